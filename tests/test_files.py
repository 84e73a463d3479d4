"""Tables of files: written back as they were read."""

from __future__ import annotations

import tomllib

import pytest

from flexdesign.core import toml_writing
from flexdesign.core.toml_files import as_text
from flexdesign.design.design import Actuator
from flexdesign.design.study import OutputSettings


def test_as_text_carries_units_and_reads_back() -> None:
    written = {
        "free_stroke": "38 um",
        "stiffness": "100 N/um",
        "preload": "20 N",
        "voltage_range": ["0 V", "150 V"],
        "contact_stiffness": "300 N/um",
    }
    actuator = Actuator.model_validate(written)
    text = as_text(actuator)
    assert text["stiffness"] == "100000 N/mm"
    assert text["voltage_range"] == ["0 V", "150 V"]
    again = Actuator.model_validate(text)
    for name in ("free_stroke", "stiffness", "contact_stiffness", "preload", "voltage_range"):
        assert getattr(again, name) == pytest.approx(getattr(actuator, name), rel=1e-6)


def test_a_table_in_a_table_carries_its_units() -> None:
    stack = {"free_stroke": "40 um", "stiffness": "60 N/um"}
    loop = {"model": "bouc-wen", "a": "0.0773 um/V", "b": "0.0165 1/V", "c": "0.004 1/V"}
    actuator = Actuator.model_validate({**stack, "hysteresis": loop})
    text = as_text(actuator)["hysteresis"]
    assert (text["model"], text["b"]) == ("bouc-wen", "0.0165 1/V")
    again = Actuator.model_validate({**stack, "hysteresis": text}).hysteresis
    assert again is not None and actuator.hysteresis is not None
    assert again.a == pytest.approx(actuator.hysteresis.a, rel=1e-6)


def test_numbers_left_out_stay_out() -> None:
    given = {name: value for name, value in as_text(OutputSettings()).items() if value is not None}
    assert given == {"actuator_offset": "0.1 mm", "large_steps": 4}
    assert as_text(OutputSettings.model_validate({"stroke": "0.2 mm"}))["stroke"] == "0.2 mm"


def test_tables_in_lists_are_read_back() -> None:
    content = {
        "title": 'a "b"',
        "top": {"rate": 1e-7, "far": float("inf"), "inner": {"of": [1, 2.5]}},
        "run": [{"file": "1.csv", "volts.high": {"u": "V", "x": [True]}}, {"file": "2.csv"}],
        "none": [],
    }
    assert tomllib.loads(toml_writing.to_toml(content)) == content

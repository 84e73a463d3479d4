"""In which units a stage model says its strokes, and reports its responses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.dynamics import stage_model
from flexdesign.dynamics.experiments import simulation
from flexdesign.dynamics.experiments.standard_experiments import plan
from flexdesign.dynamics.stage_model import ActuatorData, AxisModel, ResponseUnits, StageModel
from flexdesign.report.comparison_text import error, limit, units_of
from flexdesign.report.simulation import simulation_figures

AXIS = """format = 1
[axis.x]
natural_frequency = "100 Hz"
damping_ratio = 0.02
gain = "{gain}"
[axis.x.actuator]
{actuator}
"""


def read(folder: Path, gain: str, actuator: str = "") -> AxisModel:
    path = folder / "stage.toml"
    path.write_text(AXIS.format(gain=gain, actuator=actuator))
    return stage_model.read(path).axes["x"]


@pytest.mark.parametrize(
    ("gain", "stroke", "value", "si"),
    [
        ("1.5 um/V", "40 um", 40e-6, "m"),
        ("1.5 um/V", "250 mm", 0.25, "m"),
        ("3 urad/V", "40 um", 40e-6, "m"),  # of a stack that turns a mirror
        ("3 urad/V", "2 mrad", 2e-3, "rad"),
        ("-1.5 V/V", "1 um", 1e-6, "m"),
        ("-1.5 V/V", "800 mV", 0.8, "V"),
    ],
)
def test_a_free_stroke_is_a_length_or_in_the_unit_of_the_response(
    gain: str, stroke: str, value: float, si: str, tmp_path: Path
) -> None:
    axis = read(tmp_path, gain, f'free_stroke = "{stroke}"\nvoltage_range = ["0 V", "100 V"]')
    assert axis.actuator == ActuatorData(pytest.approx(value), (0.0, 100.0), stroke_si=si)
    (tmp_path / "again.toml").write_text(stage_model.to_toml(stage_model.read(tmp_path / "stage.toml")))
    again = stage_model.read(tmp_path / "again.toml").axes["x"].actuator
    assert again is not None and (again.free_stroke, again.stroke_si) == (pytest.approx(value, rel=1e-6), si)


def test_a_free_stroke_may_be_unknown(tmp_path: Path) -> None:
    axis = read(tmp_path, "1.5 um/V", 'voltage_range = ["0 V", "100 V"]')
    assert axis.actuator == ActuatorData(None, (0.0, 100.0)) and "actuator.free_stroke" not in axis.numbers
    assert "free_stroke" not in stage_model.to_toml(stage_model.read(tmp_path / "stage.toml"))
    assert read(tmp_path, "1.5 um/V").actuator is None


# --- the unit of a response ---------------------------------------------------------------------------------------


def with_unit(folder: Path, gain: str, unit: str) -> StageModel:
    path = folder / "stage.toml"
    path.write_text(AXIS.format(gain=gain, actuator="").replace("[axis.x]", f'[axis.x]\nunit = "{unit}"', 1))
    return stage_model.read(path)


def test_the_unit_of_a_response_is_read_and_written(tmp_path: Path) -> None:
    model = with_unit(tmp_path, "3 urad/V", "mrad")
    axis = model.axes["x"]
    assert (axis.response, axis.unit, axis.gain) == ("rad", "mrad", pytest.approx(3e-6))
    assert (axis.response_units, axis.response_units.large, axis.response_units.small) == ("rad", "mrad", "mrad")
    text = stage_model.to_toml(model)
    assert 'unit = "mrad"' in text and 'gain = "0.003 mrad/V"' in text
    (tmp_path / "again.toml").write_text(text)
    assert stage_model.read(tmp_path / "again.toml").axes == model.axes


@pytest.mark.parametrize(
    ("gain", "unit", "words"),
    [
        ("3 urad/V", "mm", "'mm' is wrong here: it is not a unit of angle; the gain is per volt of it: write for"),
        ("3 urad/V", "mrda", "unknown unit 'mrda'"),
        ("3 um/V", "mrad", "not a unit of length"),
        ("3 V/V", "um", "write for example mV or V"),
    ],
)
def test_a_unit_that_the_gain_does_not_have_is_refused(gain: str, unit: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        with_unit(tmp_path, gain, unit)
    assert str(caught.value).startswith(f"{tmp_path}/stage.toml: axis.x.unit = {unit}: ") and words in str(caught.value)


def test_sizes_are_written_in_the_unit_that_the_model_says() -> None:
    assert error(ResponseUnits("rad", "mrad"), 4.2e-6) == "0.00420 mrad"
    assert error(ResponseUnits("rad"), 4.2e-6) == error("rad", 4.2e-6) == "4.20 µrad"
    assert error(ResponseUnits("rad", "mrad").per_volt, 4.2e-3) == "4.20 mrad/V"
    assert limit(-2e-3, ResponseUnits("m", "mm")) == "-2 mm" and limit(-2e-3, ResponseUnits("m")) == limit(-2e-3, "m")
    assert units_of(ResponseUnits("m", "mm").per_volt) == ("mm/V", "mm/V")


def test_a_comparison_is_printed_in_the_unit_that_the_model_says(
    tmp_path: Path, command_line: Callable[..., Any]
) -> None:
    t = np.arange(400) / 1000
    u = 10 * np.sin(2 * np.pi * 3 * t)
    table = np.c_[t, u, 3e-3 * u + 1e-3 * np.sign(u)]
    np.savetxt(tmp_path / "slow.csv", table, delimiter=",", header="t [s],u [V],x [mrad]", comments="")
    with_unit(tmp_path, "3 urad/V", "mrad")
    said = command_line("compare", "stage.toml", "slow.csv")
    assert said.code == 0 and "Stroke: 0.0620 mrad" in said.stdout
    assert " mrad rms" in said.stdout and "µrad" not in said.stdout
    (tmp_path / "stage.toml").write_text(AXIS.format(gain="3 urad/V", actuator=""))
    said = command_line("compare", "stage.toml", "slow.csv")
    assert "Stroke: 62.0 µrad" in said.stdout and "mrad" not in said.stdout


def test_a_simulation_is_measured_in_the_unit_that_the_model_says(tmp_path: Path) -> None:
    model = with_unit(tmp_path, "1 mm/V", "mm")
    axis = replace(model.axes["x"], actuator=ActuatorData(None, (0.0, 10.0)))
    stage = replace(model, axes={"x": axis})
    of_voltage = replace(plan(stage), experiments=plan(stage).experiments[:1])
    found = simulation.run(stage, {}, of_voltage, lambda _: None)
    seen = {q.name: q for case in found.cases for q in case.measures["x"]}
    assert seen["amplitude"].unit == "mm" and all("um" not in q.unit for q in seen.values())
    drawn = simulation_figures.draw(found.cases[0].experiment, found.cases[:1], axis.response_units)
    assert b"x [mm]" in drawn[0].data and "µm".encode() not in drawn[0].data

"""In which units a stage model says its strokes, and reports its responses."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexdesign import stage_model
from flexdesign.stage_model import ActuatorData, AxisModel

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

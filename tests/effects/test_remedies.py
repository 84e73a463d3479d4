"""What one can do about an effect depends on what drives the axis."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from flexdesign import effects
from flexdesign.core.errors import InputError
from flexdesign.core.model import ACTUATORS, PIEZO
from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.dynamics import stage_model
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import ActuatorData, AxisModel

#: Words that mean nothing to who has a motor, a coil or a circuit.
OF_STACKS = re.compile(r"stack|charge amplifier|capacitance|monolithic|flexure|hinge|bridge|seat|piezo")
AXIS = AxisModel(100.0, 0.02, 1e-6)


@pytest.mark.parametrize("name", effects.names())
def test_the_neutral_remedy_speaks_of_no_stack(name: str) -> None:
    effect = effects.find(name)
    assert not OF_STACKS.search(effect.remedy), effect.remedy
    for actuator, remedy in effect.remedies.items():
        assert actuator in ACTUATORS and remedy != effect.remedy and len(remedy) > 15
        assert actuator == PIEZO or not re.search("stack|charge amplifier|capacitance|piezo", remedy)
        assert effect.remedy_for(actuator) == remedy
    assert effect.remedy_for() == effect.remedy_for("other") == effect.remedy


def test_a_remedy_for_an_unknown_actuator_is_refused() -> None:
    with pytest.raises(ValueError, match="has a remedy for 'voicecoil'; known actuators: piezo stack, voice coil"):
        replace(effects.find("creep"), remedies={"voicecoil": "turn it off and on"})


@pytest.mark.parametrize(
    ("actuator", "driven_by"),
    [
        (None, ""),
        (ActuatorData(40e-6, (0.0, 100.0)), ""),
        (ActuatorData(40e-6, (0.0, 100.0), stiffness=6e7), PIEZO),
        (ActuatorData(capacitance=1e-6), PIEZO),
        (ActuatorData(40e-6, kind="motor"), "motor"),
        (ActuatorData(preload=10.0, kind="voice coil"), "voice coil"),
    ],
)
def test_a_model_says_what_drives_it_or_numbers_of_a_stack_do(actuator: ActuatorData | None, driven_by: str) -> None:
    assert replace(AXIS, actuator=actuator).driven_by == driven_by


def test_the_class_of_an_actuator_is_read_and_written(tmp_path: Path) -> None:
    path = tmp_path / "drive.toml"
    text = 'format = 1\n[axis.x]\nnatural_frequency = "19 Hz"\ndamping_ratio = 0.4\ngain = "1 mm/V"\n'
    path.write_text(text + '[axis.x.actuator]\nkind = "motor"\n')
    model = stage_model.read(path)
    assert model.axes["x"].driven_by == "motor"
    assert "guides and nut" in effects.find("coulomb_friction").remedy_for(model.axes["x"].driven_by)
    path.write_text(stage_model.to_toml(model))
    assert stage_model.read(path).axes == model.axes
    path.write_text(text + '[axis.x.actuator]\nkind = "stepper"\n')
    with pytest.raises(InputError, match=r'axis\.x\.actuator\.kind = stepper: expected "piezo stack" or "voice coil"'):
        stage_model.read(path)


@pytest.mark.parametrize("kind", ["", *ACTUATORS])
def test_no_effect_of_a_piezo_stack_is_tried_on_another_actuator(kind: str) -> None:
    """The extension of a motor has no part that grows with the square of a field."""
    model = AxisDynamics("x", replace(AXIS, actuator=ActuatorData(40e-6, kind=kind)))
    tried = {candidate.name for candidate in candidates(model)}
    of_stacks = {"electrostriction", "asymmetric_hysteresis", "pair_mismatch"}
    assert tried & of_stacks == (set() if kind in {"motor", "voice coil"} else of_stacks)
    assert {"coulomb_friction", "bouc_wen", "second_mode"} <= tried

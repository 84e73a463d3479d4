"""Recordings that flexdesign simulates itself are diagnosed as what they are: conventions agree on both sides."""

from __future__ import annotations

import pytest

from flexdesign.dynamics import stage_dynamics, stage_model
from studies.round_trips.__main__ import AXIS, STAGE, round_trip, with_effect


@pytest.mark.parametrize(
    ("effect", "seed"),
    [
        ("thermal_expansion", 8),  # it does not show, and the stage was cycled before: beyond one way out and back
        ("base_motion", 9),  # in another phase than that where a fit of the validation run begins
    ],
)
def test_round_trip(effect: str, seed: int) -> None:
    found = round_trip(effect, "hold", seed)
    assert found.is_right
    assert found.verdict == ("nothing-missing" if effect == "thermal_expansion" else "effects-found")


@pytest.mark.parametrize("effect", ["prandtl_ishlinskii", "coulomb_friction", "creep"])
def test_two_hystereses_have_one_past(effect: str) -> None:
    axis = with_effect(stage_model.read(STAGE), effect)[0].axes[AXIS]
    assert (stage_dynamics.cycled(axis) is axis) == (effect != "creep")

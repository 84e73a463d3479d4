"""Recordings that flexdesign simulates itself are diagnosed as what they are: conventions agree on both sides."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from flexdesign.dynamics import stage_dynamics, stage_model
from studies.round_trips.__main__ import AXIS, SEEN, STAGE, outcome, rms, round_trip, with_effect


@pytest.mark.parametrize(
    ("effect", "seed"),
    [
        ("thermal_expansion", 8),  # it does not show, and the stage was cycled before: beyond one way out and back
        ("base_motion", 9),  # in another phase than that where a fit of the validation run begins
        pytest.param("driver_slew", 10, marks=pytest.mark.slow),  # it does not show
        # From a stage that was never driven before: no voltage had turned.
        pytest.param("coulomb_friction", 10, marks=pytest.mark.slow),
        # One of its numbers does not show, and ends anywhere.
        pytest.param("rate_dependent_hysteresis", 10, marks=pytest.mark.slow),
    ],
)
def test_round_trip(effect: str, seed: int) -> None:
    found = round_trip(effect, "hold", seed)
    assert found.is_right
    assert found.verdict == ("nothing-missing" if effect in ("thermal_expansion", "driver_slew") else "effects-found")


@pytest.mark.parametrize("effect", ["prandtl_ishlinskii", "coulomb_friction", "creep"])
def test_two_hystereses_have_one_past(effect: str) -> None:
    axis = with_effect(stage_model.read(STAGE), effect)[0].axes[AXIS]
    assert (stage_dynamics.after_full_cycles(axis) is axis) == (effect != "creep")


@pytest.mark.parametrize(("missed", "named", "is_right"), [(0.5, ("creep",), True), (0.5, (), False), (0.1, (), True)])
def test_what_calibration_imitates_should_not_be_named(missed: float, named: tuple[str, ...], is_right: bool) -> None:
    effects = tuple(SimpleNamespace(name=name, values=()) for name in named)
    found: Any = SimpleNamespace(effects=effects, confusable=(), verdict="")
    assert (missed < SEEN) is (missed == 0.1)
    assert outcome("creep", "hold", 5.0, missed, {}, found).is_right is is_right


def test_offsets_and_gaps_are_no_errors() -> None:
    assert rms([np.array([4.0, 2.0, np.nan]), np.array([-9.0, -7.0])]) == pytest.approx(1.0)

"""Readings of more than an axis' own motion: in open and closed loops against the balance at rest."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from flexdesign.dynamics import disturbances
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.control import pid as pids
from flexdesign.dynamics.simulate import Loop, simulate
from flexdesign.dynamics.stage_model import AxisModel, StageModel

PERIOD = 1e-3
PLAIN = AxisModel(100.0, 0.5, 2e-6)
#: It follows with a rate of kp gain / ti = 50 1/s: after 0.59 s nothing is left.
SETTLING = pids.controller(pids.PID(kp=0.05 / 2e-6, ti=1e-3), "settling")


def with_effects(axis: AxisModel, **effects: dict[str, float]) -> AxisModel:
    return replace(axis, effects=effects)


def step(size: float) -> Any:
    return np.where(np.arange(600) < 10, 0.0, size)


def test_a_resting_sensor_reads_its_share_of_another_axis() -> None:
    tilted = with_effects(PLAIN, abbe_error={"linear": 0.03})
    response = disturbances.run(StageModel({"x": tilted, "y": PLAIN}), {"y": Loop(step(20.0))}, PERIOD, oversampling=3)
    x, y = response.motion
    assert not x.any() and np.ptp(y) > 39e-6
    # Between the samples of the clock the share goes straight.
    assert response.reading[0, ::3] == pytest.approx(0.03 * y[::3], abs=1e-6 * np.ptp(y))


def test_loops_that_read_each_other_come_to_rest_where_both_readings_are_as_asked() -> None:
    """x + a y = r, y + b x + c x^2 = s."""
    a, b, c, r, s = 0.2, -0.1, 500.0, 10e-6, 4e-6
    model = StageModel(
        {
            "x": with_effects(PLAIN, abbe_error={"linear": a}),
            "y": with_effects(PLAIN, cross_coupling={"linear": b, "quadratic": c}),
        }
    )
    loops = {name: Loop(step(0.0), step(size), (SETTLING,)) for name, size in (("x", r), ("y", s))}
    response = disturbances.run(model, loops, PERIOD)
    x, y = response.motion[:, -1]
    assert (x + a * y, y + b * x + c * x**2) == pytest.approx((r, s), rel=1e-5)
    assert abs(x - r) > 0.05 * r and response.error < 1e-5


def test_without_such_effects_it_is_the_engine_alone() -> None:
    model = StageModel({"x": with_effects(PLAIN, mains_hum={"amplitude": 1e-7, "frequency": 50.0, "phase": 0.0})})
    loops = {"x": Loop(step(5.0))}
    mine, engine = disturbances.run(model, loops, PERIOD), simulate(stages.stage(model), loops, PERIOD)
    assert np.array_equal(mine.reading, engine.reading) and not np.array_equal(mine.reading, mine.motion)


def test_what_experiments_do_not_have_is_said() -> None:
    axis = with_effects(PLAIN, thermal_expansion={"coefficient": 1e-6}, abbe_error={"linear": 0.01})
    alone, two = StageModel({"x": axis}), StageModel({"x": axis, "y": PLAIN})
    assert disturbances.inactive_disturbances(alone, "x") == [
        "thermal expansion needs a record of T, which is not there: it adds nothing here.",
        "abbe error needs another axis, which is not there: it adds nothing here.",
    ]
    assert len(disturbances.inactive_disturbances(two, "x")) == 1 and not disturbances.inactive_disturbances(two, "y")

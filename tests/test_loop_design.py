"""Controllers for an axis: analysis beside experiment, and plants of either sign."""

from __future__ import annotations

import dataclasses

import pytest

from flexdesign.dynamics.experiments import Plan
from flexdesign.dynamics.experiments.loop_design import Designer, plant
from flexdesign.dynamics.stage_model import AxisModel, Mode
from flexdesign.dynamics.stage_model.axis import ActuatorData

PERIOD = 1e-3
PLAN = Plan("made up", "", "", (), {}, {}, 1.6, True)
AXIS = AxisModel(118.3, 0.0242, 2e-6, actuator=ActuatorData(40e-6, (0.0, 150.0)))
HYSTERESIS = {"a": 0.46e-6, "b": 0.0165, "c": 0.004, "n": 1.0, "rest": 0.0}


@pytest.mark.parametrize("delay", [0.0, 1.4e-3])
def test_the_experiment_on_a_linear_stage_gives_what_analysis_gives(delay: float) -> None:
    designer = Designer(PLAN, PERIOD)
    analytic = designer.pid("ziegler-nichols", "x", AXIS, delay)
    tried = designer.pid("ziegler-nichols by experiment", "x", AXIS, delay)
    assert tried.kp == pytest.approx(analytic.kp, rel=2e-3)
    assert tried.ti == pytest.approx(analytic.ti, rel=1e-3)


def test_the_experiment_sees_the_lags_that_analysis_sees() -> None:
    """Taken as delays of the same length, these lags would give an ultimate gain lower by 9 %."""
    driver, sensor = (
        dataclasses.replace(AXIS.driver, bandwidth=300.0),
        dataclasses.replace(AXIS.sensor, bandwidth=800.0),
    )
    axis, designer = dataclasses.replace(AXIS, driver=driver, sensor=sensor), Designer(PLAN, PERIOD)
    analytic = designer.pid("ziegler-nichols", "x", axis, 0.4e-3)
    tried = designer.pid("ziegler-nichols by experiment", "x", axis, 0.4e-3)
    assert tried.kp == pytest.approx(analytic.kp, rel=2e-3)
    assert tried.ti == pytest.approx(analytic.ti, rel=1e-3)


def test_hysteresis_holds_back_small_oscillations_and_allows_more_gain() -> None:
    """Around a turning point the slope is k_v - a, less than the secant that analysis takes."""
    axis = dataclasses.replace(AXIS, effects={"bouc_wen": HYSTERESIS})
    designer = Designer(PLAN, PERIOD)
    analytic = designer.pid("ziegler-nichols", "x", axis, 0.0)
    tried = designer.pid("ziegler-nichols by experiment", "x", axis, 0.0)
    most = plant(axis, 0.0).static_gain / (AXIS.gain - HYSTERESIS["a"])
    assert 1.0 < tried.kp / analytic.kp < most * 1.01


@pytest.mark.parametrize("piece", ["ziegler-nichols", "ziegler-nichols by experiment", "robust"])
def test_a_negative_gain_turns_the_controller_round(piece: str) -> None:
    turned = dataclasses.replace(AXIS, gain=-AXIS.gain)
    designer = Designer(PLAN, PERIOD)
    upright, mirrored = (designer.pid(piece, "x", axis, 0.0) for axis in (AXIS, turned))
    assert mirrored.kp == pytest.approx(-upright.kp, rel=1e-9)
    assert mirrored.ti == pytest.approx(upright.ti, rel=1e-9)


def test_a_linear_design_sees_all_modes_and_lags() -> None:
    axis = dataclasses.replace(
        AXIS,
        modes=(Mode(345.0, 0.01, 0.25),),
        driver=dataclasses.replace(AXIS.driver, gain=10.0, bandwidth=500.0),
        sensor=dataclasses.replace(AXIS.sensor, bandwidth=2000.0),
    )
    seen = plant(axis, 1e-3)
    assert seen.static_gain == pytest.approx(10.0 * AXIS.gain, rel=1e-12)
    assert seen.gain == pytest.approx(0.75 * 10.0 * AXIS.gain, rel=1e-12)
    assert seen.delay == 1e-3
    # A bandwidth is where a lag has fallen to 1/sqrt(2) and trails by 45 deg.
    bare = dataclasses.replace(seen, lags=())
    for bandwidth, lag in zip((500.0, 2000.0), seen.lags, strict=True):
        ratio = dataclasses.replace(bare, lags=(lag,)).response(bandwidth) / bare.response(bandwidth)
        assert ratio == pytest.approx((1 - 1j) / 2, rel=1e-12)
    assert plant(AXIS, 1e-3).lags == ()

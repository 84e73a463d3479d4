"""Ultimate gains against closed forms, and the experiment against the analysis."""

from __future__ import annotations

import math

import control as ct
import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.dynamics.control.pid import PID
from flexdesign.dynamics.control.plant import Plant
from flexdesign.dynamics.control.sampled_loop import simulate
from flexdesign.dynamics.control.ziegler_nichols import Ultimate, by_experiment, from_rule, oscillation, rule, ultimate

PERIOD = 1e-3
LIGHT, DELAYED = Plant(6.0777, 118.3, 0.0242), Plant(6.0777, 128.8, 0.063, 2e-3)
REAL = Plant.from_time_constants(6.0777, 1.3708e-3, 1.3635e-3)
LAGGING = Plant(6.0777, 128.8, 0.063, lags=(0.3e-3, 0.1e-3))


@pytest.mark.parametrize("delay", [0, 1, 2, 5])
def test_integrator_with_delay(delay: int) -> None:
    """z^d (z - 1) + K = 0 on the circle: w = pi / (2 d + 1), K = 2 sin(w / 2)."""
    found = ultimate(ct.tf([1], [1, -1] + [0] * delay, PERIOD))
    w = math.pi / (2 * delay + 1)
    assert found == pytest.approx((2 * math.sin(w / 2), 2 * math.pi / w * PERIOD), rel=1e-9)


def test_held_first_order_lag_with_one_sample_of_delay() -> None:
    """z (z - p) + K (1 - p) = 0: the product of the poles is 1 at K = 1 / (1 - p), their sum 2 cos w = p."""
    p = math.exp(-0.4)
    found = ultimate(ct.tf([1 - p], [1, -p, 0], PERIOD))
    assert found == pytest.approx((1 / (1 - p), 2 * math.pi / math.acos(p / 2) * PERIOD), rel=1e-9)


def test_held_first_order_lag_without_delay() -> None:
    """z = p - K (1 - p) reaches -1: K = (1 + p) / (1 - p), two samples per period."""
    p = math.exp(-0.4)
    found = ultimate(ct.tf([1 - p], [1, -p], PERIOD))
    assert found == pytest.approx(((1 + p) / (1 - p), 2 * PERIOD), rel=1e-9)


def test_held_resonance() -> None:
    """z^2 + a1 z + a2 + K (b1 z + b2): the product of the poles is 1 at K = (1 - a2) / b2."""
    system = ct.tf(LIGHT.discretise(PERIOD))
    b1, b2 = system.num[0][0][-2:]
    _, a1, a2 = system.den[0][0]
    gain = (1 - a2) / b2
    found = ultimate(LIGHT.discretise(PERIOD))
    assert found.gain == pytest.approx(gain, rel=1e-9)
    assert found.period == pytest.approx(2 * math.pi / math.acos(-(a1 + gain * b1) / 2) * PERIOD, rel=1e-9)


@pytest.mark.parametrize("lag", [0.1e-3, 1e-3, 10e-3])
def test_mode_and_lag_tend_to_the_continuous_loop(lag: float) -> None:
    """Routh on (1 + 2 zeta s / w + s^2 / w^2)(1 + tau s) + K: a1 a2 = a0 a3, and the loop oscillates at sqrt(a1/a3)."""
    w, zeta = 2 * math.pi * 118.3, 0.2
    a1, a2, a3 = 2 * zeta / w + lag, 1 / w**2 + 2 * zeta * lag / w, lag / w**2
    exact = (a1 * a2 / a3 - 1, 2 * math.pi / math.sqrt(a1 / a3))
    plant = Plant(1.0, 118.3, zeta, lags=(lag,))
    short = min(lag, 1 / w) / 50
    errors = np.array([ultimate(plant.discretise(period)) for period in (short, short / 2)]) / exact - 1
    # A hold delays by half a period: the error is of first order, and extrapolated of second, about (1/50)^2.
    np.testing.assert_allclose(errors[0] / errors[1], 2.0, rtol=0.05)
    np.testing.assert_allclose(2 * errors[1] - errors[0], 0.0, atol=4e-4)


def test_the_gain_scales_inversely_with_the_plants_over_many_decades() -> None:
    one, tiny = (ultimate(Plant(g, 118.3, 0.0242, 1.4e-3).discretise(PERIOD)) for g in (1.0, 1e-7))
    assert tiny.gain == pytest.approx(one.gain * 1e7, rel=1e-9)


def test_printed_transfer_function_gives_other_gains_than_the_printed_ones() -> None:
    """Lin et al. (2019): eq (31) with the 1 ms hold gives 0.741, eq (34) prints 0.01355."""
    assert rule(ultimate(REAL.discretise(PERIOD))).kp == pytest.approx(0.741, abs=5e-4)


def test_the_rule_and_its_inverse() -> None:
    assert from_rule(rule(Ultimate(0.0226, 7.976e-3))) == pytest.approx((0.0226, 7.976e-3))
    assert rule(Ultimate(10.0, 0.8)) == PID(6.0, 0.4, 0.1)


@pytest.mark.parametrize("plant", [LIGHT, DELAYED, REAL, Plant(6.3621, 177.57, 0.255, 1.46e-3), LAGGING])
def test_experiment_finds_what_the_analysis_says(plant: Plant) -> None:
    def respond(kp: float) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore"):  # far too large gains run beyond all numbers
            return simulate(plant, PID(kp), np.ones(1200), PERIOD, substeps=1).output

    found, exact = by_experiment(respond, PERIOD, start=0.005), ultimate(plant.discretise(PERIOD))
    # Bracket 1e-4, and growth counts as none below 1e-5 per oscillation: 1e-4 of the gain on the lightest plant.
    assert found.gain == pytest.approx(exact.gain, rel=3e-4)
    assert found.period == pytest.approx(exact.period, rel=1e-4)


@pytest.mark.parametrize(("limit", "drift"), [(0.1, 0.0), (math.inf, 2e-5)])
def test_experiment_on_a_loop_with_limits_or_drift_and_with_offset_and_noise(limit: float, drift: float) -> None:
    """A growing oscillation that the limits hold to a constant amplitude must count as beyond the boundary."""
    plant, noise = LIGHT, np.random.default_rng(2).uniform(-1e-4, 1e-4, size=2000)
    stage = plant.sampled(PERIOD)

    def respond(kp: float) -> np.ndarray:
        x, readings = np.zeros(len(stage.a)), np.zeros(2000)
        for k in range(2000):
            readings[k] = stage.c @ x + 0.2 + drift * k + noise[k]
            command = min(max(kp * ((1.0 if k > 5 else 0.0) - readings[k]), -limit), limit)
            x = stage.a @ x + stage.b * command
        return readings

    found, exact = by_experiment(respond, PERIOD, 0.005, noise=2e-4), ultimate(plant.discretise(PERIOD))
    # Noise of 1e-3 of the amplitude blurs the growth rate by some 1e-5 per oscillation: 1e-3 of the gain.
    assert found.gain == pytest.approx(exact.gain, rel=5e-3)
    assert found.period == pytest.approx(exact.period, rel=1e-3)


def test_growth_and_frequency_of_a_known_oscillation() -> None:
    t = np.arange(1500) * PERIOD
    record = 3.0 + 0.5 * t + 2.0 * np.exp(-0.05 * t) * np.cos(2 * math.pi * 125.37 * t + 0.4)
    found = oscillation(record, PERIOD)
    assert found.frequency == pytest.approx(125.37, rel=1e-7)
    # Window by window the decay is a factor exp(-0.05 * 0.094): the fit's error is of its second order.
    assert found.growth == pytest.approx(-0.05, rel=1e-2)
    assert found.amplitude == pytest.approx(2.0 * math.exp(-0.05 * 1.5), rel=1e-2)


def test_a_plant_without_ultimate_gain_is_refused() -> None:
    with pytest.raises(InputError, match="no ultimate gain"):
        ultimate(ct.tf([0.1, 0], [1, -0.9], PERIOD))
    with pytest.raises(InputError, match="unstable under small"):
        ultimate(ct.tf([0.1], [1, -1.1], PERIOD))


def test_experiments_that_cannot_work_are_refused() -> None:
    with pytest.raises(InputError, match="start"):
        by_experiment(lambda kp: np.zeros(2000), PERIOD, 0.0)
    with pytest.raises(InputError, match="decays at every gain"):
        by_experiment(lambda kp: np.exp(-np.arange(2000.0)), PERIOD, 1.0)
    with pytest.raises(InputError, match="make it longer"):
        by_experiment(lambda kp: np.sin(0.01 * np.arange(2000)), PERIOD, 1.0)
    with pytest.raises(InputError, match="too short"):
        oscillation(np.zeros(50), PERIOD)

"""The sampled plant against python-control, closed forms, and an integrator that knows no z-transform."""

from __future__ import annotations

import math

import control as ct
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexdesign.core.errors import InputError
from flexdesign.dynamics.control.plant import Plant

PERIOD = 1e-3
ANGLES = np.array([0.01, 0.3, 0.74, 1.5, 3.0])


@pytest.mark.parametrize("damping_ratio", [0.0242, 0.5, 1.0, 3.0])
def test_without_delay_it_is_python_controls_zero_order_hold(damping_ratio: float) -> None:
    plant = Plant(6.0777, 118.3, damping_ratio)
    w = 2 * math.pi * 118.3
    theirs = ct.sample_system(ct.tf([6.0777 * w**2], [1, 2 * damping_ratio * w, w**2]), PERIOD, "zoh")
    z = np.exp(1j * ANGLES)
    # Two matrix exponentials, each good to about 1e-14 of its norm.
    np.testing.assert_allclose(plant.discretise(PERIOD)(z), theirs(z), rtol=1e-10)


def test_a_whole_delay_is_a_power_of_z_and_costs_no_further_state() -> None:
    plain, late = (Plant(2.0, 118.3, 0.05, delay).discretise(PERIOD) for delay in (0.0, 3 * PERIOD))
    z = np.exp(1j * ANGLES)
    np.testing.assert_allclose(late(z), plain(z) * z**-3, rtol=1e-12)
    assert late.nstates == plain.nstates + 3


@pytest.mark.parametrize("delay", [0.3e-3, 1.4e-3, 2.9999e-3])
def test_fractional_delay_and_output_between_samples_against_an_integrator(delay: float) -> None:
    plant = Plant(2.0, 118.3, 0.05, delay, modes=((300.0, 0.02, 0.3),))
    commands = np.random.default_rng(3).normal(size=12)
    stage = plant.sampled(PERIOD, substeps=5)
    x, ours = np.zeros(len(stage.a)), []
    for u in commands:
        ours.extend(stage.between @ x + stage.direct * u)
        x = stage.a @ x + stage.b * u
    moments = np.arange(len(ours)) * PERIOD / 5
    theirs = _integrated(plant, commands, moments)
    # The integrator's tolerance is 1e-10 per step, over about 1000 steps.
    np.testing.assert_allclose(ours, theirs, atol=1e-7 * np.ptp(theirs))


def _integrated(plant: Plant, commands: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Integrate mode by mode from one jump of the delayed command to the next."""
    jumps = np.arange(len(commands)) * PERIOD + plant.delay
    total = np.zeros(len(moments))
    for frequency, damping, share in plant.all_modes:
        w, state = 2 * math.pi * frequency, np.zeros(2)
        for start, end, u in zip(jumps, [*jumps[1:], math.inf], commands, strict=True):
            end = min(end, moments[-1] + PERIOD)
            if end <= start:
                break

            def rates(_: float, s: np.ndarray, w: float = w, damping: float = damping, u: float = u) -> list[float]:
                return [s[1], w**2 * (u - s[0]) - 2 * damping * w * s[1]]

            run = solve_ivp(rates, (start, end), state, "DOP853", rtol=1e-11, atol=1e-14, dense_output=True)
            state, here = run.y[:, -1], (moments >= start) & (moments < end)
            if np.any(here):
                total[here] += plant.gain * share * run.sol(moments[here])[0]
    return total


@pytest.mark.parametrize("lags", [(0.3e-3,), (2e-3, 0.1e-3), (1e-3, 1e-3, 5e-6)])
def test_lags_are_in_series_with_all_modes(lags: tuple[float, ...]) -> None:
    """python-control: the modes in parallel, the lags in series, held at zero order."""
    plant = Plant(2.0, 118.3, 0.05, 2 * PERIOD, ((300.0, 0.02, -0.3),), lags)
    # Joined in state space: the coefficients of one long polynomial in s would cost the reference ten digits.
    series = ct.parallel(*(_mode(2.0 * share, *mode) for *mode, share in plant.all_modes))
    for lag in lags:
        series = ct.series(ct.ss(-1 / lag, 1 / lag, 1.0, 0.0), series)
    f, z = np.array([1.0, 80.0, 118.3, 250.0, 900.0]), np.exp(1j * ANGLES)
    np.testing.assert_allclose(plant.response(f), series(2j * np.pi * f) * np.exp(-4j * np.pi * f * PERIOD), rtol=1e-10)
    theirs = ct.sample_system(series, PERIOD, "zoh")
    np.testing.assert_allclose(plant.discretise(PERIOD)(z), theirs(z) * z**-2, rtol=1e-9)


def _mode(gain: float, frequency: float, damping: float) -> ct.StateSpace:
    w = 2 * math.pi * frequency
    return ct.ss([[0.0, 1.0], [-(w**2), -2 * damping * w]], [[0.0], [w**2]], [[gain, 0.0]], 0.0)


@pytest.mark.parametrize("delay", [0.0, 0.3e-3, 2.9999e-3])
def test_lags_with_fractional_delay_and_between_samples_against_partial_fractions(delay: float) -> None:
    plant = Plant(2.0, 118.3, 0.05, delay, ((300.0, 0.02, 0.3),), (0.8e-3, 0.1e-3))
    commands = np.random.default_rng(4).normal(size=12)
    stage = plant.sampled(PERIOD, substeps=5)
    x, ours = np.zeros(len(stage.a)), []
    for u in commands:
        ours.extend(stage.between @ x + stage.direct * u)
        x = stage.a @ x + stage.b * u
    moments = np.arange(len(ours)) * PERIOD / 5
    jumps = np.arange(len(commands)) * PERIOD + delay
    theirs = sum(u * _step(plant, moments - at) for at, u in zip(jumps, np.diff(commands, prepend=0.0), strict=True))
    # Both are exact; the residual is rounding over 60 moments.
    np.testing.assert_allclose(ours, theirs, atol=1e-11 * np.ptp(theirs))


def _step(plant: Plant, times: np.ndarray) -> np.ndarray:
    """Return the step response without delay, sum of 1 + exp(p t) / prod(1 - p / q) over the other poles q."""
    since = np.maximum(times, 0.0)
    total = np.zeros(len(times))
    for frequency, damping, share in plant.all_modes:
        pair = 2 * math.pi * frequency * np.array([1, -1]) * 1j * np.sqrt(1 - damping**2 + 0j)
        poles = np.concatenate([pair - 2 * math.pi * frequency * damping, [-1 / lag for lag in plant.lags]])
        for i, pole in enumerate(poles):
            total -= share * np.real(np.exp(pole * since) / np.prod(1 - pole / np.delete(poles, i)))
        total += share
    return plant.gain * np.where(times > 0, total, 0.0)


def test_a_lag_that_is_over_at_once_changes_nothing() -> None:
    plain, quick = (Plant(2.0, 118.3, 0.05, 1.4e-3, lags=lags).discretise(PERIOD) for lags in ((), (1e-9,)))
    z = np.exp(1j * ANGLES)
    # A lag of tau shifts the response by tau: 1e-9 s beside 1e-3 s, times an angle of up to 3 and what L gains there.
    np.testing.assert_allclose(quick(z), plain(z), rtol=1e-4)


def test_time_constants_give_the_poles_back() -> None:
    plant = Plant.from_time_constants(6.0777, 1.3708e-3, 1.3635e-3)
    s = 2j * math.pi * 80.0
    assert plant.response(80.0) == pytest.approx(6.0777 / ((1 + 1.3708e-3 * s) * (1 + 1.3635e-3 * s)), rel=1e-12)


def test_phase_is_not_wrapped() -> None:
    plant = Plant(1.0, 100.0, 0.02, delay=10e-3)
    assert plant.phase([100.0, 1000.0]) == pytest.approx([-90 - 360, -180 - 3600 + math.degrees(0.04 / 9.9)], abs=1e-3)


def test_phase_is_not_wrapped_behind_lags() -> None:
    """Far above everything, two lags and a mode trail by 360 deg; at the end of its bandwidth a lag by 45 deg."""
    corner = 1 / (2 * math.pi * 100.0)
    plant = Plant(1.0, 100.0, 0.02, lags=(corner, corner))
    assert plant.phase(100.0) == pytest.approx(-90 - 2 * 45, abs=1e-9)
    # Of the lags atan(1e-4) each is left, of the mode atan(2 0.02 1e-4).
    assert plant.phase(1e6) == pytest.approx(-360 + math.degrees(2e-4 + 4e-6), abs=1e-6)


def test_shifting_keeps_the_static_gain_and_the_lags() -> None:
    plant = Plant(2.0, 100.0, 0.02, modes=((300.0, 0.02, 0.5),), lags=(1e-3,))
    assert plant.shifted(1.03).lags == (1e-3,)
    assert plant.shifted(1.03).all_modes[1].natural_frequency == pytest.approx(309.0)
    assert plant.shifted(1.03).static_gain == plant.static_gain == pytest.approx(3.0)
    assert plant.discretise(PERIOD).dcgain() == pytest.approx(3.0, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"natural_frequency": 0.0}, "natural_frequency"),
        ({"damping_ratio": -0.1}, "damping_ratio"),
        ({"delay": -1e-3}, "delay"),
        ({"gain": math.nan}, "gain"),
        ({"modes": ((-5.0, 0.1, 1.0),)}, "modes.1.natural_frequency"),
        ({"lags": (0.0,)}, "lags.1"),
        ({"lags": (1e-3, -1e-3)}, "lags.2"),
        ({"lags": (math.inf,)}, "lags.1"),
    ],
)
def test_what_is_no_plant_is_refused_by_name(change: dict[str, object], field: str) -> None:
    with pytest.raises(InputError, match=f"plant: {field}"):
        Plant(**{"gain": 1.0, "natural_frequency": 100.0, "damping_ratio": 0.1, **change})  # type: ignore[arg-type]


def test_a_period_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="loop: period"):
        Plant(1.0, 100.0, 0.1).sampled(0.0)


def test_coarse_sampling_is_said_and_fine_sampling_is_not() -> None:
    assert "too coarse" in Plant(1.0, 300.0, 0.02).concerns(PERIOD)[0]
    assert Plant(1.0, 118.3, 0.02).concerns(PERIOD) == []
    assert Plant(1.0, 118.3, 0.02, lags=(1e-6,)).concerns(PERIOD) == []

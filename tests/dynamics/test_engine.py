"""The engine against closed forms: what must come out exactly does, at any number of steps."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.core.model import Controller
from flexdesign.dynamics.signal_chain.chain import AxisChain, Oscillator
from flexdesign.dynamics.simulate import Loop, Stage, simulate

PERIOD = 1e-3
GAIN = 2e-6
MAIN = Oscillator(118.3, 0.0242)
Array = NDArray[np.float64]


def axis(*names: str, name: str = "x", modes: tuple[Oscillator, ...] = (MAIN,), **values: float) -> AxisChain:
    """An axis with effects at their starting values, or those given."""
    found = [effects.find(effect) for effect in names]
    given = [(e, {p.name: values.get(p.name, p.start or 0.0) for p in e.parameters}) for e in found]
    return AxisChain(name, GAIN, modes, tuple(given))


def step_response(t: Array, mode: Oscillator) -> Array:
    """Closed form for an underdamped mode of unit static response."""
    w, z = 2 * np.pi * mode.frequency, mode.damping_ratio
    wd = w * math.sqrt(1 - z * z)
    late = np.maximum(t, 0.0)
    return np.where(t >= 0, 1 - np.exp(-z * w * late) * (np.cos(wd * late) + z * w / wd * np.sin(wd * late)), 0.0)


def run(chain: AxisChain, command: Array, **options: object) -> Array:
    return simulate(Stage((chain,)), {"x": Loop(command)}, PERIOD, **options).motion[0]  # type: ignore[arg-type]


@pytest.mark.parametrize("substeps", [1, 3])
@pytest.mark.parametrize("delay", [0.0, 1e-3, 0.3e-3, 2.7e-3])
def test_held_step_is_exact_however_late_it_acts(substeps: int, delay: float) -> None:
    command = np.full(200, 10.0)
    found = run(axis(), command, substeps=substeps, delay=delay)
    t = PERIOD * np.arange(200) - delay
    assert found == pytest.approx(10 * GAIN * step_response(t, MAIN), abs=1e-12 * GAIN)


@pytest.mark.parametrize("delay", [0.0, 0.3e-3, 1.7e-3])
def test_linear_command_is_exact_however_late_it_acts(delay: float) -> None:
    """A ramp into a mode: x = g (t - 2 zeta/w + transient)."""
    t = PERIOD * np.arange(300)
    found = run(axis(), 5e3 * t, between_samples="linear", substeps=1, delay=delay)
    w, z = 2 * np.pi * MAIN.frequency, MAIN.damping_ratio
    wd, s = w * math.sqrt(1 - z * z), np.maximum(t - delay, 0.0)
    transient = np.exp(-z * w * s) * (2 * z / w * np.cos(wd * s) + (2 * z * z - 1) / wd * np.sin(wd * s))
    assert found == pytest.approx(GAIN * 5e3 * (s - 2 * z / w + transient), abs=1e-11 * GAIN * 1500)


def test_a_chain_with_nothing_before_its_modes_runs() -> None:
    chain = AxisChain("x", 1.0, (MAIN,))
    t = PERIOD * np.arange(50)
    assert run(chain, np.ones(50), substeps=1) == pytest.approx(step_response(t, MAIN), abs=1e-12)


def test_modes_add_up() -> None:
    modes = (Oscillator(118.3, 0.0242, 0.75), Oscillator(345.0, 0.01, 0.25))
    found = run(axis(modes=modes), np.ones(100), substeps=1)
    t = PERIOD * np.arange(100)
    assert found == pytest.approx(GAIN * sum(m.share * step_response(t, m) for m in modes), abs=1e-12 * GAIN)


@pytest.mark.parametrize("frequency", [20.0, 500.0, 20e3])
def test_driver_lag_is_exact_at_any_number_of_steps(frequency: float) -> None:
    response = simulate(
        Stage((axis("driver_bandwidth", bandwidth=frequency),)), {"x": Loop(np.ones(50))}, PERIOD, substeps=1
    )
    t = PERIOD * np.arange(50)
    assert response.voltage[0] == pytest.approx(1 - np.exp(-2 * np.pi * frequency * t), abs=1e-12)


def test_slew_limit_makes_a_ramp_of_a_step() -> None:
    response = simulate(Stage((axis("driver_slew", slew=2e3),)), {"x": Loop(np.full(50, 40.0))}, PERIOD, substeps=4)
    assert response.voltage[0] == pytest.approx(np.minimum(2e3 * response.time, 40.0), abs=1e-9)


def test_readings_come_in_whole_steps() -> None:
    response = simulate(Stage((axis("quantisation", step=1e-7),)), {"x": Loop(np.full(50, 1.0))}, PERIOD)
    assert response.reading[0] == pytest.approx(1e-7 * np.round(response.motion[0] / 1e-7), abs=1e-15)


def test_creep_is_one_exponential_per_decade() -> None:
    response = simulate(Stage((axis("creep", per_decade=0.02, t0=0.01),)), {"x": Loop(np.ones(2001))}, PERIOD)
    slow = sum(1 - np.exp(-response.time / (0.01 * 10**i)) for i in range(4))
    assert response.drive[0] == pytest.approx(GAIN * (1 + 0.02 * slow) * (response.time > 0), abs=1e-12 * GAIN)


def test_table_moves_with_every_axis() -> None:
    """Motion along y is the coupling ratio times that of x, and the quadratic term times its square."""
    linear, quadratic = np.array([[1.0, 0.0], [0.02, 1.0]]), np.array([[0.0, 0.0], [30.0, 0.0]])
    stage = Stage((axis(name="x"), axis(name="y")), linear, quadratic)
    motion = simulate(stage, {"x": Loop(np.full(100, 50.0))}, PERIOD).motion
    assert motion[1] == pytest.approx(0.02 * motion[0] + 30.0 * motion[0] ** 2, abs=1e-15)


def test_axes_do_not_disturb_each_other_uncoupled() -> None:
    chains = axis("bouc_wen", "creep", name="x"), axis("bouc_wen", "stress_stiffening", name="y")
    commands = {"x": Loop(np.full(300, 50.0)), "y": Loop(np.linspace(0, 80, 300))}
    together = simulate(Stage(chains), commands, PERIOD, substeps=8).motion
    for i, chain in enumerate(chains):
        alone = simulate(Stage((chain,)), {chain.name: commands[chain.name]}, PERIOD, substeps=8).motion[0]
        assert np.array_equal(together[i], alone)


def test_negative_gain_turns_the_motion_round_hysteresis_included() -> None:
    chain, command = axis("bouc_wen", "creep"), sine()
    turned = dataclasses.replace(chain, gain=-GAIN)
    assert run(turned, command) == pytest.approx(-run(chain, command), abs=1e-18)


def test_command_is_amplified_to_the_voltage_at_the_stack() -> None:
    chain, command = axis("bouc_wen", "driver_bandwidth"), sine()
    amplified = dataclasses.replace(chain, amplifier=10.0)
    assert run(amplified, command / 10) == pytest.approx(run(chain, command), abs=1e-15)


# --- accuracy ---------------------------------------------------------------------------------------------------


def sine(count: int = 400, frequency: float = 40.0) -> Array:
    return 60 - 60 * np.cos(2 * np.pi * frequency * PERIOD * np.arange(count))


def test_order_in_the_step_is_four_where_everything_is_smooth() -> None:
    chain = axis("driver_bandwidth", "stress_stiffening", bandwidth=300.0, cubic=1e6)
    finest = run(chain, sine(), between_samples="linear", substeps=256)
    errors = [
        float(np.abs(run(chain, sine(), between_samples="linear", substeps=n) - finest).max()) for n in (4, 8, 16)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(orders > 3.7), orders


@pytest.mark.parametrize("names", [("bouc_wen",), ("bouc_wen", "driver_bandwidth", "creep", "sensor_bandwidth")])
def test_error_estimate_covers_the_error(names: tuple[str, ...]) -> None:
    chain = axis(*names, bandwidth=700.0, cubic=1e6)
    finest = run(chain, sine(), between_samples="linear", substeps=512)
    for tolerance in (1e-4, 1e-6, 1e-8):
        found = simulate(Stage((chain,)), {"x": Loop(sine())}, PERIOD, between_samples="linear", tolerance=tolerance)
        error = np.abs(found.motion[0] - finest).max() / np.ptp(finest)
        assert found.error <= tolerance
        assert error <= max(found.error, 1e-10)


@pytest.mark.parametrize("delay", [0.0, 0.4e-3])
def test_finer_samples_show_the_same_motion(delay: float) -> None:
    """Closed loop: every eighth of the finer samples is one of the coarse ones."""
    loop = Loop(np.zeros(100), np.full(100, 1e-5), (Controller("push", {}, push, lambda v, period: (0.02 / GAIN,)),))
    stage = Stage((axis("bouc_wen", "driver_bandwidth", bandwidth=500.0),))
    coarse = simulate(stage, {"x": loop}, PERIOD, delay=delay, substeps=16).motion[0]
    fine = simulate(stage, {"x": loop}, PERIOD, delay=delay, substeps=2, oversampling=8).motion[0]
    assert len(fine) == 8 * 99 + 1
    assert fine[::8] == pytest.approx(coarse, rel=1e-5, abs=1e-11)


# --- what can go wrong ------------------------------------------------------------------------------------------


def push(reference: float, reading: float, excess: float, state: Array, constants: Array) -> float:
    """A controller with far too much gain."""
    return constants[0] * (reference - reading)


def test_divergence_is_noticed_and_dated() -> None:
    controller = Controller("push", {}, push, lambda values, period: (50 / GAIN,))
    loop = Loop(np.zeros(5000), np.full(5000, 1e-6), (controller,))
    found = simulate(Stage((axis(),)), {"x": loop}, PERIOD)
    assert found.diverged is not None and found.diverged < 1.0
    assert found.motion.shape[1] == round(found.diverged / PERIOD)


def test_limits_cut_the_command_and_say_how_much() -> None:
    found = simulate(Stage((axis(),), limits={"x": (0.0, 50.0)}), {"x": Loop(np.full(50, 70.0))}, PERIOD)
    assert np.all(found.command == 50.0) and np.all(found.cut == 20.0)


def test_command_that_is_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="not finite"):
        run(axis(), np.array([0.0, math.nan, 1.0]))


@pytest.mark.parametrize("between", ["linear", "smooth"])
def test_the_command_of_a_closed_loop_is_held(between: str) -> None:
    controller = Controller("push", {}, push, lambda values, period: (0.1,))
    with pytest.raises(ValueError, match="held"):
        simulate(
            Stage((axis(),)),
            {"x": Loop(np.zeros(10), np.zeros(10), (controller,))},
            PERIOD,
            between_samples=between,
        )


def test_noise_is_the_same_for_the_same_seed_and_of_the_stated_size() -> None:
    stage = Stage((axis(),), noise={"x": 1e-9})
    first, again, other = (
        simulate(stage, {"x": Loop(np.zeros(5000))}, PERIOD, seed=seed).reading for seed in (1, 1, 2)
    )
    assert np.array_equal(first, again) and not np.array_equal(first, other)
    assert first.std() == pytest.approx(1e-9, rel=0.05)

"""The noise floor: simulated noise of known level comes back, from each source; what is no noise is left out of it.

Slow noise is AR(1) with 0.98 at 1 kHz: it is correlated over 50 ms, so that fifty samples count as one.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from flexdesign.core.errors import InputError
from flexdesign.diagnosis.preparation.dataset import coarse_step
from flexdesign.estimation.noise.autoregressive import Process
from flexdesign.measurements.noise_level import noise_floor
from flexdesign.measurements.noise_level.noise_floor import resample
from flexdesign.measurements.recordings import Run

Array = NDArray[np.float64]
PERIOD, LEVEL, GAIN = 1e-3, 40e-9, 1e-6


def slow(rng: np.random.Generator, n: int, rho: float = 0.98) -> Array:
    drive = math.sqrt(1 - rho**2) * rng.standard_normal(n)
    drive[0] /= math.sqrt(1 - rho**2)
    return LEVEL * lfilter([1.0], [1.0, -rho], drive)


def white(rng: np.random.Generator, n: int) -> Array:
    return LEVEL * rng.standard_normal(n)


def run(name: str, command: Any, response: Any, period: float = PERIOD) -> Run:
    command = np.asarray(command, dtype=float)
    return Run(name, period * np.arange(len(command)), {"u": command, "x": response}, {"u": "V", "x": "m"}, "hold")


def levels(count: int = 9, hold: int = 400) -> Array:
    """Jumps to random voltages, the first zero."""
    return np.repeat(np.append(0.0, np.random.default_rng(5).uniform(10, 100, count - 1)), hold)


def multisine(periods: int, n: int = 2000) -> Array:
    t, rng = np.arange(periods * n) / n, np.random.default_rng(6)
    return np.sum([8 * np.cos(2 * np.pi * k * t + rng.uniform(0, 2 * np.pi)) for k in range(2, 400, 7)], axis=0)


def dataset(seed: int, noise: Any = slow, creep: float = 0.0, hum: float = 0.0) -> list[Run]:
    """1.5 s of quiet before three sines, and eight jumps of which 0.2 s each are quiet."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(2000)
    commands = {f"sine{i}": np.where(t < 0.5, 0.0, 50 * np.sin(10 * np.pi * (t - 0.5))) for i in range(3)}
    commands["jumps"] = levels()
    made = []
    for name, u in commands.items():
        x = GAIN * u + noise(rng, len(u))
        time = PERIOD * np.arange(len(u))
        if name == "jumps":
            for k in np.flatnonzero(np.diff(u)):
                x[k + 1 :] += creep * GAIN * (u[k + 1] - u[k]) * np.log10(1 + time[: len(u) - k - 1] / 0.05)
        made.append(run(name, u, x + hum * np.sin(2 * np.pi * 50 * time + rng.uniform(0, 2 * np.pi))))
    return made


@pytest.mark.parametrize("creep", [0.0, 0.02], ids=["", "with creep"])
def test_level_of_slow_noise_comes_back_from_short_stretches(creep: float) -> None:
    """The mean of 30 levels is right within 5 %: each scatters by some 13 %, 3.1 s hold 63 independent samples.

    The innovation's deviation, which weighs a fit, is known to 1 / sqrt(2 * 3100) each. Trends taken out of the
    stretches by least squares would leave 78 % of the level.
    """
    found = [noise_floor(dataset(seed, creep=creep), "x", settling_time=0.2) for seed in range(30)]
    assert np.mean([floor.rms["jumps"] for floor in found]) == pytest.approx(LEVEL, rel=0.05)
    errors = [floor.rms["jumps"] / LEVEL - 1 for floor in found]
    stated = float(np.median([floor.relative_error for floor in found]))
    assert 0.5 * stated < np.std(errors) < 2 * stated
    innovation = LEVEL * math.sqrt(1 - 0.98**2)
    sigmas = [floor.whitening.process("jumps").sigma for floor in found]
    assert sigmas == pytest.approx(np.full(30, innovation), rel=4 / math.sqrt(2 * 3100))
    assert all(floor.known and not floor.lines for floor in found)
    assert found[0].source == "quiet stretches, 3.5 s in 4 runs"


def test_level_of_white_noise_comes_back() -> None:
    """Four standard errors of 3500 samples."""
    floor = noise_floor(dataset(0, white), "x", settling_time=0.2)
    assert floor.rms["jumps"] == pytest.approx(LEVEL, rel=4 / math.sqrt(7000))
    assert floor.relative_error == pytest.approx(1 / math.sqrt(7000), rel=0.01)


def test_hum_is_a_line_and_no_noise() -> None:
    """Of amplitude half the noise; known to 10 %: sqrt(2 / 3500) of the white part of the noise, a fifth of it."""
    with_hum, without = (noise_floor(dataset(3, hum=hum), "x", settling_time=0.2) for hum in (0.5 * LEVEL, 0.0))
    (line,) = with_hum.lines
    assert line.frequency == pytest.approx(50.0, abs=0.05)
    assert line.amplitude == pytest.approx(0.5 * LEVEL, rel=0.1)
    assert with_hum.rms["jumps"] == pytest.approx(without.rms["jumps"], rel=0.03)
    kept = noise_floor(dataset(3, white, hum=2 * LEVEL), "x", settling_time=0.2, remove_lines=False)
    assert not kept.lines
    assert kept.rms["jumps"] == pytest.approx(math.sqrt(3) * LEVEL, rel=0.2)  # the sine adds 2^2 / 2 to the variance


@pytest.mark.parametrize("noise", [slow, white])
@pytest.mark.parametrize("strength", [5.0, 50.0])
def test_a_strong_line_is_no_noise_either(noise: Any, strength: float) -> None:
    """Its frequency must be known far better than a resolution, or a beat is left that seems to fade."""
    t = PERIOD * np.arange(1500)
    x = strength * LEVEL * np.sin(2 * np.pi * 13.583 * t + 1.0) + noise(np.random.default_rng(1), len(t))
    floor = noise_floor([run("quiet", np.zeros(len(t)), x)], "x", settling_time=0.2)
    (line,) = floor.lines
    assert line.frequency == pytest.approx(13.583, abs=0.05 / strength)
    assert line.amplitude == pytest.approx(strength * LEVEL, rel=1.0 / strength)
    assert floor.rms["quiet"] < 2 * LEVEL


def test_noise_alone_shows_no_line() -> None:
    """One false alarm in a thousand: two in 20 would come once in 5000 draws."""
    assert sum(bool(noise_floor(dataset(seed), "x", settling_time=0.2).lines) for seed in range(20)) < 2


def test_a_ringing_mode_is_neither_noise_nor_line() -> None:
    """118 Hz, damping ratio 0.024; what rings after 20 ms, a fifth of the jump, is 10 um."""
    u, w, damping = levels(), 2 * np.pi * 118, 0.024
    numerator, denominator, _ = cont2discrete(([w * w], [1, 2 * damping * w, w * w]), PERIOD)
    x = GAIN * lfilter(numerator.ravel(), denominator, u) + LEVEL * np.random.default_rng(0).standard_normal(len(u))
    early, late = (noise_floor([run("a", u, x)], "x", settling_time=settle) for settle in (0.02, 0.35))
    assert early.rms["a"] == pytest.approx(LEVEL, rel=0.35)  # the residual is below what can be told from noise
    assert late.rms["a"] == pytest.approx(LEVEL, rel=0.06)
    assert not early.lines and not late.lines


def lagging(period: float, tau: float, hold: float) -> list[Run]:
    """Jumps to which a first-order lag [s] responds, with white noise."""
    u, pole = levels(9, round(hold / period)), math.exp(-period / tau)
    x = GAIN * lfilter([0.0, 1 - pole], [1.0, -pole], u)
    return [run("a", u, x + white(np.random.default_rng(0), len(u)), period)]


@pytest.mark.parametrize(("period", "tau", "hold"), [(1e-3, 0.3, 5.0), (0.1, 0.5, 12.0)])
def test_settling_is_no_noise_where_no_model_says_how_long_it_takes(period: float, tau: float, hold: float) -> None:
    """What settles moves by less than the noise from sample to sample. Four standard errors of 400 samples or more."""
    found = noise_floor(lagging(period, tau, hold), "x")
    assert found.rms["a"] == pytest.approx(LEVEL, rel=4 / math.sqrt(2 * 400))
    assert found.dof > 400


@pytest.mark.parametrize("periods", [2, 3, 6])
def test_periods_tell_noise_from_motion(periods: int) -> None:
    """Four standard errors; of two periods the second alone counts from where the extremes were passed."""
    rng, u = np.random.default_rng(1), multisine(periods)
    floor = noise_floor([run("m", u, GAIN * u + slow(rng, len(u), 0.9))], "x", settling_time=0.1)
    assert floor.source.startswith("difference of periods") and floor.known
    assert floor.rms["m"] == pytest.approx(LEVEL, rel=4 * floor.relative_error)
    assert floor.relative_error < 0.08


def test_a_transient_in_the_first_period_is_left_out() -> None:
    rng, u = np.random.default_rng(2), multisine(4)
    transient = 5e-6 * np.exp(-np.arange(len(u)) / 100) * np.cos(0.7 * np.arange(len(u)))
    floor = noise_floor([run("m", u, GAIN * u + transient + slow(rng, len(u), 0.9))], "x", settling_time=0.1)
    assert floor.rms["m"] == pytest.approx(LEVEL, rel=4 * floor.relative_error)


def test_repeats_tell_noise_from_motion() -> None:
    rng = np.random.default_rng(3)
    u = np.cumsum(rng.standard_normal(4000))
    seen = [run(name, u, GAIN * u + slow(rng, len(u), 0.9)) for name in "ab"]
    floor = noise_floor(seen, "x", settling_time=0.1)
    assert floor.source == "difference of repeats, 4 s in 1 run"
    assert floor.rms["b"] == pytest.approx(LEVEL, rel=4 * floor.relative_error)


def test_without_a_source_the_stated_noise_counts_and_else_a_guess() -> None:
    u = np.cumsum(np.random.default_rng(3).standard_normal(4000))
    alone = [run("a", u, GAIN * u + LEVEL * np.random.default_rng(4).standard_normal(4000))]
    stated = noise_floor(alone, "x", settling_time=0.1, sensor_noise=LEVEL)
    assert (stated.source, stated.known, stated.relative_error) == ("the sensor's stated noise", True, 0.0)
    assert stated.rms["a"] == LEVEL
    guessed = noise_floor(alone, "x", settling_time=0.1)
    assert (guessed.source, guessed.known, guessed.relative_error) == ("unknown", False, math.inf)


def test_the_guess_comes_from_the_quietest_band() -> None:
    """Motion up to 50 Hz of 500: above it there is noise alone, of whose spectrum the low tenth is 15 % too low."""
    rng = np.random.default_rng(7)
    u = np.convolve(rng.standard_normal(20_000), np.hanning(100), "same")
    floor = noise_floor([run("a", u, GAIN * u + LEVEL * rng.standard_normal(len(u)))], "x", settling_time=0.1)
    assert not floor.known
    assert floor.rms["a"] == pytest.approx(LEVEL, rel=0.3)


def test_noise_that_grows_with_motion_is_said() -> None:
    rng, jumps, u = np.random.default_rng(8), levels(), multisine(4)
    seen = [run("jumps", jumps, GAIN * jumps + slow(rng, len(jumps), 0.9))]
    seen.append(run("m", u, GAIN * u + 4 * slow(rng, len(u), 0.9)))
    (remark,) = noise_floor(seen, "x", settling_time=0.2).remarks
    assert remark.startswith("difference of periods") and "noise grows with motion" in remark


def test_a_louder_run_has_a_level_of_its_own() -> None:
    rng, zeros = np.random.default_rng(9), np.zeros(2000)
    seen = [run(name, zeros, scale * slow(rng, 2000, 0.9)) for name, scale in (("a", 1.0), ("b", 1.0), ("c", 5.0))]
    floor = noise_floor(seen, "x", settling_time=0.1)
    assert floor.rms["c"] / floor.rms["a"] == pytest.approx(5.0, rel=0.25)
    assert any(remark.startswith("the noise of c is") for remark in floor.remarks)


def test_readings_in_steps_have_the_noise_of_steps() -> None:
    """A quiet record of one and the same reading: the step over the root of 12."""
    u = np.concatenate([np.zeros(1000), np.linspace(0, 100, 4000), np.full(1000, 100.0)])
    floor = noise_floor([run("a", u, 1e-7 * np.round(GAIN * u / 1e-7))], "x", settling_time=0.1)
    assert floor.rms["a"] == pytest.approx(1e-7 / math.sqrt(12), rel=1e-3)


def test_another_sampling_period_keeps_the_correlation() -> None:
    """AR(1) sampled every fifth time is AR(1) with the fifth power."""
    found = resample(Process.from_coefficients(np.array([1.0, -0.98]), 1.0), 1e-3, 5e-3)
    assert found.rms == pytest.approx(5.025, rel=1e-3)
    assert found.autocorrelation(4)[1:] == pytest.approx(0.98 ** (5 * np.arange(1, 4)), rel=1e-4)


def test_gaps_cut_stretches() -> None:
    x = slow(np.random.default_rng(10), 3000, 0.9)
    x[[500, 1700]] = np.nan
    floor = noise_floor([run("a", np.zeros(3000), x)], "x", settling_time=0.1)
    assert floor.rms["a"] == pytest.approx(LEVEL, rel=4 * floor.relative_error)


def test_what_cannot_be_judged_is_refused() -> None:
    with pytest.raises(InputError, match="at least one recorded run"):
        noise_floor([], "x", settling_time=0.1)
    with pytest.raises(InputError, match="no response of axis y"):
        noise_floor([run("a", np.zeros(100), np.zeros(100))], "y", settling_time=0.1)


def test_a_command_that_was_read_back_jitters_where_it_stands_still() -> None:
    """A converter of 10 bits: half of its readings of a held voltage are one step off."""
    rng = np.random.default_rng(3)
    u, step = levels(), 0.1
    read_back = step * np.round(u / step + rng.uniform(-0.4, 0.4, len(u)) + rng.integers(0, 2, len(u)))
    assert len(np.unique(read_back[:400])) == 2
    found = noise_floor([run("jumps", read_back, GAIN * u + white(rng, len(u)))], "x", settling_time=0.05)
    assert found.known and found.source.startswith("quiet stretches")
    assert found.rms["jumps"] == pytest.approx(LEVEL, rel=3 / math.sqrt(2 * 1000))  # of 1000 samples or more
    # A command that creeps on from step to step does not stand still.
    ramp = step * np.round(np.linspace(0, 100, 4000) / step)
    assert not noise_floor([run("ramp", ramp, GAIN * ramp + white(rng, 4000))], "x", settling_time=0.05).known


def test_a_run_that_stands_on_one_step_has_the_noise_of_the_step() -> None:
    """Readings in whole steps: one run rests between two of them, the other on one; that one is not without noise."""
    rng, step = np.random.default_rng(1), 1e-6
    u = np.concatenate([np.zeros(1500), 100 * np.sin(0.01 * np.arange(1500))])
    between = step * np.round(GAIN * u / step + rng.normal(0.5, 0.3, 3000))
    on = step * np.round(GAIN * u / step)
    found = noise_floor([run("between", u, between), run("on", u, on)], "x", settling_time=0.1)
    assert found.source.startswith("quiet stretches")
    # The noise of rounding, Bennett 1948; steps are read to 1e-9 of the span of 200 steps.
    assert found.rms["on"] >= step / math.sqrt(12) * (1 - 1e-6)


def test_coarse_steps_are_found_in_a_file_that_rounds_its_readings() -> None:
    """Of gaps of 9.76 and 9.77 nm, neither of which is the step, 50 levels make 9.765625 nm."""
    step = 40e-6 / 2**12
    readings = np.round(step * np.random.default_rng(0).integers(100, 150, 2000), 11)
    found = coarse_step(readings, 0.1 * step, 0.0)
    assert found == pytest.approx(step, rel=2e-5)
    assert np.median(np.diff(np.unique(readings))) != pytest.approx(step, rel=2e-4)
    assert coarse_step(readings, 1.1 * step, 0.0) is None

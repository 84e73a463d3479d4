"""The bench: a stage with effects, driven and read."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from studies.hidden_effect_trial import kernel
from studies.hidden_effect_trial.effects import Stage, Values, vector
from studies.hidden_effect_trial.faults import Fault
from studies.hidden_effect_trial.kernel import P
from studies.hidden_effect_trial.recordings import PERIOD, Recording

Array = NDArray[np.float64]
#: Steps in a sample: for recordings, and for sensitivities. Fifty would leave a tenth of the finest noise where a slew
#: limit meets held commands, which moves what thousands of samples determine by six of its standard deviations.
FINE, COARSE = 200, 6
_STILL = np.zeros(0)
#: Share of its time constant that a step may have, of the damper that smooth friction is near rest: Runge and Kutta's
#: rule is then right to a few millionths.
DECAY = 0.5
#: A bench without structural errors.
SOUND = Fault("", 0.0)


def readings(
    stage: Stage,
    effects: Mapping[str, Values],
    runs: Sequence[Recording],
    substeps: int = FINE,
    fault: Fault = SOUND,
) -> list[Array]:
    """Return what the sensor reads in each run, without noise and without rounding [m].

    Parameters
    ----------
    stage
        The base.
    effects
        What is hidden in it, with values in SI.
    runs
        What is driven.
    substeps
        Steps of the integrator in a sample.
    fault
        A structural error of the bench.
    """
    p = vector(stage, effects)
    p[P.UNEVEN_REACH : P.UNEVEN_REACH + 4] = fault.gain(stage) or 0.0
    if p[P.SMOOTH_LEVEL]:  # near rest this friction is a damper, whose decay in a step must be short
        decay = p[P.SMOOTH_LEVEL] * p[P.OMEGA] ** 2 / p[P.SMOOTH_SPEED]
        substeps = max(substeps, math.ceil(decay * PERIOD / DECAY))
    with np.errstate(invalid="ignore", over="ignore"):  # a stage may be torn apart by what is tried on it
        return [_reading(p, stage, effects, run, substeps, fault) for run in runs]


def _reading(
    p: Array, stage: Stage, effects: Mapping[str, Values], run: Recording, substeps: int, fault: Fault
) -> Array:
    p = p.copy()
    start = kernel.history(run.turns, run.before, run.waited, run.shift, p)
    kick = _kicks(run, effects["stick_slip"]["kick"]) if "stick_slip" in effects else _STILL
    late = run.late + effects.get("transport_delay", {}).get("delay", 0.0)
    period, (command, held) = fault.period, fault.command(run)
    substeps = math.ceil(substeps * period / PERIOD)
    ahead = max(0, math.ceil(late / period))  # stretches for which the first command has been standing
    # The base moves as it does on a sound bench, wherever time begins.
    sooner = max(0, math.ceil(late / PERIOD)) * PERIOD - ahead * period
    p[P.SHAKE_PHASE] = run.phase + 2.0 * math.pi * p[P.SHAKE_HZ] * sooner
    u = np.concatenate((np.full(ahead, command[0]), command))
    x = kernel.run(u, held, period, substeps, p, start, run.velocity, kick)
    at: Array = np.arange(run.n, dtype=np.float64) * PERIOD
    places: Array = ((at + fault.timing_error(run) - late) / period + ahead) * substeps
    y = _sensor_output(fault.sensor(interpolate(x, places)), at, stage, effects, run)
    return fault.recorder(y, stage)


def interpolate(x: Array, places: Array) -> Array:
    """Return a fine series at places between its points, by cubics."""
    places = np.clip(places, 0.0, len(x) - 1.0)
    left = np.minimum(places.astype(np.int64), len(x) - 2)
    s = places - left
    padded = np.concatenate(([x[0]], x, [2.0 * x[-1] - x[-2]]))
    a, b, c, d = (padded[left + i] for i in range(4))
    cubic = b + 0.5 * s * (c - a + s * (2.0 * a - 5.0 * b + 4.0 * c - d + s * (3.0 * (b - c) + d - a)))
    return np.asarray(cubic)


def _sensor_output(x: Array, t: Array, stage: Stage, effects: Mapping[str, Values], run: Recording) -> Array:
    """Return what the sensor makes of a motion at moments t."""
    y = x + run.offset
    if "sensor_drift" in effects:
        y = y + effects["sensor_drift"]["rate"] * t
    if "mains_hum" in effects:
        hum = effects["mains_hum"]
        y = y + hum["amplitude"] * np.sin(2.0 * math.pi * hum["frequency"] * t + run.phase)
    # Outside the catalogue.
    reach, rng = stage.stroke, np.random.default_rng(run.seed)
    if "quadratic_sensor" in effects:
        y = y + effects["quadratic_sensor"]["share"] * x * x / reach
    if "s_shaped_sensor" in effects:
        y = y + effects["s_shaped_sensor"]["share"] * reach * np.sin(2.0 * math.pi * x / reach)
    if "interpolation_error" in effects:
        error = effects["interpolation_error"]
        y = y + error["amplitude"] * np.sin(2.0 * math.pi * x / error["pitch"])
    if "telegraph_jump" in effects:
        flips = rng.random(len(t)) < PERIOD / 0.4
        y = y + effects["telegraph_jump"]["jump"] * (np.cumsum(flips) % 2)
    if "lost_samples" in effects:
        y = _repeat_readings(y, rng, effects["lost_samples"]["share"])
    return np.asarray(y)


def _repeat_readings(y: Array, rng: np.random.Generator, share: float) -> Array:
    """Return readings of which a share, drawn in bursts of up to eight, repeats the last good one."""
    lost = np.zeros(len(y), dtype=bool)
    starts = np.sort(rng.permutation(len(y) - 9)[: max(1, int(share * len(y) / 4.5))])
    for start, length in zip(starts + 1, rng.integers(1, 9, len(starts)), strict=True):
        lost[start : start + length] = True
    good = np.maximum.accumulate(np.where(lost, 0, np.arange(len(y))))
    return np.asarray(y[good])


def _kicks(run: Recording, size: float) -> Array:
    rng = np.random.default_rng(run.seed)
    hits = rng.random(2 * len(run.u)) < PERIOD / 0.25
    return np.asarray(size * hits * rng.choice([-1.0, 1.0], 2 * len(run.u)))


def noise(rng: np.random.Generator, n: int, rms: float, poles: Sequence[float]) -> Array:
    """Return stationary noise with the coefficients of an autoregression, of a given root mean square [m]."""
    from scipy.signal import lfilter

    recursion = np.concatenate(([1.0], -np.asarray(poles, dtype=float)))
    impulse = lfilter([1.0], recursion, np.eye(1, 4000)[0])
    white = rng.standard_normal(n + 2000)
    return np.asarray(lfilter([1.0], recursion, white)[2000:] * rms / math.sqrt(float(impulse @ impulse)))

"""Ziegler-Nichols tuning from the ultimate gain, found from the sampled plant or by experiment on any loop.

Raise the gain of a proportional controller until the loop oscillates and the oscillation neither grows nor decays:
that gain is the ultimate gain, and the period is the ultimate period (Ziegler and Nichols 1942, Optimum settings for
automatic controllers, Trans. ASME 64).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.dynamics.control.pid import PID
from flexdesign.dynamics.control.sampled_loop import matrices, stable_ranges

#: Least number of oscillations in a record, so that each window of its late half sees two.
FEWEST_OSCILLATIONS = 32
#: Growth per oscillation, as a share of the amplitude, that counts as none.
STEADY = 1e-5
#: An oscillation this small compared with the whole excursion has decayed.
DEAD = 1e-6
_WINDOWS = 8


class Ultimate(NamedTuple):
    """Where a proportional loop stops being stable: gain [command per reading] and period of oscillation [s]."""

    gain: float
    period: float


class Oscillation(NamedTuple):
    """The late part of a record: frequency [Hz], growth and its standard error [1/s], last amplitude [reading]."""

    frequency: float
    growth: float
    growth_error: float
    amplitude: float


def rule(ultimate: Ultimate) -> PID:
    """Return the classical PID: 0.6 Ku, Tu/2, Tu/8.

    >>> rule(Ultimate(gain=10.0, period=0.8))
    PID(kp=6.0, ti=0.4, td=0.1, ...)
    """
    return PID(0.6 * ultimate.gain, ultimate.period / 2, ultimate.period / 8)


def from_rule(pid: PID) -> Ultimate:
    """Return the ultimate gain and period that the rule turns into this PID; `td` has no say, see `consistency`."""
    return Ultimate(pid.kp / 0.6, 2 * pid.ti)


def ultimate(loop: Any) -> Ultimate:
    """Return the ultimate gain and period of a sampled plant under proportional control.

    Exact: the smallest gain at which closed-loop poles reach the unit circle, stable below, unstable above.

    Parameters
    ----------
    loop
        The plant, a discrete single-input, single-output system of python-control; `Plant.discretise` gives one.

    Raises
    ------
    InputError
        If the loop is unstable for small gains already, or stable for any.
    """
    ranges = stable_ranges(matrices(loop))
    if not ranges or ranges[0].low.gain > 0:
        raise InputError("plant", "", None, "is unstable under small proportional gains; the rule does not apply")
    gain, angle = ranges[0].high
    if math.isinf(gain):
        raise InputError("plant", "", None, "is stable under any proportional gain; it has no ultimate gain")
    return Ultimate(gain, 2 * math.pi * float(loop.dt) / angle)


def by_experiment(
    respond: Callable[[float], ArrayLike],
    period: float,
    start: float,
    tolerance: float = 1e-4,
    noise: float = 0.0,
    tries: int = 80,
) -> Ultimate:
    """Find the ultimate gain and period of a loop that can only be run.

    The gain is doubled or halved until the boundary is bracketed, then bisected. Growth is judged on the late half of
    each record, where slower and faster motions have died out, window by window; an offset or a slow drift, as a
    hysteretic or creeping stage leaves it, does not disturb. Where limits hold a growing oscillation to a constant
    amplitude, it counts as not decaying.

    Parameters
    ----------
    respond
        ``respond(kp)`` runs the loop under proportional gain `kp`, from rest, with a step or a pulse of the
        reference, and returns the readings, one per sample.
    period
        Sampling period of the readings [s].
    start
        A gain to begin with, with the sign that closes the loop.
    tolerance
        Relative width to which the gain is bracketed.
    noise
        Peak-to-peak noise of the reading; an oscillation that does not stand out from it has died out.
    tries
        Largest number of runs.

    Raises
    ------
    InputError
        If the start is zero, the records are too short for the oscillation, or no boundary is met.
    """
    if not (math.isfinite(start) and start != 0):
        raise InputError("experiment", "start", start, "must be a gain other than zero")
    low = high = 0.0  # the largest gain that decays, the smallest that does not
    gain, frequency = start, math.nan
    for _ in range(tries):
        record = np.asarray(respond(gain), dtype=float)
        motion = _late_oscillation(record, period, noise)
        if motion.growth < -max(STEADY * motion.frequency, 3 * motion.growth_error):
            low = gain
        else:
            high = gain
        if math.isfinite(motion.growth):
            frequency = motion.frequency
        if low and high and abs(high - low) <= tolerance * abs(low) and math.isfinite(frequency):
            return Ultimate((low + high) / 2, 1 / frequency)
        gain = (low + high) / 2 if low and high else 2 * low if low else high / 2
    what = "decays at every gain tried" if not high else "never decays" if not low else "is too irregular to judge"
    raise InputError("experiment", "start", start, f"no ultimate gain was found: the oscillation {what}")


def _late_oscillation(record: Array, period: float, noise: float) -> Oscillation:
    """Return the late oscillation; growth is infinite, of either sign, where there is no sinusoid to measure."""
    if not np.all(np.isfinite(record)):
        return Oscillation(1.0, math.inf, 0.0, math.inf)
    early, late = np.ptp(record[: len(record) // 2]), np.ptp(record[len(record) // 2 :])
    dead = Oscillation(1.0, -math.inf, 0.0, 0.0)
    if late <= max(DEAD * early, 2 * noise):
        return dead
    try:
        motion = oscillation(record, period)
        return dead if motion.amplitude <= max(DEAD * early, noise) else motion
    except InputError:
        if early / 2 <= late <= 2 * early:
            raise
        # Too fast in or out for a sinusoid: it creeps towards rest, or runs away within a few samples.
        return dead if late < early else Oscillation(1.0, math.inf, 0.0, math.inf)


def oscillation(record: ArrayLike, period: float) -> Oscillation:
    """Return the oscillation in the late half of a record, with offset and drift removed.

    Each of several windows is fitted with a sinusoid, an offset and a slope. The trend of the logarithm of its
    amplitude is the growth rate, the trend of its phase corrects the frequency, so that both are free of the raggedness
    of sampled peaks.

    Parameters
    ----------
    record
        Readings, one per sample.
    period
        Sampling period [s].

    Raises
    ------
    InputError
        If the record holds too few oscillations.
    """
    y = np.asarray(record, dtype=float)
    late = y[len(y) // 2 :]
    if len(late) < 8 * _WINDOWS:
        raise InputError("experiment", "record", f"{len(y)} samples", f"is too short; give {16 * _WINDOWS} or more")
    angle = _strongest(late)
    size = len(late) // _WINDOWS
    starts = np.arange(_WINDOWS) * size + (len(late) - size * _WINDOWS)
    phasors = np.zeros(_WINDOWS, dtype=complex)
    for _ in range(3):  # the frequency's error falls by orders of magnitude each time
        if angle * len(y) < 2 * math.pi * FEWEST_OSCILLATIONS:
            remedy = f"holds {angle * len(y) / (2 * math.pi):.1f} oscillations; make it longer"
            raise InputError("experiment", "record", f"{len(y)} samples", remedy)
        n = np.arange(size)
        shape = np.column_stack([np.ones(size), n - n.mean()])
        for i, first in enumerate(starts):
            waves = np.column_stack([np.cos(angle * (first + n)), np.sin(angle * (first + n)), shape])
            cosine, sine = np.linalg.lstsq(waves, late[first : first + size], rcond=None)[0][:2]
            phasors[i] = complex(cosine, -sine)
        if np.any(phasors == 0):  # nothing moves
            return Oscillation(angle / (2 * math.pi * period), 0.0, 0.0, 0.0)
        angle += float(np.polyfit(starts, np.unwrap(np.angle(phasors)), 1)[0])
    (growth, level), spread = np.polyfit(starts + size / 2, np.log(np.abs(phasors)), 1, cov=True)
    amplitude = math.exp(min(level + growth * len(late), 700.0))
    error = math.sqrt(max(float(spread[0, 0]), 0.0))
    return Oscillation(angle / (2 * math.pi * period), float(growth) / period, error / period, amplitude)


def _strongest(late: Array) -> float:
    """Return the angle per sample of the strongest line in the spectrum."""
    n = np.arange(len(late))
    scaled = late / (np.max(np.abs(late)) or 1.0)
    flat = (scaled - np.polyval(np.polyfit(n, scaled, 1), n)) * np.hanning(len(late))
    padded = 8 * len(late)
    spectrum = np.abs(np.fft.rfft(flat, padded))
    rates = spectrum * np.arange(len(spectrum))  # of the velocity, so that creep does not pass for an oscillation
    return 2 * math.pi * float(np.argmax(rates[1:]) + 1) / padded

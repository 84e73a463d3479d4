"""The plants that printed gains can belong to.

A Ziegler-Nichols tuning is two numbers, the ultimate gain and the ultimate period, written as three. They say that the
sampled plant passes through -1/Ku at one frequency: two equations. A plant has more unknowns than that, so that a
whole family fits, and the gains do not distinguish its members: the phase of a frequency response does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.units import significant, to_text
from flexdesign.dynamics.control.pid import PID
from flexdesign.dynamics.control.plant import Plant
from flexdesign.dynamics.control.ziegler_nichols import Ultimate, from_rule, ultimate

#: Where the unknowns are looked for. Natural frequencies: from this share of the oscillation's frequency up to half
#: the sampling rate, beyond which every solution has aliases without end.
LOWEST_FREQUENCY = 0.05
DAMPING_RATIOS = (1e-5, 5.0)
DELAYS = (0.0, 10.0)  # in samples
_POINTS = 400


@dataclass(frozen=True)
class Candidate:
    """A plant whose Ziegler-Nichols tuning is the printed one.

    Parameters
    ----------
    plant
        The plant.
    ultimate
        Its ultimate gain and period, computed from the plant itself.
    """

    plant: Plant
    ultimate: Ultimate

    def says(self) -> str:
        """Return the plant in words."""
        delay = f", {to_text(self.plant.delay, 'ms', 3)} of delay" if self.plant.delay else ", no delay"
        damping = significant(self.plant.damping_ratio, 3)
        return f"{to_text(self.plant.natural_frequency, 'Hz')}, damping ratio {damping}{delay}"


@dataclass(frozen=True)
class Comparison:
    """The frequency responses of several candidates.

    Parameters
    ----------
    frequencies
        In Hz, m of them.
    magnitude
        Of the plants, delay included [reading per command]; candidates x m.
    phase
        Likewise [deg], not wrapped.
    best_frequency
        Where the phases lie farthest apart [Hz].
    largest_phase_difference
        How far [deg].
    """

    frequencies: Array
    magnitude: Array
    phase: Array
    best_frequency: float
    largest_phase_difference: float

    def says(self) -> str:
        """Return where a frequency response distinguishes the candidates."""
        return (
            f"The phases of the candidates lie farthest apart at {to_text(self.best_frequency, 'Hz', 3)}: "
            f"{significant(self.largest_phase_difference, 3)} deg."
        )


def consistency(pid: PID) -> float:
    """Return ``4 Td / Ti``, which is 1 where the three numbers follow the rule Tu/2, Tu/8.

    >>> round(consistency(PID(kp=0.01355, ti=3.988e-3, td=0.997e-3)), 6)
    1.0
    """
    return 4 * pid.td / pid.ti


def plants_for_delays(
    pid: PID, period: float, gain: float, delays: Sequence[float] = (0.0, 1.0, 2.0)
) -> list[Candidate]:
    """Return all plants with a given loop delay that the printed gains can belong to.

    Parameters
    ----------
    pid
        The printed tuning.
    period
        Sampling period T [s]; the command is held in between.
    gain
        Static gain of the plant [reading per command].
    delays
        Delays of the loop in addition to the hold, in samples.

    Raises
    ------
    InputError
        If the printed gains are no Ziegler-Nichols tuning, or oscillate faster than the sampling can.
    """
    target = _target(pid, period, gain)
    frequencies = np.log([LOWEST_FREQUENCY / target.period, 0.5 / period])
    found = []
    for samples in delays:

        def family(log_frequency: Array, log_damping: Array, delay: float = samples) -> tuple[ArrayLike, ...]:
            return np.exp(log_frequency), np.exp(log_damping), delay

        found += _solve(family, frequencies, np.log(DAMPING_RATIOS), target, period, gain)
    return found


def plants_for_frequency(pid: PID, period: float, gain: float, natural_frequency: float) -> list[Candidate]:
    """Return all plants with a given natural frequency that the printed gains can belong to: damping and delay.

    Parameters
    ----------
    pid, period, gain
        As in `plants_for_delays`.
    natural_frequency
        In Hz.

    Raises
    ------
    InputError
        As `plants_for_delays`.
    """
    target = _target(pid, period, gain)

    def family(log_damping: Array, samples: Array) -> tuple[ArrayLike, ...]:
        return natural_frequency, np.exp(log_damping), samples

    return _solve(family, np.log(DAMPING_RATIOS), np.array(DELAYS), target, period, gain)


def compare(candidates: Sequence[Candidate], frequencies: ArrayLike) -> Comparison:
    """Return the frequency responses of the candidates, and where the phase distinguishes them best.

    Parameters
    ----------
    candidates
        Two or more.
    frequencies
        In Hz, 1-D.

    Raises
    ------
    InputError
        If there are fewer than two candidates.
    """
    if len(candidates) < 2:
        raise InputError("plants", "candidates", len(candidates), "two or more are needed for a comparison")
    f = np.asarray(frequencies, dtype=float)
    magnitude = np.array([np.abs(c.plant.response(f)) for c in candidates])
    phase = np.array([c.plant.phase(f) for c in candidates])
    spread = np.ptp(phase, axis=0)
    widest = int(np.argmax(spread))
    return Comparison(f, magnitude, phase, float(f[widest]), float(spread[widest]))


def _target(pid: PID, period: float, gain: float) -> Ultimate:
    if not math.isfinite(pid.ti):
        raise InputError("controller", "ti", pid.ti, "the rule gives an integral time; without one nothing is implied")
    target = from_rule(pid)
    if target.gain * gain <= 0:
        raise InputError("controller", "kp", pid.kp, "must have the sign of the plant's gain")
    if target.period <= 2 * period:
        remedy = f"implies an oscillation of {2e3 * pid.ti:g} ms, faster than sampling every {1e3 * period:g} ms allows"
        raise InputError("controller", "ti", f"{1e3 * pid.ti:g} ms", remedy)
    return target


def _solve(
    family: Callable[[Array, Array], tuple[ArrayLike, ...]],
    first: Array,
    second: Array,
    target: Ultimate,
    period: float,
    gain: float,
) -> list[Candidate]:
    """Return all plants over a rectangle of two unknowns whose sampled response is -1/Ku at the printed frequency.

    A grid finds the cells in which both parts of the equation change sign, and each is polished. Then the plant itself
    is asked: what passes -1 at the printed frequency but turned unstable at a smaller gain already is dropped.
    """
    from scipy.optimize import least_squares

    angle = 2 * math.pi * period / target.period

    def mismatch(x: Array, y: Array) -> NDArray[np.complex128]:
        frequency, damping, samples = (np.asarray(value) for value in family(x, y))
        return 1 + target.gain * gain * _sampled_mode(frequency * period, damping, samples, angle)

    def residual(at: Array) -> list[float]:
        value = complex(mismatch(at[0], at[1]))
        return [value.real, value.imag]

    ones, twos = np.linspace(first[0], first[1], _POINTS), np.linspace(second[0], second[1], _POINTS)
    values = mismatch(ones[:, None], twos[None, :])
    bounds = [first[0], second[0]], [first[1], second[1]]
    candidates: list[Candidate] = []
    for i, j in np.argwhere(_changes_sign(values.real) & _changes_sign(values.imag)):
        start = [(ones[i] + ones[i + 1]) / 2, (twos[j] + twos[j + 1]) / 2]
        solution = least_squares(residual, start, bounds=bounds, xtol=1e-14, ftol=1e-14, gtol=1e-14)
        if np.max(np.abs(solution.fun)) > 1e-8:
            continue
        frequency, damping, samples = (float(np.asarray(value)) for value in family(*solution.x))
        found = Plant(gain, frequency, damping, samples * period)
        if any(_same(found, other.plant, period) for other in candidates):
            continue
        own = ultimate(found.discretise(period))
        if math.isclose(own.gain, target.gain, rel_tol=1e-6):
            candidates.append(Candidate(found, own))
    return candidates


def _changes_sign(values: Array) -> NDArray[np.bool_]:
    """Tell of each cell of a grid whether its corners differ in sign."""
    corners = np.stack([values[:-1, :-1], values[1:, :-1], values[:-1, 1:], values[1:, 1:]])
    return np.asarray((corners.min(axis=0) <= 0) & (corners.max(axis=0) >= 0))


def _same(one: Plant, other: Plant, period: float) -> bool:
    return (
        math.isclose(one.natural_frequency, other.natural_frequency, rel_tol=1e-5)
        and math.isclose(one.damping_ratio, other.damping_ratio, rel_tol=1e-4)
        and math.isclose(one.delay, other.delay, rel_tol=1e-5, abs_tol=1e-5 * period)
    )


def _sampled_mode(frequency: Array, damping: Array, delay: Array, angle: float) -> NDArray[np.complex128]:
    """Return the response of one sampled mode of unit gain at ``z = exp(j angle)``, in closed form from its residues.

    Frequency in cycles per sample, delay in samples; arrays broadcast. Far faster than matrices, and good enough to
    find a plant; it loses digits where two poles meet, at damping ratio 1.
    """
    z = complex(math.cos(angle), math.sin(angle))
    w = 2 * math.pi * frequency
    split = w * np.sqrt(np.asarray(damping**2 - 1, dtype=complex))
    split = np.where(np.abs(split) < 1e-6 * w, 1e-6 * w, split)
    whole = np.floor(delay + 1e-9)
    late = np.maximum(delay - whole, 0.0)
    total = np.zeros(np.broadcast(split, delay).shape, dtype=complex)
    for sign in (1, -1):
        pole = -damping * w + sign * split
        decay, partly = np.exp(pole), np.exp(pole * (1 - late))
        total = total + sign * ((partly - 1) + (decay - partly) / z) / (pole * (z - decay))
    return np.asarray(w**2 / (2 * split) * total * z**-whole)

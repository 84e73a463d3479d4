"""Hysteresis loops: span, opening, area, chord."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Quantity
from flexdesign.dynamics.metrics.common import need_positive, need_same_length, quantity, ratio

#: A branch of a loop may step back by this share of the command's span (noise of a measured command), not by more.
_JITTER = 0.02


@dataclass(frozen=True)
class Loop:
    """A hysteresis loop: one cycle of a response over its command.

    Parameters
    ----------
    span
        From the lowest response to the highest [m].
    width
        Largest opening, at one value of the command [m].
    area
        Enclosed area [m V]; positive if the response lags behind the command.
    secant_gain
        `span` over the span of the command [m/V], negative if the response falls as the command rises. No coefficient
        of a model: the chord of this loop.
    """

    span: float
    width: float
    area: float
    secant_gain: float

    @property
    def width_relative(self) -> float:
        """Largest opening over the span."""
        return ratio(self.width, self.span)

    def quantities(self, source: str = "", si: str = "m") -> tuple[Quantity, ...]:
        """Return the numbers as quantities; `si` is the unit of the response, ``V`` for an analogue."""
        return (
            quantity("loop_span", self.span, si, source),
            quantity("loop_width", self.width, si, source),
            quantity("loop_width_relative", self.width_relative, "1", source),
            quantity("loop_area", self.area, f"{si}*V", source),
            quantity("secant_gain", self.secant_gain, f"{si}/V", source),
        )


def loop(command: Array, response: Array, period: float, frequency: float) -> Loop:
    """Measure the hysteresis loop of the last full cycle of a periodic run.

    Parameters
    ----------
    command, response
        n samples [V], [m]. The command rises once and falls once in a cycle.
    period
        Sampling period [s].
    frequency
        Cycles per second [Hz]; a cycle need not be a whole number of samples.

    Raises
    ------
    ValueError
        If an array is unfit, the record is shorter than a cycle, a cycle has fewer than eight samples, or the command
        turns more than twice in it.
    """
    need_same_length(command, response)
    need_positive(period)
    need_positive(frequency, "frequency")
    samples = 1 / (frequency * period)
    start = len(command) - 1 - samples
    if samples < 8 or start < -1e-6 * samples:
        raise ValueError(f"a cycle of {samples:.4g} samples is too short, or longer than the record of {len(command)}")
    index = np.arange(max(0, math.ceil(start - 1e-6)), len(command))
    index = index if index[0] - start < 1e-6 * samples else np.concatenate([[start], index])
    u, x = (np.interp(index, np.arange(len(values)), values) for values in (command, response))
    if not np.ptp(u) > 0:
        raise ValueError("the command stands still")
    # From their means, so that the area of a small loop far from zero keeps its digits.
    du, dx = u - u.mean(), x - x.mean()
    sign = math.copysign(1.0, float(np.dot(du, dx)))
    span = float(np.ptp(x))
    return Loop(
        span=span,
        width=_width(u, x),
        area=sign * 0.5 * float(np.dot(du, np.roll(dx, -1)) - np.dot(dx, np.roll(du, -1))),
        secant_gain=sign * span / float(np.ptp(u)),
    )


def _width(u: Array, x: Array) -> float:
    """Return the largest distance between the rising and the falling branch of a cycle, at one command."""
    lowest = int(np.argmin(u))
    u, x = (np.concatenate([values[lowest:], values[: lowest + 1]]) for values in (u, x))
    highest = int(np.argmax(u))
    up = _branch(u[: highest + 1], x[: highest + 1])
    down = _branch(u[highest:][::-1], x[highest:][::-1])
    at = np.union1d(up[0], down[0])
    return float(np.abs(np.interp(at, *up) - np.interp(at, *down)).max())


def _branch(u: Array, x: Array) -> tuple[Array, Array]:
    """Return a branch with its command ironed out to one that never falls."""
    rising = np.maximum.accumulate(u)
    if float((rising - u).max()) > _JITTER * float(np.ptp(u)):
        raise ValueError("the command turns more than twice in a cycle; give the frequency of its turns")
    return rising, x

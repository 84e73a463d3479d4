"""Commands for the bench: what is sent, what it is for, and the shapes it is put together from."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.unit_tables import KELVIN
from flexdesign.diagnosis.experiment_design.limits import COMMAND_GRID, Limits
from flexdesign.measurements.recordings import AXES, Role, Run


@dataclass(frozen=True, eq=False)
class Command:
    """One experiment: what is sent to an axis, and what else happens.

    Parameters
    ----------
    name
        As its file is called, without the number before it.
    kind, purpose
        What it shows, a key of `KIND_WORDS`, or ``sine`` or ``levels`` for validation; what it is for, in words.
    samples
        The command, n values [V].
    period
        Sampling period [s].
    role
        Whether a fit may see it.
    marks
        Moments that matter [s]: where a hold or the periods begin, the edges of steps.
    cycle
        Length of what repeats [s]; zero if nothing does.
    mass_ratio
        Known mass that is added at the output, relative to the moving mass.
    push
        Known static force on the output, as the displacement it causes by the model [m].
    recorded
        What another axis [response] or the temperature [K above 0 °C] does, by the name of its column.
    note
        What has to be done by hand.
    scaled
        Why it is smaller than wanted; empty if it is not.
    """

    name: str
    kind: str
    purpose: str
    samples: Array
    period: float
    role: Role = "identify"
    marks: tuple[float, ...] = ()
    cycle: float = 0.0
    mass_ratio: float = 0.0
    push: float = 0.0
    recorded: Mapping[str, Array] = field(default_factory=dict)
    note: str = ""
    scaled: str = ""

    @property
    def is_file(self) -> bool:
        """Whether its file is all that acts on the stage, but for a mass that is added before."""
        return not (self.push or self.recorded)

    @property
    def time(self) -> Array:
        """Moments of the samples [s]."""
        return self.period * np.arange(len(self.samples), dtype=np.float64)

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return self.period * (len(self.samples) - 1)

    @property
    def peak(self) -> float:
        """Largest voltage, with its sign [V]."""
        return float(self.samples[np.argmax(np.abs(self.samples))])

    @property
    def slew(self) -> float:
        """Largest change from one sample to the next, per sampling period [V/s]."""
        return float(np.abs(np.diff(self.samples)).max(initial=0.0)) / self.period

    def run(self, axis: str, response: str) -> Run:
        """Return it as a run with nothing measured yet: a response of zeros, in the SI unit `response`.

        Temperature and another axis rest, unless it is them that move.
        """
        still, other = np.zeros(len(self.samples)), other_than(axis)
        columns = {"u": self.samples, axis: still, other: still, "T": still, **self.recorded}
        columns["T"] = columns["T"] + KELVIN["degC"]
        si = {"u": "V", axis: response, other: response, "T": "K"}
        return Run(self.name, self.time, columns, si, "hold", self.role)


def other_than(axis: str) -> str:
    """Return the name of another axis of a stage."""
    return next(name for name in AXES if name != axis)


def on_grid(samples: Array, limits: Limits) -> Array:
    """Return a command in whole multiples of the grid, within the voltage range [V].

    Rounding is to the nearest multiple; one that the ends of the range cut off is the last within.
    """
    first, last = math.ceil(limits.low / COMMAND_GRID - 1e-9), math.floor(limits.high / COMMAND_GRID + 1e-9)
    # Divided by a whole number: the nearest double of the decimal that a file holds.
    return np.clip(np.rint(samples / COMMAND_GRID), first, last) / round(1 / COMMAND_GRID)


def path(limits: Limits, points: Sequence[tuple[float, float]], gentle: float = 0.0) -> tuple[Array, tuple[float, ...]]:
    """Return levels joined by ramps, and when each ramp begins [s].

    Parameters
    ----------
    limits
        Of their slew and bandwidth.
    points
        Levels [V], each with the time for which it is held [s].
    gentle
        A ramp takes at least this long, and has no corners [s]; zero for straight ones.
    """
    pieces, begins, level, count = [], [], points[0][0], 0
    for target, dwell in points:
        if target != level:
            begins.append(count / limits.rate)
            pieces.append(ramp(limits, level, target, gentle))
            count += len(pieces[-1])
        held = max(1, round(dwell * limits.rate))
        pieces.append(np.full(held, target))
        count, level = count + held, target
    return np.concatenate(pieces), tuple(begins)


def ramp(limits: Limits, start: float, end: float, gentle: float = 0.0) -> Array:
    """Return the samples between two levels, neither of them included: none where the command may jump.

    A gentle way is half a cosine, which leaves a mode of a few of its periods' length nearly at rest.
    """
    # As a low-pass of first order rises from 10 to 90 %, which is 0.8 of a ramp.
    ramp_time = math.log(9) / (2 * math.pi * limits.bandwidth) / 0.8
    slowest = abs(end - start) / limits.step * (0.5 * math.pi if gentle else 1.0)
    samples = max(1, math.ceil(max(ramp_time, gentle) * limits.rate - 0.5), math.ceil(slowest))
    share = np.arange(1, samples) / samples
    return start + (end - start) * (0.5 - 0.5 * np.cos(np.pi * share) if gentle else share)


def triangle(limits: Limits, frequency: float, cycles: int) -> Array:
    """Return cycles between both ends of the range at constant rate, from home and back [V]."""
    rate = 2 * limits.span * frequency
    corners = [limits.home, *([limits.high, limits.low] * cycles), limits.home]
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(corners)) / rate)])
    return np.interp(np.arange(math.ceil(times[-1] * limits.rate) + 1) / limits.rate, times, corners)

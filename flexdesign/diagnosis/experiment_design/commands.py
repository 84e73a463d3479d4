"""A command for the bench: what is sent, what it is for, and what else happens."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.unit_tables import KELVIN
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

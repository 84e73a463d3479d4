"""A recorded run as seen by one axis: its command and its response; and ways by which a record comes to its start."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cache

import numpy as np
from numpy.typing import NDArray

from flexdesign.errors import InputError
from flexdesign.runs import AXES, Run
from flexdesign.stage_model import AxisModel

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class AxisRun(Run):
    """What a run holds of one axis, an `Observation` of n values; other columns are there for what disturbs it.

    Parameters
    ----------
    response
        Column of the response.
    """

    response: str = ""

    def command(self) -> Array:
        """Return the command of this axis [V], n values."""
        return self.columns[command_column(self, self.response)]

    def measured(self) -> Array:
        """Return the response of this axis, n values."""
        return self.columns[self.response]


def of_axis(run: Run, name: str, axis: AxisModel) -> AxisRun:
    """Return a run as seen by one axis: its command and its response.

    Raises
    ------
    InputError
        If the axis is none that runs know, or the run lacks its command or response, or has it in another unit.
    """
    if name not in AXES:
        raise InputError("model", f"axis.{name}", None, f"runs hold the axes {', '.join(AXES)}; name it one of these")
    if name not in run.responses:
        there = f"there is {', '.join(run.responses)}"
        raise InputError(run.name, name, None, f"the run has no response of axis {name}; {there}: leave the run out")
    if run.si[name] != axis.response:
        remedy = f"the model's axis {name} responds in {axis.response} (the unit of its gain); correct one of the two"
        raise InputError(run.name, name, f"in {run.si[name]}", remedy)
    command_column(run, name)
    return AxisRun(**{each.name: getattr(run, each.name) for each in fields(run)}, response=name)


def command_column(run: Run, name: str) -> str:
    """Return the name of the column that commands an axis: u, or ux and so on.

    Raises
    ------
    InputError
        If there is none.
    """
    for column in ("u", f"u{name}"):
        if column in run.columns:
            return column
    there = f"there is {', '.join(run.commands)}"
    raise InputError(run.name, f"u{name}", None, f"the run has no command of axis {name}; {there}: leave the run out")


@cache
def smooth_way(samples: int) -> Array:
    """Return a way from zero to one, n values: the integral of Harris's window of four terms.

    A mode that is given six of its periods to follow is left at rest within 1e-4 of the way: F. J. Harris, On the use
    of windows for harmonic analysis with the discrete Fourier transform, Proc. IEEE 66 (1978).
    """
    phase = 2 * math.pi * (np.arange(samples) + 0.5) / samples
    window = 0.35875 - 0.48829 * np.cos(phase) + 0.14128 * np.cos(2 * phase) - 0.01168 * np.cos(3 * phase)
    way = np.cumsum(window)
    return np.asarray(way / way[-1])


def span(values: Array) -> float:
    """Return how far values reach, those that are no numbers left out."""
    present = values[np.isfinite(values)]
    return float(np.ptp(present)) if present.size else 0.0

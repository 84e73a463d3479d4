"""Readings that jump away and back at once, as codes for overrange and lost bits do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexdesign.diagnosis.check.coverage import STEP_CHANGE
from flexdesign.measurements.recordings import Run

Array = NDArray[np.float64]
#: No more samples lie between a jump and the jump back: a stage that moves on its own comes back slowly.
LONGEST = 20
#: Samples before and after that a jump is compared with.
AROUND = 25
#: A jump is this many times the largest one around it. Of a resonance, successive jumps differ by less: even at a
#: damping ratio of 0.4 a swing is a quarter of the one before. Of 50 samples of normal noise none is twice the largest
#: other.
BEYOND = 8.0
#: And it is this many times the median change from sample to sample, which noise is not; and this share of the motion.
BEYOND_MEDIAN, SHARE = 20.0, 0.05
#: The readings before and after differ by no more than this share of the jump.
RETURNS = 0.25


def outliers(run: Run, response: str) -> NDArray[np.intp]:
    """Return the samples of a response that jump away from those around them and back, while no command jumps.

    >>> t = np.arange(400) * 1e-3
    >>> x = np.sin(9 * t) + np.where(np.abs(t - 0.2) < 1.5e-3, 50, 0)
    >>> outliers(Run("a", t, {"u": t, "x": x}, {"u": "V", "x": "m"}), "x")
    array([199, 200, 201])
    """
    values = run.columns[response]
    there = np.flatnonzero(np.isfinite(values))
    reading = values[there]
    steps = np.diff(reading)
    sizes = np.abs(steps)
    if len(reading) < 2 * AROUND or not sizes.any():
        return there[:0]
    low, high = np.percentile(reading, (2, 98))
    smallest = float(sizes[sizes > 0].min())  # the resolution, where readings have one
    least = max(BEYOND * smallest, BEYOND_MEDIAN * float(np.median(sizes)), SHARE * float(high - low))
    jumps = np.flatnonzero(sizes > least)
    away, back = jumps[:-1], jumps[1:]
    is_pair = (back - away <= LONGEST) & (steps[away] * steps[back] < 0)
    found = [
        there[first + 1 : last + 1]
        for first, last in zip(away[is_pair].tolist(), back[is_pair].tolist(), strict=True)
        if _stands_out(reading, sizes, first, last)
        and not _is_driven(run, int(there[max(first - AROUND, 0)]), int(there[last + 1]))
    ]
    return np.concatenate(found) if found else there[:0]


def _stands_out(reading: Array, sizes: Array, first: int, last: int) -> bool:
    """Tell whether a jump at `first` and one back at `last` are far larger than those around them."""
    size = min(sizes[first], sizes[last])
    around = np.concatenate([sizes[max(first - AROUND, 0) : first], sizes[last + 1 : last + 1 + AROUND]])
    return bool(size > BEYOND * around.max(initial=0.0) and abs(reading[last + 1] - reading[first]) <= RETURNS * size)


def _is_driven(run: Run, first: int, last: int) -> bool:
    """Tell whether a command jumps from `first` to `last`: by a share of its span, and as it does not all the time."""
    for name in run.commands:
        changes = np.abs(np.diff(run.columns[name][first : last + 1]))
        least = STEP_CHANGE * float(np.ptp(run.columns[name]))
        if changes.max() > max(least, BEYOND * float(np.median(changes))):
            return True
    return False

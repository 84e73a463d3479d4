"""The step in which a sensor's readings are written: a converter's, or that of the digits of a file."""

from __future__ import annotations

import numpy as np

from flexdesign.core.arrays import Array

#: Readings with fewer different values do not show the sensor's step; what is below this share of their span is
#: rounding of the numbers themselves.
MANY, ROUNDING = 50, 1e-9


def smallest_step(values: Array, grain: float | None = None) -> float:
    """Return the smallest difference between two readings; zero where they are too few to show it.

    Parameters
    ----------
    values
        Readings; NaN at gaps.
    grain
        What counts as rounding of the numbers, in the unit of the readings; by default `ROUNDING` of their span.

    >>> round(smallest_step(np.round(np.sin(np.linspace(0, 6, 500)), 2)), 9)
    0.01
    """
    there = values[np.isfinite(values)]
    if grain is None:
        grain = ROUNDING * float(np.ptp(there)) if len(there) else 0.0
    levels = np.unique(np.round(there / grain)) if grain > 0 else there[:1]
    return grain * float(np.diff(levels).min()) if len(levels) >= MANY else 0.0

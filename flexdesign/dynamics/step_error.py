"""The error that the length of steps leaves in a simulation, from what shorter steps change."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from flexdesign.core.arrays import Array

#: On the error estimate; more than the 1.25 of a grid convergence index, as turning points make the order unsteady.
SAFETY = 1.5


def error_left(changes: Sequence[float], most: float = 4.0) -> float:
    """Return the error left, from the changes at each doubling of the number of steps.

    The order is what the last changes show, at most four, or `most`. Where turning points of the voltage fall within
    steps it goes up and down, so that the lowest of the last three counts, and fewer for no more than two.
    """
    orders = [math.log2(a / b) if b > 0 else 4.0 for a, b in pairwise(changes)]
    order = min([*orders[-3:], most if len(orders) > 2 else 2.0]) if orders else 1.0
    return SAFETY * changes[-1] / (2.0 ** max(order, 1.0) - 1.0)


def relative_change(coarse: Array, fine: Array, least_span: float = 0.0) -> float:
    """Return the largest change of motions, axes by samples, over the largest span of them, or a given span."""
    span = max(float(np.max(np.ptp(fine, axis=1))), least_span)
    return float(np.max(np.abs(fine - coarse))) / span if span > 0 else 0.0


def is_same_divergence(coarse: Array, fine: Array) -> bool:
    """Tell whether motions ran away at the same time, and on the same way: steps that are too long do so anyhow."""
    return coarse.shape == fine.shape and coarse.shape[1] >= 8 and relative_change(coarse, fine) < 0.1

"""What all metrics need: quantities in the units people read, and refusals of unfit arrays."""

from __future__ import annotations

import math

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Quantity

#: In which unit people read a number: SI unit -> display unit.
_DISPLAY_UNITS = {"m": "um", "s": "ms", "1": "%", "m/V": "um/V", "m*V": "um*V"}


def quantity(name: str, value: float, si: str, source: str, boundary: str = "") -> Quantity:
    """Return a quantity in the unit in which people read it."""
    return Quantity(name, value, si, _DISPLAY_UNITS.get(si, si), boundary, source)


def rms(values: Array) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def ratio(part: float, whole: float) -> float:
    """Return part over whole; of a whole that is zero, 0 for no part and inf for any other."""
    if whole == 0:
        return 0.0 if part == 0 else math.inf
    return part / whole


def need_positive(value: float, what: str = "sampling period") -> None:
    """Raise ValueError unless a number is more than zero and finite."""
    if not 0 < value < math.inf:
        raise ValueError(f"a {what} is more than zero, found {value!r}")


def need_same_length(first: Array, second: Array) -> None:
    """Raise ValueError unless two arrays are one-dimensional, finite, and of one length of at least two."""
    if first.ndim != 1 or first.shape != second.shape or len(first) < 2:
        raise ValueError(f"two arrays of one length are needed, found {first.shape} and {second.shape}")
    need_finite(first, second)


def need_finite(*arrays: Array) -> None:
    """Raise ValueError unless every sample is finite."""
    if not all(np.isfinite(values).all() for values in arrays):
        raise ValueError("a sample is not finite")

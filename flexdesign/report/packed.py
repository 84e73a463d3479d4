"""Arrays as text in a page: little-endian numbers in base64, rounded to 16 bits where that is finer than any screen."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Steps between the smallest and the largest number of a rounded array, and the code of a gap.
STEPS, GAP = 2**16 - 2, 2**16 - 1


def exact(values: ArrayLike) -> str:
    """Return numbers in single precision, which has seven digits; gaps stay NaN."""
    return _text(np.asarray(values, dtype="<f4"))


def indices(values: ArrayLike) -> str:
    """Return whole numbers from zero on."""
    return _text(np.asarray(values, dtype="<u4"))


def rounded(values: ArrayLike) -> dict[str, Any]:
    """Return numbers as whole multiples of a step above their minimum; the error is half a step, a gap stays one.

    >>> rounded([0.0, 65534.0])["step"]
    1.0
    """
    numbers: NDArray[np.float64] = np.asarray(values, dtype=float)
    there = np.isfinite(numbers)
    low, high = (float(numbers[there].min()), float(numbers[there].max())) if there.any() else (0.0, 0.0)
    step = (high - low) / STEPS or 1.0
    codes = np.where(there, np.round((np.where(there, numbers, low) - low) / step), GAP)
    return {"low": low, "step": step, "data": _text(codes.astype("<u2"))}


def _text(numbers: NDArray[Any]) -> str:
    return base64.b64encode(numbers.tobytes()).decode()

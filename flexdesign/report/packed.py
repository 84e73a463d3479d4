"""Arrays as text in a page: little-endian numbers, rounded to 16 bits where that is finer than any screen, deflated.

An array of shape (n, k) is written column by column, as its neighbours are then alike and deflate to less. The page
inflates arrays with the browser's own `DecompressionStream` (RFC 1950) before it shows what they belong to.
"""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Steps between the smallest and the largest number of a rounded array, and the code of a gap.
STEPS, GAP = 2**16 - 2, 2**16 - 1


def exact(values: ArrayLike) -> dict[str, Any]:
    """Return numbers in single precision, which has seven digits; gaps stay NaN."""
    return _text(np.asarray(values, dtype="<f4"))


def corners(values: ArrayLike) -> dict[str, Any]:
    """Return the corners of edges or triangles, shape (n, k), in an order of which the differences are small.

    Each begins with its smallest corner, and keeps the sense in which it goes round; they are sorted. The first column
    holds differences to the one before, the others differences to the first.
    """
    given: NDArray[np.int64] = np.asarray(values, dtype=np.int64)
    turned = (given.argmin(axis=1)[:, None] + np.arange(given.shape[1])) % given.shape[1]
    rows = np.take_along_axis(given, turned, axis=1)
    rows = rows[np.lexsort(rows.T[::-1])]
    rows[:, 1:] -= rows[:, :1]
    rows[:, 0] = np.diff(rows[:, 0], prepend=0)
    return _text(rows.astype("<u4"))


def quantise(values: ArrayLike) -> dict[str, Any]:
    """Return numbers as whole multiples of a step above their minimum; the error is half a step, a gap stays one.

    >>> quantise([0.0, 65534.0])["step"]
    1.0
    """
    numbers: NDArray[np.float64] = np.asarray(values, dtype=float)
    there = np.isfinite(numbers)
    low, high = (float(numbers[there].min()), float(numbers[there].max())) if there.any() else (0.0, 0.0)
    step = (high - low) / STEPS or 1.0
    codes = np.where(there, np.round((np.where(there, numbers, low) - low) / step), GAP)
    return {"low": low, "step": step, "data": _text(codes.astype("<u2"))}


def _text(numbers: NDArray[Any]) -> dict[str, Any]:
    """Return the numbers column by column, deflated; `columns` says how many there are."""
    columns = numbers.shape[1] if numbers.ndim == 2 else 1
    deflated = zlib.compress(np.ascontiguousarray(numbers.T).tobytes(), 9)
    return {"deflated": base64.b64encode(deflated).decode(), "columns": columns}

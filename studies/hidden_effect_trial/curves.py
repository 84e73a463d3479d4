"""Legendre polynomials: smooth curves that hold neither a slope nor a parabola nor a cubic."""

from __future__ import annotations

from typing import cast

import numpy as np
from numba import njit
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Degrees of the sensor's error, and of the gain's. Over a range that is covered evenly they are orthogonal to every
#: polynomial of lower degree. What the catalogue bends in position or voltage, it bends by squares and cubes. A gain is
#: integrated to a displacement, so that its degree 5 holds degrees 4 and 6 there.
OF_SENSOR, OF_GAIN = range(4, 8), range(5, 8)


def curve(place: Array, weights: tuple[float, ...]) -> Array:
    """Return the sum of the polynomials `OF_SENSOR` at places, cut to -1 ... 1."""
    coefficients = (*([0.0] * OF_SENSOR.start), *weights)
    return cast("Array", legendre.legval(np.clip(place, -1.0, 1.0), coefficients))


@njit(inline="always", error_model="numpy")
def integral(place: float, five: float, six: float, seven: float) -> float:
    """Return the integral from -1 of a sum of polynomials `OF_GAIN`; zero at both ends and beyond."""
    x = min(max(place, -1.0), 1.0)
    last, now, whole = 1.0, x, 0.0
    for n in range(1, 8):  # now is P_n, last P_(n - 1)
        after = ((2 * n + 1) * x * now - n * last) / (n + 1)
        weight = five if n == 5 else six if n == 6 else seven if n == 7 else 0.0
        whole += weight * (after - last) / (2 * n + 1)
        last, now = now, after
    return whole

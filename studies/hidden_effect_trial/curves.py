"""Legendre polynomials: smooth curves that hold neither a slope nor a parabola nor a cubic."""

from __future__ import annotations

from typing import cast

import numpy as np
from numba import njit
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Degrees of the error of the sensor, and of the gain. What the catalogue bends in position or voltage, it bends by
#: squares and cubes; to these, polynomials of higher degree are orthogonal over a range that is covered evenly. A gain
#: is integrated to a displacement, so that its degree 5 holds degrees 4 and 6 there.
OF_SENSOR, OF_GAIN = range(4, 8), range(5, 8)


def curve(place: Array, weights: tuple[float, ...]) -> Array:
    """Return the sum of polynomials from degree 0 on, at places, cut to -1 ... 1."""
    return cast("Array", legendre.legval(np.clip(place, -1.0, 1.0), weights))


def without_low_degrees(weights: Array, places: Array) -> tuple[float, ...]:
    """Return the polynomials `OF_SENSOR` with weights, less the cubic that is nearest over places, from degree 0 on.

    Runs do not cover a range evenly; over their places the curve is then orthogonal to every cubic.
    """
    all_degrees = legendre.legvander(np.clip(places, -1.0, 1.0), OF_SENSOR.stop - 1)
    low, high = all_degrees[:, : OF_SENSOR.start], all_degrees[:, OF_SENSOR.start :] @ weights
    cubic = np.linalg.lstsq(low, high, rcond=None)[0]
    return tuple(float(weight) for weight in (*-cubic, *weights))


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

"""How far a plate clamped at two sides and free at the others is relieved of its constraint: Ritz solutions.

The plate is 1 long between its clamped sides and 1 / ratio wide; moduli are those of plane stress with E = 1. The
relief r is that of `flexdesign.effects.hinge_compliance.width`: the compliance is 1 - nu^2 + nu^2 r of a beam's.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import Legendre, Polynomial
from numpy.typing import NDArray

Array = NDArray[np.float64]
POISSON = 0.33
#: Terms along and across; points of the quadrature.
ALONG, ACROSS, POINTS = 6, 14, 60


def _points(low: float, high: float) -> tuple[Array, Array]:
    places, weights = np.polynomial.legendre.leggauss(POINTS)
    return low + (places + 1) * (high - low) / 2, weights * (high - low) / 2


def _shapes(degree: int, domain: tuple[float, float], vanishing: Polynomial, places: Array) -> tuple[Array, ...]:
    """Return a shape function at some places, with its first two derivatives."""
    shape = vanishing * Legendre.basis(degree, domain=list(domain)).convert(kind=Polynomial)
    return tuple(np.asarray(f(places) + 0 * places) for f in (shape, shape.deriv(1), shape.deriv(2)))


def _across(degree: int, wide: float, places: Array) -> tuple[Array, ...]:
    shape = Legendre.basis(degree, domain=[-wide / 2, wide / 2])
    return tuple(np.asarray(f(places) + 0 * places) for f in (shape, shape.deriv(1), shape.deriv(2)))


def _relief(gradients: list[tuple[Array, Array, Array]], weights: Array, twist: float) -> float:
    """Return the relief where shapes add (along, across, shear) to a state (1, 0, 0); `twist` weighs the shear."""
    a, b, c = (np.array([g[k].ravel() for g in gradients]) for k in range(3))
    nu = POISSON
    stiffness = (a * weights) @ a.T + (b * weights) @ b.T + nu * ((a * weights) @ b.T + (b * weights) @ a.T)
    stiffness += twist * (c * weights) @ c.T
    load = -((a * weights).sum(axis=1) + nu * (b * weights).sum(axis=1))
    whole = weights.sum()
    left = whole - np.linalg.lstsq(stiffness, load, rcond=1e-12)[0] @ load
    return float(((1 - nu**2) * whole / left - (1 - nu**2)) / nu**2)


@cache
def bent(ratio: float) -> float:
    """Return the relief of a Kirchhoff plate whose clamped sides turn; length over width is `ratio`."""
    wide = 1 / ratio
    (x, wx), (y, wy) = _points(0, 1), _points(-wide / 2, wide / 2)
    clamped = Polynomial([0, 0, 1, -2, 1])
    along = [_shapes(2 * i, (0, 1), clamped, x) for i in range(ALONG)]
    across = [_across(2 * j, wide, y) for j in range(ACROSS)]
    gradients = [(np.outer(p[2], q[0]), np.outer(p[0], q[2]), np.outer(p[1], q[1])) for p in along for q in across]
    return _relief(gradients, np.outer(wx, wy).ravel(), 2 * (1 - POISSON))


@cache
def relief(ratio: float) -> float:
    """Return the relief of a sheet whose clamped sides part; length over width is `ratio`."""
    wide = 1 / ratio
    (x, wx), (y, wy) = _points(-0.5, 0.5), _points(-wide / 2, wide / 2)
    held = Polynomial([0.25, 0, -1])
    nothing = np.zeros((len(x), len(y)))
    gradients = []
    for i in range(ALONG):
        odd, even = _shapes(2 * i + 1, (-0.5, 0.5), held, x), _shapes(2 * i, (-0.5, 0.5), held, x)
        for j in range(ACROSS):
            level, tilt = _across(2 * j, wide, y), _across(2 * j + 1, wide, y)
            gradients.append((np.outer(odd[1], level[0]), nothing, np.outer(odd[0], level[1])))
            gradients.append((nothing, np.outer(even[0], tilt[1]), np.outer(even[1], tilt[0])))
    return _relief(gradients, np.outer(wx, wy).ravel(), (1 - POISSON) / 2)

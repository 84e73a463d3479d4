"""What the mesh leaves open: Richardson extrapolation, and an error bar from several meshes.

On meshes refined alike everywhere a quantity behaves as f(h) = f(0) + C h^p. At a sharp root, where the solid fills
270 degrees, stresses grow as r^(s - 1) with s = 0.5445 (Williams 1952), and energies, hence stiffnesses, converge in
the end with p = 2 s = 1.089 however high the order of the elements. Before the end, the smooth part of the error, which
falls with a higher power, has its share, so that the order seen lies between that and about 2.

Hence a bracket: extrapolations with the lowest and the highest order that theory allows for, and their middle as the
value. Where rounded roots leave little that is singular, three meshes may still show the smooth error's own order, 3 to
4 with quadratic elements, and the bracket opens to what they show. Half their distance would be all of the error if
meshes were refined alike everywhere. They are not: how many triangles meet at a root, and how many layers or elements
fit, changes from mesh to mesh, and with it what a mesh leaves open. Over refinements of one section the error of K_in
fell by factors between 1.7 and 2.5 where 2.1 is the mean; on forty parts (`studies.error_bars`) an estimate that left
this out held no more than 4 truths of 5. Each mesh therefore has a `MeshNoise`, part of which is a share of what it
leaves open, and extrapolation magnifies it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

#: Lowest and highest order: Williams' exponent of a re-entrant right angle, the root of sin(3 pi s / 2) = s, times two;
#: and that of a mixture with the smooth error. Rounding the hinge roots leaves the sharp corners elsewhere and brings
#: the error of straight edges on round fillets, of order 2, so that the bracket is the same.
ORDERS = (2 * 0.5444837, 2.0)

#: Order of the smooth error of quadratic elements, in energies and what follows from them: no mesh shows a higher one.
SMOOTH = 4.0


@dataclass(frozen=True)
class MeshNoise:
    """How far results lie apart on meshes made alike.

    Parameters
    ----------
    relative
        Spread, relative to the value.
    share
        Half-width, as a share of what the mesh leaves open.
    """

    relative: float
    share: float = 0.0


#: That of a mesher that does not repeat itself: the spread of K_in over runs with the same input.
MESH_NOISE = MeshNoise(2e-3)


@dataclass(frozen=True)
class Extrapolated:
    """A quantity freed from its leading discretisation error.

    Parameters
    ----------
    value
        Extrapolated to vanishing element size.
    error
        Half-width within which the truth is expected.
    finest
        On the finest mesh.
    observed_order
        The p that three meshes suggest; NaN if they do not converge monotonically.
    gci
        Roache's grid convergence index of the finest mesh with the lowest order and a safety factor of 1.25,
        relative: what a report without extrapolation would have to state.
    """

    value: float
    error: float
    finest: float
    observed_order: float
    gci: float


def extrapolate(
    values: Sequence[float],
    sizes: Sequence[float],
    orders: tuple[float, float] = ORDERS,
    mesh_noise: MeshNoise = MESH_NOISE,
    remaining_errors: Sequence[float] | None = None,
) -> Extrapolated:
    """Extrapolate the values found on two or more meshes, coarse to fine.

    Parameters
    ----------
    values
        The quantity on each mesh.
    sizes
        Element size of each mesh.
    orders
        Lowest and highest order of convergence. The highest gives way to the one that three meshes show, if that is
        higher, up to `SMOOTH`.
    mesh_noise
        Of the values over meshes made alike.
    remaining_errors
        The remaining error of each mesh, relative, in the stiffnesses of the same hinges. In a ratio, such as an
        amplification, the regular part of their errors cancels, and its own values show little; the scatter stays, as
        each root is irregular by itself.
    """
    # of the last step, in the extrapolation; scatter may feign a high order, which must not make its own share small
    weight = sum(_weight(sizes[-2:], order) for order in orders) / 2
    observed = observed_order(values[-3:], sizes[-3:]) if len(values) > 2 else math.nan
    if observed > orders[1]:
        orders = orders[0], min(observed, SMOOTH)
    low, high = (_pair(values[-2:], sizes[-2:], order) for order in orders)
    value = (low + high) / 2
    doubts = [abs(high - low) / 2]
    if len(values) == 2:
        doubts.append(abs(value - values[-1]) / 2)
    else:
        before = sum(_pair(values[-3:-1], sizes[-3:-1], order) for order in orders) / 2
        doubts.append(abs(value - before) / 4)
    coarse, fine = (
        math.hypot(mesh_noise.relative / 2 * abs(value), mesh_noise.share * max(abs(value - found), abs(value) * other))
        for found, other in zip(values[-2:], remaining_errors[-2:] if remaining_errors else (0.0, 0.0), strict=True)
    )
    noise = math.hypot((1 + weight) * fine, weight * coarse)
    gci = 1.25 * abs(low - values[-1]) / abs(values[-1]) if values[-1] else 0.0
    return Extrapolated(value, math.hypot(max(doubts), noise), values[-1], observed, gci)


def describe(mesh_noise: MeshNoise) -> str:
    """Return in words how limits and their errors are found."""
    share = f" and of {100 * mesh_noise.share:g} % of the remaining error of each mesh" if mesh_noise.share else ""
    return (
        f"The error is assumed to fall with a power of the edge length between {ORDERS[0]:.3g} and {ORDERS[1]:.3g} (or "
        f"the higher one that three meshes show, up to {SMOOTH:g}). The value is the mean of the two extrapolations. "
        "The printed error is the larger of two numbers: half the difference of the two extrapolations, and a quarter "
        "of the change from the extrapolation of the coarser pair of meshes (with two meshes: half the change by "
        f"extrapolation). The effect of a scatter of {100 * mesh_noise.relative:g} %{share} on the extrapolation is "
        "added in quadrature."
    )


def observed_order(values: Sequence[float], sizes: Sequence[float]) -> float:
    """Return p with f = f0 + C h^p through three meshes, or NaN if there is none."""
    from scipy.optimize import brentq

    (a, b, c), (ha, hb, hc) = values, sizes
    if (a - b) * (b - c) <= 0:
        return math.nan
    ratio = (a - b) / (b - c)

    def gap(p: float) -> float:
        return (ha**p - hb**p) / (hb**p - hc**p) - ratio

    low, high = 0.05, 12.0
    return float(brentq(gap, low, high)) if gap(low) * gap(high) < 0 else math.nan


def _pair(values: Sequence[float], sizes: Sequence[float], order: float) -> float:
    coarse, fine = values
    return fine + (fine - coarse) * _weight(sizes, order)


def _weight(sizes: Sequence[float], order: float) -> float:
    return 1 / ((sizes[0] / sizes[1]) ** order - 1)

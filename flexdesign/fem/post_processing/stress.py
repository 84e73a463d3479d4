"""Von Mises stress at the nodes, and what its peak is worth.

At a sharp root, where the solid fills 270 degrees, linear elasticity has no peak: stress grows as r^(s - 1) with s =
0.5445 (Williams 1952), so that the largest value a mesh shows grows as h^(s - 1) and depends on the mesh alone. At a
fillet or a round notch it has one, and meshes fine enough to follow the curve approach it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Member
from flexdesign.fem.convergence import ORDERS
from flexdesign.fem.solving.elasticity import EDGES, Elasticity

FloatArray = NDArray[np.float64]


#: Barycentric coordinates of a tetrahedron's ten nodes.
NODES = np.vstack([np.eye(4), np.eye(4)[EDGES].mean(axis=1)])
#: How fast the peak at a sharp root grows as the mesh is refined: 1 - s of a re-entrant right angle.
SINGULAR = 1 - ORDERS[0] / 2
#: The slowest power of h with which the error of a peak on a faceted curve is taken to fall.
SLOWEST = 0.5


def von_mises(stress: FloatArray) -> FloatArray:
    """Return the von Mises stress of stress tensors (..., 3, 3)."""
    deviator = stress - np.trace(stress, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) / 3
    return np.asarray(np.sqrt(1.5 * np.einsum("...ij,...ij->...", deviator, deviator)))


def largest_principal(stress: FloatArray) -> FloatArray:
    """Return the largest principal stress, tension positive, of stress tensors (..., 3, 3): what breaks the brittle."""
    return np.asarray(np.linalg.eigvalsh(stress)[..., -1])


def nodal(body: Elasticity, displacement: FloatArray) -> FloatArray:
    """Return the stress averaged at each node over its elements, shape (n, 3, 3) [Pa]."""
    stress = body.stress(displacement, NODES)
    total = np.zeros((body.n_dofs // 3, 3, 3))
    np.add.at(total, body.nodes, stress)
    count = np.bincount(body.nodes.ravel(), minlength=len(total))
    return np.asarray(total / count[:, None, None])


def nodal_von_mises(body: Elasticity, displacement: FloatArray) -> FloatArray:
    """Return the von Mises stress of `nodal`, shape (n,) [Pa]."""
    return von_mises(nodal(body, displacement))


def is_sharp(member: Member) -> bool:
    """Tell whether a member ends in sharp roots: neither fillets nor a round notch."""
    return member.root_radius == 0 and member.profile is None


def growth(peaks: Sequence[float], sizes: Sequence[float]) -> float:
    """Return the exponent g of peaks ~ h^-g, fitted to two or more meshes of element sizes h.

    >>> round(growth([1.0, 2.0], [4.0, 1.0]), 3)
    0.5
    """
    slope, _ = np.polyfit(np.log(sizes), np.log(np.abs(peaks)), 1)
    return float(-slope)


@dataclass(frozen=True)
class Peak:
    """The largest stress on meshes coarse to fine, and whether it is a property of the body.

    Parameters
    ----------
    value
        On the finest mesh [Pa].
    error
        Half-width within which the true peak is expected [Pa]; None where there is none.
    exponent
        g of the growth as h^-g over all meshes.
    """

    value: float
    error: float | None
    exponent: float


def peak(values: Sequence[float], sizes: Sequence[float], *, sharp: bool) -> Peak:
    """Judge the peaks of two or more meshes, coarse to fine.

    Elements with straight edges make a polygon of a curve, and its corners, though blunt, raise the stress: at a hole
    the error falls no faster than the first power of h, and slower for a while. A node seldom lies where the peak is,
    so that values scatter, too. Hence no extrapolation: the value is that of the finest mesh. Its error is what the
    mesh before leaves to it if errors fall with the power `SLOWEST`, or, if larger, what any mesh before that leaves
    to it if errors fall with the first power, as what coarse meshes miss goes sooner.
    """
    finest = values[-1]
    exponent = growth(values, sizes)
    if sharp:
        return Peak(finest, None, exponent)
    powers = [1.0] * (len(values) - 2) + [SLOWEST]
    coarser = zip(values[:-1], sizes[:-1], powers, strict=True)
    error = max(abs(finest - value) / ((size / sizes[-1]) ** power - 1) for value, size, power in coarser)
    return Peak(finest, error, exponent)

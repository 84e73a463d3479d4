"""The profile of a hinge: how thick it is along its axis, and whether its neck is curved."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Member

FloatArray = NDArray[np.float64]

#: A fillet makes a neck of a leaf if its radius is at least so many thicknesses, or if both fillets take at least this
#: share of the length: then the leaf has no even part in which it bends.
FILLET, SHARE = 1.0, 0.9


def is_curved(member: Member) -> bool:
    """Tell whether a member is a hinge with a curved neck: a circular notch, however declared, or a long fillet.

    >>> leaf = Member("h", "hinge", ("a", "b"), (0.0, 0.0, 0.0), (4e-3, 0.0, 0.0), 5e-4, 1e-2, root_radius=3e-4)
    >>> is_curved(leaf)
    False
    """
    if member.kind != "hinge":
        return False
    if math.isfinite(member.curvature_radius):
        return True
    fillet = member.root_radius
    return fillet > 0 and (fillet >= FILLET * member.thickness or 2 * fillet >= SHARE * member.length)


def radius(member: Member) -> float:
    """Return the radius of curvature of a curved hinge's profile [m]."""
    return member.curvature_radius if math.isfinite(member.curvature_radius) else member.root_radius


def flat_half(member: Member) -> float:
    """Return how far from the centre a hinge is as thin as at its neck [m]."""
    if math.isfinite(member.curvature_radius):
        return 0.0
    return max(member.length / 2 - member.root_radius, 0.0)


def frame(member: Member) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors along a member and across it in the plane."""
    axis = np.array(member.axis)
    return axis, np.cross([0.0, 0.0, 1.0], axis)


def thickness(member: Member, s: FloatArray) -> FloatArray:
    """Return the nominal thickness [m] at distances `s` [m] from a member's centre."""
    s = np.asarray(s, dtype=float)
    if math.isinf(member.curvature_radius) and member.root_radius == 0:
        return np.full(s.shape, member.thickness)
    return np.asarray(np.vectorize(member.thickness_at, otypes=[float])(s))

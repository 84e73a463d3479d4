"""The profile of a hinge: how thick it is along its axis, and whether its neck is curved."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Member

FloatArray = NDArray[np.float64]

#: A fillet makes a neck of a leaf if its radius is at least this number of thicknesses, or if both fillets take at
#: least this share of the length: then the leaf has no even part in which it bends.
FILLET, SHARE = 1.0, 0.9


def is_curved(member: Member) -> bool:
    """Tell whether a member is a hinge with a curved neck: a notch, however declared, or a long fillet.

    >>> leaf = Member("h", "hinge", ("a", "b"), (0.0, 0.0, 0.0), (4e-3, 0.0, 0.0), 5e-4, 1e-2, root_radius=3e-4)
    >>> is_curved(leaf)
    False
    """
    if member.kind != "hinge":
        return False
    if member.profile is not None:
        return True
    fillet = member.root_radius
    return fillet > 0 and (fillet >= FILLET * member.thickness or 2 * fillet >= SHARE * member.length)


def radius(member: Member, s: FloatArray) -> FloatArray:
    """Return the radius of curvature of a curved hinge's profile at distances `s` from its centre [m].

    No smaller than at the neck: where an ellipse bends more towards its ends, the hinge is thick.
    """
    if (notch := member.profile) is not None:
        return np.maximum(notch.curvature_radius(s), notch.radius)
    return np.full(np.shape(s), member.root_radius)


def flat_half(member: Member) -> float:
    """Return how far from the centre a hinge is as thin as at its neck [m]."""
    return 0.0 if member.profile is not None else max(member.length / 2 - member.root_radius, 0.0)


def frame(member: Member) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors along a member and across it in the plane."""
    axis = np.array(member.axis)
    return axis, np.cross([0.0, 0.0, 1.0], axis)

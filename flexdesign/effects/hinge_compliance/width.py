"""How much its width stiffens a leaf: between plane stress, E, and plane strain, E / (1 - nu^2).

A leaf that bends or stretches would contract sideways, and what it runs into keeps its ends from doing so. How far the
constraint reaches depends on length over width. For a thin plate clamped at two opposite sides and free at the others,
the effective compliance is (1 - nu^2 + nu^2 r) / E with a relief r between 0 (wide) and 1 (narrow) that hardly depends
on nu: `BENDING` holds it for a plate whose clamped sides turn, `STRETCHING` for one whose clamped sides part. Both are
Ritz solutions (``python -m studies.hinge_coefficients``).

A plate that is not thin is relieved along its free edges besides, over a width of about its thickness. The factor,
`EDGES`, is the one number here that was fitted: to the output stiffness of the 27 sharp-rooted amplifiers of
`studies.error_bars`, solved with hexahedra, for which hinge rotation is nearly all.
"""

from __future__ import annotations

import math

import numpy as np

from flexdesign.core.model import Elastic, Member

#: Length over width, and the relief of a plate that is bent, or stretched.
RATIOS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2, 2.0, 4.0, 20.0)
BENDING = (0.0, 0.006, 0.015, 0.031, 0.063, 0.094, 0.158, 0.258, 0.394, 0.597, 0.793, 0.956)
STRETCHING = (0.0, 0.018, 0.046, 0.093, 0.190, 0.288, 0.467, 0.651, 0.773, 0.865, 0.932, 0.986)
#: Relief of the free edges, per thickness over width.
EDGES = 1.3


def bending_modulus(member: Member, elastic: Elastic) -> float:
    """Return the modulus of a member that bends [Pa]; a rod is held against contraction at one end only."""
    clamped = {"hinge": 1.0, "rod": 2.0}.get(member.kind)
    if clamped is None:
        return elastic.youngs_modulus
    ratio = clamped * member.length / member.width
    return _constrained(elastic, float(np.interp(ratio, RATIOS, BENDING)) + _edges(member))


def stretching_modulus(member: Member, elastic: Elastic) -> float:
    """Return the modulus of a member that is stretched [Pa]."""
    if member.kind != "hinge":
        return elastic.youngs_modulus
    ratio = member.length / member.width
    return _constrained(elastic, float(np.interp(ratio, RATIOS, STRETCHING)) + _edges(member))


def root_modulus(member: Member, elastic: Elastic) -> float:
    """Return the modulus at a member's root, which is in plane strain but at the free edges [Pa]."""
    return _constrained(elastic, _edges(member))


def _edges(member: Member) -> float:
    return EDGES * member.thickness / member.width


def _constrained(elastic: Elastic, relief: float) -> float:
    remaining = elastic.constraint * elastic.poissons_ratio**2 * (1 - min(relief, 1.0))
    return elastic.youngs_modulus / (1 - remaining)


def plate_modulus(member: Member, elastic: Elastic, lever: int) -> float:
    """Return the modulus of a hinge as a plate, constrained most at its clamped ends [Pa].

    The constraint is taken as cosh(s / d) / cosh(l / 2d), s from the middle, and d such that its mean over the length
    is that of `BENDING`. The free edges relieve it where it is.

    Parameters
    ----------
    member, elastic
        The hinge and its material, whose own constraint is left aside.
    lever
        0 for an even moment, 2 for an S, whose moment grows with s: the compliance is weighted with s^lever.
    """
    length = member.length
    mean = 1 - float(np.interp(length / member.width, RATIOS, BENDING))
    u = _argument(mean)
    weight = math.tanh(u) / u if lever == 0 else 3 * (math.tanh(u) * (1 / u + 2 / u**3) - 2 / u**2)
    remaining = elastic.poissons_ratio**2 * weight * (1 - min(_edges(member), 1.0))
    return elastic.youngs_modulus / (1 - remaining)


def _argument(mean: float) -> float:
    """Return u = l / 2d with tanh(u) / u = mean, by Newton's method."""
    u = max(1 / mean, 1e-3) if mean < 0.5 else math.sqrt(3 * (1 / mean - 1)) + 1e-3
    for _ in range(30):
        value, slope = math.tanh(u) / u - mean, (1 - math.tanh(u) ** 2) / u - math.tanh(u) / u**2
        u = max(u - value / slope, 1e-3)
    return u

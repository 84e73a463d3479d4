"""Members as Timoshenko beams, in the plane of the mechanism.

About its centre a beam's compliance is diagonal: stretch l/EA, sway l^3/12EI and shear l/kGA, rotation l/EI. Where the
thickness varies along the member these are the integrals of 1/EA, s^2/EI, 1/kGA and 1/EI, s from the centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Elastic, Member
from flexdesign.effects.hinge_compliance import width

#: Share of a rectangular section that carries shear.
SHEAR_SHARE = 5 / 6
#: Points of the quadrature along each smooth piece of a profile.
POINTS = 64


def stretch(member: Member, elastic: Elastic) -> float:
    """Return the stretch per force along the member [m/N]."""
    return integral(member, 1, 0) / (width.stretching_modulus(member, elastic) * member.width)


def rotation(member: Member, elastic: Elastic) -> float:
    """Return the rotation of one end to the other per moment [rad/(N m)]."""
    return 12 * integral(member, 3, 0) / (width.bending_modulus(member, elastic) * member.width)


def sway(member: Member, elastic: Elastic) -> float:
    """Return the motion across the member per force across it, as it bends into an S [m/N]."""
    return 12 * integral(member, 3, 2) / (width.bending_modulus(member, elastic) * member.width)


def shear(member: Member, elastic: Elastic) -> float:
    """Return the motion across the member per force across it, as it shears [m/N]."""
    return integral(member, 1, 0) / (SHEAR_SHARE * elastic.shear_modulus * member.width)


def out_of_plane(member: Member, elastic: Elastic, yielding: float = 0.0) -> Array:
    """Return the compliance along z, twisting, and turning about the line across a member, 3 by 3.

    About the centre it is diagonal: l^3/12EI + l/kGA and l/EI, of a beam as deep as the member is wide. A leaf does not
    twist freely: its ends stay plane, and the material off the axis bends into an S. With u = (l/2) sqrt(GJ / EI_w),
    the ends held against warping, the twist per moment is l/GJ (1 - tanh u / u); J = w t^3/3 (1 - 0.63 t/w) is
    Saint-Venant's, I_w = w^3 t^3/144 Vlasov's of a thin strip, its modulus that of a plate, E / (1 - nu^2).

    Parameters
    ----------
    member, elastic
        The member, its thickness that of the mean, and its material.
    yielding
        By how much a strip of the member that bends into an S gives way at its ends, over its own compliance.
    """
    young, shear, length = elastic.youngs_modulus, elastic.shear_modulus, member.length
    mean = length / integral(member, 1, 0)
    thin, wide = sorted((mean, member.width))
    deep = young * mean * member.width**3 / 12
    across = length**3 / (12 * deep) + length / (SHEAR_SHARE * shear * mean * member.width)
    free = shear * wide * thin**3 / 3 * (1 - 0.63 * thin / wide)
    warped = young / (1 - elastic.poissons_ratio**2) * wide**3 * thin**3 / 144 / (1 + yielding)
    u = length / 2 * math.sqrt(free / warped)
    return np.diag([across, length / free * (1 - math.tanh(u) / u), length / deep])


def evenly_loaded(member: Member, elastic: Elastic) -> Array:
    """Return the compliance of half a block that is pressed evenly on one side and held at its ends, 3 by 3.

    The member runs from the block's end, where it is held, to its middle, whose cross-section does not turn; its end
    has the mean motion of the pressed side. With M(s) = M + V (s - s^2 / 2l), s from the held end, the integrals
    of M^2 / EI and V^2 / kGA give 2 l^3 / 15 EI + l / 3 kGA across, l / EI turning, and l^2 / 3 EI between the two.
    """
    length, bending = member.length, elastic.youngs_modulus * member.second_moment
    across = 2 * length**3 / (15 * bending) + length / (3 * SHEAR_SHARE * elastic.shear_modulus * member.area)
    between = -(length**2) / (3 * bending)  # a force to the left at the start turns the block to the right
    held = np.array([[0.0, 0.0, 0.0], [0.0, across, between], [0.0, between, length / bending]])
    return from_place(held, -length / 2)


def from_place(compliance: Array, place: float) -> Array:
    """Return at the member's centre a compliance that is known at a place on its axis.

    Parameters
    ----------
    compliance
        3 by 3, for the forces at that place.
    place
        Where it is, from the centre towards the end [m]: the moment there is M - V place.
    """
    to_place = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -place, 1.0]])
    return np.asarray(to_place.T @ compliance @ to_place)


def integral(member: Member, power: int, moment: int) -> float:
    """Return the integral of s^moment / t(s)^power along the member [m], s from its centre; `moment` is even."""
    straight = straight_half(member)
    whole = 2 * straight ** (moment + 1) / ((moment + 1) * member.thickness**power)
    if straight == member.length / 2:
        return float(whole)
    side = sides(member)
    return float(whole + 2 * side.lengths @ (side.s**moment / side.thicknesses**power))


@dataclass(frozen=True)
class Sides:
    """A half of a member where its sides rise, at points of a quadrature.

    Parameters
    ----------
    s, lengths
        Distances from the centre, and the length that each point represents [m].
    thicknesses
        Thickness there [m].
    gradients
        Slope of either side.
    """

    s: Array
    lengths: Array
    thicknesses: Array
    gradients: Array


def straight_half(member: Member) -> float:
    """Return how far from the centre a member is prismatic [m]."""
    return 0.0 if member.profile is not None else member.length / 2 - member.root_radius


def sides(member: Member) -> Sides:
    """Return where the sides of a notch or of fillets rise, each piece in a variable in which it is smooth."""
    unit, weights = _quarter()
    half, thin = member.length / 2, member.thickness
    notch = member.profile
    if notch is None or notch.shape in ("circular", "elliptic"):
        # Along an arc s runs as the sine of an angle.
        reach = member.root_radius if notch is None else notch.half_length
        axis = notch.radius if notch is not None and notch.shape == "circular" else reach
        last = math.asin(min(reach / axis, 1.0))
        into, lengths = axis * np.sin(last * unit), last * axis * weights * np.cos(last * unit)
        s = half - member.root_radius + into if notch is None else into
        gradients = np.tan(last * unit) if notch is None else notch.slope(s)
    elif notch.shape == "parabolic":
        # s / neck is the tangent of an angle, neck being where the thickness is twice that of the neck.
        neck = half * math.sqrt(thin / (2 * notch.depth))
        last = math.atan(half / neck)
        s, lengths = neck * np.tan(last * unit), last * neck * weights / np.cos(last * unit) ** 2
        gradients = notch.slope(s)
    else:
        # The arc by its angle, the flank by the logarithm of its thickness.
        angle, bend = notch.flank_angle, notch.arc_half
        rising = 2 * math.tan(angle)
        at_bend = thin + 2 * float(notch.rise(np.array([bend]))[0])
        ratio = (at_bend + rising * (half - bend)) / at_bend
        flank = at_bend * ratio**unit
        s = np.concatenate([notch.radius * np.sin(angle * unit), bend + (flank - at_bend) / rising])
        lengths = np.concatenate(
            [angle * notch.radius * weights * np.cos(angle * unit), math.log(ratio) * weights * flank / rising]
        )
        gradients = notch.slope(s)
    return Sides(s, lengths, member.thicknesses(s), gradients)


@cache
def _quarter() -> tuple[Array, Array]:
    """Return places and weights of a quadrature from 0 to 1."""
    places, weights = np.polynomial.legendre.leggauss(POINTS)
    return (places + 1) / 2, weights / 2

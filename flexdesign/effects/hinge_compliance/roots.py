"""What gives way at the root of a leaf, where its stress spreads into what it runs into.

The root's compliance is what a planar solution of leaf and body together has over the beams that both are: with the
leaf's thickness t, its width w and the modulus E' of the root, rotation per moment is MM / (E' w t^2), motion across
the leaf per moment MV / (E' w t), along it per moment NM / (E' w t), and along it per force NN / (E' w). For a leaf on
a half-plane O'Donnell (1960) found MM = 16.67 / pi = 5.31 from the mean displacement under the beam's linear stress;
with the leaf's own elasticity it is 4.99. The numbers below are limits of planar quadratic finite elements
(``python -m studies.hinge_coefficients`` prints them again, next to the values of this module):

- ``end``: into the end of a beam of thickness a, as functions of a / t;
- ``flank``: into the side of a beam of depth d that runs across, the leaf's axis an overhang b from the beam's end and
  a height h from where the beam is held. NN is (2 / pi) ln(d / t), for what spreads, less what the beam's axis, half a
  depth away, gives way too little or too much;
- ``block``: into the side of a block that is pulled from behind alike, d being half its depth.

W. J. O'Donnell, The additional deflection of a cantilever due to the elasticity of the support, J. Appl. Mech. 27
(1960).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Elastic, Member, Root
from flexdesign.effects.hinge_compliance import taper, width
from flexdesign.effects.hinge_compliance.beam import from_place

Knots = tuple[Sequence[float], Sequence[float]]

#: ``end``, by a / t.
_END = (1.0, 1.1, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 10.0, 20.0, 40.0)
END_MM: Knots = _END, (0.0, 0.168, 0.839, 1.842, 3.084, 3.730, 4.098, 4.483, 4.764, 4.912, 4.973, 4.989)
END_MV: Knots = _END, (0.0, -0.486, -0.553, -0.522, -0.371, -0.254, -0.155, -0.013, 0.141, 0.273, 0.375, 0.427)
END_NN: Knots = _END, (0.0, -0.007, 0.025, 0.092, 0.226, 0.344, 0.446, 0.614, 0.859, 1.175, 1.611, 2.049)
#: Near an edge, by b / t.
EDGE_MM: Knots = (0.6, 0.75, 1.0, 1.25, 1.5, 2.0, 2.5, 4.0, 8.0), (6.63, 5.98, 5.53, 5.33, 5.22, 5.12, 5.07, 5.02, 4.99)
EDGE_MV: Knots = (0.6, 0.75, 1.0, 1.5, 2.5, 4.0), (1.90, 1.54, 1.18, 0.84, 0.60, 0.51)
#: How much less a ``flank`` gives way than a half-plane, times d / t.
FLANK_MM, FLANK_MV = 0.9, 1.45
#: ``flank``: the part of NN in addition to (2 / pi) ln(d / t), by d / h; what an edge near the leaf adds, by d / b; and
#: NM, of which a part goes with t / d, another, times b / t, with d / b.
FLANK_NN: Knots = (0.25, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8), (-1.65, -1.20, -0.38, -0.12, 0.0, 0.10, 0.15)
FLANK_NN_EDGE: Knots = (
    (3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0),
    (0, 0.04, 0.10, 0.15, 0.28, 0.47, 0.55, 0.83, 1.1),
)
FLANK_NM = 1.3
FLANK_NM_EDGE: Knots = (
    (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 20.0),
    (0, 0.03, 0.09, 0.15, 0.2, 0.3, 0.4, 0.45, 0.55, 0.64),
)
#: ``block``: the part of NN in addition to (2 / pi) ln(d / t), and NM times b / t, by d / b.
BLOCK_NN: Knots = (
    (1.0, 2.0, 3.0, 4.0, 5.3, 6.4, 8.0, 10.7, 16.0),
    (0.645, 0.69, 0.87, 1.06, 1.31, 1.48, 1.76, 2.07, 2.61),
)
BLOCK_NM: Knots = (
    (1.0, 1.6, 2.0, 2.7, 3.2, 4.0, 5.3, 6.4, 8.0, 10.7, 16.0),
    (0, 0.055, 0.12, 0.255, 0.31, 0.41, 0.5, 0.53, 0.61, 0.64, 0.71),
)
#: What a fillet takes away, by radius over thickness; the leaf's profile in it is the beam's.
_FILLET = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2)
FILLET_MM: Knots = _FILLET, (0.0, -0.267, -0.515, -0.927, -1.252, -1.731, -2.204, -2.608)
FILLET_MV: Knots = _FILLET, (0.0, -0.087, -0.179, -0.357, -0.525, -0.833, -1.236, -1.694)
FILLET_NN: Knots = _FILLET, (0.0, -0.018, -0.038, -0.075, -0.108, -0.166, -0.237, -0.310)
#: Root assumed for a hinge or rod where its linkage states none: a beam of this multiple of its thickness.
TYPICAL = 6.0


def compliance(member: Member, elastic: Elastic) -> Array:
    """Return the compliance of a member's roots, 3 by 3; zero where no root is stated."""
    member = _at_its_ends(member)
    total = np.zeros((3, 3))
    for root, way in zip(member.roots, (-1, 1), strict=True):
        if root is not None:
            total += from_place(_at_root(member, root, way, elastic), way * member.length / 2)
    return total


def with_guessed_roots(member: Member) -> Member:
    """Return a hinge or rod with a guess of what its linkage does not state of its ends; any other as it is.

    A rod that states one root has none at the other end.
    """
    if (member.kind == "hinge" and None in member.roots) or (member.kind == "rod" and not any(member.roots)):
        typical = Root("end", TYPICAL * _at_its_ends(member).thickness)
        return replace(member, roots=(member.roots[0] or typical, member.roots[1] or typical))
    return member


def _at_its_ends(member: Member) -> Member:
    """Return a notch, or a leaf with long fillets, as a leaf as thick as it is at its roots; any other as it is."""
    if not taper.counts(member):
        return member
    thick = member.thickness_at(member.length / 2)
    return replace(member, thickness=thick, root_radius=0.0, curvature_radius=math.inf, notch=None)


def out_of_plane(member: Member, elastic: Elastic) -> tuple[Array, float]:
    """Return what a member's roots give way out of its plane, 3 by 3, and by how much strips of it do that bend.

    As a leaf bends over its width, each strip of it pulls at its root by itself, so that the turning is that of the
    pull, NN / Ew, times 12 / w^2. A shear along z spreads as the pull does: a line load moves a half-plane by
    2/pi ln(r) / E in its plane and by 1/pi ln(r) / G along z, which is 1 + nu times as much. A strip that bends into
    an S turns at its roots, (l/2)^2 MM / E t^2 each, in addition to its own l^3 / E t^3.
    """
    member = _at_its_ends(member)
    total, strips = np.zeros((3, 3)), 0.0
    scale = width.root_modulus(member, elastic) * member.width
    for root, way in zip(member.roots, (-1, 1), strict=True):
        if root is not None:
            mm, _, nn, _ = coefficients(root, member.thickness, member.root_radius)
            turning, place = 12 * nn / (scale * member.width**2), way * member.length / 2
            along = (1 + elastic.poissons_ratio) * nn / scale
            # A force along z at the centre turns the root at `place` by its lever.
            total += [
                [along + turning * place**2, 0.0, turning * place],
                [0.0, 0.0, 0.0],
                [turning * place, 0.0, turning],
            ]
            strips += mm * member.thickness / (4 * member.length)
    return total, strips


def _at_root(member: Member, root: Root, way: int, elastic: Elastic) -> Array:
    """Return the compliance for forces at the root; seen from the other end (`way`), across and turning swap signs."""
    t = member.thickness
    mm, mv, nn, nm = coefficients(root, t, member.root_radius)
    scale = width.root_modulus(member, elastic) * member.width
    nm = -root.side * nm / (scale * t)
    mv = -way * mv / (scale * t)
    return np.array([[nn / scale, 0.0, nm], [0.0, 0.0, mv], [nm, mv, mm / (scale * t**2)]])


def coefficients(root: Root, thickness: float, radius: float = 0.0) -> tuple[float, float, float, float]:
    """Return MM, MV, NN and NM of a root, without unit.

    Parameters
    ----------
    root
        What the leaf runs into.
    thickness, radius
        Of the leaf, and of the fillet at its root [m].
    """
    depth, overhang = max(root.depth / thickness, 1.0), root.overhang / thickness
    if root.kind == "end":
        mm, mv, nn, nm = _at(depth, END_MM), _at(depth, END_MV), _at(depth, END_NN), 0.0
    else:
        mm, mv = _at(overhang, EDGE_MM), _at(overhang, EDGE_MV)
        nn, near = 2 / math.pi * math.log(depth), depth / overhang
        if root.kind == "flank":
            mm, mv = mm - FLANK_MM / depth, mv - FLANK_MV / depth
            nn += _at(root.depth / root.height, FLANK_NN) + _at(near, FLANK_NN_EDGE)
            nm = FLANK_NM / depth + _at(near, FLANK_NM_EDGE) / overhang
        else:
            nn += _at(near, BLOCK_NN)
            nm = _at(near, BLOCK_NM) / overhang
    rounded = radius / thickness
    mm, mv, nn = (c + float(np.interp(rounded, *k)) for c, k in ((mm, FILLET_MM), (mv, FILLET_MV), (nn, FILLET_NN)))
    return mm, mv, nn, nm


def _at(ratio: float, knots: Knots) -> float:
    """Interpolate over the logarithm of a ratio, in which what spreads is straight."""
    places, values = knots
    return float(np.interp(math.log(ratio), np.log(places), values))

"""Section forces in hinges, arms and rods, from virtual work, and the compliance each accounts for.

What a member transmits is the virtual work of its stresses in a motion that leaves one end at rest and moves the other
as a rigid body r, with a ramp phi(s) from 0 to 1 in its middle part:

    W(r) = int sigma : grad(phi r) dV,    N = W(e_s),    V = W(e_n),    M = -W(turn about the centre)

In equilibrium that is independent of the ramp; with displacements from the elements' own space it balances what acts on
the rest of the body to rounding, however few elements the member holds, and however its stress is distributed: a notch
is no beam. Beam theory gives the compliance that two load cases a, b share through a member of thickness t(s), M
varying with slope V:

    c_ab = N_a N_b int ds / EA + V_a V_b int ds / (kappa G A) + M_a M_b int ds / EI + V_a V_b int s^2 ds / EI

with kappa = 5/6.

What the members do not account for (the roots, where the leaf's stress spreads into its neighbours; the blocks; the
stiffening of a wide leaf that cannot contract sideways) is the remainder, and may be negative.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Member
from flexdesign.design.materials import Material
from flexdesign.effects.hinge_compliance import beam
from flexdesign.fem.meshing import profile
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.solving.elasticity import Elasticity, stress_points

FloatArray = NDArray[np.float64]

#: Timoshenko's shear coefficient of a rectangle.
SHEAR_COEFFICIENT = 5 / 6
#: Middle part of a member over which the ramp rises; its ends belong to the roots.
MIDDLE = 0.8
#: Places along half a member at which its largest fibre stress is sought.
PLACES = 401


@dataclass(frozen=True)
class Section:
    """Section forces of one member of the whole part.

    Parameters
    ----------
    member
        The member.
    normal, shear
        N and V [N].
    moment
        M at the member's centre [N m].
    """

    member: Member
    normal: float
    shear: float
    moment: float

    def shared_compliance(self, other: Section, material: Material) -> dict[str, float]:
        """Return what this and another load case (both per unit load) share through the member [m/N]."""
        member, width = self.member, self.member.width
        young, shear = material.beam_moduli(member.axis)
        length_by_area = beam.integral(member, 1, 0) / width
        rotation, sway = (12 / width * beam.integral(member, 3, moment) for moment in (0, 2))
        return {
            "axial": self.normal * other.normal * length_by_area / young,
            "shear": self.shear * other.shear * length_by_area / (SHEAR_COEFFICIENT * shear),
            "bending": (self.moment * other.moment * rotation + self.shear * other.shear * sway) / young,
        }

    def minus(self, factor: float, other: Section) -> Section:
        """Return the section forces of this load case less `factor` times those of another."""
        return Section(
            self.member,
            self.normal - factor * other.normal,
            self.shear - factor * other.shear,
            self.moment - factor * other.moment,
        )

    @property
    def nominal_stress(self) -> float:
        """Largest fibre stress of beam theory, where section and moment make it largest [Pa].

        In a leaf that is at the more loaded end of its even part, in a notch at the neck or close to it.
        """
        s = np.linspace(0.0, self.member.length / 2, PLACES)
        s = np.append(s, profile.flat_half(self.member))
        thickness = self.member.thicknesses(s)
        moment = abs(self.moment) + abs(self.shear) * s
        bending = 6 * moment / (self.member.width * thickness**2)
        return float((abs(self.normal) / (self.member.width * thickness) + bending).max())


def sections(body: Elasticity, domain: Domain, displacement: FloatArray, members: Sequence[Member]) -> list[Section]:
    """Integrate the section forces of the members that lie in the domain.

    Parameters
    ----------
    body, domain
        The discretised domain.
    displacement
        Nodal displacements, shape (n, 3) [m].
    members
        Members of the whole part; those whose centre the symmetry planes cut away are skipped.
    """
    return [_section(member, body, domain, displacement) for member in members if domain.keeps(member)]


def _section(member: Member, body: Elasticity, domain: Domain, displacement: FloatArray) -> Section:
    axis, normal = profile.frame(member)
    reach, half = MIDDLE * member.length / 2, member.length / 2
    away = body.mesh.points[body.mesh.tets] - np.array(member.centre)
    s, n = away @ axis, away @ normal
    near = np.flatnonzero((s.min(axis=1) < reach) & (s.max(axis=1) > -reach))
    near = near[np.abs(away[near, :, 2].mean(axis=1)) <= member.width / 2 * (1 + 1e-6)]
    s, n = s[near].mean(axis=1), np.abs(n[near])
    thickness = member.thicknesses(np.clip(s, -half, half)) * (1 + 1e-6)
    # An element may reach into the member from the body at its end.
    elements = near[np.where(np.abs(s) <= half, n.mean(axis=1), n.min(axis=1)) <= thickness / 2]
    barycentric, weights = stress_points()
    volumes = body.barycentric_gradients[1][elements]
    stress = body.stress(displacement, barycentric, elements) * (volumes[:, None] * weights)[:, :, None, None]
    halves, across, along = _cut(member, domain)
    places = body.positions - np.array(member.centre)
    place = places @ axis
    ramp = np.clip(place / reach if along else (place + reach) / (2 * reach), 0.0, 1.0)
    turn = np.cross([0.0, 0.0, 1.0], places)
    work = [
        float(np.einsum("eqij,eqij->", stress, body.strain(ramp[:, None] * motion, barycentric, elements)))
        for motion in (axis, normal, turn)
    ]
    # Where a plane holds the axis both halves pull alike and bend against each other; one across it lets no shear pass.
    pull, shear, moment = 2**halves * np.array(work)
    return Section(
        member=member,
        normal=float(pull),
        shear=0.0 if across or along else float(shear),
        moment=0.0 if across else -float(moment),
    )


def _cut(member: Member, domain: Domain) -> tuple[int, bool, bool]:
    """Return how many planes cut a member lengthwise, and whether one stands across it in the plane, or ends it."""
    axis, normal = profile.frame(member)
    planes = [np.eye(3)[plane.index] for plane in domain.planes if abs(member.centre[plane.index]) < 1e-12]
    along = any(abs(axis @ plane) > 0.5 for plane in planes)
    across = any(abs(normal @ plane) > 0.5 for plane in planes)
    return sum(abs(axis @ plane) <= 0.5 for plane in planes), across, along


def shares(
    cases: tuple[Sequence[Section], Sequence[Section]], total: float, material: Material, images: Mapping[str, int]
) -> dict[str, float]:
    """Split a compliance into what each kind of member and deformation accounts for, and the remainder.

    Parameters
    ----------
    cases
        Sections of the two load cases whose shared compliance is split, per unit load.
    total
        The compliance of the whole part [m/N].
    material
        Its elastic constants.
    images
        How many members of the whole part each listed member represents, by name.

    Returns
    -------
    dict
        ``"hinge bending"`` ... -> compliance [m/N], adding up to `total`.
    """
    split: dict[str, float] = {}
    for first, second in zip(*cases, strict=True):
        for deformation, value in first.shared_compliance(second, material).items():
            key = f"{first.member.kind} {deformation}"
            split[key] = split.get(key, 0.0) + images[first.member.name] * value
    split["roots, blocks and width"] = total - sum(split.values())
    return split

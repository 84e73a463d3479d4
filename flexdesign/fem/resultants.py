"""Section forces in hinges, arms and rods, integrated from the stresses, and the compliance each accounts for.

In a member with axis s and normal n, the finite element stresses give

    sigma_ss = N / A + M n / I + M' s n / I  by least squares over the member, M at its centre,    V = A <sigma_sn>

(a leaf may hold few elements, not evenly: a mean of sigma_ss alone would take bending for tension), and beam theory
the compliance that two load cases a, b share through it, M varying with slope V:

    c_ab = N_a N_b L / EA + V_a V_b L / (kappa G A) + (M_a M_b + V_a V_b L^2 / 12) L / EI,     kappa = 5/6.

What the members do not account for (the roots, where the leaf's stress spreads into its neighbours; the blocks; the
stiffening of a wide leaf that cannot contract sideways) is the remainder, and may be negative.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.fem.domain import Domain
from flexdesign.fem.elasticity import Elasticity, stress_points
from flexdesign.materials import Material
from flexdesign.model import Member

FloatArray = NDArray[np.float64]

#: Timoshenko's shear coefficient of a rectangle.
SHEAR_COEFFICIENT = 5 / 6
#: Middle part of a member over which stresses are averaged; its ends belong to the roots.
MIDDLE = 0.8


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
        length, area, inertia = self.member.length, self.member.area, self.member.second_moment
        young, shear = material.beam_moduli(self.member.axis)
        shear_area = SHEAR_COEFFICIENT * shear * area
        moments = self.moment * other.moment + self.shear * other.shear * length**2 / 12
        return {
            "axial": self.normal * other.normal * length / (young * area),
            "shear": self.shear * other.shear * length / shear_area,
            "bending": moments * length / (young * inertia),
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
        """Largest fibre stress of beam theory, at the more loaded end [Pa]."""
        end = abs(self.moment) + abs(self.shear) * self.member.length / 2
        return abs(self.normal) / self.member.area + end * self.member.thickness / 2 / self.member.second_moment


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
    barycentric, weights = stress_points()
    corners = body.mesh.points[body.mesh.tets]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    stress = body.stress(displacement, barycentric)
    places = np.einsum("qk,eki->eqi", barycentric, corners)
    return [_section(member, places, stress, volumes[:, None] * weights) for member in members if domain.keeps(member)]


def _section(member: Member, places: FloatArray, stress: FloatArray, weights: FloatArray) -> Section:
    axis = np.array(member.axis)
    normal = np.cross([0.0, 0.0, 1.0], axis)
    s, n = (places - member.centre) @ axis, (places - member.centre) @ normal
    inside = (np.abs(s) <= MIDDLE * member.length / 2) & (np.abs(n) <= member.thickness / 2 * (1 + 1e-6))
    w, s, n, sigma = weights[inside], s[inside], n[inside], stress[inside]
    along = np.einsum("i,pij,j->p", axis, sigma, axis)
    across = np.einsum("i,pij,j->p", axis, sigma, normal)
    height, length = n / member.thickness, s / member.length
    terms = np.column_stack([np.ones_like(n), height, height * length]) * np.sqrt(w)[:, None]
    (tension, bending, _), *_ = np.linalg.lstsq(terms, along * np.sqrt(w))
    return Section(
        member=member,
        normal=float(member.area * tension),
        shear=float(member.area * (w @ across) / w.sum()),
        moment=float(member.second_moment * bending / member.thickness),
    )


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
        How many members of the whole part each listed member stands for, by name.

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

"""Strain energy by region: hinges, arms, rods as the part declares its members, and the blocks that are left.

A member's region is the box of its length, its thickness where it is thickest, and its width; what lies in no box
belongs to the blocks. The energy density is integrated where it is known best, at the elements' stress points, so that
the regions add up to the whole energy, which is half of force times motion.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Member
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.solving.elasticity import Elasticity, stress_points

FloatArray = NDArray[np.float64]

#: The region of what belongs to no member.
BLOCKS = "block"
#: Elements whose strains are held in memory at once.
CHUNK = 20_000


def by_region(
    body: Elasticity, domain: Domain, first: FloatArray, second: FloatArray, members: Sequence[Member]
) -> dict[str, tuple[float, float, float]]:
    """Integrate the strain energy of two load cases over the regions of the whole part.

    Parameters
    ----------
    body, domain
        The discretised domain.
    first, second
        Nodal displacements of two load cases, shape (n, 3) [m], even in every symmetry plane.
    members
        Members of the whole part; those of one kind make one region.

    Returns
    -------
    dict
        Kind of member -> (U_11, U_12, U_22) [J]: under a times the first case and b times the second the region holds
        a^2 U_11 + 2 a b U_12 + b^2 U_22.
    """
    barycentric, weights = stress_points()
    corners = body.mesh.points[body.mesh.tets]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1])) / 6
    places = np.einsum("qk,eki->eqi", barycentric, corners)
    strains = [body.strain(field, barycentric) for field in (first, second)]
    stresses = [body.stress(field, barycentric) for field in (first, second)]
    share = domain.copies / 2 * volumes[:, None] * weights
    densities = [share * np.einsum("eqij,eqij->eq", stresses[a], strains[b]) for a, b in ((0, 0), (0, 1), (1, 1))]
    left = np.ones(places.shape[:2], dtype=bool)
    found: dict[str, tuple[float, float, float]] = {}
    for kind in dict.fromkeys(member.kind for member in members):
        inside = left & np.any([_within(member, places) for member in members if member.kind == kind], axis=0)
        left &= ~inside
        if inside.any():
            found[kind] = _sum(densities, inside)
    rest, blocks = _sum(densities, left), found.get(BLOCKS, (0.0, 0.0, 0.0))
    found[BLOCKS] = (rest[0] + blocks[0], rest[1] + blocks[1], rest[2] + blocks[2])
    return found


def between(body: Elasticity, fields: FloatArray, elements: NDArray[np.bool_]) -> FloatArray:
    """Return twice the strain energy that some elements hold, as a quadratic form of load cases.

    Parameters
    ----------
    body
        The discretised domain.
    fields
        Nodal displacements of k load cases, shape (n_dofs, k).
    elements
        Which elements, shape (m,).

    Returns
    -------
    ndarray
        Shape (k, k); under the sum of the cases times factors c the elements hold c^T E c / 2.
    """
    barycentric, weights = stress_points()
    chosen, total = np.flatnonzero(elements), np.zeros((fields.shape[1],) * 2)
    displacements = [field.reshape(-1, 3) for field in fields.T]
    for some in np.array_split(chosen, len(chosen) // CHUNK + 1):
        strains = np.array([body.strain(each, barycentric, some) for each in displacements])
        stresses = np.array([body.stress(each, barycentric, some) for each in displacements])
        scale = body.barycentric_gradients[1][some, None] * weights
        total += np.einsum("aeqij,beqij,eq->ab", stresses, strains, scale, optimize=True)
    return total


def largest_share(part: FloatArray, whole: FloatArray) -> float:
    """Return the largest share of the whole energy that a part holds under any mixture of load cases.

    Both are quadratic forms (k, k). Load cases that do next to nothing, as of another symmetry class, are left out.
    """
    scale = np.sqrt(np.maximum(np.diag(whole), 0.0))
    does = scale > 1e-6 * scale.max(initial=0.0)
    if not does.any():
        return 0.0
    part, whole = (form[np.ix_(does, does)] / np.outer(scale[does], scale[does]) for form in (part, whole))
    values, vectors = np.linalg.eigh((whole + whole.T) / 2)
    vectors = vectors[:, values > 1e-9] / np.sqrt(values[values > 1e-9])
    return float(np.clip(np.linalg.eigvalsh(vectors.T @ (part + part.T) / 2 @ vectors)[-1], 0.0, 1.0))


def _sum(densities: Sequence[FloatArray], inside: NDArray[np.bool_]) -> tuple[float, float, float]:
    one, mixed, two = (float(density[inside].sum()) for density in densities)
    return one, mixed, two


def _within(member: Member, places: FloatArray) -> NDArray[np.bool_]:
    """Tell which places (..., 3) lie in a member's box."""
    away, axis = places - np.array(member.centre), np.array(member.axis)
    s, n = away @ axis, away @ np.cross([0.0, 0.0, 1.0], axis)
    thickest = max(member.thickness, member.thickness_at(member.length / 2))
    flat = (np.abs(s) <= member.length / 2) & (np.abs(n) <= thickest / 2 * (1 + 1e-6))
    return np.asarray(flat & (np.abs(away[..., 2]) <= member.width / 2 * (1 + 1e-6)))

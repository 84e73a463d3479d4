"""The mesh gate: a mesh may be used only if every hinge on it is as thick as drawn, and every curved neck is resolved.

Volume is insensitive: a 0.5 mm neck thickened by 21 um changes the volume by 0.02 % and the stiffness by 13 %. So the
thickness itself is measured: lines across the leaf, on a grid over its length and width, from the facet they enter by
to the facet they leave by.

Flat leaves and curved necks are judged line by line. Where a leaf runs out into a fillet, facets straddle the line at
which the fillet begins and thicken the leaf there by some percent over a fraction of an element; such a leaf is judged
line by line in its middle half, and the whole hinge, fillets included, by its thickness in bending,

    t_b = (mean of t^-3 over the lines)^(-1/3).

A curved neck may be as thick as drawn and hold one element, which knows nothing of how stress concentrates there. So
the elements across it are counted, as its thickness over the elements' mean extent across it, by volume.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Member
from flexdesign.fem.meshing import profile
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh, signed_volumes

FloatArray = NDArray[np.float64]

#: Largest relative deviation of a hinge's thickness.
FLAT_LIMIT = 1e-3
CURVED_LIMIT = 5e-3
#: Elements across a curved neck, at least.
LEAST_ACROSS = 2.5


@dataclass(frozen=True)
class HingeCheck:
    """What the gate measured on one hinge.

    Parameters
    ----------
    hinge
        The hinge.
    deviation
        Largest relative deviation of thickness from the drawing, line by line.
    bending
        Relative deviation of the whole hinge's thickness in bending.
    limit
        The largest deviation allowed.
    across
        Elements across a curved neck; infinite for leaves, of which nothing is asked.
    share
        The largest share of the strain energy that the hinge holds under any load on the output.
    """

    hinge: Member
    deviation: float
    bending: float
    limit: float
    across: float = math.inf
    share: float = 1.0

    @property
    def passed(self) -> bool:
        """Whether the deviations are within their limits."""
        return self.deviation <= self.limit and abs(self.bending) <= CURVED_LIMIT  # false for NaN

    @property
    def weighed(self) -> float:
        """The larger deviation times the share: what a hinge that holds all of the strain energy would be off by."""
        return self.share * max(self.deviation, abs(self.bending))

    @property
    def stiffness_error(self) -> float:
        """How far the deviation may put stiffness off, relative: in bending it goes with the cube of the thickness."""
        return 3 * self.share * abs(self.bending)

    @property
    def resolved(self) -> bool:
        """Whether there are elements enough across a curved neck."""
        return self.across >= LEAST_ACROSS

    @property
    def across_text(self) -> str:
        """Elements across a curved neck, rounded down: a number that is refused is below its limit."""
        return f"{math.floor(100 * self.across) / 100:g}"


def check(mesh: TaggedMesh, domain: Domain, hinges: Sequence[Member]) -> list[HingeCheck]:
    """Measure every hinge that lies in the domain.

    Raises
    ------
    MeshError
        If one is off by more than its limit, missing, or not resolved; it names the hinge and what to change.
    """
    checks = [
        replace(_measure(_around(mesh, domain, hinge), hinge), across=elements_across(mesh, hinge))
        for hinge in hinges
        if domain.keeps(hinge)
    ]
    for found in checks:
        if math.isnan(found.deviation):
            raise MeshError(f"{found.hinge.name} is missing in the mesh; reduce mesh.envelope")
        if not found.passed:
            line = found.deviation > found.limit
            off, limit = (found.deviation, found.limit) if line else (found.bending, CURVED_LIMIT)
            raise MeshError(
                f"{found.hinge.name} is off its {found.hinge.thickness * 1e3:g} mm by {off * 100:.2g} % "
                f"{'' if line else 'in bending '}(limit {limit * 100:g} %); reduce mesh.envelope or mesh.at_root"
            )
        if not found.resolved:
            raise MeshError(
                f"{found.hinge.name} has {found.across_text} elements across its curved neck of "
                f"{found.hinge.thickness * 1e3:g} mm, {LEAST_ACROSS:g} at least are needed; reduce mesh.at_root"
            )
    return checks


def elements_across(mesh: TaggedMesh, hinge: Member) -> float:
    """Return how many elements lie across a curved neck, 0 if none lies there; infinite for a leaf.

    Counted are the elements that reach within a quarter of the thickness of where the hinge is as thin as at its neck.
    """
    if not profile.is_curved(hinge):
        return math.inf
    axis, normal = profile.frame(hinge)
    reach = profile.flat_half(hinge) + hinge.thickness / 4
    corners = mesh.points[mesh.tets] - np.array(hinge.centre)
    s, n = corners @ axis, corners @ normal
    crossing = (s.min(axis=1) <= reach) & (s.max(axis=1) >= -reach) & (np.abs(n).max(axis=1) <= hinge.thickness)
    chosen = crossing & (np.abs(corners[:, :, 2].mean(axis=1)) <= hinge.width / 2)
    if not chosen.any():
        return 0.0
    extent = np.ptp(n[chosen], axis=1)
    volume = np.abs(signed_volumes(mesh.points, mesh.tets[chosen]))
    return float(hinge.thickness * volume.sum() / (volume @ extent))


def _around(mesh: TaggedMesh, domain: Domain, hinge: Member) -> FloatArray:
    """Return the corners of the surface's facets (k, 3, 3), mirrored in the planes that cut the hinge in two."""
    cut = {face for faces in domain.plane_faces for face in faces}
    facets = mesh.points[mesh.facets[~np.isin(mesh.faces, sorted(cut))]]
    for plane in domain.planes:
        if abs(hinge.centre[plane.index]) < 1e-12:
            facets = np.concatenate([facets, facets * np.where(np.arange(3) == plane.index, -1.0, 1.0)])
    return facets


def _measure(surface: FloatArray, hinge: Member, along: int = 21, across: int = 7) -> HingeCheck:
    axis = np.array(hinge.axis)
    depth = np.array([0.0, 0.0, 1.0])
    normal = np.cross(depth, axis)
    frame = np.stack([axis, depth, normal])
    facets = (surface - np.array(hinge.centre)) @ frame.T  # (k, 3 corners, 3 components)
    near = np.all(np.abs(facets[:, :, 0]).min(axis=1, keepdims=True) <= hinge.length / 2, axis=1)
    near &= np.abs(facets[:, :, 2]).max(axis=1) <= 2 * hinge.thickness_at(hinge.length / 2)
    facets = facets[near]
    curved = profile.is_curved(hinge)
    reach = 0.49 * hinge.length
    if not curved and hinge.root_radius == 0:  # next to an oblique side a leaf has one surface only
        reach = max(hinge.length / 2 - hinge.thickness, hinge.length / 4)
    s = np.linspace(-reach, reach, along)
    low = facets[:, :, 1].min(initial=0.0)
    high = facets[:, :, 1].max(initial=0.0)
    z = low + (high - low) * (np.arange(across) + 0.5) / across
    grid = np.stack(np.meshgrid(s, z, indexing="ij"), axis=-1).reshape(-1, 2)
    measured = _thickness(facets, grid)
    nominal = np.array([hinge.thickness_at(value) for value in grid[:, 0]])
    filleted = hinge.root_radius > 0 and not curved
    middle = min(hinge.length / 4, hinge.length / 2 - 2 * hinge.root_radius) if filleted else math.inf
    central = np.abs(grid[:, 0]) <= max(middle, hinge.length / 20)
    return HingeCheck(
        hinge=hinge,
        deviation=float(np.abs(measured / nominal - 1)[central].max()),
        bending=float((np.mean(measured**-3.0) / np.mean(nominal**-3.0)) ** (-1 / 3) - 1),
        limit=CURVED_LIMIT if curved else FLAT_LIMIT,
    )


def _thickness(facets: FloatArray, grid: FloatArray) -> FloatArray:
    """Length inside the body of lines across the leaf at grid places (g, 2); NaN where a line misses it."""
    a, b, c = (facets[:, i, :] for i in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    steep = np.abs(area) > 1e-18
    a, b, c, area = a[steep], b[steep], c[steep], area[steep]
    result = np.full(len(grid), np.nan)
    for index, (s, z) in enumerate(grid):
        v = ((s - a[:, 0]) * (c[:, 1] - a[:, 1]) - (z - a[:, 1]) * (c[:, 0] - a[:, 0])) / area
        w = ((b[:, 0] - a[:, 0]) * (z - a[:, 1]) - (b[:, 1] - a[:, 1]) * (s - a[:, 0])) / area
        hit = (v >= -1e-9) & (w >= -1e-9) & (v + w <= 1 + 1e-9)
        heights = (a + v[:, None] * (b - a) + w[:, None] * (c - a))[hit, 2]
        if (heights > 0).any() and (heights < 0).any():
            result[index] = heights[heights > 0].min() - heights[heights < 0].max()
    return result

"""Tetrahedra of a domain that is an extrusion: a graded triangulation of its section, drawn out in layers.

The stress of a flexure is singular at the sharp roots of its hinges across them, and smooth along them. So the
triangles may shrink towards the roots a hundredfold while the layers stay as thick as a hinge is long: a root then
costs a few tetrahedra in each layer, where an isotropic mesh, which must be as fine along the root as across it, runs
out of memory long before. Every hinge is as thick as drawn, and nothing has to be moved onto the CAD faces afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh, boundary, signed_volumes
from flexdesign.fem.meshing.planar import PlanarError, Size, Triangulation, triangulate
from flexdesign.fem.meshing.section import Section
from flexdesign.fem.meshing.sizing import Sizing, count_pieces, divide_line

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Layers:
    """How thick the layers are.

    Parameters
    ----------
    at_ends
        At a free end of the extrusion [m], where a wide leaf's stress changes from plane strain to plane stress.
    growth
        Increase of the thickness per distance from a free end.
    largest
        Largest thickness [m].
    limits
        Where layers are to be no thicker than something: from where to where, and that thickness, shape (k, 3) [m].
    """

    at_ends: float
    growth: float
    largest: float
    limits: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))

    def heights(self, low: float, high: float, free: tuple[bool, bool], count: int | None = None) -> FloatArray:
        """Return where layers meet [m], from the low to the high end; `free` ends are none of symmetry.

        A `count` sets their number, with the same grading.
        """
        heights = low + divide_line(*self._wanted(low, high, free), count)
        heights[-1] = high
        return heights

    def count(self, low: float, high: float, free: tuple[bool, bool]) -> float:
        """Return how many layers of the wanted thickness there are between the ends, a broken number."""
        return float(count_pieces(*self._wanted(low, high, free))[-1])

    def _wanted(self, low: float, high: float, free: tuple[bool, bool]) -> tuple[FloatArray, FloatArray]:
        """Return distances from the low end and the thickness wanted there, both (n,) [m]."""
        s = np.linspace(0.0, high - low, 4001)
        wanted = np.full(len(s), self.largest)
        for is_free, away in zip(free, (s, s[::-1]), strict=True):
            if is_free:
                np.minimum(wanted, self.at_ends + self.growth * away, out=wanted)
        for start, end, thickness in self.limits:
            away = np.maximum(np.maximum(start - low - s, s + low - end), 0.0)
            np.minimum(wanted, thickness + self.growth * away, out=wanted)
        return s, wanted


def planar_size(section: Section, sizing: Sizing) -> Size:
    """Return the target edge length in a section, which is asked half-way between the ends."""
    middle = (section.low + section.high) / 2
    return lambda points: sizing(section.lifted(points, middle))


def triangulate_section(section: Section, sizing: Sizing, chord: float) -> Triangulation:
    """Triangulate a section.

    Parameters
    ----------
    section
        What to mesh.
    sizing
        The target edge length, asked half-way between the ends.
    chord
        Largest distance between a curved face and the mesh [m]; on the profile of a neck the sizing limits it.

    Raises
    ------
    MeshError
        If the section cannot be triangulated.
    """
    try:
        return triangulate(section.outline, planar_size(section, sizing), _chord_beside_necks(section, sizing, chord))
    except PlanarError as error:
        raise MeshError(f"{error}; change mesh.at_root, or take the method wild") from error


def _chord_beside_necks(section: Section, sizing: Sizing, chord: float) -> Size:
    middle = (section.low + section.high) / 2

    def allowed(points: FloatArray) -> FloatArray:
        return np.where(sizing.on_profile(section.lifted(points, middle)), np.inf, chord)

    return allowed


def extrude(section: Section, sizing: Sizing, layers: Layers, chord: float, free: tuple[bool, bool]) -> TaggedMesh:
    """Mesh a section as `triangulate_section` does, and extrude it in layers; `free` ends are none of symmetry."""
    plan = triangulate_section(section, sizing, chord)
    return stack_prisms(plan, section, layers.heights(section.low, section.high, free))


def stack_prisms(plan: Triangulation, section: Section, heights: FloatArray) -> TaggedMesh:
    """Stack prisms on the triangles and cut each into three tetrahedra.

    The side of two neighbouring prisms is cut from its lower corner of smaller number to its upper corner of larger
    number, as seen from both (Dompierre et al. 1999), so that the tetrahedra fit together.
    """
    count, layers = len(plan.points), len(heights) - 1
    points = np.concatenate([section.lifted(plan.points, height) for height in heights])
    a, b, c = np.sort(plan.triangles, axis=1).T
    prism = np.concatenate(
        [
            np.column_stack(corners)
            for corners in ((a, b, c, c + count), (a, b, b + count, c + count), (a, a + count, b + count, c + count))
        ]
    )
    tets = (prism + count * np.arange(layers)[:, None, None]).reshape(-1, 4)
    inverted = signed_volumes(points, tets) < 0
    tets[inverted] = tets[inverted][:, [0, 1, 3, 2]]
    facets = boundary(tets)
    return TaggedMesh(points, tets, facets, _owners(facets, plan, section, layers))


def _owners(facets: IntArray, plan: Triangulation, section: Section, layers: int) -> IntArray:
    """Return the CAD face of each facet: an end if its corners are of one height, else that of its outline's piece."""
    count = len(plan.points)
    height, place = np.divmod(facets, count)
    low, high = (height == 0).all(axis=1), (height == layers).all(axis=1)
    pieces = np.sort(plan.sides, axis=1) @ [count, 1]
    order = np.argsort(pieces)
    ends = np.column_stack([place.min(axis=1), place.max(axis=1)]) @ [count, 1]
    owners = plan.owners[order][np.searchsorted(pieces[order], ends).clip(max=len(pieces) - 1)]
    return np.asarray(np.select([low, high], section.ends, owners))

"""A section's triangles moved from one design to its neighbour: the same triangles, elsewhere.

Where two sections have the same corners in the same order, no new triangulation is needed. A vertex on the outline
keeps its place in the count of edges along its curve,

    u(s) = int_0^s ds / h  /  int_0^L ds / h,

with the edge length h that the new design wants, so that the grading follows the hinges' thickness. The others follow
by the displacement d that is discretely harmonic on the old triangles, the smaller ones stiffer (Stein, Tezduyar and
Benney 2003, whose exponent is the 1 below):

    sum over triangles of (grad v . grad d) A / A  =  0,   d given on the outline.

The map depends on the old and the new section alone, so that what is computed on it is a smooth function of the
dimensions: no triangle appears or vanishes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh, signed_volumes
from flexdesign.fem.meshing.planar import Size, Triangulation
from flexdesign.fem.meshing.section import Curve, Section
from flexdesign.fem.meshing.sizing import count_pieces

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Quality of the worst element that a morphed mesh may have, as a share of the worst before.
LEAST_QUALITY = 0.2
#: Places along a curve, as shares of its length, at which the edge length wanted is asked: dense at the ends, where the
#: roots are.
PLACES = (1 - np.cos(np.linspace(0.0, np.pi, 161))) / 2


@dataclass(frozen=True)
class Pattern:
    """The triangles of one design, ready to be moved.

    Parameters
    ----------
    section
        What was triangulated.
    size
        The edge length that was wanted [m] at points of shape (n, 2).
    plan
        Its triangles.
    """

    section: Section
    size: Size
    plan: Triangulation

    def morph(self, section: Section, size: Size) -> Triangulation:
        """Return the triangles in a neighbour's section, with the edge length wanted there.

        Raises
        ------
        MeshError
            If its corners are others, or triangles turn over or become much worse than they were.
        """
        if not have_same_topology(self.section, section):
            raise MeshError("the section has other corners than its neighbour's")
        points = self.plan.points.copy()
        counts = _counts(section, size)
        for curve, count, vertices, shares in zip(section.outline, counts, *self._on_curves, strict=True):
            arc = _arc(curve)
            arcs = np.interp(shares * count[-1], count, PLACES * arc[-1])
            points[vertices] = _on(curve, arc, arcs)
        fixed, free, solve, coupling = self._spring
        shift = points[fixed] - self.plan.points[fixed]
        points[free] = self.plan.points[free] - solve(coupling @ shift)
        plan = replace(self.plan, points=points)
        worst, before = plan.quality().min(), self.plan.quality().min()
        if not worst > LEAST_QUALITY * before:
            raise MeshError(f"morphed from a neighbour's, the section's worst triangle has a quality of {worst:.2g}")
        return plan

    @cached_property
    def _on_curves(self) -> tuple[list[IntArray], list[FloatArray]]:
        """Vertices on each curve, and their u there."""
        vertices, shares = [], []
        for curve, count in zip(self.section.outline, _counts(self.section, self.size), strict=True):
            there = np.unique(self.plan.sides[self.plan.owners == curve.face])
            arc = _arc(curve)
            along = _project(curve, arc, self.plan.points[there])
            vertices.append(there)
            shares.append(np.interp(along, PLACES * arc[-1], count / count[-1]))
        return vertices, shares

    @cached_property
    def _spring(self) -> tuple[IntArray, IntArray, Any, sp.csr_matrix]:
        """Vertices on the outline and the others, the solver for the others, and how they depend on the outline."""
        from scipy.sparse.linalg import splu

        fixed = np.unique(self.plan.sides)
        free = np.setdiff1d(np.arange(len(self.plan.points)), fixed)
        corners = self.plan.points[self.plan.triangles]
        across = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)  # gradients times 2 A, turned
        doubles = np.abs(across[:, 0, 0] * across[:, 1, 1] - across[:, 0, 1] * across[:, 1, 0])
        local = np.einsum("eai,ebi->eab", across, across) / doubles[:, None, None] ** 2
        rows = np.repeat(self.plan.triangles, 3, axis=1).ravel()
        columns = np.tile(self.plan.triangles, (1, 3)).ravel()
        matrix = sp.csr_matrix((local.ravel(), (rows, columns)), shape=(len(self.plan.points),) * 2)
        inner = matrix[free]
        return fixed, free, splu(inner[:, free].tocsc()).solve, inner[:, fixed]


def have_same_topology(one: Section, other: Section) -> bool:
    """Tell whether two sections have the same corners in the same order, joined by curves of the same kind."""
    if len(one.outline) != len(other.outline) or (one.axis, one.ends) != (other.axis, other.ends):
        return False
    pairs = list(zip(one.outline, other.outline, strict=True))
    if any(a.face != b.face or (len(a.points) > 2) != (len(b.points) > 2) for a, b in pairs):
        return False
    return bool(np.array_equal(_joints(one), _joints(other)))


def morph(mesh: TaggedMesh, plan: Triangulation, section: Section, heights: FloatArray) -> TaggedMesh:
    """Return an extruded mesh with its vertices where a moved plan and layers, as many as it has, put them.

    Raises
    ------
    MeshError
        If tetrahedra turn over or become much worse than they were.
    """
    points = np.concatenate([section.lifted(plan.points, height) for height in heights])
    found = replace(mesh, points=points)
    turned = int((signed_volumes(points, mesh.tets) <= 0).sum())
    if turned:
        raise MeshError(f"{turned} tetrahedra turn over where the mesh is morphed from a neighbour's")
    worst = found.quality().min()
    if not worst > LEAST_QUALITY * mesh.quality().min():
        raise MeshError(f"morphed from a neighbour's, the worst tetrahedron has a quality of {worst:.2g}")
    return found


def _joints(section: Section) -> IntArray:
    """Return a number for each curve's two ends, the same where curves meet, in order of first appearance."""
    ends = np.concatenate([curve.points[[0, -1]] for curve in section.outline])
    _, first, number = np.unique(np.round(ends / 1e-9), axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[number.reshape(-1)])


def _arc(curve: Curve) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve.points, axis=0), axis=1))])


def _counts(section: Section, size: Size) -> list[FloatArray]:
    """Return how many edges as long as wanted fit on each curve before each of `PLACES`."""
    arcs = [_arc(curve) for curve in section.outline]
    places = [_on(curve, arc, PLACES * arc[-1]) for curve, arc in zip(section.outline, arcs, strict=True)]
    wanted = np.split(size(np.concatenate(places)), len(places))
    return [count_pieces(PLACES * arc[-1], there) for arc, there in zip(arcs, wanted, strict=True)]


def _on(curve: Curve, arc: FloatArray, s: FloatArray) -> FloatArray:
    """Return the places at arc lengths s [m], shape (n, 2) [m]."""
    return np.column_stack([np.interp(s, arc, curve.points[:, i]) for i in (0, 1)])


def _project(curve: Curve, arc: FloatArray, places: FloatArray) -> FloatArray:
    """Return the arc lengths [m] of places on a curve."""
    starts, ways = curve.points[:-1], np.diff(curve.points, axis=0)
    share = np.einsum("nki,ki->nk", places[:, None] - starts, ways) / (ways**2).sum(axis=1)
    share = share.clip(0.0, 1.0)
    gaps = np.linalg.norm(starts + share[:, :, None] * ways - places[:, None], axis=2)
    nearest = gaps.argmin(axis=1)
    return arc[nearest] + share[np.arange(len(places)), nearest] * np.diff(arc)[nearest]

"""Re-entrant edges of a solid, sharp or rounded by a fillet: found on its triangles, and measured on meshes.

A fillet that is small against the thickness next to it makes stiffness no other than a sharp edge does, and the mesh
must be as fine there. Its stress has a peak, which a mesh shows if its edges follow the fillet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flexdesign.design.part import SymmetryPlane
from flexdesign.fem.meshing.surface import Surface, triangle_areas

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: An edge between faces is re-entrant where they meet at more than this angle.
REENTRANT = np.radians(20.0)
#: A hollow face is a fillet up to this radius, in thicknesses next to it: larger ones are the profiles of necks.
LARGEST = 0.5
#: Fillets are sought next to what is thinner than the thickest hinge times this.
OF_HINGE = 1.5
#: Places along an edge: their distance in thicknesses next to it, and their largest number.
APART, MOST = 0.5, 200


@dataclass(frozen=True)
class ReentrantEdges:
    """Places along re-entrant edges.

    Parameters
    ----------
    places
        Shape (k, 3) [m].
    thickness
        Of the thin region next to each, shape (k,) [m].
    radii
        Of the fillet, 0 at a sharp edge, shape (k,) [m].
    ways
        Unit vectors along the edge, shape (k, 3).
    """

    places: FloatArray
    thickness: FloatArray
    radii: FloatArray
    ways: FloatArray

    def sizes(self, sharp: float, least: float, across: float) -> FloatArray:
        """Return the edge lengths wanted at the places, shape (k,) [m].

        Parameters
        ----------
        sharp
            At sharp edges, in thicknesses.
        least
            The smallest radius that is to be resolved, in thicknesses: smaller fillets are meshed as sharp edges.
        across
            Across fillets, in radii.
        """
        shares = np.where(self.radii < least * self.thickness, sharp * self.thickness, across * self.radii)
        return np.asarray(shares)

    def next_to(self, middles: FloatArray, thickness: FloatArray) -> ReentrantEdges:
        """Return those that lie next to places half-way across thin regions, shape (n, 3) [m], of a thickness (n,)."""
        if not len(self.places):
            return self
        away, nearest = cKDTree(middles).query(self.places)
        near = away < 0.75 * thickness[nearest] + self.radii
        return ReentrantEdges(self.places[near], self.thickness[near], self.radii[near], self.ways[near])

    def inside(self, planes: Sequence[SymmetryPlane]) -> ReentrantEdges:
        """Return those in the domain that planes of symmetry leave, on its positive side of each."""
        kept = np.all([self.places[:, plane.index] > 0 for plane in planes], axis=0) if planes else slice(None)
        return ReentrantEdges(self.places[kept], self.thickness[kept], self.radii[kept], self.ways[kept])

    @property
    def is_sharp(self) -> bool:
        """Whether one of them is."""
        return bool(np.any(self.radii == 0))

    def unresolved(self, points: FloatArray, facets: IntArray) -> tuple[float, float] | None:
        """Return radius and edge length across it [m] of the fillet that a mesh's facets follow worst.

        None if no edge is longer than the radius: a quarter circle then has two at least.
        """
        fillets = np.flatnonzero(self.radii > 0)
        if not len(fillets):
            return None
        corners = points[facets]
        _, nearest = cKDTree(corners.mean(axis=1)).query(self.places[fillets])
        sides = corners[nearest] - np.roll(corners[nearest], 1, axis=1)
        ways = self.ways[fillets, None, :]
        sides = sides - (sides * ways).sum(axis=2, keepdims=True) * ways
        across = np.linalg.norm(sides, axis=2).max(axis=1)
        worst = int(np.argmax(across / self.radii[fillets]))
        radius = float(self.radii[fillets[worst]])
        return (radius, float(across[worst])) if across[worst] > radius else None


def find(surface: Surface, places: FloatArray, thickness: FloatArray, thickest: float) -> ReentrantEdges:
    """Find them on a surface.

    Parameters
    ----------
    surface
        Of the solid.
    places, thickness
        Where the solid's thickness is known, shapes (n, 3) and (n,) [m].
    thickest
        Thickness of the thickest hinge [m], which limits the radius of fillets.
    """
    edges, radii = _hollow(surface, LARGEST * thickest)
    ends = surface.points[edges].reshape(-1, 2, 3)
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    tree = cKDTree(places)
    reach = tree.query_ball_point(ends.mean(axis=1), r=length / 2 + 1e-3 * surface.size)
    least = np.array([thickness[near].min() if near else d for near, d in zip(reach, length, strict=True)])
    count = np.clip(np.ceil(length / (APART * least)), 1, MOST).astype(np.int64)
    owner = np.repeat(np.arange(len(edges)), count)
    order = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    line = ends[owner, 0] + ((order + 0.5) / count[owner])[:, None] * along[owner]
    thin = thickness < OF_HINGE * thickest
    beside, nearest = thickness_beside(line, tree, thickness)
    at_sharp = np.where(np.isfinite(beside), beside, nearest)
    at_fillets, _ = thickness_beside(line, cKDTree(places[thin]), thickness[thin])
    at = np.where(radii[owner] > 0, at_fillets, at_sharp)
    kept = np.isfinite(at) & (radii[owner] <= LARGEST * at)
    return ReentrantEdges(line[kept], at[kept], radii[owner][kept], (along / length[:, None])[owner][kept])


def thickness_beside(line: FloatArray, tree: Any, thickness: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the least thickness of what is no farther away than 1.5 times that, else infinite; and of the nearest."""
    if not len(line):
        return np.zeros(0), np.zeros(0)
    away, nearest = tree.query(line, k=range(1, min(12, len(thickness)) + 1))
    beside = np.where(away < 1.5 * thickness[nearest], thickness[nearest], np.inf).min(axis=1)
    return beside, thickness[nearest[:, 0]]


def _hollow(surface: Surface, largest: float) -> tuple[IntArray, FloatArray]:
    """Return the edges of triangles (k, 2) at which a surface turns inwards, and the radius with which it does (k,).

    Sharp edges between faces have none; on one face, triangles of heights a and b that meet at an angle follow a
    cylinder whose radius is (a + b) / 2 over the angle; of a free-form face, as where fillets meet, that scatters, and
    the median over the face counts. Larger radii are left out.
    """
    edges, faces, pairs = pairs_at_edges(surface)
    outward, corners = surface.outward, surface.corners
    one, other = outward[pairs[:, 0]], outward[pairs[:, 1]]
    bend = np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), np.einsum("ij,ij->i", one, other))
    towards = corners[pairs[:, 1]].mean(axis=1) - surface.points[edges[:, 0]]
    concave = np.einsum("ij,ij->i", one, towards) > 0
    apart = faces[:, 0] != faces[:, 1]
    length = np.linalg.norm(surface.points[edges[:, 1]] - surface.points[edges[:, 0]], axis=1)
    radius = 2 * triangle_areas(corners)[pairs].mean(axis=1) / length / np.maximum(bend, 1e-9)
    radii = np.where(apart, 0.0, radius)
    chosen = concave & np.where(apart, bend > REENTRANT, radius <= largest)
    for face in np.unique(faces[chosen & ~apart]):
        on = chosen & ~apart & (faces[:, 0] == face)
        radii[on] = np.median(radii[on])
    return edges[chosen], radii[chosen]


def pairs_at_edges(surface: Surface) -> tuple[IntArray, IntArray, IntArray]:
    """Return edges between two triangles (k, 2), the faces these lie on (k, 2), and the triangles (k, 2)."""
    edges = np.sort(surface.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    triangle = np.repeat(np.arange(len(surface.triangles)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, triangle = edges[order], triangle[order]
    same = np.flatnonzero(np.all(edges[1:] == edges[:-1], axis=1))
    pairs = np.column_stack([triangle[same], triangle[same + 1]])
    return edges[same], surface.owners[pairs], pairs

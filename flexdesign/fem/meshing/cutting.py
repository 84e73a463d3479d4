"""Bores cut out of a mesh: elements that the surface of a bore crosses are divided there, those within are dropped.

Edges are split where they cross the surface, the longest first, and with an edge every tetrahedron around it, so that
the tetrahedra fit together throughout (bisection, Rivara 1984). The new surface has chords in place of arcs, as long as
the elements there; all that lies elsewhere stays as it was.
"""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexdesign.fem.meshing.crossing import Crossings
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import TET_FACES, MeshError, TaggedMesh, boundary, nearest_faces

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
#: A vertex that is nearer to the surface than this share of an edge counts as on it, lest slivers arise.
NEAR = 0.1
#: Halvings by which the place is found where an edge crosses the surface: to a few thousandths of the edge.
HALVINGS = 8
#: Largest share of the solid's volume by which what is cut out may be off, on the finest mesh; chords err by the square
#: of the edge length.
OFF = 1e-3


def cut(mesh: TaggedMesh, domain: Domain, crossings: Crossings, coarseness: float = 1.0) -> TaggedMesh:
    """Return a mesh of the domain, made of one of the domain without its crossings; facets are tagged anew.

    Parameters
    ----------
    mesh, domain, crossings
        What to cut, and what out of it.
    coarseness
        Edge length over that of the finest mesh.

    Raises
    ------
    MeshError
        If the elements are too large to follow what is to be cut out.
    """
    gap = _Gap(domain, crossings)
    made = _cut(mesh, gap)
    is_cut = np.isin(made.faces, crossings.faces)
    a, b, c = np.moveaxis(made.points[made.facets[is_cut]], 1, 0)
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    if area:  # chords make bores too small: their surface is cut farther out by what that lacks on average
        farther = (made.volume - domain.volume) / area
        made = _cut(mesh, gap.wider(farther))
    if abs(made.volume / domain.volume - 1) > OFF * coarseness**2:
        raise MeshError("the layers are too coarse for bores across them; reduce mesh.at_root, or take the method wild")
    return made


def _cut(mesh: TaggedMesh, gap: _Gap) -> TaggedMesh:
    away = np.full(len(mesh.points), gap.size)
    some = np.unique(mesh.tets[gap.may_meet(mesh.points[mesh.tets])])
    away[some] = gap.distance(mesh.points[some])
    points, near = _drawn_onto(mesh, away, gap)
    away[near] = 0.0
    points, tets, away = _divide(points, mesh.tets, away, gap)
    skin = boundary(tets)
    ends = away[tets]
    kept = np.asarray((ends > 0).any(axis=1))
    undecided = np.flatnonzero((ends == 0).all(axis=1))
    kept[undecided] = gap.distance(points[tets[undecided]].mean(axis=1)) > 0
    tets = _largest_piece(tets[kept])
    used, tets = np.unique(tets, return_inverse=True)
    points, tets = points[used], tets.reshape(-1, 4)
    facets = boundary(tets)
    before = {tuple(corners) for corners in np.sort(skin, axis=1).tolist()}
    is_new = np.array([tuple(corners) not in before for corners in np.sort(used[facets], axis=1).tolist()])
    faces = gap.faces(points[facets], is_new)
    return replace(mesh, points=points, tets=tets, facets=facets, faces=faces)


class _Gap:
    """What is missing in the domain, and how far from its surface places around it are."""

    def __init__(self, domain: Domain, crossings: Crossings) -> None:
        import pyvista as pv
        from vtkmodules.vtkFiltersCore import vtkImplicitPolyDataDistance

        points, triangles, owners = domain.surface()
        left = np.isin(owners, crossings.faces)
        #: The faces that the gap has left in the solid, and the others, each as `Domain.surface` gives them.
        self._surfaces = tuple((points, triangles[some], owners[some]) for some in (left, ~left))
        self._inner = pv.PolyData.from_regular_faces(points, triangles[left])
        self._pieces = []
        for piece in np.unique(crossings.pieces):
            triangles = crossings.triangles[crossings.pieces == piece]
            closed = pv.PolyData.from_regular_faces(crossings.points, triangles).clean()
            signed = vtkImplicitPolyDataDistance()
            signed.SetInput(closed)
            self._pieces.append((np.reshape(closed.bounds, (3, 2)).T, signed))
        self._farther = 0.0
        self.size = float(np.linalg.norm(np.ptp(points, axis=0)))

    def wider(self, length: float) -> _Gap:
        """Return the gap with its surface farther out by a length [m]."""
        made = copy.copy(self)
        made._farther = length
        return made

    def faces(self, corners: FloatArray, is_new: BoolArray) -> IntArray:
        """Return the CAD face that each facet (k, 3, 3) lies on: one of those the gap has left if the facet is new."""
        faces = np.empty(len(corners), dtype=np.int64)
        for chosen, surface in zip((is_new, ~is_new), self._surfaces, strict=True):
            faces[chosen] = nearest_faces(corners[chosen], surface)
        return faces

    def may_meet(self, corners: FloatArray) -> BoolArray:
        """Tell which tetrahedra (m, 4, 3) reach into a box around what is missing."""
        low, high = corners.min(axis=1), corners.max(axis=1)
        wider = max(self._farther, 0.0) + 1e-9 * self.size
        meet = [np.all((high >= box[0] - wider) & (low <= box[1] + wider), axis=1) for box, _ in self._pieces]
        return np.asarray(np.any(meet, axis=0))

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (n, 3) from the faces the gap has left in the solid [m], negative within it.

        Where the gap opens through another face of the solid, that face is none of its surface.
        """
        if not len(points):
            return np.zeros(0)
        _, nearest = self._inner.find_closest_cell(points, return_closest_point=True)
        away = np.linalg.norm(points - nearest, axis=1)
        return np.where(self._within(points), -away, away) - self._farther

    def _within(self, points: FloatArray) -> BoolArray:
        """Tell which points lie in what is missing, or on its surface."""
        from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkDoubleArray

        near, within = 1e-9 * self.size, np.zeros(len(points), dtype=bool)
        for (low, high), signed in self._pieces:
            some = np.flatnonzero(np.all((points >= low - near) & (points <= high + near), axis=1))
            if len(some):
                found = vtkDoubleArray()
                signed.FunctionValue(numpy_to_vtk(points[some]), found)
                within[some] |= vtk_to_numpy(found) <= near
        return within


def _drawn_onto(mesh: TaggedMesh, away: FloatArray, gap: _Gap) -> tuple[FloatArray, IntArray]:
    """Return the vertices, of which those nearly on the surface are drawn onto it, and the indices of the latter.

    They lie off it by a small share of an edge that crosses it, and are moved along that. One on the skin of the mesh
    stays there: it moves along an edge on the same faces, if one crosses the surface so near.
    """
    edges = np.unique(np.sort(mesh.tets[:, EDGES].reshape(-1, 2), axis=1), axis=0)
    edges = edges[away[edges].prod(axis=1) < 0]
    share = _shares(mesh.points, edges, away, gap)
    places = (1 - share[:, None]) * mesh.points[edges[:, 0]] + share[:, None] * mesh.points[edges[:, 1]]
    starts, ends = np.concatenate([edges, edges[:, ::-1]]).T
    share, places = np.concatenate([share, 1 - share]), np.vstack([places, places])
    close = np.flatnonzero(share < NEAR)
    near = np.unique(starts[close])
    on_skin = np.zeros((len(mesh.points), mesh.faces.max() + 1), dtype=bool)
    on_skin[mesh.facets, mesh.faces[:, None]] = True
    free = close[~(on_skin[starts[close]] & ~on_skin[ends[close]]).any(axis=1)]
    free = free[np.argsort(-share[free], kind="stable")]  # of several moves the least, which is written last
    points = mesh.points.copy()
    points[starts[free]] = places[free]
    return points, near


def _shares(points: FloatArray, edges: IntArray, away: FloatArray, gap: _Gap) -> FloatArray:
    """Return how far along each edge (k, 2) it crosses the surface, in its lengths, shape (k,)."""
    start, way = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    low, high = np.zeros(len(edges)), np.ones(len(edges))
    within = away[edges[:, 0]] < 0
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        same = (gap.distance(start + middle[:, None] * way) < 0) == within
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return (low + high) / 2


def _divide(points: FloatArray, tets: IntArray, away: FloatArray, gap: _Gap) -> tuple[FloatArray, IntArray, FloatArray]:
    """Split edges that cross the surface, until none does; return vertices, tetrahedra and distances."""
    while True:
        pairs = np.sort(tets[:, EDGES], axis=2)
        crossing = away[pairs].prod(axis=2) < 0
        if not crossing.any():
            return points, tets, away
        edges, which = np.unique(pairs[crossing], axis=0, return_inverse=True)
        length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        order = np.lexsort((edges[:, 1], edges[:, 0], -length))  # the same in every tetrahedron
        edges, none = edges[order], len(edges)
        number = np.full(crossing.shape, none)
        number[crossing] = np.argsort(order)[which.reshape(-1)]
        first = number.min(axis=1)
        around = np.bincount(number[crossing])
        agreed = np.flatnonzero(np.bincount(first[first < none], minlength=none) == around)
        share = _shares(points, edges[agreed], away, gap)[:, None]
        middles = (1 - share) * points[edges[agreed, 0]] + share * points[edges[agreed, 1]]
        split = np.flatnonzero(np.isin(first, agreed))
        ends = edges[first[split]]
        new = len(points) + np.searchsorted(agreed, first[split])
        halves = [np.where(tets[split] == ends[:, [side]], new[:, None], tets[split]) for side in (0, 1)]
        tets = np.vstack([np.delete(tets, split, axis=0), *halves])
        points, away = np.vstack([points, middles]), np.concatenate([away, np.zeros(len(agreed))])


def _largest_piece(tets: IntArray) -> IntArray:
    """Return the largest set of tetrahedra that are connected by facets: nothing would hold the others."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    facets = np.sort(tets[:, TET_FACES].reshape(-1, 3), axis=1)
    owner = np.repeat(np.arange(len(tets)), 4)
    order = np.lexsort(facets.T)
    same = np.flatnonzero(np.all(facets[order[1:]] == facets[order[:-1]], axis=1))
    one, other = owner[order[same]], owner[order[same + 1]]
    graph = coo_matrix((np.ones(len(one)), (one, other)), shape=(len(tets), len(tets)))
    _, piece = connected_components(graph, directed=False)
    return tets[piece == np.bincount(piece).argmax()]

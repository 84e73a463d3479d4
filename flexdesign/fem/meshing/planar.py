"""Graded triangulation of a plane section: edges as short as a sizing function asks for, vertices on the outline.

Delaunay refinement: the outline is cut into pieces as long as wanted there, which enclose the area of its curves; then
circumcentres of triangles that are too large or too thin become vertices (Chew 1993), many in a round, until none is
left; a few rounds of centroidal patch smoothing (Chen and Holst 2011) even the triangles out. Pieces of the outline
that the Delaunay triangulation leaves out are halved until it has them, so that no edge has to be forced.

The same input gives the same triangles, so that meshes can be compared and results kept. The libraries for this would
not do: Triangle and what wraps it are not free for every use, gmsh is under the GPL, and Netgen brings a second copy of
the CAD kernel into the process.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from flexdesign.fem.meshing.section import Curve, encloses
from flexdesign.fem.meshing.sizing import divide_line

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Size = Callable[[FloatArray], FloatArray]

#: Circumradius, in edge lengths wanted, above which a triangle is split; 0.577 is that of an equilateral one.
LARGEST = 0.8
#: Circumradius over shortest edge above which a triangle is too thin: 30 degrees are 1, 24 degrees 1.23.
THINNEST = 1.2
ROUNDS = 60
SMOOTHINGS = 6


class PlanarError(Exception):
    """An outline that could not be triangulated."""


@dataclass(frozen=True)
class Triangulation:
    """Triangles of a section.

    Parameters
    ----------
    points
        Vertices, shape (n, 2) [m].
    triangles
        Corners, counter-clockwise, shape (m, 3).
    sides, owners
        Vertices of the pieces of the outline, shape (k, 2), and the CAD face that each lies on, shape (k,).
    """

    points: FloatArray
    triangles: IntArray
    sides: IntArray
    owners: IntArray

    @property
    def area(self) -> float:
        """Area [m^2]."""
        return float(_areas(self.points, self.triangles).sum())

    def quality(self) -> FloatArray:
        """Return four times the root of three times area over the sum of squared edges: 1 for equilateral, (m,)."""
        corners = self.points[self.triangles]
        squares = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
        return np.asarray(4 * np.sqrt(3) * _areas(self.points, self.triangles) / squares)


def triangulate(outline: Sequence[Curve], size: Size, chord: float | Size) -> Triangulation:
    """Triangulate what an outline encloses.

    Parameters
    ----------
    outline
        Its curves; they close to one or several loops.
    size
        The edge length wanted [m] at points of shape (n, 2).
    chord
        Largest distance between a curved edge and the pieces it is cut into [m], or a function of points of shape
        (n, 2).

    Raises
    ------
    PlanarError
        If the curves do not close, or the refinement finds no end or leaves a gap.
    """
    boundary = _Boundary(outline, size, chord)
    inner = np.empty((0, 2))
    for _ in range(ROUNDS):
        points, triangles = _interior(boundary, inner)
        missing = boundary.missing(triangles)
        if missing.any():
            boundary.halve(missing)
            continue
        centres = _circumcentres(points, triangles, boundary, size)
        if not len(centres):
            break
        inner = np.vstack([inner, centres])
    else:
        raise PlanarError("the triangulation of the section finds no end")
    return _smooth(boundary, inner, size)


class _Boundary:
    """The outline, cut into pieces."""

    def __init__(self, outline: Sequence[Curve], size: Size, chord: float | Size) -> None:
        self._outline = outline
        self._arcs = [
            np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(c.points, axis=0), axis=1))]) for c in outline
        ]
        self._cuts = [_cuts(curve.points, arc, size, chord) for curve, arc in zip(outline, self._arcs, strict=True)]
        self._number()

    def _number(self) -> None:
        """Give each vertex a number, the same to curves that meet there."""
        places, pieces, owners = [], [], []
        first = 0
        for curve, arc, cuts in zip(self._outline, self._arcs, self._cuts, strict=True):
            places.append(_vertices(curve.points, arc, cuts))
            numbers = first + np.arange(len(cuts))
            pieces.append(np.column_stack([numbers[:-1], numbers[1:]]))
            owners.append(np.full(len(cuts) - 1, curve.face))
            first += len(cuts)
        stacked = np.vstack(places)
        _, keep, number = np.unique(np.round(stacked / 1e-9), axis=0, return_index=True, return_inverse=True)
        self.points = stacked[keep]
        self.sides = number.reshape(-1)[np.vstack(pieces)]
        self.owners = np.concatenate(owners)
        if np.any(np.bincount(self.sides.ravel(), minlength=len(keep)) != 2):
            raise PlanarError("the outline of the section is not closed")

    def missing(self, triangles: IntArray) -> NDArray[np.bool_]:
        """Tell which pieces are not the side of exactly one triangle."""
        return np.asarray(np.isin(_keys(self.sides), _single(triangles), invert=True))

    def fits(self, triangles: IntArray) -> bool:
        """Tell whether the outline's pieces, and they alone, are sides of one triangle."""
        return not self.missing(triangles).any() and len(_single(triangles)) == len(self.sides)

    def halve(self, chosen: NDArray[np.bool_]) -> None:
        """Cut the chosen pieces in two."""
        ends = np.cumsum([len(cuts) - 1 for cuts in self._cuts])[:-1]
        for index, marked in enumerate(np.split(chosen, ends)):
            cuts = self._cuts[index]
            self._cuts[index] = np.sort(np.concatenate([cuts, ((cuts[:-1] + cuts[1:]) / 2)[marked]]))
        self._number()

    def encloses(self, places: FloatArray) -> NDArray[np.bool_]:
        """Tell which places lie inside."""
        return encloses(self.points[self.sides], places)

    def clear(self, places: FloatArray) -> NDArray[np.bool_]:
        """Tell which places lie outside the circles that have a piece as diameter."""
        ends = self.points[self.sides]
        middle, radius = ends.mean(axis=1), np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2
        nearest = np.linalg.norm(places[:, None] - middle, axis=2)
        return np.asarray((nearest > radius).all(axis=1))


def _cuts(points: FloatArray, arc: FloatArray, size: Size, chord: float | Size) -> FloatArray:
    """Return the arc lengths at which a curve is cut, so that each piece is about as long as wanted there."""
    s = np.linspace(0.0, arc[-1], 2001)
    places = np.column_stack([np.interp(s, arc, points[:, i]) for i in (0, 1)])
    wanted = size(places)
    if len(points) > 2:
        turning = np.abs(np.diff(np.unwrap(np.arctan2(*np.diff(points, axis=0).T[::-1])))).max()
        radius = arc[-1] / (len(points) - 1) / max(turning, 1e-12)  # smallest on the curve
        allowed = chord(places) if callable(chord) else chord
        wanted = np.minimum(wanted, np.sqrt(8 * radius * allowed))
    return divide_line(s, wanted)


def _vertices(points: FloatArray, arc: FloatArray, cuts: FloatArray) -> FloatArray:
    """Return the vertices of a curve that is cut at arc lengths, so that the pieces enclose the curve's area.

    Chords lie on the hollow side of a curve: with all vertices on it, the metal at a notch is too thick by two thirds
    of the chord error on average. Each inner vertex is moved along the normal, by which it takes half of the area
    between curve and chord on either side of it, and all of that next to an end. The mean thickness of a neck is then
    off by the chord error to second order instead of the first.
    """
    places = np.column_stack([np.interp(cuts, arc, points[:, i]) for i in (0, 1)])
    if len(points) < 3 or len(cuts) < 3:
        return places
    swept = np.concatenate([[0.0], np.cumsum(_cross(points[:-1], points[1:]) / 2)])
    missing = np.diff(np.interp(cuts, arc, swept)) - _cross(places[:-1], places[1:]) / 2
    missing[1:-1] /= 2
    across = places[2:] - places[:-2]
    normal = np.column_stack([across[:, 1], -across[:, 0]]) / (across**2).sum(axis=1, keepdims=True)
    places[1:-1] += 2 * (missing[:-1] + missing[1:])[:, None] * normal
    return places


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])


def _interior(boundary: _Boundary, inner: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the vertices and the Delaunay triangles that lie inside."""
    points = np.vstack([boundary.points, inner])
    triangles = Delaunay(points).simplices.astype(np.int64)
    areas = _areas(points, triangles)
    triangles[areas < 0] = triangles[areas < 0][:, [0, 2, 1]]
    corners = points[triangles]
    squares = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
    proper = np.abs(areas) > 1e-7 * squares  # three vertices on one line of the outline make none
    triangles = triangles[proper]
    return points, triangles[boundary.encloses(points[triangles].mean(axis=1))]


def _circumcentres(points: FloatArray, triangles: IntArray, boundary: _Boundary, size: Size) -> FloatArray:
    """Return circumcentres of triangles that are too large or too thin, none too close to another or the outline."""
    centres, radius = _circles(points, triangles)
    shortest = np.linalg.norm(points[triangles] - np.roll(points[triangles], 1, axis=1), axis=2).min(axis=1)
    wanted = size(points[triangles].mean(axis=1))
    excess = np.maximum(radius / (LARGEST * wanted), radius / (THINNEST * shortest))
    bad = np.flatnonzero((excess > 1) & (radius > 0.5 * wanted))
    bad = bad[boundary.encloses(centres[bad])]
    bad = bad[boundary.clear(centres[bad])]
    bad = bad[np.argsort(-excess[bad], kind="stable")]
    places, reach = centres[bad], radius[bad]
    near = cKDTree(places).query_ball_point(places, 0.9 * reach) if len(places) else []
    is_used = np.zeros(len(bad), dtype=bool)
    for index, neighbours in enumerate(near):
        is_used[index] = not is_used[neighbours].any()
    return np.asarray(places[is_used])


def _smooth(boundary: _Boundary, inner: FloatArray, size: Size) -> Triangulation:
    """Move inner vertices to the middle of the triangles around them, each counted as often as it should be split."""
    first = len(boundary.points)
    points, triangles = _interior(boundary, inner)
    if not boundary.fits(triangles):
        raise PlanarError("the triangulation of the section has gaps")
    best = Triangulation(points, triangles, boundary.sides, boundary.owners)
    for _ in range(SMOOTHINGS):
        middles = points[triangles].mean(axis=1)
        weights = np.abs(_areas(points, triangles)) / size(middles) ** 4
        total = np.bincount(triangles.ravel(), np.repeat(weights, 3), minlength=len(points))
        smoothed = [
            np.bincount(triangles.ravel(), np.repeat(weights * middles[:, i], 3), minlength=len(points)) / total
            for i in (0, 1)
        ]
        points, triangles = _interior(boundary, np.column_stack(smoothed)[first:])
        found = Triangulation(points, triangles, boundary.sides, boundary.owners)
        if not boundary.fits(triangles):
            break
        best = found
    return best


def _circles(points: FloatArray, triangles: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return circumcentres and circumradii."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    u, v = b - a, c - a
    double = 2 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
    uu, vv = (u**2).sum(axis=1), (v**2).sum(axis=1)
    offset = np.column_stack([v[:, 1] * uu - u[:, 1] * vv, u[:, 0] * vv - v[:, 0] * uu]) / double[:, None]
    return a + offset, np.linalg.norm(offset, axis=1)


def _areas(points: FloatArray, triangles: IntArray) -> FloatArray:
    u, v = (points[triangles[:, i]] - points[triangles[:, 0]] for i in (1, 2))
    return np.asarray((u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2)


def _keys(sides: IntArray) -> IntArray:
    """Return one number for each pair of vertices, whichever comes first."""
    ordered = np.sort(sides, axis=1)
    return np.asarray(ordered[:, 0] * np.int64(2**31) + ordered[:, 1])


def _single(triangles: IntArray) -> IntArray:
    """Return the keys of the sides that belong to one triangle only."""
    keys, count = np.unique(_keys(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)), return_counts=True)
    return np.asarray(keys[count == 1])

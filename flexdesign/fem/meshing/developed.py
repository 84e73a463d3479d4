"""Even triangles on planes and cylinders: the kernel's needles, which reach across a face, made anew.

Both surfaces can be laid flat without stretching. There the kernel's boundary is cut into pieces, points of a
triangular lattice are put between, and Delaunay's triangulation joins them. Neighbours need not share points: the
unstructured mesher takes faces as they come, and points on straight edges are cut alike.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.path import Path
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from flexdesign.core.errors import InputError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

#: Most triangles of one tessellated cylinder: some seconds and 100 MB. The notched lever of `studies.error_bars` has
#: 3400; a hinge of some nanometres next to a large bore needs more than any memory holds.
MOST = 200_000
#: What the area of the new triangles may differ by from that of the kernel's, relative.
AREA = 1e-3


def triangles_of(face: Any, chord: float, longest: float) -> tuple[FloatArray, IntArray] | None:
    """Return points (n, 3) and triangles (m, 3) of a plane or cylindrical face, all in the kernel's unit.

    Parameters
    ----------
    face
        CadQuery face.
    chord
        How far the boundary's polygon may stray from curved edges.
    longest
        Distance of the lattice's points.

    Returns
    -------
    tuple or None
        None where the face is neither, or what comes out does not cover it.
    """
    from OCP.BRep import BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.TopLoc import TopLoc_Location

    kind = face.geomType()
    if kind not in ("PLANE", "CYLINDER"):
        return None
    face.tessellate(chord, 0.35)
    place = TopLoc_Location()
    known = BRep_Tool.Triangulation_s(face.wrapped, place)
    if known is None or not known.HasUVNodes():
        return None
    surface = BRepAdaptor_Surface(face.wrapped)
    scale = np.array([surface.Cylinder().Radius() if kind == "CYLINDER" else 1.0, 1.0])
    flat = np.array([(p.X(), p.Y()) for p in (known.UVNode(i + 1) for i in range(known.NbNodes()))]) * scale
    corners = np.array([known.Triangle(i + 1).Get() for i in range(known.NbTriangles())]) - 1
    made = _develop(flat, corners, longest)
    if made is None:
        return None
    points, triangles = made
    lifted = [surface.Value(u, v) for u, v in (points / scale).tolist()]
    if (face.wrapped.Orientation().name == "TopAbs_REVERSED") != _left_handed(surface, kind):
        triangles = triangles[:, [0, 2, 1]]
    return np.array([(p.X(), p.Y(), p.Z()) for p in lifted]), triangles


def split(points: FloatArray, triangles: IntArray, longest: float) -> tuple[FloatArray, IntArray]:
    """Halve triangles at their longest side until none is longer than asked for; neighbours share the new points.

    Raises
    ------
    InputError
        If that takes more than `MOST` triangles.
    """
    done, count = [], 0
    while len(triangles):
        count += len(triangles)
        if count > MOST:
            remedy = (
                f"a round face needs more than {MOST} triangles with edges of at most {longest * 1e3:.2g} mm, which "
                "the thinnest hinge asks for; make this hinge thicker, or the face smaller"
            )
            raise InputError("part", "solid", None, remedy)
        sides = np.linalg.norm(points[np.roll(triangles, -1, axis=1)] - points[triangles], axis=2)
        is_long = sides.max(axis=1) > longest
        done.append(triangles[~is_long])
        count -= int(is_long.sum())
        first = sides[is_long].argmax(axis=1)
        a, b, c = np.take_along_axis(triangles[is_long], (first[:, None] + np.arange(3)) % 3, axis=1).T
        middle = len(points) + np.arange(len(a))
        points = np.concatenate([points, (points[a] + points[b]) / 2])
        triangles = np.concatenate([np.column_stack([a, middle, c]), np.column_stack([middle, b, c])])
    places, number = np.unique(points, axis=0, return_inverse=True)  # neighbours halve the same side to the same point
    return places, number.reshape(-1)[np.concatenate(done)]


def _left_handed(surface: Any, kind: str) -> bool:
    """Tell whether the surface's normal is against du x dv of its axes."""
    axes = (surface.Plane() if kind == "PLANE" else surface.Cylinder()).Position()
    return not axes.Direct()


def _develop(flat: FloatArray, corners: IntArray, longest: float) -> tuple[FloatArray, IntArray] | None:
    edges = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    each, count = np.unique(edges, axis=0, return_counts=True)
    rim = each[count == 1]
    pieces = [_cut(flat[a], flat[b], longest) for a, b in rim.tolist()]
    boundary = np.unique(np.round(np.vstack(pieces), 12), axis=0)
    low, high = flat.min(axis=0), flat.max(axis=0)
    if np.prod((high - low) / longest) > 2e5:
        return None
    x, y = np.arange(low[0], high[0], longest), np.arange(low[1], high[1], longest * np.sqrt(0.75))
    lattice = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    lattice[:, 1::2, 0] += longest / 2
    inner = lattice.reshape(-1, 2)
    away, _ = cKDTree(boundary).query(inner)
    inner = inner[away > 0.6 * longest]
    loops = _loops(rim)
    inner = inner[_within(inner, flat, loops)] if len(inner) else inner
    points = np.vstack([boundary, inner])
    if len(points) < 3:
        return None
    triangles = Delaunay(points).simplices.astype(np.int64)
    a, b, c = (points[triangles[:, i]] for i in range(3))
    area = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    inside = _within((a + b + c) / 3, flat, loops) & (np.abs(area) > 1e-9 * longest**2)
    triangles, area = triangles[inside], area[inside]
    triangles[area < 0] = triangles[area < 0][:, [0, 2, 1]]
    one, other = flat[corners[:, 1]] - flat[corners[:, 0]], flat[corners[:, 2]] - flat[corners[:, 0]]
    whole = np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]).sum() / 2
    if abs(np.abs(area).sum() / whole - 1) > AREA:
        return None
    return points, triangles


def _cut(a: FloatArray, b: FloatArray, longest: float) -> FloatArray:
    count = max(int(np.ceil(np.linalg.norm(b - a) / longest)), 1)
    return np.asarray(a + np.linspace(0.0, 1.0, count + 1)[:, None] * (b - a))


def _loops(rim: IntArray) -> list[list[int]]:
    """Return closed loops of vertices from edges (k, 2)."""
    neighbours: dict[int, list[int]] = {}
    for a, b in rim.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    left, loops = {tuple(edge) for edge in rim.tolist()}, []
    while left:
        first, here = min(left)
        left.discard((first, here))
        loop = [first, here]
        while here != first:
            following = next((n for n in neighbours[here] if (min(here, n), max(here, n)) in left), None)
            if following is None:
                break
            left.discard((min(here, following), max(here, following)))
            here = following
            loop.append(here)
        loops.append(loop)
    return loops


def _within(places: FloatArray, flat: FloatArray, loops: list[list[int]]) -> NDArray[np.bool_]:
    inside = np.zeros(len(places), dtype=bool)
    for loop in loops:
        inside ^= Path(flat[loop]).contains_points(places)
    return inside

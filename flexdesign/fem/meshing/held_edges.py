"""Edges of faces that are held or move as one body: stress is singular there, as at re-entrant edges.

Where a face that cannot deform meets a free one at right angles, displacements vary as r^s with the s that solves

    sin^2(s pi / 2) = (4 (1 - nu)^2 - s^2) / (3 - 4 nu),

0.71 for nu = 0.3 (Williams 1952, J. Appl. Mech. 19, clamped-free corner), so that stiffnesses converge with h^(2 s),
however high the order of the elements. Of a solid without hinges, such as a lug, a bush or a clevis, these edges leave
most of the error open: meshes must be refined there by the law by which results are extrapolated.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flexdesign.fem.meshing.reentrant_edges import APART, MOST, thickness_beside

MM = 1e-3
FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class HeldEdges:
    """Places along them.

    Parameters
    ----------
    places, ways
        Where they are [m], and unit vectors along the edge, shapes (k, 3).
    thickness
        Of the solid next to each, shape (k,) [m].
    """

    places: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    ways: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    thickness: FloatArray = field(default_factory=lambda: np.zeros(0))

    def flattened(self, axis: int, height: float) -> Callable[[FloatArray, FloatArray], NDArray[np.bool_]]:
        """Return what tells which points (n, 3) lie on edges drawn out along an axis, within lengths (n,) [m].

        Points and edges are seen at one height [m] along the axis.
        """
        places = self.places.copy()
        places[:, axis] = height
        tree = cKDTree(places) if len(places) else None

        def near(points: FloatArray, reach: FloatArray) -> NDArray[np.bool_]:
            return np.zeros(len(points), dtype=bool) if tree is None else tree.query(points)[0] < reach

        return near

    def heights(self, axis: int, share: float) -> FloatArray:
        """Return at which heights along an axis edges run across it, and how thick layers may be there.

        Parameters
        ----------
        axis
            0, 1 or 2.
        share
            Thickness of the layers in that of the solid.

        Returns
        -------
        ndarray
            Rows of start, end and thickness, shape (h, 3) [m].
        """
        across = np.abs(self.ways[:, axis]) < 0.5
        heights, sizes = self.places[across, axis], share * self.thickness[across]
        _, first, number = np.unique(np.round(heights / 1e-9), return_index=True, return_inverse=True)
        thick = np.full(len(first), np.inf)
        np.minimum.at(thick, number.reshape(-1), sizes)
        return np.column_stack([heights[first], heights[first], thick])


def find(
    solid: Any, faces: Sequence[int], mirrors: Collection[int], places: FloatArray, thickness: FloatArray
) -> HeldEdges:
    """Find them on a CadQuery solid [mm].

    Parameters
    ----------
    solid
        What is meshed.
    faces
        Indices of the faces that are held or move as one body.
    mirrors
        Those of the faces in symmetry planes, where nothing ends.
    places, thickness
        Where the solid's thickness is known, shapes (n, 3) and (n,) [m].
    """
    lines, ways = [np.zeros((0, 3))], [np.zeros((0, 3))]
    tree, held = cKDTree(places), set(faces)
    for edge, owners in _owners(solid):
        if not (held & owners and owners - held - set(mirrors)):
            continue
        spots, along = _sample(edge, MOST)
        beside, nearest = thickness_beside(spots, tree, thickness)
        least = float(np.where(np.isfinite(beside), beside, nearest).min())
        count = int(np.clip(np.ceil(edge.Length() * MM / (APART * least)), 1, MOST))
        chosen = np.unique(np.linspace(0, MOST - 1, count).round().astype(np.int64))
        lines.append(spots[chosen])
        ways.append(along[chosen])
    found = np.vstack(lines)
    beside, nearest = thickness_beside(found, tree, thickness)
    return HeldEdges(found, np.vstack(ways), np.where(np.isfinite(beside), beside, nearest))


def _owners(solid: Any) -> list[tuple[Any, set[int]]]:
    """Return the edges of a solid with the indices of the faces that meet there."""
    found = dict[int, list[tuple[Any, set[int]]]]()
    for index, face in enumerate(solid.Faces()):
        for edge in face.Edges():
            same = found.setdefault(edge.hashCode(), [])
            for other, owners in same:
                if edge.isSame(other):
                    owners.add(index)
                    break
            else:
                same.append((edge, {index}))
    return [each for edges in found.values() for each in edges]


def _sample(edge: Any, count: int) -> tuple[FloatArray, FloatArray]:
    """Return places along an edge [m] and unit vectors along it, shapes (count, 3)."""
    at = (np.arange(count) + 0.5) / count
    places, ways = ([v.toTuple() for v in found] for found in (edge.positions(at), edge.tangents(at)))
    return np.array(places) * MM, np.array(ways)

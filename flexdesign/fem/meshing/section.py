"""The cross-section of a domain that is an extrusion, read off its CAD solid: nothing is drawn twice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.design.part import Axis

MM = 1e-3
AXES: tuple[Axis, ...] = ("x", "y", "z")
FloatArray = NDArray[np.float64]

#: Pieces a curved edge is sampled by; a half circle's chords then stay within 5e-6 of its radius.
SAMPLES = 512


@dataclass(frozen=True)
class Curve:
    """One edge of a section's outline, and the CAD face that the extrusion makes of it.

    Parameters
    ----------
    points
        Polyline from end to end, shape (n, 2) [m]: two points where it is straight, many where it is curved.
    face
        Index of the CAD face.
    """

    points: FloatArray
    face: int


@dataclass(frozen=True)
class Section:
    """A plane section and how it is extruded.

    Parameters
    ----------
    axis
        0, 1 or 2: the extrusion runs along x, y or z.
    low, high
        Coordinates of the ends along the axis [m].
    ends
        Indices of the CAD faces at the low and the high end.
    outline
        The edges of the section, in coordinates along the two axes that follow `axis` cyclically.
    """

    axis: int
    low: float
    high: float
    ends: tuple[int, int]
    outline: tuple[Curve, ...]

    def lifted(self, points: FloatArray, height: float) -> FloatArray:
        """Return points (n, 2) of the section in space, at a coordinate along the axis [m], shape (n, 3)."""
        return np.roll(np.column_stack([points, np.full(len(points), height)]), self.axis - 2, axis=1)

    def reentrant_corners(self, least: float = 0.2) -> FloatArray:
        """Return the corners at which the section turns inwards by more than `least` radians, shape (n, 2) [m]."""
        ends = np.array([(p[0], p[-1]) for p in (curve.points for curve in self.outline)])  # (curves, 2 ends, 2)
        ways = np.array([(p[1] - p[0], p[-2] - p[-1]) for p in (curve.points for curve in self.outline)])
        _, number = np.unique(np.round(ends.reshape(-1, 2) / 1e-9), axis=0, return_inverse=True)
        pairs = np.argsort(number.reshape(-1), kind="stable").reshape(-1, 2)  # two curves end at each corner
        corners, ways = ends.reshape(-1, 2)[pairs[:, 0]], ways.reshape(-1, 2)[pairs]
        ways = ways / np.linalg.norm(ways, axis=2, keepdims=True)
        between = ways.sum(axis=1)  # points to the side on which the angle is below 180 degrees
        sharp = np.linalg.norm(between, axis=1) > 2 * np.sin(least / 2)
        sides = np.concatenate([np.stack([c.points[:-1], c.points[1:]], axis=1) for c in self.outline])
        return corners[sharp][~encloses(sides, (corners + 1e-9 * between)[sharp])]


def encloses(sides: FloatArray, places: FloatArray) -> NDArray[np.bool_]:
    """Tell which places lie within an outline, by how many of its sides a ray along x crosses.

    Parameters
    ----------
    sides
        Ends of the outline's straight sides, shape (k, 2, 2) [m].
    places
        Shape (n, 2) [m].
    """
    (ax, ay), (bx, by) = sides[:, 0].T, sides[:, 1].T
    x, y = places[:, :1], places[:, 1:]
    spans = (ay > y) != (by > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        right = x < ax + (y - ay) / (by - ay) * (bx - ax)
    return np.asarray((spans & right).sum(axis=1) % 2 == 1)


def of_solid(solid: Any, axis: Axis, tolerance: float = 1e-6) -> Section:
    """Read the section of a CAD solid that is said to be an extrusion.

    Parameters
    ----------
    solid
        A CadQuery solid [mm].
    axis
        The axis along which it is extruded.
    tolerance
        Relative difference allowed between its volume and that of the extruded section.

    Raises
    ------
    InputError
        If the solid is no extrusion along this axis.
    """
    index = "xyz".index(axis)
    box = solid.BoundingBox()
    low, high = ((box.xmin, box.xmax), (box.ymin, box.ymax), (box.zmin, box.zmax))[index]
    faces = solid.Faces()
    caps = [_cap(faces, index, side, axis) for side in (-1, 1)]
    low, high = (faces[cap].Center().toTuple()[index] for cap in caps)
    if abs(faces[caps[0]].Area() * (high - low) / solid.Volume() - 1) > tolerance:
        raise _no_extrusion(axis, "its volume is not that of its end face drawn out to its length")
    sides = [(i, face.Edges()) for i, face in enumerate(faces) if i not in caps]
    outline = []
    for edge in faces[caps[0]].Edges():
        owners = [i for i, edges in sides if any(edge.isSame(other) for other in edges)]
        if len(owners) != 1:
            raise _no_extrusion(axis, "an edge of its end face belongs to no one side face")
        outline.append(Curve(_sample(edge, index), owners[0]))
    if len({curve.face for curve in outline}) != len(sides):
        raise _no_extrusion(axis, "some side faces do not reach from end to end")
    return Section(index, low * MM, high * MM, (caps[0], caps[1]), tuple(outline))


def candidates(inward: FloatArray, perpendicular: float = 1e-7) -> list[int]:
    """Return along which axes, 0, 1 or 2, a solid may be extruded.

    Parameters
    ----------
    inward
        Directions across its hinges, to which the axis is perpendicular, unit vectors of shape (n, 3).
    perpendicular
        Largest cosine of the angle between them.
    """
    return [index for index in range(3) if np.abs(inward[:, index]).max(initial=0.0) <= perpendicular]


def find(solid: Any, inward: FloatArray) -> Section | None:
    """Return the section of a CAD solid [mm] if it is an extrusion along one of the `candidates`; else None."""
    for index in candidates(inward):
        try:
            return of_solid(solid, AXES[index])
        except InputError:
            continue
    return None


def _cap(faces: Sequence[Any], index: int, side: int, axis: Axis) -> int:
    """Return the one plane face whose outward normal points along the axis, forwards (1) or backwards (-1)."""
    found = [
        i
        for i, face in enumerate(faces)
        if face.geomType() == "PLANE" and side * face.normalAt().toTuple()[index] > 1 - 1e-9
    ]
    if len(found) != 1:
        raise _no_extrusion(axis, f"it has {len(found)} faces that look along {'-+'[side > 0]}{axis}, not one")
    return found[0]


def _sample(edge: Any, index: int) -> FloatArray:
    straight = edge.geomType() == "LINE"
    places = [edge.startPoint(), edge.endPoint()] if straight else edge.positions(np.linspace(0.0, 1.0, SAMPLES + 1))
    points = np.array([place.toTuple() for place in places]) * MM
    return points[:, [(index + 1) % 3, (index + 2) % 3]]


def _no_extrusion(axis: Axis, why: str) -> InputError:
    return InputError("part", "prismatic", axis, f"the solid is no extrusion along {axis}: {why}; return None instead")

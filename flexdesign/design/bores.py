"""Bores of a solid: which they are, and which two of them are the natural ports of a lever, a link or a clevis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.design.faces import DIRECTION, MM, SAME_RADIUS, SolidFace, is_of_one_cylinder, on_axis

#: A bore goes all the way round, up to this angle [rad].
OPEN = 0.01


@dataclass(frozen=True)
class Bore:
    """A bore: one of its faces, and the middle of its axis [m]."""

    face: SolidFace
    centre: NDArray[np.float64]

    def is_like(self, other: Bore) -> bool:
        """Tell whether another bore has the radius and the direction of this one."""
        same = abs(self.face.radius - other.face.radius) < SAME_RADIUS * self.face.radius
        return same and abs(float(np.dot(self.face.axis or (), other.face.axis or ()))) > DIRECTION


def of_faces(faces: Sequence[SolidFace], size: float) -> list[Bore]:
    """Return the hollow cylinders that go all the way round, the widest first.

    Parameters
    ----------
    faces
        Of the solid.
    size
        Diagonal of the solid's bounding box [m].
    """
    left = [face for face in faces if face.kind == "cylinder" and _is_hollow(face)]
    found = []
    while left:
        first, *others = left
        group = [first]
        for _ in others:  # pieces may touch other pieces alone
            group += [
                face
                for face in others
                if face not in group
                and is_of_one_cylinder(face, first, size)
                and any(face.shape.distance(piece.shape) < 1e-5 * size / MM for piece in group)
            ]
        left = [face for face in others if face not in group]
        if sum(_turn(face) for face in group) > 2 * math.pi - OPEN:
            found.append(Bore(first, np.mean([on_axis(face) for face in group], axis=0)))
    return sorted(found, key=lambda bore: -bore.face.radius)


def pair(bores: Sequence[Bore], longest: float) -> tuple[Bore, Bore] | None:
    """Return the two bores that are the natural ports of a solid, if there are two.

    Their axes are farther apart than half the solid's longest side [m], and they are the only two bores, or the only
    two of one radius and direction; more than two alike are holes for screws. Of several pairs the one that is
    farthest apart is meant.
    """

    def apart(two: tuple[Bore, Bore]) -> float:
        one, other = two
        between, along = other.centre - one.centre, np.array(one.face.axis)
        parallel = abs(float(along @ np.array(other.face.axis))) > DIRECTION
        return float(np.linalg.norm(between - (between @ along) * along if parallel else between))

    pairs = [
        (one, other)
        for one, other in combinations(bores, 2)
        if len(bores) == 2 or (one.is_like(other) and sum(one.is_like(each) for each in bores) == 2)
    ]
    return max((two for two in pairs if apart(two) > longest / 2), key=apart, default=None)


def _surface(face: SolidFace) -> Any:
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    return BRepAdaptor_Surface(face.shape.wrapped)


def _turn(face: SolidFace) -> float:
    """Return the angle that a cylindrical face goes round [rad]."""
    surface = _surface(face)
    return float(surface.LastUParameter() - surface.FirstUParameter())


def _is_hollow(face: SolidFace) -> bool:
    """Tell whether the outward normal of a cylindrical face looks at its axis."""
    import cadquery as cq

    surface = _surface(face)
    middle = [
        (first + last) / 2
        for first, last in (
            (surface.FirstUParameter(), surface.LastUParameter()),
            (surface.FirstVParameter(), surface.LastVParameter()),
        )
    ]
    point = surface.Value(*middle)
    place = np.array([point.X(), point.Y(), point.Z()])
    axis = np.array(face.axis)
    from_axis = place - on_axis(face) / MM
    from_axis -= (from_axis @ axis) * axis
    return bool(from_axis @ np.array(face.shape.normalAt(cq.Vector(*place)).toTuple()) < 0)

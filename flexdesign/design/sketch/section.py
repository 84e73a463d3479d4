"""The plane section of a sketch, put together by the CAD kernel, and the solid drawn out of it [mm]."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Notch
from flexdesign.design.part import Outline, SymmetryPlane
from flexdesign.design.sketch import polygons
from flexdesign.design.sketch.drawing import Drawing, Flexure

#: Chords that approximate a curved edge where rays are sent across the section.
CHORDS = 32


@dataclass(frozen=True, eq=False)
class Section:
    """The section of a drawing: bodies and flexures in one."""

    drawing: Drawing

    @cached_property
    def face(self) -> Any:
        """The section as one plane CAD face [mm].

        Raises
        ------
        InputError
            If the pieces do not make one.
        """
        import cadquery as cq

        pieces = [_polygon(body.corners) for body in self.drawing.bodies.values()]
        pieces += [_outline_of(flexure) for flexure in self.drawing.flexures.values()]
        pieces += [_polygon(wedge) for flexure in self.drawing.flexures.values() for wedge in self._wedges(flexure)]
        first, *others = [cq.Face.makeFromWires(wire) for wire in pieces]
        whole = first.fuse(*others).clean() if others else first
        faces = whole.Faces()
        if len(faces) != 1:
            remedy = f"its pieces make {len(faces)} separate sections; let every flexure end at the bodies it joins"
            raise InputError("design", "flexure", None, remedy)
        return faces[0]

    @cached_property
    def edges(self) -> tuple[Any, ...]:
        """The edges of the face."""
        return tuple(self.face.Edges())

    @cached_property
    def segments(self) -> Array:
        """The boundary as straight segments, curved edges by chords, shape (k, 2, 2) [m]."""
        found = []
        for edge in self.edges:
            straight = edge.geomType() == "LINE"
            places = [edge.startPoint(), edge.endPoint()] if straight else edge.positions(np.linspace(0, 1, CHORDS + 1))
            points = 1e-3 * np.array([place.toTuple()[:2] for place in places])
            found.append(np.stack([points[:-1], points[1:]], axis=1))
        return np.concatenate(found)

    def outline(self) -> Outline | None:
        """Return the section by its corners; None with curved edges."""
        drawing = self.drawing
        if any(f.profile != "leaf" or f.root_fillet > 0 for f in drawing.flexures.values()):
            return None
        loops = [_corners(wire) for wire in (self.face.outerWire(), *self.face.innerWires())]
        return Outline(loops, -drawing.thickness / 2, drawing.thickness / 2)

    def solid(self) -> Any:
        """Return the plate, fillets at the roots of the flexures that have any [mm]."""
        import cadquery as cq

        half = 1e3 * self.drawing.thickness / 2
        low = self.face.translate(cq.Vector(0, 0, -half))
        body = cq.Workplane(cq.Solid.extrudeLinear(low, cq.Vector(0, 0, 2 * half)))
        for radius in sorted({f.root_fillet for f in self.drawing.flexures.values()} - {0.0}):
            places = [
                place for f in self.drawing.flexures.values() if f.root_fillet == radius for place in self._roots(f)
            ]
            edges = [e for e in body.edges("|Z").vals() if _near((e.Center().x, e.Center().y), places)]
            try:
                body = body.newObject(edges).fillet(1e3 * radius)
            except Exception as error:  # the kernel's exceptions have no common class but this
                first = next(f for f in self.drawing.flexures.values() if f.root_fillet == radius)
                remedy = "does not fit at its roots; make it smaller, or let the bodies reach further to both sides"
                field = f"flexure.{first.name}.fillet"
                raise InputError("design", field, f"{1e3 * radius:.6g} mm", remedy) from error
        return body.solids().val()

    def _roots(self, flexure: Flexure) -> Iterator[Array]:
        """Yield the corners at which a flexure meets its bodies [m]."""
        for number, (name, point, _) in enumerate(flexure.ends):
            if not polygons.contains(self.drawing.bodies[name].corners, point):
                yield from self.drawing.feet(flexure, number)

    def _wedges(self, flexure: Flexure) -> Iterator[Array]:
        """Yield the triangles between a flexure's ends and sides of bodies that are not square to it [m]."""
        for number, (name, point, way) in enumerate(flexure.ends):
            if polygons.contains(self.drawing.bodies[name].corners, point):
                continue
            for side, foot in zip((-1, 1), self.drawing.feet(flexure, number), strict=True):
                corner = point + side * flexure.end_thickness / 2 * flexure.normal
                if float((foot - corner) @ way) > 10 * polygons.TOLERANCE:
                    yield np.array([corner, foot, point])

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return the coordinate planes in which section and ports are their own mirror images, and z = 0.

        A rigid port that moves is not cut: with one there are none.
        """
        if any(port.rigid and port.role != "ground" for port in self.drawing.ports):
            return ()
        found = [self._mirrored(index) for index in (0, 1)]
        return (*(plane for plane in found if plane is not None), SymmetryPlane("z", {}))

    def _mirrored(self, index: int) -> SymmetryPlane | None:
        flip = np.where(np.arange(3) == index, -1.0, 1.0)
        swaps = {}
        for port in self.drawing.ports:
            point, normal = np.array(port.point) * flip, np.array(port.normal) * flip
            image = next((p for p in self.drawing.ports if p.role == port.role
                          and np.allclose(p.point, point, rtol=0, atol=10 * polygons.TOLERANCE)
                          and np.allclose(p.normal, normal, rtol=0, atol=1e-9)), None)  # fmt: skip
            if image is None or (image is not port and port.role != "input"):
                return None
            if image is not port and port.point[index] < 0:
                swaps[port.name] = image.name
        places = np.array([self._edge_points(edge) for edge in self.edges])
        images = places * np.tile(flip[:2], 3)
        images = np.concatenate([images, images[:, [2, 3, 0, 1, 4, 5]]])  # an image may run the other way
        gaps = np.abs(places[:, None] - images[None]).max(axis=2).min(axis=1)
        return SymmetryPlane("xyz"[index], swaps) if (gaps < 10 * polygons.TOLERANCE).all() else None  # type: ignore[arg-type]

    @staticmethod
    def _edge_points(edge: Any) -> tuple[float, ...]:
        """Return start, end and middle of an edge [m]; the middle by parameter, as an arc length is approximate."""
        middle = edge.positionAt(sum(edge.bounds()) / 2, mode="parameter")
        places = (edge.startPoint(), edge.endPoint(), middle)
        return tuple(1e-3 * value for place in places for value in place.toTuple()[:2])


def _polygon(corners: Array) -> Any:
    import cadquery as cq

    if polygons.winding(corners) < 0:  # faces are joined only if they look the same way
        corners = corners[::-1]
    return cq.Wire.makePolygon([cq.Vector(*map(float, 1e3 * corner), 0.0) for corner in corners], close=True)


def _outline_of(flexure: Flexure) -> Any:
    """Return the outline of a flexure; sides of notches are arcs, half ellipses, parabolas or lines and an arc."""
    import cadquery as cq

    notch = flexure.notch
    if notch is None:
        return _polygon(flexure.corners)
    half, high = notch.half_length, flexure.end_thickness / 2
    lower, upper = _side(flexure, notch, 1.0), _side(flexure, notch, -1.0)
    right, left = (
        cq.Edge.makeLine(_point_at(flexure, way * half, -way * high), _point_at(flexure, way * half, way * high))
        for way in (1, -1)
    )
    return cq.Wire.assembleEdges([*lower, right, *upper, left])


def _point_at(flexure: Flexure, along: float, up: float) -> Any:
    """Return a point by its distances from a flexure's middle along it and to its left [m], as a vector [mm]."""
    import cadquery as cq

    x, y = 1e3 * ((flexure.start + flexure.end) / 2 + along * flexure.axis + up * flexure.normal)
    return cq.Vector(float(x), float(y), 0.0)


def _side(flexure: Flexure, notch: Notch, turn: float) -> list[Any]:
    """Return the edges of a notch's right side from start to end; turned by half a turn, -1, the left side's back."""
    import cadquery as cq

    def place(along: float, rise: float) -> Any:
        return _point_at(flexure, turn * along, -turn * (flexure.thickness / 2 + rise))

    half, depth = notch.half_length, notch.depth
    first, last = place(-half, depth), place(half, depth)
    if notch.shape == "parabolic":  # the middle pole of a parabola lies as far beyond its vertex as its ends
        return [cq.Edge.makeBezier([first, place(0, -depth), last])]
    if notch.shape == "elliptic":
        along, up = (cq.Vector(*map(float, turn * each), 0.0) for each in (flexure.axis, flexure.normal))
        centre, plane, long, short = place(0, depth), cq.Vector(0, 0, -1), 1e3 * half, 1e3 * depth
        if short > long:  # the kernel wants the longer axis first
            return [cq.Edge.makeEllipse(short, long, centre, plane, up, -90.0, 90.0)]
        return [cq.Edge.makeEllipse(long, short, centre, plane, -along, 0.0, 180.0)]
    bend = notch.arc_half
    low, high = (place(at, float(notch.rise(np.array([bend]))[0])) for at in (-bend, bend))
    arc = cq.Edge.makeThreePointArc(low, place(0, 0), high)
    return [arc] if notch.shape == "circular" else [cq.Edge.makeLine(first, low), arc, cq.Edge.makeLine(high, last)]


def _corners(wire: Any) -> list[tuple[float, float]]:
    """Return the corners of a wire of straight edges in turn [m]."""
    edges = [np.array([p.toTuple()[:2] for p in (e.startPoint(), e.endPoint())]) for e in wire.Edges()]
    chain = [edges[0][0], edges[0][1]]
    left = edges[1:]
    while left:
        number, end = min(
            ((i, j) for i in range(len(left)) for j in (0, 1)), key=lambda at: math.dist(left[at[0]][at[1]], chain[-1])
        )
        chain.append(left.pop(number)[1 - end])
    return [(1e-3 * float(x), 1e-3 * float(y)) for x, y in chain[:-1]]


def _near(centre: tuple[float, float], places: list[Array]) -> bool:
    return any(math.dist(centre, 1e3 * place) < 1e-6 for place in places)

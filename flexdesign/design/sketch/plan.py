"""A sketch that has been read, turned into a drawing for any values of its dimensions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any

import numpy as np

from flexdesign.core import arithmetic
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Parameter
from flexdesign.design.part import Port
from flexdesign.design.sketch import polygons
from flexdesign.design.sketch.drawing import Body, Drawing, Flexure
from flexdesign.design.sketch.tables import FlexureTable, Repeated, SketchTables

#: Units that arithmetic may name, with their size in SI; a number takes one behind it.
UNITS = {"m": ("m", 1.0), "mm": ("m", 1e-3), "um": ("m", 1e-6), "deg": ("rad", math.pi / 180), "rad": ("rad", 1.0)}
#: Returns the number [SI] at a place of the file.
Number = Callable[[str], float]
_SIDES = {"-x": (-1.0, 0.0), "+x": (1.0, 0.0), "-y": (0.0, -1.0), "+y": (0.0, 1.0)}


@dataclass(frozen=True)
class Expression:
    """Arithmetic that gives a number in one SI unit."""

    formula: arithmetic.Formula
    where: str

    def at(self, values: Mapping[str, float]) -> float:
        """Return the number [SI] for values of the names."""
        try:
            return self.formula.number(values)
        except ValueError as error:
            raise InputError("design", self.where, self.formula.text, str(error)) from None


@dataclass(frozen=True)
class Plan:
    """A sketch that has been understood, for any values of its dimensions.

    Parameters
    ----------
    tables
        What the file says.
    dimensions
        Its dimensions.
    expressions
        Arithmetic by where it stands.
    """

    tables: SketchTables
    dimensions: tuple[Parameter, ...]
    expressions: Mapping[str, Expression] = field(default_factory=dict)

    @property
    def axes(self) -> tuple[str, ...]:
        """The names of the axes, in the order of the outputs."""
        return tuple(dict.fromkeys(axis for port in self.tables.of_role("output") for axis in port.axes))

    def at(self, given: Mapping[str, float], axis: str | None = None) -> Drawing:
        """Return the drawing for values of the dimensions [SI], its ports those of one axis, the first by default.

        Raises
        ------
        InputError
            If it is no mechanism with these values.
        """
        values = {**{name: size for name, (_, size) in UNITS.items()}, **given}
        for name in self.tables.derived:
            values[name] = self.expressions[f"derived.{name}"].at(values)

        def number(where: str) -> float:
            return self.expressions[where].at(values)

        bodies = self._bodies(number)
        flexures = self._flexures(number, bodies)
        thick = number("plate.thickness")
        if not thick > 0:
            raise InputError("design", "plate.thickness", f"{1e3 * thick:g} mm", "must be more than 0 mm")
        by_axis = {each: list(self._ports(number, bodies, each)) for each in self.axes}
        for ports in by_axis.values():
            _require_moving(ports)
            _require_apart(ports)
        found = by_axis[self.axis_of(axis)]
        return Drawing(bodies, flexures, tuple(port for port, _ in found), {p.name: body for p, body in found}, thick)

    def axis_of(self, axis: str | None = None) -> str:
        """Return the axis that is looked at: the one named, or the one that the file names, or the first."""
        return axis or self.tables.active_axis or self.axes[0]

    def _bodies(self, number: Number) -> dict[str, Body]:
        bodies: dict[str, Body] = {}
        for table in self.tables.body:
            where = f"body.{table.name}"
            if table.box is not None:
                x0, y0, x1, y1 = (number(f"{where}.box.{i}") for i in range(1, 5))
                corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
            else:
                places = range(1, len(table.polygon or ()) + 1)
                corners = np.array([_point(number, f"{where}.polygon.{i}") for i in places])
            for suffix, turn in _images(table):
                _add(bodies, Body(f"{table.name}{suffix}", corners @ turn.T), "body")
        return bodies

    def _flexures(self, number: Number, bodies: Mapping[str, Body]) -> dict[str, Flexure]:
        flexures: dict[str, Flexure] = {}
        for table in self.tables.flexure:
            start, end = _ends(table, number)
            thickness, fillet = (number(f"flexure.{table.name}.{key}") for key in ("thickness", "fillet"))
            depth = 0.0 if table.depth is None else number(f"flexure.{table.name}.depth")
            for suffix, turn in _images(table):
                name = f"{table.name}{suffix}"
                first, second = (_image(bodies, body, turn, f"flexure.{name}") for body in table.between)
                ends = turn @ start, turn @ end
                flexure = Flexure(name, (first, second), *ends, thickness, table.profile, fillet, table.kind, depth)
                _add(flexures, flexure, "flexure")
        return flexures

    def _ports(self, number: Number, bodies: Mapping[str, Body], axis: str) -> Iterator[tuple[Port, str]]:
        """Yield the ports with their bodies; inputs and outputs of other axes are left out."""
        names: list[str] = []
        for role in ("input", "output", "ground"):
            tables = self.tables.of_role(role)
            for count, table in enumerate(tables, 1):
                base = table.name or (role if len(tables) == 1 else f"{role}_{count}")
                images = list(_images(table))
                for image, (suffix, turn) in enumerate(images):
                    if role != "ground" and table.axes[image * table.repeat // len(images)] != axis:
                        continue
                    body = _image(bodies, table.body, turn, f"port.{base}")
                    corners = bodies[body].corners
                    if table.side is not None:
                        way = turn @ np.array(_SIDES[table.side])
                        middle = _side(corners, way, f"port.{base}.side", table.side)
                    else:
                        point = turn @ _point(number, f"port.{self.tables.port.index(table) + 1}.at")
                        middle, way = _side_at(corners, point, f"port.{base}.at", body)
                    name = f"{base}{suffix}"
                    if name in names:
                        raise InputError("design", "port", name, 'two ports have this name; write name = "..." in one')
                    names.append(name)
                    at, normal = (float(middle[0]), float(middle[1]), 0.0), (float(way[0]), float(way[1]), 0.0)
                    yield Port(name, role, at, normal, rigid=table.interface == "rigid"), body


def _require_moving(ports: Sequence[tuple[Port, str]]) -> None:
    """Refuse inputs that all lie on the ground, and such outputs: nothing could move there."""
    grounds = {body: port.name for port, body in ports if port.role == "ground"}
    for role in ("input", "output"):
        own = [(port, body) for port, body in ports if port.role == role]
        if own and all(body in grounds for _, body in own):
            port, body = own[0]
            remedy = f"is the ground (port {grounds[body]}) and stands still; name a body that flexures let move"
            raise InputError("design", f"port.{port.name}.body", body, remedy)


def _require_apart(ports: Sequence[tuple[Port, str]]) -> None:
    """Refuse two ports on one side of a body: what one does the other would do, or hinder."""
    for (one, _), (other, body) in combinations(ports, 2):
        gap = np.abs(np.subtract(one.point, other.point)).max()
        if gap < 10 * polygons.TOLERANCE and np.allclose(one.normal, other.normal, rtol=0, atol=1e-9):
            side = next((name for name, way in _SIDES.items() if np.allclose(way, other.normal[:2])), None)
            remedy = f"is the side of the body {body} that {one.name} has; a side belongs to one port: name another"
            raise InputError("design", f"port.{other.name}.side", side, remedy)


def _point(number: Number, where: str) -> Array:
    return np.array([number(f"{where}.1"), number(f"{where}.2")])


def _ends(table: FlexureTable, number: Number) -> tuple[Array, Array]:
    """Return the two ends of a flexure [m]."""
    where = f"flexure.{table.name}"
    if table.start is not None:
        return _point(number, f"{where}.from"), _point(number, f"{where}.to")
    angle, half = number(f"{where}.direction"), number(f"{where}.length") / 2
    middle, way = _point(number, f"{where}.at"), np.array([math.cos(angle), math.sin(angle)])
    return middle - half * way, middle + half * way


def _images(table: Repeated) -> Iterator[tuple[str, Array]]:
    """Yield the suffix and the map of each image, the original first."""
    flips = [("", (1.0, 1.0))]
    if "x" in table.mirror:
        flips.append(("_x", (-1.0, 1.0)))
    if "y" in table.mirror:
        flips.append(("_y", (1.0, -1.0)))
    if table.mirror == "xy":
        flips.append(("_xy", (-1.0, -1.0)))
    for turn in range(table.repeat):
        angle = 2 * math.pi * turn / table.repeat
        c, s = math.cos(angle), math.sin(angle)
        for suffix, flip in flips:
            number = f"_{turn + 1}" if turn else ""
            yield f"{suffix}{number}", np.array([[c, -s], [s, c]]) @ np.diag(flip)


def _image(bodies: Mapping[str, Body], name: str, turn: Array, where: str) -> str:
    """Return the body that is the image of the body `name`: itself, if it is symmetric."""
    if name not in bodies:
        raise InputError("design", where, name, f"is not a body{suggest(name, list(bodies))}")
    corners = bodies[name].corners @ turn.T
    found = next((each for each, body in bodies.items() if polygons.have_same_corners(body.corners, corners)), None)
    if found is None:
        remedy = "the image of this body is no body; mirror or repeat the body too, or give this piece for one place"
        raise InputError("design", where, name, remedy)
    return found


def _add(pieces: dict[str, Any], piece: Any, kind: str) -> None:
    if piece.name in pieces:
        raise InputError("design", f"{kind}.{piece.name}", None, f"is the second {kind} of this name; rename one")
    pieces[piece.name] = piece


def _side(corners: Array, way: Array, where: str, side: str) -> Array:
    """Return the middle of a body's outermost side in a direction."""
    ends = polygons.sides(corners)
    reach = (corners @ way).max()
    outer = ends[(np.abs(ends @ way - reach) < 10 * polygons.TOLERANCE).all(axis=1)]
    if len(outer) != 1:
        remedy = 'the body has no one straight side there; name a side by a point on it: at = ["x", "y"]'
        raise InputError("design", where, side, remedy)
    return np.asarray(outer[0].mean(axis=0))


def _side_at(corners: Array, point: Array, where: str, body: str) -> tuple[Array, Array]:
    """Return the middle of the straight side on which a point lies, and its outward normal."""
    found = [ends for ends in polygons.sides(corners) if polygons.on_boundary(ends, point)]
    at = " ".join(f"{1e3 * value:.6g} mm" for value in point)
    if not found:
        raise InputError("design", where, at, f"is on no side of the body {body}; give a point on one of its sides")
    if len(found) > 1:
        raise InputError("design", where, at, f"is a corner of the body {body}; give a point between two corners")
    start, end = found[0]
    right = np.array([end[1] - start[1], start[0] - end[0]]) / np.linalg.norm(end - start)
    return (start + end) / 2, polygons.winding(corners) * right

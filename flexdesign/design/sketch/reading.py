"""The tables of a sketch: checked when they are read, turned into numbers for any values of the dimensions.

A coordinate is a number with a unit (``"3 mm"``), or arithmetic of them and of the names of `[dimensions]` and
`[derived]` (``"arm_span / 2 + 3 mm"``; `core.arithmetic`). Numbers without a unit are pure; a bare 0 is any nothing.

Bodies, flexures and ports may be given once for several: ``mirror = "x"`` adds the mirror image in the plane x = 0,
named as the original with ``_x`` behind, ``mirror = "xy"`` those in both planes and in one after the other (``_x``,
``_y``, ``_xy``), ``repeat = 3`` the images turned about the origin by a third each (``_2``, ``_3``).

Inputs and outputs of several axes name theirs: ``axis = "x"``, or, of one that is repeated, ``axis = ["a", "b", "c"]``.
A validation drives one of them, the first or the ``active_axis`` of the file.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from flexdesign.core import arithmetic, units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Parameter
from flexdesign.core.toml_files import Table, as_written, check, whole
from flexdesign.design.part import Port
from flexdesign.design.sketch import polygons
from flexdesign.design.sketch.drawing import Body, Drawing, Flexure

Array = NDArray[np.float64]
Text = str | int | float
#: Tables of a design that belong to its sketch.
KEYS = ("plate", "derived", "body", "flexure", "port", "active_axis")
#: Units that arithmetic may name, with their size in SI; a number takes one behind it.
UNITS = {"m": ("m", 1.0), "mm": ("m", 1e-3), "um": ("m", 1e-6), "deg": ("rad", math.pi / 180), "rad": ("rad", 1.0)}
_WITH_UNIT = re.compile(rf"(?<![\w.])(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+)\s*({'|'.join(UNITS)})\b")
#: What dimensions may be: SI unit, unit shown, largest magnitude.
_KINDS = (("m", "mm", 1.0), ("rad", "deg", 2 * math.pi), ("1", "", 1e6))
_SIDES = {"-x": (-1.0, 0.0), "+x": (1.0, 0.0), "-y": (0.0, -1.0), "+y": (0.0, 1.0)}
Mirror = Literal["", "x", "y", "xy"]


class _Repeated(Table):
    mirror: Mirror = ""
    repeat: whole(1, 12) = 1  # type: ignore[valid-type]


class _Plate(Table):
    thickness: Text = Field(examples=['thickness = "12 mm"'])


class _Body(_Repeated):
    name: str
    box: tuple[Text, Text, Text, Text] | None = None
    polygon: list[tuple[Text, Text]] | None = None


class _Flexure(_Repeated):
    name: str
    between: tuple[str, str]
    start: tuple[Text, Text] | None = Field(default=None, alias="from")
    end: tuple[Text, Text] | None = Field(default=None, alias="to")
    at: tuple[Text, Text] | None = None
    direction: Text = "0 deg"
    length: Text | None = None
    thickness: Text
    profile: Literal["leaf", "circular"] = "leaf"
    fillet: Text = 0
    kind: Literal["hinge", "rod"] = "hinge"


class _Port(_Repeated):
    role: Literal["ground", "input", "output"]
    body: str
    side: Literal["-x", "+x", "-y", "+y"]
    name: str = ""
    axis: str | list[str] = ""

    @property
    def axes(self) -> list[str]:
        """The axis of each turned image."""
        return self.axis if isinstance(self.axis, list) else [self.axis] * self.repeat


class _Sketch(Table):
    plate: _Plate
    derived: dict[str, Text] = Field(default_factory=dict)
    body: list[_Body]
    flexure: list[_Flexure]
    port: list[_Port]
    active_axis: str = ""

    def of_role(self, role: str) -> list[_Port]:
        return [port for port in self.port if port.role == role]


@dataclass(frozen=True)
class _Expression:
    """Arithmetic that gives a number in one SI unit."""

    formula: arithmetic.Formula
    where: str

    def at(self, values: Mapping[str, float]) -> float:
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

    tables: _Sketch
    dimensions: tuple[Parameter, ...]
    expressions: Mapping[str, _Expression] = field(default_factory=dict)

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

        def point(where: str) -> Array:
            return np.array([number(f"{where}.1"), number(f"{where}.2")])

        bodies: dict[str, Body] = {}
        for table in self.tables.body:
            where = f"body.{table.name}"
            if table.box is not None:
                x0, y0, x1, y1 = (number(f"{where}.box.{i}") for i in range(1, 5))
                corners = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
            else:
                corners = np.array([point(f"{where}.polygon.{i}") for i in range(1, len(table.polygon or ()) + 1)])
            for suffix, turn in _images(table):
                _add(bodies, Body(f"{table.name}{suffix}", corners @ turn.T), "body")
        flexures: dict[str, Flexure] = {}
        for each in self.tables.flexure:
            start, end = self._ends(each, number, point)
            thickness, fillet = (number(f"flexure.{each.name}.{key}") for key in ("thickness", "fillet"))
            for suffix, turn in _images(each):
                name = f"{each.name}{suffix}"
                first, second = (_image(bodies, body, turn, f"flexure.{name}") for body in each.between)
                flexure = Flexure(
                    name, (first, second), turn @ start, turn @ end, thickness, each.profile, fillet, each.kind
                )
                _add(flexures, flexure, "flexure")
        thick = number("plate.thickness")
        if not thick > 0:
            raise InputError("design", "plate.thickness", f"{1e3 * thick:g} mm", "must be more than 0 mm")
        found = list(self._ports(bodies, self.axis_of(axis)))
        return Drawing(bodies, flexures, tuple(port for port, _ in found), {p.name: body for p, body in found}, thick)

    def axis_of(self, axis: str | None = None) -> str:
        """Return the axis that is looked at: the one named, or the one that the file names, or the first."""
        return axis or self.tables.active_axis or self.axes[0]

    @staticmethod
    def _ends(table: _Flexure, number: Any, point: Any) -> tuple[Array, Array]:
        where = f"flexure.{table.name}"
        if table.start is not None:
            return point(f"{where}.from"), point(f"{where}.to")
        angle, half = number(f"{where}.direction"), number(f"{where}.length") / 2
        middle, way = point(f"{where}.at"), np.array([math.cos(angle), math.sin(angle)])
        return middle - half * way, middle + half * way

    def _ports(self, bodies: Mapping[str, Body], axis: str) -> Iterator[tuple[Port, str]]:
        """Yield the ports with their bodies; inputs and outputs of other axes are left out."""
        taken: list[str] = []
        for role in ("input", "output", "ground"):
            tables = self.tables.of_role(role)
            for number, table in enumerate(tables, 1):
                base = table.name or (role if len(tables) == 1 else f"{role}_{number}")
                images = list(_images(table))
                for image, (suffix, turn) in enumerate(images):
                    if role != "ground" and table.axes[image * table.repeat // len(images)] != axis:
                        continue
                    body = _image(bodies, table.body, turn, f"port.{base}")
                    way = turn @ np.array(_SIDES[table.side])
                    middle = _side(bodies[body].corners, way, f"port.{base}.side", table.side)
                    name = f"{base}{suffix}"
                    if name in taken:
                        raise InputError("design", "port", name, 'two ports have this name; write name = "..." in one')
                    taken.append(name)
                    at, normal = (float(middle[0]), float(middle[1]), 0.0), (float(way[0]), float(way[1]), 0.0)
                    yield Port(name, role, at, normal), body  # type: ignore[arg-type]


def read(content: Mapping[str, Any], dimensions: Mapping[str, object], path: Path) -> Plan:
    """Read the tables of a sketch.

    Parameters
    ----------
    content
        The tables `KEYS` of the file.
    dimensions
        Its table of dimensions, as written.
    path
        The file.

    Raises
    ------
    InputError
        If a table is wrong: which field, its value and what to write.
    """
    tables = check(_Sketch, content, path)
    if not dimensions:
        raise InputError(path, "dimensions", None, "is empty; name at least one length that the sketch uses")
    known = {name: _dimension(name, value, path) for name, value in dimensions.items()}
    values = {name: units.quantity(1.0, unit) for name, (unit, _) in UNITS.items()}
    values |= {p.name: units.quantity(p.start, p.si) for p in known.values()}
    expressions: dict[str, _Expression] = {}
    for name, text in tables.derived.items():
        _require_new(name, values, path)
        later = [each for each in tables.derived if each not in values]
        formula, value = _understood(text, values, path, f"derived.{name}", later)
        expressions[f"derived.{name}"] = _Expression(formula, f"derived.{name}")
        values[name] = value
    for where, text, si in _texts(tables, path):
        formula, value = _understood(text, values, path, where)
        if not (value.magnitude == 0 and not f"{value.units:~C}"):  # a bare 0 is any nothing
            _require_unit(value, si, path, where, text)
        expressions[where] = _Expression(formula, where)
    plan = Plan(tables, tuple(known.values()), expressions)
    _require_axes(plan, path)
    return plan


def _require_axes(plan: Plan, path: Path) -> None:
    for role in ("ground", "input", "output"):
        if not plan.tables.of_role(role):
            remedy = f'there is none of the role {role}; add [[port]] with role = "{role}", body and side'
            raise InputError(path, "port", None, remedy)
    for port in plan.tables.port:
        if len(port.axes) != port.repeat:
            remedy = "name as many axes as repeat makes images, or one for all of them"
            raise InputError(path, "port.axis", port.axis, remedy)
    names = [axis for port in plan.tables.of_role("output") for axis in port.axes]
    for axis in names:
        if names.count(axis) > 1:
            remedy = 'two outputs have this axis; name the axis of each output and input: axis = "x"'
            raise InputError(path, "port.axis", axis or None, remedy)
        if axis not in [each for port in plan.tables.of_role("input") for each in port.axes]:
            raise InputError(path, "port.axis", None, f'no input has the axis "{axis}" of this output; add one')
    active = plan.tables.active_axis
    if active and active not in names:
        raise InputError(path, "active_axis", active, f"no output has this axis{suggest(active, names)}")


def _dimension(name: str, given: object, path: Path) -> Parameter:
    """Return a dimension; its kind is that of the unit it is written with."""
    if not name.isidentifier() or name in UNITS or name == "pi":
        remedy = "is no name that arithmetic can use; take letters, digits and _, and neither a unit nor pi"
        raise InputError(path, f"dimensions.{name}", as_written(given), remedy)
    for si, unit, most in _KINDS:
        try:
            value = units.from_text(given, si)
        except ValueError as error:
            why = error
            continue
        return Parameter(name, si, unit, name.replace("_", " "), start=value, plausible=(-most, most))
    remedy = f"{why}; a dimension is a length, an angle or a pure number" if given is not None else "is empty"
    raise InputError(path, f"dimensions.{name}", as_written(given), remedy)


def _require_new(name: str, known: Mapping[str, Any], path: Path) -> None:
    if not name.isidentifier() or name in known or name == "pi":
        remedy = "is a unit, a dimension, or no name; take another name of letters, digits and _"
        raise InputError(path, f"derived.{name}", None, remedy)


def _texts(tables: _Sketch, path: Path) -> Iterator[tuple[str, Text, str]]:
    """Yield every piece of arithmetic: where it stands, the text, and the SI unit it must have."""

    def listed(where: str, texts: Sequence[Text]) -> Iterator[tuple[str, Text, str]]:
        yield from ((f"{where}.{i}", text, "m") for i, text in enumerate(texts, 1))

    yield "plate.thickness", tables.plate.thickness, "m"
    for body in tables.body:
        where = f"body.{body.name}"
        if (body.box is None) == (body.polygon is None):
            raise InputError(path, where, None, 'give its corners: box = ["x0", "y0", "x1", "y1"] or polygon = [...]')
        if body.box is not None:
            yield from listed(f"{where}.box", body.box)
        for i, corner in enumerate(body.polygon or (), 1):
            yield from listed(f"{where}.polygon.{i}", corner)
        if body.polygon is not None and len(body.polygon) < 3:
            raise InputError(path, f"{where}.polygon", None, "has fewer than three corners; add some")
    for flexure in tables.flexure:
        where, by_ends = f"flexure.{flexure.name}", (flexure.start, flexure.end)
        by_middle = (flexure.at, flexure.length)
        if (None in by_ends) == (None in by_middle) or any(by_ends) == any(by_middle):
            remedy = 'say where it is: from = ["x", "y"] and to = ["x", "y"], or at, direction and length'
            raise InputError(path, where, None, remedy)
        if flexure.start is not None and flexure.end is not None:
            yield from listed(f"{where}.from", flexure.start)
            yield from listed(f"{where}.to", flexure.end)
        elif flexure.at is not None and flexure.length is not None:
            yield from listed(f"{where}.at", flexure.at)
            yield f"{where}.direction", flexure.direction, "rad"
            yield f"{where}.length", flexure.length, "m"
        yield f"{where}.thickness", flexure.thickness, "m"
        yield f"{where}.fillet", flexure.fillet, "m"


def _understood(
    text: Text, known: Mapping[str, Any], path: Path, where: str, later: Sequence[str] = ()
) -> tuple[arithmetic.Formula, Any]:
    """Return arithmetic and its value, a quantity of pint; names that are `later` stand below it in the file."""
    plain = _WITH_UNIT.sub(r"(\1 * \2)", str(text))
    try:
        formula = arithmetic.parse(plain)
        for name in formula.names:
            if name in later:
                raise ValueError(f"has {name} in it, which stands at or below it; move the line of {name} up")
            if name not in known:
                names = [each for each in known if each not in UNITS]
                raise ValueError(f"has {name} in it, which is no dimension and no derived one{suggest(name, names)}")
        return formula, formula.evaluate(known)
    except ValueError as error:
        raise InputError(path, where, as_written(text), str(error)) from None


def _require_unit(value: Any, si: str, path: Path, where: str, text: Text) -> None:
    kind = {"m": "length", "rad": "angle"}[si]
    pure = not f"{value.units:~C}"
    if pure or not value.is_compatible_with(si):
        found = "a pure number" if pure else f"in {value.units:~C}"
        remedy = f'is {found}, not a {kind}; write for example "{units.example(si) if si == "m" else "30 deg"}"'
        raise InputError(path, where, as_written(text), remedy)


def _images(table: _Repeated) -> Iterator[tuple[str, Array]]:
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
    found = next((each for each, body in bodies.items() if polygons.alike(body.corners, corners)), None)
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
    outer = ends[(np.abs(ends @ way - reach) < 10 * polygons.NEAR).all(axis=1)]
    if len(outer) != 1:
        remedy = "the body has no one straight side there; give it one that looks this way and lies outermost"
        raise InputError("design", where, side, remedy)
    return np.asarray(outer[0].mean(axis=0))

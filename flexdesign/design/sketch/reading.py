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
from contextlib import suppress
from pathlib import Path
from typing import Any

from flexdesign.core import arithmetic, units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Parameter
from flexdesign.core.toml_files import as_written, check
from flexdesign.design.sketch.plan import UNITS, Expression, Plan
from flexdesign.design.sketch.tables import SketchTables, Text

#: Tables of a design that belong to its sketch.
KEYS = ("plate", "derived", "body", "flexure", "port", "active_axis")
_WITH_UNIT = re.compile(rf"(?<![\w.])(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+)\s*({'|'.join(UNITS)})\b")
#: What dimensions may be: SI unit, unit shown, largest magnitude.
_KINDS = (("m", "mm", 1.0), ("rad", "deg", 2 * math.pi), ("1", "", 1e6))
#: What arithmetic gives, by its SI unit: the word, and how one is written.
_EXAMPLES = {"m": ("a length", "1.5 mm"), "rad": ("an angle", "30 deg")}


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
    tables = check(SketchTables, content, path)
    if not dimensions:
        raise InputError(path, "dimensions", None, "is empty; name at least one length that the sketch uses")
    known = {name: _dimension(name, value, path) for name, value in dimensions.items()}
    values = {name: units.quantity(1.0, unit) for name, (unit, _) in UNITS.items()}
    values |= {p.name: units.quantity(p.start, p.si) for p in known.values()}
    named = {f"dimensions.{name}": given for name, given in dimensions.items()}
    named |= {f"derived.{name}": text for name, text in tables.derived.items()}
    expressions: dict[str, Expression] = {}
    for name, text in tables.derived.items():
        _require_new(name, values, path)
        later = [each for each in tables.derived if each not in values]
        formula, value = _understood(text, values, path, f"derived.{name}", later)
        expressions[f"derived.{name}"] = Expression(formula, f"derived.{name}")
        values[name] = value
    for where, text, si in _texts(tables, path):
        formula, value = _understood(text, values, path, where)
        if not (value.magnitude == 0 and not f"{value.units:~C}"):  # a bare 0 is any nothing
            pure = _pure_name(formula, value, values)
            field = next((field for field in named if field.partition(".")[2] == pure), where)
            _require_unit(value, si, path, where, text, (field, named.get(field)))
        expressions[where] = Expression(formula, where)
    _require_used(expressions, named, path)
    plan = Plan(tables, tuple(known.values()), expressions)
    _require_axes(plan, path)
    return plan


def _require_used(expressions: Mapping[str, Expression], named: Mapping[str, object], path: Path) -> None:
    """Refuse a dimension or a derived one that no arithmetic names: a misspelt one would change nothing."""
    used = {name for expression in expressions.values() for name in expression.formula.names}
    for field, given in named.items():
        name = field.partition(".")[2]
        if name not in used:
            remedy = f"is used nowhere in the sketch: use it, or leave it out{suggest(name, sorted(used - set(UNITS)))}"
            raise InputError(path, field, as_written(given), remedy)


def _require_axes(plan: Plan, path: Path) -> None:
    has_inputs = bool(plan.tables.of_role("input"))
    for role in ("ground", "output"):
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
        if has_inputs and axis not in [each for port in plan.tables.of_role("input") for each in port.axes]:
            raise InputError(path, "port.axis", None, f'no input has the axis "{axis}" of this output; add one')
    active = plan.tables.active_axis
    if active and active not in names:
        unnamed = f'; leave it out, or write axis = "{active}" in the output and its input'
        remedy = f"no output has this axis{suggest(active, names) if any(names) else unnamed}"
        raise InputError(path, "active_axis", active, remedy)


def _dimension(name: str, given: object, path: Path) -> Parameter:
    """Return a dimension; its kind is that of the unit it is written with."""
    if not name.isidentifier() or name in UNITS or name == "pi":
        remedy = "is no name that arithmetic can use; take letters, digits and _, and neither a unit nor pi"
        raise InputError(path, f"dimensions.{name}", as_written(given), remedy)
    for si, unit, most in _KINDS:
        try:
            value = units.from_text(given, si)
        except ValueError as error:
            why = str(error).partition(";")[0]
            continue
        return Parameter(name, si, unit, name.replace("_", " "), start=value, plausible=(-most, most))
    with suppress(ValueError):  # else what the last kind says of it is true: it is no number, or has no known unit
        why = f"is in {units.quantity_from_text(given).units:~C}"
    remedy = f'{why}; a dimension is a length ("1.5 mm"), an angle ("30 deg") or a pure number (3)'
    raise InputError(path, f"dimensions.{name}", as_written(given), remedy)


def _require_new(name: str, known: Mapping[str, Any], path: Path) -> None:
    if not name.isidentifier() or name in known or name == "pi":
        remedy = "is a unit, a dimension, or no name; take another name of letters, digits and _"
        raise InputError(path, f"derived.{name}", None, remedy)


def _texts(tables: SketchTables, path: Path) -> Iterator[tuple[str, Text, str]]:
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
        if flexure.depth is not None:
            yield f"{where}.depth", flexure.depth, "m"
    for i, port in enumerate(tables.port, 1):
        if (port.side is None) == (port.at is None):
            remedy = 'say which side it is: side = "-x", or at = ["x", "y"], a point on the side'
            raise InputError(path, f"port.{i}.side", port.side, remedy)
        yield from listed(f"port.{i}.at", port.at or ())


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


def _pure_name(formula: arithmetic.Formula, value: Any, known: Mapping[str, Any]) -> str | None:
    """Return the one name of a formula that is a pure number if both are: it may be what lacks a unit."""
    names = [name for name in formula.names if name not in UNITS]
    pure = not f"{value.units:~C}" and len(names) == 1 and not f"{known[names[0]].units:~C}"
    return names[0] if pure else None


def _require_unit(value: Any, si: str, path: Path, where: str, text: Text, to_blame: tuple[str, object]) -> None:
    """Refuse what is not in the unit that is needed where it stands; `to_blame` may be a dimension instead."""
    kind, example = _EXAMPLES[si]
    field, given = to_blame
    pure = not f"{value.units:~C}"
    if pure and field != where:
        remedy = f'is a pure number, and {where} = {text} needs {kind}; write for example "{example}"'
        raise InputError(path, field, as_written(given), remedy)
    if pure or not value.is_compatible_with(si):
        found = "a pure number" if pure else f"in {value.units:~C}"
        remedy = f'is {found}, not {kind}; write for example "{example}"'
        raise InputError(path, where, as_written(text), remedy)

"""Files of static measurements: CSV with ``quantity, value, unit, sigma, boundary`` and columns for dimensions.

Those of a whole stage have a column ``axis`` besides.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Quantity
from flexdesign.core.toml_files import Bounds
from flexdesign.design.design import Design
from flexdesign.measurements import static_conditions

#: What can be measured: SI unit, which port's boundary it names, and in words.
QUANTITIES: Mapping[str, tuple[str, str, str]] = {
    "K_in": ("N/m", "output", "input stiffness"),
    "lambda": ("1", "output", "amplification"),
    "K_out": ("N/m", "input", "output stiffness"),
}
#: What else can be measured of a part under a load at its output, however large: SI unit, and in words.
DISPLACEMENTS: Mapping[str, tuple[str, str]] = {
    "u_x": ("m", "displacement along x"),
    "u_y": ("m", "displacement along y"),
    "theta_z": ("rad", "rotation about z"),
}
#: The load: columns and their SI units; and the boundary of such a row.
LOADS: Mapping[str, str] = {"F_x": "N", "F_y": "N", "M_z": "N m"}
LOADED = "loaded"
#: Boundaries as files may write them, and in full.
BOUNDARIES: Mapping[str, Mapping[str, str]] = {
    "output": {"free": "output free", "held": "output held"},
    "input": {"free": "input free", "held": "input held", "actuator": "actuator installed"},
}
#: The same of a stage, whose boundaries begin with the axis: ``x, table free``.
STAGE_BOUNDARIES: Mapping[str, Mapping[str, str]] = {
    "output": {"free": "table free"},
    "input": {"free": "inputs free", "held": "inputs held", "actuator": "actuators installed"},
}
HEAD = ("quantity", "value", "unit", "sigma", "boundary")
AXIS = "axis"
_DIMENSION = re.compile(r"(\w+)\s*\[\s*([^\[\]]+?)\s*\]$")


@dataclass(frozen=True)
class Row:
    """One measurement.

    Parameters
    ----------
    quantity, boundary
        As in `Quantity`: ``K_out``, ``input held``; of a stage ``x, inputs held``.
    value
        SI.
    sigma
        Its standard deviation, SI; None where not stated.
    unit
        The unit in which it was written.
    dimensions
        Those in which the part differs from the design, SI.
    numbers
        Names of those that are no lengths but numbers, such as how many branches there are.
    load
        Force along x and y [N] and moment about z [N m] at the output, of a displacement; None of a stiffness.
    """

    quantity: str
    boundary: str
    value: float
    sigma: float | None
    unit: str
    dimensions: Mapping[str, float] = field(default_factory=dict)
    numbers: frozenset[str] = frozenset()
    load: tuple[float, ...] | None = None

    @property
    def part(self) -> tuple[tuple[str, float], ...]:
        """What distinguishes its part from others: the dimensions that differ."""
        return tuple(sorted(self.dimensions.items()))

    @property
    def key(self) -> str:
        """Name and boundary in one word, as `Quantity.key`."""
        return Quantity(self.quantity, self.value, "", "", self.boundary).key

    @property
    def kind(self) -> str:
        """The key without the axis of a stage."""
        return Quantity(self.quantity, self.value, "", "", self.boundary.rpartition(", ")[2]).key


@dataclass(frozen=True, eq=False)
class StaticTable:
    """Measurements of one design and its variants; an `Observation`.

    Parameters
    ----------
    name
        The stem of its file.
    rows
        One for each measurement.
    role
        Whether the table is fitted or used for validation.
    """

    name: str
    rows: tuple[Row, ...]
    role: Literal["identify", "validate"] = "identify"

    def measured(self) -> Array:
        """Return the values, SI."""
        return np.array([row.value for row in self.rows])

    def without(self, left_out: int) -> StaticTable:
        """Return the table without one row."""
        return StaticTable(self.name, tuple(row for i, row in enumerate(self.rows) if i != left_out), self.role)


def read(paths: Iterable[Path], design: Design) -> StaticTable:
    """Read files of static measurements of one design into one table.

    Raises
    ------
    InputError
        If a file cannot be read, a column or cell cannot be used, or there is no row.
    """
    paths = list(paths)
    rows = [row for path in paths for row in _read(path, design)]
    return StaticTable("+".join(path.stem for path in paths), tuple(rows))


def measurable(design: Design) -> list[tuple[str, str]]:
    """Return quantity and boundary of everything that can be measured of a design."""
    found = []
    for axis in _axes(design) or ("",):
        for quantity, (_, port, _) in QUANTITIES.items():
            for boundary in (STAGE_BOUNDARIES if axis else BOUNDARIES)[port].values():
                if (quantity, boundary) != ("lambda", "output held") and (
                    "actuator" not in boundary or design.actuator
                ):
                    found.append((quantity, f"{axis}, {boundary}" if axis else boundary))
    return found


def _axes(design: Design) -> tuple[str, ...]:
    return tuple(design.stage().assembly().axes) if design.is_stage else ()


def to_csv(found: Sequence[Quantity], design: Design | None = None) -> str:
    """Return quantities as a file that `read` takes; those that no table holds are left out.

    What overrides changed of the `design` goes with them: dimensions in columns, material, actuator and part in
    comments, which `read` compares with its design.
    """
    stream = io.StringIO()
    changed = static_conditions.overrides_of(design) if design else {}
    dimensions = static_conditions.dimensions(design) if design else {}
    stream.write("".join(f"# {name}: {text}\n" for name, text in changed.items()))
    writer = csv.writer(stream, lineterminator="\n")
    of_stage = any(", " in quantity.boundary for quantity in found)
    writer.writerow([*HEAD, *([AXIS] if of_stage else []), *dimensions])
    for quantity in found:
        axis, _, boundary = quantity.boundary.rpartition(", ")
        port = QUANTITIES.get(quantity.name, ("", "", ""))[1]
        if bool(axis) == of_stage and boundary in (STAGE_BOUNDARIES if axis else BOUNDARIES).get(port, {}).values():
            scale = units.factor(quantity.unit or "1", quantity.si)
            sigma = "" if quantity.half_width is None else f"{quantity.half_width / scale:.6g}"
            value = f"{quantity.value / scale:.8g}"
            cells = [quantity.name, value, quantity.unit or "1", sigma, boundary]
            writer.writerow([*cells, *([axis] if of_stage else []), *dimensions.values()])
    return stream.getvalue()


def lines_of(path: Path) -> tuple[str, list[str], list[tuple[int, list[str]]]]:
    """Return the text of a file, its header, and its further lines with their numbers; comments are left out.

    Raises
    ------
    InputError
        If it cannot be read, is no CSV or is empty.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(path, "", None, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(path, "", None, "is not UTF-8 text; save it as UTF-8") from error
    try:
        lines = [
            (n, cells) for n, cells in enumerate(csv.reader(text.splitlines()), 1) if cells and not _comment(cells)
        ]
    except csv.Error as error:
        remedy = "is no table in CSV: a line is too long, or a quotation mark stands alone; save it again"
        raise InputError(path, "", None, remedy) from error
    if not lines:
        raise InputError(path, "", None, f"is empty; begin with the header {','.join(HEAD)}")
    (_, head), *body = lines
    return text, [cell.strip() for cell in head], body


def rows_of(
    path: Path, names: Sequence[str], body: Sequence[tuple[int, Sequence[str]]]
) -> list[tuple[int, dict[str, str]]]:
    """Return the cells of each line by their column; header and lines are those of `lines_of`.

    Raises
    ------
    InputError
        If there is no line, or one has more or fewer cells than the header.
    """
    if not body:
        raise InputError(path, "", None, "holds no measurement; write one in each row")
    for line, cells in body:
        if len(cells) != len(names):
            raise InputError(path, f"line {line}", f"{len(cells)} cells", f"the header has {len(names)}")
    return [(line, dict(zip(names, (cell.strip() for cell in cells), strict=True))) for line, cells in body]


def _read(path: Path, design: Design) -> list[Row]:
    text, names, body = lines_of(path)
    static_conditions.refuse_others(path, text, design)
    dimensions, axes = _columns(path, names, design), _axes(design)
    return [_row(path, line, cells, dimensions, axes) for line, cells in rows_of(path, names, body)]


def _comment(cells: Sequence[str]) -> bool:
    return cells[0].lstrip().startswith("#") or not any(cell.strip() for cell in cells)


def _columns(path: Path, names: Sequence[str], design: Design) -> dict[str, tuple[str, Bounds, str]]:
    """Return the columns that hold dimensions: name, bounds and unit of each, by the header cell."""
    head = (*HEAD, AXIS) if design.is_stage else HEAD
    require(path, names, head)
    for name in names:
        if names.count(name) > 1:
            raise InputError(path, "header", name, "two columns have this name")
    known = {p.name: Bounds(p.si, *p.plausible) for p in design.part_class.dimensions}
    found = {}
    for name in names:
        match = _DIMENSION.match(name)
        if name in head or (match and match[1] in LOADS and not design.is_stage):
            continue
        if match is None or match[1] not in known or (known[match[1]].si == "1") != (match[2] == "1"):
            stem = match[1] if match else name
            remedy = f"is neither one of {', '.join(head)} nor a dimension with its unit{suggest(stem, list(known))}"
            raise InputError(path, "header", name, remedy)
        found[name] = (match[1], known[match[1]], match[2])
    return found


def require(path: Path, names: Sequence[str], head: Sequence[str]) -> None:
    """Refuse a header that lacks one of some columns; ``sigma`` may be left out."""
    for required in (name for name in head if name != "sigma"):
        if required not in names:
            remedy = f"there is no column {required}; the header is {','.join(head)} and dimensions such as t [mm]"
            raise InputError(path, "header", None, remedy)


def measurement(
    path: Path, line: int, cells: Mapping[str, str], others: Collection[str] = DISPLACEMENTS
) -> tuple[str, float, float | None]:
    """Return quantity, value and standard deviation of a row, SI; of the last None where nobody says.

    Parameters
    ----------
    path, line, cells
        The file, the line and its cells.
    others
        Which displacements may be measured.

    Raises
    ------
    InputError
        If one of them cannot be used.
    """
    quantity = cells["quantity"]
    if quantity not in QUANTITIES and quantity not in others:
        remedy = f"is no quantity of static tables{suggest(quantity, [*QUANTITIES, *others])}"
        raise InputError(path, f"line {line}, column quantity", quantity, remedy)
    si = QUANTITIES[quantity][0] if quantity in QUANTITIES else DISPLACEMENTS[quantity][0]
    unit = cells["unit"] or "1"
    value = _number(path, line, "value", cells["value"], unit, si)
    sigma = _number(path, line, "sigma", cells["sigma"], unit, si, value) if cells.get("sigma") else None
    if quantity in QUANTITIES and quantity != "lambda" and value <= 0:
        raise InputError(path, f"line {line}, column value", cells["value"], "a stiffness is above zero")
    if value == 0:
        remedy = "an amplification is not zero" if quantity == "lambda" else "is zero; leave the row out"
        raise InputError(path, f"line {line}, column value", cells["value"], remedy)
    if sigma is not None and not 0 < sigma < math.inf:
        raise InputError(path, f"line {line}, column sigma", cells["sigma"], "is one standard deviation, above zero")
    return quantity, value, sigma


def _row(
    path: Path,
    line: int,
    cells: Mapping[str, str],
    dimensions: Mapping[str, tuple[str, Bounds, str]],
    axes: Sequence[str],
) -> Row:
    quantity, value, sigma = measurement(path, line, cells, () if axes else DISPLACEMENTS)
    port = QUANTITIES[quantity][1] if quantity in QUANTITIES else "output"
    unit = cells["unit"] or "1"
    read = {}
    for column, (name, bounds, its_unit) in dimensions.items():
        if cells[column]:
            try:
                read[name] = bounds.read(float(cells[column]) if its_unit == "1" else f"{cells[column]} {its_unit}")
            except ValueError as error:
                raise InputError(path, f"line {line}, column {column}", cells[column], str(error)) from None
    if quantity in DISPLACEMENTS:
        return Row(quantity, LOADED, value, sigma, unit, read, _pure(dimensions, read), _load(path, line, cells))
    boundary = _boundary(path, line, cells["boundary"], port, quantity, STAGE_BOUNDARIES if axes else BOUNDARIES)
    if axes:
        axis = cells[AXIS]
        if axis not in axes:
            remedy = f"is no axis of this stage{suggest(axis, list(axes))}"
            raise InputError(path, f"line {line}, column {AXIS}", axis or None, remedy)
        boundary = f"{axis}, {boundary}"
    return Row(quantity, boundary, value, sigma, unit, read, _pure(dimensions, read))


def _pure(dimensions: Mapping[str, tuple[str, Bounds, str]], read: Mapping[str, float]) -> frozenset[str]:
    return frozenset(name for name, _, its_unit in dimensions.values() if name in read and its_unit == "1")


def _load(path: Path, line: int, cells: Mapping[str, str]) -> tuple[float, ...]:
    """Return the load of a displacement, SI; a component without a column, or an empty cell, is zero."""
    if cells["boundary"] != LOADED:
        remedy = f"a displacement is measured under a load: write {LOADED}, and the load in columns such as F_y [N]"
        raise InputError(path, f"line {line}, column boundary", cells["boundary"] or None, remedy)
    found = dict.fromkeys(LOADS, 0.0)
    for column, cell in cells.items():
        match = _DIMENSION.match(column)
        if match and match[1] in LOADS and cell:
            try:
                found[match[1]] = float(cell) * units.factor(match[2], LOADS[match[1]])
            except ValueError as error:
                raise InputError(path, f"line {line}, column {column}", cell, str(error)) from None
    if not any(found.values()) or not all(map(math.isfinite, found.values())):
        remedy = "a displacement needs a finite load that is not zero, in columns F_x [N], F_y [N] or M_z [N m]"
        raise InputError(path, f"line {line}", None, remedy)
    return tuple(found.values())


def _boundary(
    path: Path, line: int, given: str, port: str, quantity: str, every: Mapping[str, Mapping[str, str]]
) -> str:
    known = every[port]
    full = known.get(given) or (given if given in known.values() else None)
    if full is None:
        remedy = f"says how the {port} was held as {quantity} was measured: {', '.join(known)}"
        raise InputError(path, f"line {line}, column boundary", given or None, remedy)
    if quantity == "lambda" and full == "output held":
        raise InputError(path, f"line {line}, column boundary", given, "an output that is held does not move: free")
    return full


def _number(path: Path, line: int, column: str, text: str, unit: str, si: str, of: float | None = None) -> float:
    """Return a cell in SI; a share of the value where it ends in a percent sign."""
    place = f"line {line}, column {column}"
    try:
        if of is not None and text.endswith("%"):
            return float(text[:-1]) / 100 * abs(of)
        number = float(text)
    except ValueError:
        raise InputError(path, place, text or None, "is no number; decimals have a point") from None
    try:
        scale = units.factor(unit, si)
    except ValueError as error:
        raise InputError(path, f"line {line}, column unit", unit, str(error)) from None
    if not math.isfinite(number * scale):
        raise InputError(path, place, text, "is not finite; leave the row out")
    return number * scale

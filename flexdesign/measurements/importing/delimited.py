"""Tables in text as instruments and spreadsheets write them: any separator, decimal commas, lines above the header."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from flexdesign.core import unit_tables
from flexdesign.core.errors import InputError
from flexdesign.measurements.importing.contents import Array, Variable, stored

#: What cells may be separated by; the last one is any white space.
SEPARATORS = (";", "\t", ",", " ")
#: Rows from which the separator is told.
SAMPLE = 20
#: Units of more letters are words, in which capitals mean nothing: mV is not MV, but Volt is volt.
LONGEST_SYMBOL = 3
_WHOLE_CELL = re.compile(r"(.*?)\s*[\[(]\s*([^\[\]()]*?)\s*[\])]$")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?$")


@dataclass(frozen=True)
class Dialect:
    """How a table is written; None where it is found out.

    Parameters
    ----------
    separator
        Between cells: a character, or a space for any white space.
    decimal
        ``.`` or ``,``.
    skip
        Lines above the header row.
    encoding
        Of the text; UTF-8 and UTF-16 are recognised, else Windows' western European.
    """

    separator: str | None = None
    decimal: str | None = None
    skip: int | None = None
    encoding: str | None = None


def read(path: Path, dialect: Dialect = Dialect()) -> tuple[dict[str, Variable], tuple[str, ...]]:
    """Return the columns of a table by name, and the lines above its header.

    Header lines are those before the first row of numbers that have as many cells, whatever their number: a line whose
    cells are all units gives the units, the line above it the names. A unit may stand behind its name in brackets,
    ``x [um]`` or ``x (um)``. Columns without a name are called ``column 1`` and so on. Empty cells, and words where a
    number should be, are NaN.

    Raises
    ------
    InputError
        If there are no rows of numbers, or rows differ in length.
    """
    lines = [line.rstrip("\r") for line in _decoded(path, dialect.encoding).split("\n")][dialect.skip or 0 :]
    kept = [line for line in lines if line.strip()]
    separator = dialect.separator or _separator(kept)
    table = [_cells(line.lstrip("#% ") if line[0] in "#%" else line, separator) for line in kept]
    decimal = dialect.decimal or _decimal(table)
    first = next((k for k, row in enumerate(table) if _is_numbers(row, decimal)), None)
    if first is None:
        remedy = "has no row of numbers; say in [text] how it is written (separator, decimal, skip, encoding)"
        raise InputError(path, "", None, remedy)
    if all(len(row) > 1 and not row[-1] for row in table[first:]):  # every row ends in a separator
        table = [row[:-1] if row and not row[-1] else row for row in table]
    width, rows = len(table[first]), table[first:]
    if ragged := next((k for k, row in enumerate(rows) if len(row) != width), None):
        remedy = f"has {len(rows[ragged])} cells where the first row of numbers has {width}"
        raise InputError(path, f"row {ragged + 1} of numbers", kept[first + ragged], f"{remedy}; remove or complete it")
    numbers = np.array([[_number(cell, decimal) for cell in row] for row in rows])
    above = [k for k in range(first) if (len(table[k]) == width and width > 1) or (k == first - 1 and width == 1)]
    headers = _headers([table[k] for k in above])
    names, units = _names([table[above[k]] for k in headers], width)
    notes = tuple(line.strip() for k, line in enumerate(kept[:first]) if k not in [above[k] for k in headers])
    return {name: stored(numbers[:, k], units[k]) for k, name in enumerate(names)}, notes


def _decoded(path: Path, encoding: str | None) -> str:
    data = path.read_bytes()
    if encoding is None:
        wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
        for encoding in ("utf-16",) if wide else ("utf-8-sig", "cp1252"):
            try:
                return data.decode(encoding)
            except UnicodeDecodeError:
                continue
        raise InputError(path, "", None, 'is no text in UTF-8, UTF-16 or CP1252; say encoding = "..." in [text]')
    try:
        return data.decode(encoding)
    except (UnicodeDecodeError, LookupError) as error:
        raise InputError(path, "text.encoding", encoding, f"does not fit: {error}") from error


def _separator(lines: Sequence[str]) -> str:
    """Return the separator that gives most of the last lines one number of cells, more than one."""
    sample = lines[-SAMPLE:]
    for separator in SEPARATORS:
        counts = Counter(len(_cells(line, separator)) for line in sample)
        cells, times = counts.most_common(1)[0] if counts else (1, 0)
        if cells > 1 and times >= 0.8 * len(sample):
            return separator
    return ","


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        cells = line.split()
    elif '"' in line:  # a separator between quotation marks is none
        cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
    else:
        cells = line.split(separator)
    return [cell.strip().strip('"').strip() for cell in cells]


def _decimal(table: Sequence[Sequence[str]]) -> str:
    cells = [cell for row in table[-SAMPLE:] for cell in row]
    return "," if any(_DECIMAL_COMMA.match(cell) for cell in cells) else "."


def _number(cell: str, decimal: str) -> float:
    try:
        return float(cell.replace(".", "").replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return np.nan


def _is_numbers(row: Sequence[str], decimal: str) -> bool:
    """Tell whether all cells but empty ones are numbers, and one is."""
    filled: Array = np.array([_number(cell, decimal) for cell in row if cell])
    return len(filled) > 0 and not np.isnan(filled).any()


def _headers(lines: Sequence[Sequence[str]]) -> list[int]:
    """Return which of the header lines has the names and, behind it, which the units, if one has.

    Without a line of units it is the last two, as names and as what stands below them; of three lines or more it is the
    last one, of which the others are titles.
    """
    of_units = next((k for k in range(len(lines) - 1, 0, -1) if _are_units(lines[k])), None)
    if of_units is not None:
        return [of_units - 1, of_units]
    last = list(range(len(lines)))
    return last[-1:] if len(last) > 2 else last[-2:]


def _are_units(cells: Sequence[str]) -> bool:
    """Tell whether all cells but empty ones name a unit, and one does."""
    filled = [cell.strip("[]() ") for cell in cells if cell.strip("[]() ")]
    return bool(filled) and all(_unit(cell) for cell in filled)


def _unit(cell: str) -> str:
    """Return the unit that a cell names, also as instruments write it: ``Volt``, ``second``; empty if none."""
    for written in (cell, cell.lower() if len(cell) > LONGEST_SYMBOL else cell):
        try:
            unit_tables.si_of(written)
        except ValueError:
            continue
        return written
    return ""


def _names(headers: Sequence[Sequence[str]], width: int) -> tuple[list[str], list[str]]:
    """Return names and units of the columns from at most two lines above the numbers."""
    titles = [*(headers[0] if headers else ()), *[""] * width][:width]
    below = list(headers[1]) if len(headers) > 1 else [""] * width
    names, units = [], []
    for k, (title, unit) in enumerate(zip(titles, below, strict=True)):
        match = _WHOLE_CELL.match(title) if len(title) <= unit_tables.LONGEST else None
        name = match[1] if match else title
        unit = (match[2] if match else "") or unit.strip("[]() ")
        if not name or name in names:
            name = f"{name} {k + 1}" if name else f"column {k + 1}"
        names.append(name)
        units.append(_unit(unit) or unit)
    return names, units

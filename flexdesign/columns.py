"""Tables of numbers in CSV files whose header cells carry the unit: ``x [um]``. Lines that start with # are comments.

Reading is fast as long as all is well. When it is not, the file is gone through again, cell by cell, to name the place.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexdesign import units
from flexdesign.errors import InputError

Array = NDArray[np.float64]
#: What a column may measure if nothing is known about it from its name.
ANY = ("m", "V", "s", "A", "N", "K", "Hz", "rad", "m/s", "m/s^2", "V/s", "Pa", "1")
#: Temperatures do not count from zero: unit -> what has to be added to get K.
_ZEROS = {"degC": 273.15, "°C": 273.15, "K": 0.0}
_CELL = re.compile(r"([^\[\]]*?)\s*\[\s*([^\[\]]*?)\s*\]$")


@dataclass(frozen=True, eq=False)
class Sheet:
    """The columns of one file.

    Parameters
    ----------
    path
        Where they come from.
    values
        By name, in SI; read-only arrays of one length, all finite.
    si, unit
        SI unit of the values, and the unit that the header gives, by name.
    lines
        The line of the file in which each row stands, counted from 1.
    """

    path: Path
    values: Mapping[str, Array]
    si: Mapping[str, str]
    unit: Mapping[str, str]
    lines: NDArray[np.intp]

    def time(self) -> Array:
        """Return the column ``t`` [s].

        Raises
        ------
        InputError
            If there is none, or time does not increase from row to row.
        """
        if "t" not in self.values:
            remedy = f"there is no column t [s]; found {', '.join(self.values)}: add the time of each row"
            raise InputError(self.path, "header", None, remedy)
        time = self.values["t"]
        back = np.flatnonzero(np.diff(time) <= 0)
        if back.size:
            row = int(back[0]) + 1
            remedy = f"is not later than the row before ({time[row - 1]:.9g} s); sort the rows, remove doubles"
            raise self.refusal(row, "t", f"{time[row]:.9g} s", remedy)
        return time

    def refusal(self, row: int, column: str, value: object, remedy: str) -> InputError:
        """Return the error that names one cell, by the line of the file it stands in."""
        return InputError(self.path, f"line {self.lines[row]}, column {column}", value, remedy)


def read(path: Path, allowed: Mapping[str, Sequence[str]]) -> Sheet:
    """Read a CSV file.

    Parameters
    ----------
    path
        The file; UTF-8, cells separated by commas, decimals with a point.
    allowed
        Which SI units a column may have, by name; others may have any of `ANY`.

    Raises
    ------
    InputError
        If the file cannot be read, a header cell lacks its unit or has a wrong one, two columns share a name, rows are
        ragged, or a cell is empty, no number or not finite. It names the line and the column.
    """
    text = _text(path)
    kept = [bool(line.strip()) and not line.lstrip().startswith("#") for line in text]
    lines = np.flatnonzero(kept) + 1
    if not lines.size:
        raise InputError(path, "", None, "is empty; it needs a header such as t [s],u [V],x [um], and rows of numbers")
    header, *rows = compress(text, kept)
    columns = _columns(path, int(lines[0]), header, allowed)
    if not rows:
        raise InputError(path, "", None, "has a header and no rows; add rows of numbers")
    try:
        numbers = np.loadtxt(rows, delimiter=",", ndmin=2, dtype=np.float64)
    except ValueError as error:
        _complain(path, list(columns), lines[1:], rows)
        raise InputError(path, "", None, f"cannot be read as numbers: {error}") from error
    if numbers.shape != (len(rows), len(columns)) or not np.isfinite(numbers).all():
        _complain(path, list(columns), lines[1:], rows)
    values = {}
    for number, (name, (unit, si)) in enumerate(columns.items()):
        values[name] = _in_si(numbers[:, number], unit, si)
        values[name].setflags(write=False)
    of_si, of_unit = ({name: pair[k] for name, pair in columns.items()} for k in (1, 0))
    return Sheet(path, values, of_si, of_unit, lines[1:])


def write(path: Path, columns: Mapping[str, Array], comment: str = "") -> None:
    """Write a CSV file, whole or not at all.

    Parameters
    ----------
    path
        Where to; a file that is there is replaced.
    columns
        By header cell, such as ``x [um]``: the values in SI, which are written in the unit of the cell.
    comment
        Lines that go above the header.

    Raises
    ------
    ValueError
        If a header cell has no unit that can be written, lengths differ, or a value is not finite.
    InputError
        If the file cannot be written.
    """
    written = []
    for cell, values in columns.items():
        _, unit = split(cell)
        written.append(_from_si(np.asarray(values, dtype=np.float64), unit, si_of(unit, ANY)))
    if not written or {column.shape for column in written} != {(written[0].size,)}:
        raise ValueError(f"columns of one length are needed, found {[column.shape for column in written]}")
    table = np.column_stack(written)
    if not np.isfinite(table).all():
        raise ValueError("a value that is not finite cannot be written")
    remarks = "".join(f"# {line}\n" for line in comment.splitlines())
    try:
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".writing-") as scratch:
            new = Path(scratch) / path.name
            # Twelve digits: time on a fine grid far from its zero keeps its steps.
            np.savetxt(new, table, "%.12g", ",", header=remarks + ",".join(columns), comments="", encoding="utf-8")
            new.replace(path)
    except OSError as error:
        raise InputError(path, "", None, f"cannot be written: {error.strerror}; choose another place") from error


def split(cell: str) -> tuple[str, str]:
    """Return name and unit of a header cell.

    Raises
    ------
    ValueError
        If it is not written as ``name [unit]``.

    >>> split("x [um]")
    ('x', 'um')
    """
    match = _CELL.match(cell.strip().strip('"').strip())
    if not match or not match[1] or not match[2]:
        raise ValueError("write name and unit, for example x [um]; [1] for a pure number")
    return match[1], match[2]


def si_of(unit: str, allowed: Sequence[str] = ANY) -> str:
    """Return which of the `allowed` SI units belongs to `unit`.

    Raises
    ------
    ValueError
        If none does; the message says why.

    >>> si_of("mV")
    'V'
    """
    if unit in _ZEROS and "K" in allowed:
        return "K"
    first: ValueError | None = None
    for si in allowed:
        try:
            units.factor(unit, si)
        except ValueError as error:
            first = first or error
        else:
            return si
    raise ValueError(f"{first}; expected a unit like {' or '.join(allowed)}")


def _in_si(values: Array, unit: str, si: str) -> Array:
    return values + _ZEROS[unit] if unit in _ZEROS else values * units.factor(unit, si)


def _from_si(values: Array, unit: str, si: str) -> Array:
    return values - _ZEROS[unit] if unit in _ZEROS else values / units.factor(unit, si)


def _text(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8-sig").split("\n")
    except OSError as error:
        raise InputError(path, "", None, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        raise InputError(path, "", None, f"is not UTF-8 text (line {line}); save it as CSV in UTF-8") from error


def _columns(path: Path, line: int, header: str, allowed: Mapping[str, Sequence[str]]) -> dict[str, tuple[str, str]]:
    """Return unit and SI unit of each column, by name, in the order of the file."""
    if "," not in header and (";" in header or "\t" in header):
        raise InputError(path, f"line {line}", header, "separate cells by commas, and write decimals with a point")
    columns: dict[str, tuple[str, str]] = {}
    for number, cell in enumerate(header.split(","), start=1):
        place = f"line {line}, header cell {number}"
        try:
            name, unit = split(cell)
            si = si_of(unit, allowed.get(name, ANY))
        except ValueError as error:
            raise InputError(path, place, cell.strip() or '""', str(error)) from error
        if name in columns:
            raise InputError(path, place, cell.strip(), f"there are two columns {name}; rename or remove one")
        columns[name] = (unit, si)
    return columns


def _complain(path: Path, names: Sequence[str], lines: NDArray[np.intp], rows: Sequence[str]) -> None:
    """Raise the error that names the first bad cell, if one is found."""
    for line, row in zip(lines, rows, strict=True):
        cells = row.partition("#")[0].split(",")
        if len(cells) != len(names):
            remedy = f"has {len(cells)} cells where the header has {len(names)}; give one cell for each column"
            raise InputError(path, f"line {line}", row.strip(), remedy)
        for name, cell, wrong in _wrong(names, cells):
            raise InputError(path, f"line {line}, column {name}", cell, f"{wrong}; correct the cell or remove the rows")


def _wrong(names: Sequence[str], cells: Sequence[str]) -> Iterator[tuple[str, str, str]]:
    for name, cell in zip(names, (cell.strip() for cell in cells), strict=True):
        try:
            if not np.isfinite(float(cell)):
                yield name, cell, "is not a finite number"
        except ValueError:
            yield name, cell or '""', "is not a number" if cell else "is empty"

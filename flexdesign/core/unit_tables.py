"""Tables of numbers whose header cells carry the unit, ``x [um]``: CSV files, or Parquet where they are large.

In CSV, lines that start with # are comments. Reading is fast as long as all is well. When it is not, the file is gone
through again, cell by cell, to name the place.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import parquet, units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, join_names
from flexdesign.core.whole_files import written_whole

#: What a column may measure if nothing is known about it from its name.
ANY = ("m", "V", "s", "A", "N", "K", "Hz", "rad", "m/s", "m/s^2", "V/s", "Pa", "1")
#: Temperatures do not count from zero: unit -> what has to be added to get K.
KELVIN = {"degC": 273.15, "°C": 273.15, "K": 0.0}
_CELL = re.compile(r"([^\[\]]*?)\s*\[\s*([^\[\]]*?)\s*\]$")
_ANGLE = re.compile("rad|deg|°|arc")
#: What stands in a cell, in small letters, where there is no number.
_MISSING = frozenset(("", "-", "--", "na", "n/a", "null", "none"))
#: No number is larger [SI]; squares of larger ones would have no end.
LARGEST = 1e100
#: No header cell has more letters.
LONGEST = 200
#: Not more stretches of rows than these are named in one sentence.
NAMED = 4


@dataclass(frozen=True, eq=False)
class Sheet:
    """The columns of one file.

    Parameters
    ----------
    path
        Where they come from.
    values
        By name, in SI; read-only arrays of one length, all finite, or NaN where gaps are allowed.
    si, unit
        SI unit of the values, and the unit that the header gives, by name.
    lines
        The line of the file in which each row stands, counted from 1; of a Parquet file the row itself.
    counted
        What `lines` counts: ``"line"`` or ``"row"``.
    """

    path: Path
    values: Mapping[str, Array]
    si: Mapping[str, str]
    unit: Mapping[str, str]
    lines: NDArray[np.intp]
    counted: str = "line"

    def moments(self) -> Array:
        """Return the column ``t`` [s], in whatever order it is.

        Raises
        ------
        InputError
            If there is none.
        """
        if "t" not in self.values:
            remedy = f"there is no column t [s]; found {', '.join(self.values)}: add the time of each row"
            raise InputError(self.path, "header", None, remedy)
        return self.values["t"]

    def time(self) -> Array:
        """Return the column ``t`` [s].

        Raises
        ------
        InputError
            If there is none, or time does not increase from row to row.
        """
        time = self.moments()
        back = np.flatnonzero(np.diff(time) <= 0)
        if back.size:
            row = int(back[0]) + 1
            is_new = row > 1 and time[row] < time[1]  # a clock that begins again
            remedy = "split the file here, as its clock starts again" if is_new else "sort the rows, remove doubles"
            remedy = f"is not later than the row before ({time[row - 1]:.9g} s); {remedy}"
            raise self.cell_error(row, "t", f"{time[row]:.9g} s", remedy)
        return time

    def rows(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> Sheet:
        """Return the sheet with some of its rows, in the order in which they are chosen."""
        values = {name: column[chosen] for name, column in self.values.items()}
        for column in values.values():
            column.setflags(write=False)
        return replace(self, values=values, lines=self.lines[chosen])

    def where(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> str:
        """Return the lines of the file in which some rows stand: ``lines 7, 9 to 12 and 3 more stretches``."""
        lines = np.sort(self.lines[rows])
        stretches = np.split(lines, np.flatnonzero(np.diff(lines) > 1) + 1)
        message = [f"{s[0]}" if len(s) == 1 else f"{s[0]} to {s[-1]}" for s in stretches[:NAMED]]
        if more := len(stretches) - len(message):
            message.append(f"{more} more stretches" if more > 1 else "one more stretch")
        return f"{self.counted}{'s' if len(lines) > 1 else ''} {join_names(message)}"

    def cell_error(self, row: int, column: str, value: object, remedy: str) -> InputError:
        """Return the error that names one cell, by the line of the file it stands in."""
        return InputError(self.path, f"{self.counted} {self.lines[row]}, column {column}", value, remedy)


def read(path: Path, allowed: Mapping[str, Sequence[str]], *, gaps: bool = False, plain: Collection[str] = ()) -> Sheet:
    """Read a CSV file, or a Parquet file whose column names are header cells.

    Parameters
    ----------
    path
        The file; CSV as UTF-8, cells separated by commas, decimals with a point.
    allowed
        Which SI units a column may have, by name; others may have any of `ANY`.
    gaps
        Whether a cell may be empty or not finite: it is NaN then. The time ``t`` may not.
    plain
        Names of columns that are pure numbers, and may stand in the header without a unit.

    Raises
    ------
    InputError
        If the file cannot be read, a header cell lacks its unit or has a wrong one, two columns share a name, rows are
        ragged, or a cell is no number, or empty or not finite where that is not allowed. It names line and column.
    """
    if path.suffix.lower() == parquet.SUFFIX:
        cells, numbers = parquet.read(path)
        columns = _columns(path, "column", _with_units(cells, plain), allowed)
        lines = np.arange(1, len(numbers) + 1)
    else:
        columns, numbers, lines = _from_csv(path, allowed, gaps, plain)
    values = {}
    for number, (name, (unit, si)) in enumerate(columns.items()):
        column = in_si(numbers[:, number], unit, si)
        if gaps:
            column = np.where(np.isfinite(column), column, np.nan)
        column.setflags(write=False)
        values[name] = column
    of_si, of_unit = ({name: pair[k] for name, pair in columns.items()} for k in (1, 0))
    sheet = Sheet(path, values, of_si, of_unit, lines, "row" if path.suffix.lower() == parquet.SUFFIX else "line")
    for name, column in values.items():
        unusable = np.flatnonzero(~np.isfinite(column))
        if unusable.size and (name == "t" or not gaps):
            row = int(unusable[0])
            raise sheet.cell_error(row, name, "nan", "is not a finite number; correct the cell or remove the rows")
        large = np.flatnonzero(np.abs(np.nan_to_num(column)) > LARGEST)
        if large.size:
            value = f"{column[large[0]]:g} {of_si[name]}".removesuffix(" 1")
            raise sheet.cell_error(int(large[0]), name, value, "is more than anything measures; correct the cell")
    return sheet


def write(
    path: Path,
    columns: Mapping[str, Array],
    comment: str = "",
    *,
    gaps: bool = False,
    allowed: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Write a CSV file, or a Parquet file where its name ends so, whole or not at all.

    Parameters
    ----------
    path
        Where to; a file that is there is replaced.
    columns
        By header cell, such as ``x [um]``: the values in SI, which are written in the unit of the cell.
    comment
        Lines that go above the header, or into the metadata.
    gaps
        Whether values may be NaN, in all columns but the first.
    allowed
        Which SI units a column may have, by name; others may have any of `ANY`.

    Raises
    ------
    ValueError
        If a header cell has no unit that can be written, lengths differ, or a value is not finite.
    InputError
        If the file cannot be written.
    """
    written = []
    for cell, values in columns.items():
        name, unit = split(cell)
        si = si_of(unit, (allowed or {}).get(name, ANY))
        written.append(_from_si(np.asarray(values, dtype=np.float64), unit, si))
    if not written or {column.shape for column in written} != {(written[0].size,)}:
        raise ValueError(f"columns of one length are needed, found {[column.shape for column in written]}")
    table = np.column_stack(written)
    if not np.isfinite(table[:, 0]).all() or (np.isinf(table) if gaps else ~np.isfinite(table)).any():
        raise ValueError("a value that is not finite cannot be written")
    remarks = "".join(f"# {line}\n" for line in comment.splitlines())
    try:
        with written_whole(path.parent) as scratch:
            new = scratch / path.name
            if path.suffix.lower() == parquet.SUFFIX:
                parquet.write(new, list(columns), table, comment)
            else:
                # Twelve digits: time on a fine grid far from its zero keeps its steps.
                np.savetxt(new, table, "%.12g", ",", header=remarks + ",".join(columns), comments="", encoding="utf-8")
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
    cell = cell.strip().strip('"').strip()
    match = _CELL.match(cell) if len(cell) <= LONGEST else None
    if not match or not match[1] or not match[2]:
        raise ValueError("write name and unit, for example x [um]; [1] for a pure number")
    return match[1], match[2]


def si_of(unit: str, allowed: Sequence[str] = ANY) -> str:
    """Return which of the `allowed` SI units belongs to `unit`.

    Raises
    ------
    ValueError
        If none does; the message says why.

    >>> si_of("mV"), si_of("urad"), si_of("%")
    ('V', 'rad', '1')
    """
    if unit in KELVIN and "K" in allowed:
        return "K"
    first: ValueError | None = None
    for si in allowed:
        try:
            units.factor(unit, si)
        except ValueError as error:
            first = first or error
        else:
            if si != "rad" or _ANGLE.search(unit):  # to the register of units a percent is an angle as well
                return si
            first = first or ValueError(f"{unit!r} is no unit of angle")
    remedy = f"expected a unit like {' or '.join(allowed)}"
    if tuple(allowed) == ("V",):
        remedy += "; a command that is no voltage, as a current or a force, is written in V, one for one"
    elif any(_measures(unit, f"{si}/{time}") for si in ("m", "rad") if si in allowed for time in ("s", "s^2")):
        remedy += "; a response is a position: integrate a velocity once, an acceleration twice"
    raise ValueError(f"{first}; {remedy}")


def _measures(unit: str, si: str) -> bool:
    """Tell whether values in `unit` convert to an SI unit."""
    try:
        units.factor(unit, si)
    except ValueError:
        return False
    return True


def in_si(values: Array, unit: str, si: str) -> Array:
    """Return values in `unit` as values in the SI unit `si`, temperatures counted from absolute zero."""
    return values + KELVIN[unit] if unit in KELVIN else values * units.factor(unit, si)


def _from_si(values: Array, unit: str, si: str) -> Array:
    return values - KELVIN[unit] if unit in KELVIN else values / units.factor(unit, si)


def _from_csv(
    path: Path, allowed: Mapping[str, Sequence[str]], gaps: bool, plain: Collection[str]
) -> tuple[dict[str, tuple[str, str]], Array, NDArray[np.intp]]:
    """Return unit and SI unit of each column, rows by columns as they are written, and the line of each row."""
    text = _text(path)
    content = [bool(line.strip()) and not line.lstrip().startswith("#") for line in text]
    lines = np.flatnonzero(content) + 1
    if not lines.size:
        raise InputError(path, "", None, "is empty; it needs a header such as t [s],u [V],x [um], and rows of numbers")
    header, *rows = compress(text, content)
    if "," not in header and (";" in header or "\t" in header):
        remedy = "separate cells by commas, and write decimals with a point, or bring it in with flexdesign import"
        raise InputError(path, f"line {lines[0]}", header, remedy)
    columns = _columns(path, f"line {lines[0]}, header cell", _with_units(header.split(","), plain), allowed)
    if not rows:
        raise InputError(path, "", None, "has a header and no rows; add rows of numbers")
    _check_lengths(path, len(columns), lines[1:], rows)
    try:
        numbers = _numbers(rows)
    except ValueError as error:
        _complain(path, list(columns), lines[1:], rows, gaps)
        if not gaps:
            raise InputError(path, "", None, f"cannot be read as numbers: {error}") from error
        try:
            numbers = _numbers([_filled(row) for row in rows])
        except ValueError as again:
            raise InputError(path, "", None, f"cannot be read as numbers: {again}") from again
    if numbers.shape != (len(rows), len(columns)) or not (gaps or np.isfinite(numbers).all()):
        _complain(path, list(columns), lines[1:], rows, gaps)
    return columns, numbers, lines[1:]


def _numbers(rows: Sequence[str]) -> Array:
    return np.loadtxt(rows, delimiter=",", ndmin=2, dtype=np.float64)


def _filled(row: str) -> str:
    cells = row.partition("#")[0].split(",")
    return ",".join("nan" if cell.strip().lower() in _MISSING else cell for cell in cells)


def _text(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8-sig").split("\n")
    except OSError as error:
        raise InputError(path, "", None, f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        remedy = "save it as CSV in UTF-8, or bring it in with flexdesign import"
        raise InputError(path, "", None, f"is not UTF-8 text (line {line}); {remedy}") from error


def _with_units(header: Sequence[str], plain: Collection[str]) -> list[str]:
    """Return header cells, pure numbers with the unit that says so."""
    return [f"{cell} [1]" if cell.strip().strip('"').strip() in plain else cell for cell in header]


def _columns(
    path: Path, place: str, header: Sequence[str], allowed: Mapping[str, Sequence[str]]
) -> dict[str, tuple[str, str]]:
    """Return unit and SI unit of each column, by name, in the order of the file."""
    columns: dict[str, tuple[str, str]] = {}
    for number, cell in enumerate(header, start=1):
        try:
            name, unit = split(cell)
            si = si_of(unit, allowed.get(name, ANY))
        except ValueError as error:
            raise InputError(path, f"{place} {number}", cell.strip() or '""', str(error)) from error
        if name in columns:
            remedy = f"there are two columns {name}; rename or remove one"
            raise InputError(path, f"{place} {number}", cell.strip(), remedy)
        columns[name] = (unit, si)
    return columns


def _check_lengths(path: Path, columns: int, lines: NDArray[np.intp], rows: Sequence[str]) -> None:
    """Raise the error that names the first row with too many or too few cells."""
    for line, row in zip(lines, rows, strict=True):
        if (cells := row.partition("#")[0].count(",") + 1) != columns:
            remedy = f"has {cells} cells where the header has {columns}; give one cell for each column"
            raise InputError(path, f"line {line}", row.strip(), remedy)


def _complain(path: Path, names: Sequence[str], lines: NDArray[np.intp], rows: Sequence[str], gaps: bool) -> None:
    """Raise the error that names the first bad cell, if one is found; a missing number is none where gaps may be."""
    for line, row in zip(lines, rows, strict=True):
        cells = row.partition("#")[0].split(",")
        for name, cell, wrong in _wrong(names, cells, gaps):
            raise InputError(path, f"line {line}, column {name}", cell, f"{wrong}; correct the cell or remove the rows")


def _wrong(names: Sequence[str], cells: Sequence[str], gaps: bool) -> Iterator[tuple[str, str, str]]:
    for name, cell in zip(names, (cell.strip() for cell in cells), strict=True):
        may_be_missing = gaps and name != "t"
        try:
            if not (np.isfinite(float(cell.replace("_", "?"))) or may_be_missing):
                yield name, cell, "is not a finite number"
        except ValueError:
            if not (may_be_missing and cell.lower() in _MISSING):
                yield name, cell or '""', "is not a number" if cell else "is empty"

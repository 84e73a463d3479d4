"""Tables in text as instruments and spreadsheets write them: any separator, decimal commas, lines above the header."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from pathlib import Path

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.measurements.importing import header_cells, moments
from flexdesign.measurements.importing.contents import Variable, from_memory

#: What cells may be separated by; the last one is any white space.
SEPARATORS = (";", "\t", ",", "|", " ")
#: Rows from which the separator is found.
SAMPLE = 20
#: More different words in a column are not the names of channels.
MOST_CHANNELS = 20
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(\.\d{3})+$")
_DECIMAL_COMMA = re.compile(r"[+-]?(\d*|\d{1,3}(\.\d{3})+),\d+([eE][+-]?\d+)?$")
#: The signs before and behind the numbers of a matrix as in MATLAB.
_MATRIX_BEGINS = re.compile(r"\s*([A-Za-z]\w*\s*=\s*)?\[(?=\s*([-+.\d]|\.\.\.|$))")
_MATRIX_ENDS = re.compile(r"\]\s*;?\s*$")


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
    table
        Which table of several in one file, from 1 on.
    """

    separator: str | None = None
    decimal: str | None = None
    skip: int | None = None
    encoding: str | None = None
    table: int | None = None


def read(path: Path, dialect: Dialect = Dialect()) -> tuple[dict[str, Variable], tuple[str, ...], tuple[str, ...]]:
    """Return the columns of a table by name, the lines above its header, and what was left out.

    Header lines are those before the first row of numbers that have as many cells, whatever their number: a line whose
    cells are all units gives the units, the line above it the names. A unit may stand in its name's cell, ``x [um]``,
    ``x (um)`` or ``x_um``: see `header_cells`. Columns without a name are called ``column 1`` and so on; those of words
    are left out, and one that holds a single number is that number. Empty cells, and words where a number should be,
    are NaN. Times of day become seconds since the first.

    Raises
    ------
    InputError
        If there are no rows of numbers, rows differ in length, or there are several tables and none is chosen.
    """
    lines = [line.rstrip("\r") for line in _decode(path, dialect.encoding).split("\n")][dialect.skip or 0 :]
    content = _without_brackets(_unquoted([line for line in lines if line.strip()]))
    numbered = np.array(
        [k for k, line in enumerate(lines, start=1 + (dialect.skip or 0)) if line.strip()], dtype=np.intp
    )
    separator = dialect.separator or _separator(content)
    table = [_cells(line.lstrip("#% ") if line[0] in "#%" else line, separator) for line in content]
    decimal = dialect.decimal or _decimal(table)
    tables = _tables(table, decimal)
    if dialect.table is not None or len(tables) > 1:
        chosen = _choose(path, table, decimal, tables, dialect.table)
        content, table, numbered = content[chosen], table[chosen], numbered[chosen]
    numeric = _numeric(table, decimal)
    first = next((k for k, row in enumerate(table) if _is_data(row, decimal, numeric)), None)
    if first is None:
        remedy = "has no row of numbers; say in [text] how it is written (separator, decimal, skip, encoding)"
        raise InputError(path, "", None, remedy)
    if all(len(row) > 1 and not row[-1] for row in table[first:]):  # every row ends in a separator
        table = [row[:-1] if row and not row[-1] else row for row in table]
    width, rows = len(table[first]), table[first:]
    cut_off = rows.pop() if len(rows) > 1 and len(rows[-1]) < width else None  # as of a log that was stopped
    if ragged := next((k for k, row in enumerate(rows) if len(row) != width), None):
        remedy = f"has {len(rows[ragged])} cells where the first row of numbers has {width}"
        raise InputError(
            path, f"row {ragged + 1} of numbers", content[first + ragged], f"{remedy}; remove or complete it"
        )
    heads, of_head = _head(table[:first], content[:first], width)
    names, units = _names(heads, width)
    notes = tuple(line.strip() for k, line in enumerate(content[:first]) if k not in of_head)
    found = {}
    for k, name in enumerate(names):
        if k in numeric or not numeric:
            cells = [row[k] for row in rows]
            of_day = _of_day(cells)
            numbers = np.array([_number(cell, decimal) for cell in cells]) if of_day is None else of_day
            made = from_memory(numbers, units[k] if of_day is None else "s")
            found[name] = replace(made, lines=numbered[first : first + len(rows)])
        elif len(alone := [row[k] for row in rows if row[k]]) == 1 and _is_number(alone[0], decimal) and not units[k]:
            found[name] = from_memory(np.array(_number(alone[0], decimal)), "")  # a sampling time next to the table
    if sum(variable.unit != "s" for variable in found.values()) == 1:
        notes += _channels([[row[k] for row in rows] for k in range(width) if k not in numeric])
    left_out = () if cut_off is None else (f"the last line, {content[-1].strip()!r}, is cut off; left out",)
    return found, notes, left_out


def _channels(columns: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """Return notes on columns of words that may name the channel of each row, as in logs of control systems."""
    several = [sorted(set(words)) for words in columns if 1 < len(set(words)) <= MOST_CHANNELS]
    remedy = "if they name channels, whose values stand one below another, write a file with a column for each"
    return tuple(f"a column holds the words {', '.join(words)}: {remedy}" for words in several)


def _tables(table: Sequence[Sequence[str]], decimal: str) -> list[slice]:
    """Return the lines of each table of a file, with the lines above it.

    A line of words below rows of numbers begins another table if at least three rows of numbers follow. It has no
    number; a line of the same word in all cells is a row without values.
    """
    cuts = [k for k, row in enumerate(table) if _is_heading(row, decimal)]
    ends = []
    for begin, end in zip([-1, *cuts], [*cuts, len(table)], strict=True):
        rows = islice((row for row in table[begin + 1 : end] if _is_mostly_numbers(row, decimal)), 3)
        if len(widths := [len(row) for row in rows]) == 3 and len(set(widths)) == 1:
            ends.append(end)
    return [slice(begin, end) for begin, end in pairwise([0, *ends])]


def _is_heading(row: Sequence[str], decimal: str) -> bool:
    filled = [cell for cell in row if cell]
    is_one_word = len(filled) > 1 and len(set(filled)) == 1
    has_letters = any(cell[0].isalpha() and cell.lower() not in ("nan", "inf") for cell in filled)
    return has_letters and not is_one_word and not any(_is_number(cell, decimal) for cell in filled)


def _is_mostly_numbers(row: Sequence[str], decimal: str) -> bool:
    return 2 * sum(_is_number(cell, decimal) for cell in row) > len(row)


def _choose(
    path: Path, table: Sequence[Sequence[str]], decimal: str, found: Sequence[slice], number: int | None
) -> slice:
    """Return the lines of the table that is chosen of several."""
    if number is not None and number <= len(found):
        return found[number - 1]
    if not found:  # the message follows where its rows are read
        return slice(None)
    heads = list[str]()
    for each in found:
        first = next(k for k in range(each.start, each.stop) if _is_mostly_numbers(table[k], decimal))
        heads.append(f"{len(heads) + 1}: {', '.join(filter(None, table[first - 1])) if first else 'without a header'}")
    remedy = f"holds {len(found)} table{'s' * (len(found) != 1)} ({'; '.join(heads)})"
    if number is None:
        raise InputError(path, "", None, f"{remedy}; say which in [text] of a map: table = 1")
    raise InputError(path, "text.table", number, remedy)


def _numeric(table: Sequence[Sequence[str]], decimal: str) -> frozenset[int]:
    """Return which columns hold numbers, or times of day, in at least half of the filled cells of the last rows."""
    sample = table[-SAMPLE:]
    width = Counter(map(len, sample)).most_common(1)[0][0] if sample else 0
    columns = zip(*(row for row in sample if len(row) == width), strict=True)
    found = set()
    for k, column in enumerate(columns):
        filled = [cell for cell in column if cell]
        if filled and 2 * sum(_is_number(cell, decimal) for cell in filled) >= len(filled):
            found.add(k)
    return frozenset(found)


def _is_number(cell: str, decimal: str) -> bool:
    return not (np.isnan(_number(cell, decimal)) and np.isnan(moments.seconds(cell)))


def _is_data(row: Sequence[str], decimal: str, numeric: frozenset[int]) -> bool:
    """Tell whether the cells of the numeric columns are numbers, but for empty ones, and one is."""
    filled = [cell for k, cell in enumerate(row) if cell and (k in numeric or not numeric)]
    return max(numeric, default=0) < len(row) and bool(filled) and all(_is_number(cell, decimal) for cell in filled)


def _of_day(cells: Sequence[str]) -> Array | None:
    """Return a column of times of day as seconds since the first; None of another one."""
    if ":" not in next((cell for cell in cells if cell), ""):
        return None
    times = np.array([moments.seconds(cell) for cell in cells])
    return moments.since_first(times) if np.isfinite(times).any() else None


def _head(
    table: Sequence[Sequence[str]], lines: Sequence[str], width: int
) -> tuple[list[Sequence[str]], frozenset[int]]:
    """Return the header lines, of names and perhaps of units, in cells, and which lines they are."""
    last = len(table) - 1
    above = [
        k
        for k, row in enumerate(table)
        if (len(row) == width > 1) or (k == last and (width == 1 or len(row) == width + 1))
    ]
    if above:
        chosen = [above[k] for k in _headers([table[k] for k in above])]
        return [table[k] for k in chosen], frozenset(chosen)
    if last >= 0 and width > 1:  # names are separated otherwise than numbers
        line = lines[last].lstrip("#% ").strip()
        ways = (r"\s*;\s*", r"\s*\t\s*", r"\s*,\s*", r"\s{2,}", r"\s+(?![\[({])", r"[\s,;]+")
        for way in ways:
            if len(cells := re.split(way, line)) == width:
                return [cells], frozenset([last])
    return [], frozenset()


def _decode(path: Path, encoding: str | None) -> str:
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
    except (ValueError, LookupError) as error:
        raise InputError(path, "text.encoding", encoding, f"does not fit: {error}") from error


def _unquoted(lines: Sequence[str]) -> list[str]:
    """Return lines without the quotation marks about each whole line, as of a table that was written as one column."""
    bare = [line.strip() for line in lines]
    is_one_column = all(len(line) > 1 and line[0] == line[-1] == '"' and line.count('"') == 2 for line in bare)
    return [line[1:-1] for line in bare] if is_one_column else list(lines)


def _without_brackets(lines: Sequence[str]) -> list[str]:
    """Return the lines of a table without the signs about a matrix as in MATLAB: ``data = [1 2;``, ..., ``3 4];``.

    The rows of such a table end in semicolons, but for the last one, and perhaps by themselves.
    """
    first = next((k for k, line in enumerate(lines) if _MATRIX_BEGINS.match(line)), None)
    last = next((k for k in range(len(lines) - 1, -1, -1) if _MATRIX_ENDS.search(lines[k])), None)
    if first is None or last is None or last <= first:
        return list(lines)
    rows = [_MATRIX_BEGINS.sub("", lines[first]), *lines[first + 1 : last], _MATRIX_ENDS.sub("", lines[last])]
    rows = [row.strip().removesuffix("...").rstrip().removesuffix(";") for row in rows]
    return [*lines[:first], *(row for row in rows if row)]


def _separator(lines: Sequence[str]) -> str:
    """Return the separator that gives most of the last lines one number of cells, more than one.

    Of several it is the one between the most numbers: a comma in ``15:03:27 0,74 23,5`` separates none.
    """
    sample, found, most = lines[-SAMPLE:], ",", -1.0
    for separator in SEPARATORS:
        table = [_cells(line, separator) for line in sample]
        cells, times = Counter(map(len, table)).most_common(1)[0] if table else (1, 0)
        if cells > 1 and times >= 0.8 * len(sample):
            decimal = _decimal(table)
            are_numbers = [_is_number(cell, decimal) for row in table if len(row) == cells for cell in row if cell]
            if (share := sum(are_numbers) / max(len(are_numbers), 1)) > most:
                found, most = separator, share
    return found


def _cells(line: str, separator: str) -> list[str]:
    if separator == " ":
        cells = line.split()
    elif '"' in line:  # a separator between quotation marks is none
        try:
            cells = next(csv.reader([line], delimiter=separator, skipinitialspace=True), [])
        except csv.Error:  # a cell of more than 131 072 characters is none of a table
            cells = line.split(separator)
    else:
        cells = line.split(separator)
    return [cell.strip().strip('"').strip() for cell in cells]


def _decimal(table: Sequence[Sequence[str]]) -> str:
    cells = [cell for row in table[-SAMPLE:] for cell in row]
    return "," if any(_DECIMAL_COMMA.match(cell) for cell in cells) else "."


def _number(cell: str, decimal: str) -> float:
    """Return the number of a cell; NaN if it is none. Next to decimal commas, points may be those of thousands."""
    if decimal == "," and ("," in cell or _THOUSANDS.match(cell)):
        cell = cell.replace(".", "").replace(",", ".")
    try:
        return float(cell)
    except ValueError:
        return np.nan


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
    filled = [cell.strip("[](){} ") for cell in cells if cell.strip("[](){}- ")]
    return bool(filled) and all(header_cells.unit_of(cell) for cell in filled)


def _names(headers: Sequence[Sequence[str]], width: int) -> tuple[list[str], list[str]]:
    """Return names and units of the columns from at most two lines above the numbers."""
    titles = [*(headers[0] if headers else ()), *[""] * width][:width]
    below = [*(headers[1] if len(headers) > 1 else ()), *[""] * width][:width]
    names, units = [], []
    counted = header_cells.numbered(titles)
    for k, (title, under) in enumerate(zip(titles, below, strict=True)):
        name, unit = (title, "") if title in counted else header_cells.split_unit(title)
        stripped = under.strip("[](){} ")
        unit = unit or header_cells.unit_of(stripped) or stripped.strip("-")
        if not name or name in names:
            name = f"{name} {k + 1}" if name else f"column {k + 1}"
        names.append(name)
        units.append(unit)
    return names, units

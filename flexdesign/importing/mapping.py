"""``map.toml``: which variable of a file is which column of a run.

::

    title = "Bench 3"
    rate = "10 kHz"                                    # unless a column t, or the file itself, has the time
    axes = ["sample", "channel", "realisation", "period"]      # of arrays that have so many axes
    [[run]]
    name = "multisine"
    kind = "multisine"
    [run.columns.u]
    variable = "data.input"
    unit = "V"
    scale = 10                                         # stored numbers times scale, plus offset, are in that unit
    [run.columns.x]
    variable = "data.output"
    unit = "um"
    channel = 2                                        # counted from 1

What ``measurements.toml`` may say (``command_is``, ``limits``, ``sensors``, ``role`` ...) may stand here as well, and
is passed on. Channels are chosen; each realisation is a run of its own; periods follow one another in time. A table in
text that is not understood is described in ``[text]``: separator, decimal, skip, encoding.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

from flexdesign import columns, files
from flexdesign.errors import InputError
from flexdesign.files import in_si, whole
from flexdesign.importing.delimited import Dialect
from flexdesign.runs import ALLOWED
from flexdesign.runs.description import RunSettings, Setup

#: What the axes of an array can be.
AXES = ("sample", "channel", "realisation", "period")
#: Keys of a map that are not passed on to ``measurements.toml``.
OWN = ("rate", "axes", "text", "run", "name", "columns")


def _axes(given: Any) -> tuple[str, ...]:
    known = ", ".join(AXES)
    if not isinstance(given, list) or not all(each in AXES for each in given):
        raise ValueError(f'expected a list of {known}: axes = ["sample", "channel"]')
    if len(set(given)) < len(given) or "sample" not in given:
        raise ValueError("names each axis once, and sample among them")
    return tuple(given)


def _separator(given: Any) -> str:
    if not isinstance(given, str) or len(given) != 1:
        raise ValueError('expected one character, for example ";" or "\\t"; " " for any white space')
    return given


def _decimal(given: Any) -> str:
    if given not in (".", ","):
        raise ValueError('expected "." or ","')
    return str(given)


class TextTable(files.Table):
    """``[text]``: how a table in text is written."""

    separator: Annotated[str | None, BeforeValidator(_separator)] = None
    decimal: Annotated[str | None, BeforeValidator(_decimal)] = None
    skip: whole(0, 10_000_000) | None = None  # type: ignore[valid-type]
    encoding: str | None = None


class ColumnTable(files.Table):
    """``[run.columns.NAME]``: one column of a run."""

    variable: str
    unit: str = ""
    scale: in_si("1", -1e15, 1e15) = 1.0  # type: ignore[valid-type]
    offset: in_si("1", -1e15, 1e15) = 0.0  # type: ignore[valid-type]
    channel: whole(1, 100_000) | None = None  # type: ignore[valid-type]


class RunMap(RunSettings):
    """``[[run]]`` of a map; its rate and axes go before those of all."""

    name: str = ""
    rate: in_si("Hz", 1e-6, 1e12) | None = None  # type: ignore[valid-type]
    axes: Annotated[tuple[str, ...] | None, BeforeValidator(_axes)] = None
    columns: Any = None


class MapTable(Setup):
    """A map."""

    rate: in_si("Hz", 1e-6, 1e12) | None = None  # type: ignore[valid-type]
    axes: Annotated[tuple[str, ...] | None, BeforeValidator(_axes)] = None
    text: TextTable = TextTable()


@dataclass(frozen=True)
class Map:
    """A map that has been read.

    Parameters
    ----------
    path
        The file.
    dialect
        How tables in text are written.
    runs
        Of each run: its settings, and its columns by name.
    said
        What is passed on to ``measurements.toml``, as it is written: of all runs, and of each.
    """

    path: Path
    dialect: Dialect
    runs: tuple[tuple[RunMap, Mapping[str, ColumnTable]], ...]
    said: Mapping[str, Any]
    said_of_runs: tuple[Mapping[str, Any], ...]


def read_map(path: Path) -> Map:
    """Read a map.

    Raises
    ------
    InputError
        If a key is unknown, a value cannot be used, there is no run or one without columns, two have one name, or a
        unit does not suit its column.
    """
    content = files.read_toml(path)
    tables: Any = content.get("run")
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        raise InputError(path, "run", None, "is missing; write a table for each run: [[run]]")
    table = files.check(MapTable, content, path)
    runs = []
    for number, each in enumerate(tables, start=1):
        run = files.check(RunMap, each, path, f"run {number}")
        run = run.model_copy(update={"rate": run.rate or table.rate, "axes": run.axes or table.axes})
        runs.append((run, _columns(each.get("columns"), path, f"run {number}.columns")))
    names = [run.name for run, _ in runs]
    for number, name in enumerate(names, start=1):
        if name in names[: number - 1]:
            raise InputError(path, f"run {number}.name", name or '""', "is the name of two runs; give each its own")
        if not name.isprintable() or any(sign in name for sign in '/\\:*?"<>|'):
            raise InputError(path, f"run {number}.name", name, "is no name for a file; use letters, digits and - _")
    dialect = Dialect(**table.text.model_dump())
    return Map(path, dialect, tuple(runs), _passed_on(content), tuple(_passed_on(each) for each in tables))


def _passed_on(table: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if key not in OWN}


def _columns(given: Any, path: Path, place: str) -> dict[str, ColumnTable]:
    if not isinstance(given, dict) or not all(isinstance(table, dict) for table in given.values()) or not given:
        raise InputError(path, place, None, "is missing; write a table for each column: [run.columns.u]")
    found = {}
    for name, table in given.items():
        if not name.replace("_", "").isalnum():
            raise InputError(path, f"{place}.{name}", None, "is no name for a column; use letters and digits")
        found[name] = files.check(ColumnTable, table, path, f"{place}.{name}")
        if found[name].unit:
            check_unit(name, found[name].unit, path, f"{place}.{name}.unit")
    return found


def check_unit(name: str, unit: str, file: Path, field: str) -> str:
    """Return the SI unit of a column that is written in `unit`.

    Raises
    ------
    InputError
        If the column cannot have that unit.
    """
    try:
        return columns.si_of(unit, ALLOWED.get(name, columns.ANY))
    except ValueError as error:
        raise InputError(file, field, unit, str(error)) from error

"""``map.toml``: which variable of a file is which column of a run.

::

    title = "Bench 3"
    rate = "10 kHz"                                    # unless a column t, or the file itself, has the time
    axes = ["sample", "channel", "realisation", "period"]      # of arrays with this number of axes
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

A frequency response is a run with a column ``f`` and a complex one, ``response``; or with ``magnitude`` and ``phase``,
or ``re`` and ``im``, and ``coherence`` if it was recorded ::

    axes = ["channel", "input", "frequency"]           # of arrays with three axes
    [[run]]
    [run.columns.f]
    variable = "freq"
    unit = "Hz"
    [run.columns.response]
    variable = "H"
    unit = "um/V"
    channel = 1
    input = 1

A column may be computed, with units checked; what a formula may have says `core.arithmetic` ::

    [constants]
    kv = "243.45 V s/m"
    kp = "160.18 1/s"
    per_length = "1 V/mm"
    [variables.pulse]                                  # of a variable whose name or unit the file does not say well
    variable = "bench/force pulse"
    unit = "V"
    [run.columns.u]
    formula = "per_length * (qg + pulse / (kv * kp))"
    unit = "V"

One map serves many files that hold the same variables: with ``per_file = true`` it is applied to each file by itself,
and each makes runs of its own, named after the file. A run with ``files = ["scope_*.csv"]`` is for these alone.

What ``measurements.toml`` may say (``command_is``, ``limits``, ``sensors``, ``role`` ...) may stand here as well, and
is passed on. Channels are chosen; each realisation is a run of its own; periods follow one another in time. A table in
text that is not understood is described in ``[text]``: separator, decimal, skip, encoding, table.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator

from flexdesign.core import arithmetic, toml_files, unit_tables, units
from flexdesign.core.arithmetic import Formula
from flexdesign.core.errors import InputError
from flexdesign.core.toml_files import in_si, whole
from flexdesign.measurements.importing.delimited import Dialect
from flexdesign.measurements.recordings import ALLOWED, frequency_response
from flexdesign.measurements.recordings.description import RunSettings, Setup

#: A run's name has no more letters.
LONGEST = 100
#: What the axes of an array can be; along the first or the second one of them there are the numbers of a column.
AXES = ("sample", "frequency", "channel", "input", "realisation", "period")
#: Keys of a map that are not passed on to ``measurements.toml``.
OWN = ("rate", "axes", "per_file", "text", "constants", "variables", "run", "name", "files", "columns")
#: Words for readings of a converter, which are no unit; and the unit that is proposed for their size.
COUNTS = ("count", "counts", "cts", "bit", "bits", "digit", "digits", "lsb", "inc", "tick", "ticks", "1", "")
USUAL = {"t": "s", "u": "V", "v": "V", "i": "A", "f": "N", "T": "degC"}
#: The column of a frequency response in complex numbers.
RESPONSE = "response"
#: Which SI units the columns of a frequency response may have.
OF_RESPONSES = {**frequency_response.ALLOWED, RESPONSE: tuple(frequency_response.PER_VOLT)}


def _axes(given: Any) -> tuple[str, ...]:
    known = ", ".join(AXES)
    if not isinstance(given, list) or not all(each in AXES for each in given):
        raise ValueError(f'expected a list of {known}: axes = ["sample", "channel"]')
    if len(set(given)) < len(given) or len({"sample", "frequency"} & set(given)) != 1:
        raise ValueError("names each axis once, and sample among them, or frequency")
    if "frequency" in given and "period" in given:
        raise ValueError("has both frequency and period; a frequency response has no periods")
    return tuple(given)


def _separator(given: Any) -> str:
    if not isinstance(given, str) or len(given) != 1:
        raise ValueError('expected one character, for example ";" or "\\t"; " " for any white space')
    return given


def _decimal(given: Any) -> str:
    if given not in (".", ","):
        raise ValueError('expected "." or ","')
    return str(given)


def _patterns(given: Any) -> tuple[str, ...]:
    if not isinstance(given, list) or not given or not all(isinstance(each, str) and each for each in given):
        raise ValueError('expected a list of names of files: files = ["scope_*.csv"]')
    return tuple(given)


class TextTable(toml_files.Table):
    """``[text]``: how a table in text is written."""

    separator: Annotated[str | None, BeforeValidator(_separator)] = None
    decimal: Annotated[str | None, BeforeValidator(_decimal)] = None
    skip: whole(0, 10_000_000) | None = None  # type: ignore[valid-type]
    encoding: str | None = None
    table: whole(1, 10_000) | None = None  # type: ignore[valid-type]


class VariableTable(toml_files.Table):
    """``[variables.NAME]``: a variable of a file as formulas call it."""

    variable: str = ""
    unit: str = ""
    scale: in_si("1", -1e15, 1e15) = 1.0  # type: ignore[valid-type]
    offset: in_si("1", -1e15, 1e15) = 0.0  # type: ignore[valid-type]
    channel: whole(1, 100_000) | None = None  # type: ignore[valid-type]
    input: whole(1, 100_000) | None = None  # type: ignore[valid-type]


class ColumnTable(VariableTable):
    """``[run.columns.NAME]``: one column of a run, a variable or a formula."""

    formula: str = ""


class RunMap(RunSettings):
    """``[[run]]`` of a map; its rate and axes go before those of all."""

    name: str = ""
    files: Annotated[tuple[str, ...], BeforeValidator(_patterns)] = ()
    rate: in_si("Hz", 1e-6, 1e12) | None = None  # type: ignore[valid-type]
    axes: Annotated[tuple[str, ...] | None, BeforeValidator(_axes)] = None
    columns: Any = None


class MapTable(Setup):
    """A map."""

    rate: in_si("Hz", 1e-6, 1e12) | None = None  # type: ignore[valid-type]
    axes: Annotated[tuple[str, ...] | None, BeforeValidator(_axes)] = None
    text: TextTable = TextTable()
    per_file: bool = False
    constants: Any = None
    variables: Any = None


@dataclass(frozen=True)
class RunColumns:
    """The columns of one run.

    Parameters
    ----------
    tables
        By name.
    formulas
        Of those that are computed, by name.
    is_response
        Whether they are a frequency response.
    """

    tables: Mapping[str, ColumnTable]
    formulas: Mapping[str, Formula]
    is_response: bool

    def si_of(self, name: str, unit: str, file: Path, field: str) -> str:
        """Return the SI unit of a column that is written in `unit`.

        Raises
        ------
        InputError
            If the column cannot have that unit.
        """
        try:
            return unit_tables.si_of(unit, (OF_RESPONSES if self.is_response else ALLOWED).get(name, unit_tables.ANY))
        except ValueError as error:
            size = f'; of counts state the size of one: unit = "{USUAL.get(name[:1], "um")}", scale = ...'
            remedy = f"{error}{size if unit.lower() in COUNTS else ''}"
            raise InputError(file, field, unit, remedy) from error


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
    constants
        Quantities of pint, by the names that formulas use.
    variables
        Variables of the files, by the names that formulas use.
    stated, said_of_runs
        Entries for ``measurements.toml``, as written in the map: for all runs, and for each run.
    per_file
        Whether the map is applied to each file by itself.
    """

    path: Path
    dialect: Dialect
    runs: tuple[tuple[RunMap, RunColumns], ...]
    constants: Mapping[str, Any]
    variables: Mapping[str, VariableTable]
    stated: Mapping[str, Any]
    said_of_runs: tuple[Mapping[str, Any], ...]
    per_file: bool = False

    def of(self, file: Path) -> tuple[int, ...]:
        """Return which runs are for a file, of a map that is applied to each file by itself.

        Raises
        ------
        InputError
            If none is.
        """
        numbers = tuple(
            number
            for number, (run, _) in enumerate(self.runs)
            if not run.files or any(fnmatch.fnmatch(file.name, pattern) for pattern in run.files)
        )
        if not numbers:
            remedy = "no run is for this file; name it, or a pattern such as scope_*.csv, in files of a [[run]]"
            raise InputError(self.path, "run.files", file.name, remedy)
        return numbers


def read_map(path: Path) -> Map:
    """Read a map from a file; raise as `parse_map` does."""
    return parse_map(toml_files.read_toml(path), path)


def parse_map(content: Mapping[str, Any], path: Path) -> Map:
    """Return a map of what a TOML file says; `path` stands in messages.

    Raises
    ------
    InputError
        If a key is unknown, a value cannot be used, there is no run or one without columns, two have one name, a unit
        does not suit its column, or a formula cannot be understood.
    """
    tables: Any = content.get("run")
    if not isinstance(tables, list) or not tables or not all(isinstance(table, dict) for table in tables):
        raise InputError(path, "run", None, "is missing; write a table for each run: [[run]]")
    table = toml_files.check(MapTable, content, path)
    runs = []
    for number, each in enumerate(tables, start=1):
        run = toml_files.check(RunMap, each, path, f"run {number}")
        run = run.model_copy(update={"rate": run.rate or table.rate, "axes": run.axes or table.axes})
        runs.append((run, _columns(each.get("columns"), path, f"run {number}.columns")))
    names = [run.name for run, _ in runs]
    if any(run.files for run, _ in runs) and not table.per_file:
        remedy = "chooses files of those that each make runs of their own: write per_file = true above [[run]], or"
        raise InputError(path, "run.files", None, f"{remedy} remove this line")
    for number, (run, _) in enumerate(runs, start=1):
        name = run.name
        if name in names[: number - 1] and not run.files:
            raise InputError(path, f"run {number}.name", name or '""', "is the name of two runs; give each its own")
        if len(name) > LONGEST:
            raise InputError(path, f"run {number}.name", name, f"has more than {LONGEST} letters; a file is named so")
        if not name.isprintable() or any(sign in name for sign in '/\\:*?"<>|'):
            raise InputError(path, f"run {number}.name", name, "is no name for a file; use letters, digits and - _")
    dialect = Dialect(**table.text.model_dump())
    constants, variables = _constants(table.constants, path), _variables(table.variables, path)
    if both := sorted(constants.keys() & variables.keys()):
        raise InputError(path, f"variables.{both[0]}", None, "is the name of a constant as well; rename one of them")
    remark = _passed_on(content), tuple(_passed_on(each) for each in tables)
    return Map(path, dialect, tuple(runs), constants, variables, *remark, per_file=table.per_file)


def _passed_on(table: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in table.items() if key not in OWN}


def _constants(given: Any, path: Path) -> dict[str, Any]:
    if not isinstance(given, dict | None):
        raise InputError(path, "constants", toml_files.as_written(given), "expected a table: [constants]")
    found = {}
    for name, value in (given or {}).items():
        _require_name(name, path, f"constants.{name}")
        try:
            found[name] = units.quantity_from_text(value)
        except ValueError as error:
            raise InputError(path, f"constants.{name}", toml_files.as_written(value), str(error)) from None
    return found


def _variables(given: Any, path: Path) -> dict[str, VariableTable]:
    if not isinstance(given, dict | None) or not all(isinstance(table, dict) for table in (given or {}).values()):
        raise InputError(path, "variables", toml_files.as_written(given), "expected a table for each: [variables.NAME]")
    found = {}
    for name, table in (given or {}).items():
        _require_name(name, path, f"variables.{name}")
        found[name] = toml_files.check(VariableTable, table, path, f"variables.{name}")
        if not found[name].variable:
            found[name] = found[name].model_copy(update={"variable": name})
    return found


def _require_name(name: str, path: Path, field: str) -> None:
    if not name.isidentifier() or name == "pi" or name in arithmetic.FUNCTIONS:
        remedy = "is no name for a formula; use letters, digits and _, not the name of a function or pi"
        raise InputError(path, field, None, remedy)


def _columns(given: Any, path: Path, place: str) -> RunColumns:
    if not isinstance(given, dict) or not all(isinstance(table, dict) for table in given.values()) or not given:
        raise InputError(path, place, None, "is missing; write a table for each column: [run.columns.u]")
    tables, computed = {}, {}
    for name, table in given.items():
        field = f"{place}.{name}"
        if not name.replace("_", "").isalnum():
            raise InputError(path, field, None, "is no name for a column; use letters and digits")
        tables[name] = toml_files.check(ColumnTable, table, path, field)
        if tables[name].formula:
            computed[name] = _formula(tables[name], table, path, field)
        elif not tables[name].variable:
            raise InputError(path, f"{field}.variable", None, 'is missing; write for example variable = "..."')
    about_lines = {RESPONSE, *frequency_response.POLAR, *frequency_response.PARTS} & tables.keys()
    found = RunColumns(tables, computed, "t" not in tables and bool(about_lines))
    for name, column in tables.items():
        if column.unit:
            found.si_of(name, column.unit, path, f"{place}.{name}.unit")
    if found.is_response and frequency_response.FREQUENCY not in tables:
        remedy = f"is missing; a frequency response ({', '.join(sorted(about_lines))}) has a column f [Hz]"
        raise InputError(path, f"{place}.f", None, remedy)
    return found


def _formula(column: ColumnTable, given: Mapping[str, Any], path: Path, field: str) -> Formula:
    other = next((key for key in given if key not in ("formula", "unit")), None)
    if other:
        remedy = "conflicts with a formula; state it for the variables in it: [variables.NAME]"
        raise InputError(path, f"{field}.{other}", toml_files.as_written(given[other]), remedy)
    if not column.unit:
        remedy = "is missing; say in which unit the column is to be written"
        raise InputError(path, f"{field}.unit", None, remedy)
    try:
        return arithmetic.parse(column.formula)
    except ValueError as error:
        raise InputError(path, f"{field}.formula", column.formula, str(error)) from None

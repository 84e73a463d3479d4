"""Runs: recorded experiments in CSV files, and what ``measurements.toml`` beside them says about each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict

from flexdesign import columns, files
from flexdesign.columns import Sheet
from flexdesign.errors import InputError, suggest

Array = NDArray[np.float64]
Role = Literal["identify", "validate"]
Between = Literal["linear", "hold"]

#: Axes in their order, and the column of each one's command.
AXES = ("x", "y", "z")
COMMANDS = ("u", "ux", "uy", "uz")
#: Which SI units a column may have. An electronic analogue of a stage answers in volts.
ALLOWED = {
    "t": ("s",),
    **dict.fromkeys([*COMMANDS, "v", "vx", "vy", "vz"], ("V",)),
    **dict.fromkeys([*AXES, "r", "rx", "ry", "rz"], ("m", "V")),
    **dict.fromkeys(["i", "ix", "iy", "iz"], ("A",)),
    **dict.fromkeys(["f", "fx", "fy", "fz"], ("N",)),
    "T": ("K",),
}
#: With fewer rows nothing can be said about dynamics.
FEWEST = 10
#: How far a time may lie from its place on the uniform grid, in periods.
UNIFORM = 1e-3
#: The file that describes the runs of a folder.
DESCRIPTION = "measurements.toml"


@dataclass(frozen=True, eq=False)
class Run:
    """One recorded experiment, sampled uniformly; an `Observation`.

    Parameters
    ----------
    name
        The stem of its file, with the folder before it where two stems would be the same.
    time
        n moments, uniform and increasing [s].
    columns
        Everything else that was recorded, n values each, in SI, by name: ``u``, ``x``, ``r``, ...
    si
        SI unit of each column.
    between_samples
        What the command does between its samples: goes straight to the next (``linear``), or waits (``hold``).
    role
        Whether a fit may see it.
    """

    name: str
    time: Array
    columns: Mapping[str, Array]
    si: Mapping[str, str]
    between_samples: Between = "linear"
    role: Role = "identify"

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of the command columns."""
        return tuple(name for name in COMMANDS if name in self.columns)

    @property
    def responses(self) -> tuple[str, ...]:
        """Names of the response columns, in the order of the axes."""
        return tuple(name for name in AXES if name in self.columns)

    def command(self) -> Array:
        """Return the command [V]: n values, or commands x n where there are several."""
        return self._together(self.commands)

    def measured(self) -> Array:
        """Return the response [m, or V for an electronic analogue]: n values, or axes x n where there are several."""
        return self._together(self.responses)

    def _together(self, names: tuple[str, ...]) -> Array:
        return self.columns[names[0]] if len(names) == 1 else np.stack([self.columns[name] for name in names])


class _RunTable(files.Table):
    """One ``[[run]]``; what else it says (kind, conditions) is for others to read."""

    model_config = ConfigDict(extra="allow", frozen=True)

    file: str
    role: Role = "identify"
    between_samples: Between = "linear"


class _Description(files.Table):
    """The tables of ``measurements.toml`` that a run needs; others (sensors, scale, limits) may be there too."""

    model_config = ConfigDict(extra="allow", frozen=True)

    title: str = ""


@dataclass(frozen=True)
class Measurements:
    """What ``measurements.toml`` says.

    Parameters
    ----------
    path
        The file.
    title
        What was measured.
    runs
        Role and behaviour between samples, by the name of the CSV file.
    """

    path: Path
    title: str
    runs: Mapping[str, tuple[Role, Between]]


def read_run(path: str | Path) -> Run:
    """Read one CSV file, and what ``measurements.toml`` beside it says about it.

    Header cells are ``name [unit]``: time ``t``, command ``u`` (or ``ux``, ``uy``, ``uz``), responses ``x``, ``y``,
    ``z``; if recorded, reference ``r``, voltage at the stack ``v``, current ``i``, force ``f``, temperature ``T``.
    Other columns are carried along.

    Raises
    ------
    InputError
        If the file is no such table, a unit is wrong, a cell is empty or no finite number, time does not increase
        uniformly, there are fewer than ten rows, or command or response is missing.
    """
    path = Path(path)
    sheet = columns.read(path, ALLOWED)
    time = sheet.time()
    recorded = {name: values for name, values in sheet.values.items() if name != "t"}
    _needs(sheet, COMMANDS, "command", "u [V]")
    _needs(sheet, AXES, "response", "x [um]")
    if "u" in recorded and any(name in recorded for name in COMMANDS[1:]):
        raise InputError(path, "header", None, "has u beside ux, uy or uz; name every command by its axis")
    if len(time) < FEWEST:
        raise InputError(path, "", None, f"has {len(time)} rows; at least {FEWEST} are needed")
    _refuse_gaps(sheet, time)
    run = Run(path.stem, time, recorded, {name: sheet.si[name] for name in recorded})
    description = path.parent / DESCRIPTION
    if description.is_file():
        said = read_measurements(description).runs.get(path.name)
        if said:
            return replace(run, role=said[0], between_samples=said[1])
    return run


def read_runs(paths: Iterable[str | Path]) -> tuple[Run, ...]:
    """Read CSV files, and all those of folders in alphabetical order; one that is named twice is read once.

    Raises
    ------
    InputError
        If a path does not exist, a folder has no CSV file or lacks one that its ``measurements.toml`` names, or a run
        cannot be read.
    """
    found: dict[Path, Run] = {}
    for path in map(Path, paths):
        for file in _csv_files(path) if path.is_dir() else [path]:
            if file.resolve() not in found:
                found[file.resolve()] = read_run(file)
    times = Counter(run.name for run in found.values())
    return tuple(
        run if times[run.name] == 1 else replace(run, name=f"{file.parent.name}/{run.name}")
        for file, run in found.items()
    )


def read_measurements(path: Path) -> Measurements:
    """Read ``measurements.toml``: its title, and of each ``[[run]]`` file, role and between_samples.

    Raises
    ------
    InputError
        If one of these cannot be used, or two tables name one file.
    """
    content = files.read_toml(path)
    title = files.check(_Description, content, path).title if content else ""
    tables: Any = content.get("run", [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError(path, "run", None, "expected a list of tables: [[run]]")
    said: dict[str, tuple[Role, Between]] = {}
    for number, table in enumerate(tables, start=1):
        place = f"run {number}"
        run = files.check(_RunTable, table, path, place)
        if run.file in said:
            raise InputError(path, f"{place}.file", run.file, "is described twice; keep one of the two tables")
        said[run.file] = (run.role, run.between_samples)
    return Measurements(path, title, said)


def write_run(path: str | Path, time: Array, recorded: Mapping[str, Array], comment: str = "") -> None:
    """Write a run as `read_run` reads it, whole or not at all.

    Parameters
    ----------
    path
        Where to; a file that is there is replaced.
    time
        n moments [s].
    recorded
        By header cell, such as ``x [um]``: n values in SI, written in the unit of the cell.
    comment
        Lines that go above the header.

    Raises
    ------
    ValueError
        If a header cell has no unit, lengths differ, or a value is not finite.
    InputError
        If the file cannot be written.
    """
    columns.write(Path(path), {"t [s]": time, **recorded}, comment)


def _needs(sheet: Sheet, names: tuple[str, ...], what: str, example: str) -> None:
    if not any(name in sheet.values for name in names):
        remedy = f"there is no {what} ({', '.join(names)}); found {', '.join(sheet.values)}: add a column {example}"
        raise InputError(sheet.path, "header", None, remedy)


def _refuse_gaps(sheet: Sheet, time: Array) -> None:
    """Refuse time that is not uniform: a step of another length, or a clock that drifts off the grid."""
    steps = np.diff(time)
    usual = float(np.median(steps))
    uneven = np.flatnonzero(np.abs(steps - usual) > UNIFORM * usual)
    advice = "resample to a uniform time, or write it with more digits"
    if uneven.size:
        row = int(uneven[0]) + 1
        remedy = f"comes {steps[row - 1]:.6g} s after the row before, where {usual:.6g} s is usual; {advice}"
        raise sheet.refusal(row, "t", f"{time[row]:.9g} s", remedy)
    grid = np.linspace(time[0], time[-1], len(time))
    row = int(np.argmax(np.abs(time - grid)))
    if abs(time[row] - grid[row]) > UNIFORM * usual:
        remedy = f"lies {time[row] - grid[row]:.3g} s off the uniform time from first to last row; {advice}"
        raise sheet.refusal(row, "t", f"{time[row]:.9g} s", remedy)


def _csv_files(folder: Path) -> list[Path]:
    found = sorted(file for file in folder.iterdir() if file.suffix.lower() == ".csv" and file.is_file())
    description = folder / DESCRIPTION
    if description.is_file():
        names = [file.name for file in found]
        for name in read_measurements(description).runs:
            if name not in names:
                remedy = f"is not in the folder{suggest(name, names)}"
                raise InputError(description, "run.file", name, remedy)
    if not found:
        raise InputError(folder, "", None, "has no CSV file; name a folder of recorded runs, or the files themselves")
    return found

"""A trajectory from a CSV file of the user's own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, model_validator

from flexdesign.core import unit_tables
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.unit_tables import Sheet
from flexdesign.dynamics.trajectories.base import Trajectory


def _cells(given: Any) -> Any:
    return [given] if isinstance(given, str) else given


def _check_cell(cell: str) -> str:
    _axis(cell)
    return cell


def _axis(cell: str) -> tuple[str, str]:
    """Return name and SI unit of a header cell that commands an axis."""
    name, unit = unit_tables.split(cell)
    return name, unit_tables.si_of(unit, ("V", "m"))


class Recorded(Trajectory):
    """Straight lines between the rows of a CSV file with a column ``t [s]``.

    `column` is the header cell of the command, ``"u [V]"``, or a list of them, one per axis. Time must increase but
    need not be uniform; the first row is the start, whatever its time.
    """

    shape: Literal["csv"] = "csv"
    file: str
    column: Annotated[tuple[Annotated[str, AfterValidator(_check_cell)], ...], BeforeValidator(_cells)]

    @model_validator(mode="after")
    def _has_one_kind(self) -> Self:
        if not self.column:
            raise ValueError('names no column; write for example column = "u [V]"')
        if len({_axis(cell)[1] for cell in self.column}) > 1:
            raise ValueError("mixes volts and metres; name columns of the same kind")
        return self

    @property
    def si(self) -> str:
        """``V`` or ``m``, as the header cell says."""
        return _axis(self.column[0])[1]

    @property
    def axes(self) -> int:
        """How many columns are named."""
        return len(self.column)

    def with_folder(self, folder: Path) -> Self:
        """Return this trajectory with `file` looked up in `folder`, unless it is absolute."""
        return self.model_copy(update={"file": str(folder / self.file)})

    def _sheet(self) -> Sheet:
        """Return what the file holds, with its time checked and the columns there.

        Raises
        ------
        InputError
            If it cannot be read, time does not increase, or a column is not there as it is named.
        """
        path = Path(self.file)
        sheet = unit_tables.read(path, {"t": ("s",), **{_axis(cell)[0]: ("V", "m") for cell in self.column}})
        if len(sheet.time()) < 2:
            raise InputError(path, "", None, "has one row; a trajectory needs at least two")
        there = [f"{name} [{unit}]" for name, unit in sheet.unit.items() if name != "t"]
        for cell in self.column:
            name, si = _axis(cell)
            if sheet.si.get(name) != si:
                raise InputError(path, "header", None, f"there is no column {cell}; found {', '.join(there)}")
        return sheet

    def _moving(self) -> float:
        time = self._sheet().time()
        return float(time[-1] - time[0])

    def _at(self, time: Array) -> Array:
        sheet = self._sheet()
        rows = sheet.time() - sheet.time()[0]
        points_at = np.stack([np.interp(time, rows, sheet.values[_axis(cell)[0]]) for cell in self.column])
        return points_at[0] if self.axes == 1 else points_at

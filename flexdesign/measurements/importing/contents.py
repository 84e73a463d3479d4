"""What a file of another program holds: numeric arrays with names, and what it says of their units and rates."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import extras
from flexdesign.core.errors import InputError, suggest

#: Complex numbers, or real ones where nothing is imaginary.
Numbers = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Variable:
    """One array.

    Parameters
    ----------
    shape
        Its size along each axis.
    read
        Returns the numbers, as they are stored.
    unit
        What the file says; empty if nothing.
    step
        Time between samples [s], where the file says it.
    note
        What else helps to recognise it.
    is_complex
        Whether its numbers are complex.
    label
        What the file calls it, if its name only says where it is: ``log.Y(2).Data``.
    lines
        The line of the file in which each number stands, counted from 1, of a table in text.
    path
        The file.
    """

    shape: tuple[int, ...]
    read: Callable[[], Any]
    unit: str = ""
    step: float | None = None
    note: str = ""
    is_complex: bool = False
    label: str = ""
    lines: NDArray[np.intp] | None = None
    path: Path | None = None

    @property
    def size(self) -> int:
        """How many numbers it holds."""
        return int(np.prod(self.shape))

    def values(self) -> Numbers:
        """Return the numbers."""
        return np.asarray(self.read(), dtype=np.complex128 if self.is_complex else np.float64)


@dataclass(frozen=True, eq=False)
class Contents:
    """What was found.

    Parameters
    ----------
    paths
        The files.
    variables
        By name; where two files have one name, with the stem of the file before it: ``second:x``.
    notes
        Other statements of the files, such as lines above the header of a table.
    remarks
        What was left out of them.
    """

    paths: tuple[Path, ...]
    variables: Mapping[str, Variable]
    notes: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def find(self, name: str, file: Path, field: str) -> Variable:
        """Return a variable that `field` of a map `file` asks for.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        for path in self.paths:  # a structure named as its file may be written before its fields
            if name not in self.variables:
                name = name.removeprefix(f"{path.stem}.")
        if name not in self.variables:
            remedy = f"is no variable of {', '.join(path.name for path in self.paths)}"
            if all(f"{path.stem}:{name}" in self.variables for path in self.paths):
                remedy = f"is in each file: write per_file = true above [[run]], or {self.paths[0].stem}:{name} here"
                raise InputError(file, field, name, remedy)
            raise InputError(file, field, name, remedy + suggest(name, list(self.variables)))
        return self.variables[name]


def from_memory(values: Any, unit: str = "", step: float | None = None, note: str = "") -> Variable:
    """Return a variable whose numbers are in memory."""
    return Variable(np.shape(values), partial(np.asarray, values), unit, step, note, bool(np.iscomplexobj(values)))


def is_numeric(dtype: Any) -> bool:
    """Tell whether a dtype is of real or complex numbers, or true and false."""
    return np.dtype(dtype).kind in "biufc"


def library(name: str, path: Path) -> Any:
    """Return a library that only some formats need.

    Raises
    ------
    InputError
        If it is not installed; the message says how to.
    """
    try:
        return import_module(name)
    except ImportError as error:
        raise InputError(path, "", None, extras.requirement(name)) from error


def short_name(name: str) -> str:
    """Return a name without the file, the group or the structure it is in.

    >>> short_name("log.Y.time_ms"), short_name("first:bench/AO0")
    ('time_ms', 'AO0')
    """
    return name.replace(":", "/").replace(".", "/").rpartition("/")[2]

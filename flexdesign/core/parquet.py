"""Parquet files of numbers: header cells as column names, rows of floats."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import numpy as np

from flexdesign.core import extras
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError

#: The ending of files that are read and written as Parquet.
SUFFIX = ".parquet"


def read(path: Path) -> tuple[list[str], Array]:
    """Return header cells, and rows by columns as they are written; what is null is NaN.

    Raises
    ------
    InputError
        If pyarrow is missing, the file cannot be read, has no rows, or has a cell that is no number.
    """
    pyarrow = _pyarrow(path)
    try:
        table = pyarrow.parquet.read_table(pyarrow.BufferReader(path.read_bytes()))
        names = list(table.column_names)
    except Exception as error:  # a damaged file ends in errors of every kind
        why = getattr(error, "strerror", None)  # what the system says; pyarrow's own have none
        damaged = " as Parquet: it is damaged, cut short or something else; save it again"
        raise InputError(path, "", None, f"cannot be read{f': {why}' if why else damaged}") from error
    if not table.num_rows or not table.num_columns:
        raise InputError(path, "", None, "has no rows; add rows of numbers")
    numbers = []
    for name, column in zip(names, table.columns, strict=True):
        try:
            numbers.append(column.cast(pyarrow.float64(), safe=False).to_numpy())
        except Exception as error:
            raise InputError(path, f"column {name}", None, "has a cell that is no number; correct it") from error
    return names, np.column_stack(numbers)


def write(path: Path, cells: Sequence[str], table: Array, comment: str) -> None:
    """Write rows by columns under header cells, and the comment into the metadata.

    Raises
    ------
    InputError
        If pyarrow is missing.
    OSError
        If the file cannot be written.
    """
    pyarrow = _pyarrow(path)
    made = pyarrow.table({cell: table[:, number] for number, cell in enumerate(cells)})
    pyarrow.parquet.write_table(made.replace_schema_metadata({"comment": comment}), path)


def _pyarrow(path: Path) -> ModuleType:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise InputError(path, "", None, f"{extras.requirement('pyarrow')}, or use CSV") from error
    return pyarrow

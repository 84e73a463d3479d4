"""Which reader opens which file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from flexdesign.errors import InputError
from flexdesign.importing import binary, delimited
from flexdesign.importing.contents import Contents, Variable
from flexdesign.importing.delimited import Dialect

T = TypeVar("T")
#: By the ending of the file; what has another one is read as a table in text.
READERS: dict[str, Callable[[Path], dict[str, Variable]]] = {
    ".mat": binary.matlab,
    ".h5": binary.hdf5,
    ".hdf5": binary.hdf5,
    ".hdf": binary.hdf5,
    ".tdms": binary.tdms,
    ".uff": binary.universal,
    ".unv": binary.universal,
    ".npy": binary.numpy_array,
    ".npz": binary.numpy_archive,
}


def look(paths: Sequence[Path], dialect: Dialect = Dialect()) -> Contents:  # noqa: B008
    """Return what files hold together.

    Parameters
    ----------
    paths
        One or more files.
    dialect
        How tables in text are written, as far as it is known.

    Raises
    ------
    InputError
        If a file cannot be read as what its ending says, its reader is not installed, or it holds no numbers.
    """
    found = []
    notes: list[str] = []
    for path in paths:
        variables, said = _opened(path, dialect)
        if not variables:
            raise InputError(path, "", None, "holds no array of numbers")
        notes += said
        found += [(path, name, variable) for name, variable in variables.items()]
    times = Counter(name for _, name, _ in found)
    named = {name if times[name] == 1 else f"{path.stem}:{name}": variable for path, name, variable in found}
    return Contents(tuple(paths), named, tuple(notes))


def _opened(path: Path, dialect: Dialect) -> tuple[dict[str, Variable], tuple[str, ...]]:
    ending = path.suffix.lower()
    try:
        with path.open("rb"):  # what the system says is clearer than what libraries make of it
            pass
    except OSError as error:
        raise InputError(path, "", None, f"cannot be read: {error.strerror}") from error
    if ending not in READERS:
        return delimited.read(path, dialect)
    found = _intact(lambda: READERS[ending](path), path)
    # Some read the numbers only when they are asked for them.
    return {name: replace(each, read=partial(_intact, each.read, path)) for name, each in found.items()}, ()


def _intact(read: Callable[[], T], path: Path) -> T:
    """Return what a library reads; each has errors of its own for files that are cut short or are something else."""
    try:
        return read()
    except InputError:
        raise
    except Exception as error:
        ending = path.suffix.lower()
        remedy = f"cannot be read as a {ending} file: it is damaged, cut short or something else; save it again"
        raise InputError(path, "", None, remedy) from error

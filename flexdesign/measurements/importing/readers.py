"""Which reader opens which file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from flexdesign.core.errors import InputError
from flexdesign.measurements.importing import binary, delimited
from flexdesign.measurements.importing.apart import apart, intact
from flexdesign.measurements.importing.contents import Contents, Variable, library, short_name
from flexdesign.measurements.importing.delimited import Dialect
from flexdesign.measurements.importing.header_cells import numbered, split_unit
from flexdesign.measurements.recordings import DESCRIPTION

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
#: What is not read, by the ending of the file, and the remedy.
NOT_READ = {
    **dict.fromkeys(
        (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"), "is a spreadsheet; export the sheet as CSV, and import that"
    ),
    ".json": "is JSON; write its lists as columns of a CSV file, and import that",
}
#: Those whose libraries can take the whole process with them, and the package that is needed; SciPy is always there.
APART = {
    ".mat": "scipy", ".h5": "h5py", ".hdf5": "h5py", ".hdf": "h5py",
    ".tdms": "nptdms", ".uff": "pyuff", ".unv": "pyuff",
}  # fmt: skip


def read_contents(paths: Sequence[Path], dialect: Dialect = Dialect()) -> Contents:  # noqa: B008
    """Return what files hold together.

    Parameters
    ----------
    paths
        One or more files.
    dialect
        How tables in text are written, where known.

    Raises
    ------
    InputError
        If a file cannot be read as what its ending says, its reader is not installed, or it holds no numbers.
    """
    found = []
    notes, remarks = list[str](), list[str]()
    for path in paths:
        variables, said, left_out = _open(path, dialect)
        if not variables:
            objects = "; of an object, such as a timeseries, save the numbers: t = ts.Time, u = ts.Data"
            remedy = f"holds no array of numbers{objects if path.suffix.lower() == '.mat' else ''}"
            raise InputError(path, "", None, remedy)
        notes += said
        remarks += [f"{path.name}: {each}" for each in left_out]
        counted = numbered(list(variables))
        found += [
            (path, name, replace(variable if name in counted else _with_unit(name, variable), path=path))
            for name, variable in variables.items()
        ]
    times = Counter(name for _, name, _ in found)
    named = {name if times[name] == 1 else f"{path.stem}:{name}": variable for path, name, variable in found}
    return Contents(tuple(paths), named, tuple(notes), tuple(remarks))


def _with_unit(name: str, variable: Variable) -> Variable:
    """Return a variable with the unit that its name ends in, if the file says none: ``log.time_ms``."""
    return variable if variable.unit else replace(variable, unit=split_unit(short_name(name))[1])


def list_files(paths: Sequence[Path]) -> list[Path]:
    """Return the files of paths; of a folder those that stand in it, in the order of their names.

    Raises
    ------
    InputError
        If a folder is empty, or a folder of runs that is imported already.
    """
    found = list[Path]()
    for path in paths:
        if path.is_dir() and (path / DESCRIPTION).exists():
            raise InputError(path, "", None, f"has a {DESCRIPTION}: it is imported already; use it as RUNS")
        inside = sorted(each for each in path.iterdir() if _is_recording(each)) if path.is_dir() else [path]
        if not inside:
            raise InputError(path, "", None, "is a folder without files; name the recordings, or their folder")
        found += inside
    return found


def _is_recording(path: Path) -> bool:
    return path.is_file() and not path.name.startswith(".") and path.suffix.lower() != ".toml"


def _open(path: Path, dialect: Dialect) -> tuple[dict[str, Variable], tuple[str, ...], tuple[str, ...]]:
    ending = path.suffix.lower()
    try:
        with path.open("rb"):  # what the system says is clearer than what libraries make of it
            pass
    except OSError as error:
        raise InputError(path, "", None, f"cannot be read: {error.strerror}") from error
    if ending in NOT_READ:
        raise InputError(path, "", None, NOT_READ[ending])
    if ending not in READERS:
        return delimited.read(path, dialect)
    read = READERS[ending]
    if ending not in APART:
        return intact(path, lambda: read(path)), (), ()
    library(APART[ending], path)
    return apart(path, read, path.absolute()), (), ()

"""A folder of runs and frequency responses with ``measurements.toml``, written whole or not at all, and read back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from flexdesign.core import toml_writing, unit_tables
from flexdesign.core.errors import InputError
from flexdesign.core.whole_files import written_whole
from flexdesign.measurements.importing.assembling import Recording, assemble
from flexdesign.measurements.importing.mapping import Map, read_map
from flexdesign.measurements.importing.readers import read_contents
from flexdesign.measurements.importing.sources import at_source
from flexdesign.measurements.recordings import (
    DESCRIPTION,
    FrequencyResponse,
    Run,
    frequency_response,
    read_recordings,
    write_run,
)


@dataclass(frozen=True)
class Imported:
    """What was written.

    Parameters
    ----------
    folder
        Where.
    runs
        The runs as they are read back, with remarks on what is wrong with them.
    responses
        The frequency responses, likewise.
    """

    folder: Path
    runs: tuple[Run, ...]
    responses: tuple[FrequencyResponse, ...] = ()


def bring_in(paths: Sequence[Path], plan: Path | Map, folder: Path) -> Imported:
    """Write the runs that a map makes of some files into a folder.

    Parameters
    ----------
    paths
        The files.
    plan
        The map, or its file.
    folder
        Where to.

    Raises
    ------
    InputError
        If a file or the map cannot be read, they do not fit together, a run that comes out cannot be used, or the
        folder cannot be written or has a ``measurements.toml`` already.
    """
    plan = read_map(plan) if isinstance(plan, Path) else plan
    recordings = _assemble(paths, plan)
    described = folder / DESCRIPTION
    if described.exists():
        raise InputError(
            described, "", None, "is there already, and may have been edited; choose another folder with -o"
        )
    names = [recording.name for recording in recordings]
    if twice := next((name for name in names if names.count(name) > 1), None):
        remedy = "two runs would be written to one file; give another name, or rename one of the files"
        raise InputError(plan.path, "run.name", twice, remedy)
    try:
        with _made(folder), written_whole(folder) as scratch:
            written = _write(recordings, plan, paths, scratch)
            found = _read_back(written, recordings, paths, plan)
    except OSError as error:
        raise InputError(folder, "", None, f"cannot be written: {error.strerror}; choose another folder") from error
    remark = {recording.name: recording.remarks for recording in recordings}
    found = tuple(replace(each, remarks=(*remark[each.name], *each.remarks)) for each in found)
    responses = tuple(each for each in found if isinstance(each, FrequencyResponse))
    return Imported(folder, tuple(each for each in found if isinstance(each, Run)), responses)


@contextmanager
def _made(folder: Path) -> Iterator[None]:
    """Make a folder and those it is in; after an error none of them stays that was not there before."""
    new = [each for each in (folder, *folder.parents) if not each.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        with suppress(OSError):  # somebody else has written there
            for each in new:
                each.rmdir()
        raise


def _assemble(paths: Sequence[Path], plan: Map) -> list[Recording]:
    """Return the recordings of all files: read together, or of each by itself, which are then named after it."""
    if not plan.per_file:
        return assemble(read_contents(paths, plan.dialect), plan)
    made = []
    for path in paths:
        for recording in assemble(read_contents([path], plan.dialect), plan, plan.of(path)):
            own = plan.runs[recording.number][0].name
            made.append(replace(recording, name=f"{path.stem}_{recording.name}") if own else recording)
    return made


def _write(recordings: Sequence[Recording], plan: Map, paths: Sequence[Path], folder: Path) -> list[Path]:
    origin = f"imported from {', '.join(path.name for path in paths)}"
    tables, written = [], []
    for recording in recordings:
        file = folder / f"{recording.name}.csv"
        try:
            if recording.time is None:
                unit_tables.write(file, recording.recorded, origin, gaps=True, allowed=frequency_response.ALLOWED)
            else:
                write_run(file, recording.time, recording.recorded, origin, gaps=True)
        except ValueError as error:  # a time or an infinite value, which no unit mends
            raise InputError(
                plan.path, f"run {recording.number + 1}", None, f"has a bad time or value: {error}"
            ) from error
        written.append(file)
        tables.append({"file": file.name, **plan.said_of_runs[recording.number]})
    description = folder / DESCRIPTION
    text = toml_writing.to_toml({**plan.stated, "run": tables})
    description.write_text(f"# {origin}\n{text}", encoding="utf-8")
    return [*written, description]


def _read_back(
    written: Sequence[Path], recordings: Sequence[Recording], paths: Sequence[Path], plan: Map
) -> tuple[Run | FrequencyResponse, ...]:
    try:
        return read_recordings(file for file in written if file.name != DESCRIPTION)
    except InputError as error:
        made_of = {str(file): recording for file, recording in zip(written, recordings, strict=False)}
        if recording := made_of.get(error.file):
            raise at_source(error, recording, paths, plan.path) from error
        raise InputError(plan.path, error.field, error.value, error.remedy) from error

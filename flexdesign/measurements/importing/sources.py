"""Where in the files of another program stands what is wrong with a run that was made of them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from flexdesign.core.errors import InputError
from flexdesign.measurements.importing.assembling import Recording
from flexdesign.measurements.recordings.reading import BRING_IN

#: Lines above the rows of a file as it is written: where it comes from, and the header.
ABOVE = 2
_PLACE = re.compile(r"(?:line (\d+), )?column (\w+)")
_LINES = re.compile(r"\blines? \d+(?:(?:, | to | and )\d+(?! more))*")


def at_source(error: InputError, recording: Recording, paths: Sequence[Path], plan: Path) -> InputError:
    """Return an error about a recording as one about the file, the line and the variable that it was made of.

    Parameters
    ----------
    error
        What was raised as the recording was read back; it names a line and a column of the file that was written.
    recording
        The recording.
    paths
        The files it may come from.
    plan
        The map, or what stands for it, which is named where a column is missing.
    """
    if error.field == "header":
        remedy = error.remedy.removesuffix(BRING_IN)
        return InputError(plan, f"run {recording.number + 1}.columns", error.value, remedy)
    place = _PLACE.fullmatch(error.field)
    column = place[2] if place and place[2] in recording.sources else next(iter(recording.sources), "")
    name, variable = recording.sources.get(column, ("", None))
    file = (variable.path if variable else None) or paths[0]
    remedy = _LINES.sub(lambda match: _lines(match[0], recording, column), error.remedy)
    if place is None:
        return InputError(file, error.field, error.value, remedy)
    said = f'column "{name}"' if place[2] == column and name else f"column {place[2]}"
    line = f"{_lines(f'line {place[1]}', recording, column)}, " if place[1] else ""
    return InputError(file, f"{line}{said}", error.value, remedy)


def _lines(written: str, recording: Recording, column: str) -> str:
    """Return lines of the file that was written as those of its source; as samples where that has no lines."""
    _, variable = recording.sources.get(column, ("", None))
    lines = variable.lines if variable else None

    def of_source(match: re.Match[str]) -> str:
        row = int(match[0]) - ABOVE - 1
        sample = int(recording.samples[row]) if recording.samples is not None else row
        return str(sample + 1 if lines is None else lines[sample])

    return re.sub(r"\d+", of_source, written if lines is not None else written.replace("line", "sample"))

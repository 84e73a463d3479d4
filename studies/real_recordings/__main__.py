"""The command ``python -m studies.real_recordings``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

from flexdesign.core import versions
from flexdesign.diagnosis import Diagnosis, diagnose
from flexdesign.dynamics import stage_model
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.measurements import recordings
from flexdesign.report import comparison_text as words
from flexdesign.report.diagnosis import diagnosis_text as said
from studies.real_recordings import varied
from studies.real_recordings.varied import Recordings


@dataclass(frozen=True)
class Recording:
    """Recordings in a folder, and where the diagnosis begins.

    Parameters
    ----------
    folder, title
        Name of the folder, and what was measured.
    axis
        Which axis; empty if there is one.
    model
        The axis of a stage model, where the folder has no ``model.toml``.
    """

    folder: str
    title: str
    axis: str = ""
    model: str = ""


RECORDINGS = (
    Recording("positioning-drive", "EMPS: carriage with a drive, closed loop"),
    Recording("piezo-loops", "PZT plate, quasi-static loops"),
    Recording("disc-player-arm", "disc player arm, x", axis="x"),
    Recording("disc-player-arm", "disc player arm, y", axis="y"),
    Recording(
        "duffing-circuit",
        "Silverbox: Duffing circuit",
        model='natural_frequency = "70 Hz"\ndamping_ratio = 0.05\ngain = "1 V/V"',
    ),
    Recording(
        "piezo-actuator",
        "piezo actuator, cycles after a step",
        model='natural_frequency = "967 Hz"\ndamping_ratio = 0.03\ngain = "0.13 um/V"',
    ),
)
HEADS = ("recording", "verdict", "named", "as designed", "recalibrated", "with effects", "remains", "processor time")


def row(title: str, found: Diagnosis, seconds: float) -> tuple[str, ...]:
    """Return what was said of a recording: errors are those of the validation runs, rms; seconds of the processor."""
    si = said.response(found)
    errors = {rung.label: words.error(si, rung.error) for rung in found.error_ladder}
    named = ", ".join(said.effect_name(each.name) for each in found.effects) or "–"
    rest = words.error(si, found.remainder_rms) if found.remainder_rms else "noise"
    with_effects = words.error(si, found.error) if found.effects else "–"
    errors_before = errors["as designed"], errors["recalibrated"]
    return title, found.verdict, named, *errors_before, with_effects, rest, f"{seconds:.0f} s"


def read(recording: Recording, folder: Path) -> tuple[StageModel, Recordings]:
    """Return the model from which a diagnosis begins, and what was recorded."""
    with TemporaryDirectory() as scratch:
        path = folder / "model.toml"
        if recording.model:
            path = Path(scratch) / "model.toml"
            path.write_text(f"format = 1\n[axis.x]\n{recording.model}\n", encoding="utf-8")
        return stage_model.read(str(path), []), recordings.read_recordings([folder])


def diagnose_recording(recording: Recording, folder: Path) -> Diagnosis:
    """Return the diagnosis of a recording."""
    model, recorded = read(recording, folder)
    return diagnose(model, recorded, axis=recording.axis or None)


def write(heads: Sequence[str], rows: Sequence[tuple[str, ...]], option: str, out: Path) -> None:
    """Write the table of what is diagnosed so far, as Markdown and as JSON."""
    out.mkdir(parents=True, exist_ok=True)
    made = ", ".join(f"{name} {version}" for name, version in versions.installed().items())
    lines = [
        "# Recordings of others",
        "",
        f"Made by `python -m studies.real_recordings FOLDER{option}` ({made}).",
        "",
        *(f"| {' | '.join(cells)} |" for cells in (heads, ["---"] * len(heads), *rows)),
    ]
    result: dict[str, Any] = {"rows": [dict(zip(heads, cells, strict=True)) for cells in rows]}
    (out / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (out / "result.json").write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose what is there; print and write the table, row by row."""
    parser = argparse.ArgumentParser(prog="python -m studies.real_recordings", description="Recordings of others")
    parser.add_argument("folder", type=Path, help="folder that holds the folders of recordings")
    parser.add_argument("--vary", action="store_true", help="begin with other models and with shorter recordings, too")
    parser.add_argument("--out", type=Path, help="folder of the table")
    given = parser.parse_args(arguments)
    out = given.out or Path("reports/varied_recordings" if given.vary else "reports/real_recordings")
    heads, option = (varied.HEADS, " --vary") if given.vary else (HEADS, "")
    rows = list[tuple[str, ...]]()
    for recording in RECORDINGS:
        folder = given.folder / recording.folder
        if not folder.is_dir():
            print(f"{folder} is not there; left out", file=sys.stderr)
            continue
        for cells in _rows(recording, folder, is_varied=given.vary):
            rows.append(cells)
            print("  ".join(cells), flush=True)
            write(heads, rows, option, out)  # an interruption loses nothing
    if not rows:
        print(f"error: {given.folder} holds none of {', '.join(r.folder for r in RECORDINGS)}", file=sys.stderr)
        return 2
    return 0


def _rows(recording: Recording, folder: Path, *, is_varied: bool) -> Iterator[tuple[str, ...]]:
    """Yield the rows of a recording: one, or one for each variation."""
    if not is_varied:
        began = process_time()
        found = diagnose_recording(recording, folder)
        yield row(recording.title, found, process_time() - began)
        return
    model, recorded = read(recording, folder)
    for variation in varied.VARIATIONS:
        changed = variation.of_model(model), variation.of_recordings(recorded)
        yield varied.row(recording.title, variation, diagnose(*changed, axis=recording.axis or None))


if __name__ == "__main__":
    sys.exit(main())

"""The command ``python -m studies.real_recordings``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

from flexdesign.core import versions
from flexdesign.diagnosis import Diagnosis, diagnose
from flexdesign.dynamics import stage_model
from flexdesign.measurements import recordings
from flexdesign.report import comparison_text as words
from flexdesign.report.diagnosis import diagnosis_text as said


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


def diagnose_recording(recording: Recording, folder: Path) -> Diagnosis:
    """Return the diagnosis of a recording."""
    with TemporaryDirectory() as scratch:
        path = folder / "model.toml"
        if recording.model:
            path = Path(scratch) / "model.toml"
            path.write_text(f"format = 1\n[axis.x]\n{recording.model}\n", encoding="utf-8")
        model = stage_model.read(str(path), [])
        return diagnose(model, recordings.read_recordings([folder]), axis=recording.axis or None)


def write(rows: Sequence[tuple[str, ...]], out: Path) -> None:
    """Write the table of what is diagnosed so far, as Markdown and as JSON."""
    out.mkdir(parents=True, exist_ok=True)
    made = ", ".join(f"{name} {version}" for name, version in versions.installed().items())
    lines = [
        "# Recordings of others",
        "",
        f"Made by `python -m studies.real_recordings FOLDER` ({made}).",
        "",
        *(f"| {' | '.join(cells)} |" for cells in (HEADS, ["---"] * len(HEADS), *rows)),
    ]
    result: dict[str, Any] = {"rows": [dict(zip(HEADS, cells, strict=True)) for cells in rows]}
    (out / "report.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (out / "result.json").write_text(json.dumps(result, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Diagnose what is there; print and write the table, row by row."""
    parser = argparse.ArgumentParser(prog="python -m studies.real_recordings", description="Recordings of others")
    parser.add_argument("folder", type=Path, help="folder that holds the folders of recordings")
    parser.add_argument("--out", type=Path, default=Path("reports/real_recordings"), help="folder of the table")
    given = parser.parse_args(arguments)
    rows = list[tuple[str, ...]]()
    for recording in RECORDINGS:
        folder = given.folder / recording.folder
        if not folder.is_dir():
            print(f"{folder} is not there; left out", file=sys.stderr)
            continue
        began = process_time()
        found = diagnose_recording(recording, folder)
        rows.append(row(recording.title, found, process_time() - began))
        print("  ".join(rows[-1]), flush=True)
        write(rows, given.out)  # an interruption loses nothing
    if not rows:
        print(f"error: {given.folder} holds none of {', '.join(r.folder for r in RECORDINGS)}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""``flexdesign check``: contents of recordings, what is suspicious, and the effects a diagnosis can identify."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import MEASUREMENTS, AsJson, app, next_step, progress, report_folder, show

HELP = """Check recordings before a fit: what they hold, what is suspicious, and which effects they can reveal.

RUNS are runs in time, frequency responses, static tables, or folders of them. No model is needed.

**Examples**

    flexdesign check recordings/

    flexdesign check steps.csv response.csv --json

**Result:** for each recording its kind of experiment, role, length, rate, channels, range and noise. Suspicions, each
with a remedy: the same command in a fitted and a validation run; a command that is held, or shifted by a
sample or by half of one; a response that is saturated, stuck, or does not follow; dropped samples and an irregular
clock; filtered or unknown noise; too few samples in a period, or far more than needed; measurements in a static table
that do not go together. Then the effects of the catalogue that these experiments can reveal, and for each other effect
the experiment that would.

**Output:** with --out, report.html, report.md and result.json.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=MEASUREMENTS)
def check(
    recordings: Annotated[list[Path], typer.Argument(metavar="RUNS...", help="Recordings: files or folders.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report [default: none is written].", show_default=False)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check recordings and print what was found."""
    from flexdesign.api import recordings as measured

    with progress() as say:
        say("reading the recordings")
        found = measured.check(recordings)
        written = report_folder(out, "", "check", recordings).write(found) if out else []
    show(found, written, as_json)
    if found.recordings and not as_json:
        next_step("compare", "MODEL", *recordings)

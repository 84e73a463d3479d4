"""``flexdesign doctor``: what the installation has and lacks."""

from __future__ import annotations

import typer

from flexdesign.cli.shared import INSTALLATION, AsJson, CacheFolder, app, progress, show

HELP = """Say what the installation has and lacks, and how to get it.

Versions; each extra with what it brings and the command that installs it; the solver; whether pictures can be drawn;
free memory; whether cache, working and temporary folder can be written.

**Examples**

    flexdesign doctor

    flexdesign doctor --json

**Exit codes:** 0 no problem; 1 a problem was found; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=INSTALLATION)
def doctor(cache: CacheFolder = None, as_json: AsJson = False) -> None:
    """Look at the installation and print what was found."""
    from flexdesign.api import health

    with progress() as say:
        say("looking at the installation")
        found = health.doctor(cache)
    show(found, [], as_json)
    if not found.is_sound:
        raise typer.Exit(1)

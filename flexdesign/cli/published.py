"""``flexdesign published``: mechanisms whose numbers are published, and ours."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import PUBLICATIONS, AsJson, CacheFolder, app, progress, report_folder, show

HELP = """Compare published numbers of mechanisms with finite elements, and name the effect that closes each gap.

MECHANISM is a folder, or the name of one in studies/published; all of these by default. A folder holds one TOML file,
a design or a study, and one CSV file with the columns `quantity,value,unit,sigma,boundary,place,kind,neglects`:
quantity and boundary as `validate` names them, the place where the number is printed, the kind (formula, simulation or
measurement), and the static effects that a formula leaves out. A last column `note` may explain a difference.

**Examples**

    flexdesign published

    flexdesign published leaf_pivot my_mechanism/ --json

**Output:** report.html, report.md, result.json and the figure, in --out: theirs, ours, the uncertainty of both, and
what closes each gap.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=PUBLICATIONS)
def published(
    mechanisms: Annotated[
        list[str] | None, typer.Argument(metavar="[MECHANISM...]", help="Folders, or their names.", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the report [default: reports/published].")] = None,
    as_json: AsJson = False,
    cache: CacheFolder = None,
) -> None:
    """Compare published mechanisms with ours and write the page."""
    from flexdesign.api import published as api
    from flexdesign.workflows import published as workflow

    with progress() as say:
        folders = workflow.find(mechanisms or [])
        files = [file for folder in folders for file in sorted((*folder.glob("*.toml"), *folder.glob("*.csv")))]
        where = report_folder(out, "published", "published", files)
        found = api.published(*folders, cache=cache, progress=say)
        say("writing")
        written = where.write(found)
    show(found, written, as_json)

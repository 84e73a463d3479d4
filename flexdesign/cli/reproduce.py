"""``flexdesign reproduce``: every printed value of a publication, with a verdict."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import PUBLICATIONS, AsJson, CacheFolder, app, progress, report_folder, show

HELP = """Reproduce every printed value of a publication, each with a verdict.

PUBLICATION is a file of printed values, or the bare name of one in studies/. Its stage is solved by finite elements and
its experiments are simulated. The report has a row for every table, figure and equation: the printed value, ours, and
the verdict: agrees, agrees by construction, contradictory with the reason, not printed, or differs.

**Examples**

    flexdesign reproduce lin2019

    flexdesign reproduce lin2019 --out reports/paper --json

**Keys of --set:** those of the study of the stage (`mesh.*`, `dimensions.*` and all others of `validate`).

**Output:** report.html, report.md, result.json and the figures, in --out.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.

The command takes some minutes; meshes and condensed parts are cached, so that a second run takes less time.
"""


@app.command(help=HELP, rich_help_panel=PUBLICATIONS)
def reproduce(
    publication: Annotated[str, typer.Argument(help="Printed numbers: a path, or a bare name.")] = "lin2019",
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change one value, e.g. mesh.levels=3.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report [default: reports/PUBLICATION].", show_default=False)
    ] = None,
    as_json: AsJson = False,
    cache: CacheFolder = None,
) -> None:
    """Reproduce a publication and write the report."""
    from flexdesign.api import studies
    from flexdesign.core import printed_numbers
    from flexdesign.report import origin

    with progress() as say:
        file = printed_numbers.find(publication)
        where = report_folder(out, origin.name_of(file), "reproduce", [file], overrides or [])
        found = studies.reproduce(publication, overrides or [], cache=cache, progress=say)
        say("writing")
        written = where.write(found)
    show(found, written, as_json)

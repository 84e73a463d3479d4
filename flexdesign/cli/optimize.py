"""``flexdesign optimize``: the best dimensions within limits, checked by finite elements."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import DESIGN, AsJson, app, progress, report_folder, show

HELP = """Find the best dimensions for one aim within limits, checked by finite elements.

STUDY is a sweep file (see `flexdesign sweep --help`) with ranges, limits and one aim, or the bare name of one in
studies/. The formulas are optimised; finite elements check the optimum and correct the formulas, until both agree. The
values of a list, such as materials, are tried one by one.

**Examples**

    flexdesign optimize stiffest_amplifier

    flexdesign optimize stiffest_amplifier --set limits.K_in_output_free="< 2 N/um"

    flexdesign optimize stiffest_amplifier --no-check

**Output:** optimum.toml (the design), report.html, report.md and result.json, in --out.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 no design keeps all limits, or
internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=DESIGN)
def optimize(
    study: Annotated[str, typer.Argument(help="Sweep with limits and one aim: a path, or a bare name.")],
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change one value of sweep or design; may be repeated."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report [default: reports/STUDY].", show_default=False)
    ] = None,
    check: Annotated[bool, typer.Option(help="Check and correct by finite elements.")] = True,
    as_json: AsJson = False,
) -> None:
    """Optimise a design and write its report."""
    from flexdesign.api import studies
    from flexdesign.report import origin

    with progress() as say:
        plan = studies.read_sweep(study, overrides or [])
        where = report_folder(
            out, origin.name_of(plan.file), "optimize", [plan.file, plan.subject_file], overrides or []
        )
        found = studies.optimize(plan, check=check, progress=say)
        written = where.write(found)
    show(found, written, as_json)
    if found.broken:
        raise typer.Exit(1)

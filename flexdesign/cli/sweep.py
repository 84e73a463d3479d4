"""``flexdesign sweep``: many versions of one design, and the best of them."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import DESIGN, AsJson, app, progress, report_folder, show

HELP = """Evaluate many versions of a design, save every answer, and find the best.

STUDY is a file that names a design, or a stage model, and the parameters to vary; or the bare name of one in studies/:

    format = 1
    design = "lin2019_amplifier_xy.toml"
    evaluator = "analytic"                   # pseudo-rigid, analytic, planar, fem or simulation

    [vary]
    "dimensions.hinge_thickness" = { from = "0.3 mm", to = "0.8 mm", count = 21 }
    material = ["AZ31B", "Al 7075-T6"]

    [sample]                                 # default: every combination
    method = "sobol"                         # grid, latin-hypercube, sobol, or sensitivity for Sobol' indices
    count = 64

    [limits]
    K_in_output_free = "< 2 N/um"
    "|stroke_output_free|" = "> 150 um"

    [aim]
    maximise = "K_out_actuator_installed"    # several aims give a Pareto front

**Examples**

    flexdesign sweep hinge_thickness

    flexdesign sweep hinge_thickness --set sample.method=sobol --set sample.count=256

    flexdesign sweep what_matters

    flexdesign sweep hinge_thickness --set evaluator=fem --set mesh.accuracy="1 %" --jobs 4

    flexdesign sweep payload_and_damping

    flexdesign sweep hinge_thickness --scheduler tcp://192.168.1.10:8786

**Output:** report.html, report.md, result.json, cases.csv (cases.parquet too if pyarrow is installed) and the pictures,
in --out; and the answers, in its folder cases/, under the hash of design, part, engine and versions. After an
interruption, only missing cases are computed; the same holds for a finer grid, or a second sweep in the same folder. A
failed case is recorded with its reason; the sweep continues.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


#: The files that the terminal names.
NAMED = ("report.html", "report.md", "result.json", "cases.csv")


@app.command(help=HELP, rich_help_panel=DESIGN)
def sweep(
    study: Annotated[str, typer.Argument(help="Sweep: a path, or a bare name.")],
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change one value, e.g. sample.count=256; may be repeated."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for report and answers [default: reports/STUDY_CHANGES].", show_default=False),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Number of processes [default: one per processor].", show_default=False)
    ] = None,
    scheduler: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="Dask scheduler of a cluster, e.g. tcp://10.0.0.2:8786."),
    ] = "",
    as_json: AsJson = False,
) -> None:
    """Run a sweep and write its report."""
    from flexdesign.api import studies
    from flexdesign.report import origin

    with progress() as say:
        plan = studies.read_sweep(study, overrides or [])
        where = report_folder(out, origin.name_of(plan.file), "sweep", [plan.file, plan.subject_file], overrides or [])
        processes = jobs or os.cpu_count() or 1
        found = studies.sweep(plan, store=where.folder, jobs=processes, scheduler=scheduler, progress=say)
        say("writing the report")
        written = where.write(found)
    show(found, [path for path in written if path.name in NAMED], as_json)

"""``flexdesign compare``: a stage model beside recorded runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import AsJson, Noise, StageOverrides, app, file_of, listed, progress, report_folder, show

HELP = """Compare a stage model with recorded runs: by how much it fails, and where.

MODEL is a stage model: a file that `validate` or `identify` wrote, or the bare name of one in studies/. RUNS are CSV
files with the columns `t [s]`, `u [V]` and `x [um]`, frequency responses with the columns `f [Hz]`,
`magnitude [um/V]`, `phase [deg]` and `coherence`, or folders of them. Nothing is fitted: each run is predicted with
the model as it is, driven by the voltage at the stack where a column `v [V]` holds it.

**Examples**

    flexdesign compare my_stage.toml recordings/

    flexdesign compare my_stage.toml steps.csv sine.csv --axis x --json

**What it says:** the error of each run, largest and rms, beside the stroke and the noise floor; then where the error
above the noise lies: by run, frequency band, position, velocity, voltage and time since the last step. The noise is
measured where every command stands still, else from periods or runs that repeat themselves.

**Of a part at rest:** where MODEL is a design (a file with `part = ...`, or the bare name of one in geometry/), RUNS
are static tables, CSV with the columns `quantity,value,unit,sigma,boundary` and one for each dimension that differs,
such as `hinge_thickness [mm]`: K_in, lambda and K_out with the other port free, held or (K_out) with the actuator in
place. Differences count where they exceed the validation uncertainty, of measurement, tolerances and model.

**What it writes:** report.html, report.md, result.json and the figures, into --out.

**Exit codes:** 0 done; 2 the input cannot be used, and one message says why; 1 our fault; 130 interrupted.
"""


@app.command(help=HELP)
def compare(
    model: Annotated[str, typer.Argument(help="Stage model: a path, or a bare name.")],
    recordings: Annotated[list[Path], typer.Argument(metavar="RUNS...", help="Recorded runs: files or folders.")],
    axis: Annotated[str | None, typer.Option(help="Which axis, where several could be meant.")] = None,
    noise: Noise = None,
    overrides: StageOverrides = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the report [default: reports/MODEL_compared].", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Compare a stage model with runs and write the report."""
    from flexdesign.api import recordings as measured
    from flexdesign.report import origin

    with progress() as say:
        files, options = [file_of(model), *recordings], listed(axis=axis, noise=noise)
        where = report_folder(out, origin.name_of(files[0]), "compare", files, overrides or [], options, "_compared")
        found = measured.compare(model, recordings, overrides or [], axis=axis, noise=noise, progress=say)
        say("writing")
        written = where.write(found)
    show(found, written, as_json)

"""``flexdesign compare``: the error of a stage model against recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import (
    MEASUREMENTS,
    AsJson,
    AxisName,
    ModelName,
    Noise,
    Recordings,
    StageOverrides,
    app,
    file_of,
    listed,
    next_step,
    progress,
    report_folder,
    show,
)

HELP = """Compare a stage model with recordings: the size and the location of its error.

MODEL is a stage model: a file written by `validate` or `identify`, or the bare name of one in studies/. RUNS are CSV
files with the columns `t [s]`, `u [V]` and `x [um]`, frequency responses with the columns `f [Hz]`, `magnitude [um/V]`,
`phase [deg]` and `coherence`, or folders of them. Only the initial conditions of each run are fitted. A column `v [V]`,
the voltage at the stack, replaces the command as input of the model.

**Examples**

    flexdesign compare my_stage.toml recordings/

    flexdesign compare my_stage.toml steps.csv sine.csv --axis x --json

**Result:** the error of each run, largest and rms, relative to the stroke and to the noise floor; then the location of
the error above the noise: by run, frequency band, position, velocity, voltage and time since the last step. The noise
is estimated from stretches with a constant command, or from periods or repeated runs.

**Static tables:** if MODEL is a design (a file with `part = ...`, or the bare name of one in geometry/), RUNS are
static tables, CSV with the columns `quantity,value,unit,sigma,boundary` and one for each dimension that differs, such
as `hinge_thickness [mm]`: K_in, lambda and K_out with the other port free, held or (K_out) with the actuator installed.
Displacements `u_x`, `u_y` and `theta_z` under a load in columns `F_x [N]`, `F_y [N]`, `M_z [N m]` have the boundary
`loaded`. A difference counts if it exceeds the validation uncertainty, of measurement, tolerances and model.

**Output:** report.html, report.md, result.json and the figures, in --out.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=MEASUREMENTS)
def compare(
    model: ModelName,
    recordings: Recordings,
    axis: AxisName = None,
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
    if not found.agrees and not as_json:
        next_step("diagnose", model, *recordings)

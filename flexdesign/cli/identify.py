"""``flexdesign identify``: the free parameters of a stage model from recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import (
    MEASUREMENTS,
    AsJson,
    AxisName,
    ModelFile,
    ModelName,
    Recordings,
    StageOverrides,
    app,
    file_of,
    listed,
    progress,
    report_folder,
    show,
    write_file,
)

HELP = """Fit the free parameters of a stage model to recorded runs, and state which the runs do not determine.

MODEL is a stage model: a file written by `validate`, or the bare name of one in studies/. RUNS are CSV files with the
columns `t [s]`, `u [V]` and `x [um]`, or folders of them. A `measurements.toml` in the same folder may state runs for
validation (`role = "validate"`) or for testing (`role = "test"`): these are predicted, not fitted.

**Examples**

    flexdesign identify my_stage.toml recordings/ -o my_stage_identified.toml

    flexdesign identify my_stage.toml sine.csv step.csv --axis x --free gain,damping_ratio

    flexdesign identify my_stage.toml sweep.csv --set axis.x.effects.creep.per_decade=0.01 --free gain,creep.per_decade

**Parameters:** gain, damping_ratio and natural_frequency, and bouc_wen.a, b, c and rest if the model has hysteresis;
--free names others, such as controller.delay or the parameters of an effect. A stated uncertainty is a prior, unless
the parameter is assumed. Parameters that the runs do not determine are held and reported.

**Frequency responses** are for `flexdesign diagnose`, which fits gain, damping_ratio and natural_frequency to them,
alone or together with runs, and writes the model. The intervals of `identify` need residuals in time.

**Output:** report.html, report.md, result.json, stage_model.toml and the figures, in --out.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=MEASUREMENTS)
def identify(
    model: ModelName,
    recordings: Recordings,
    model_file: ModelFile = None,
    axis: AxisName = None,
    free: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Parameters to fit, e.g. gain,damping_ratio,bouc_wen.a.")
    ] = None,
    overrides: StageOverrides = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the report [default: reports/MODEL_identified].", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fit a stage model to runs and write the report."""
    from flexdesign.api import recordings as measured
    from flexdesign.report import origin

    names = None if free is None else [name.strip() for name in free.split(",") if name.strip()]
    with progress() as say:
        files, options = [file_of(model), *recordings], listed(axis=axis, free=free)
        where = report_folder(out, origin.name_of(files[0]), "identify", files, overrides or [], options, "_identified")
        write_file(model_file)
        found = measured.identify(model, recordings, overrides or [], axis=axis, free=names, progress=say)
        say("writing")
        written = where.write(found, model_file=model_file)
    show(found, written, as_json)

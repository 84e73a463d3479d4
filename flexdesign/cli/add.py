"""``flexdesign add``: fit one effect to recordings and write it into a stage model."""

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
    Noise,
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

HELP = """Fit one effect to recordings, and write it into a stage model.

MODEL is a stage model: a file written by `validate` or `identify`, or the bare name of one in studies/. EFFECT is one
of `flexdesign effects`, or the path of a file with an effect of your own. RUNS are CSV files or folders of them: runs
in time with the columns `t [s]`, `u [V]` and `x [um]`, or frequency responses with `f [Hz]`, `magnitude [um/V]`,
`phase [deg]` and `coherence`. All are fitted together.

**Examples**

    flexdesign add my_stage.toml creep recordings/ -o my_stage_creeping.toml

    flexdesign add my_stage.toml my_effect.py recordings/ --axis x --json

**Method:** fits the parameters of the model without and with the effect, and compares the error on validation runs;
states if the effect is not significant; and simulates a closed loop without and with it.

**Static tables:** if MODEL is a design, EFFECT is a static effect, or the path of a file with one of your own, and RUNS
are static tables (see `flexdesign diagnose --help`); the design with the effect is written to -o.

**Output:** the stage model with the effect, in -o; report.html, report.md, result.json and the figures, in --out.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=MEASUREMENTS)
def add(
    model: ModelName,
    effect: Annotated[str, typer.Argument(help="Effect: a name, or the path of a file.")],
    recordings: Recordings,
    model_file: ModelFile = None,
    axis: AxisName = None,
    noise: Noise = None,
    overrides: StageOverrides = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the report [default: reports/MODEL_with_EFFECT].", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Add an effect to a stage model and write the report."""
    from flexdesign.api import recordings as measured
    from flexdesign.report import origin

    with progress() as say:
        files, options = [file_of(model), *recordings], listed(axis=axis, noise=noise)
        ending = f"_with_{Path(effect).stem}"
        where = report_folder(out, origin.name_of(files[0]), f"add {effect}", files, overrides or [], options, ending)
        write_file(model_file)
        found = measured.add_effect(model, effect, recordings, overrides or [], axis=axis, noise=noise, progress=say)
        say("writing")
        written = where.write(found, model_file=model_file)
    show(found, written, as_json)

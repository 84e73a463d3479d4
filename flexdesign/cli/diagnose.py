"""``flexdesign diagnose``: the physical effect that a stage model lacks, from recordings."""

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
    next_step,
    progress,
    report_folder,
    show,
    write_file,
)

HELP = """Find the physical effect that a stage model lacks, from recordings.

MODEL is a stage model: a file written by `validate` or `identify`, or the bare name of one in studies/. RUNS are CSV
files with the columns `t [s]`, `u [V]` and `x [um]`, frequency responses with the columns `f [Hz]`, `magnitude [um/V]`,
`phase [deg]` and `coherence`, or folders of them. A `measurements.toml` in the same folder may state the validation
runs (`role = "validate"`).

**Examples**

    flexdesign diagnose my_stage.toml recordings/

    flexdesign diagnose my_stage.toml recordings/ -o my_stage_better.toml --tolerance "20 nm"

    flexdesign diagnose my_stage.toml steps.csv sine.csv --axis x --effect my_effect.py

**Method:** estimates the noise, fits the parameters of the model within their priors, screens every effect of the
catalogue, and adds significant effects that also reduce the error of the validation runs.

**Result:** one of three verdicts. Nothing is missing. Or: the missing effects, each with value, unit, 95 % interval,
explained share and remedy, the effects that these runs cannot distinguish from it, the experiment that distinguishes
them, and the remaining residual. Or: unknown, if no effect of the catalogue explains a large share of the residual,
with its shape.

**Static tables:** if MODEL is a design (a file with `part = ...`, or the bare name of one in geometry/), RUNS are
static tables, CSV with the columns `quantity,value,unit,sigma,boundary` and one for each dimension that differs, such
as `hinge_thickness [mm]`, for a stage also `axis`. The static effects are fitted, also your own (`--effect`), and the
result is written to design.toml.

    flexdesign diagnose bridge_amplifier thickness_series.csv -o as_cut.toml

**Output:** report.html, report.md, result.json, stage_model.toml and the figures, in --out.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=MEASUREMENTS)
def diagnose(
    model: ModelName,
    recordings: Recordings,
    model_file: ModelFile = None,
    axis: AxisName = None,
    effect: Annotated[
        list[str] | None, typer.Option(metavar="PATH", help="File with an effect of your own, tried with the others.")
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help='Relevant rms error, e.g. "0.2 um" or "0.1 %" of the stroke, the largest peak-to-peak reading of a '
            "run: a smaller residual counts as zero, and no effect is named that changes a prediction by less "
            "[default: 0.05 % of the stroke or 0.3 of the noise, whichever is less].",
            show_default=False,
        ),
    ] = None,
    noise: Noise = None,
    bare: Annotated[bool, typer.Option("--bare", help="For a design: start from hinges that only rotate.")] = False,
    overrides: StageOverrides = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the report [default: reports/MODEL_diagnosed].", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Diagnose a stage model and write the report."""
    from flexdesign.api import recordings as measured
    from flexdesign.report import origin

    with progress() as say:
        files = [file_of(model), *recordings]
        options = [
            *listed(axis=axis, noise=noise, tolerance=tolerance, effect=effect, bare=bare or None),
        ]
        where = report_folder(out, origin.name_of(files[0]), "diagnose", files, overrides or [], options, "_diagnosed")
        write_file(model_file)
        found = measured.diagnose(
            model, recordings, overrides or [], axis=axis, effects=effect or [], tolerance=tolerance, noise=noise,
            bare=bare, progress=say,
        )  # fmt: skip
        say("writing")
        written = where.write(found, model_file=model_file)
    show(found, written, as_json)
    if model_file and not as_json:
        next_step("compare", model_file, *recordings)

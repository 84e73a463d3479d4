"""``flexdesign diagnose``: which physical effect a stage model lacks, judged by recorded runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import (
    AsJson,
    Noise,
    StageOverrides,
    app,
    file_of,
    listed,
    progress,
    report_folder,
    show,
    write_file,
)

HELP = """Find which physical effect a stage model lacks, from recorded runs.

MODEL is a stage model: a file that `validate` or `identify` wrote, or the bare name of one in studies/. RUNS are CSV
files with the columns `t [s]`, `u [V]` and `x [um]`, frequency responses with the columns `f [Hz]`,
`magnitude [um/V]`, `phase [deg]` and `coherence`, or folders of them; a `measurements.toml` beside them may say
which runs are kept for validation (`role = "validate"`).

**Examples**

    flexdesign diagnose my_stage.toml recordings/

    flexdesign diagnose my_stage.toml recordings/ -o my_stage_better.toml --tolerance "20 nm"

    flexdesign diagnose my_stage.toml steps.csv sine.csv --axis x --effect my_effect.py

**What it does:** reads the noise, fits the model's own numbers within what is known of them, screens every effect of
the catalogue, and adds those that explain more than chance does, on validation runs, too.

**What it says:** nothing is missing; or which effects are, with value, unit and 95 % interval, how much each explains,
what to do about it, which others these runs cannot tell from it, with the experiment that would, and how much remains
beside them; or that no effect known here explains a large share of what is missing, and what it looks like.

**Of a part at rest:** where MODEL is a design (a file with `part = ...`, or the bare name of one in geometry/), RUNS
are static tables, CSV with the columns `quantity,value,unit,sigma,boundary` and one for each dimension that differs,
such as `hinge_thickness [mm]`, of a whole stage also `axis`: the static effects are fitted, those of your own
(`--effect`) among them, and the answer goes into design.toml.

    flexdesign diagnose bridge_amplifier thickness_series.csv -o as_cut.toml

**What it writes:** report.html, report.md, result.json, stage_model.toml and the figures, into --out.

**Exit codes:** 0 done; 2 the input cannot be used, and one message says why; 1 our fault; 130 interrupted.
"""


@app.command(help=HELP)
def diagnose(
    model: Annotated[str, typer.Argument(help="Stage model: a path, or a bare name.")],
    recordings: Annotated[list[Path], typer.Argument(metavar="RUNS...", help="Recorded runs: files or folders.")],
    model_file: Annotated[
        Path | None,
        typer.Option("-o", metavar="FILE", help="Where the model goes [default: stage_model.toml in --out]."),
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Which axis, where several could be meant.")] = None,
    effect: Annotated[
        list[str] | None, typer.Option(metavar="PATH", help="A file with an effect of your own, tried with the others.")
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help='What matters, rms, e.g. "0.2 um" or "0.1 %" of the stroke: a smaller residual counts as none, and no '
            "effect is named that moves a prediction by less [default: 0.05 % of the stroke or 0.3 of the noise; 0.1 % "
            "of the stroke where the noise is unknown].",
            show_default=False,
        ),
    ] = None,
    noise: Noise = None,
    bare: Annotated[
        bool, typer.Option("--bare", help="For a design: begin with hinges that only rotate, and ask what they lack.")
    ] = False,
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

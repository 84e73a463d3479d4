"""``flexdesign simulate``: experiments on a stage model, in open and closed loop."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import SIMULATION, AsJson, ModelName, StageOverrides, app, progress, report_folder, show

HELP = """Simulate a stage: hysteresis, feedforward, PID, steps, tracking, lines.

MODEL is a stage model: a file written by `validate` or `identify`, or the bare name of one in studies/. STUDY lists the
experiments (by default hysteresis, step, sine and staircase of each axis within its range). The report shows every
controller on every variant of the stage, and the published values of the study in the same tables.

**Examples**

    flexdesign simulate lin2019_stage lin2019_experiments

    flexdesign simulate reports/bridge_amplifier/stage_model.toml

    flexdesign simulate my_stage.toml --set axis.x.damping_ratio=0.02 --runs

**Keys of --set:** those of the stage model (`axis.*`, `controller.*`, `coupling.*`) and of the study (`robust_ms`,
`cycled`); `--set axis.x.mass*=1.1` multiplies the value of the file.

**Output:** report.html, report.md, result.json, stage_model.toml and the figures, in --out; with --runs also
runs/*.csv, recordings that `identify` reads.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=SIMULATION)
def simulate(
    model: ModelName = "lin2019_stage",
    study: Annotated[
        str | None, typer.Argument(help="Study of experiments: a path, or a bare name [default: standard experiments].")
    ] = None,
    overrides: StageOverrides = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report [default: reports/MODEL_STUDY].", show_default=False)
    ] = None,
    as_json: AsJson = False,
    with_runs: Annotated[bool, typer.Option("--runs", help="Also write every response as a recording.")] = False,
) -> None:
    """Run experiments and write their report."""
    from flexdesign.api import models
    from flexdesign.dynamics import experiments, stage_model
    from flexdesign.report import origin
    from flexdesign.report.simulation import simulation_report

    with progress() as say:
        files = [stage_model.find(model), *([experiments.find(study)] if study else [])]
        name = f"{origin.name_of(files[0])}_{origin.name_of(files[1]) if study else 'standard'}"
        where = report_folder(out, name, "simulate", files, overrides or [])
        found = models.simulate(model, study, overrides or [], progress=say)
        say("writing")
        written = where.write(found)
        if with_runs:
            simulation_report.write_runs(found.found, where.folder / "runs")
    show(found, written, as_json)

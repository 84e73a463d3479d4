"""``flexdesign plan``: command files for the bench, within its limits, as inputs of a diagnosis."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import (
    MEASUREMENTS,
    AsJson,
    ModelName,
    StageOverrides,
    app,
    listed,
    progress,
    report_folder,
    show,
)

HELP = """Write command files for the bench, within its limits, as inputs of a diagnosis.

MODEL is a stage model: a file written by `validate` or `identify`, or the bare name of one in studies/. Commands are
designed for its modes and damping. If slew rate or motion would be too large they are reduced, with a remark. The slew
rate of the voltage must be known: from `driver.slew` of the model, --slew, or --current and the capacitance of the
stacks. Without it no command is written; `--slew none` states that there is no limit.

**Examples**

    flexdesign plan my_stage.toml --axis x --slew "2000 V/s" --out bench

    flexdesign plan my_stage.toml --current "50 mA" --bandwidth "400 Hz" --rate "8 kHz"

    flexdesign plan my_stage.toml --resolve payload_mass stiffness_loss --sensor-noise "20 nm"

**Experiments:** a quiet record, small calibration steps, multisines of three amplitudes with two realisations of two
periods each, steps of several heights, triangles at two rates, a staircase, a hold of 100 s, a decaying sine and random
levels for validation, and a multisine with a known added mass. With --resolve: the experiments that distinguish two
effects, found by simulation with either effect: what remains when the second is fitted to the first.

**Output:** commands/*.csv and commands/measurements.toml, to which you add the recorded responses; report.html,
report.md, result.json and the figures, in --out.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""


@app.command(help=HELP, rich_help_panel=MEASUREMENTS)
def plan(
    model: ModelName,
    resolve: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="A B", help="Two effects to distinguish, e.g. payload_mass stiffness_loss."),
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Axis [default: the first].", show_default=False)] = None,
    volts: Annotated[
        tuple[str, str] | None, typer.Option(metavar="LOW HIGH", help='Narrower range, e.g. "0 V" "100 V".')
    ] = None,
    slew: Annotated[
        str | None, typer.Option(help='Largest slew rate of the command, e.g. "2000 V/s"; none for no limit.')
    ] = None,
    current: Annotated[str | None, typer.Option(help='Largest current of the driver, e.g. "50 mA".')] = None,
    bandwidth: Annotated[
        str | None, typer.Option(help="Highest frequency of the tones [default: 0.4 of the rate].", show_default=False)
    ] = None,
    rate: Annotated[
        str | None, typer.Option(help="Sampling rate [default: the model's controller.rate].", show_default=False)
    ] = None,
    sensor_noise: Annotated[
        str | None, typer.Option(help='Standard deviation of the sensor reading at rest, e.g. "20 nm".')
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of random phases and levels.")] = 1,
    overrides: StageOverrides = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the plan [default: reports/MODEL_plan].", show_default=False)
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write command files and their report."""
    from flexdesign.api import models
    from flexdesign.dynamics import stage_model
    from flexdesign.report import origin
    from flexdesign.report.diagnosis import plan_pages

    with progress() as say:
        options = listed(
            resolve=resolve, axis=axis, volts=volts, slew=slew, current=current, bandwidth=bandwidth, rate=rate,
            sensor_noise=sensor_noise, seed=seed if seed != 1 else None,
        )  # fmt: skip
        file = stage_model.find(model)
        where = report_folder(out, origin.name_of(file), "plan", [file], overrides or [], options, "_plan")
        found = models.plan(
            model, overrides or [], progress=say, resolve=resolve, axis=axis, volts=volts, slew=slew, current=current,
            bandwidth=bandwidth, rate=rate, sensor_noise=sensor_noise, seed=seed,
        )  # fmt: skip
        say("writing")
        written = [*where.write(found), *found.found.write(where.folder / "commands")]
    show(found, plan_pages.files_to_list(written), as_json)

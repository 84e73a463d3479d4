"""``flexdesign plan``: command files for the bench, within its limits, so that a diagnosis will work."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import AsJson, StageOverrides, app, listed, progress, report_folder, show

HELP = """Write command files for the bench, within its limits, so that a diagnosis will work.

MODEL is a stage model: a file that `validate` or `identify` wrote, or the bare name of one in studies/. Commands are
shaped to its modes and damping; where slew or motion would be too large they are made smaller, and it is said. How
fast the voltage may change must be known: from `driver.slew` of the model, --slew, or --current and the capacitance of
the stacks. Without these no command is written; `--slew none` says that nothing limits it.

**Examples**

    flexdesign plan my_stage.toml --axis x --slew "2000 V/s" --out bench

    flexdesign plan my_stage.toml --current "50 mA" --bandwidth "400 Hz" --rate "8 kHz"

    flexdesign plan my_stage.toml --resolve payload_mass stiffness_loss --sensor-noise "20 nm"

**What it plans:** a quiet record, small calibration steps, multisines of three sizes with two realisations of two
periods each, steps of several sizes, triangles at two rates, a staircase, a hold of 100 s, a decaying sine and random
levels for validation, and a multisine with a known added mass. With --resolve: the experiments that tell two effects
apart, found by simulating the stage with either at strengths at which they look alike on a multisine.

**What it writes:** commands/*.csv and commands/measurements.toml, to which recorded responses only need adding;
report.html, report.md, result.json and the figures, into --out.

**Exit codes:** 0 done; 2 the input cannot be used, and one message says why; 1 our fault; 130 interrupted.
"""


@app.command(help=HELP)
def plan(
    model: Annotated[str, typer.Argument(help="Stage model: a path, or a bare name.")],
    resolve: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="A B", help="Two effects to be told apart, e.g. payload_mass stiffness_loss."),
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Which axis [default: the first].", show_default=False)] = None,
    volts: Annotated[
        tuple[str, str] | None, typer.Option(metavar="LOW HIGH", help='Narrower range, e.g. "0 V" "100 V".')
    ] = None,
    slew: Annotated[
        str | None, typer.Option(help='Fastest change of the command, e.g. "2000 V/s"; none if nothing limits it.')
    ] = None,
    current: Annotated[str | None, typer.Option(help='Largest current of the driver, e.g. "50 mA".')] = None,
    bandwidth: Annotated[
        str | None, typer.Option(help="No tone above it [default: 0.4 of the rate].", show_default=False)
    ] = None,
    rate: Annotated[
        str | None, typer.Option(help="Sampling rate [default: the model's controller.rate].", show_default=False)
    ] = None,
    sensor_noise: Annotated[
        str | None, typer.Option(help='Standard deviation of a reading at rest, e.g. "20 nm".')
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Of random phases and levels.")] = 1,
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
    show(found, plan_pages.listed(written), as_json)

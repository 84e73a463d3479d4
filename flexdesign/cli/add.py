"""``flexdesign add``: an effect fitted to recorded runs and written into a stage model."""

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

HELP = """Fit one effect to recorded runs, and write it into a stage model.

MODEL is a stage model: a file that `validate` or `identify` wrote, or the bare name of one in studies/. EFFECT is one
of `flexdesign effects`, or the path of a file with an effect of your own. RUNS are CSV files or folders of them: runs
in time with the columns `t [s]`, `u [V]` and `x [um]`, or frequency responses with `f [Hz]`, `magnitude [um/V]`,
`phase [deg]` and `coherence`, which are fitted together.

**Examples**

    flexdesign add my_stage.toml creep recordings/ -o my_stage_creeping.toml

    flexdesign add my_stage.toml my_effect.py recordings/ --axis x --json

**What it does:** fits the model's own numbers without and with the effect, and shows the fall of the error on runs that
no fit has seen; says if the effect is not needed; and simulates a closed loop without and with it.

**Of a part at rest:** where MODEL is a design, EFFECT is one of the static effects, or the path of a file with one of
your own, and RUNS are static tables (see `flexdesign diagnose --help`); the design with the effect goes to -o.

**What it writes:** the stage model with the effect, to -o; report.html, report.md, result.json and the figures, into
--out.

**Exit codes:** 0 done; 2 the input cannot be used, and one message says why; 1 our fault; 130 interrupted.
"""


@app.command(help=HELP)
def add(
    model: Annotated[str, typer.Argument(help="Stage model: a path, or a bare name.")],
    effect: Annotated[str, typer.Argument(help="Effect: a name, or the path of a file.")],
    recordings: Annotated[list[Path], typer.Argument(metavar="RUNS...", help="Recorded runs: files or folders.")],
    model_file: Annotated[
        Path | None,
        typer.Option("-o", metavar="FILE", help="Where the model goes [default: stage_model.toml in --out]."),
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Which axis, where several could be meant.")] = None,
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

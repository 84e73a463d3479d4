"""The command line: reads arguments, calls the library, prints; nothing else happens here."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from flexdesign import __version__
from flexdesign.errors import InputError

app = typer.Typer(
    name="flexdesign",
    help="Design piezo-driven flexure stages, simulate them, and fit them to recordings.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)

AsJson = Annotated[bool, typer.Option("--json", help="Print result.json on stdout, and nothing else.")]
StageOverrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one value, e.g. axis.x.damping_ratio=0.02."),
]
#: The exit code after Ctrl-C, by the shell's custom.
INTERRUPTED = 130

VALIDATE_HELP = """Solve a design with FEM and set the analytic model beside it.

STUDY is a study or design file, or the bare name of one in studies/ or geometry/. Its part is built, meshed, checked
(every hinge as thick on the mesh as drawn), solved on several meshes and extrapolated; the report shows stiffness,
amplification, stroke, coupling, modes and stress, each with the boundary it holds under, beside the formulas.

**Examples**

    flexdesign validate bridge_amplifier

    flexdesign validate bridge_amplifier --set dimensions.hinge_thickness="0.4 mm"

    flexdesign validate my_design.toml --set mesh.levels=2 --json > result.json

**What --set can change:** the design (`dimensions.*`, `material`, `actuator.*`, `part`) and the study (`mesh.levels`,
`mesh.at_root`, `mesh.growth`, `mesh.largest`, `mesh.refinement`, `mesh.envelope`, `modes.count`, `output.load`,
`output.stroke`, `output.actuator_offset`).

**What it writes:** report.html, report.md, result.json, stage_model.toml and the pictures, into --out.

**Exit codes:** 0 done; 2 the input cannot be used, and one message says why; 1 our fault; 130 interrupted.

Meshes and solutions are cached by content, so that a second run takes seconds and an interrupted one resumes.
"""


SIMULATE_HELP = """Simulate a stage: hysteresis, feedforward, PID, steps, tracking, lines.

MODEL is a stage model: a file that `validate` or `identify` wrote, or the bare name of one in studies/. STUDY says what
is tried (without one: hysteresis, step, sine and staircase of each axis within its range); the report shows every
controller on every variant of the stage, with published numbers beside ours where the study has some.

**Examples**

    flexdesign simulate lin2019_stage lin2019_experiments

    flexdesign simulate reports/bridge_amplifier/stage_model.toml

    flexdesign simulate my_stage.toml --set axis.x.damping_ratio=0.02 --runs

**What --set can change:** the stage model (`axis.*`, `controller.*`, `coupling.*`) and the study (`robust_ms`,
`cycled`).

**What it writes:** report.html, report.md, result.json, stage_model.toml and the figures, into --out; with --runs also
runs/*.csv, recordings that `identify` reads.

**Exit codes:** 0 done; 2 the input cannot be used, and one message says why; 1 our fault; 130 interrupted.
"""


IDENTIFY_HELP = """Fit the free numbers of a stage model to recorded runs, and say what the runs leave open.

MODEL is a stage model: a file that `validate` wrote, or the bare name of one in studies/. RUNS are CSV files with the
columns `t [s]`, `u [V]` and `x [um]`, or folders of them; a `measurements.toml` beside them may say which runs are for
validation (`role = "validate"`): those are predicted, never fitted.

**Examples**

    flexdesign identify my_stage.toml recordings/ -o my_stage_identified.toml

    flexdesign identify my_stage.toml sine.csv step.csv --axis x --free gain,damping_ratio

    flexdesign identify my_stage.toml sweep.csv --set axis.x.effects.creep.per_decade=0.01 --free gain,creep.per_decade

**What is fitted:** gain, damping_ratio and natural_frequency, and bouc_wen.a, b, c and rest where the model has
hysteresis; --free names others, such as controller.delay or the numbers of an effect. A stated uncertainty counts as
prior knowledge, unless the number is assumed. What the runs do not determine is held and reported as such.

**What it writes:** report.html, report.md, result.json, stage_model.toml and the figures, into --out.

**Exit codes:** 0 done; 2 the input cannot be used, and one message says why; 1 our fault; 130 interrupted.
"""


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"flexdesign {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command(help=VALIDATE_HELP)
def validate(
    study: Annotated[str, typer.Argument(help="Study or design: a path, or a bare name.")] = "bridge_amplifier",
    overrides: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help='Change one value, e.g. dimensions.width="15 mm"; may be repeated.'
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report [default: reports/STUDY].", show_default=False)
    ] = None,
    as_json: AsJson = False,
    cache: Annotated[
        Path | None,
        typer.Option(
            help="Folder for cached meshes and solutions [default: $FLEXDESIGN_CACHE or ~/.cache/flexdesign].",
            show_default=False,
        ),
    ] = None,
    export: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FILE",
            help="Also write the solid (.step) or the finest mesh (.vtu, .msh, .inp ...); may be repeated.",
        ),
    ] = None,
) -> None:
    """Run a validation and write its report."""
    from flexdesign import stage_model
    from flexdesign import study as studies
    from flexdesign.cache import Cache, default_folder
    from flexdesign.report import render, terminal, validation_report
    from flexdesign.validation import validate as run

    with terminal.progress() as progress:
        asked = studies.read(study, overrides or [])
        folder = out or Path("reports") / asked.name
        exports = [(path, _exporter(path)) for path in export or []]
        render.prepare(folder)
        store = Cache(cache or default_folder())
        store.prepare()
        found = run(asked, store, progress)
        result = validation_report.result(found)
        document = validation_report.document(found, progress)
        others = {"stage_model.toml": stage_model.to_toml(found.stage_model)} if found.stage_model else {}
        written = render.write(folder, document, result, others)
        for path, write in exports:
            write(found, Path(path))
    if as_json:
        _print(result)
        return
    terminal.show(
        document,
        found,
        [path for path in written if path.name in ("report.html", "report.md", "result.json", "stage_model.toml")],
    )


@app.command(help=SIMULATE_HELP)
def simulate(
    model: Annotated[str, typer.Argument(help="Stage model: a path, or a bare name.")] = "lin2019_stage",
    study: Annotated[
        str | None, typer.Argument(help="Study of experiments: a path, or a bare name; without it, a standard one.")
    ] = None,
    overrides: StageOverrides = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the report [default: reports/MODEL_STUDY].", show_default=False)
    ] = None,
    as_json: AsJson = False,
    with_runs: Annotated[bool, typer.Option("--runs", help="Also write every response as a recording.")] = False,
) -> None:
    """Run experiments and write their report."""
    from flexdesign import experiments, simulation, stage_model, standard_experiments
    from flexdesign.report import render, simulation_report, terminal

    of_study = [o for o in overrides or [] if o.partition("=")[0].strip() in experiments.SETTINGS]
    of_model = [o for o in overrides or [] if o not in of_study]
    if of_study and not study:
        raise InputError("command line", "--set", of_study[0], "is a setting of a study of experiments; name the study")
    with terminal.progress() as progress:
        stage = stage_model.read(model, of_model)
        plan = experiments.read(study, list(stage.axes), of_study) if study else standard_experiments.plan(stage)
        variants = experiments.variants(plan, lambda changes: stage_model.read(model, [*of_model, *changes]))
        folder = out or Path("reports") / f"{stage.name}_{plan.name}"
        render.prepare(folder)
        found = simulation.run(stage, variants, plan, progress)
        progress("writing")
        document = simulation_report.document(found)
        result = simulation_report.result(found)
        others = {"stage_model.toml": stage_model.to_toml(found.model)}
        written = render.write(folder, document, result, others)
        if with_runs:
            simulation_report.write_runs(found, folder / "runs")
    if as_json:
        _print(result)
        return
    terminal.brief(document, simulation_report.digest(found), [path for path in written if path.suffix != ".svg"])


@app.command(help=IDENTIFY_HELP)
def identify(
    model: Annotated[str, typer.Argument(help="Stage model: a path, or a bare name.")],
    recordings: Annotated[list[Path], typer.Argument(metavar="RUNS...", help="Recorded runs: files or folders.")],
    model_file: Annotated[
        Path | None,
        typer.Option("-o", metavar="FILE", help="Where the model goes [default: stage_model.toml in --out]."),
    ] = None,
    axis: Annotated[str | None, typer.Option(help="Which axis, where several could be meant.")] = None,
    free: Annotated[
        str | None, typer.Option(metavar="NAMES", help="What is fitted, e.g. gain,damping_ratio,bouc_wen.a.")
    ] = None,
    overrides: StageOverrides = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the report [default: reports/MODEL_identified].", show_default=False),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fit a stage model to runs and write the report."""
    from flexdesign import identification, runs, stage_model
    from flexdesign.report import identification_report, render, terminal

    names = None if free is None else [name.strip() for name in free.split(",") if name.strip()]
    with terminal.progress() as progress:
        stage = stage_model.read(model, overrides or [])
        seen = runs.read_runs(recordings)
        folder = out or Path("reports") / f"{stage.name}_identified"
        render.prepare(folder)
        if model_file:
            identification_report.write_model(model_file, None)
        found = identification.identify(stage, seen, axis=axis, free=names, progress=progress)
        progress("writing")
        document, result = identification_report.document(found), identification_report.result(found)
        others = {} if model_file else {"stage_model.toml": stage_model.to_toml(found.model)}
        written = [path for path in render.write(folder, document, result, others) if path.suffix != ".svg"]
        if model_file:
            identification_report.write_model(model_file, found)
            written.append(model_file)
    if as_json:
        _print(result)
        return
    terminal.brief(document, identification_report.estimates(found), written)


def _print(result: Mapping[str, Any]) -> None:
    json.dump(result, sys.stdout, indent=2, ensure_ascii=False)
    sys.stdout.write("\n")


def _exporter(name: str) -> Callable[[Any, Path], None]:
    from flexdesign.report import export

    return export.writer(Path(name))


def main() -> None:
    """Run the command line; every InputError ends here as one message and exit code 2."""
    try:
        code = app(standalone_mode=False)  # what a command returns, or the code it was ended with
        if code == INTERRUPTED:
            raise KeyboardInterrupt
        sys.exit(code)
    except InputError as error:
        typer.echo(f"flexdesign: {' '.join(str(error).split())}", err=True)
        sys.exit(2)
    except (typer.Abort, KeyboardInterrupt):
        typer.echo("flexdesign: interrupted; what was finished is cached, the same command resumes", err=True)
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not hasattr(error, "format_message"):
            raise
        context = getattr(error, "ctx", None)  # the parser's own errors; without arguments it has printed the help
        if said := error.format_message().rstrip("."):
            command = context.command_path if context else "flexdesign"
            typer.echo(f"flexdesign: {said} (see {command} --help)", err=True)
        sys.exit(2)

"""Shared by all commands: the application, options, progress, and the output of a result."""

from __future__ import annotations

import json
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexdesign.core.errors import printable
from flexdesign.core.serialise import to_json
from flexdesign.core.whole_files import written_whole
from flexdesign.design import changes

if TYPE_CHECKING:
    from flexdesign.api.result import Result
    from flexdesign.report.origin import Inputs

#: Groups of commands in the help, in this order.
DESIGN, SIMULATION, MEASUREMENTS = "Design and validate", "Simulate", "Confront with measurements"
PUBLICATIONS, CATALOGUES, INSTALLATION = "Publications", "Catalogues", "To begin with"

app = typer.Typer(
    name="flexdesign",
    help="Design piezo-driven flexure stages, simulate them, and fit them to recordings.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)

ModelName = Annotated[str, typer.Argument(help="Stage model: a path, or a bare name.")]
Recordings = Annotated[list[Path], typer.Argument(metavar="RUNS...", help="Recorded runs: files or folders.")]
AxisName = Annotated[str | None, typer.Option(help="Axis, if the stage has several.")]
ModelFile = Annotated[
    Path | None,
    typer.Option("-o", metavar="FILE", help="File of the written model [default: stage_model.toml in --out]."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print only result.json, on stdout.")]
CacheFolder = Annotated[
    Path | None,
    typer.Option(
        "--cache",
        help="Folder for cached meshes and solutions [default: $FLEXDESIGN_CACHE or ~/.cache/flexdesign].",
        show_default=False,
    ),
]
Noise = Annotated[
    str | None,
    typer.Option(
        "--noise", help='Standard deviation of the noise, e.g. "3 nm" [default: estimated].', show_default=False
    ),
]
StageOverrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one value, e.g. axis.x.damping_ratio=0.02."),
]


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Show the progress of a command on stderr; yields the function that takes the messages."""
    from flexdesign.report import terminal

    with terminal.progress() as say:
        yield say


def print_json(result: Mapping[str, Any]) -> None:
    """Print a result on stdout, in the form of result.json."""
    json.dump(to_json(result), sys.stdout, indent=2, ensure_ascii=False, allow_nan=False)
    sys.stdout.write("\n")


@dataclass(frozen=True)
class ReportFolder:
    """The destination of a report.

    Parameters
    ----------
    folder
        The folder.
    inputs
        The inputs of the report.
    replaced
        The report of other inputs that is replaced, in words; empty if none.
    """

    folder: Path
    inputs: Inputs
    replaced: str

    def write(self, found: Result[Any], links: Sequence[str] = (), *, model_file: Path | None = None) -> list[Path]:
        """Write the report of a result, and name on stderr the other report that it replaces.

        Parameters
        ----------
        found
            The result; its inputs are added to its result.json.
        links
            Files that the report links to, relative to its folder.
        model_file
            File of the model in the result, if not in the folder.
        """
        from flexdesign.report import render

        found.to_dict()["inputs"] = self.inputs.record
        files = {} if model_file else found.files(self.folder)
        written = render.write(self.folder, found.document, found.to_dict(), files, links)
        if model_file:
            (text,) = found.files(model_file.parent).values()
            write_file(model_file, str(text))
            written.append(model_file)
        if self.replaced:
            typer.echo(f"flexdesign: {printable(self.replaced)}", err=True)
        return written


def show(found: Result[Any], written: Sequence[Path], as_json: bool) -> None:
    """Print a result: as JSON alone, or summary, table and the names of the written files, without pictures."""
    from flexdesign.report import terminal

    if as_json:
        print_json(found.to_dict())
    else:
        terminal.show(str(found), [path for path in written if path.suffix not in (".svg", ".png")])


def next_step(command: str, *arguments: str | Path) -> None:
    """Name on stderr the command that one usually runs next."""
    typer.echo(f"Next: flexdesign {command} {shlex.join(map(str, arguments))}", err=True)


def write_file(path: Path | None, text: str | None = None) -> None:
    """Write the file of -o, completely or not at all; without a text, check that it can be written.

    Raises
    ------
    InputError
        If it cannot.
    """
    from flexdesign.core.errors import InputError

    if path is None:
        return
    try:
        if path.is_dir():
            raise IsADirectoryError(0, "it is a folder")
        there = next(place for place in path.absolute().parents if place.exists())
        if text is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            there = path.parent
        with written_whole(there) as scratch:
            if text is not None:
                (scratch / path.name).write_text(text, encoding="utf-8")
    except OSError as error:
        remedy = f"cannot be written ({error.strerror or error}); choose another file"
        raise InputError("command line", "-o", str(path), remedy) from error


def file_of(model: str) -> Path:
    """Return the file of a stage model or of a design; raise InputError if there is none."""
    from flexdesign.api import static_tables
    from flexdesign.design import design
    from flexdesign.dynamics import stage_model

    return design.find(model) if static_tables.is_design(model) else stage_model.find(model)


def report_folder(
    out: Path | None,
    name: str,
    verb: str,
    files: Sequence[Path],
    overrides: Sequence[str] = (),
    options: Sequence[str] = (),
    ending: str = "",
) -> ReportFolder:
    """Return the destination of a report, and check that it can be written.

    Without `out` that is the folder `name`, overrides from the command line and `ending` in reports/. If that
    folder holds a report of another command, other files or other options, the new folder has a hash in its name.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    from flexdesign.report import origin, render

    inputs = origin.Inputs(verb, files, [*overrides, *options])
    folder = out or Path("reports") / f"{name}{changes.as_name(overrides)}{ending}"
    if out is None and (found := origin.state_of_checkout(folder)) and origin.is_another(found, inputs):
        folder = folder.with_name(f"{folder.name}_{inputs.digest}")
    render.prepare(folder)
    return ReportFolder(folder, inputs, origin.replacement_notice(folder, inputs))


def listed(**given: object) -> list[str]:
    """Return the given options of a command as settings: ``axis=x``.

    >>> listed(axis="x", noise=None, volts=("0 V", "100 V"))
    ['axis=x', 'volts=0 V 100 V']
    """
    texts = {name: " ".join(map(str, v)) if isinstance(v, (list, tuple)) else v for name, v in given.items()}
    return [f"{name}={value}" for name, value in texts.items() if value is not None]

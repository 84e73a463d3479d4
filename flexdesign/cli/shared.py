"""What the verbs of the command line share: the application, options, progress, and how an answer is printed."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexdesign import changes
from flexdesign.errors import printable

if TYPE_CHECKING:
    from flexdesign.cache import Cache
    from flexdesign.report.document import Document
    from flexdesign.report.origin import Inputs

app = typer.Typer(
    name="flexdesign",
    help="Design piezo-driven flexure stages, simulate them, and fit them to recordings.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)

AsJson = Annotated[bool, typer.Option("--json", help="Print result.json on stdout, and nothing else.")]
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
    """Show on stderr what is going on while a verb works; yields what takes the words."""
    from flexdesign.report import terminal  # slow to import: not before a verb runs

    with terminal.progress() as say:
        yield say


def print_json(result: Mapping[str, Any]) -> None:
    """Print a result on stdout, as result.json has it."""
    json.dump(result, sys.stdout, indent=2, ensure_ascii=False)
    sys.stdout.write("\n")


def open_cache(folder: Path | None) -> Cache:
    """Return the cache in a folder, or the user's own, ready to be written to."""
    from flexdesign.cache import Cache, default_folder

    store = Cache(folder or default_folder())
    store.prepare()
    return store


@dataclass(frozen=True)
class Place:
    """Where a verb's report goes.

    Parameters
    ----------
    folder
        The folder.
    inputs
        What the report is made of.
    replaced
        Which report of other inputs stands there and is replaced, in words; empty if none.
    """

    folder: Path
    inputs: Inputs
    replaced: str

    def write(
        self, document: Document, result: dict[str, Any], others: Mapping[str, str | bytes], links: Sequence[str] = ()
    ) -> list[Path]:
        """Write the report, put the inputs into its result, and say on stderr which other report it replaces."""
        from flexdesign.report import render

        result["inputs"] = self.inputs.record
        written = render.write(self.folder, document, result, others, links)
        if self.replaced:
            typer.echo(f"flexdesign: {printable(self.replaced)}", err=True)
        return written


def place(
    out: Path | None,
    name: str,
    verb: str,
    files: Sequence[Path],
    overrides: Sequence[str] = (),
    options: Sequence[str] = (),
    ending: str = "",
) -> Place:
    """Return where a report goes, and check that it can be written there.

    Without `out` that is the folder `name`, overrides from the command line and `ending` in reports/. If a report of
    another command, other files or other options stands there, a hash in the name tells the new folder from it.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    from flexdesign.report import origin, render

    inputs = origin.Inputs(verb, files, [*overrides, *options])
    folder = out or Path("reports") / f"{name}{changes.as_name(overrides)}{ending}"
    if out is None and (found := origin.standing(folder)) and origin.is_another(found, inputs):
        folder = folder.with_name(f"{folder.name}_{inputs.digest}")
    render.prepare(folder)
    return Place(folder, inputs, origin.replaced(folder, inputs))


def listed(**given: object) -> list[str]:
    """Return the options of a verb that were given, as settings: ``axis=x``.

    >>> listed(axis="x", noise=None, volts=("0 V", "100 V"))
    ['axis=x', 'volts=0 V 100 V']
    """
    texts = {name: " ".join(map(str, v)) if isinstance(v, (list, tuple)) else v for name, v in given.items()}
    return [f"{name}={value}" for name, value in texts.items() if value is not None]

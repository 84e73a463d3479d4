"""What the verbs of the command line share: the application, options, progress, and how an answer is printed."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

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
CacheFolder = Annotated[
    Path | None, typer.Option("--cache", help="Folder of meshes and solutions [default: the user's cache].")
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

"""``flexdesign init``: files to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import app

HELP = """Write files to start from.

**Examples**

    flexdesign init project my_stage
"""
PROJECT = """Write a working project: an amplifier, a stage model, recordings of the stage, and a README.

**Examples**

    flexdesign init project

    flexdesign init project my_stage

    cd my_stage && flexdesign diagnose model.toml runs

**Output:** README.md, amplifier.toml, model.toml and runs/ in FOLDER, which must not exist, or be empty.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""

#: A kind of thing to start from is one function under @commands.command(name, help=...).
commands = typer.Typer(
    help=HELP,
    no_args_is_help=True,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(commands, name="init")


@commands.command(help=PROJECT)
def project(
    folder: Annotated[Path, typer.Argument(help="The new folder.")] = Path("my_stage"),
) -> None:
    """Write the files, and say what comes next."""
    from flexdesign.workflows import scaffolding

    for path in scaffolding.write_project(folder):
        typer.echo(path)
    typer.echo(f"Next: cd {folder}, and read README.md", err=True)

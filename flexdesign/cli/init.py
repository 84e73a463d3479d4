"""``flexdesign init``: files to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexdesign.cli.shared import INSTALLATION, app

HELP = """Write files to start from.

**Examples**

    flexdesign init project my_stage

    flexdesign init part my_part && flexdesign validate my_part.toml
"""
PROJECT = """Write a working project: an amplifier, a stage model, recordings of the stage, and a README.

**Examples**

    flexdesign init project

    flexdesign init project my_stage

    cd my_stage && flexdesign diagnose model.toml runs

**Output:** README.md, amplifier.toml, model.toml and runs/ in FOLDER, which must not exist, or be empty.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""

PART = """Write the smallest part that validates, a class with solid and ports, and its design.

**Examples**

    flexdesign init part my_part

    flexdesign validate my_part.toml

**Output:** NAME.py and NAME.toml, which must not exist.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""
EFFECT = """Write an effect of your own, which works as it is.

**Examples**

    flexdesign init effect my_effect

    flexdesign effects my_effect.py

**Output:** NAME.py, which must not exist.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""
STUDY = """Write a study, which says how a design is solved.

**Examples**

    flexdesign init study my_study

    flexdesign validate my_study.toml

**Output:** NAME.toml, which must not exist.

**Exit codes:** 0 done; 2 unusable input, with one message that names the cause; 1 internal error; 130 interrupted.
"""

#: A kind of thing to start from is one function under @commands.command(name, help=...).
commands = typer.Typer(
    help=HELP,
    no_args_is_help=True,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(commands, name="init", rich_help_panel=INSTALLATION)


@commands.command(help=PROJECT)
def project(
    folder: Annotated[Path, typer.Argument(help="The new folder.")] = Path("my_stage"),
) -> None:
    """Write the files, and say what comes next."""
    from flexdesign.workflows import scaffolding

    for path in scaffolding.write_project(folder):
        typer.echo(path)
    typer.echo(f"Next: cd {folder}, and read README.md", err=True)


@commands.command(help=PART)
def part(name: Annotated[str, typer.Argument(help="Of the new files, without ending.")] = "my_part") -> None:
    """Write the files, and say what comes next."""
    from flexdesign.workflows import scaffolding

    _next_steps(scaffolding.write_part(name), "flexdesign validate {}")


@commands.command(help=EFFECT)
def effect(name: Annotated[str, typer.Argument(help="Of the new file, without ending.")] = "my_effect") -> None:
    """Write the file, and say what comes next."""
    from flexdesign.workflows import scaffolding

    _next_steps(scaffolding.write_effect(name), "flexdesign effects {}")


@commands.command(help=STUDY)
def study(name: Annotated[str, typer.Argument(help="Of the new file, without ending.")] = "my_study") -> None:
    """Write the file, and say what comes next."""
    from flexdesign.workflows import scaffolding

    _next_steps(scaffolding.write_study(name), "flexdesign validate {}")


def _next_steps(written: list[Path], command: str) -> None:
    for path in written:
        typer.echo(path)
    typer.echo(f"Next: {command.format(written[-1])}", err=True)

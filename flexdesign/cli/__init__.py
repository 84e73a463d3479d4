"""The command line: reads arguments, calls the library, prints."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from flexdesign.cli.shared import app
from flexdesign.core.errors import InputError
from flexdesign.core.versions import __version__

# A verb is one module with a function under @app.command(help=HELP), and one line here; the help has this order:
# from flexdesign.cli import my_verb as my_verb
# isort: off
from flexdesign.cli import size as size
from flexdesign.cli import validate as validate
from flexdesign.cli import ports as ports
from flexdesign.cli import sweep as sweep
from flexdesign.cli import optimize as optimize
from flexdesign.cli import simulate as simulate
from flexdesign.cli import reproduce as reproduce
from flexdesign.cli import published as published
from flexdesign.cli import identify as identify
from flexdesign.cli import compare as compare
from flexdesign.cli import diagnose as diagnose
from flexdesign.cli import add as add
from flexdesign.cli import effects as effects
from flexdesign.cli import materials as materials
from flexdesign.cli import plan as plan
from flexdesign.cli import import_ as import_
from flexdesign.cli import check as check
from flexdesign.cli import init as init
# isort: on

#: The exit code after Ctrl-C, by convention of the shell.
INTERRUPTED = 130


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


def main() -> None:
    """Run the command line; every InputError ends here as one message and exit code 2."""
    try:
        code = app(standalone_mode=False)  # the return value of a command, or its exit code
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

"""The command line: reads arguments, calls the library, prints."""

from __future__ import annotations

import errno
import os
import sys
from typing import Annotated

import typer

from flexdesign.cli.shared import app
from flexdesign.core import extras, foreign_code, result_cache
from flexdesign.core.errors import InputError, printable
from flexdesign.core.versions import __version__

# A verb is one module with a function under @app.command, and one line here; the help has this order:
# from flexdesign.cli import my_verb as my_verb
# isort: off
from flexdesign.cli import validate as validate
from flexdesign.cli import ports as ports
from flexdesign.cli import size as size
from flexdesign.cli import sweep as sweep
from flexdesign.cli import optimize as optimize
from flexdesign.cli import simulate as simulate
from flexdesign.cli import import_ as import_
from flexdesign.cli import check as check
from flexdesign.cli import compare as compare
from flexdesign.cli import diagnose as diagnose
from flexdesign.cli import add as add
from flexdesign.cli import identify as identify
from flexdesign.cli import plan as plan
from flexdesign.cli import workbench as workbench
from flexdesign.cli import reproduce as reproduce
from flexdesign.cli import published as published
from flexdesign.cli import effects as effects
from flexdesign.cli import materials as materials
from flexdesign.cli import init as init
from flexdesign.cli import doctor as doctor
# isort: on

#: The option that forbids code of others, at any place of the command line.
NO_CODE = "--no-code"
#: The exit code after Ctrl-C, by convention of the shell.
INTERRUPTED = 130
#: Errors of a disk that is full, also from where libraries write by themselves.
FULL = (errno.ENOSPC, errno.EDQUOT)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"flexdesign {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
    no_code: Annotated[
        bool, typer.Option(NO_CODE, help="Run no Python file that a design or a model names; at any place.")
    ] = False,
) -> None:
    pass  # `main` has taken it out of the arguments, wherever it stood


def _without_code(arguments: list[str]) -> list[str]:
    """Return arguments without `--no-code`, which forbids files of others to run."""
    if NO_CODE not in arguments:
        return arguments
    foreign_code.forbid()
    return [each for each in arguments if each != NO_CODE]


def _say_what_ran() -> None:
    if ran := foreign_code.ran():
        typer.echo(f"flexdesign: ran the code of {', '.join(map(printable, ran))}; {NO_CODE} forbids it", err=True)
    for path in result_cache.damaged():
        typer.echo(f"flexdesign: {printable(path)} in the cache was damaged; computed again", err=True)


def main() -> None:
    """Run the command line; every InputError ends here as one message and exit code 2."""
    sys.argv[1:] = _without_code(sys.argv[1:])
    foreign_code.forget()
    result_cache.forget_damaged()
    try:
        code = app(standalone_mode=False)  # the return value of a command, or its exit code
        _say_what_ran()  # what is refused ends in one line
        if code == INTERRUPTED:
            raise KeyboardInterrupt
        sys.exit(code)
    except InputError as error:
        typer.echo(f"flexdesign: {' '.join(str(error).split())}", err=True)
        sys.exit(2)
    except OSError as error:
        if error.errno not in FULL:
            raise
        place = printable(str(error.filename or "a file of a library's cache or of TMPDIR"))
        remedy = f"cannot be written ({os.strerror(error.errno)}); free space"
        typer.echo(f"flexdesign: {place}: {remedy}", err=True)
        sys.exit(2)
    except ImportError as error:
        if not (remedy := extras.remedy(error)):
            raise
        typer.echo(f"flexdesign: {remedy}", err=True)
        sys.exit(2)
    except (typer.Abort, KeyboardInterrupt):
        typer.echo("flexdesign: interrupted; what was finished is cached, the same command resumes", err=True)
        sys.exit(INTERRUPTED)
    except Exception as error:
        if not hasattr(error, "format_message"):
            raise
        context = getattr(error, "ctx", None)  # the parser's own errors; without arguments it has printed the help
        if message := error.format_message().rstrip("."):
            command = context.command_path if context else "flexdesign"
            typer.echo(f"flexdesign: {message} (see {command} --help)", err=True)
        sys.exit(2)

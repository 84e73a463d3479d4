"""The reference of the command line, made from the Typer application itself."""

from __future__ import annotations

import re
from collections.abc import Iterator

import click
import typer

from flexdesign import cli


def pages() -> Iterator[tuple[str, str]]:
    """Yield one page for each command, and the page that lists them."""
    group = typer.main.get_command(cli.app)
    names = list(_commands(group, "flexdesign"))
    rows = [f"| [`{name}`]({_file(name)}) | {_first(command)} |" for name, command in names]
    index = ["# Command line", "", INTRODUCTION, "", "| command | task |", "|---|---|", *rows, ""]
    index += ["```{toctree}", ":hidden:", ""]
    index += [_file(name).removesuffix(".md") for name, _ in names]
    index += ["```", ""]
    yield "cli/index.md", "\n".join(index)
    for name, command in names:
        yield f"cli/{_file(name)}", _page(name, command)


INTRODUCTION = """This reference is made from the program at each build; `flexdesign COMMAND --help` prints the same.
Options of every command: `--help`, and at the top `--version`, `--install-completion` (bash, zsh, fish, PowerShell) and
`--show-completion`."""


def _commands(group: click.Command, name: str) -> Iterator[tuple[str, click.Command]]:
    for word, command in group.commands.items():  # type: ignore[attr-defined]
        if hasattr(command, "commands"):
            yield from _commands(command, f"{name} {word}")
        else:
            yield f"{name} {word}", command


def _file(name: str) -> str:
    return "_".join(name.split()[1:]) + ".md"


def _first(command: click.Command) -> str:
    return str(command.help).partition("\n")[0].rstrip(".")


def _page(name: str, command: click.Command) -> str:
    with click.Context(command, info_name=name) as context:
        usage = " ".join(command.collect_usage_pieces(context)).replace("{", "").replace("}...", "").replace("}", "")
        rows = [_row(parameter, context) for parameter in command.get_params(context) if parameter.name != "help"]
    table = ["| argument, option | meaning |", "|---|---|", *rows] if rows else []
    help_ = re.sub(r"(?m)^    (flexdesign .*)$", r"    \1", str(command.help))
    return "\n".join([f"# {name}", "", "```text", f"{name} {usage}", "```", "", help_, "", *table, ""])


def _row(parameter: click.Parameter, context: click.Context) -> str:
    record = parameter.get_help_record(context)
    left, right = record or (parameter.make_metavar(context), "")
    words = " ".join(right.split()).replace("|", "\\|").replace("<", "&lt;")
    shown = ", ".join(f"`{each}`" for each in left.replace("|", "\\|").split(", "))
    return f"| {shown} | {words} |"

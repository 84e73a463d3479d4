"""What files hold, written as a map that only wants completing: what is not known stands there to be replaced."""

from __future__ import annotations

import json
import shlex
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flexdesign.core.errors import InputError, printable
from flexdesign.measurements.importing.contents import Contents, Variable
from flexdesign.measurements.importing.guessing import USUAL, Column, Guess, guess
from flexdesign.measurements.importing.mapping import Map, parse_map
from flexdesign.measurements.importing.readers import read_contents

#: Most letters of a repeated line above a table, and most lines.
LETTERS, LINES = 110, 30


@dataclass(frozen=True)
class Proposal:
    """A map for some files.

    Parameters
    ----------
    text
        The map, in TOML.
    questions
        What only the owner of the files can know, each with the file it is asked of; empty if the map is complete.
    understood
        How each column was understood, in words.
    left_out
        Variables that are no columns.
    """

    text: str
    questions: tuple[str, ...]
    understood: tuple[str, ...]
    left_out: tuple[str, ...]

    def map(self) -> Map:
        """Return the map as it is used; raise InputError where something in it is still to be answered."""
        return parse_map(tomllib.loads(self.text), Path("map"))


def proposal(paths: Sequence[Path]) -> Proposal:
    """Return a map for files: for each by itself where each holds a whole recording, else for all together.

    Files that hold the same variables share one run of the map; so do their questions.

    Raises
    ------
    InputError
        As `look` does.
    """
    alone = [read_contents([path]) for path in paths]
    guesses = [guess(each) for each in alone]
    groups: list[list[int]] = []
    for k, each in enumerate(alone):
        group = next((group for group in groups if _names(alone[group[0]]) == _names(each)), None)
        if group is None:
            groups.append([k])
        else:
            group.append(k)
    if len(groups) > 1 and not all(_is_whole(guesses[group[0]]) for group in groups):
        together = read_contents(paths)
        return _text([together], [guess(together)], [paths])
    first = [alone[group[0]] for group in groups]
    return _text(first, [guesses[group[0]] for group in groups], [[paths[k] for k in group] for group in groups])


def propose(paths: Sequence[Path]) -> str:
    """Return the text of the map that `proposal` makes; raise as that does."""
    return proposal(paths).text


def template(contents: Contents, similar: Sequence[Path] = ()) -> str:
    """Return a map as text: what the files hold in comments, then a run with the columns that can be guessed.

    The text is TOML. Guesses are marked; lines that nobody can guess are ``?`` and refused until they are replaced.
    Files of `similar` hold the same variables, and the map is for each of them.
    """
    return _text([contents], [guess(contents)], [[*contents.paths, *similar]]).text


def asking(paths: Sequence[Path], questions: Sequence[str], then: str = "") -> InputError:
    """Return the message that asks for what cannot be known; `then` says how to answer, if not by a command."""
    more = f" and {len(paths) - 1} more" if len(paths) > 1 else ""
    count = f"{len(questions)} thing{'s' if len(questions) > 1 else ''}"
    files = " ".join(shlex.quote(str(path)) for path in paths[:3]) + (" ..." if len(paths) > 3 else "")
    remedy = f"does not say {'; '.join(questions)}"
    closing = f". {then or f'Save the map above, answer there, then flexdesign import {files} --map map.toml'}"
    room = 330 - len(closing)
    if len(remedy) > room:
        remedy = f"{remedy[:room]}... ({count} in all)"
    return InputError(f"{paths[0]}{more}", "", None, remedy + closing)


def _names(contents: Contents) -> list[tuple[str, str, bool]]:
    return [(name, variable.unit, variable.size > 1) for name, variable in contents.variables.items()]


def _is_whole(found: Guess) -> bool:
    """Tell whether a file holds what a run needs by itself: command and response, or a response over frequency."""
    return all(column.variable or column.formula for column in found.columns)


def _text(contents: Sequence[Contents], guesses: Sequence[Guess], files: Sequence[Sequence[Path]]) -> Proposal:
    """Return the map of some groups of files, each with what its first file holds and the guess for it."""
    head: list[str] = []
    questions: list[str] = []
    count = sum(map(len, files))
    per_file = len(contents) > 1 or (count > 1 and len(contents[0].paths) == 1)
    for each, found, group in zip(contents, guesses, files, strict=True):
        head += _content(each, group)
        of = f" of {group[0].name}" if len(contents) > 1 else ""
        questions += [f"{question}{of}" for question in found.questions]
    head += ["# A map: complete it, then flexdesign import FILES --map map.toml -o FOLDER"]
    head += [f"# Nobody but you knows {_line(question)}." for question in questions]
    head += ["", f"title = {json.dumps(printable(contents[0].paths[0].stem), ensure_ascii=False)}"]
    if per_file:
        head.append("per_file = true  # each file by itself makes a run, named after it")
    rates = {found.rate for found in guesses}
    if rates != {""} and len(guesses) == 1:
        head.append(f"rate = {json.dumps(guesses[0].rate)}  # or map a column t")
    if len(guesses) == 1 and guesses[0].axes:
        head.append(_axes(guesses[0]))
    body: list[str] = []
    tables: dict[str, list[str]] = {}
    for each, found, group in zip(contents, guesses, files, strict=True):
        body += ["", "[[run]]"]
        if not per_file:
            body.append(f"name = {json.dumps(_file_name(each.paths[0].stem), ensure_ascii=False)}")
        if len(contents) > 1:
            body.append(f"files = {json.dumps([path.name for path in group], ensure_ascii=False)}")
            body += [f"rate = {json.dumps(found.rate)}  # or map a column t"] if found.rate else []
            body += [_axes(found)] if found.axes else []
        body.append('# kind = "multisine"')
        for column in found.columns:
            body += ["", f"[run.columns.{column.name}]", *_column(column, each)]
            tables |= {f"constants.{name}": [f"{name} = {json.dumps(q)}"] for name, q in column.constants.items()}
            for name, unit in column.variables.items():
                tables[f"variables.{name}"] = ["", f"[variables.{name}]", f"unit = {json.dumps(unit)}"]
    constants = [line for name, lines in tables.items() if name.startswith("constants.") for line in lines]
    if constants:
        head += ["", "[constants]", *constants]
    head += [line for name, lines in tables.items() if name.startswith("variables.") for line in lines]
    understood = [_understood(column, each) for each, f in zip(contents, guesses, strict=True) for column in f.columns]
    left = tuple(dict.fromkeys(name for found in guesses for name in found.left_out))
    text = "\n".join([*head, *body]) + "\n"
    return Proposal(text, tuple(questions), tuple(dict.fromkeys(understood)), left)


def _content(contents: Contents, group: Sequence[Path]) -> list[str]:
    """Return in comments what the files hold."""
    others = len(group) - len(contents.paths)
    more = f", and likewise in {others} more" if others else ""
    lines = [f"# What is in {_line(', '.join(path.name for path in contents.paths))}{more}:", "#"]
    rows = [_row(name, variable) for name, variable in contents.variables.items()]
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, [*widths, 0], strict=True)]
        lines.append(f"#   {'  '.join(cells)}".rstrip())
    return [*lines, "#", *(f"# {_line(note)}" for note in contents.notes[:LINES])]


def _line(text: str) -> str:
    return printable(" ".join(text.split()))[: 2 * LETTERS]


def _axes(found: Guess) -> str:
    of = "frequency, channel, input, realisation" if found.is_response else "sample, channel, realisation, period"
    return f'axes = ["?", "?"]  # of {of}'


def _row(name: str, variable: Variable) -> list[str]:
    size = "scalar" if variable.size == 1 else " x ".join(map(str, variable.shape))
    if variable.is_complex:
        size = f"{size}, complex"
    unit = f"[{variable.unit}]" if variable.unit else "no unit"
    remark = [f"{1 / variable.step:.6g} Hz"] if variable.step else []
    if variable.size == 1:
        remark.append(f"= {variable.values().item():.6g}")
    note = _line("; ".join([*remark, variable.note]).strip("; "))
    return [_quote(name), size, _line(unit), note]


def _quote(name: str) -> str:
    return json.dumps(name, ensure_ascii=not name.isprintable())


def _column(column: Column, contents: Contents) -> list[str]:
    if column.formula:
        remark = f"  # {column.remark}" if column.remark else ""
        return [f"formula = {json.dumps(column.formula)}{remark}", f"unit = {json.dumps(column.unit)}"]
    variable = contents.variables.get(column.variable)
    lines = [f"variable = {_quote(column.variable or '?')}" + ("  # a guess" if column.variable else "")]
    if column.unit == "?":
        lines.append(f'unit = "?"  # {_line(column.remark) or USUAL.get(column.name, USUAL[_kind(column.name)]) + "?"}')
    elif column.unit:
        lines.append(f"unit = {json.dumps(column.unit)}")
    if column.remark and column.unit != "?":
        lines.append(f"# {_line(column.remark)}")
    if variable and sum(length > 1 for length in variable.shape) > 1:
        lines.append("channel = 1")
    return lines


def _kind(name: str) -> str:
    """Return the column without its axis: ``u`` of ``ux``, ``x`` of ``y``."""
    return "u" if name.startswith("u") else "x" if name in ("x", "y", "z") else "t"


def _understood(column: Column, contents: Contents) -> str:
    if column.formula:
        return f"{column.name} = {column.formula}"
    if not column.variable:
        return f"{column.name} = ?"
    unit = column.unit or contents.variables[column.variable].unit
    return f'{column.name} = "{printable(column.variable)}" [{unit}]'


def _file_name(stem: str) -> str:
    """Return a name for a run that a file can have."""
    return "".join(sign if sign.isprintable() and sign not in '/\\:*?"<>|' else "_" for sign in stem)[:100]

"""What a report was made of: the command with its input files, and the report that stands in its folder already.

result.json holds the inputs, so that a later run knows whether it replaces a report of the same inputs. Date and
command line stand in report.html and report.md alone: result.json is the same in every run. With SOURCE_DATE_EPOCH in
the environment the date is that one, so that reports are the same, too.
"""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from flexdesign.core.toml_files import is_file, is_folder

#: Files that verbs write under one name in every folder: the folder's name distinguishes them.
COMMON = ("stage_model", "design", "optimum", "dimensions")
#: Options that say where things go and who works, and nothing of the result; alone, and with a value.
PLACES, VALUED = ("--json",), ("--out", "--cache", "--jobs", "--scheduler")
#: Letters of a file's hash.
DIGITS = 12


@dataclass(frozen=True)
class Inputs:
    """What a command was given.

    Parameters
    ----------
    verb
        The command, such as validate.
    files
        Files, or folders of recordings.
    settings
        Overrides and options that change the result, as they were written.
    """

    verb: str
    files: Sequence[Path]
    settings: Sequence[str] = ()

    @cached_property
    def record(self) -> dict[str, Any]:
        """The inputs as result.json holds them: each file by its path and the hash of its content."""
        hashes = {_relative_path(file): _hash(file) for file in self.files}
        return {"command": self.verb, "files": hashes, "settings": list(self.settings)}

    @property
    def digest(self) -> str:
        """A few letters that distinguish these inputs from others, whatever the files hold."""
        named = json.dumps([self.verb, [_relative_path(file) for file in self.files], list(self.settings)])
        return hashlib.sha256(named.encode()).hexdigest()[:6]


def name_of(file: Path) -> str:
    """Return the distinct name of a file: where verbs write it under one name, with its folder's."""
    return f"{file.resolve().parent.name}_{file.stem}" if file.stem in COMMON else file.stem


def state_of_checkout(folder: Path) -> Mapping[str, Any] | None:
    """Return the inputs of the report that stands in a folder; empty if it does not say, None if there is none."""
    file = folder / "result.json"
    if not is_file(file):
        return {} if is_file(folder / "report.html") else None
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    inputs = content.get("inputs") if isinstance(content, Mapping) else None
    known = {"command": str, "files": Mapping, "settings": list}
    whole = isinstance(inputs, Mapping) and all(isinstance(inputs.get(name), kind) for name, kind in known.items())
    return inputs if whole else {}


def is_another(found: Mapping[str, Any], inputs: Inputs) -> bool:
    """Tell whether a report is known to be one of another command, other files or other settings."""
    own = inputs.record
    names = ("command", "settings")
    return bool(found) and (
        list(found["files"]) != list(own["files"]) or any(found[name] != own[name] for name in names)
    )


def replacement_notice(folder: Path, inputs: Inputs) -> str:
    """Say which report of other inputs will be replaced in a folder; empty if there is none."""
    found = state_of_checkout(folder)
    if found is None or found == inputs.record:
        return ""
    if not found:
        return f"replaced the report in {folder}, which did not say what it was made of"
    if is_another(found, inputs):
        words = " ".join([found["command"], *found["files"]])
        settings = f" with {', '.join(map(str, found['settings']))}" if found["settings"] else ""
        return f"replaced the report in {folder}, which was that of {words}{settings}"
    files = found["files"]
    changed = [Path(name).name for name, digest in inputs.record["files"].items() if files.get(name) != digest]
    return f"replaced the report in {folder}, made before {', '.join(changed)} changed"


def date() -> str:
    """Return the time, UTC, to the minute; that of SOURCE_DATE_EPOCH where the environment has it."""
    stated = os.environ.get("SOURCE_DATE_EPOCH", "")
    now = datetime.fromtimestamp(int(stated), UTC) if stated.isdecimal() else datetime.now(UTC)
    return f"{now:%Y-%m-%d %H:%M} UTC"


def command(arguments: Sequence[str] | None = None) -> str:
    """Return the command line that makes the same result, without where things go and how they are shown.

    >>> command(["/usr/bin/flexdesign", "validate", "a b.toml", "--out", "x", "--json"])
    "flexdesign validate 'a b.toml'"
    """
    program, *given = sys.argv if arguments is None else arguments
    file = Path(program)
    name = file.stem
    if name == "__main__":
        folder = file.parent
        inner = f"{folder.parent.name}.{folder.name}" if folder.parent.name == "studies" else folder.name
        name = inner if inner == "flexdesign" else f"python -m {inner}"
    return shlex.join([*name.split(), *_result_arguments(given)])


def _result_arguments(given: Sequence[str]) -> Iterator[str]:
    words = iter(given)
    for word in words:
        if word in VALUED:
            next(words, None)
        elif word not in PLACES and word.partition("=")[0] not in VALUED:
            yield word


def _relative_path(file: Path) -> str:
    """Return the path of a file from where we work, if it lies below; else the whole one."""
    whole, here = file.resolve(), Path().resolve()
    return (whole.relative_to(here) if whole.is_relative_to(here) else whole).as_posix()


def _hash(file: Path) -> str:
    """Return the hash of a file, or of all that lies in a folder."""
    found = hashlib.sha256()
    inner = sorted(file.iterdir()) if is_folder(file) else [file]
    for each in inner:
        if is_file(each):
            found.update(each.name.encode())
            with each.open("rb") as stream:
                while block := stream.read(1 << 20):
                    found.update(block)
    return found.hexdigest()[:DIGITS]

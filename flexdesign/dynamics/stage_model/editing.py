"""A changed stage model in the file it was read from: comments, order and spelling of the user stay."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from flexdesign.core import toml_writing
from flexdesign.core.errors import InputError
from flexdesign.dynamics.stage_model import reading
from flexdesign.dynamics.stage_model.model import StageModel
from flexdesign.dynamics.stage_model.writing import ABSENT, to_toml


def edit(origin: str | Path | StageModel, model: StageModel, folder: Path) -> str:
    """Return a stage model as TOML, with the comments of the file it began as.

    Parameters
    ----------
    origin
        The file, or its bare name. A model in memory has no comments: the text is then that of `to_toml`.
    model
        The model to write.
    folder
        Where the file will lie; see `to_toml`.

    Notes
    -----
    The edited text is read back. Where it does not give the same model, for example because hysteresis was written as
    a table of effects and its numbers changed, the text is that of `to_toml`, without comments.
    """
    fresh = to_toml(model, folder)
    if isinstance(origin, StageModel):
        return fresh
    path = reading.find(origin)
    try:
        before = to_toml(reading.read(path), path.resolve().parent)
        original = _remove_outdated_comments(path.read_text(encoding="utf-8-sig"), before, fresh)
        edited = toml_writing.merge(original, before, fresh)
        again = reading.from_content(tomllib.loads(edited), folder / path.name)
    except (InputError, OSError, ValueError):  # an unusable original or edit; tomlkit's errors are ValueErrors
        return fresh
    return edited if tomllib.loads(to_toml(again, folder)) == tomllib.loads(fresh) else fresh


def _remove_outdated_comments(text: str, before: str, after: str) -> str:
    """Return a text without the comment lines of the program that the changed model no longer has."""
    outdated = set(re.findall(r"^#.*$", before, re.MULTILINE)) - set(re.findall(r"^#.*$", after, re.MULTILINE))
    lines = [line for line in text.splitlines() if line not in outdated and not line.startswith(ABSENT)]
    return "\n".join(lines) + "\n"

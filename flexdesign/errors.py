"""The one way in which flexdesign refuses its input."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path


class InputError(Exception):
    """Something the user gave cannot be used; raised where the fact is known, caught once by the CLI.

    Parameters
    ----------
    file
        The file the fact came from, or what stands in for one (``"command line"``).
    field
        The dotted name of the field, e.g. ``dimensions.hinge_thickness``; empty when the whole file is meant.
    value
        What was found there, shown as it was written.
    remedy
        One sentence that says what is wrong and what to do about it.
    """

    def __init__(self, file: str | Path, field: str, value: object, remedy: str) -> None:
        self.file = str(file)
        self.field = field
        self.value = value
        self.remedy = remedy
        super().__init__(str(self))

    def __str__(self) -> str:
        where = self.file + (f": {self.field}" if self.field else "")
        found = "" if self.value is None else f" = {_shown(self.value)}"
        return " ".join(f"{where}{found}: {self.remedy}".split())


def suggest(name: str, known: Sequence[str]) -> str:
    """Return the end of a remedy: the known names nearest to `name`, or all of them."""
    near = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    if not near:
        return f"; known: {_listed(known)}" if known else ""
    if difflib.SequenceMatcher(None, name, near[0]).ratio() > 0.75:
        near = near[:1]
    return f"; did you mean {' or '.join(near)}?"


def _listed(names: Sequence[str], longest: int = 160) -> str:
    """Return names in a row, as many as one message bears."""
    room = next((n for n in range(len(names)) if len(", ".join(names[: n + 1])) > longest), len(names))
    more = len(names) - room
    return ", ".join(names[:room]) + (f" and {more} more" if more else "")


def _shown(value: object, longest: int = 80) -> str:
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= longest else text[: longest - 1] + "…"

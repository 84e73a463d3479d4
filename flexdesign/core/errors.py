"""The one way in which flexdesign refuses its input."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path

#: Most letters of a message without the folder of its file; of its field, its value and each of its words.
MESSAGE, FIELD, VALUE, WORD = 400, 100, 80, 120
#: No name that anybody gives has more letters: nothing is like it.
NAME = 100


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

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, object, str]]:  # from one process to another
        return InputError, (self.file, self.field, self.value, self.remedy)

    def __str__(self) -> str:
        file, name = printable(self.file), printable(Path(self.file).name)
        field = f": {shorten(printable(self.field), FIELD)}" if self.field else ""
        value = "" if self.value is None else f" = {_value_text(self.value)}"
        words = " ".join(shorten(word, WORD) for word in printable(self.remedy).split())
        room = MESSAGE - len(f"{name}{field}{value}: ")
        return f"{file}{field}{value}: {shorten(words, max(room, WORD))}"


def import_remedy(error: BaseException) -> str:
    """Say how a file of the user imports what flexdesign offers, if it failed as it looked elsewhere; else nothing.

    >>> import_remedy(ModuleNotFoundError("No module named 'flexdesign.model'", name="flexdesign.model"))
    'imports from flexdesign.model what is not there; write from flexdesign import Effect, Parameter, Port, ...
    """
    if not isinstance(error, ImportError) or (error.name or "").partition(".")[0] != "flexdesign":
        return ""
    words = "from flexdesign import Effect, Parameter, Port, … (flexdesign.__all__ lists what there is)"
    return f"imports from {error.name} what is not there; write {words}"


def join_names(names: Sequence[str], last: str = "and") -> str:
    """Write names as a sentence lists them.

    >>> join_names(["a", "b", "c"], "or")
    'a, b or c'
    """
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} {last} {names[-1]}"


def shorten(text: str, longest: int) -> str:
    """Return a text, or its beginning and its end where it is longer than it may be.

    >>> shorten("dimensions.hinge_thickness", 16)
    'dimensions…kness'
    """
    if len(text) <= longest:
        return text
    end = longest // 3
    return f"{text[: longest - end - 1]}…{text[len(text) - end :]}"


def printable(text: str) -> str:
    r"""Return a text in one line, and what would move the cursor or hide in it by its code.

    >>> printable("an\nend" + chr(27))
    'an end\\x1b'
    """
    line = " ".join(text.split())
    return "".join(sign if sign.isprintable() else sign.encode("unicode_escape").decode("ascii") for sign in line)


def suggest(name: str, known: Sequence[str]) -> str:
    """Return the end of a remedy: the known names nearest to `name`, or all of them."""
    known = [shorten(each, NAME) for each in known]
    closest = difflib.get_close_matches(name, known, n=3, cutoff=0.5) if len(name) <= NAME else []
    if not closest:
        return f"; known: {_join_names(known)}" if known else ""
    if difflib.SequenceMatcher(None, name, closest[0]).ratio() > 0.75:
        closest = closest[:1]
    return f"; did you mean {' or '.join(closest)}?"


def _join_names(names: Sequence[str], longest: int = 160) -> str:
    """Return names in a row, as many as one message bears."""
    room = next((n for n in range(len(names)) if len(", ".join(names[: n + 1])) > longest), len(names))
    more = len(names) - room
    return ", ".join(names[:room]) + (f" and {more} more" if more else "")


def _value_text(value: object) -> str:
    try:
        text = value if isinstance(value, str) else repr(value)
    except ValueError:  # a whole number of thousands of digits
        text = "a number without end"
    text = printable(text)
    return text if len(text) <= VALUE else text[: VALUE - 1] + "…"

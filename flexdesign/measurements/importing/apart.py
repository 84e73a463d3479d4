"""Libraries at damaged files: each has errors of its own, some end the process, some never come back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

from flexdesign.core import subprocess_call
from flexdesign.core.errors import InputError

P = ParamSpec("P")
T = TypeVar("T")
#: Reading takes no more processor time than this [s], and so much for each byte besides.
LONGEST, PER_BYTE = 6.0, 1e-7


def apart(path: Path, read: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Return what a function of a module reads from a file, in a process of its own.

    Raises
    ------
    InputError
        If it cannot be read.
    """
    seconds = LONGEST + PER_BYTE * path.stat().st_size
    return intact(path, lambda: subprocess_call.ask(seconds, read, *args, **kwargs))


def intact(path: Path, read: Callable[[], T]) -> T:
    """Return what a function reads from a file; whatever it raises is an InputError."""
    try:
        return read()
    except InputError as error:
        raise InputError(path, error.field, error.value, error.remedy) from error
    except Exception as error:
        ending = path.suffix.lower()
        remedy = f"cannot be read as a {ending} file: it is damaged, cut short or something else; save it again"
        raise InputError(path, "", None, remedy) from error

"""Python files that a design or a model names: they run with the rights of the user, unless that is forbidden.

`--no-code` on the command line, or ``FLEXDESIGN_NO_CODE=1`` in the environment, forbids it; processes that a sweep
starts inherit that, and workers of a cluster receive it. What comes with flexdesign always runs, as do installed
packages.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from flexdesign.core import data_files

#: The variable of the environment that forbids it.
VARIABLE = "FLEXDESIGN_NO_CODE"
_ran: dict[Path, str] = {}


def forbid() -> None:
    """Forbid files of others to run in this process and in those that it starts."""
    os.environ[VARIABLE] = "1"


@contextmanager
def forbidden(wanted: bool = True) -> Iterator[None]:
    """Forbid files of others to run for a while, if that is wanted."""
    before = os.environ.get(VARIABLE, "")
    if wanted:
        forbid()
    try:
        yield
    finally:
        os.environ[VARIABLE] = before


def is_forbidden() -> bool:
    """Tell whether files of others may not run."""
    return os.environ.get(VARIABLE, "") not in ("", "0")


def is_own(path: Path) -> bool:
    """Tell whether a file comes with flexdesign."""
    resolved = path.resolve()
    package = Path(__file__).resolve().parent.parent
    return any(resolved.is_relative_to(folder) for folder in (package, data_files.root() / "geometry"))


def admit(path: Path, kind: str) -> None:
    """Note that a file is about to run.

    Parameters
    ----------
    path
        The file.
    kind
        What it is: ``part`` or ``effect``.

    Raises
    ------
    PermissionError
        If that is forbidden; the message says what to do.
    """
    if is_own(path):
        return
    if is_forbidden():
        raise PermissionError(f"is a Python file, and --no-code forbids its {kind} to run; read it, then allow it")
    _ran[path.resolve()] = kind


def forget() -> None:
    """Begin anew with what ran: at the start of each command."""
    _ran.clear()


def ran() -> tuple[str, ...]:
    """Return which files of others ran in this command, each with what it is."""
    return tuple(f"{path} ({kind})" for path, kind in _ran.items())

"""How a catalogue finds effects that are not its own: by entry points of installed packages, or in a file."""

from __future__ import annotations

import importlib.util
from collections.abc import Collection, Mapping
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

from flexdesign.core import foreign_code
from flexdesign.core.errors import import_remedy, suggest
from flexdesign.core.model import Effect
from flexdesign.core.toml_files import is_file


def entry_points_by_name(group: str, own: Collection[str]) -> dict[str, EntryPoint]:
    """Return the entry points of installed packages by the names of their effects; none takes the place of our own."""
    return {entry.name: entry for entry in entry_points(group=group) if entry.name not in own}


def foreign(name: str, entries: Mapping[str, EntryPoint], known: Collection[str], kind: str) -> Effect:
    """Return an effect of an installed package, or from a file, which is loaded once.

    Parameters
    ----------
    name
        Of an entry point, or a path.
    entries
        By their names.
    known
        All names of the catalogue, for the message.
    kind
        What the catalogue's effects are called: ``effect`` or ``static effect``.

    Raises
    ------
    ValueError
        If there is none; the message says what there is.
    """
    if name in entries:
        found = _from_package(entries[name])
    elif name.endswith(".py"):
        found = _from_file(Path(name).resolve())  # a relative path means another file in another folder
    else:
        raise ValueError(f"is not a known {kind}{suggest(name, list(known))}")
    if not isinstance(found, Effect):
        raise ValueError("has an EFFECT that is no flexdesign.Effect")
    if name in entries and found.name != name:
        raise ValueError(f"is called {found.name} by itself; the entry point needs that name")
    return found


def resolve_name(name: str, folder: Path, known: Collection[str]) -> str:
    """Return the name of an effect that is valid everywhere: that of a file is its absolute path.

    Parameters
    ----------
    name
        Of the catalogue, or a path.
    folder
        Where a relative path is looked up first, before the working directory.
    known
        All names of the catalogue.

    Raises
    ------
    ValueError
        If there is no such file; the message says what was tried.
    """
    if name in known or not name.endswith(".py"):
        return name
    candidates = list(dict.fromkeys(base.resolve() / name for base in (folder, Path())))
    for path in candidates:
        if is_file(path):
            return str(path.resolve())
    raise ValueError(f"is no Python file; tried {' and '.join(map(str, candidates))}")


@cache
def _from_package(entry: EntryPoint) -> object:
    try:
        return entry.load()
    except Exception as error:
        raise ValueError(f"cannot be loaded from {entry.value}: {type(error).__name__}: {error}") from error


@cache
def _from_file(path: Path) -> object:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not is_file(path):
        raise ValueError("is no Python file")
    try:
        foreign_code.admit(path, "effect")
    except PermissionError as error:
        raise ValueError(str(error)) from None
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        return module.EFFECT
    except Exception as error:
        raise ValueError(import_remedy(error) or f"cannot be loaded: {type(error).__name__}: {error}") from error

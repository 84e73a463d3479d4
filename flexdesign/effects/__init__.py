"""The catalogue of effects: one piece of physics per file, found by its name or by a path.

An installed package adds effects of its own by entry points of the group ``flexdesign.effects``, each the name of the
effect and its place, such as ``my_package.my_effect:EFFECT``.

>>> find("bouc_wen").where
'the piezo stack, between its voltage and its extension'
"""

from __future__ import annotations

import importlib.util
import pkgutil
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import cast

from flexdesign.errors import suggest
from flexdesign.model import Effect

#: The group of entry points by which installed packages add effects.
GROUP = "flexdesign.effects"


@cache
def names() -> tuple[str, ...]:
    """Return the names of the effects that come with flexdesign, and of those that installed packages add."""
    return tuple(sorted({*_own(), *_added()}))


@cache
def _own() -> frozenset[str]:
    return frozenset(m.name for m in pkgutil.iter_modules(__path__) if not (m.ispkg or m.name.startswith("_")))


@cache
def _added() -> dict[str, EntryPoint]:
    """Return the entry points of installed packages by the names of their effects; none takes the place of ours."""
    return {entry.name: entry for entry in entry_points(group=GROUP) if entry.name not in _own()}


def find(name: str) -> Effect:
    """Return an effect by its name, or from a file by its path, which is loaded once.

    Raises
    ------
    ValueError
        If there is none; the message says what there is.
    """
    if name in _own():
        return _shipped(name)
    elif name in _added():
        found = _from_package(_added()[name])
    elif name.endswith(".py"):
        found = _from_file(Path(name).resolve())  # a relative path means another file in another folder
    else:
        raise ValueError(f"is not a known effect{suggest(name, list(names()))}")
    if not isinstance(found, Effect):
        raise ValueError("has an EFFECT that is no flexdesign.model.Effect")
    if name in _added() and found.name != name:
        raise ValueError(f"is called {found.name} by itself; the entry point needs that name")
    return found


@cache
def _shipped(name: str) -> Effect:
    return cast(Effect, importlib.import_module(f"{__name__}.{name}").EFFECT)


def beside(name: str, folder: Path) -> str:
    """Return the name under which `find` has an effect from everywhere: that of a file is its absolute path.

    Parameters
    ----------
    name
        Of the catalogue, or a path.
    folder
        Where a relative path is looked up first, before the working directory.

    Raises
    ------
    ValueError
        If there is no such file; the message says what was tried.
    """
    if name in names() or not name.endswith(".py"):
        return name
    tried = list(dict.fromkeys((base / name).resolve() for base in (folder, Path())))
    for path in tried:
        if path.is_file():
            return str(path)
    raise ValueError(f"is no Python file; tried {' and '.join(map(str, tried))}")


@cache
def _from_package(entry: EntryPoint) -> object:
    try:
        return entry.load()
    except Exception as error:
        raise ValueError(f"cannot be loaded from {entry.value}: {type(error).__name__}: {error}") from error


@cache
def _from_file(path: Path) -> object:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.is_file():
        raise ValueError("is no Python file")
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
        return module.EFFECT
    except Exception as error:
        raise ValueError(f"cannot be loaded: {type(error).__name__}: {error}") from error

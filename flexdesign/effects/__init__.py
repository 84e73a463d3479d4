"""The catalogue of effects: one piece of physics per file, found by its name or by a path.

An installed package adds effects of its own by entry points of the group ``flexdesign.effects``, each the name of the
effect and its place, such as ``my_package.my_effect:EFFECT``.

>>> find("bouc_wen").where
'the piezo stack, between its voltage and its extension'
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import cast

from flexdesign.effects import _finding
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
    return _finding.added(GROUP, _own())


def find(name: str) -> Effect:
    """Return an effect by its name, or from a file by its path, which is loaded once.

    Raises
    ------
    ValueError
        If there is none; the message says what there is.
    """
    return _shipped(name) if name in _own() else _finding.foreign(name, _added(), names(), "effect")


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
    return _finding.beside(name, folder, names())

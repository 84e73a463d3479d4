"""The catalogue of effects: one piece of physics per file, found by its name or by a path.

An installed package adds effects of its own by entry points of the group ``flexdesign.effects``, each the name of the
effect and its place, such as ``my_package.my_effect:EFFECT``.

>>> find("bouc_wen").where
'the piezo stack, between its voltage and its extension'
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
from collections.abc import Iterator
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import cast

from flexdesign.core.model import Effect
from flexdesign.effects import _finding

#: The group of entry points by which installed packages add effects.
GROUP = "flexdesign.effects"
#: Effects of which an axis may have several, the second one as ``second_mode.2``, and how many.
REPEATED, MOST = ("second_mode",), 4


@cache
def names() -> tuple[str, ...]:
    """Return the names of the effects that come with flexdesign, and of those that installed packages add."""
    return tuple(sorted({*_own_names(), *_entry_points()}))


@cache
def _own_names() -> frozenset[str]:
    return frozenset(m.name for m in pkgutil.iter_modules(__path__) if not (m.ispkg or m.name.startswith("_")))


@cache
def _entry_points() -> dict[str, EntryPoint]:
    return _finding.entry_points_by_name(GROUP, _own_names())


def find(name: str) -> Effect:
    """Return an effect by its name, or from a file by its path, which is loaded once.

    Raises
    ------
    ValueError
        If there is none; the message says what there is.

    >>> find("second_mode.2") is find("second_mode")
    True
    """
    name = original(name)
    return _load_own(name) if name in _own_names() else _finding.foreign(name, _entry_points(), names(), "effect")


def original(name: str) -> str:
    """Return the name in the catalogue of an effect that an axis has several times.

    >>> original("second_mode.2"), original("creep")
    ('second_mode', 'creep')
    """
    first, _, number = name.rpartition(".")
    return first if first in REPEATED and number in map(str, range(2, MOST + 1)) else name


def again(name: str) -> tuple[str, ...]:
    """Return the names of an effect that an axis has several times, from the second one on.

    >>> again("second_mode"), again("creep")
    (('second_mode.2', 'second_mode.3', 'second_mode.4'), ())
    """
    return tuple(f"{name}.{number}" for number in range(2, MOST + 1)) if name in REPEATED else ()


@cache
def _load_own(name: str) -> Effect:
    return cast(Effect, importlib.import_module(f"{__name__}.{name}").EFFECT)


def resolve_name(name: str, folder: Path) -> str:
    """Return the name of an effect that is valid everywhere: that of a file is its absolute path.

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
    return _finding.resolve_name(name, folder, names())


class _Catalogue(ModuleType):
    """The module as a mapping, so that ``fd.effects["creep"]`` is an effect."""

    def __getitem__(self, name: str) -> Effect:
        return find(name)

    def __iter__(self) -> Iterator[str]:
        return iter(names())

    def __len__(self) -> int:
        return len(names())

    def __contains__(self, name: object) -> bool:
        return name in names()


sys.modules[__name__].__class__ = _Catalogue

"""The catalogue of static effects: what changes stiffness in addition to rotating hinges, one effect per file.

One of a user's own is found by its path, or by an entry point of the group ``flexdesign.static_effects``.

>>> find("over_cut").where
'every cut face; it shows in the hinges'
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import cast

from flexdesign.core.model import Effect
from flexdesign.effects import _finding

#: Effects that follow from a drawing act in full strength: nothing has to be measured for them.
BY_DRAWING = (
    "hinge_axial",
    "hinge_shear",
    "arm_axial",
    "arm_bending",
    "rod_bending",
    "rod_shear",
    "block_bending",
    "root_flexibility",
    "sloping_sides",
    "plane_strain",
)


#: Effects that follow from the drawing of a stage: between its parts, and out of their planes.
OF_STAGES = ("free_bodies", "out_of_plane")
#: What is of a single part.
OF_PARTS = ("geometric_stiffening", "one_member")
#: The group of entry points by which installed packages add static effects.
GROUP = "flexdesign.static_effects"


@cache
def names() -> tuple[str, ...]:
    """Return the names of the static effects that come with flexdesign, and of those that installed packages add."""
    return tuple(sorted({*_own_names(), *_entry_points()}))


@cache
def _own_names() -> frozenset[str]:
    return frozenset(module.name for module in pkgutil.iter_modules(__path__))


@cache
def _entry_points() -> dict[str, EntryPoint]:
    return _finding.entry_points_by_name(GROUP, _own_names())


def find(name: str) -> Effect:
    """Return a static effect by its name, or from a file by its path, which is loaded once.

    Raises
    ------
    ValueError
        If there is none, or it does not act at rest; the message says what there is.
    """
    relative = name.endswith(".py") and name not in names() and not Path(name).is_absolute()
    return _load(str(Path(name).resolve()) if relative else name)


@cache
def _load(name: str) -> Effect:
    if name in _own_names():
        return cast(Effect, importlib.import_module(f"{__name__}.{name}").EFFECT)
    effect = _finding.foreign(name, _entry_points(), names(), "static effect")
    if not effect.acts_at_rest:
        remedy = 'give it a Term, a Reshape, or an Adjust(..., of="part")'
        raise ValueError(f"acts in time alone, which no part at rest shows; {remedy}")
    return effect


def resolve_name(name: str, folder: Path) -> str:
    """Return the name of a static effect that is valid everywhere, as `flexdesign.effects.resolve_name` does."""
    return _finding.resolve_name(name, folder, names())

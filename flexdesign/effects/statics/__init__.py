"""The catalogue of static effects: what a mechanism's stiffness has beside rotating hinges, one piece per file.

>>> find("over_cut").where
'every cut face; it shows in the hinges'
"""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from typing import cast

from flexdesign.errors import suggest
from flexdesign.model import Effect

#: What a drawing tells is there, in full strength: nothing has to be measured for it.
BY_DRAWING = (
    "hinge_axial",
    "hinge_shear",
    "arm_axial",
    "arm_bending",
    "rod_bending",
    "rod_shear",
    "block_bending",
    "root_flexibility",
    "plane_strain",
)


@cache
def names() -> tuple[str, ...]:
    """Return the names of the static effects."""
    return tuple(sorted(module.name for module in pkgutil.iter_modules(__path__)))


@cache
def find(name: str) -> Effect:
    """Return a static effect by its name.

    Raises
    ------
    ValueError
        If there is none; the message says what there is.
    """
    if name not in names():
        raise ValueError(f"is not a known static effect{suggest(name, list(names()))}")
    return cast(Effect, importlib.import_module(f"{__name__}.{name}").EFFECT)

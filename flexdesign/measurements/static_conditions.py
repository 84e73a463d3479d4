"""What a static table says of the part it was measured or computed on, where it differs from the design's file.

Dimensions stand in columns. Material, actuator and part cannot vary within a table: they stand in comments at its head,
and a table of another material is refused rather than compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from flexdesign.core import units
from flexdesign.core.errors import InputError
from flexdesign.design.design import Design

#: Conditions that comments state, by names that no user's comment has by chance: what of a design changes it, and how
#: it is written.
STATED_CONDITIONS: Mapping[str, tuple[str, Callable[[Design], str]]] = {
    "computed with the part": ("part", lambda design: design.part_class.__name__),
    "computed with the material": ("material", lambda design: design.material.name),
    "computed with an actuator, seats included, of": (
        "actuator",
        lambda d: units.to_text(d.actuator.installed_stiffness, "N/um", 6, si="N/m") if d.actuator else "none",
    ),
}


def overrides_of(design: Design) -> dict[str, str]:
    """Return what overrides changed of a design in addition to its dimensions, as comments have it."""
    return {name: write(design) for name, (key, write) in STATED_CONDITIONS.items() if key in design.changed}


def dimensions(design: Design) -> dict[str, str]:
    """Return the dimensions that overrides changed: header cells with units, and their numbers."""
    known = {parameter.name: parameter for parameter in design.part_class.dimensions}
    names = [key.removeprefix("dimensions.") for key in design.changed if key.startswith("dimensions.")]
    found = {}
    for name in names:
        unit = known[name].unit or "1"
        value = design.dimensions[name] / (units.factor(unit, known[name].si) if unit != "1" else 1.0)
        found[f"{name} [{unit}]"] = f"{value:.12g}"
    return found


def refuse_others(path: Path, text: str, design: Design) -> None:
    """Refuse a table whose comments state another part, material or actuator than the design has.

    Raises
    ------
    InputError
        If one does.
    """
    for line in text.splitlines():
        name, colon, value = line.strip().removeprefix("#").partition(":")
        if not (line.strip().startswith("#") and colon and name.strip() in STATED_CONDITIONS):
            continue
        key, write = STATED_CONDITIONS[name.strip()]
        if write(design) != value.strip():
            remedy = f"the design has {write(design)}; read it with the same --set {key}... as the table was made with"
            raise InputError(path, name.strip(), value.strip(), remedy)

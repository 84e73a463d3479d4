"""What others published of a stage: read, and refused, by what is known of its quantities before anything is solved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from flexdesign.core import units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Quantity, by_key
from flexdesign.design.assembly import Assembly
from flexdesign.design.study import Study
from flexdesign.fem import cross_axis_coupling
from flexdesign.fem.quantities.stage import requested_quantities

#: What keys of quantities at a stated input have after quantity and axis.
AT_INPUT = "_input_of_"


def input_motion(study: Study, axis: str) -> float:
    """Return how far an axis' inputs part: as the study says, or half the free stroke."""
    actuator = study.design.actuator
    if axis in study.stage.inputs:
        return float(study.stage.inputs[axis])
    return actuator.free_stroke / 2 if actuator else 10e-6


def read_published(study: Study, assembly: Assembly) -> dict[str, dict[str, Quantity]]:
    """Return published numbers by where they come from and by the key of the quantity they are compared with.

    What holds at another input than those for which anything is computed is left out.

    Raises
    ------
    InputError
        If a number belongs to no quantity, or cannot be read.
    """
    actuator = study.design.actuator
    known = by_key(requested_quantities(assembly.axes, installed=actuator is not None))
    for axis in assembly.axes:
        others = [other for other in assembly.axes if other != axis]
        for extension in [input_motion(study, axis), *([actuator.free_stroke] if actuator else [])]:
            known |= by_key(cross_axis_coupling.requested_quantities(axis, extension, others))
    return {
        label: {
            key: _read_number(study, label, key, text, known)
            for key, text in numbers.items()
            if key in known or not _is_other_input(key, known)
        }
        for label, numbers in study.published.items()
    }


def _read_number(study: Study, label: str, key: str, text: str, known: Mapping[str, Quantity]) -> Quantity:
    """Read a number of others, such as "238 um" or "238 ± 15 um", by the quantity it is compared with."""
    place = f"published.{label}.{key}"
    if key not in known:
        remedy = f"is no quantity of this stage{suggest(key, sorted(known))}"
        raise InputError(study.file, place, text, remedy)
    quantity = known[key]
    number, _, spread = (each.strip() for each in text.partition("±"))
    unit = spread.lstrip("+-.0123456789eE").strip()
    try:
        value = units.from_text(f"{number} {unit}".strip(), quantity.si)
        sigma = units.from_text(spread, quantity.si) if spread else None
        if sigma is not None and sigma <= 0:
            raise ValueError("the uncertainty must be positive")
    except ValueError as error:
        raise InputError(study.file, place, text, str(error)) from None
    return replace(quantity, value=value, half_width=sigma, source=label)


def _is_other_input(key: str, known: Mapping[str, Quantity]) -> bool:
    """Tell whether a key is one of those that are known but for the input, at which nothing was computed."""
    name, mark, _ = key.partition(AT_INPUT)
    return bool(mark) and any(other.startswith(f"{name}{mark}") for other in known)

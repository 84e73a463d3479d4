"""How axes, quantities and deviations of a stage are written; equal axes are listed once."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

from flexdesign.core.model import Quantity
from flexdesign.report.wording import NAMES
from flexdesign.workflows.validation import Comparison
from flexdesign.workflows.validation.validate_stage import StageValidation

#: Axes whose quantities differ by less than this, relative, are alike.
SAME_AXIS = 1e-6
#: How quantities are called in short.
SHORT = {"lambda": "λ", "output_mass": "modal mass", "output_frequency": "frequency"}


class Axes:
    """Which axes of a stage are listed, and how they are called: X/Y where Y is as X.

    Parameters
    ----------
    validation
        What was found.
    """

    def __init__(self, validation: StageValidation) -> None:
        self.names = list(validation.assembly.axes)
        self.head = {name: name for name in self.names}
        for first, second in itertools.combinations(self.names, 2):
            if self.head[first] == first and self.head[second] == second and _are_equivalent(validation, first, second):
                self.head[second] = first

    @property
    def listed(self) -> list[str]:
        """The axes that represent themselves and equal ones."""
        return [name for name in self.names if self.head[name] == name]

    def label(self, axis: str) -> str:
        """Return an axis and those like it, such as X/Y."""
        return "/".join(name.upper() for name in self.names if self.head[name] == self.head[axis])

    def pair(self, driven: str, other: str) -> str:
        """Return a coupling's axes, such as X/Y→Z, and X→Y for what is between two that are alike."""
        if self.head[driven] == self.head[other]:
            return f"{driven.upper()}→{other.upper()}"
        return f"{self.label(driven)}→{self.label(other)}"

    def is_listed(self, quantity: Quantity) -> bool:
        """Return whether a quantity is listed, because its axis is not equal to another."""
        axis, other = axis_of(quantity), quantity.name.partition("coupling_")[2]
        if axis not in self.head:
            return True
        return self.head[axis] == axis and (not other or self.head[other] in (other, axis))

    def pairs(self) -> Iterator[tuple[str, str]]:
        """Yield driven and other axis of every coupling that is listed."""
        for driven in self.listed:
            for other in self.names:
                if other != driven and self.head[other] in (other, driven):
                    yield driven, other

    def what(self, quantity: Quantity) -> str:
        """Return what a quantity is, without its boundary: output stiffness K_out, or coupling X→Y."""
        _, coupled, other = quantity.name.partition("coupling_")
        if coupled:
            return f"coupling {self.pair(axis_of(quantity), other)}"
        return NAMES.get(quantity.name, quantity.name.replace("_", " "))

    def where(self, quantity: Quantity) -> str:
        """Return its boundary with the axes by their labels."""
        axis, _, rest = quantity.boundary.partition(", ")
        if axis not in self.head:
            return quantity.boundary
        return rest if quantity.name.startswith("coupling_") else f"{self.label(axis)}, {rest}"

    def short(self, quantity: Quantity) -> str:
        """Return quantity and axis in few letters: K_out X/Y."""
        if quantity.name.startswith("coupling_"):
            return self.what(quantity)
        return f"{SHORT.get(quantity.name, quantity.name)} {self.label(axis_of(quantity))}"


def axis_of(quantity: Quantity) -> str:
    """Return the axis that a boundary begins with."""
    return quantity.boundary.partition(", ")[0]


def _are_equivalent(validation: StageValidation, first: str, second: str) -> bool:
    """Tell whether two axes have the same quantities, each other's place taken."""
    swap = {first: second, second: first}
    for key, quantity in validation.coarsest.items():
        if axis_of(quantity) in swap:
            image = validation.coarsest.get("_".join(swap.get(word, word) for word in key.split("_")))
            # Inputs may be stated for one axis and not for the other: then they are not alike.
            if image is None or not math.isclose(quantity.value, image.value, rel_tol=SAME_AXIS):
                return False
    return True


def written(validation: StageValidation, model: str, quantity: Quantity) -> str:
    """Write a model's number; a published one with as many digits as were printed."""
    text = validation.study.published.get(model, {}).get(quantity.key)
    if text is None:
        return quantity.formatted()
    if "±" in text:
        return text
    digits = text.split()[0].lstrip("+-").replace(".", "").lstrip("0")
    return quantity.formatted(max(len(digits), 1))


def percent(ratio: float | None) -> str:
    """Write a relative deviation."""
    return "–" if ratio is None else f"{100 * ratio:+.1f} %"


def share(ratio: float) -> str:
    """Write a coupling; what rounding leaves of none as 0."""
    return "0" if abs(ratio) < 1e-9 else f"{100 * ratio:.3g} %"


def measured_values(comparison: Comparison) -> dict[str, Quantity]:
    """Return the numbers with an uncertainty that a quantity is compared with, by whose they are."""
    return {model: quantity for model, quantity in comparison.analytic.items() if quantity.half_width}


def computed_values(comparison: Comparison) -> dict[str, Quantity]:
    """Return the numbers without an uncertainty: analytic models, and other programs."""
    return {model: quantity for model, quantity in comparison.analytic.items() if not quantity.half_width}

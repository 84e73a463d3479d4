"""A number that says what it is: the common answer of FEM, formula, paper and bench."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from flexdesign.core import units


@dataclass(frozen=True)
class Quantity:
    """One physical quantity, in SI, with the boundary it holds under and where it comes from.

    Parameters
    ----------
    name
        Standard name, e.g. ``K_in``. Two quantities are comparable when name and boundary agree.
    value
        The number, in the SI unit `si`.
    si
        Its SI unit, e.g. ``N/m``; ``"1"`` for ratios.
    unit
        The unit in which people read it, e.g. ``N/mm``.
    boundary
        The conditions at the ports, e.g. ``output free``.
    source
        What produced it: an equation, a mesh, a paper, an instrument.
    half_width
        Half-width of the stated uncertainty in SI, or None when none is known.
    datum
        Of a coordinate, the one from which it is computed: a relative error is one of their difference.
    """

    name: str
    value: float
    si: str
    unit: str
    boundary: str = ""
    source: str = ""
    half_width: float | None = None
    datum: float = 0.0

    @property
    def key(self) -> str:
        """Name and boundary in one word: ``K_out_input_held``."""
        return "_".join([self.name, *self.boundary.replace(",", "").split()])

    def formatted(self, digits: int = 4) -> str:
        """Write the value in the display unit with `digits` digits, or with those its uncertainty leaves meaning."""
        scale = units.factor(self.unit or "1", self.si)
        value = self.value / scale
        if not self.half_width:
            return f"{units.significant(value, digits)} {self.unit}".rstrip()
        half_width = self.half_width / scale
        decimals = 1 - math.floor(math.log10(float(f"{half_width:.1e}")))  # two digits of the uncertainty
        if -5 < decimals < 0:
            return f"{round(value, decimals):.0f} ± {round(half_width, decimals):.0f} {self.unit}".rstrip()
        if decimals < 0 or decimals > 9:
            digits = max(math.floor(math.log10(abs(value) or half_width)) + decimals, 0)  # as far as the uncertainty's
            return f"{value:.{digits}e} ± {half_width:.1e} {self.unit}".rstrip()
        return f"{value:.{decimals}f} ± {half_width:.{decimals}f} {self.unit}".rstrip()

    def to_json(self) -> dict[str, Any]:
        """Return the quantity in its display unit, as result.json holds it."""
        scale = units.factor(self.unit or "1", self.si)
        return {
            "name": self.name,
            "boundary": self.boundary,
            "value": self.value / scale,
            "half_width": None if self.half_width is None else self.half_width / scale,
            "unit": self.unit or "1",
            "source": self.source,
        }

    def __str__(self) -> str:
        boundary = f" ({self.boundary})" if self.boundary else ""
        return f"{self.name}{boundary} = {self.formatted()}"


def by_key(found: Iterable[Quantity]) -> dict[str, Quantity]:
    """Return quantities by their keys."""
    return {quantity.key: quantity for quantity in found}


def output_boundary(load: float) -> str:
    """Return the boundary's name for an output that pushes against a stiffness [N/m]; 0 is a free output.

    Raises
    ------
    ValueError
        If the stiffness is negative or not finite.
    """
    if not 0 <= load < math.inf:
        raise ValueError(f"an output load is a stiffness of zero or more, found {load!r} N/m")
    return "output free" if load == 0 else f"output loaded by {units.to_text(load, 'N/mm', si='N/m')}"

"""A number that can be changed: what a dimension, a base constant and an effect's strength have in common."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from flexdesign.core import units


@dataclass(frozen=True)
class Parameter:
    """One adjustable number of a part, a model or an effect.

    Parameters
    ----------
    name
        Name within its owner; dotted with the owner's name in files (``x.creep.per_decade``).
    si, unit
        The SI unit it travels in and the unit in which people read and write it.
    meaning
        What it is, in a few words that a mechanical engineer uses.
    null
        The value at which it has no influence (0, or infinity for limits); None if there is none.
    start
        Where a fit begins, or the default of a dimension; None if the user must give it.
    plausible
        The range outside which a value is physically suspect, in SI.
    scale
        How a fit should move it.
    symbol
        The symbol the literature uses, e.g. ``l_x``.
    screen
        Values at which a search tries it, where the gradient vanishes: a limit, a corner frequency. They scale
        as `plausible` does.
    per_run
        Whether every recorded run has its own: a start state, a phase.
    run
        The one recorded run on which this number acts; empty if it acts on all.
    twin
        Number of single runs that does to each what this one does to all: both add up, and only what is known of either
        distinguishes them.
    """

    name: str
    si: str
    unit: str
    meaning: str
    null: float | None = None
    start: float | None = None
    plausible: tuple[float, float] = (-math.inf, math.inf)
    scale: Literal["linear", "log", "inverse"] = "linear"
    symbol: str = ""
    screen: tuple[float, ...] = ()
    per_run: bool = False
    run: str = ""
    twin: str = ""

    @property
    def factor(self) -> float:
        """What its unit is in SI."""
        return units.factor(self.unit or "1", self.si)

    def is_plausible(self, value: float) -> bool:
        """Tell whether `value` (SI) lies in the plausible range, bounds included."""
        return self.plausible[0] <= value <= self.plausible[1]

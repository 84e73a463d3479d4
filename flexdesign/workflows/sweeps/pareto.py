"""Which of many designs are good: limits that they keep, aims, and those that no other beats in all aims at once."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, suggest
from flexdesign.workflows.sweeps.results import Results, key_of

Places = NDArray[np.intp]
_LIMIT = re.compile(r"\s*([<>])=?\s*(.+)")


@dataclass(frozen=True)
class Limit:
    """What a design has to keep.

    Parameters
    ----------
    quantity
        Key, or ``|key|`` for its size.
    is_upper
        Whether the quantity stays below the bound.
    text
        The bound as it was written, read in the unit of the quantity.
    file
        Where it was written.
    """

    quantity: str
    is_upper: bool
    text: str
    file: Path

    @classmethod
    def read(cls, quantity: str, text: str, file: Path) -> Limit:
        """Read a limit such as ``< 40 N/mm``.

        Raises
        ------
        InputError
            If it is none.
        """
        match = _LIMIT.fullmatch(text)
        if match is None:
            raise InputError(file, f"limits.{quantity}", text, 'write < or > and a bound, for example "< 40 N/mm"')
        return cls(quantity, match[1] == "<", match[2], file)

    def bound(self, si: str) -> float:
        """Return the bound [SI].

        Raises
        ------
        InputError
            If it is no number in a unit of the quantity.
        """
        try:
            return units.from_text(self.text, si)
        except ValueError as error:
            raise InputError(self.file, f"limits.{self.quantity}", self.text, str(error)) from None

    def is_satisfied(self, results: Results) -> NDArray[np.bool_]:
        """Tell of each design whether it keeps it; one without the quantity does not."""
        if not results.has(self.quantity):
            return np.zeros(len(results), dtype=bool)
        bound, found = self.bound(results.kinds[key_of(self.quantity)].si), results.column(self.quantity)
        return np.asarray(found < bound if self.is_upper else found > bound)

    def __str__(self) -> str:
        return f"{self.quantity} {'<' if self.is_upper else '>'} {self.text}"


@dataclass(frozen=True)
class Aim:
    """A quantity, by key or ``|key|``, that is to be large or small."""

    quantity: str
    is_largest: bool

    def costs(self, results: Results) -> Array:
        """Return what is to be small: the quantity, or its negative."""
        found = results.column(self.quantity)
        return -found if self.is_largest else found

    def __str__(self) -> str:
        return f"{'largest' if self.is_largest else 'smallest'} {self.quantity}"


def feasible(results: Results, limits: Sequence[Limit]) -> Places:
    """Return the places of the designs that keep all limits."""
    fine = np.array([not error for error in results.errors], dtype=bool)
    for limit in limits:
        fine &= limit.is_satisfied(results)
    return np.flatnonzero(fine)


def pareto_front(results: Results, places: Places, aims: Sequence[Aim]) -> Places:
    """Return the places of designs that no other is better than in one aim and as good as in the rest (Pareto).

    The best in the first aim comes first. Designs without one of the quantities are left out; with a single aim there
    is one.
    """
    costs = np.column_stack([aim.costs(results)[places] for aim in aims]).reshape(len(places), len(aims))
    there = np.isfinite(costs).all(axis=1)
    costs, places = costs[there], places[there]
    left = np.lexsort(costs.T[::-1])
    found: list[int] = []
    while left.size:  # whoever beats a design stands before it in this order, so that the first is beaten by none
        first, rest = left[0], left[1:]
        found.append(int(first))
        left = rest[(costs[rest] < costs[first]).any(axis=1)]
    return places[found]


def rank(results: Results, places: Places, aim: Aim) -> Places:
    """Return the places of designs, the best in one aim first; those without the quantity are left out."""
    costs = aim.costs(results)[places]
    order = np.argsort(costs, kind="stable")
    return places[order[np.isfinite(costs[order])]]


def refuse_unknown(results: Results, limits: Sequence[Limit], aims: Sequence[Aim], file: Path) -> None:
    """Refuse limits and aims of quantities that no case has.

    Raises
    ------
    InputError
        If there is one.
    """
    named = [(f"limits.{limit.quantity}", limit.quantity) for limit in limits] + [("aim", a.quantity) for a in aims]
    for place, quantity in named if results.kinds else []:
        if not results.has(quantity):
            remedy = f"no case has this quantity{suggest(key_of(quantity), list(results.kinds))}"
            raise InputError(file, place, quantity, remedy)

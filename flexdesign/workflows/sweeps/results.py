"""What was said of many cases, as columns: a hundred thousand of them are a handful of arrays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.model import Quantity

#: What one case was answered: its quantities, why there are none, and how long it took [s].
CaseResult = tuple[Sequence[Quantity], str, float]
Number = TypeVar("Number", float, Array)


def key_of(name: str) -> str:
    """Return the key of a quantity that limits and aims name by it, or by ``|key|`` for its size."""
    return name.strip("|")


def value_by_name(name: str, value: Number) -> Number:
    """Return a value of a quantity, or its size where ``|key|`` names it."""
    return abs(value) if name.startswith("|") else value


@dataclass(frozen=True, eq=False)
class Results:
    """Quantities of n cases.

    Parameters
    ----------
    kinds
        By key what a quantity is and is measured in; without a value.
    values, sigmas
        By key, n numbers [SI]; NaN where there is none.
    errors
        Why a case has no quantities; empty where it has.
    seconds
        How long each took.
    """

    kinds: Mapping[str, Quantity]
    values: Mapping[str, Array]
    sigmas: Mapping[str, Array]
    errors: Sequence[str]
    seconds: Array

    @classmethod
    def of(cls, cases: Sequence[CaseResult]) -> Results:
        """Return the answers to single cases as columns."""
        kinds: dict[str, Quantity] = {}
        rows: dict[str, list[tuple[int, float, float]]] = {}
        for place, (quantities, _, _) in enumerate(cases):
            for quantity in quantities:
                key = quantity.key
                if key not in kinds:
                    kinds[key], rows[key] = replace(quantity, value=math.nan, half_width=None), []
                rows[key].append(
                    (place, quantity.value, math.nan if quantity.half_width is None else quantity.half_width)
                )
        values = {key: np.full(len(cases), math.nan) for key in kinds}
        sigmas = {key: np.full(len(cases), math.nan) for key in kinds}
        for key, entries in rows.items():
            places, numbers, spreads = (np.array(part) for part in zip(*entries, strict=True))
            values[key][places], sigmas[key][places] = numbers, spreads
        errors, seconds = [error for _, error, _ in cases], np.array([duration for _, _, duration in cases])
        return cls(kinds, values, sigmas, errors, seconds)

    @classmethod
    def concatenate(cls, parts: Iterable[tuple[Results, NDArray[np.intp], NDArray[np.intp]]], count: int) -> Results:
        """Return rows of several answers in one: each part with its rows, and where they go among `count` cases."""
        kinds: dict[str, Quantity] = {}
        values, sigmas = dict[str, Array](), dict[str, Array]()
        errors, seconds = np.full(count, "", dtype=object), np.zeros(count)
        for part, rows, places in parts:
            for key, kind in part.kinds.items():
                if key not in kinds:
                    kinds[key] = kind
                    values[key], sigmas[key] = np.full(count, math.nan), np.full(count, math.nan)
                values[key][places], sigmas[key][places] = part.values[key][rows], part.sigmas[key][rows]
            errors[places], seconds[places] = np.array(part.errors, dtype=object)[rows], part.seconds[rows]
        return cls(kinds, values, sigmas, errors.tolist(), seconds)

    def __len__(self) -> int:
        return len(self.errors)

    def has(self, quantity: str) -> bool:
        """Tell whether any case has a quantity, by key or ``|key|``."""
        return key_of(quantity) in self.kinds

    def column(self, quantity: str) -> Array:
        """Return a quantity of all cases by key, or its size by ``|key|`` [SI]; NaN where there is none."""
        return value_by_name(quantity, self.values.get(key_of(quantity), np.full(len(self), math.nan)))

    def unit(self, quantity: str) -> str:
        """Return the unit in which people read a quantity."""
        return self.kinds[key_of(quantity)].unit or "1" if self.has(quantity) else "1"

    def in_unit(self, quantity: str) -> Array:
        """Return a quantity of all cases in its unit."""
        si = self.kinds[key_of(quantity)].si if self.has(quantity) else "1"
        return self.column(quantity) / units.factor(self.unit(quantity), si)

    def relative_errors(self, names: Sequence[str]) -> Array:
        """Return the largest estimated error of the named quantities of each case, relative; NaN without any."""
        worst = np.full(len(self), math.nan)
        for key, kind in self.kinds.items():
            if kind.name in names:
                value = np.where(self.values[key] == 0, math.nan, self.values[key])
                worst = np.fmax(worst, np.abs(self.sigmas[key] / value))
        return worst

    def at(self, place: int) -> list[Quantity]:
        """Return the quantities of one case."""
        found = []
        for key, kind in self.kinds.items():
            value, sigma = float(self.values[key][place]), float(self.sigmas[key][place])
            if not math.isnan(value):
                found.append(replace(kind, value=value, half_width=None if math.isnan(sigma) else sigma))
        return found

"""Which effects close the gap between a published number and ours.

Whoever published a number by a formula left something out. The compliance model of the design has each effect of the
drawing as a switch: without some of them it is off by a factor. The gap is closed by the fewest effects whose factor
takes our number to the published one, within what is known of both and of the model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from flexdesign.analytic import static_model
from flexdesign.analytic.static_model import Row, StaticModel, StaticTable
from flexdesign.analytic.static_model.uncertainty import MODEL
from flexdesign.core.errors import InputError
from flexdesign.design.design import Design
from flexdesign.workflows.published.folder import PublishedNumber

#: Effects tried together where a formula does not state what it omits; then all of them, and all but this number.
TOGETHER = 3
#: An effect that changes a number by less than this, relative, explains nothing in it.
SMALLEST = 1e-4


@dataclass(frozen=True)
class Closing:
    """The effects that close a gap.

    Parameters
    ----------
    effects
        Which the published number is without.
    remaining
        Published number over ours without them, less one.
    uncertainty
        Of `remaining`: that of both numbers, and two standard deviations of the compliance model.
    """

    effects: tuple[str, ...]
    remaining: float
    uncertainty: float


def model_of(design: Design) -> StaticModel | None:
    """Return the compliance model with all effects of the drawing; None where the design is no frame."""
    try:
        return static_model.of_design(design)
    except InputError:
        return None


def neglected_effects(model: StaticModel, number: PublishedNumber) -> dict[str, float]:
    """Return by how much each effect that a formula states to neglect changes our number, relative, and all of them.

    Parameters
    ----------
    model
        Of the design, with all effects of the drawing.
    number
        The published number.

    Returns
    -------
    dict
        The model without an effect over the model with it, less one; under ``""`` without all of them. Empty if the
        formula states nothing, or the model has no such quantity.
    """
    factor = _factors(model, number)
    there = [name for name in number.neglects if name in model.effects]
    if factor is None or not there:
        return {}
    alone = {name: factor([name]) - 1 for name in there}
    return {**{name: change for name, change in alone.items() if abs(change) >= SMALLEST}, "": factor(there) - 1}


def closing(model: StaticModel, number: PublishedNumber, ratio: float, allowed: float) -> Closing | None:
    """Return the fewest effects without which ours is the published number; None if there are none.

    Parameters
    ----------
    model
        Of the design, with all effects of the drawing.
    number
        The published number.
    ratio
        The published number over ours.
    allowed
        How far they may be apart, relative.
    """
    factor = _factors(model, number)
    if factor is None or ratio <= 0:
        return None
    there = [name for name in number.neglects or tuple(model.effects) if name in model.effects]
    named = [name for name in there if not abs(factor([name]) - 1) < SMALLEST]  # infinite without it: it counts
    known = allowed + 2 * MODEL[_row(number).kind]
    within = min(known, abs(ratio - 1))  # no effect closes a gap that it widens
    for trials in _by_size(named):
        remaining = {trial: ratio / factor(trial) - 1 for trial in trials}
        good = {trial: left for trial, left in remaining.items() if math.isfinite(left) and abs(left) <= within}
        if good:
            best = min(good, key=lambda trial: abs(good[trial]))
            return Closing(best, good[best], known)
    return None


def _row(number: PublishedNumber) -> Row:
    return Row(number.quantity, number.boundary, 1.0, None, "")


def _factors(model: StaticModel, number: PublishedNumber) -> Callable[[Sequence[str]], float] | None:
    """Return the model without some effects over the whole one, as a function; None if it lacks the quantity."""
    row = _row(number)
    if row.kind not in MODEL:
        return None
    table = StaticTable("", (row,))
    whole = float(model.predict(table)[0])

    def factor(without: Sequence[str]) -> float:
        kept = {name: values for name, values in model.effects.items() if name not in without}
        try:
            return float(replace(model, effects=kept).predict(table)[0]) / whole
        except InputError:
            return math.nan

    return factor


def _by_size(names: Sequence[str]) -> Iterator[list[tuple[str, ...]]]:
    """Yield sets of effects, those of one size at a time, few first; of many effects sets of a middle size are left."""
    for size in range(1, len(names) + 1):
        if size <= TOGETHER or size >= len(names) - 1:
            yield list(itertools.combinations(names, size))

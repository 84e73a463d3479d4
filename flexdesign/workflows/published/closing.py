"""Which effects close the gap between a published number and ours.

Whoever published a number by a formula left something out. The compliance model of the design has each effect of the
drawing as a switch: without some of them it is off by a factor. The gap is closed by the fewest effects whose factor
takes our number to the published one, within what is known of both and of the model.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
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
    """

    effects: tuple[str, ...]
    remaining: float


def model_of(design: Design) -> StaticModel | None:
    """Return the compliance model with all that the drawing tells; None where the design is no frame."""
    try:
        return static_model.of_design(design)
    except InputError:
        return None


def closing(model: StaticModel, number: PublishedNumber, ratio: float, allowed: float) -> Closing | None:
    """Return the fewest effects without which ours is the published number; None if there are none.

    Parameters
    ----------
    model
        Of the design, with all that the drawing tells.
    number
        The published number.
    ratio
        The published number over ours.
    allowed
        How far they may be apart, relative.
    """
    row = Row(number.quantity, number.boundary, 1.0, None, "")
    if row.kind not in MODEL or ratio <= 0:
        return None
    table = StaticTable("", (row,))
    whole = float(model.predict(table)[0])

    def factor(without: Sequence[str]) -> float:
        kept = {name: values for name, values in model.effects.items() if name not in without}
        try:
            return float(replace(model, effects=kept).predict(table)[0]) / whole
        except InputError:
            return math.nan

    there = [name for name in number.neglects or tuple(model.effects) if name in model.effects]
    named = [name for name in there if not abs(factor([name]) - 1) < SMALLEST]  # infinite without it: it counts
    within = min(allowed + 2 * MODEL[row.kind], abs(ratio - 1))  # no effect closes a gap that it widens
    for trials in _by_size(named):
        remaining = {trial: ratio / factor(trial) - 1 for trial in trials}
        good = {trial: left for trial, left in remaining.items() if math.isfinite(left) and abs(left) <= within}
        if good:
            best = min(good, key=lambda trial: abs(good[trial]))
            return Closing(best, good[best])
    return None


def _by_size(names: Sequence[str]) -> Iterator[list[tuple[str, ...]]]:
    """Yield sets of effects, those of one size at a time, few first; of many effects sets of a middle size are left."""
    for size in range(1, len(names) + 1):
        if size <= TOGETHER or size >= len(names) - 1:
            yield list(itertools.combinations(names, size))

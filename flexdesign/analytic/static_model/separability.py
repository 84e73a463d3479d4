"""Measurements that distinguish models of static tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexdesign.analytic.static_model.model import StaticModel
from flexdesign.analytic.static_model.uncertainty import UNSAID
from flexdesign.core.errors import InputError
from flexdesign.measurements.static_table import Row, StaticTable, measurable

#: By how much a dimension is changed to distinguish models.
CHANGED = (0.7, 1.4)


class Proposal(NamedTuple):
    """A measurement that would distinguish models, and the prediction of each, in the row's unit."""

    row: Row
    expected: tuple[float, ...]

    @property
    def apart(self) -> float:
        """How far the models are apart, relative; an amplification by less than `UNSAID` counts as `UNSAID`.

        Of a guide it is zero by symmetry, and such small motions next to that of the input cannot be measured.
        """
        least = UNSAID if self.row.quantity == "lambda" else 0.0
        return (max(self.expected) - min(self.expected)) / max(abs(float(np.mean(self.expected))), least)


def proposals(models: Sequence[StaticModel], table: StaticTable, most: int = 3) -> tuple[Proposal, ...]:
    """Return measurements that no table holds yet on which models of a design differ, the best first.

    They are of the part itself, and of parts with one dimension changed. A difference smaller than the uncertainty that
    is taken for a measurement distinguishes nothing.
    """
    design = models[0].design
    done = {(row.key, row.part) for row in table.rows}
    lengths = {p.name for p in design.part_class.dimensions if p.si == "m"}
    variants: list[dict[str, float]] = [{}]
    for name, nominal in design.dimensions.items():
        variants += [{name: float(f"{by * nominal:.3g}")} for by in CHANGED if nominal > 0 and name in lengths]
    found = []
    for dimensions in variants:
        asked = [Row(quantity, boundary, 1.0, None, "", dimensions) for quantity, boundary in measurable(design)]
        rows = tuple(row for row in asked if (row.key, row.part) not in done)
        try:
            expected = np.array([model.predict(StaticTable("", rows)) for model in models])
        except InputError:  # cannot be built
            continue
        finite = zip(rows, expected.T, np.isfinite(expected).all(axis=0), strict=True)
        found += [Proposal(row, tuple(map(float, column))) for row, column, is_finite in finite if is_finite]
    found.sort(key=lambda offer: (-round(offer.apart, 2), len(offer.row.dimensions)))
    return tuple(offer for offer in found[:most] if offer.apart > UNSAID)

"""A design's compliance model compared with a static table: errors, and whether they are significant."""

from __future__ import annotations

import itertools
import math
import operator
from dataclasses import dataclass, replace

import numpy as np

from flexdesign.analytic.static_model import Row, StaticModel, StaticTable, Uncertainty, uncertainty
from flexdesign.analytic.static_model.uncertainty import UNSAID
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.estimation.criterion import LARGE
from flexdesign.measurements.recordings.unit_check import TOLERANCE
from flexdesign.measurements.static_table import DISPLACEMENTS, LOADS

#: In which rows of a column signs are tried: in all, and in those of one sign.
SIGNS = {"": operator.ne, " below zero": operator.lt, " above zero": operator.gt}


@dataclass(frozen=True, eq=False)
class TableComparison:
    """A model compared with a table.

    Parameters
    ----------
    model, table
        What was compared.
    predicted
        What the model says of each row, SI.
    uncertainty
        How far it may be off although nothing is missing.
    remarks
        What was done to the table, or makes it say less.
    """

    model: StaticModel
    table: StaticTable
    predicted: Array
    uncertainty: Uncertainty
    remarks: tuple[str, ...] = ()

    @property
    def errors(self) -> Array:
        """Predicted over measured, less one."""
        return np.asarray(self.predicted / self.table.measured() - 1)

    @property
    def significance(self) -> Array:
        """Size of each difference over the validation uncertainty: above one it says that the model is wrong there."""
        return np.asarray(np.abs(self.predicted - self.table.measured()) / self.uncertainty.validation)

    @property
    def agrees(self) -> bool:
        """Whether chance makes such differences, each by itself and all together; then nothing is missing."""
        return self.uncertainty.agrees(self.predicted - self.table.measured())


def compare(model: StaticModel, table: StaticTable) -> TableComparison:
    """Compare a model with a table.

    Raises
    ------
    InputError
        If the model has no number for a row, or a row seems to have another unit.
    """
    signed, turned = restore_signs(model, table)
    predicted, remarks = model.predict(signed), [*turned]
    plausible = _believable(signed, predicted)
    noise = uncertainty(model, plausible)
    if plausible is not signed:
        remarks.append("amplifications were taken with the sign of the model, along the output's normal")
    if noise.unsaid:
        remarks.append(f"some rows state no sigma: {100 * UNSAID:g} % was taken for it")
    if noise.unstated:
        some, widest = ", ".join(noise.unstated[:2]), 100 * float(np.max(noise.model / np.abs(plausible.measured())))
        remarks.append(
            f"the part does not state what all its hinges and rods run into (Member.roots, as of {some}): the model "
            f"may be off by {widest:.2g} %, one standard deviation, and this table determines little"
        )
    return TableComparison(model, plausible, predicted, noise, tuple(remarks))


def _believable(table: StaticTable, predicted: Array) -> StaticTable:
    """Return a table whose values can be meant: amplifications with the model's sign."""
    rows = []
    for row, expected in zip(table.rows, predicted, strict=True):
        if row.load is None and math.isfinite(expected):
            times = abs(row.value / float(expected)) if expected else math.inf
            if not times or abs(math.log10(times)) > 3 - TOLERANCE:
                remedy = f"is {float(f'{times:.2g}'):g} times what the model expects: correct the unit ({row.unit})"
                raise InputError(table.name, row.key, f"{row.value:.4g} (SI)", remedy)
        opposite = row.quantity == "lambda" and np.sign(row.value) * np.sign(expected) < 0
        rows.append(replace(row, value=-row.value) if opposite else row)
    return table if tuple(rows) == table.rows else replace(table, rows=tuple(rows))


# --- lost signs ------------------------------------------------------------------------------------------------------


def restore_signs(model: StaticModel, table: StaticTable) -> tuple[StaticTable, tuple[str, ...]]:
    """Return a table with the signs that its model expects, and a remark for each that was turned.

    A moment that is entered without its sign, or an axis that points the other way, looks like a wrong model. Each
    column of loads is tried with its sign turned, in all rows and in those of one sign, and each measured quantity; the
    one that lowers the error most is taken, and the others are tried again.
    """
    remarks: list[str] = []
    columns = [*itertools.product(LOADS, SIGNS), *((quantity, "") for quantity in DISPLACEMENTS)]
    while True:
        errors, trials = _errors(model, table), []
        for column, way in columns:
            turned = replace(table, rows=tuple(_turned(row, column, way) for row in table.rows))
            concerned = [a is not b for a, b in zip(turned.rows, table.rows, strict=True)]
            if errors[concerned].any():
                left = np.linalg.norm(_errors(model, turned)[concerned]) / np.linalg.norm(errors[concerned])
                rows = f"rows with {column}{way} agree better with the model if {column} has the other sign"
                trials.append((float(left), turned, f"{rows}: it was taken so"))
        share, turned, remark = min(trials, key=lambda trial: trial[0], default=(1.0, table, ""))
        if LARGE * share >= 1 or remark in remarks:
            return table, tuple(remarks)
        table = turned
        remarks.append(remark)


def _turned(row: Row, column: str, way: str) -> Row:
    """Return a row with the other sign in a column, or as it is if it does not concern it."""
    if column in DISPLACEMENTS:
        return replace(row, value=-row.value) if row.quantity == column else row
    place = list(LOADS).index(column)
    if row.load is None or not SIGNS[way](row.load[place], 0):
        return row
    return replace(row, load=tuple(-f if i == place else f for i, f in enumerate(row.load)))


def _errors(model: StaticModel, table: StaticTable) -> Array:
    return np.asarray(model.predict(table) / table.measured() - 1)

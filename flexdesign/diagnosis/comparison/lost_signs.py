"""Signs that a table of displacements under load has lost: a column with which the model agrees once it is turned.

A moment that is entered without its sign, or an axis that points the other way, looks like a wrong model. Each column
of loads is tried with its sign turned, in all rows and in those of one sign, and each measured quantity in all rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexdesign.analytic.static_model import Row, StaticModel, StaticTable
from flexdesign.measurements.static_table import DISPLACEMENTS, LOADS

Array = NDArray[np.float64]
#: A sign counts as lost where the model's error in the rows that it concerns falls below this share.
LOST_SIGN_SHARE = 0.5


def restore_signs(model: StaticModel, table: StaticTable) -> tuple[StaticTable, tuple[str, ...]]:
    """Return a table with the signs that its model expects, and a remark for each that was turned."""
    remarks: list[str] = []
    while found := _best(model, table):
        turned, notes = found
        if notes in remarks:
            break
        table = turned
        remarks.append(notes)
    return table, tuple(remarks)


def _best(model: StaticModel, table: StaticTable) -> tuple[StaticTable, str] | None:
    """Return the table with one column turned that lowers the error most, and the remark; None if none is lost."""
    before, trials = model.predict(table), []
    for remarks, turn in _turns():
        turned = replace(table, rows=tuple(turn(row) for row in table.rows))
        concerned = np.array([a is not b for a, b in zip(turned.rows, table.rows, strict=True)])
        if concerned.any():
            was = _error(before[concerned], table.measured()[concerned])
            left = _error(model.predict(turned)[concerned], turned.measured()[concerned])
            if left < LOST_SIGN_SHARE * was:
                trials.append((left / was, turned, f"{remarks}: it was taken so"))
    if not trials:
        return None
    _, turned, remarks = min(trials, key=lambda trial: trial[0])
    return turned, remarks


def _error(predicted: Array, measured: Array) -> float:
    return float(np.sqrt(np.mean(((predicted - measured) / measured) ** 2)))


def _turns() -> Iterator[tuple[str, Callable[[Row], Row]]]:
    """Yield every column that may have lost its sign: what is said of it, and what turns a row."""
    for place, column in enumerate(LOADS):
        for way, where in ((0, ""), (-1, " below zero"), (1, " above zero")):

            def turn(row: Row, place: int = place, way: int = way) -> Row:
                if row.load is None or row.load[place] == 0 or way * row.load[place] < 0:
                    return row
                return replace(row, load=tuple(-f if i == place else f for i, f in enumerate(row.load)))

            yield f"rows with {column}{where} agree better with the model if {column} has the other sign", turn
    for quantity in DISPLACEMENTS:

        def turn_value(row: Row, quantity: str = quantity) -> Row:
            return replace(row, value=-row.value) if row.quantity == quantity else row

        yield f"{quantity} agrees better with the model if it has the other sign", turn_value

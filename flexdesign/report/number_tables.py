"""Fitted numbers with their intervals: tables of a report, and what result.json holds of them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from flexdesign import units
from flexdesign.diagnosis import Value
from flexdesign.report import diagnosis_words as said
from flexdesign.report.document import Table
from flexdesign.stage_model import AxisModel


def values_table(values: Sequence[Value]) -> Table:
    """Return fitted numbers with their intervals and what they mean."""
    rows = []
    for value in values:
        estimate = said.estimated(value)
        name = value.parameter.name.rpartition(".")[2]
        rows.append([name, value.parameter.meaning, estimate.value_text, estimate.interval_text])
    return Table(["number", "what it is", "value", "95 % interval"], rows)


def value_json(value: Value) -> dict[str, Any]:
    """Return a fitted number with its unit and its 95 % interval."""
    low, high = (end if math.isfinite(end) else None for end in value.interval)
    name = value.parameter.name.rpartition(".")[2]
    return {
        "name": name,
        "number": value.parameter.name,
        "value": value.value if math.isfinite(value.value) else None,
        "unit": value.parameter.si,
        "interval": [low, high],
        "text": said.quantity(value, short=True),
    }


def by_run_table(by_run: Mapping[str, Value]) -> list[Table]:
    """Return the values of a number that differs from run to run; no table where none does."""
    estimates = {run: said.estimated(value) for run, value in by_run.items()}
    rows = [[run, each.value_text, each.interval_text] for run, each in estimates.items()]
    names = dict.fromkeys(value.parameter.name.rpartition(".")[2] for value in by_run.values())
    return [Table(["run", name, "95 % interval"], rows, f"The {name} differs from run to run") for name in names]


def by_run_json(by_run: Mapping[str, Value]) -> dict[str, Any]:
    """Return the values of a number that differs from run to run, by run."""
    return {run: value_json(value) for run, value in by_run.items()}


def numbers_table(axis: AxisModel, calibration: Sequence[Value]) -> Table:
    """Return the model's own numbers, before and after."""
    before = axis.numbers
    rows = []
    for value in calibration:
        p, estimate = value.parameter, said.estimated(value)
        old = before.get(p.name)
        was = "–" if old is None else units.to_text(old, p.unit, si=p.si)
        change = f"{100 * (value.value / old - 1):+.2g} %" if old else "–"
        rows.append([p.name, was, estimate.value_text, estimate.interval_text, change])
    return Table(["number", "before", "fitted", "95 % interval", "change"], rows)

"""Runs made of the variables of a file, as a map says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexdesign import columns
from flexdesign.errors import InputError
from flexdesign.importing.contents import Array, Contents, Variable
from flexdesign.importing.mapping import ColumnTable, Map, RunMap, check_unit

#: Times from a rate that differ by less than this, relative, are one.
ALIKE = 1e-9


@dataclass(frozen=True, eq=False)
class Recording:
    """One run, not yet written.

    Parameters
    ----------
    name
        The stem of its file.
    number
        Which run of the map it comes from, counted from zero.
    time
        n moments [s].
    recorded
        n values of each column, by header cell, in SI.
    """

    name: str
    number: int
    time: Array
    recorded: Mapping[str, Array]


def assemble(contents: Contents, plan: Map) -> list[Recording]:
    """Return all runs of a map, each realisation a run of its own.

    Raises
    ------
    InputError
        If a variable is not there, the axes of an array are not told or not as told, a unit or the time is missing, or
        columns of one run differ in length.
    """
    made = []
    for number, (run, tables) in enumerate(plan.runs):
        place = f"run {number + 1}"
        cells, parts, steps = {}, {}, {}
        for name, table in tables.items():
            field = f"{place}.columns.{name}"
            variable = contents.find(table.variable, plan.path, f"{field}.variable")
            unit = table.unit or variable.unit
            if not unit:
                example = f'write unit = "{"um" if name in "xyz" else "V" if name[0] in "uv" else "s"}"'
                raise InputError(
                    plan.path, f"{field}.unit", None, f"is missing, and the file does not say it; {example}"
                )
            si = check_unit(name, unit, plan.path, f"{field}.unit")
            values = _parted(variable, table, run, plan, field)
            parts[name] = columns.in_si(table.scale * values + table.offset, unit, si)
            cells[name] = f"{name} [{unit}]"
            if variable.step:
                steps[name] = variable.step
        made += _recordings(contents, plan, number, parts, cells, steps)
    return made


def _parted(variable: Variable, table: ColumnTable, run: RunMap, plan: Map, field: str) -> Array:
    """Return the numbers as realisations by samples, periods one after the other."""
    values = variable.values()
    size = " x ".join(map(str, variable.shape))
    if max(values.shape, default=0) == values.size:  # a row or a column, whatever the axes of others are
        if table.channel not in (None, 1):
            remedy = f"the variable has one channel, its size is {size}; remove this line"
            raise InputError(plan.path, f"{field}.channel", table.channel, remedy)
        return values.reshape(1, -1)
    axes = run.axes or ()
    if len(axes) != values.ndim:
        remedy = f"the variable is {size}; say what its axes are: axes = [" + '"sample", "channel"]'
        raise InputError(plan.path, "axes", list(axes) or None, f"{remedy} (or realisation, period)")
    # Channel, realisation, period, sample, each there.
    order = [axes.index(axis) for axis in ("channel", "realisation", "period", "sample") if axis in axes]
    values = values.transpose(order)
    for place, axis in enumerate(("channel", "realisation", "period")):
        if axis not in axes:
            values = np.expand_dims(values, place)
    channels = len(values)
    if table.channel is None and channels > 1:
        remedy = f"is missing; the variable has {channels} channels: write channel = 1"
        raise InputError(plan.path, f"{field}.channel", None, remedy)
    if table.channel is not None and table.channel > channels:
        remedy = f"the variable has {channels} channels, counted from 1"
        raise InputError(plan.path, f"{field}.channel", table.channel, remedy)
    return values[(table.channel or 1) - 1].reshape(values.shape[1], -1)


def _recordings(
    contents: Contents,
    plan: Map,
    number: int,
    parts: Mapping[str, Array],
    cells: Mapping[str, str],
    steps: Mapping[str, float],
) -> list[Recording]:
    run, place = plan.runs[number][0], f"run {number + 1}"
    lengths = {name: values.shape[1] for name, values in parts.items()}
    count = max(len(values) for values in parts.values())
    if len(set(lengths.values())) > 1 or any(len(values) not in (1, count) for values in parts.values()):
        sizes = ", ".join(f"{name} {len(v)} x {v.shape[1]}" for name, v in parts.items())
        remedy = f"differ in realisations x samples ({sizes}); take variables that were recorded together"
        raise InputError(plan.path, f"{place}.columns", None, remedy)
    name, made = run.name or contents.paths[0].stem, []
    for k in range(count):
        recorded = {cells[c]: values[k if len(values) > 1 else 0] for c, values in parts.items() if c != "t"}
        if "t" in parts:
            time = parts["t"][k if len(parts["t"]) > 1 else 0]
        else:
            time = _period(run, plan, place, steps) * np.arange(next(iter(lengths.values())))
        made.append(Recording(name if count == 1 else f"{name}_{k + 1}", number, time, recorded))
    return made


def _period(run: RunMap, plan: Map, place: str, steps: Mapping[str, float]) -> float:
    if run.rate:
        return float(1 / run.rate)
    stated = list(steps.values())
    if not stated:
        remedy = 'is missing, and the file does not say it; write rate = "1 kHz", or map a column t'
        raise InputError(plan.path, f"{place}.rate", None, remedy)
    if max(stated) - min(stated) > ALIKE * max(stated):
        said = ", ".join(f"{name} {1 / step:.6g} Hz" for name, step in steps.items())
        remedy = f"the columns were sampled at different rates ({said}); make runs of columns of one rate"
        raise InputError(plan.path, f"{place}.columns", None, remedy)
    return stated[0]

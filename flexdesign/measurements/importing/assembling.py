"""Runs made of the variables of a file, as a map says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import unit_tables, units
from flexdesign.core.arithmetic import Formula
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, suggest
from flexdesign.measurements.importing.contents import Contents, Numbers, Variable
from flexdesign.measurements.importing.mapping import RESPONSE, Map, RunColumns, RunMap, VariableTable
from flexdesign.measurements.recordings import COMMANDS, FEWEST
from flexdesign.measurements.recordings.frequency_response import FREQUENCY
from flexdesign.measurements.recordings.gap_filling import recordings_apart

#: Times from a rate that differ by less than this, relative, are one.
SAME_PERIOD = 1e-9
#: Precision of files, relative; a time is to be right within this part of a period.
WRITTEN, FINE = 1e-12, 1e-4
#: Axes of an array of which a map chooses one number, and those along which there are realisations and samples.
CHOSEN, ALONG = ("channel", "input"), ("realisation", "period", "sample", "frequency")


@dataclass(frozen=True, eq=False)
class Recording:
    """One run or frequency response, not yet written.

    Parameters
    ----------
    name
        The stem of its file.
    number
        Which run of the map it comes from, counted from zero.
    recorded
        n values of each column, by header cell, in SI.
    time
        n moments [s]; None of a frequency response.
    remarks
        What was left out.
    sources
        The variable that each column comes from, the first one of a formula, by the column's name: its own name and it.
    samples
        Which of its numbers are in the recording, counted from zero; None of all.
    """

    name: str
    number: int
    recorded: Mapping[str, Array]
    time: Array | None = None
    remarks: tuple[str, ...] = ()
    sources: Mapping[str, tuple[str, Variable]] = field(default_factory=dict)
    samples: NDArray[np.intp] | None = None


def assemble(contents: Contents, plan: Map, numbers: Sequence[int] | None = None) -> list[Recording]:
    """Return the runs of a map, all or those of some numbers, each realisation a run of its own.

    Raises
    ------
    InputError
        If a variable is not there, the axes of an array are not stated or wrong, a unit or the time is missing,
        units of a formula do not go together, or columns of one run differ in length.
    """
    chosen = range(len(plan.runs)) if numbers is None else numbers
    made = [recording for number in chosen for recording in _Maker(contents, plan, number).make()]
    return [replace(made[0], remarks=(*contents.remarks, *made[0].remarks)), *made[1:]] if made else made


@dataclass(frozen=True)
class _Part:
    """A column: realisations by samples in SI, and the time between samples of what it is made of, by name."""

    values: Numbers
    unit: str
    steps: Mapping[str, float]


@dataclass(frozen=True)
class _Maker:
    contents: Contents
    plan: Map
    number: int

    @property
    def run(self) -> RunMap:
        return self.plan.runs[self.number][0]

    @property
    def columns(self) -> RunColumns:
        return self.plan.runs[self.number][1]

    @property
    def place(self) -> str:
        return f"run {self.number + 1}"

    def refused(self, field: str, value: object, remedy: str) -> InputError:
        return InputError(self.plan.path, field, value, remedy)

    def make(self) -> list[Recording]:
        """Return the recordings of this run of the map."""
        parts = {name: self._part(name) for name in self.columns.tables}
        sizes = {name: part.values.shape for name, part in parts.items()}
        count, length = max(rows for rows, _ in sizes.values()), next(iter(sizes.values()))[1]
        if any(rows not in (1, count) or n != length for rows, n in sizes.values()):
            remark = ", ".join(f"{name} {rows} x {n}" for name, (rows, n) in sizes.items())
            of_data = {n for name, (_, n) in sizes.items() if name != "t"}
            what = "take variables that were recorded together"
            if len(of_data) == 1 and "t" in sizes:
                what = 'if the clock is even, leave column t out and write its rate = "1 kHz" instead'
            remedy = f"differ in realisations x samples ({remark}); {what}"
            raise self.refused(f"{self.place}.columns", None, remedy)
        name = self.run.name or self.contents.paths[0].stem
        made = []
        for k in range(count):
            rows = {column: part.values[k if len(part.values) > 1 else 0] for column, part in parts.items()}
            called = name if count == 1 else f"{name}_{k + 1}"
            if self.columns.is_response:
                made.append(self._response(called, rows, parts))
            else:
                time = rows.pop("t") if "t" in rows else self._period(parts) * np.arange(length)
                cells = {f"{column} [{parts[column].unit}]": np.real(values) for column, values in rows.items()}
                commands = [np.real(values) for column, values in rows.items() if column in COMMANDS]
                whole = Recording(called, self.number, cells, np.real(time), sources=self._sources())
                made += _in_time(whole, commands)
        return made

    def _sources(self) -> dict[str, tuple[str, Variable]]:
        """Return name and variable that each column comes from, where it comes from one."""
        found = {}
        for column, table in self.columns.tables.items():
            formula = self.columns.formulas.get(column)
            for each in formula.names if formula else (table.variable,):
                told = self.plan.variables.get(each) if formula else None
                name = told.variable if told else each
                if name in self.contents.variables and column not in found:
                    found[column] = (name, self.contents.variables[name])
        return found

    def _part(self, name: str) -> _Part:
        table, field = self.columns.tables[name], f"{self.place}.columns.{name}"
        if formula := self.columns.formulas.get(name):
            part = self._compute(name, formula, field)
        else:
            values, unit, steps = self._variable(name, table, field)
            si = self.columns.si_of(name, unit, self.plan.path, f"{field}.unit")
            part = _Part(unit_tables.in_si(values, unit, si), unit, steps)
        if name == RESPONSE or not np.iscomplexobj(part.values):
            return part
        if np.any(part.values.imag != 0):
            remedy = 'holds complex numbers; map it as response, or write formula = "real(NAME)", imag, abs or angle'
            raise self.refused(field, table.formula or table.variable, remedy)
        return _Part(part.values.real, part.unit, part.steps)

    def _variable(self, name: str, table: VariableTable, field: str) -> tuple[Any, str, dict[str, float]]:
        """Return the numbers of a variable in its unit, that unit, and its step."""
        variable = self.contents.find(table.variable, self.plan.path, f"{field}.variable")
        unit = table.unit or variable.unit
        if not unit:
            default_units = {"t": "s", "f": "Hz", "response": "um/V", "magnitude": "um/V", "re": "um/V", "im": "um/V"}
            default_units |= {"phase": "deg", "coherence": "1"} if self.columns.is_response else {}
            example = default_units.get(name) or ("um" if name in "xyz" else "V")
            remedy = f'is missing, and the file does not say it; write unit = "{example}"'
            raise self.refused(f"{field}.unit", None, remedy)
        values = table.scale * _split_periods(variable.values(), table, self, field) + table.offset
        return values, unit, {name: variable.step} if variable.step else {}

    def _compute(self, name: str, formula: Formula, field: str) -> _Part:
        """Return what a formula gives."""
        import pint

        unit, place = self.columns.tables[name].unit, f"{field}.formula"
        si = self.columns.si_of(name, unit, self.plan.path, f"{field}.unit")
        known: dict[str, Any] = {}
        steps: dict[str, float] = {}
        for each in formula.names:
            known[each], step = self._operand(each, formula, place)
            steps |= step
        try:
            result = formula.evaluate(known)
        except ValueError as error:
            raise self.refused(place, formula.text, str(error)) from None
        try:
            found = result.to(si).magnitude
        except pint.DimensionalityError:
            remedy = f"has the unit {result.units:~C}" if f"{result.units:~C}" else "is a pure number"
            raise self.refused(place, formula.text, f"{remedy}; a column {name} is written in {unit} here") from None
        if np.ndim(found) < 2:
            raise self.refused(place, formula.text, "has no variable of the file in it, and gives one number")
        if np.isinf(found).any():
            sample = int(np.argwhere(np.isinf(found))[0, 1])
            remedy = f"is infinite at sample {sample + 1}; does it divide by zero?"
            raise self.refused(place, formula.text, remedy)
        return _Part(found, unit, steps)

    def _operand(self, name: str, formula: Formula, place: str) -> tuple[Any, dict[str, float]]:
        """Return the meaning of a name in a formula, and the step of its samples."""
        plan = self.plan
        if name in plan.constants:
            return plan.constants[name], {}
        is_told, variables = name in plan.variables, self.contents.variables
        if not is_told and name not in variables:
            known = [*plan.constants, *plan.variables, *(each for each in variables if each.isidentifier())]
            remedy = f"{name} is no variable of the files, nor in [variables] or [constants]{suggest(name, known)}"
            raise self.refused(place, formula.text, remedy)
        field = f"variables.{name}"
        table = plan.variables[name] if is_told else VariableTable(variable=name)
        if not table.unit and not self.contents.find(table.variable, plan.path, f"{field}.variable").unit:
            if not name.isidentifier():
                remedy = f'{name} has no unit in the file; write [variables.NAME] with variable = "{name}" and its unit'
                raise self.refused(place, formula.text, f"{remedy}, and NAME in the formula")
            remedy = 'is missing, and the file does not say it; write unit = "V", or "1" for a pure number'
            raise self.refused(f"{field}.unit", None, remedy)
        values, unit, steps = self._variable(name, table, field)
        if unit in unit_tables.KELVIN:
            return units.quantity(unit_tables.in_si(values, unit, "K"), "K"), steps
        try:
            return units.quantity(values, unit), steps
        except ValueError as error:
            raise self.refused(f"{field}.unit", unit, str(error)) from None

    def _response(self, name: str, rows: dict[str, Numbers], parts: Mapping[str, _Part]) -> Recording:
        """Return a frequency response, a complex one as magnitude and phase; without its line at zero frequency."""
        recorded: dict[str, Array] = {f"{FREQUENCY} [{parts[FREQUENCY].unit}]": np.real(rows.pop(FREQUENCY))}
        if RESPONSE in rows:
            values = rows.pop(RESPONSE)
            recorded[f"magnitude [{parts[RESPONSE].unit}]"] = np.abs(values)
            recorded["phase [deg]"] = np.angle(values)
        recorded |= {f"{column} [{parts[column].unit}]": np.real(values) for column, values in rows.items()}
        valid = next(iter(recorded.values())) != 0
        left = "" if valid.all() else "the line at 0 Hz is left out"
        lines = {cell: values[valid] for cell, values in recorded.items()}
        remarks = (left,) if left else ()
        return Recording(name, self.number, lines, None, remarks, self._sources(), np.flatnonzero(valid))

    def _period(self, parts: Mapping[str, _Part]) -> float:
        if self.run.rate:
            return float(1 / self.run.rate)
        steps = {name: step for part in parts.values() for name, step in part.steps.items()}
        if not steps:
            remedy = 'is missing, and the file does not say it; write rate = "1 kHz", or map a column t'
            raise self.refused(f"{self.place}.rate", None, remedy)
        stated = list(steps.values())
        if max(stated) - min(stated) > SAME_PERIOD * max(stated):
            remark = ", ".join(f"{name} {1 / step:.6g} Hz" for name, step in steps.items())
            remedy = f"the columns were sampled at different rates ({remark}); make runs of columns of one rate"
            raise self.refused(f"{self.place}.columns", None, remedy)
        return stated[0]


def _in_time(recording: Recording, commands: Sequence[Array]) -> list[Recording]:
    """Return a run in time; or several, if it has gaps in which a command may have done anything."""
    time = recording.time
    assert time is not None
    every = recordings_apart(time, commands)
    rows = [each for each in every if each.stop - each.start >= FEWEST] if len(every) > 1 else every
    if len(every) == 1 or not rows:
        return [_from_first_sample(recording)]
    parts = []
    for number, each in enumerate(rows, start=1):
        cells = {cell: values[each] for cell, values in recording.recorded.items()}
        samples = np.arange(each.start, each.stop)
        name = f"{recording.name}_{number:0{len(str(len(rows)))}d}"  # names sort as the parts were recorded
        part = replace(recording, name=name, recorded=cells, time=time[each], samples=samples)
        parts.append(_from_first_sample(part))
    said = f"{recording.name} has gaps in which its command is unknown: {len(rows)} recordings"
    short = len(every) - len(rows)
    said += f"; {short} of fewer than {FEWEST} samples left out" if short else ""
    return [replace(parts[0], remarks=(*parts[0].remarks, said)), *parts[1:]]


def _from_first_sample(recording: Recording) -> Recording:
    """Return a run; where its clock began long before, time counts from the first sample: no digit is lost."""
    time = recording.time
    assert time is not None
    start, period = float(time[0]), float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    if not (np.isfinite(start) and abs(start) * WRITTEN > FINE * period > 0):
        return recording
    return replace(recording, time=time - start, remarks=(f"time counts from the first sample, at {start:.12g} s",))


def _split_periods(values: Numbers, table: VariableTable, maker: _Maker, field: str) -> Numbers:
    """Return the numbers as realisations by samples, periods one after the other."""
    size = " x ".join(map(str, values.shape))
    asked = {"channel": table.channel, "input": table.input}
    if max(values.shape, default=0) == values.size or values.size == 1:  # a row or a column, whatever the axes are
        for name, number in asked.items():
            if number not in (None, 1):
                remedy = f"the variable has one {name}, its size is {size}; remove this line"
                raise maker.refused(f"{field}.{name}", number, remedy)
        return values.reshape(1, -1)
    axes = maker.run.axes or ()
    if len(axes) != values.ndim:
        example = '["frequency", "channel"] (or input' if maker.columns.is_response else '["sample", "channel"] (or'
        remedy = f"the variable is {size}; say what its axes are: axes = {example}"
        rest = ", realisation)" if maker.columns.is_response else " realisation, period)"
        raise maker.refused("axes", list(axes) or None, remedy + rest)
    values = values.transpose([axes.index(axis) for axis in (*CHOSEN, *ALONG) if axis in axes])
    for axis in CHOSEN:
        number, there = asked[axis], len(values) if axis in axes else 1
        if number is None and there > 1:
            raise maker.refused(
                f"{field}.{axis}", None, f"is missing; the variable has {there} {axis}s: write {axis} = 1"
            )
        if number is not None and number > there:
            raise maker.refused(f"{field}.{axis}", number, f"the variable has {there} {axis}s, counted from 1")
        values = values[(number or 1) - 1] if axis in axes else values
    realisations = len(values) if "realisation" in axes else 1
    return values.reshape(realisations, -1)

"""How comparisons and diagnoses of static tables are put into words and drawings."""

from __future__ import annotations

import math

import numpy as np

from flexdesign.analytic.static_model import Row
from flexdesign.analytic.static_model.separability import Proposal
from flexdesign.core import units
from flexdesign.core.errors import join_names
from flexdesign.core.model import PIEZO
from flexdesign.diagnosis import Value
from flexdesign.diagnosis.comparison.static_table import TableComparison
from flexdesign.diagnosis.static_tables.diagnose import TableDiagnosis
from flexdesign.diagnosis.static_tables.fit import Trial
from flexdesign.effects import statics
from flexdesign.measurements.static_table import DISPLACEMENTS, LOADS, QUANTITIES
from flexdesign.report import charts


def effect_name(name: str) -> str:
    """Return what an effect is called in a sentence.

    >>> effect_name("over_cut")
    'over cut'
    """
    return statics.find(name).name.replace("_", " ")


def measurement(row: Row) -> str:
    """Return what a row measures: ``K_out, input held, hinge_thickness 0.3 mm``."""
    text = ", ".join(
        f"{name} {value:.4g}" if name in row.numbers else f"{name} {1e3 * value:.4g} mm"
        for name, value in row.dimensions.items()
    )
    load = zip(LOADS.items(), row.load or (0.0, 0.0, 0.0), strict=True)
    pushed = [f"{name} {units.to_text(f, si, 4, si=si)}" for (name, si), f in load if f]
    return ", ".join([row.quantity, *(pushed or [row.boundary]), *([text] if text else [])])


def number(row: Row, value: float, digits: int = 4) -> str:
    """Return a number of a row, SI, in the row's unit."""
    si = (DISPLACEMENTS[row.quantity] if row.load else QUANTITIES[row.quantity])[0]
    unit = row.unit or {"N/m": "N/mm", "1": "", "m": "mm", "rad": "mrad"}[si]
    text = units.significant(value / units.factor(unit or "1", si), digits)
    return f"{text} {'' if unit == '1' else unit}".rstrip()


def percentage(share: float) -> str:
    """Return a percentage without sign."""
    return f"{100 * share:.2g} %"


def percent(share: float) -> str:
    """Return a signed percentage."""
    return f"{100 * share:+.1f} %"


def quantity(value: Value) -> str:
    """Return a fitted number with its 95 % interval, in the parameter's unit."""
    parameter = value.parameter
    scale = units.factor(parameter.unit or "1", parameter.si)
    name = parameter.name.rpartition(".")[2]
    low, high = (end / scale for end in value.interval)
    if _is_without_end(value):
        return f"{name} indistinguishable from a rigid one" if parameter.null == 0 else f"{name} next to nothing"
    text = units.significant(value.value / scale, 3)
    return f"{name} {text} {parameter.unit} (95 %: {low:.3g} to {high:.3g} {parameter.unit})"


def _is_without_end(value: Value) -> bool:
    """Tell whether a strength of many decades went to the end of its range."""
    low, high = value.parameter.plausible
    ends = [end for end in (low, high) if math.isfinite(end)]
    return value.parameter.scale != "linear" and any(math.isclose(value.value, end, rel_tol=0.05) for end in ends)


def verdict(diagnosis: TableDiagnosis) -> str:
    """Return the verdict in a sentence or two."""
    before, after = diagnosis.error_ladder[0].error, diagnosis.error_ladder[-1].error
    if diagnosis.asked:
        with_it = diagnosis.error_ladder[1].error
        return (
            f"With {names(diagnosis.found)} the model misses the table by {percentage(with_it)} rms, without by "
            f"{percentage(before)}."
        )
    if diagnosis.verdict == "nothing-missing":
        return (
            f"Nothing is missing. The design's model misses the table by {percentage(before)} rms, no more than "
            "measurement, tolerances and the model's own accuracy allow."
        )
    if diagnosis.verdict == "unknown":
        near = f" Nearest, without explaining enough: {names(diagnosis.found)}." if diagnosis.found.names else ""
        return f"Something is missing, and it is none of the effects that are known here.{near}"
    them = "them" if len(diagnosis.found.names) > 1 else "it"
    return (
        f"Missing: {join_names([_alternatives(diagnosis, name) for name in diagnosis.found.names])}. "
        f"With {them} the model misses "
        f"rows left out of the fit by {percentage(after)} rms, without by {percentage(before)}."
    )


def _alternatives(diagnosis: TableDiagnosis, name: str) -> str:
    group = next((group for group in diagnosis.groups if group[0] == name), (name,))
    return join_names([effect_name(other) for other in group], "or")


def names(trial: Trial, between: str = " and ") -> str:
    """Return the effects of a trial, with the first of the members of which one is changed."""
    first = {name: [member.name for member in trial.members(name)[:1]] for name in trial.names}
    return between.join(effect_name(name) + "".join(f" ({member})" for member in first[name]) for name in trial.names)


def summary(diagnosis: TableDiagnosis) -> list[str]:
    """Return the answer in a few paragraphs."""
    sentences = [verdict(diagnosis)]
    if diagnosis.verdict == "effects-found":
        sentences += [effect(diagnosis.found, name) for name in diagnosis.found.names]
    for group in diagnosis.groups if diagnosis.verdict == "effects-found" else ():
        sentences.append(
            f"This table does not distinguish {join_names([effect_name(name) for name in group], 'from')}. "
            f"{_would_tell(diagnosis)}"
        )
    if diagnosis.verdict == "unknown":
        sentences.append(f"What it looks like: {shape(diagnosis)}")
    if diagnosis.remarks:
        sentences.append(f"Take care: {'; '.join(diagnosis.remarks)}.")
    return sentences


def effect(trial: Trial, name: str) -> str:
    """Return an effect with its numbers and what to do about it."""
    values = [quantity(value) for value in trial.values if value.parameter.name.startswith(f"{name}.")]
    known = statics.find(name)
    members = [member.name for member in trial.members(name)]
    values += [
        f"it is {join_names(members, 'or')}, which the table does not distinguish" if members[1:] else f"it is {m}"
        for m in members[:1]
    ]
    strength = f": {'; '.join(values)}" if values else ""
    return (
        f"{effect_name(name).capitalize()}{strength}. {known.physics} What to do about it: {known.remedy_for(PIEZO)}."
    )


def _would_tell(diagnosis: TableDiagnosis) -> str:
    if not diagnosis.proposals:
        return "No single measurement of this part, or of one with a dimension changed by 40 %, would."
    best = diagnosis.proposals[0]
    return f"Measure {measurement(best.row)}: {_expectations(diagnosis, best)}."


def _expectations(diagnosis: TableDiagnosis, proposal: Proposal) -> str:
    candidates = (diagnosis.found, *diagnosis.alike)[: len(proposal.expected)]
    expected = [number(proposal.row, value, 3) for value in proposal.expected]
    return ", ".join(f"with {names(a)} it is {value}" for a, value in zip(candidates, expected, strict=True))


def proposals(diagnosis: TableDiagnosis) -> list[list[str]]:
    """Return rows of discriminating measurements, and the prediction of each model."""
    return [[measurement(proposal.row), _expectations(diagnosis, proposal)] for proposal in diagnosis.proposals]


def shape(diagnosis: TableDiagnosis) -> str:
    """Return where what no effect explains is largest."""
    measured, rows = diagnosis.before.table.measured(), diagnosis.before.table.rows
    left = diagnosis.before.model.predict(diagnosis.before.table) / measured - 1
    worst = np.argsort(-np.abs(left))[:3]
    return f"the model is off most in {join_names([f'{measurement(rows[i])} ({percent(left[i])})' for i in worst])}."


def differences(comparison: TableComparison) -> bytes:
    """Draw the difference of each row in percent, with what is no difference."""
    # A line for the quantity, one for the dimensions that were changed.
    parts = [measurement(row).split(", ") for row in comparison.table.rows]
    labels = [",\n".join([", ".join(each[:2]), *each[2:]]) for each in parts]
    measured = np.abs(comparison.table.measured())
    figure, axes = charts.drawing(charts.NARROW, 0.4 * len(labels) + 1.2)
    places = np.arange(len(labels))
    allowed = 100 * comparison.uncertainty.validation / measured
    axes.barh(places, 2 * allowed, left=-allowed, color=charts.NEUTRAL, alpha=0.3, height=0.8, label="no difference")
    wrong = comparison.significance > 1
    for sentences, chosen, colour in (
        ("within it", ~wrong, charts.COLOURS[0]),
        ("beyond it", wrong, charts.COLOURS[1]),
    ):
        if chosen.any():
            error = 100 * (comparison.predicted - comparison.table.measured()) / measured
            axes.plot(error[chosen], places[chosen], "o", color=colour, label=sentences)
    axes.axvline(0, color=charts.NEUTRAL, linewidth=1)
    axes.set_yticks(places, labels)
    axes.invert_yaxis()
    axes.set_xlabel("predicted less measured, % of measured")
    charts.below(figure, axes, 3)
    return charts.svg(figure)

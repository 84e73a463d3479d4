"""Published numbers compared with a simulation, and what a difference proves: a cause that was seen, or none."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from flexdesign.core import units
from flexdesign.core.errors import join_names
from flexdesign.core.model import Quantity
from flexdesign.dynamics.experiments import AS_MODELLED
from flexdesign.dynamics.experiments.simulation import Case, Compared, Simulation
from flexdesign.report import charts
from flexdesign.report.document import Figure, Section, Table

#: Measures in words, in the order of tables.
WORDS = {
    "amplitude": "travel",
    "loop_span": "loop span",
    "loop_width": "loop width",
    "loop_width_relative": "of span",
    "secant_gain": "secant gain",
    "rise_time": "rise 10 to 90 %",
    "overshoot": "overshoot",
    "settling_time": "settling to 2 %",
    "steady_error": "steady error",
    "max_error": "largest error",
    "max_error_relative": "of range",
    "rms_error": "rms error",
    "max_contour_error": "largest distance from the path",
    "rms_contour_error": "rms distance",
    "coupled_motion": "motion",
    "coupling": "coupling",
}


#: Names of fractions that a table of measures lists next to their totals.
ALONE = {"loop_width_relative": "loop width per span", "max_error_relative": "largest error per range"}
#: Verdicts on numbers that say nothing about the model.
SET, NOT_COMPARABLE, NOT_MEASURED = "used to set the model", "not comparable", "not measured"
#: What may come of a published number, and how many did so, in words.
OUTCOMES = {
    "agrees": "agree with ours",
    "differs": "differ",
    "set": "were used to set the model",
    "not comparable": "cannot be compared",
}
#: What settling means: the motion stays within this share of the step.
BAND = 0.02


def table(simulation: Simulation) -> Table:
    """Return published numbers and ours."""
    rows = []
    for experiment in simulation.plan.experiments:
        for case, c in simulation.compare_published(experiment):
            ours = c.ours.formatted(3) if c.ours else "–"
            what = f"{ALONE.get(c.published.measure) or WORDS[c.published.measure]}, {c.axis}"
            note = "; ".join(text for text in (c.published.place, c.published.note) if text)
            rows.append([experiment.name, what, who(case), _as_printed(c), ours, _verdict(simulation, case, c), note])
    head = ["experiment", "what", "run", "published", "ours", "difference", "place and note"]
    return Table(head, rows, "Published numbers, with the uncertainty of their sensor where one is known")


def agreement(simulation: Simulation) -> str:
    """Say how many published numbers agree with ours; nothing where the study has none."""
    counts = _count(table(simulation).rows)
    if not any(counts.values()):
        return ""
    parts = join_names([f"{count} {OUTCOMES[outcome]}" for outcome, count in counts.items() if count])
    return f"Of {sum(counts.values())} published numbers {parts}."


def _count(rows: Sequence[Sequence[str]]) -> dict[str, int]:
    """Return how many rows of the table have each outcome."""
    outcomes = Counter(_outcome(row[5]) for row in rows)
    return {outcome: outcomes[outcome] for outcome in OUTCOMES}


def _outcome(verdict: str) -> str:
    if verdict in (NOT_COMPARABLE, NOT_MEASURED):
        return "not comparable"
    return "set" if verdict == SET else "agrees" if "within" in verdict else "differs"


def _picture(found: Table) -> Figure:
    """Draw how many published numbers of each experiment have each outcome."""
    names = dict.fromkeys(row[0] for row in found.rows)
    split = {name: _count([row for row in found.rows if row[0] == name]) for name in names}
    drawn = charts.shares(split, "published numbers", charts.NARROW)
    caption = "Published numbers of each experiment, compared with ours"
    return Figure("published.svg", drawn, caption, alt=charts.spoken(split))


def section(simulation: Simulation) -> Section:
    """Return the section with published numbers; empty where the study has none."""
    found = table(simulation)
    if not found.rows:
        return Section("Published numbers")
    text = "A difference within the uncertainty of the published number is no evidence for or against the model."
    return Section("Published numbers and ours", [text, *_damping(simulation)], [found], [_picture(found)])


def who(case: Case) -> str:
    """Return the controller of a run, and the variant of the stage if it is one."""
    return case.controller if case.variant == AS_MODELLED else f"{case.controller}, {case.variant}"


def _as_printed(compared: Compared) -> str:
    sigma = compared.published.uncertainty
    if compared.published.bound:
        return f"< {compared.published.value}"
    return f"{compared.published.value} ± {sigma}" if sigma else compared.published.value


def _verdict(simulation: Simulation, case: Case, compared: Compared) -> str:
    published, ours = compared.published, compared.ours
    if not published.comparable:
        return NOT_COMPARABLE
    if ours is None:
        return NOT_MEASURED
    if published.measure in _fitted_measures(simulation, case, compared.axis):
        return SET
    if not math.isfinite(ours.value):
        return "never settles"
    cause = _cause(case, compared.axis)
    if published.bound:
        within = ours.value < published.si
        return "within it" if within else f"beyond it{cause and f': {cause}'}"
    off, width = ours.value - published.si, published.half_width
    if width is None:
        return f"{100 * off / published.si:+.3g} %" if published.si else f"off by {ours.formatted(3)}"
    if abs(off) <= width:
        return f"{_difference(off, ours)}, within ±"
    return f"{_difference(off, ours)}, beyond ±: {cause or 'unexplained'}"


def _difference(off: float, ours: Quantity) -> str:
    """Write a difference as its uncertainty is written, which it is judged by; of two shares in points."""
    written = replace(ours, value=abs(off), half_width=None).formatted(3)
    return f"{'-' if off < 0 else '+'}{written.removesuffix(' %')}{' points' if written.endswith(' %') else ''}"


def _fitted_measures(simulation: Simulation, case: Case, axis: str) -> tuple[str, ...]:
    """Return the measures that an axis was set to give; none of them for what concerns all axes."""
    axes = simulation.variants[case.variant].axes
    return axes[axis].fitted if axis in axes else ()


def _cause(case: Case, axis: str) -> str:
    """Return what went wrong with an axis that was driven, or, for one that was not, with any that was; or nothing."""
    driven = [axis] if axis in case.experiment.axes else case.experiment.axes
    if case.response.diverged is not None or not all(case.margins[each].stable for each in driven if each in case.pid):
        return "the loop is unstable"
    cut = any((case.response.cut[case.row(each)] != 0).any() for each in driven)
    return "limits cut the command" if cut else ""


def _damping(simulation: Simulation) -> list[str]:
    """Say what damping a published settling without feedback takes, exp(-zeta w t) being the band at its end."""
    words = dict.fromkeys(
        _takes(simulation, case, c)
        for experiment in simulation.plan.experiments
        for case, c in simulation.compare_published(experiment)
        if c.published.measure == "settling_time" and not case.pid and not c.published.bound
    )
    return [f"Settling without feedback depends on the damping ratio. {' '.join(words)}"] if words else []


def _takes(simulation: Simulation, case: Case, compared: Compared) -> str:
    axis, modelled = simulation.variants[case.variant].axes[compared.axis], simulation.model.axes[compared.axis]
    damping = -math.log(BAND) / (2 * math.pi * axis.natural_frequency * compared.published.si)
    guessed = "damping_ratio" in axis.assumed and axis.damping_ratio == modelled.damping_ratio
    return (
        f"{compared.axis}, {case.variant}: a settling time of {compared.published.value} at "
        f"{units.to_text(axis.natural_frequency, 'Hz')} needs a ratio of {units.significant(damping, 3)}; the model "
        f"has {units.significant(axis.damping_ratio, 3)}{' (assumed)' if guessed else ''}."
    )

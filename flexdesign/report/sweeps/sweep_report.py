"""The report of a sweep: the best designs, what varies with what, and what failed and why."""

from __future__ import annotations

import csv as csv_format
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np

from flexdesign.core import units, versions
from flexdesign.core.serialise import header
from flexdesign.design.design import Design
from flexdesign.fem import mesh_refinement
from flexdesign.report import accuracy_text
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.sweeps import sweep_figures
from flexdesign.report.sweeps.sweep_figures import axis_label
from flexdesign.report.validation import design_pictures
from flexdesign.workflows.sweeps import Sweep, evaluators, pareto, sensitivity
from flexdesign.workflows.sweeps.sensitivity import Indices

#: How many designs, reasons of failure and quantities a report has, where nobody says which.
BEST, REASONS, SHOWN = 10, 8, 4
#: Number of the best designs drawn.
DRAWN = 4
#: What everybody asks of an amplifier, in this order.
DEFAULT_QUANTITIES = (
    "K_in_output_free", "|lambda_output_free|", "|stroke_output_free|", "K_out_actuator_installed", "K_out_input_free",
)  # fmt: skip


def reported_quantities(sweep: Sweep) -> list[str]:
    """Return the quantities that the report shows: those asked for, else those of limits and aims, else the usual."""
    asked = [*sweep.plan.show, *(a.quantity for a in sweep.plan.aims), *(c.quantity for c in sweep.plan.limits)]
    chosen = [quantity for quantity in dict.fromkeys(asked) if sweep.results.has(quantity)]
    return chosen or [quantity for quantity in DEFAULT_QUANTITIES if sweep.results.has(quantity)][:SHOWN]


@lru_cache(maxsize=1)
def chosen(sweep: Sweep) -> tuple[Sequence[int], Sequence[int]]:
    """Return the places of the designs that keep all limits, and of the best of these, best first."""
    feasible, aims = pareto.feasible(sweep.results, sweep.plan.limits), sweep.plan.aims
    if not aims:
        return feasible.tolist(), []
    best = pareto.rank(sweep.results, feasible, aims[0])[:BEST] if len(aims) == 1 else None
    return feasible.tolist(), (pareto.pareto_front(sweep.results, feasible, aims) if best is None else best).tolist()


def document(sweep: Sweep) -> Document:
    """Write the report."""
    return Document(title(sweep), summary(sweep), partial(_sections, sweep))


def _sections(sweep: Sweep) -> list[Section]:
    feasible, front = chosen(sweep)
    figures = sweep_figures.figures(sweep, reported_quantities(sweep), front, feasible)
    good = []
    if sweep.plan.method != "sensitivity":
        pictures, missing = _draw(sweep)
        good.append(
            Section("The best designs", [_how(sweep), *missing], [best(sweep)], pictures, gallery=len(pictures) > 1)
        )
    sections = [
        *good,
        *([Section("What depends on what", [], [], figures)] if figures else []),
        *_matters(sweep),
        Section("What varied", [], [_factors(sweep)]),
    ]
    if sweep.failed:
        sections.append(Section("What failed", [], [_failures(sweep)]))
    return sections


def title(sweep: Sweep) -> str:
    """Return what the file calls the sweep, or whose it is."""
    return sweep.plan.title or f"{sweep.plan.subject.title}: a sweep"


def summary(sweep: Sweep) -> list[str]:
    """Say which design is best or what matters most, whether an accuracy is missed, and how many cases there are."""
    feasible, front = chosen(sweep)
    plan, failed = sweep.plan, len(sweep.failed)
    sentences = []
    if front and len(plan.aims) == 1:
        largest = _number(sweep, front[0], plan.aims[0].quantity)
        sentences.append(f"The {plan.aims[0]} is {largest}: {_factors_text(sweep, front[0])}.")
    elif front:
        sentences.append(f"{len(front)} designs are beaten by no other in {' and '.join(map(str, plan.aims))} at once.")
    for quantity, each in _indices(sweep).items():
        order = np.argsort(-each.total)[:2]
        most = " and ".join(f"{plan.factors[i].name} ({100 * each.total[i]:.0f} %)" for i in order)
        sentences.append(f"{quantity} depends most on {most}.")
    sentences += _inaccurate(sweep)
    if plan.limits:
        sentences.append(f"{len(feasible)} of {len(sweep.cases)} keep {' and '.join(map(str, plan.limits))}.")
    text = f"{len(sweep.cases)} versions of {plan.subject.title}, evaluated by {EVALUATORS[plan.evaluator]}"
    text += f"; {failed} of them failed" if failed else ""
    known = len(sweep.cases) - sweep.computed
    text += f". {sweep.computed} were computed in {sweep.seconds:.3g} s" if sweep.computed else ". All were known"
    return [*sentences, text + (f", {known} were known." if known and sweep.computed else ".")]


def _inaccurate(sweep: Sweep) -> list[str]:
    """Say that the accuracy that was asked for is not reached in some cases."""
    missed = {_factors_text(sweep, place): error for place, error in sweep.inaccurate.items()}
    sentences = accuracy_text.not_reached_by(sweep.plan.mesh.accuracy, missed, len(sweep.cases) - len(sweep.failed))
    return [sentences] if sentences else []


#: What evaluators are called in a sentence.
EVALUATORS = {
    "pseudo-rigid": "the pseudo-rigid-body formulas",
    "analytic": "the compliance model",
    "planar": "finite elements in the plane, corrected to space",
    "fem": "finite elements",
    "simulation": "simulated experiments",
}


def _draw(sweep: Sweep) -> tuple[list[Figure], list[str]]:
    """Draw the first of the best designs; return the pictures, and why some are not there."""
    if not isinstance(sweep.plan.subject, Design):
        return [], []
    feasible, front = chosen(sweep)
    best = (_spread(front) if sweep.plan.aims else feasible[:BEST])[:DRAWN]
    found = {_factors_text(sweep, place): evaluators.version_of(sweep.plan, sweep.cases[place]) for place in best}
    return design_pictures.draw(found)


def _how(sweep: Sweep) -> str:
    if not sweep.plan.aims:
        return "Nothing was said to be good: write an aim, and limits, into the file. These are the first."
    if len(sweep.plan.aims) == 1:
        return f"The {sweep.plan.aims[0]} first."
    return "None of these is beaten by another in all aims at once."


def best(sweep: Sweep) -> Table:
    """Return the best designs, or the first where nobody said what is good."""
    feasible, front = chosen(sweep)
    places = _spread(front) if sweep.plan.aims else feasible[:BEST]
    quantities = reported_quantities(sweep)
    heads = [
        *(axis_label(factor.name, factor.unit) for factor in sweep.plan.factors),
        *(axis_label(quantity, sweep.results.unit(quantity)) for quantity in quantities),
    ]
    rows = [
        [
            *(factor.formatted(sweep.cases[i].values[factor.key], unit=False) for factor in sweep.plan.factors),
            *(_plain(sweep, i, quantity) for quantity in quantities),
        ]
        for i in places
    ]
    return Table(heads, rows, f"{len(places)} of {len(front if len(sweep.plan.aims) > 1 else feasible)} designs")


def _spread(places: Sequence[int]) -> list[int]:
    """Return some of the best, from one end of a front to the other."""
    chosen = np.linspace(0, len(places) - 1, min(BEST, len(places))).round().astype(int)
    return [places[i] for i in chosen]


def _plain(sweep: Sweep, place: int, quantity: str) -> str:
    value = sweep.results.in_unit(quantity)[place]
    return "–" if np.isnan(value) else units.significant(value, 4)


def _number(sweep: Sweep, place: int, quantity: str) -> str:
    return f"{_plain(sweep, place, quantity)} {sweep.results.unit(quantity)}".rstrip()


def _factors_text(sweep: Sweep, place: int) -> str:
    values = sweep.cases[place].values
    return ", ".join(f"{factor.name} {factor.formatted(values[factor.key])}" for factor in sweep.plan.factors)


def _matters(sweep: Sweep) -> list[Section]:
    """Return the section with Sobol's indices; none where the sample does not determine them."""
    indices = _indices(sweep)
    if not indices:
        return []
    text = (
        "Of a quantity's variance over all cases: what each factor explains alone, and in what it has a part, alone or "
        "with others. The difference is what it does together with them; the intervals hold in 95 of 100 samples."
    )
    names = [factor.name for factor in sweep.plan.factors]
    return [Section("What matters for what", [text], [importance(sweep)], [sweep_figures.importance(indices, names)])]


@lru_cache(maxsize=1)
def _indices(sweep: Sweep) -> dict[str, Indices]:
    if sweep.plan.method != "sensitivity":
        return {}
    count, seed = len(sweep.plan.factors), sweep.plan.seed
    found = {q: sensitivity.indices(sweep.results.in_unit(q), count, seed) for q in reported_quantities(sweep)}
    return {quantity: indices for quantity, indices in found.items() if indices is not None}


def importance(sweep: Sweep) -> Table:
    """Return Sobol's indices: a row for each quantity and factor."""

    def percent(value: float, half: float) -> str:
        return f"{100 * value:.1f} ± {100 * half:.1f} %"

    rows = [
        [
            quantity,
            factor.name,
            percent(each.first[index], each.first_half[index]),
            percent(each.total[index], each.total_half[index]),
        ]
        for quantity, each in _indices(sweep).items()
        for index, factor in enumerate(sweep.plan.factors)
    ]
    return Table(["quantity", "factor", "alone", "in all"], rows)


def result_table(sweep: Sweep) -> Table:
    """Return the table that answers what was asked: what matters for what, or the best designs."""
    return importance(sweep) if sweep.plan.method == "sensitivity" else best(sweep)


def _factors(sweep: Sweep) -> Table:
    rows = []
    for factor in sweep.plan.factors:
        values = [factor.formatted(value, unit=False) for value in factor.values]
        ends = f"{values[0]} to {factor.formatted(factor.values[-1])}" if factor.ends else ", ".join(values[:8])
        count = str(len(factor.values)) if sweep.plan.method == "grid" or not factor.ends else "any"
        rows.append([factor.key, ends, count, "equal ratios" if factor.is_log else ""])
    caption = f"{sweep.plan.method}, {len(sweep.cases)} cases" + (
        f", seed {sweep.plan.seed}" if sweep.plan.method != "grid" else ""
    )
    return Table(["what", "values", "how many", "spacing"], rows, caption)


def _failures(sweep: Sweep) -> Table:
    first: dict[str, int] = {}
    for place in sweep.failed:
        first.setdefault(sweep.results.errors[place], place)
    reasons = Counter(sweep.results.errors[place] for place in sweep.failed)
    rows = [[_factors_text(sweep, first[reason]), str(count), reason] for reason, count in reasons.most_common(REASONS)]
    return Table(["for example", "cases", "reason"], rows, f"{len(reasons)} reasons" if len(reasons) > 1 else "")


# --- files ------------------------------------------------------------------------------------------------------


def columns(sweep: Sweep) -> dict[str, list[Any]]:
    """Return all cases by header cell: what varied, every quantity in its unit, and why there is none."""
    found: dict[str, list[Any]] = {}
    for factor in sweep.plan.factors:
        if factor.is_number:
            found[f"{factor.key} [{factor.unit or '1'}]"] = sweep_figures.factor_values(sweep, factor).tolist()
        else:
            found[factor.key] = [case.values[factor.key] for case in sweep.cases]
    for key in sweep.results.kinds:
        found[f"{key} [{sweep.results.unit(key)}]"] = sweep.results.in_unit(key).tolist()
    return found | {"error": list(sweep.results.errors)}


def csv(sweep: Sweep) -> str:
    """Return all cases as CSV; a cell is empty where there is no number."""
    stream = io.StringIO()
    writer = csv_format.writer(stream, lineterminator="\n")
    found = columns(sweep)
    writer.writerow(found)
    for row in zip(*found.values(), strict=True):
        writer.writerow([cell if isinstance(cell, str) else "" if cell != cell else f"{cell:.9g}" for cell in row])
    return stream.getvalue()


def records(sweep: Sweep) -> list[dict[str, Any]]:
    """Return all cases, one row each."""
    found = columns(sweep)
    return [dict(zip(found, row, strict=True)) for row in zip(*found.values(), strict=True)]


def parquet(sweep: Sweep) -> bytes | None:
    """Return all cases as Parquet; None where pyarrow is not installed."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return None
    stream = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.table(columns(sweep)), stream)
    return stream.getvalue()


def result(sweep: Sweep) -> dict[str, Any]:
    """Return the numbers as result.json has them: the best designs; all of them are in cases.csv."""
    feasible, front = chosen(sweep)
    plan, missed = sweep.plan, sweep.inaccurate
    return {
        **header("sweep"),
        "title": title(sweep),
        "cases": len(sweep.cases),
        "computed": sweep.computed,
        "failed": len(sweep.failed),
        "accuracy": {"asked": plan.mesh.accuracy, "missed": len(missed), "worst": max(missed.values(), default=None)},
        "keep_limits": len(feasible),
        "limits": [str(limit) for limit in plan.limits],
        "aims": [str(aim) for aim in plan.aims],
        "best": [_case(sweep, i) for i in (front if plan.aims else feasible)[:BEST]],
        "made_by": {
            "study": str(plan.file.name),
            "stage_model" if plan.bench and plan.bench.model else "design": plan.subject.name,
            **({"experiments": plan.bench.study.stem} if plan.bench and plan.bench.study else {}),
            "evaluator": plan.evaluator,
            "sample": {"method": plan.method, "count": len(sweep.cases), "seed": plan.seed},
            "versions": versions.installed(mesh_refinement.LIBRARIES),
        },
    }


def _case(sweep: Sweep, place: int) -> Mapping[str, Any]:
    values = sweep.cases[place].values
    varied = {factor.key: factor.formatted(values[factor.key]) for factor in sweep.plan.factors}
    return {"values": varied, "quantities": [q.to_json() for q in sweep.results.at(place)]}

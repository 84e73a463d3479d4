"""The report: do the estimates hold, in words, tables and drawings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexdesign import __version__
from flexdesign.core.serialise import header
from flexdesign.fem import convergence
from flexdesign.report import charts
from flexdesign.report.document import Document, Figure, Section, Table
from studies.error_bars.designs import curved_designs, designs
from studies.error_bars.findings import OVERCAUTIOUS, REQUIRED_COVERAGE, Case, Deviation, Judgement, judge
from studies.error_bars.trial import ACCURACY, STRESS, ProgramResult, ReferenceResult, compared_keys

#: How a quantity is written, its unit, and how many SI units that is.
DISPLAY = {
    "K_in_output_free": ("K_in", "N/mm", 1e3),
    "lambda_output_free": ("λ", "", 1.0),
    "K_out_input_free": ("K_out free", "N/mm", 1e3),
    "K_out_input_held": ("K_out held", "N/mm", 1e3),
    STRESS: ("hinge stress", "MPa", 1e6),
}
GROUPS = {
    "extruded": "Extruded meshes of leaves",
    "wild": "Unstructured meshes of leaves",
    "curved": "Extruded meshes of curved necks",
}
HEAD = (
    "what", "contained", "error: median", "error: largest", "estimate: median", "estimate: largest",
    "estimate / error, rms", "largest error / estimate", "reference's uncertainty / estimate",
)  # fmt: skip


def document(cases: Sequence[Case]) -> Document:
    """Return the report of cases that have answers, or say why not."""
    solved = [case for case in cases if case.deviations]
    sections = [_about()]
    for group, title in GROUPS.items():
        of_group = [case for case in cases if case.group == group]
        if any(case.deviations for case in of_group):
            sections.append(_overview(title, of_group))
    sections += [_designs(title, [c for c in solved if c.group == group]) for group, title in GROUPS.items()]
    return Document("Are the error estimates true?", summary(cases), [s for s in sections if s.tables or s.paragraphs])


def summary(cases: Sequence[Case]) -> list[str]:
    """Return the answer in a few sentences."""
    said = []
    for group, title in GROUPS.items():
        of_group = [case for case in cases if case.group == group]
        solved = [case for case in of_group if case.deviations]
        if not solved:
            continue
        verdict = judge(_all(solved))
        whole = sum(all(deviation.contained for deviation in case.deviations) for case in solved)
        said.append(
            f"{title}: {verdict.contained} of {verdict.count} estimates contain the reference "
            f"({100 * verdict.share:.3g} %; {100 * REQUIRED_COVERAGE:.0f} % are asked for), all "
            f"{len(compared_keys(solved[0].sample))} of a design in {whole} of {len(solved)} designs. The median "
            f"estimate is {_percent(verdict.median_estimate)}, the median error {_percent(verdict.median_error)}; the "
            f"estimates are {verdict.caution:.1f} times the errors (root mean squares). "
            f"A design takes {_median_seconds(solved):.0f} s."
        )
        said += [
            f"Design {case.sample.number} ({case.sample.text()}) has no answer: {case.answer.error}"
            for case in of_group
            if not case.deviations
        ]
    if (versions := len({case.answer.elements for case in cases})) > 1:
        said.append(f"{versions} versions of the program's elements made these answers; --fresh makes them anew.")
    return said


def of(cases: Sequence[Case]) -> dict[str, Any]:
    """Return result.json's content: every number in SI units."""
    return {
        **header("study"),
        "accuracy": ACCURACY,
        "judgements": {
            group: vars(judge(_all(solved)))
            for group in GROUPS
            if (solved := [case for case in cases if case.group == group and case.deviations])
        },
        "cases": [_entry(case) for case in cases],
        "made_by": {"study": "studies.error_bars", "flexdesign": __version__},
    }


def cases_of(result: Mapping[str, Any]) -> list[Case]:
    """Return the cases of result.json's content, without what the program answered on single meshes.

    Raises
    ------
    KeyError
        If a case is of a design that is not drawn any more.
    """
    samples = {sample.number: sample for sample in (*designs(), *curved_designs())}
    cases = []
    for entry in result["cases"]:
        found, unknowns = {each["quantity"]: each for each in entry["quantities"]}, entry["unknowns"]

        def column(name: str, found: Mapping[str, Any] = found) -> dict[str, float]:
            return {key: each[name] for key, each in found.items()}

        answer = ProgramResult(
            column("value"), column("estimate"), [math.nan] * len(unknowns), {}, unknowns, entry["seconds"],
            entry["elements"], entry["error"],
        )  # fmt: skip
        reference = ReferenceResult(column("reference"), column("uncertainty"), **entry["reference"])
        cases.append(Case(samples[entry["design"]], entry["method"], answer, reference))
    return cases


def _entry(case: Case) -> dict[str, Any]:
    return {
        "design": case.sample.number,
        "method": case.method,
        "material": case.sample.material,
        "dimensions": {name: f"{value:g} mm" for name, value in case.sample.dimensions.items()},
        "quantities": [vars(deviation) | {"contained": deviation.contained} for deviation in case.deviations],
        "unknowns": list(case.answer.unknowns),
        "elements": case.answer.elements,
        "seconds": round(case.answer.seconds, 1),
        "reference": {"unknowns": case.reference.unknowns, "seconds": round(case.reference.seconds, 1)},
        "error": case.answer.error,
    }


def _about() -> Section:
    low, high = convergence.ORDERS
    return Section(
        "What is compared",
        [
            f"Bridge amplifiers drawn from the ranges in which they are built are solved to an accuracy of "
            f"{100 * ACCURACY:g} %: the program refines until its own estimate is that small, extrapolates with orders "
            f"between {low:.3g} and {high:.3g}, and prints value ± estimate.",
            "The reference shares no mesher, shape function or assembly with the program: 27-node hexahedra in layers, "
            "graded to the roots, on two meshes, extrapolated. Its own uncertainty is stated but not added: an "
            "estimate contains the truth if the reference's value lies within it.",
            "Errors and estimates are relative. The last two columns hold the largest error and the largest "
            "uncertainty of the reference, both divided by the estimate. The ratio of the root mean squares of "
            "estimate and error is 2 for an interval that holds 95 % of normally distributed errors; at "
            f"{OVERCAUTIOUS:.0f} the intervals would be too wide to be of use.",
        ],
    )


def _overview(title: str, cases: Sequence[Case]) -> Section:
    solved = [case for case in cases if case.deviations]
    keys = compared_keys(cases[0].sample)
    rows = [_row(DISPLAY[key][0], judge([d for d in _all(solved) if d.quantity == key])) for key in keys]
    for kind in dict.fromkeys(case.sample.kind for case in solved):
        rows.append(_row(kind, judge(_all([case for case in solved if case.sample.kind == kind]))))
    rows.append(_row("all", judge(_all(solved))))
    group = cases[0].group
    return Section(title, [], [Table(HEAD, rows)], [_histogram(solved, group), _bars(solved, group)])


def _row(what: str, found: Judgement) -> list[str]:
    return [
        what,
        f"{found.contained} of {found.count}",
        *(_percent(x) for x in (found.median_error, found.worst_error, found.median_estimate, found.worst_estimate)),
        f"{found.caution:.1f}",
        f"{found.worst:.2f}",
        f"{found.doubt:.2f}",
    ]


def _designs(title: str, cases: Sequence[Case]) -> Section:
    shown = [DISPLAY[key] for key in compared_keys(cases[0].sample)] if cases else []
    head = ["design", *(f"{name} [{unit}]" if unit else name for name, unit, _ in shown)]
    head += ["error / estimate", "meshes", "time [s]", "reference, time [s]"]
    rows = []
    for case in cases:
        cells = [_value_text(deviation) for deviation in case.deviations]
        off = ", ".join(f"{deviation.in_estimates:+.2f}" for deviation in case.deviations)
        finest = f"{len(case.answer.sizes)} to {case.answer.unknowns[-1] / 1e3:.0f} k"
        seconds = [f"{case.answer.seconds:.0f}", f"{case.reference.seconds:.0f}"]
        rows.append([f"{case.sample.number}: {case.sample.text()}", *cells, off, finest, *seconds])
    caption = (
        "Value ± estimate, and the reference in brackets; t thickness of the hinges, l span and offset of the arms, w "
        "width, R fillets [mm]. Meshes: how many, and the finest one's unknowns."
    )
    return Section(f"{title}: every design", [], [Table(head, rows, caption)] if rows else [], folded=True)


def _value_text(deviation: Deviation) -> str:
    scale = DISPLAY[deviation.quantity][2]
    value, estimate, reference = (x / scale for x in (deviation.value, deviation.estimate, deviation.reference))
    digits = int(np.clip(1 - np.floor(np.log10(estimate)), 0, 9))  # two digits of the estimate
    return f"{value:.{digits}f} ± {estimate:.{digits}f} ({reference:.{digits}f})"


def _histogram(cases: Sequence[Case], group: str) -> Figure:
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(7.2, 3.0), layout="constrained")
    axes = canvas.add_subplot()
    charts.plain(axes)
    keys = compared_keys(cases[0].sample)
    groups = {DISPLAY[key][0]: [d.in_estimates for d in _all(cases) if d.quantity == key] for key in keys}
    reach = max(1.2, 1.05 * max(abs(x) for found in groups.values() for x in found))
    edges = np.arange(-np.ceil(reach / 0.1), np.ceil(reach / 0.1) + 1) * 0.1
    colours = charts.COLOURS[: len(groups)]
    axes.hist(list(groups.values()), bins=edges.tolist(), stacked=True, color=colours, label=list(groups))
    for side in (-1, 1):
        axes.axvline(side, color=charts.NEUTRAL, linestyle="--")
    axes.set_xlabel("(value - reference) / estimate")
    axes.set_ylabel("answers")
    charts.below(canvas, axes, 4)
    caption = (
        "Values between the dashed lines are contained; a peak only in the middle means estimates that are too wide"
    )
    return Figure(f"histogram_{group}.svg", charts.svg(canvas), caption)


def _bars(cases: Sequence[Case], group: str) -> Figure:
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(7.2, 3.4), layout="constrained")
    axes = canvas.add_subplot()
    charts.plain(axes)
    key = "K_in_output_free"
    found = [next(d for d in case.deviations if d.quantity == key) for case in cases]
    for number, label in enumerate(dict.fromkeys(case.sample.kind for case in cases)):
        chosen = [i for i, case in enumerate(cases) if case.sample.kind == label]
        middle, half = ([100 * x for x in part] for part in _relative([found[i] for i in chosen]))
        places = [cases[i].sample.number for i in chosen]
        colour = charts.COLOURS[number]
        axes.errorbar(places, middle, half, fmt="o", color=colour, markersize=4, capsize=2, label=label)
    numbers, doubts = (
        [case.sample.number for case in cases],
        np.array([100 * d.uncertainty / d.reference for d in found]),
    )
    axes.bar(numbers, 2 * doubts, bottom=-doubts, width=0.9, color=charts.NEUTRAL, alpha=0.4, label="reference")
    axes.axhline(0.0, color=charts.NEUTRAL, linewidth=0.8)
    axes.set_xlabel("design")
    axes.set_ylabel("K_in / reference - 1 [%]")
    charts.below(canvas, axes, 3)
    return Figure(f"bars_{group}.svg", charts.svg(canvas), "K_in ± estimate, and the reference with its own error")


def _relative(found: Sequence[Deviation]) -> tuple[list[float], list[float]]:
    return [d.error for d in found], [d.estimate / abs(d.reference) for d in found]


def _all(cases: Sequence[Case]) -> list[Deviation]:
    return [deviation for case in cases for deviation in case.deviations]


def _median_seconds(cases: Sequence[Case]) -> float:
    return float(np.median([case.answer.seconds for case in cases]))


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %"

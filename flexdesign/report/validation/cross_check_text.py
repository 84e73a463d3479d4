"""The section that sets every way of solving a part side by side, and says whether they agree."""

from __future__ import annotations

import math
from typing import Any

from flexdesign.report.document import Section, Table
from flexdesign.report.wording import format_quantity, name_of
from flexdesign.workflows.validation import CrossCheck, Way
from flexdesign.workflows.validation.cross_check import KEYS

#: How the quantities are headed.
HEADS = ("K_in", "λ", "K_out")
#: Names of methods in the text.
METHODS = {"wild": "unstructured"}


def section(check: CrossCheck | None) -> Section:
    """Return the section; an empty one if nobody asked."""
    if check is None:
        return Section("Cross-check")
    text = (
        "The same part in every way that it allows: meshes of both kinds, and the fundamental domain, whose mirror "
        "images make the whole, and the whole itself, which is solved on two meshes alone. Values are extrapolated, ± "
        "their own estimate. The differences are from the way that the rest of this report took, whose time includes "
        "modes; estimates combine in quadrature. K_in and λ hold with the output free, K_out with the input free."
    )
    failed = [f"{_method_name(way)} gave no answer: {way.failure}." for way in check.others if way.failure]
    return Section("Cross-check", [verdict(check), text, *failed], [_results(check), _differences(check)])


def verdict(check: CrossCheck) -> str:
    """Say in a sentence whether the ways agree within their estimates."""
    if not check.answered:
        return "There is no other way to solve this part that gave an answer: nothing could be cross-checked."
    way, key, worst = check.worst()
    gap = abs(100 * way.difference(check.chosen, key)[0])
    count = len(check.answered) + 1
    where = (
        f"{name_of(way.found[key])}, {_method_name(way).lower()}: {gap:.2g} %, {worst:.2g} times the combined estimate"
    )
    if check.agrees:
        return f"Cross-check: {count} ways to mesh and solve the part agree within their estimates (farthest {where})."
    return f"Cross-check: {count} ways to mesh and solve the part do NOT agree within their estimates ({where})."


def result(check: CrossCheck | None) -> dict[str, Any] | None:
    """Return result.json's entry."""
    if check is None:
        return None
    return {"agrees": check.agrees, "ways": [_entry(way, check) for way in (check.chosen, *check.others)]}


def _entry(way: Way, check: CrossCheck) -> dict[str, Any]:
    found = []
    for quantity_key, quantity in way.found.items():
        relative, estimates = way.difference(check.chosen, quantity_key)
        gap = {"difference": relative, "difference_in_estimates": estimates if math.isfinite(estimates) else None}
        found.append(quantity.to_json() | gap)
    return {
        "method": way.method,
        "symmetry_planes": list(way.planes),
        "chosen": way is check.chosen,
        "unknowns": way.unknowns,
        "seconds": round(way.seconds, 2),
        "quantities": found,
        "failure": way.failure or None,
    }


def _results(check: CrossCheck) -> Table:
    rows = [
        [
            *_cells(way, check),
            f"{way.unknowns}",
            *(format_quantity(way.found[key]) for key in KEYS),
            f"{way.seconds:.0f} s",
        ]
        for way in (check.chosen, *check.answered)
    ]
    return Table(["meshes", "domain", "unknowns", *HEADS, "time"], rows, "What each way finds")


def _differences(check: CrossCheck) -> Table:
    rows = []
    for way in check.answered:
        row = _cells(way, check)
        for key in KEYS:
            relative, estimates = way.difference(check.chosen, key)
            row += [f"{100 * relative:+.3f} %", f"{estimates:.2f}"]
        rows.append(row)
    heads = [head for quantity in HEADS for head in (quantity, "in estimates")]
    return Table(["meshes", "domain", *heads], rows, "Differences from the chosen way, and in combined estimates")


def _cells(way: Way, check: CrossCheck) -> list[str]:
    method = METHODS.get(way.method, way.method)
    return [f"{method} (chosen)" if way is check.chosen else method, _domain(way)]


def _domain(way: Way) -> str:
    return ("whole part", "half", "quarter", "eighth")[len(way.planes)]


def _method_name(way: Way) -> str:
    return f"{METHODS.get(way.method, way.method).capitalize()} meshes of the {_domain(way)}"

"""The section on one mesh of another mesher, and whether it agrees with the numbers of the report."""

from __future__ import annotations

from typing import Any

from flexdesign.report.document import Section, Table
from flexdesign.report.wording import format_quantity, name_of
from flexdesign.workflows.validation import IndependentCheck


def verdict(check: IndependentCheck) -> str:
    """Say in a sentence whether the mesh agrees."""
    if not check.found:
        return f"An independent mesh by pytetwild gave no answer: {check.failure}."
    worst = max(check.found, key=lambda key: abs(check.gap(key)) / check.allowed(key))
    gap, allowed = 100 * abs(check.gap(worst)), 100 * check.allowed(worst)
    where = f"the largest difference is {gap:.2g} %, in the {name_of(check.found[worst])}; {allowed:.2g} % is allowed"
    does = "agrees" if check.agrees else "does NOT agree"
    return f"One independent mesh of the same domain, by pytetwild, {does} within both error estimates: {where}."


def section(check: IndependentCheck | None) -> Section:
    """Return the section; an empty one if there was no such mesh."""
    if check is None or not check.found:
        return Section("An independent mesh", [] if check is None else [verdict(check)])
    text = (
        "The report's own meshes are extruded from a section; pytetwild makes tetrahedra from the surface alone. On "
        f"one mesh of {check.unknowns} unknowns the error is estimated by recovery (Zienkiewicz and Zhu 1987): the "
        "values are corrected by twice the energy of the difference between averaged and computed stresses, and that "
        f"energy is their uncertainty. It took {check.seconds:.0f} s; mesh.independent = false leaves it out."
    )
    rows = [
        [
            name_of(quantity),
            quantity.boundary,
            format_quantity(check.chosen[key]),
            format_quantity(quantity),
            f"{100 * check.gap(key):+.2g} %",
            f"{100 * check.allowed(key):.2g} %",
        ]
        for key, quantity in check.found.items()
    ]
    columns = ["quantity", "boundary", "this report", "independent mesh", "difference", "both estimates"]
    return Section("An independent mesh", [verdict(check), text], [Table(columns, rows)])


def result(check: IndependentCheck | None) -> dict[str, Any] | None:
    """Return result.json's entry."""
    if check is None:
        return None
    return {
        "mesher": "pytetwild",
        "agrees": check.agrees,
        "unknowns": check.unknowns,
        "seconds": check.seconds,
        "failure": check.failure or None,
        "quantities": [
            quantity.to_json() | {"difference": check.gap(key), "allowed": check.allowed(key)}
            for key, quantity in check.found.items()
        ],
    }

"""The table and its numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flexdesign import __version__
from flexdesign.core.serialise import header
from flexdesign.report.document import Document, Section, Table
from studies.verification.finding import Finding

HEAD = ("problem", "quantity", "source", "unit", "reference", "found", "difference", "allowed")
#: What each group of problems shows.
TEXTS = {
    "Elements": "What must hold on any mesh; most on meshes of which no two elements are alike.",
    "Benchmarks": "Plane stress is a slice with free faces; the clamp of FV32 lets the thickness contract.",
    "Cantilevers": (
        "A clamp that holds a whole face holds back lateral contraction, too, and so stiffens the root. Without "
        "contraction it disturbs nothing in pure bending. With it, two lengths distinguish beam and root: the beam "
        "is exact, and the root explains the difference under a force."
    ),
    "Hinges": (
        "Formulas are those of beams. A hinge wider than long cannot contract across its width and is stiffer by up to "
        "1 / (1 - nu^2); blocks that give way around the roots make it softer. Both are in a body, neither in a "
        "formula: the slice in plane stress is checked against numbers, the body against both limits."
    ),
    "Large displacements": "Saint Venant-Kirchhoff elements; the linear solution knows nothing of second order.",
}


def document(groups: dict[str, list[Finding]]) -> Document:
    """Return the report."""
    findings = [finding for group in groups.values() for finding in group]
    lost = [finding for finding in findings if not finding.holds]
    seconds = sum({finding.problem: finding.seconds for finding in findings}.values())
    summary = [
        f"{len(findings) - len(lost)} of {len(findings)} numbers lie in the range that their reference allows for; "
        f"{seconds:.0f} s for all.",
        *(f"Outside: {finding.problem}, {finding.quantity}." for finding in lost),
    ]
    return Document("Verification of the finite elements", summary, [_section(*group) for group in groups.items()])


def of(groups: dict[str, list[Finding]]) -> dict[str, Any]:
    """Return result.json's content: every number with its unit."""
    return {
        **header("study"),
        "findings": [_entry(group, finding) for group, findings in groups.items() for finding in findings],
        "made_by": {"study": "studies.verification", "flexdesign": __version__},
    }


def _entry(group: str, finding: Finding) -> dict[str, Any]:
    return {
        "group": group,
        "problem": finding.problem,
        "quantity": finding.quantity,
        "kind": finding.kind,
        "source": finding.source,
        "unit": finding.unit,
        "reference": finding.reference,
        "found": finding.found,
        "low": finding.low,
        "high": finding.high,
        "holds": finding.holds,
        "note": finding.note,
        "unknowns": finding.unknowns,
        "seconds": round(finding.seconds, 2),
    }


def _section(title: str, findings: Sequence[Finding]) -> Section:
    rows = [
        [
            finding.problem,
            finding.quantity,
            finding.source,
            "" if finding.unit == "1" else finding.unit,
            _number(finding.reference, finding.unit),
            _number(finding.found, finding.unit),
            "–" if finding.difference is None else f"{100 * finding.difference:+.2g} %",
            range_text(finding) if finding.holds else f"{range_text(finding)}: outside",
        ]
        for finding in findings
    ]
    reasons = dict.fromkeys((f.problem, f.note, f"{f.unknowns}", f"{f.seconds:.1f} s") for f in findings)
    caption = "Problems with several numbers are solved once, in the time of each row"
    heads = ("problem", "what the range allows for, or explains", "unknowns", "time")
    return Section(title, [TEXTS[title]], [Table(HEAD, rows), Table(heads, list(reasons), caption)])


def range_text(finding: Finding) -> str:
    """Return the range in percent of the reference, or as numbers where the reference is zero."""
    if not finding.reference:
        return f"to {finding.high:.2g}"
    ends = sorted(100 * (end / finding.reference - 1) for end in (finding.low, finding.high))
    if abs(ends[0] + ends[1]) < 1e-6 * ends[1]:
        return f"± {ends[1]:.2g} %"
    return f"{ends[0] + 0.0:+.3g} to {ends[1] + 0.0:+.3g} %"


def _number(value: float, unit: str) -> str:
    return f"{value:.2g}" if 0 < abs(value) < 1e-6 and unit == "1" else f"{value:.5g}"

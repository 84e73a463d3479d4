"""The report of a stage that was sized by formulas and finite elements: targets, dimensions, and what they leave."""

from __future__ import annotations

from flexdesign.core import units
from flexdesign.report.document import Document, Section, Table
from flexdesign.workflows.stage_sizing import Row, StageSizing

#: Who says what the stage has, by kind of target.
WHO = {"formulas": "formulas", "arms": "arms that tilt", "elements": "FEM"}


def targets(found: StageSizing) -> Table:
    """Return each target and what the dimensions give."""
    rows = [
        [
            f"{row.target.quantity.name}, {row.target.quantity.boundary}",
            WHO[row.target.kind],
            row.target.quantity.formatted(),
            row.found.formatted(),
            f"{100 * row.off:+.2f} %",
            _verdict(row),
            row.target.source or "–",
        ]
        for row in found.rows
    ]
    columns = ["target", "by", "asked for", "found", "off by", "verdict", "source"]
    caption = "± of a target: half a unit of its last digit, or its own; ± of FEM: estimated discretisation error"
    return Table(columns, rows, caption)


def _verdict(row: Row) -> str:
    return "met" if row.met else f"missed: ± {100 * row.target.tolerance:.2g} % was allowed"


def document(found: StageSizing) -> Document:
    """Return the report."""
    met = sum(row.met for row in found.rows)
    count = len(found.ratios)
    summary = [
        f"{len(found.free)} dimensions meet {met} of {len(found.rows)} targets, after {count} "
        f"solution{'s' if count > 1 else ''} of the whole stage by finite elements. They are reconstructed, and one "
        "realisation of the targets.",
        *([found.note] if found.note else []),
    ]
    return Document(
        found.title,
        summary,
        [
            Section("Targets", [], [targets(found)]),
            Section("Dimensions", [], [_dimensions(found)]),
            Section("How they were found", [_method()], [_solutions(found)]),
            Section("What else finite elements give", [], [_further(found)]),
        ],
    )


def _method() -> str:
    return (
        "Least squares in the logarithms of the free dimensions, each pulled weakly to its start. The compliance model "
        "stands in for finite elements, times their ratio at the last solution, until the ratio no longer changes "
        "(output space mapping, Bandler et al. 2004)."
    )


def _dimensions(found: StageSizing) -> Table:
    described = {p.name: p for p in found.design.part_class.dimensions}
    rows = [
        [
            name,
            units.to_text(found.started.dimensions[name], "mm", si="m"),
            units.to_text(found.design.dimensions[name], "mm", si="m"),
            described[name].symbol or "–",
            described[name].meaning,
        ]
        for name in found.free
    ]
    return Table(["dimension", "start", "found", "symbol", "meaning"], rows)


def _solutions(found: StageSizing) -> Table:
    keys = list(found.ratios[0])
    rows = [[str(n), *(f"{ratio[key]:.4f}" for key in keys)] for n, ratio in enumerate(found.ratios, 1)]
    return Table(["solution", *keys], rows, "Finite elements over the compliance model")


def _further(found: StageSizing) -> Table:
    rows = [[quantity.name, quantity.boundary, quantity.formatted()] for quantity in found.further]
    return Table(["quantity", "boundary", "FEM"], rows)

"""The report of a stage that was sized by formulas and finite elements: targets, dimensions, and what they leave."""

from __future__ import annotations

from flexdesign.core import units
from flexdesign.report.document import Document, Section, Table
from flexdesign.workflows.stage_sizing import StageSizing
from flexdesign.workflows.stage_targets import Row

#: Who says what the stage has, by kind of target.
WHO = {"formulas": "formulas", "arms": "arms that tilt", "elements": "FEM"}


def targets(sizing: StageSizing) -> Table:
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
        for row in sizing.rows
    ]
    columns = ["target", "by", "asked for", "found", "off by", "verdict", "source"]
    caption = "± of a target: half a unit of its last digit, or its own; ± of FEM: estimated discretisation error"
    return Table(columns, rows, caption)


def _verdict(row: Row) -> str:
    return "met" if row.met else f"missed: ± {100 * row.target.tolerance:.2g} % was allowed"


def document(sizing: StageSizing) -> Document:
    """Return the report."""
    met = sum(row.met for row in sizing.rows)
    count = len(sizing.ratios)
    summary = [
        f"{len(sizing.free)} dimensions meet {met} of {len(sizing.rows)} targets, after {count} "
        f"solution{'s' if count > 1 else ''} of the whole stage by finite elements. They are reconstructed, and one "
        "realisation of the targets.",
        *([sizing.note] if sizing.note else []),
    ]
    return Document(
        sizing.title,
        summary,
        [
            Section("Targets", [], [targets(sizing)]),
            Section("Dimensions", [], [_dimensions(sizing)]),
            Section("How they were found", [_method()], [_solutions(sizing)]),
            Section("What else finite elements give", [], [_other_quantities(sizing)]),
        ],
    )


def _method() -> str:
    return (
        "Least squares in the logarithms of the free dimensions, each pulled weakly to its start. The compliance model "
        "stands in for finite elements, times their ratio at the last solution, until the ratio no longer changes "
        "(output space mapping, Bandler et al. 2004)."
    )


def _dimensions(sizing: StageSizing) -> Table:
    described = {p.name: p for p in sizing.design.part_class.dimensions}
    rows = [
        [
            name,
            units.to_text(sizing.started.dimensions[name], "mm", si="m"),
            units.to_text(sizing.design.dimensions[name], "mm", si="m"),
            described[name].symbol or "–",
            described[name].meaning,
        ]
        for name in sizing.free
    ]
    return Table(["dimension", "start", "found", "symbol", "meaning"], rows)


def _solutions(sizing: StageSizing) -> Table:
    keys = list(sizing.ratios[0])
    rows = [[str(n), *(f"{ratio[key]:.4f}" for key in keys)] for n, ratio in enumerate(sizing.ratios, 1)]
    return Table(["solution", *keys], rows, "Finite elements over the compliance model")


def _other_quantities(sizing: StageSizing) -> Table:
    rows = [[quantity.name, quantity.boundary, quantity.formatted()] for quantity in sizing.further]
    return Table(["quantity", "boundary", "FEM"], rows)

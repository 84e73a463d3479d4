"""The section on the way from the pseudo-rigid model to finite elements, and on what tolerances do."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from flexdesign.effects import statics
from flexdesign.report import charts
from flexdesign.report.diagnosis.table_text import effect_name
from flexdesign.report.document import Figure, Section, Table
from flexdesign.report.wording import format_quantity, name_of
from flexdesign.workflows.validation import Validation
from flexdesign.workflows.validation.model_hierarchy import ModelHierarchy
from flexdesign.workflows.validation.validate_stage import StageValidation

#: How the quantities are written, by key.
SYMBOLS = {"K_in_output_free": "K_in", "lambda_output_free": "λ", "K_out_input_free": "K_out"}
ADDED = (
    "effect by effect, each time the one that brings it nearest to FEM (root mean square over what is compared). "
    "Effects that change nothing are left out. Effects may work against each other: roots make hinges softer, width "
    "makes them stiffer."
)
TEXT = (
    "The compliance model begins as the pseudo-rigid one, hinges that only rotate, and adds the effects of the drawing "
    f"{ADDED}"
)
#: Of a mechanism that hinges which only rotate would lock.
LOCKED = (
    "Hinges that only rotate would lock this mechanism, so that the compliance model begins with the first effect that "
    f"lets it move. It adds the effects of the drawing {ADDED}"
)
TOLERANCES = (
    "The tolerances of the part and the mesh of FEM each make the numbers uncertain. A measurement and the model "
    "differ only if their difference exceeds both and the uncertainty of the measurement together (ASME V&V 20)."
)


def section(validation: Validation | StageValidation, symbols: Mapping[str, str] = SYMBOLS) -> Section:
    """Return the section; empty for a part or a stage that the compliance model cannot take.

    Parameters
    ----------
    validation
        Of a part or a stage.
    symbols
        How the quantities that are compared are written, by key.
    """
    hierarchy = validation.hierarchy
    if hierarchy is None:
        return Section("From the pseudo-rigid model to FEM")
    figure = Figure("theory_ladder.svg", _draw(hierarchy, symbols), "Distance from FEM, effect by effect")
    given = validation.study.design.tolerances
    text = (
        f"{TOLERANCES} Dimensions within {1e6 * given.dimensions:g} um, the modulus within {100 * given.modulus:g} %."
    )
    return Section(
        "From the pseudo-rigid model to FEM",
        [LOCKED if hierarchy.rungs[0].effect else TEXT, text],
        [_error_steps(hierarchy, symbols), _tolerances(validation, hierarchy)],
        [figure],
    )


def result(hierarchy: ModelHierarchy | None) -> dict[str, Any] | None:
    """Return the ladder as result.json has it."""
    if hierarchy is None:
        return None
    rungs = [
        {"added": step_of_ladder.effect or "pseudo-rigid", "errors": dict(step_of_ladder.errors)}
        for step_of_ladder in hierarchy.rungs
    ]
    return {"rungs": rungs, "tolerances_2_sigma": dict(hierarchy.tolerances)}


def _error_steps(hierarchy: ModelHierarchy, symbols: Mapping[str, str]) -> Table:
    keys = list(hierarchy.rungs[0].errors)
    rows = []
    for step_of_ladder in hierarchy.rungs:
        label = f"+ {effect_name(step_of_ladder.effect)}" if step_of_ladder.effect else "pseudo-rigid"
        where = statics.find(step_of_ladder.effect).where if step_of_ladder.effect else ""
        errors = [f"{100 * step_of_ladder.errors[key]:+.2f} %" for key in keys]
        rows.append([label, *errors, f"{100 * math.expm1(step_of_ladder.size):.2f} %", where])
    head = ["model", *(symbols[key] for key in keys), "all", "where it acts"]
    return Table(head, rows, "Model / FEM - 1; K_in and λ with a free output, K_out with free inputs")


def _tolerances(validation: Validation | StageValidation, hierarchy: ModelHierarchy) -> Table:
    rows = []
    for key, share in hierarchy.tolerances.items():
        fem = validation.fem(key)
        rows.append([name_of(fem), fem.boundary, format_quantity(fem), f"± {100 * share:.2g} %"])
    return Table(["quantity", "boundary", "FEM ± mesh", "tolerances"], rows, "Tolerances: two standard deviations")


def _draw(hierarchy: ModelHierarchy, symbols: Mapping[str, str]) -> bytes:
    labels = [
        f"+ {effect_name(step_of_ladder.effect)}" if step_of_ladder.effect else "pseudo-rigid"
        for step_of_ladder in hierarchy.rungs
    ]
    figure, axes = charts.drawing(7.2, 0.34 * len(labels) + 1.4)
    for index, key in enumerate(hierarchy.rungs[0].errors):
        errors = [max(abs(100 * step_of_ladder.errors[key]), 0.01) for step_of_ladder in hierarchy.rungs]
        axes.plot(errors, range(len(labels)), "o-", color=charts.COLOURS[index], label=symbols[key], linewidth=1.5)
    axes.set_xscale("log")
    axes.set_yticks(range(len(labels)), labels)
    axes.invert_yaxis()
    axes.set_xlabel("distance from FEM [%]")
    axes.grid(color=charts.NEUTRAL, alpha=0.25)
    charts.below(figure, axes, 3)
    return charts.svg(figure)

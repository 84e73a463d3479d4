"""The report of a whole stage: Table 1, what explains the differences, coupling, modes, and what stands behind it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from flexdesign.core import units
from flexdesign.core.serialise import header, with_unit
from flexdesign.dynamics.experiments.simulation import stage_model_cautions
from flexdesign.fem import convergence
from flexdesign.fem.cross_axis_coupling import Cause, CrossMotion
from flexdesign.fem.quantities.stage_modes import ModeShares
from flexdesign.fem.stage_condensation import Kind
from flexdesign.report import accuracy_text
from flexdesign.report.document import Document, Section, Table
from flexdesign.report.pictures import draw_or_explain
from flexdesign.report.validation import card, hierarchy_section, stage_differences, stage_motion, stage_pictures
from flexdesign.report.validation.stage_text import Axes, axis_of, computed_values, percent, written
from flexdesign.report.wording import flat, format_quantity
from flexdesign.workflows.validation import Comparison, provenance
from flexdesign.workflows.validation.validate_stage import StageValidation

Progress = Callable[[str], None]


def table_1(validation: StageValidation) -> Table:
    """Return FEM, each analytic model and each published column, with deviations from FEM."""
    axes = Axes(validation)
    found = stage_differences.listed_comparisons(validation, axes)
    models = list(dict.fromkeys(model for comparison in found for model in computed_values(comparison)))
    rows = []
    for comparison in found:
        fem = comparison.fem
        where = axes.where(fem).removeprefix(f"{axes.label(axis_of(fem))}, ") if axis_of(fem) in axes.head else ""
        cells = [_comparison_text(validation, comparison, model) for model in models]
        rows.append([f"{axes.short(fem)}, {where}", format_quantity(fem), *cells])
    return Table(["", "FEM", *models], rows, "FEM ± estimated discretisation error; in brackets deviations from FEM")


def _comparison_text(validation: StageValidation, comparison: Comparison, model: str) -> str:
    """Write a model's number, in the unit of FEM's, and how far it is off."""
    theirs = computed_values(comparison).get(model)
    if theirs is None:
        return "–"
    number, error = written(validation, model, theirs).split()[0], comparison.error(model)
    return number if error is None else f"{number} ({percent(error)})"


def brief_table_1(validation: StageValidation) -> Table:
    """Return Table 1 for a terminal: without boundaries, its unit with the name of each quantity."""
    whole, rows = table_1(validation), []
    for (name, fem, *cells), comparison in zip(
        whole.rows, stage_differences.listed_comparisons(validation, Axes(validation)), strict=True
    ):
        unit = comparison.fem.unit
        called = f"{name.partition(',')[0]} [{unit}]" if unit else name.partition(",")[0]
        rows.append([called, fem.removesuffix(f" {unit}"), *(cell.replace(" %)", "%)") for cell in cells)])
    return Table(whole.columns, rows, whole.caption)


def document(validation: StageValidation, progress: Progress = lambda _: None) -> Document:
    """Write the report of a stage's validation, pictures included where they can be drawn."""
    sections = partial(_sections, validation, progress)
    return Document(_title(validation), _summary(validation), sections, card.facts_of_stage(validation))


def _sections(validation: StageValidation, progress: Progress) -> list[Section]:
    progress("drawing")
    still, vibrating, missing = draw_or_explain(lambda: stage_pictures.draw(validation), progress)
    sections = [
        Section("FEM, formulas and published numbers", _table_1_text(validation), [table_1(validation)]),
        stage_differences.section(validation),
        _hierarchy(validation),
        Section("Shape and deformation", missing, figures=still),
        stage_motion.coupling(validation),
        stage_motion.compare_with_measurements(validation),
        stage_motion.tilt(validation),
        stage_motion.modes(validation, vibrating),
        _stage_model(validation),
        _meshes(validation),
        _assumptions(validation),
        _inputs(validation),
    ]
    return [s for s in sections if s.tables or s.figures or s.paragraphs]


def _hierarchy(validation: StageValidation) -> Section:
    axes, rungs = Axes(validation), validation.hierarchy.rungs if validation.hierarchy else []
    return hierarchy_section.section(
        validation, {key: axes.short(validation.fem(key)) for step_of_ladder in rungs for key in step_of_ladder.errors}
    )


def _title(validation: StageValidation) -> str:
    """Return the design's title, and in it whether its dimensions are its author's."""
    design = validation.study.design
    word, colon, _ = design.provenance.partition(":")
    note = f", {word}" if colon and word not in design.title else ""
    return f"{design.title}{note}: validation"


def _summary(validation: StageValidation) -> list[str]:
    design, axes = validation.study.design, Axes(validation)
    texts, paragraphs = [], [f"This design is {design.provenance}."] if design.provenance else []
    for axis in axes.listed:
        k_out, k_in, ratio = (
            validation.fem(f"{name}_{axis}_{boundary}")
            for name, boundary in (("K_out", "inputs_free"), ("K_in", "table_free"), ("lambda", "table_free"))
        )
        travel = f", travel {card.travel_text(validation, axis)}" if design.actuator else ""
        texts.append(
            f"{axes.label(axis)}: K_out {format_quantity(k_out)}, K_in {format_quantity(k_in)}, "
            f"amplification {format_quantity(ratio)}{travel}"
        )
    paragraphs.append(f"FEM of the whole stage gives {'; '.join(texts)}.")
    found = [*(comparison.fem for comparison in validation.comparisons), *validation.further]
    if missed := accuracy_text.not_reached(validation.study.mesh.accuracy, found):
        paragraphs.append(missed)
    best = stage_differences.nearest(validation)
    if best is not None:
        paragraphs.append(
            f"Of the variants, “{best}” comes nearest to the published numbers; the report says what it leaves "
            "unexplained."
        )
    if validation.motions:
        paragraphs.append(_coupling_in_short(validation, axes))
    return [*paragraphs, *stage_model_cautions(validation.stage_model)]


def _coupling_in_short(validation: StageValidation, axes: Axes) -> str:
    first = max((abs(v) for others in validation.causes[0].coupling.values() for v in others.values()), default=0.0)
    seen = [
        f"{axes.what(q)} {validation.fem(q.key).formatted()} at an {axes.where(q)}"
        for motion in validation.motions
        for q in motion.quantities()
        if q.name.startswith("coupling") and q.value and axes.is_listed(q)
    ]
    listed = ", ".join(seen) if seen else "none that symmetry leaves"
    return f"Coupling of first order is {first:.0e} of the travel as drawn; of second order there is {listed}."


def _table_1_text(validation: StageValidation) -> list[str]:
    axes = Axes(validation)
    same = [f"{a.upper()} is as {axes.head[a].upper()}, and listed with it" for a in axes.names if axes.head[a] != a]
    sources = {
        model: dict.fromkeys(q.source for c in validation.comparisons for m, q in c.analytic.items() if m == model)
        for model in dict.fromkeys(model for c in validation.comparisons for model in computed_values(c))
    }
    listed = [
        f"{model}: {'; '.join(s for s in found if s)}." for model, found in sources.items() if set(found) - {"", model}
    ]
    return [
        "K_out is the stiffness that a force on the table meets, all inputs free; K_in that of one actuator as all of "
        "its axis push or pull at once, the table free; λ the table's travel over that actuator's extension. Coupling "
        f"is the motion aside of second order, per travel.{''.join(f' {each}.' for each in same)}",
        *listed,
    ]


def _stage_model(validation: StageValidation) -> Section:
    model = validation.stage_model
    if model is None:
        return Section("Stage model")
    rows = [
        [
            name,
            units.to_text(axis.mass or 0.0, "g", si="kg"),
            units.to_text(axis.stiffness or 0.0, "N/mm", si="N/m"),
            units.to_text(axis.gain or 0.0, "um/V", si="m/V"),
            units.significant(axis.amplification or 0.0),
            units.to_text(axis.input_stiffness or 0.0, "N/mm", si="N/m"),
            units.to_text(axis.natural_frequency, "Hz"),
        ]
        for name, axis in model.axes.items()
    ]
    columns = ["axis", "mass", "stiffness", "gain", "amplification", "K_in", "frequency"]
    text = (
        "stage_model.toml next to this report has these numbers and the couplings of second order; `flexdesign "
        "simulate` runs it. Stiffness with actuators installed; mass from it and the mode with the largest share of "
        "the static stroke. Damping is a placeholder: geometry does not determine it."
    )
    if any("bouc_wen" in axis.effects for axis in model.axes.values()):
        text += (
            " The hysteresis is that of the free stack, as the design has it, times travel per free stroke; the gain "
            "is k_v of eq (26), larger than travel over voltage by what hysteresis holds back."
        )
    return Section("Stage model for simulations", [text, *stage_model_cautions(model)], [Table(columns, rows)])


def _meshes(validation: StageValidation) -> Section:
    rows = []
    for number, level in enumerate(validation.levels, 1):
        for kind, (name, _) in zip(level.kinds, _kinds(validation), strict=True):
            origin = ", cached" if kind.cached else ""
            rows.append(
                [f"{number}", name, f"{kind.elements}", kind.method, f"{kind.part.unknowns} × {kind.copies}",
                 f"{len(kind.part.stiffness)}", _resolution_text(kind), f"{kind.seconds:.1f} s{origin}"]
            )  # fmt: skip
    whole, small = validation.finest.unknowns, validation.stages[-1].size
    scatter = convergence.describe(validation.scatter)
    text = (
        "Each kind of part is meshed once, on its fundamental domain, and condensed to its ports. On the finest mesh "
        f"the whole stage would have {whole / 1e6:.3g} million unknowns, without its bodies; assembled from "
        f"condensed parts it has {small}. {scatter} Wall time of this run: {validation.seconds:.0f} s."
    )
    columns = ["mesh", "part", "elements", "method", "unknowns × images", "amplitudes", "mesh check", "time"]
    caption = "Mesh check: the largest deviation of a hinge's thickness on the mesh from that drawn"
    return Section("Meshes and checks", [text], [Table(columns, rows, caption)])


def _resolution_text(kind: Kind) -> str:
    worst = max((abs(check.deviation) for check in kind.hinges), default=0.0)
    limit = max((check.limit for check in kind.hinges), default=0.0)
    return f"{100 * worst:.1g} % of {100 * limit:g} % allowed"


def _kinds(validation: StageValidation) -> list[tuple[str, int]]:
    from flexdesign.fem.quantities.stage_shares import kind_name

    return [(kind_name(piece, elements), len(elements)) for piece, elements in validation.assembly.kinds()]


def _assumptions(validation: StageValidation) -> Section:
    assembly = validation.assembly
    moving = len(assembly.free_bodies)
    text = [
        f"{len(assembly.elements)} parts bend; {moving} bodies between them are rigid, with the material's density, "
        "and the frame does not move. The drawn stubs of hinges are elastic, and their ends follow the "
        "body's motion.",
        "Actuators act along the line between their input faces, and hold nothing sideways. Parts are free of stress "
        "at rest. Bodies move freely; within a part displacements are kept to second order.",
        "Estimated errors are those of the discretisation alone. Dimensions, modulus and assembly have their own.",
    ]
    return Section("What is assumed", text)


def _inputs(validation: StageValidation) -> Section:
    made = provenance(validation.study, _methods(validation))
    described = {p.name: p for p in validation.study.design.part_class.dimensions}
    dimensions = [
        [name, value, described[name].symbol, described[name].meaning] for name, value in made["dimensions"].items()
    ]
    keys = ("provenance", "stage", "material", "actuator", "mesh", "inputs", "variants", "versions")
    other = [[key, flat(made[key])] for key in keys if made[key]]
    tables = [Table(["dimension", "value", "symbol", "meaning"], dimensions), Table(["input", "value"], other)]
    return Section("Inputs and versions", (), tables, folded=True)


def _methods(validation: StageValidation) -> set[str]:
    return {kind.method for level in validation.levels for kind in level.kinds}


def result(validation: StageValidation) -> dict[str, Any]:
    """Return result.json's content: every number with its unit, and what made it."""
    return {
        **header("stage validation"),
        "headline": card.quantities_of_stage(validation),
        "quantities": [
            c.fem.to_json() | {"analytic": {m: q.to_json() | {"error": c.error(m)} for m, q in c.analytic.items()}}
            for c in validation.comparisons
        ]
        + [quantity.to_json() for quantity in validation.further],
        "springs": {
            axis: [{"kind": s.kind, "count": s.count, "value": s.stiffness, "unit": "N/m"} for s in springs]
            for axis, springs in validation.springs.items()
        },
        "input_stiffness": {
            axis: {
                "load": chain.load, "formula": chain.formula, "amplifier": chain.amplifier, "stage": chain.stage,
                "unit": "N/m",
            }
            for axis, chain in validation.chains.items()
        },
        "theory_ladder": hierarchy_section.result(validation.hierarchy),
        "coupling": {
            "first_order": [_cause(cause) for cause in validation.causes],
            "second_order": [_motion(motion) for motion in [*validation.motions, *validation.at_full_stroke]],
        },
        "variants": {
            label: {key: quantity.to_json() for key, quantity in found.items()}
            for label, found in validation.variants.items()
        },
        "coarsest": {key: quantity.to_json() for key, quantity in validation.coarsest.items()},
        "modes": {
            state: [_mode(mode) for mode in found]
            for state, found in zip(("inputs free", "actuators installed"), validation.modes, strict=True)
        },
        "meshes": [
            {
                "element_size": with_unit(level.size, "m"),
                "unknowns": level.unknowns,
                "kinds": [_kind(kind, name) for kind, (name, _) in zip(level.kinds, _kinds(validation), strict=True)],
            }
            for level in validation.levels
        ],
        "assembled_unknowns": validation.stages[-1].size,
        "made_by": provenance(validation.study, _methods(validation)),
    }  # fmt: skip


def _cause(cause: Cause) -> dict[str, Any]:
    coupling = {axis: dict(others) for axis, others in cause.coupling.items()}
    return {"name": cause.name, "assumed": cause.assumed, "coupling": coupling, "unit": "1"}


def _motion(motion: CrossMotion) -> dict[str, Any]:
    return {
        "axis": motion.axis,
        "input": with_unit(motion.extension, "m"),
        "force": with_unit(motion.force, "N"),
        "travel": with_unit(motion.travel, "m"),
        "even": dict(motion.even) | {"unit": "m"},
        "odd": dict(motion.odd) | {"unit": "m"},
        "turned": with_unit([float(angle) for angle in motion.turned], "rad"),
    }


def _mode(mode: ModeShares) -> dict[str, Any]:
    return {
        "frequency": with_unit(mode.mode.frequency, "Hz"),
        "answers": dict(mode.participation) | {"unit": "1"},
        "table": dict(mode.table) | {"unit": "1"},
    }


def _kind(kind: Kind, name: str) -> dict[str, Any]:
    return {
        "name": name,
        "method": kind.method,
        "elements": kind.elements,
        "unknowns": kind.part.unknowns,
        "images": kind.copies,
        "hinge_deviation": max((abs(check.deviation) for check in kind.hinges), default=0.0),
        "seconds": kind.seconds,
        "cached": kind.cached,
    }

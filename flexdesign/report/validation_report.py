"""The report of a validation: Table 1, where the models differ and why, pictures, what stands behind the numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from flexdesign import quantities, units
from flexdesign.files import FORMAT
from flexdesign.report import charts, explanation, validation_pictures
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.pictures import NoPictures
from flexdesign.report.wording import name_of, shown
from flexdesign.validation import Validation, provenance

Progress = Callable[[str], None]


def table_1(validation: Validation) -> Table:
    """Return FEM beside the analytic models, with relative errors."""
    models = list(validation.comparisons[0].analytic)
    columns = ["quantity", "boundary", "FEM"]
    for model in models:
        columns += [model, "error"]
    rows = []
    for comparison in validation.comparisons:
        row = [name_of(comparison.fem), comparison.fem.boundary, shown(comparison.fem)]
        for model in models:
            analytic, error = comparison.analytic.get(model), comparison.error(model)
            row += [analytic.shown() if analytic else "–", f"{100 * error:+.1f} %" if error is not None else "–"]
        rows.append(row)
    return Table(columns, rows, "FEM ± estimated discretisation error; errors relative to FEM")


def result(validation: Validation) -> dict[str, Any]:
    """Return result.json's content: every number with its unit, and what made it."""
    return {
        "format": FORMAT,
        "kind": "validation",
        "quantities": [
            c.fem.to_json() | {"analytic": {m: q.to_json() | {"error": c.error(m)} for m, q in c.analytic.items()}}
            for c in validation.comparisons
        ]
        + [quantity.to_json() for quantity in validation.further],
        "compliance_shares": {
            key: {"unit": "m/N", "FEM": dict(split), "PRB": dict(validation.formula_shares.get(key, {}))}
            for key, split in validation.shares.items()
        },
        "modes": [
            {
                "frequency": {"value": m.frequency, "unit": "Hz"},
                "output_mass": {"value": m.output_mass if math.isfinite(m.output_mass) else None, "unit": "kg"},
                "symmetry": m.symmetry,
                "actuator_installed": m.installed,
            }
            for m in validation.modal.solution.modes
        ],
        "meshes": [
            {
                **level.solution.facts,
                "edge_at_roots": {"value": level.size, "unit": "m"},
                "K_in": {"value": level.solution.compliance.input_stiffness, "unit": "N/m"},
                "amplification": level.solution.compliance.amplification,
                "K_out_input_free": {"value": level.solution.compliance.output_stiffness(0.0), "unit": "N/m"},
                "checks": vars(level.solution.checks),
                "cached": level.cached,
            }
            for level in validation.levels
        ],
        "hinges": [
            {
                "name": h.hinge.name,
                "thickness": h.hinge.thickness,
                "unit": "m",
                "deviation": h.deviation,
                "limit": h.limit,
            }
            for h in validation.finest.hinges
        ],
        "made_by": provenance(validation.study),
    }


def document(validation: Validation, progress: Progress = lambda _: None) -> Document:
    """Write the report of a validation, pictures included where they can be drawn."""
    progress("drawing")
    figures: list[Figure] = []
    missing = ""
    try:
        figures = validation_pictures.draw(validation)
    except NoPictures as error:
        missing = f"No pictures: {error}."
        progress(missing)
    sections = [
        Section("FEM beside formulas", _table_1_text(validation), [table_1(validation)]),
        Section("Shape and deformation", [missing] if missing else [], figures=figures),
        explanation.section(validation),
        _actuator(validation),
        _coupling(validation),
        _modes(validation),
        _stress(validation),
        _mesh(validation),
        _formulas(validation),
        _inputs(validation),
    ]
    told = [s for s in sections if s.tables or s.figures or s.paragraphs]
    return Document(f"{validation.study.design.title}: validation", _summary(validation), told)


def _summary(validation: Validation) -> list[str]:
    design = validation.study.design
    k_in, ratio = validation.fem("K_in_output_free"), validation.fem("lambda_output_free")
    text = f"FEM gives an input stiffness of {shown(k_in)} and an amplification of {shown(ratio)}, output free"
    if design.actuator:
        travel = shown(validation.fem("stroke_output_free"))
        text += f"; with the actuator ({design.actuator.name}) in place the output travels {travel}"
    paragraphs = [f"{text}.", explanation.why(validation, "K_in_output_free")]
    if ratio.value < 0:
        paragraphs.append("The amplification is negative: as the actuator extends, the output is drawn in.")
    if design.provenance:
        paragraphs.append(f"Note on this design: {design.provenance}.")
    return [paragraph for paragraph in paragraphs if paragraph]


def _table_1_text(validation: Validation) -> list[str]:
    sources: dict[str, list[str]] = {}
    for comparison in validation.comparisons:
        for model, quantity in comparison.analytic.items():
            sources.setdefault(model, []).append(quantity.source)
    return [
        "Stiffness depends on what holds the other port, so every row names its boundary. Forces act as uniform "
        "tractions on the port faces, displacements are area averages; the ground face is held.",
        *(f"{model}: {'; '.join(dict.fromkeys(found))}." for model, found in sources.items()),
    ]


def _actuator(validation: Validation) -> Section:
    actuator = validation.study.design.actuator
    if actuator is None:
        return Section("With the actuator")
    keys = ("stroke", "blocked_force", "actuator_force", "preload_shift", "output_force_that_unloads_the_stack")
    rows = [[name_of(q), q.boundary, shown(q)] for q in validation.further if q.name in keys]
    stroke, blocked = validation.fem("stroke_output_free"), validation.fem("blocked_force_output_held")
    stiffness, holding = validation.fem("K_out_actuator_installed").value, -blocked.value
    curves = [("full voltage", [0.0, holding], [stroke.value * 1e6, 0.0])]
    if actuator.preload > 0:
        lost = validation.fem("output_force_that_unloads_the_stack_no_voltage").value
        ends = [lost, holding]
        curves.append(("no voltage, from where the preload is used up", ends, [p / stiffness * 1e6 for p in ends]))
    drawing = charts.lines(curves, "external force on the output along its normal [N]", "output motion [µm]")
    text = (
        f"{actuator.name}: free stroke {units.to_text(actuator.free_stroke, 'um', si='m')}, stack and seats in series "
        f"{units.to_text(actuator.installed_stiffness, 'N/um', si='N/m')}, "
        f"preload {units.to_text(actuator.preload, 'N')}. Along the load line the energised stage is a spring of "
        "stiffness K_out with the actuator installed. An output force beyond the one that uses up the preload parts "
        "the stack from its seats."
    )
    figure = Figure("load_line.svg", drawing, "Load lines; the one at full voltage ends at the blocked force")
    return Section("With the actuator", [text], [Table(["quantity", "boundary", "FEM"], rows)], [figure])


def _coupling(validation: Validation) -> Section:
    found = [q for q in validation.further if q.name.startswith("coupling") or q.name == "tilt"]
    text = (
        "Linear coupling of a symmetric part is zero while the actuator pushes on its axis, and stays zero where it is "
        "off the axis within a symmetry plane. The second-order coupling, which grows with the square of travel, is "
        "not in a linear solve."
    )
    rows = [[name_of(q), q.boundary, shown(q)] for q in found]
    return Section("Coupling", [text], [Table(["quantity", "boundary", "FEM"], rows)])


def _modes(validation: Validation) -> Section:
    level, actuator = validation.modal, validation.study.design.actuator
    spring = actuator.installed_stiffness if actuator else 0.0
    rows = []
    for installed, state in ((False, "no"), (True, "yes")):
        for mode in [m for m in level.solution.modes if m.installed == installed][:6]:
            share = quantities.output_share(mode, level.solution.compliance, spring)
            driven = quantities.drive_share(mode, level.solution.compliance, spring)
            moved = f"{100 * share:.0f} %" if share > 0 else "output at rest"
            answer = f"{round(100 * driven)} %" if installed and share > 0 else "–"
            rows.append([f"{units.significant(mode.frequency, 4)} Hz", state, mode.symmetry, moved, answer])
    keys = ("first_frequency", "output_frequency", "output_share")
    limits = [[name_of(q), q.boundary, shown(q)] for q in validation.further if q.name in keys]
    text = (
        "Ground held. The actuator is a spring between the input blocks that holds nothing sideways, and has no mass "
        "here: the frequencies are upper bounds for modes that move the input blocks. The second table lists single "
        f"modes on one mesh ({level.solution.facts['unknowns']} unknowns), before extrapolation. What a mode answers "
        "the actuator with is its part of the output's static motion under voltage, negative where it moves the output "
        "the other way; all modes together make 100 %."
    )
    tables = [
        Table(["quantity", "boundary", "FEM"], limits),
        Table(["frequency", "actuator", "symmetry", "carries of 1/K_out", "answers the actuator with"], rows),
    ]
    return Section("Natural frequencies", [text], tables)


def _stress(validation: Validation) -> Section:
    names = ("hinge_stress", "peak_stress", "safety_against_yield")
    found = [q for q in validation.further if q.name in names]
    material = validation.study.design.material
    rows = [[name_of(q), q.boundary, shown(q)] for q in found]
    strength = units.to_text(material.yield_strength, "MPa", 3, si="Pa")
    text = [
        f"Yield strength of {material.name}: {strength} ({material.source}). The nominal hinge stress is N/A + M t/2I "
        "from the section forces that FEM's stresses add up to.",
    ]
    if validation.sharp:
        finest = validation.finest.solution.von_mises.max()
        peaks = ", ".join(f"{level.solution.von_mises.max() / finest:.2f}" for level in validation.levels)
        text.append(
            "The hinge roots are drawn sharp, and there the stress of linear elasticity grows without bound as the "
            f"mesh is refined (peaks of these meshes relative to the finest: {peaks}). The peak, which has no error "
            "for that reason, is no property of the design. Judge by the nominal hinge stress, or give the roots the "
            "fillet that the cutter will leave (dimensions.fillet_radius)."
        )
    return Section("Stress", text, [Table(["quantity", "at", "FEM"], rows)])


def _mesh(validation: Validation) -> Section:
    rows, checks = [], []
    for level in validation.levels:
        facts, c, seen = level.solution.facts, level.solution.compliance, level.solution.checks
        rows.append(
            [
                f"{facts['unknowns']}",
                f"{facts['tetrahedra']}",
                f"{level.size * 1e6:.0f} um",
                f"{facts['worst quality']:.2f}",
                units.to_text(c.input_stiffness, "N/mm", 5, si="N/m"),
                units.significant(c.amplification, 5),
                units.to_text(c.output_stiffness(0.0), "N/mm", 5, si="N/m"),
                f"{level.seconds:.0f} s" + (", cached" if level.cached else ""),
            ]
        )
        errors = (seen.reciprocity, seen.balance, seen.energy, seen.residual)
        checks.append([f"{facts['unknowns']}", *(f"{error:.1e}" for error in errors)])
    hinges = [
        [
            h.hinge.name,
            units.to_text(h.hinge.thickness, "mm", si="m"),
            f"{100 * h.deviation:.1g} %",
            f"{100 * h.limit:g} %",
        ]
        for h in validation.finest.hinges
    ]
    planes = ", ".join(f"{plane.axis} = 0" for plane in validation.domain.planes) or "none"
    text = (
        f"Quadratic tetrahedra with straight edges on the fundamental domain (symmetry planes: {planes}), solved by "
        f"{validation.finest.solution.facts['solver']}. Unknowns are those of the domain; the whole part has "
        f"{validation.domain.copies} times as many. {validation.extrapolation} {_index(validation)}"
    )
    head = ["unknowns", "tetrahedra", "edge at roots", "worst quality", "K_in", "λ", "K_out input free", "time"]
    exact = ["unknowns", "reciprocity", "force balance", "energy", "residual"]
    tables = [
        Table(head, rows, "As solved, before extrapolation"),
        Table(exact, checks, "Relative errors of what must hold exactly"),
        Table(["hinge", "drawn", "deviation", "allowed"], hinges, "Mesh gate: thickness measured on the finest mesh"),
    ]
    return Section("Meshes and checks", [text], tables)


def _index(validation: Validation) -> str:
    limit = validation.limit(lambda solution: solution.compliance.input_stiffness)
    order = f"{limit.observed_order:.2g}" if math.isfinite(limit.observed_order) else "not monotonic"
    return (
        f"For K_in the finest mesh is {100 * (limit.finest / limit.value - 1):+.2f} % off the extrapolated value; its "
        f"grid convergence index (Roache, lowest order, safety factor 1.25) is {100 * limit.gci:.2g} %, the order "
        f"seen on the three finest meshes {order}."
    )


def _formulas(validation: Validation) -> Section:
    design = validation.study.design
    force, boundary = quantities.stated_force(validation.study, validation.finest.solution)
    found = design.part().intermediates(design.material, force)
    rows = [[name, q.shown(), q.boundary, q.source] for name, q in found.items()]
    text = f"At an actuator force of {units.to_text(force, 'N')} ({boundary}), with the output free."
    table = Table(["symbol", "value", "boundary", "equation"], rows)
    return Section("The pseudo-rigid-body model, step by step", [text], [table], folded=True)


def _inputs(validation: Validation) -> Section:
    made = provenance(validation.study)
    described = {p.name: p for p in validation.study.design.part_class.dimensions}
    dimensions = [
        [name, value, described[name].symbol, described[name].meaning] for name, value in made["dimensions"].items()
    ]
    keys = ("part", "material", "actuator", "mesh", "modes", "output", "versions")
    other = [[key, _flat(made[key])] for key in keys]
    tables = [Table(["dimension", "value", "symbol", "meaning"], dimensions), Table(["input", "value"], other)]
    return Section("Inputs and versions", (), tables, folded=True)


def _flat(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_flat(item)}" for key, item in value.items())
    if isinstance(value, (list, tuple)):
        return " to ".join(map(_flat, value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)

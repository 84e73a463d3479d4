"""The report of a validation: Table 1, where the models differ and why, pictures, what stands behind the numbers."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from flexdesign.core import units
from flexdesign.core.model import Quantity
from flexdesign.core.serialise import header, with_unit
from flexdesign.design.part import states
from flexdesign.dynamics.experiments.simulation import stage_model_cautions
from flexdesign.fem import quantities
from flexdesign.fem.meshing import methods
from flexdesign.fem.meshing.local_thickness import AT_ROOT, LocalThickness
from flexdesign.fem.solving.statics import PortCompliance
from flexdesign.report import accuracy_text, charts, strength_text
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.pictures import draw_or_explain
from flexdesign.report.validation import (
    card,
    cross_check_text,
    explanation,
    hierarchy_section,
    independent_text,
    port_section,
    solid_section,
    table_1,
    table_motion,
    validation_pictures,
    vibrations,
)
from flexdesign.report.wording import flat, format_quantity, name_of
from flexdesign.workflows.validation import Validation, provenance

Progress = Callable[[str], None]
#: How meshes of a method are called.
METHODS = {"extruded": "layers of prisms cut into tetrahedra, thin across the roots", "wild": "isotropic"}


def closing(validation: Validation) -> str:
    """Say how long it took, and what the cache had."""
    cached = sum(level.cached for level in validation.levels)
    origin = f"{cached} of {len(validation.levels)} solutions came from the cache" if cached else "nothing was cached"
    return f"Solved in {validation.seconds:.0f} s; {origin}."


def result(validation: Validation) -> dict[str, Any]:
    """Return result.json's content: every number with its unit, and what made it."""
    first = next((model for c in validation.comparisons for model in c.analytic), "PRB")
    return {
        **header("validation"),
        "headline": card.quantities(validation),
        "warnings": [*card.warnings(validation), *_accuracy(validation)],
        "quantities": [
            c.fem.to_json() | {"analytic": {m: q.to_json() | {"error": c.error(m)} for m, q in c.analytic.items()}}
            for c in validation.comparisons
        ]
        + [quantity.to_json() for quantity in validation.further],
        "compliance_shares": {
            key: {"unit": "m/N", "FEM": dict(split), first: dict(validation.formula_shares.get(key, {}))}
            for key, split in validation.shares.items()
        },
        "strain_energy_shares": strength_text.shares(validation),
        "theory_ladder": hierarchy_section.result(validation.hierarchy),
        "mass": with_unit(validation.modal.solution.facts["mass"], "kg"),
        "modes": [vibrations.result(mode) for mode in validation.modal.solution.modes],
        "meshes": [
            {
                **level.solution.facts,
                "element_size": with_unit(level.size, "m"),
                **_of_input(level.solution.compliance),
                "K_out_input_free": with_unit(level.solution.compliance.output_stiffness(0.0), "N/m"),
                "volume_deviation": solid_section.volume_deviation(validation, level),
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
                "bending": h.bending,
                "strain_energy_share": h.share,
            }
            for h in validation.finest.hinges
        ],
        "port_stiffness": port_section.result(validation),
        "cross_check": cross_check_text.result(validation.cross_check),
        "independent_mesh": independent_text.result(validation.independent),
        "made_by": provenance(validation.study, validation.methods, validation.solvers),
    }


def _of_input(c: PortCompliance) -> dict[str, Any]:
    """Return what one mesh says of the inputs, where there are any."""
    if not c.has_input:
        return {}
    return {"K_in": with_unit(c.input_stiffness, "N/m"), "amplification": c.amplification}


def document(validation: Validation, progress: Progress = lambda _: None) -> Document:
    """Write the report of a validation, pictures included where they can be drawn."""
    title = f"{validation.study.design.title}: validation"
    sections = partial(_sections, validation, progress)
    return Document(
        title, _summary(validation), sections, card.facts(validation), card.warnings(validation), "deformation.png"
    )


def _sections(validation: Validation, progress: Progress) -> list[Section]:
    progress("drawing")
    still, vibrating, missing = draw_or_explain(lambda: validation_pictures.draw(validation), progress)
    sections = [
        *_fem_alone(validation),
        port_section.section(validation),
        Section("Shape and deformation", missing, figures=still),
        _stress(validation),
        _actuator(validation),
        _large(validation),
        vibrations.section(validation, vibrating),
        explanation.section(validation),
        hierarchy_section.section(validation),
        table_motion.section(validation),
        _mesh(validation),
        cross_check_text.section(validation.cross_check),
        independent_text.section(validation.independent),
        _formulas(validation),
        solid_section.section(validation),
        _inputs(validation),
    ]
    return [s for s in sections if s.tables or s.figures or s.paragraphs]


def _fem_alone(validation: Validation) -> list[Section]:
    """Return Table 1, of a part without formulas FEM alone."""
    if not validation.has_input:
        return []
    title = "FEM and formulas" if validation.comparisons else "FEM; the part gives no formulas"
    return [Section(title, table_1.text(validation), [table_1.table(validation)])]


def _summary(validation: Validation) -> list[str]:
    design = validation.study.design
    if not validation.has_input:
        return port_section.summary(validation)
    k_in, ratio = validation.fem("K_in_output_free"), validation.fem("lambda_output_free")
    text = f"FEM gives an input stiffness of {format_quantity(k_in)} and an amplification of {format_quantity(ratio)}"
    text += ", output free"
    if design.actuator:
        text += f"; with the actuator ({design.actuator.name}) in place the output travels "
        text += card.stroke_text(validation)
    paragraphs = [f"{text}.", *_accuracy(validation), explanation.why(validation, "K_in_output_free", first=True)]
    if ratio.value < 0:
        paragraphs.append("The amplification is negative: as the actuator extends, the output is drawn in.")
    if validation.cross_check is not None:
        paragraphs.append(cross_check_text.verdict(validation.cross_check))
    if validation.independent is not None:
        paragraphs.append(independent_text.verdict(validation.independent))
    if design.provenance:
        paragraphs.append(f"Note on this design: {design.provenance}.")
    paragraphs += stage_model_cautions(validation.stage_model)
    return [paragraph for paragraph in paragraphs if paragraph]


def _accuracy(validation: Validation) -> list[str]:
    """Say that the accuracy that was asked for is not reached."""
    sentences = accuracy_text.not_reached(validation.study.mesh.accuracy, validation.found)
    return [sentences] if sentences else []


def _actuator(validation: Validation) -> Section:
    actuator = validation.study.design.actuator
    if actuator is None:
        return Section("With the actuator")
    keys = ("stroke", "blocked_force", "actuator_force", "preload_shift", "output_force_that_unloads_the_stack")
    found = [q for q in validation.further if q.name in keys and "large" not in q.boundary]
    rows = [
        [f"{name_of(q)}, linear" if q.name == "stroke" else name_of(q), q.boundary, format_quantity(q)] for q in found
    ]
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
        "stiffness K_out with the actuator installed. A larger output force than the one that uses up the preload "
        "separates the stack from its seats."
    )
    figure = Figure("load_line.svg", drawing, "Load lines; the one at full voltage ends at the blocked force")
    return Section("With the actuator", [text], [Table(["quantity", "boundary", "FEM"], rows)], [figure])


def _large(validation: Validation) -> Section:
    large = validation.large
    if large is None:
        return Section("Over the stroke")
    path, drive, shown_in = large.path, 100 * large.drive, units.to_text
    rows = [
        [
            f"{drive[i]:.0f} %",
            shown_in(path.force[i], "N", 4),
            shown_in(path.extension[i], "um", 4, si="m"),
            shown_in(path.output[i], "um", 4, si="m"),
            shown_in(path.input_stiffness[i], "N/mm", 4, si="N/m"),
            units.significant(path.amplification[i], 4),
            shown_in(large.output_stiffness[i], "N/mm", 4, si="N/m"),
        ]
        for i in range(len(drive))
    ]
    names = ("K_in_change", "lambda_change", "K_out_change")
    selected = [q for q in validation.further if q.name in names or "large" in q.boundary]
    curves = [
        ("K_in", drive.tolist(), (100 * (path.input_stiffness / path.input_stiffness[0] - 1)).tolist()),
        ("λ", drive.tolist(), (100 * (path.amplification / path.amplification[0] - 1)).tolist()),
        ("K_out", drive.tolist(), (100 * (large.output_stiffness / large.output_stiffness[0] - 1)).tolist()),
    ]
    text = (
        "Large displacements, followed in steps of force on the coarsest mesh, from rest without preload: as the arms "
        "turn, stiffnesses and amplification change. Each row has the tangents there. The stroke is the extrapolated "
        f"linear one times {large.full_stroke / large.linear_stroke:.5g}, the ratio of the nonlinear to the linear "
        "stroke on that mesh. The stage model contains these changes as quadratic and cubic stiffness and as a slope "
        "of the amplification."
    )
    columns = ["drive", "force", "extension", "output", "K_in", "λ", "K_out, actuator installed"]
    drawing = charts.lines(curves, "drive [% of full voltage]", "change against rest [%]")
    figure = Figure("over_the_stroke.svg", drawing, "Tangents over the stroke against those at rest")
    limits = Table(["quantity", "boundary", "FEM"], [[name_of(q), q.boundary, format_quantity(q)] for q in selected])
    return Section("Over the stroke", [text], [limits, Table(columns, rows)], [figure])


def _stress(validation: Validation) -> Section:
    if not validation.has_input:
        return port_section.strength(validation)
    names = ("hinge_stress", "peak_stress", "peak_tension", "safety_against_yield", "safety_against_fatigue")
    rows = [[name_of(q), q.boundary, _strength_text(q)] for q in validation.further if q.name in names]
    text = [
        *strength_text.strengths(validation.study.design.material),
        "The nominal hinge stress is N/A + M t/2I from the section forces that FEM's stresses add up to.",
        strength_text.peak(validation),
    ]
    if not validation.has_members:
        text[-2] = "The part names no members, so no nominal stress is stated; the peak is that on its thin regions."
    tables = [Table(["quantity", "at", "FEM"], rows)]
    if validation.has_members:
        tables.append(strength_text.energies(validation))
    return Section("Stress and strain energy", text, tables)


def _strength_text(quantity: Quantity) -> str:
    """Write a stress or a margin; a number that belongs to the mesh alone as such."""
    verdict = ", singular: grows with refinement, use a fillet" if "singular" in quantity.source else ""
    verdict = verdict or (", not resolved at a fillet" if "not resolved" in quantity.source else "")
    return f"{format_quantity(quantity)}{verdict}"


def _loose(validation: Validation) -> str:
    """Say how many vertices the mesher's tolerance alone keeps at the surface, if any."""
    counts = [level.solution.facts.get("loose vertices", 0) for level in validation.levels]
    if not any(counts):
        return ""
    shown = ", ".join(str(count) for count in counts)
    return (
        f"Where faces cross, {shown} vertices of the meshes lie off their CAD faces, by no more than mesh.envelope and "
        "the chord of the tessellation; elements there would have turned inside out. "
    )


def _mesh(validation: Validation) -> Section:
    rows, checks = [], []
    for level in validation.levels:
        facts, c, seen = level.solution.facts, level.solution.compliance, level.solution.checks
        rows.append(
            [
                f"{facts['unknowns']}",
                f"{facts['tetrahedra']}",
                f"{level.size * 1e6:.0f} um",
                f"{facts['worst quality']:.2g}",
                *(
                    [units.to_text(c.input_stiffness, "N/mm", 5, si="N/m"), units.significant(c.amplification, 5)]
                    if c.has_input
                    else []
                ),
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
        f"Quadratic tetrahedra with straight edges on the fundamental domain (symmetry planes: {planes}), "
        f"{METHODS[validation.method.name]}{_meshers(validation)}{_lengthened(validation)}, solved by "
        f"{validation.finest.solution.facts['solver']}{_memory(validation)}. Unknowns are those of "
        f"the domain; the whole part has {validation.domain.copies} times as many. {validation.extrapolation} "
        f"{_index(validation)}{_loose(validation)}"
        f"{accuracy_text.reached(validation.study.mesh.accuracy, validation.found)}"
    )
    of_input = ["K_in", "λ"] if validation.has_input else []
    head = ["unknowns", "tetrahedra", "element size", "worst quality", *of_input, "K_out input free", "time"]
    exact = ["unknowns", "reciprocity", "force balance", "energy", "residual"]
    tables = [
        Table(head, rows, "As solved, before extrapolation"),
        Table(exact, checks, "Relative errors of identities that must hold exactly"),
        Table(["hinge", "drawn", "deviation", "allowed"], hinges, "Mesh check: thickness measured on the finest mesh"),
    ]
    return Section("Meshes and checks", [text], [table for table in tables if table.rows])


def _meshers(validation: Validation) -> str:
    """Say which program made isotropic meshes, and which stood in for it."""
    made = [level.mesh.mesher for level in validation.levels if level.mesh.mesher]
    if len(set(made)) < 2:
        return f", by {made[0]}" if made else ""
    texts = [f"{made.count(name)} by {name}" for name in dict.fromkeys(made)]
    return f", {' and '.join(texts)}, as Netgen made no mesh"


def _lengthened(validation: Validation) -> str:
    """Say by how much edges are longer than usual, as there would be too many."""
    method = validation.method
    if validation.study.mesh.at_root or method.name != "wild" or not isinstance(method, LocalThickness):
        return ""
    if method.at_root == AT_ROOT:
        return ""
    most = f"{methods.MOST_BY_DEFAULT:,.0f}".replace(",", " ")
    return (
        f", with edges {method.at_root / AT_ROOT:.3g} times as long as usual, as there would be more than {most} "
        f"tetrahedra (`mesh.at_root` changes that, now {method.at_root:.3g})"
    )


def _memory(validation: Validation) -> str:
    largest = max(level.solution.facts["factor bytes"] for level in validation.levels)
    return f", whose largest factor takes {largest / 2**30:.2g} GiB" if largest else ""


def _index(validation: Validation) -> str:
    if validation.has_input:
        name, limit = "K_in", validation.limit(lambda solution: solution.compliance.input_stiffness)
    else:
        name, limit = "K_out", validation.limit(lambda solution: solution.compliance.output_stiffness(0.0))
    order = f"{limit.observed_order:.2g}" if math.isfinite(limit.observed_order) else "not monotonic"
    return (
        f"For {name} the finest mesh is {100 * (limit.finest / limit.value - 1):+.2f} % off the extrapolated value; "
        f"its grid convergence index (Roache, lowest order, safety factor 1.25) is {100 * limit.gci:.2g} %, the order "
        f"observed on the three finest meshes {order}."
    )


def _formulas(validation: Validation) -> Section:
    design = validation.study.design
    if not validation.comparisons:
        return Section("The formulas, step by step")
    force, boundary = quantities.stated_force(validation.study, validation.finest.solution)
    part = design.part()
    found = part.intermediates(design.material, force) if states(part, "intermediates") else {}
    rows = [[name, q.formatted(), q.boundary, q.source] for name, q in found.items()]
    if not rows:
        return Section("The formulas, step by step", ["The part states no intermediate quantities."], folded=True)
    text = f"At an actuator force of {units.to_text(force, 'N')} ({boundary}), with the output free."
    table = Table(["symbol", "value", "boundary", "equation"], rows)
    return Section("The pseudo-rigid-body model, step by step", [text], [table], folded=True)


def _inputs(validation: Validation) -> Section:
    made = provenance(validation.study, validation.methods, validation.solvers)
    described = {p.name: p for p in validation.study.design.part_class.dimensions}
    dimensions = [
        [name, value, described[name].symbol, described[name].meaning] for name, value in made["dimensions"].items()
    ]
    keys = ("part", "material", "actuator", "mesh", "modes", "output", "versions")
    other = [[key, flat(made[key])] for key in keys if made[key] is not None]
    tables = [Table(["dimension", "value", "symbol", "meaning"], dimensions), Table(["input", "value"], other)]
    return Section("Inputs and versions", (), [table for table in tables if table.rows], folded=True)

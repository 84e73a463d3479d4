"""The card of a validation's report: the numbers that most readers look for, and what to know before using them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from flexdesign.core import units
from flexdesign.core.model import Quantity
from flexdesign.report.document import Fact
from flexdesign.report.validation import solid_section
from flexdesign.report.validation.stage_text import Axes
from flexdesign.report.wording import format_quantity, name_of
from flexdesign.workflows.validation import Validation
from flexdesign.workflows.validation.validate_stage import StageValidation

#: A stiffness or amplification that changes by more than this over the stroke is worth a warning.
CHANGES = 0.1
#: So is an estimated error of more than this, relative.
ERROR = 0.05
MARGINS = ("safety_against_yield", "safety_against_fatigue")


def facts(validation: Validation) -> list[Fact]:
    """Return the card of a part: stroke, stiffness, first frequency, safety, preload."""
    design, found = validation.study.design, _by_key(validation)
    boundary = _boundary(validation)
    if not validation.has_input:
        return _of_joint(found)
    card = [_stroke(validation)] if design.actuator else []
    card += [
        Fact(name_of(found[key]), format_quantity(found[key]), found[key].boundary)
        for key in ("K_in_output_free", "lambda_output_free", f"K_out_{boundary}", f"first_frequency_{boundary}")
        if key in found
    ]
    for quantity in margins(validation):
        at = quantity.boundary.partition(", ")[0] if design.actuator else quantity.boundary  # else at a force of 1 N
        card.append(Fact(name_of(quantity), format_quantity(quantity), at))
    if design.actuator:
        preload = units.to_text(design.actuator.preload, "N") if design.actuator.preload else "none"
        lost = found.get("output_force_that_unloads_the_stack_no_voltage")
        note = f"{replace(lost, half_width=None).formatted(3)} at the output unloads it" if lost else "of the actuator"
        card.append(Fact("preload", preload, note))
    return card


def _of_joint(found: Mapping[str, Quantity]) -> list[Fact]:
    """Return the card of a joint: its six stiffnesses, and the first frequency."""
    keys = [f"k_{motion}_other_motions_held" for motion in ("x", "y", "z", "rx", "ry", "rz")]
    return [
        Fact(name_of(found[key]), format_quantity(found[key]), found[key].boundary)
        for key in (*keys, "first_frequency_output_free")
        if key in found
    ]


def quantities(validation: Validation) -> dict[str, Any]:
    """Return the card's numbers as result.json has them: the better stroke first, the linear one as such."""
    found, boundary = _by_key(validation), _boundary(validation)
    keys = {
        "stroke": "stroke_output_free_large_displacements",
        "stroke_linear": "stroke_output_free",
        "K_in": "K_in_output_free",
        "amplification": "lambda_output_free",
        "K_out": f"K_out_{boundary}",
        "first_frequency": f"first_frequency_{boundary}",
    }
    if not validation.has_input:
        keys = {key: key for key in found if key.startswith("k_") and key.endswith("_held")}
        keys["first_frequency"] = "first_frequency_output_free"
    values = {name: found[key].to_json() for name, key in keys.items() if key in found}
    return values | {quantity.name: quantity.to_json() for quantity in margins(validation)}


def margins(validation: Validation) -> list[Quantity]:
    """Return the smallest safety against yield and against fatigue, if there are any."""
    found = {name: [q for q in validation.further if q.name == name] for name in MARGINS}
    return [min(each, key=lambda quantity: quantity.value) for each in found.values() if each]


def stroke_text(validation: Validation) -> str:
    """Return the stroke as headlines state it: with large displacements, and the linear one."""
    found = _by_key(validation)
    linear = format_quantity(found["stroke_output_free"])
    large = found.get("stroke_output_free_large_displacements")
    return f"{format_quantity(large)} with large displacements (linear: {linear})" if large else f"{linear} (linear)"


def warnings(validation: Validation) -> list[str]:
    """Return what a reader must know before using the numbers of a part, except for an accuracy not reached.

    The headline says that.
    """
    design, found = validation.study.design, _by_key(validation)
    remarks = [
        f"{name_of(quantity)} is {format_quantity(quantity)}, less than 1 ({quantity.boundary})."
        for quantity in margins(validation)
        if quantity.value < 1
    ]
    if design.material.yield_strength is None:
        remarks.append(f"No yield strength of {design.material.name} is known, so that no safety is stated.")
    elif validation.sharp and validation.domain.thin is not None:
        remarks.append(
            "A re-entrant edge next to a thin region is sharp: peak stress grows without bound as meshes refine."
        )
    elif validation.sharp:
        remarks.append(
            "Hinge roots are drawn sharp: the safety is that of the nominal hinge stress, without a notch factor."
        )
    if validation.unresolved_fillet:
        remarks.append(validation.unresolved_fillet)
    if validation.domain.thin is not None:
        remarks += solid_section.geometric_errors(validation)
    changes = [
        f"{name_of(q)} {format_quantity(q)}"
        for q in found.values()
        if q.name.endswith("_change") and "full drive" in q.boundary and abs(q.value) > CHANGES
    ]
    if changes:
        remarks.append(
            f"Stiffness and amplification are those at rest. On the way to full voltage: {', '.join(changes)}."
        )
    if design.actuator and validation.large is None:
        remarks.append("Large displacements were not followed: the stroke is the linear one.")
    asked = validation.study.mesh.accuracy
    if validation.estimated_error > ERROR and (asked is None or validation.estimated_error <= asked):
        remarks.append(
            f"The largest estimated error of a stiffness or amplification is {100 * validation.estimated_error:.2g} %."
        )
    return remarks


def facts_of_stage(validation: StageValidation) -> list[Fact]:
    """Return the card of a stage: travel and output stiffness of each axis, and the first frequency."""
    axes, found = Axes(validation), _by_key(validation)
    card = []
    for axis in axes.listed:
        label = axes.label(axis)
        if (travel := found.get(f"stroke_{axis}_table_free")) is not None:
            note = f"full voltage, table free{travel_change(validation, axis)}"
            card.append(Fact(f"travel {label}, linear", format_quantity(travel), note))
        boundary = "actuators installed" if validation.study.design.actuator else "inputs free"
        stiffness = found[f"K_out_{axis}_{boundary.replace(' ', '_')}"]
        card.append(Fact(f"stiffness K_out {label}", format_quantity(stiffness), boundary))
    for boundary in ("actuators installed", "inputs free"):
        first = found.get(f"frequency_1_{boundary.replace(' ', '_')}")
        if first is not None:
            card.append(Fact("first natural frequency", format_quantity(first), boundary))
            break
    return card


def travel_text(validation: StageValidation, axis: str) -> str:
    """Return the linear travel of an axis at full voltage, and what large displacements do to it."""
    return f"{format_quantity(validation.fem(f'stroke_{axis}_table_free'))} (linear{travel_change(validation, axis)})"


def travel_change(validation: StageValidation, axis: str) -> str:
    """Say by how much large displacements change the travel per input of an axis; empty if nobody followed them.

    How far the actuators get at full voltage is known of the linear stage alone, so that there is no better travel yet.
    """
    far = next((motion for motion in validation.at_full_stroke if motion.axis == axis), None)
    if far is None:
        return ""
    travel = next(q for q in far.quantities() if q.name == "travel")
    ratio = validation.fem(travel.key).value / far.extension / abs(validation.fem(f"lambda_{axis}_table_free").value)
    at = units.to_text(far.extension, "um", 3, si="m")
    return f"; large displacements change the travel per input by {100 * (abs(ratio) - 1):+.2g} % at an input of {at}"


def quantities_of_stage(validation: StageValidation) -> dict[str, Any]:
    """Return the card's numbers as result.json has them, travels as the linear ones that they are."""
    found = _by_key(validation)
    values: dict[str, Any] = {}
    boundary = "actuators_installed" if validation.study.design.actuator else "inputs_free"
    for axis in validation.assembly.axes:
        keys = {f"travel_{axis}_linear": f"stroke_{axis}_table_free", f"K_out_{axis}": f"K_out_{axis}_{boundary}"}
        values |= {name: found[key].to_json() for name, key in keys.items() if key in found}
    first = found.get(f"frequency_1_{boundary}")
    return values | ({"first_frequency": first.to_json()} if first is not None else {})


def _stroke(validation: Validation) -> Fact:
    found = _by_key(validation)
    linear = format_quantity(found["stroke_output_free"])
    large = found.get("stroke_output_free_large_displacements")
    if large is None:
        return Fact("stroke, linear", linear, "output free")
    return Fact("stroke, large displacements", format_quantity(large), f"linear: {linear}")


def _boundary(validation: Validation) -> str:
    """Return how keys call the input of a part as it is used: with its actuator, where it has one."""
    return "actuator_installed" if validation.study.design.actuator else "input_free"


def _by_key(validation: Validation | StageValidation) -> dict[str, Quantity]:
    return {q.key: q for q in (*(c.fem for c in validation.comparisons), *validation.further)}

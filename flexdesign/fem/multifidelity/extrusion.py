"""What both evaluators are made of: a design's fundamental domain as an extrusion, and how its section is graded."""

from __future__ import annotations

from collections.abc import Mapping

from flexdesign.core.errors import InputError
from flexdesign.design import part as parts
from flexdesign.design.design import Design
from flexdesign.design.part import Part
from flexdesign.design.study import MeshSettings
from flexdesign.fem.meshing import domain, methods, polygon_domain
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.methods import Extruded, Grading

#: Relative difference allowed between the volume of the outline drawn out and that of the solid.
TOLERANCE = 1e-6


def of_design(design: Design) -> tuple[Part, Domain]:
    """Return the part and its fundamental domain; the CAD kernel is asked only if the part does not state its outline.

    Raises
    ------
    InputError
        If the design is a whole stage or no extrusion, or cannot be built.
    """
    if design.is_stage:
        raise InputError(design.file, "part", None, "is a whole stage; sweep the design of one part")
    part = design.part()
    try:
        body = polygon_domain.of_part(part, material=design.material)
        if body is None:
            body = domain.of_part(part, material=design.material, chord=domain.chord(part))
    except InputError as error:
        file = parts.file_of(type(part)) if error.file == "part" else error.file
        raise InputError(file, error.field, error.value, error.remedy) from error
    if body.section is None:
        remedy = "the part does not declare itself prismatic, so that it has no section to mesh; sweep it by validate"
        raise InputError(parts.file_of(type(part)), "prismatic", None, remedy)
    return part, body


def require_solid(design: Design, part: Part, body: Domain) -> None:
    """Check a domain that was drawn out of an outline against the part's solid, once where a mesh is made anew.

    Raises
    ------
    InputError
        If their volumes or their ports differ.
    """
    if parts.straight_outline(part) is None:
        return
    solid = domain.of_part(part, material=design.material, chord=domain.chord(part))
    if solid.ports.keys() != body.ports.keys() or abs(body.volume / solid.volume - 1) > TOLERANCE:
        remedy = "is not the section of solid(); correct either, or return None"
        raise InputError(parts.file_of(type(part)), "outline", None, remedy)


def method(part: Part, body: Domain, settings: MeshSettings) -> Extruded:
    """Return how the section is graded and drawn out."""
    at_root, growth = methods.EXTRUDED_GRADING
    given = (settings.at_root or at_root, settings.growth or growth, settings.largest)
    return Extruded(Grading(body, part.linkage().members, *given))


def coordinates(design: Design) -> dict[str, float]:
    """Return what distinguishes designs in addition to the modulus, to which stiffnesses are in proportion."""
    known = dict(design.dimensions)
    if design.material.crystal is None:
        known["poissons_ratio"] = design.material.poissons_ratio
    return known


def distance(one: Mapping[str, float], other: Mapping[str, float]) -> float:
    """Return how far two designs lie apart: the root of the sum of squared relative differences.

    >>> distance({"width": 10.0, "fillet_radius": 0.0}, {"width": 11.0, "fillet_radius": 0.0})
    0.0952...
    """
    apart = [2 * (a - b) / (abs(a) + abs(b)) for a, b in ((one[name], other[name]) for name in one) if a != b]
    return float(sum(gap**2 for gap in apart) ** 0.5)

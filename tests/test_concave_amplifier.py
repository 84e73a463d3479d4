"""Concave bridge amplifiers: their limits, solid, ports and linkage, and finite elements beside formulas.

What is compared: the concave design with its convex counterpart, whose arms rise by as much as the others fall; finite
elements with the textbook bridge, and with the hexahedra of `studies.error_bars`, which share no code with them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.design import design
from flexdesign.design.materials import Material
from flexdesign.fem import analysis, convergence
from flexdesign.fem.meshing import domain, methods, resolution_gate
from flexdesign.fem.solving.statics import PortCompliance
from studies.error_bars import bridge
from studies.error_bars.bridge import Fineness

SHIPPED = ("bridge_amplifier", "lin2019_amplifier_xy", "lin2019_amplifier_z")
#: Concave, and slender, so that the formulas are good: leaves 16 times and rods 4 times as long as thick.
SLENDER = {
    "arm_offset": -1.6e-3,
    "arm_thickness": 6e-3,
    "hinge_length": 4e-3,
    "hinge_thickness": 0.25e-3,
    "width": 6e-3,
    "rod_length": 12e-3,
    "rod_thickness": 3e-3,
    "output_block_height": 8e-3,
    "ground_block_height": 8e-3,
}
RODLESS = {**SLENDER, "rod_length": 0.0, "input_block_height": 20e-3}
#: Of a mesh that is quickly solved, 1 being the finest of a validation: stiffnesses are 2 to 4 % above their limits.
COARSENESS = 2.2


def amplifier(changes: Mapping[str, float], name: str = "bridge_amplifier") -> Any:
    part: Any = design.read(design.find(name)).part()
    return replace(part, **changes)


def metal_of(name: str) -> Material:
    return design.read(design.find(name)).material


def mirrored(part: Any) -> Any:
    return replace(part, arm_offset=-part.arm_offset)


def contour_area(part: Any) -> float:
    """Return the area of the plan by its corners [m^2]."""

    def enclosed(upper: list[tuple[float, float]], lower: list[tuple[float, float]]) -> float:
        x, y = np.array([(0.0, upper[0][1]), *upper, *((x, -y) for x, y in reversed(lower)), (0.0, -lower[0][1])]).T
        return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))  # twice the right half

    outer = enclosed(part.outer_corners(part.output_block_height), part.outer_corners(part.ground_block_height))
    return outer - enclosed(part.inner_corners(), part.inner_corners())


# --- limits


@pytest.mark.parametrize(
    ("changes", "value", "remedy"),
    [
        ({"arm_offset": 0.0}, "0 mm", ("0.05 mm or more", "flat arms", "concave bridge is negative")),
        ({"arm_offset": 0.04e-3}, "0.04 mm", ("0.05 mm or more", "flat arms")),
        ({"arm_offset": -0.04e-3}, "-0.04 mm", ("at most -0.05 mm", "flat arms")),
        ({"arm_offset": math.nan}, "nan mm", ("-50 mm to 50 mm",)),
        ({"arm_offset": -17.1e-3, "rod_length": 30e-3}, "-17.1 mm", ("-17 mm or more", "steeper than 45 degrees")),
        ({"arm_offset": -2.9e-3}, "-2.9 mm", ("-2.8 mm or more", "into the actuator", "longer rods")),
        ({"arm_offset": -0.1e-3, "rod_length": 2.2e-3}, "-0.1 mm", ("0 mm or more", "longer rods")),
        (
            {"arm_offset": -1.9e-3, "rod_length": 0.0},
            "-1.9 mm",
            ("-1.8 mm or more", "the actuator's axis", "a higher input block"),
        ),
    ],
)
def test_what_cannot_be_built_is_refused(changes: dict[str, float], value: str, remedy: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as caught:
        amplifier(changes)
    assert (caught.value.field, caught.value.value) == ("dimensions.arm_offset", value)
    assert all(words in caught.value.remedy for words in remedy)


@pytest.mark.parametrize(
    "changes",
    [
        {"arm_offset": -0.05e-3},
        {"arm_offset": -2.8e-3},
        {"arm_offset": -17e-3, "rod_length": 19.2e-3},
        {"arm_offset": -1.8e-3, "rod_length": 0.0},
        {"arm_offset": -2.8e-3, "fillet_radius": 1.35e-3},
        {"arm_offset": -2.8e-3, "input_block_depth": 40e-3},
    ],
)
def test_at_the_limits_nothing_collides(changes: dict[str, float]) -> None:
    """One solid of the contour's area, whose blocks stay off the input block, and the actuator off all of them."""
    part = amplifier(changes)
    solid = part.solid()
    assert solid.isValid() and solid.ShapeType() == "Solid"
    area = contour_area(part) + 8 * 4 * (1 - math.pi / 4) * part.fillet_radius**2  # eight leaves, four fillets each
    assert solid.Volume() * 1e-9 == pytest.approx(area * part.width, rel=1e-9)
    lowest = min(y for _, y in part.inner_corners()[:-1]) if part.rod_length else part.inner_corners()[0][1]
    assert lowest > (part.input_block_height / 2 if part.rod_length else 0.0) - 1e-12


# --- solid, ports, linkage


@pytest.mark.parametrize("rods", [True, False])
@pytest.mark.parametrize("name", SHIPPED)
def test_a_concave_bridge_is_of_the_same_pieces_as_the_convex_one(name: str, rods: bool) -> None:
    """Arms are sheared and blocks are moved, which leaves the volume as it is."""
    convex = amplifier({} if rods else {"rod_length": 0.0, "input_block_height": 20e-3}, name)
    concave = mirrored(convex)
    solid = concave.solid()
    assert solid.isValid() and solid.ShapeType() == "Solid"
    assert solid.Volume() == pytest.approx(convex.solid().Volume(), rel=1e-12)
    assert solid.Volume() * 1e-9 == pytest.approx(contour_area(concave) * concave.width, rel=1e-12)
    assert concave.outer_hinge == convex.outer_hinge
    assert convex.inner_hinge[1] - concave.inner_hinge[1] == pytest.approx(2 * convex.arm_offset, rel=1e-12)
    for ours, theirs in zip(concave.linkage().members, convex.linkage().members, strict=True):
        assert (ours.name, ours.kind, ours.thickness) == (theirs.name, theirs.kind, theirs.thickness)
        assert math.dist(ours.start, ours.end) == pytest.approx(math.dist(theirs.start, theirs.end), rel=1e-12)


def test_hinges_are_found_where_the_solid_is_thin() -> None:
    """Just inside a leaf's surface there is material, just outside there is none."""
    import cadquery as cq

    part = amplifier({"arm_offset": -1.6e-3})
    solid = part.solid()
    for hinge in part.linkage().of_kind("hinge"):
        x, y, z = (1e3 * value for value in hinge.centre)
        half = 1e3 * part.hinge_thickness / 2
        assert [solid.isInside(cq.Vector(x, y + k * half, z)) for k in (-1.01, -0.99, 0.99, 1.01)] == [0, 1, 1, 0]


@pytest.mark.parametrize("radius", [0.0, 0.3e-3])
def test_ports_and_hinges_are_found_on_the_mesh(radius: float) -> None:
    part = amplifier({"arm_offset": -1.6e-3, "fillet_radius": radius})
    body, method = meshing(part)
    assert set(body.ports) == {"input_right", "output", "ground"}
    assert body.copies == 4 and body.section is not None
    measured = resolution_gate.check(method.mesh(COARSENESS), body, part.linkage().of_kind("hinge"))
    assert {check.hinge.name for check in measured} == {
        f"hinge_{end}_{at}" for end in ("inner", "outer") for at in ("ur", "lr")
    }


# --- formulas


@pytest.mark.parametrize("name", SHIPPED)
def test_lambda_is_signed_along_the_output_s_normal(name: str) -> None:
    metal, convex = metal_of(name), amplifier({}, name)
    ours, theirs = (part.formulas(metal, 60e6, 1e4) for part in (mirrored(convex), convex))
    for model in ("PRB", "textbook"):
        concave, other = ({q.key: q.value for q in found[model]} for found in (ours, theirs))
        assert concave["lambda_output_free"] > 0 > other["lambda_output_free"]
        assert concave["K_in_output_free"] > other["K_in_output_free"]
        assert concave["K_out_input_free"] == pytest.approx(other["K_out_input_free"], rel=1e-12)
    assert all(piece > 0 for shares in mirrored(convex).formula_shares(metal).values() for piece in shares.values())
    assert mirrored(convex).intermediates(metal, 10.0)["travel"].value < 0  # inwards


# --- finite elements


def meshing(part: Any) -> tuple[domain.Domain, methods.Extruded]:
    body = domain.of_part(part, chord=domain.chord(part))
    members = part.linkage().members
    return body, methods.Extruded(methods.Grading(body, members, *methods.EXTRUDED_GRADING, None))


@cache
def solved(part: Any, metal: Any, coarseness: float = COARSENESS) -> PortCompliance:
    body, method = meshing(part)
    return analysis.solve(part, metal, body, method.mesh(coarseness), all_classes=False).compliance


@pytest.mark.parametrize("dimensions", [SLENDER, RODLESS])
def test_finite_elements_beside_the_textbook_bridge(dimensions: dict[str, float]) -> None:
    """A little softer than the formulas, and by no more than the roots of leaves and rods make up.

    With a Poisson's ratio of zero wide leaves are beams, and all that the formulas leave out gives way. That is the
    roots above all: by these a leaf is longer by up to its thickness, a rod by up to its own.
    """
    part, metal = amplifier(dimensions), replace(metal_of("bridge_amplifier"), poissons_ratio=0.0)
    found, formulas = solved(part, metal), part.formulas(metal, None, None)["textbook"]
    expected = {q.key: q.value for q in formulas}
    assert found.amplification > 0
    roots = part.hinge_thickness / part.hinge_length
    if part.rod_length:
        rod = part.rod_length**3 / (3 * metal.youngs_modulus * part.width * part.rod_thickness**3 / 12)
        roots += rod * expected["K_in_output_free"] * ((1 + part.rod_thickness / part.rod_length) ** 3 - 1)
    assert 0 < expected["K_in_output_free"] / found.input_stiffness - 1 < roots
    assert 0 < expected["lambda_output_free"] / found.amplification - 1 < roots
    assert 0 < expected["K_out_input_free"] / found.output_stiffness(0.0) - 1 < roots


def test_rods_tell_concave_from_convex_in_finite_elements_as_in_the_formulas() -> None:
    """What the formulas leave out is nearly the same in both kinds; what is odd in l_y is theirs.

    That is l_y b, b being the rotation of a rod's tip per force, l_1^2 / 2EI: a root that makes the rod longer by half
    its thickness raises b by l_3 / l_1. Of K_out nothing is odd; the slope of the arms counts squared.
    """
    metal, convex = metal_of("lin2019_amplifier_xy"), amplifier({}, "lin2019_amplifier_xy")
    concave = mirrored(convex)
    ours, theirs = solved(concave, metal), solved(convex, metal)
    k_in = [
        {q.key: q.value for q in p.formulas(metal, None, None)["textbook"]}["K_in_output_free"]
        for p in (concave, convex)
    ]
    expected, found = k_in[0] / k_in[1] - 1, ours.input_stiffness / theirs.input_stiffness - 1
    assert found == pytest.approx(expected, rel=convex.rod_thickness / convex.rod_length)
    slope = convex.arm_offset / convex.arm_span
    assert ours.output_stiffness(0.0) == pytest.approx(theirs.output_stiffness(0.0), rel=slope**2)


@pytest.mark.slow
def test_error_estimates_contain_the_hexahedra() -> None:
    """Those of two meshes; of convex bridges the coarsest hexahedra are known to be right to 0.5 %."""
    metal, part = metal_of("lin2019_amplifier_xy"), mirrored(amplifier({}, "lin2019_amplifier_xy"))
    known = bridge.solve(part, metal.youngs_modulus, metal.poissons_ratio, fineness=Fineness.of(1))
    method = meshing(part)[1]
    levels = (COARSENESS, 1.5)
    sizes = [method.size(method.mesh(level), level) for level in levels]
    found = [solved(part, metal, level) for level in levels]
    for values, reference in (
        ([compliance.input_stiffness for compliance in found], known.K_in_output_free),
        ([compliance.amplification for compliance in found], known.lambda_output_free),
        ([compliance.output_stiffness(0.0) for compliance in found], known.K_out_input_free),
    ):
        limit = convergence.extrapolate(values, sizes, mesh_noise=method.scatter)
        assert limit.error < 0.02 * limit.value
        assert abs(limit.value - reference) < limit.error + 5e-3 * reference


@pytest.mark.parametrize("changes", [{}, {"rod_length": 0.0}, {"fillet_radius": 0.4e-3}])
def test_hexahedra_fill_the_contour(changes: dict[str, float]) -> None:
    bridge.mesh(amplifier({"arm_offset": -1.6e-3, **changes}), Fineness.of(1))  # raises if they do not

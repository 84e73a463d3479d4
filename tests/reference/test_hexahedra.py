"""The reference checks itself: an exact field, beam theory, reciprocity, and its own record."""

from __future__ import annotations

import math
import tomllib
from typing import Any

import numpy as np
import pytest

from flexdesign.design import design
from studies.error_bars import bridge
from studies.error_bars.bridge import Fineness, Reference
from studies.error_bars.hexahedra import Array, Body, Plan, graded_lines, ruled_patch, sheared_patch, with_middles
from tests.reference import hexahedra

E, NU, RHO = 70e9, 0.33, 2800.0


def amplifier(**changes: float) -> Any:
    """Return the aluminium amplifier, with some of its dimensions changed."""
    read = design.read(design.find("bridge_amplifier"))
    return read.part_class(**{**read.dimensions, **changes})


@pytest.fixture(scope="module")
def coarse() -> Reference:
    """The aluminium amplifier on the coarsest mesh."""
    metal = design.read(design.find("bridge_amplifier")).material
    return bridge.solve(
        amplifier(), metal.youngs_modulus, metal.poissons_ratio, fineness=Fineness.of(1), density=metal.density
    )


@pytest.fixture(scope="module")
def recorded() -> dict[str, Any]:
    return tomllib.loads(hexahedra.RECORD.read_text(encoding="utf-8"))


def test_graded_lines_end_and_crowd_where_told() -> None:
    lines = graded_lines(1.0, 3.0, 0.01, 1.0, 0.8, 0.5)
    steps = np.diff(lines)
    assert lines[0] == 1.0 and lines[-1] == 3.0
    assert steps[0] < 0.02 and steps.max() < 0.55 and np.all(np.diff(steps) > -1e-9)


def test_uniaxial_stretch_is_exact_on_sheared_graded_patches() -> None:
    """A bent strip with upright ends pulled along y: u = (-nu x, y, -nu z) stress / E."""
    bend, end, height, depth = 2e-2, 3e-2, 7e-3, 4.2e-3
    slopes = (0.3, -0.2)
    y = np.array([0.0, 2e-3, height])
    left, right = graded_lines(0.0, bend, 1e-3, 1e-5, 0.7, 5e-3), np.array([bend, 2.4e-2, end])
    plan = Plan.of([sheared_patch(left, y, slopes[0]), sheared_patch(right, y + slopes[0] * bend, slopes[1])])
    assert plan.area() == pytest.approx(end * height, rel=1e-12)

    def fixed(nodes: Array, z: Array) -> Array:
        held = np.zeros((len(nodes), 3, z.size), dtype=bool)
        held[nodes[:, 0] < 1e-9, 0] = True
        held[:, 2, 0] = True
        held[np.hypot(*nodes.T) < 1e-9, 1] = True
        return held

    def lower_edge(x: Array) -> Array:
        return slopes[0] * np.minimum(x, bend) + slopes[1] * np.maximum(x - bend, 0.0)

    body = Body(plan, np.array([0.0, 3e-3, 4e-3, depth]), E, NU, fixed)
    stress, load, near = 1e6, np.zeros(math.prod(body.shape)), 1e-9
    for start, stop in ((0.0, bend), (bend, end)):
        for above, sign in ((0.0, -1), (height, 1)):

            def side(x: Array, y: Array, a: float = start, b: float = stop, above: float = above) -> Array:
                return (abs(y - lower_edge(x) - above) < near) & (x > a - near) & (x < b + near)

            load += sign * stress * (stop - start) * depth * body.average(side, 1)
    moved = body.solve(load[:, None]).reshape(body.shape)
    exact = np.empty(body.shape)
    exact[:, 0], exact[:, 1], exact[:, 2] = -NU * plan.nodes[:, :1], plan.nodes[:, 1:], -NU * body.z
    np.testing.assert_allclose(moved, exact * stress / E, atol=1e-9 * end * stress / E)


@pytest.mark.parametrize(("nu", "sensible"), [(0.0, 1e-3), (NU, 1e-2)])
def test_cantilever_follows_timoshenko(nu: float, sensible: float) -> None:
    """The clamp holds back lateral contraction, which the theory leaves out: it agrees best without any."""
    length, height, width = 40e-3, 2e-3, 3e-3
    x = graded_lines(0.0, length, 0.2e-3, 2e-3, 0.5, 2e-3)
    plan = Plan.of([sheared_patch(x, np.linspace(0.0, height, 4))])

    def fixed(nodes: Array, z: Array) -> Array:
        held = np.zeros((len(nodes), 3, z.size), dtype=bool)
        held[nodes[:, 0] < 1e-9] = True
        held[:, 2, 0] = True
        return held

    body = Body(plan, np.array([0.0, 1e-3, width / 2]), E, nu, fixed)
    tip = body.average(lambda x, _: x > length - 1e-9, 1)
    deflection = tip @ body.solve(tip[:, None] / 2)[:, 0]  # half the width carries half of 1 N
    area, inertia, shear = width * height, width * height**3 / 12, E / (2 * (1 + nu))
    expected = length**3 / (3 * E * inertia) + length / (5 / 6 * shear * area)
    assert deflection == pytest.approx(expected, rel=sensible)
    lowest = body.frequencies(RHO, 2)[0]
    euler = 1.8751041**2 / (2 * math.pi * length**2) * math.sqrt(E * inertia / (RHO * area))
    assert lowest == pytest.approx(euler, rel=sensible + 2e-3)


def test_amplifier_is_reciprocal_and_passive(coarse: Reference) -> None:
    assert coarse.reciprocity < 1e-6
    assert 0 < coarse.lambda_output_free**2 * coarse.K_out_input_free / coarse.K_in_output_free < 1
    assert coarse.K_out_input_held > coarse.K_out_input_free


def test_coarse_mesh_is_a_little_stiffer_than_the_record(coarse: Reference, recorded: dict[str, Any]) -> None:
    fine = recorded["bridge_amplifier"]
    assert 1e-3 < coarse.K_in_output_free / fine["K_in_output_free"]["value"] - 1 < 5e-3
    assert coarse.lambda_output_free == pytest.approx(fine["lambda_output_free"]["value"], rel=5e-4)
    assert 0 < coarse.frequencies[0] / fine["frequency_1"]["value"] - 1 < 3e-3


@pytest.mark.parametrize("name", hexahedra.DESIGNS)
def test_record_is_converged_and_consistent(name: str, recorded: dict[str, Any]) -> None:
    numbers = {key: entry["value"] for key, entry in recorded[name].items() if isinstance(entry, dict)}
    assert abs(recorded[name]["K_in_output_free"]["last_change"]) < hexahedra.TOLERANCE
    assert numbers["K_in_output_free"] * numbers["C11"] == pytest.approx(1, rel=1e-6)
    assert numbers["lambda_output_free"] == pytest.approx(numbers["C12"] / numbers["C11"], rel=1e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"rod_length": 0.0},
        {"ground_block_height": 9e-3},
        {"hinge_thickness": 0.2e-3},
        {"fillet_radius": 0.4e-3},
        {"fillet_radius": 1.35e-3, "arm_offset": 5e-3},
        {"fillet_radius": 0.1e-3, "rod_length": 0.0},
    ],
)
def test_mesh_fills_the_contour(changes: dict[str, float]) -> None:
    plan, layers = bridge.mesh(amplifier(**changes), Fineness.of(1))  # raises if it does not
    assert layers[0] == 0.0 and layers[-1] == pytest.approx(amplifier().width / 2)
    areas = plan.gradients()[2]
    assert np.all((areas > 0) == (areas[:, :1] > 0))  # mirror images run the other way round, but nothing is folded


def test_curved_quadrilaterals_integrate_a_ring() -> None:
    """A quarter of a ring: its area, its inertia about the centre, and linear fields reproduced."""
    angle = with_middles(np.linspace(0.0, np.pi / 2, 9))
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    plan = Plan.of([ruled_patch(circle, 2 * circle, np.linspace(0.0, 1.0, 4))])
    values, slopes, areas = plan.gradients()
    places = np.einsum("ga,mak->mgk", values, plan.nodes[plan.quads])
    side = np.pi / 16  # a parabola through three points of an arc of this angle lacks the share side^4 / 480 in area
    assert plan.area() == pytest.approx(np.pi / 4 * 3 * (1 - side**4 / 480), rel=1e-7)
    assert (areas * (places**2).sum(axis=2)).sum() == pytest.approx(np.pi / 8 * 15, rel=1e-5)
    linear = np.einsum("mgak,ma->mgk", slopes, (plan.nodes @ [2.0, -3.0])[plan.quads])
    np.testing.assert_allclose(linear, np.broadcast_to([2.0, -3.0], linear.shape), rtol=1e-11)


@pytest.mark.slow
def test_small_fillets_stiffen_little_and_large_ones_more(coarse: Reference) -> None:
    """Fillets add material; what they add to a leaf's bending stiffness is of the order of radius over length."""
    metal = design.read(design.find("bridge_amplifier")).material
    stiffness = [
        bridge.solve(
            amplifier(fillet_radius=radius), metal.youngs_modulus, metal.poissons_ratio, fineness=Fineness.of(1)
        ).K_in_output_free
        / coarse.K_in_output_free
        - 1
        for radius in (0.1e-3, 0.2e-3, 0.4e-3)
    ]
    assert 0 < stiffness[0] < stiffness[1] < stiffness[2] < 2 * 0.4 / 3

"""The textbook bridge against a planar frame of Euler-Bernoulli beams, and in its limits."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from flexdesign.analytic.prb import PseudoRigidBridge
from flexdesign.analytic.textbook import RodFlexibility, TextbookBridge, quantities

Array = NDArray[np.float64]

XY = {
    "youngs_modulus": 45e9,
    "width": 20e-3,
    "hinge_thickness": 0.5e-3,
    "hinge_length": 3.30e-3,
    "arm_span": 21.07e-3,
    "arm_offset": 1.213e-3,
}
Z = {**XY, "arm_offset": 0.828e-3}
STOUT = {  # short, thick and steep: where axial and transverse compliance are anything but small
    "youngs_modulus": 70e9,
    "width": 10e-3,
    "hinge_thickness": 1e-3,
    "hinge_length": 4e-3,
    "arm_span": 12e-3,
    "arm_offset": 3e-3,
}
CONCAVE = {**XY, "arm_offset": -1.213e-3}
STOUT_CONCAVE = {**STOUT, "arm_offset": -3e-3}
KINDS = [XY, Z, STOUT, CONCAVE, STOUT_CONCAVE]
NO_ROD: dict[str, float] = {}
ROD = {"rod_length": 13.58e-3, "rod_thickness": 3e-3}


# --- a planar frame: one quarter, rigid arm by constraint


def beam_stiffness(start: Array, end: Array, youngs_modulus: float, area: float, second_moment: float) -> Array:
    """Return the 6 by 6 stiffness of an Euler-Bernoulli beam; freedoms x, y, rotation at either end."""
    span = end - start
    length = float(np.hypot(*span))
    axial, bending = youngs_modulus * area / length, youngs_modulus * second_moment / length**3
    local = np.zeros((6, 6))
    local[np.ix_([0, 3], [0, 3])] = axial * np.array([[1, -1], [-1, 1]])
    local[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = bending * np.array(
        [
            [12, 6 * length, -12, 6 * length],
            [6 * length, 4 * length**2, -6 * length, 2 * length**2],
            [-12, -6 * length, 12, -6 * length],
            [6 * length, 2 * length**2, -6 * length, 4 * length**2],
        ]
    )
    c, s = span / length
    turn = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    return turn.T @ local @ turn


def frame_compliance(
    elements: int,
    youngs_modulus: float,
    width: float,
    hinge_thickness: float,
    hinge_length: float,
    arm_span: float,
    arm_offset: float,
    rod_length: float = 0.0,
    rod_thickness: float = 0.0,
) -> Array:
    """Return the compliance between input and output of a quarter.

    The inner leaf ends on the output block (moves along y only), the outer one on the input block or on the
    face of a rod whose root moves along x only. The arm is rigid, and so is the lever from the rod's face to
    its axis. The output is nearer to the actuator's axis than the input if the offset is negative.
    """
    half, rod_axis = hinge_length / 2, arm_span + hinge_length / 2 + rod_thickness / 2
    outer = np.linspace([arm_span + half, 0.0], [arm_span - half, 0.0], elements + 1)
    inner = np.linspace([half, arm_offset], [-half, arm_offset], elements + 1)
    lines = [(outer, hinge_thickness), (inner, hinge_thickness)]
    if rod_length > 0:
        lines.append((np.linspace([rod_axis, -rod_length], [rod_axis, 0.0], elements + 1), rod_thickness))
    points = np.concatenate([line for line, _ in lines])
    stiffness = np.zeros((3 * len(points), 3 * len(points)))
    for line, (_, thickness) in enumerate(lines):
        for first in range(line * (elements + 1), line * (elements + 1) + elements):
            at = slice(3 * first, 3 * first + 6)
            area, second_moment = width * thickness, width * thickness**3 / 12
            stiffness[at, at] += beam_stiffness(points[first], points[first + 1], youngs_modulus, area, second_moment)

    tie, tied = np.eye(len(stiffness)), []
    rod_root, rod_tip = 2 * (elements + 1), 2 * (elements + 1) + elements
    arm_outer, arm_inner, output = elements, elements + 1, 2 * elements + 1
    rigid_links = [(arm_inner, arm_outer)] + ([(0, rod_tip)] if rod_length > 0 else [])
    for follower, leader in rigid_links:
        lever = points[follower] - points[leader]
        tie[3 * follower : 3 * follower + 3] = 0
        tie[3 * follower : 3 * follower + 3, 3 * leader : 3 * leader + 3] = [
            [1, 0, -lever[1]],
            [0, 1, lever[0]],
            [0, 0, 1],
        ]
        tied += [3 * follower, 3 * follower + 1, 3 * follower + 2]
    source = rod_root if rod_length > 0 else 0
    held = [3 * source + 1, 3 * source + 2, 3 * output, 3 * output + 2]
    reduction = np.delete(tie, tied + held, axis=1)
    loads = np.zeros((len(stiffness), 2))
    loads[3 * source, 0] = 1.0  # the actuator pushes outward
    loads[3 * output + 1, 1] = -1.0  # inwards
    reduced_loads = reduction.T @ loads
    moved = np.linalg.solve(reduction.T @ stiffness @ reduction, reduced_loads)
    return np.asarray(reduced_loads.T @ moved)


def test_the_frame_itself_on_a_cantilever() -> None:
    points = np.linspace([0.0, 0.0], [0.0, 2.0], 3)
    total = np.zeros((9, 9))
    for i in range(2):
        total[3 * i : 3 * i + 6, 3 * i : 3 * i + 6] += beam_stiffness(points[i], points[i + 1], 5.0, 7.0, 11.0)
    tip = np.linalg.inv(total[3:, 3:])[3:, 3:]
    expected = [[2**3 / (3 * 55), 0, -(2**2) / (2 * 55)], [0, 2 / 35, 0], [-(2**2) / (2 * 55), 0, 2 / 55]]
    np.testing.assert_allclose(tip, expected, rtol=1e-10, atol=1e-14)


# --- the formulas against the frame


@pytest.mark.parametrize("rod", [NO_ROD, ROD])
@pytest.mark.parametrize("dimensions", KINDS)
def test_exact_for_elastic_hinges_and_rods(dimensions: dict[str, float], rod: dict[str, float]) -> None:
    frame = frame_compliance(3, **dimensions, **rod)
    assert frame[0, 1] * dimensions["arm_offset"] > 0  # a convex bridge draws its output in, a concave one does not
    bridge = TextbookBridge.of_leaves(**dimensions, **rod)
    # Same theory on both sides: the residual is rounding, and the frame's condition number is 1e6 to 1e8.
    np.testing.assert_allclose(bridge.port_compliance(), frame, rtol=1e-8)
    assert bridge.amplification == pytest.approx(frame[1, 0] / frame[0, 0], rel=1e-8)
    assert bridge.input_stiffness == pytest.approx(1 / frame[0, 0], rel=1e-8)
    assert bridge.output_stiffness == pytest.approx(1 / frame[1, 1], rel=1e-8)
    held = 1 / (frame[1, 1] - frame[0, 1] ** 2 / frame[0, 0])
    assert bridge.output_stiffness_with_input() == pytest.approx(held, rel=1e-6)
    behind = 1 / (frame[1, 1] - frame[0, 1] ** 2 / (frame[0, 0] + 1 / 60e6))
    assert bridge.output_stiffness_with_input(60e6) == pytest.approx(behind, rel=1e-6)


def test_one_element_a_leaf_is_as_good_as_ten() -> None:
    np.testing.assert_allclose(frame_compliance(1, **STOUT, **ROD), frame_compliance(10, **STOUT, **ROD), rtol=1e-7)


@pytest.mark.parametrize("dimensions", KINDS)
def test_the_bare_formula_lacks_sway_at_the_output_alone(dimensions: dict[str, float]) -> None:
    """K_theta and K_l alone: exact at the input, and off by l^2 / (3 l_x^2) in the output compliance."""
    frame = frame_compliance(3, **dimensions)
    bare = dataclasses.replace(TextbookBridge.of_leaves(**dimensions), sway_stiffness=math.inf).port_compliance()
    np.testing.assert_allclose(bare[0], frame[0], rtol=1e-8)
    share = dimensions["hinge_length"] ** 2 / (3 * dimensions["arm_span"] ** 2)
    assert frame[1, 1] / bare[1, 1] - 1 == pytest.approx(share, rel=1e-6)


def test_sway_is_a_part_of_the_held_output() -> None:
    leaves = TextbookBridge.of_leaves(**XY)
    bare = dataclasses.replace(leaves, sway_stiffness=math.inf)
    assert bare.output_stiffness / leaves.output_stiffness - 1 < 0.01
    assert bare.output_stiffness_with_input() / leaves.output_stiffness_with_input() - 1 > 0.1


# --- limits, and the pseudo-rigid-body model


def between(low: float, high: float) -> st.SearchStrategy[float]:
    """Return numbers of every order of magnitude between `low` and `high`."""
    return st.floats(math.log(low), math.log(high)).map(math.exp)


LEAVES = st.fixed_dictionaries(
    {
        "youngs_modulus": between(1e9, 4e11),
        "width": between(1e-3, 0.1),
        "hinge_thickness": between(1e-4, 2e-3),
        "hinge_length": between(5e-4, 1e-2),
        "arm_span": between(5e-3, 0.1),
        "arm_offset": st.one_of(between(1e-4, 1e-2), between(1e-4, 1e-2).map(lambda fall: -fall)),
    }
)


@given(LEAVES)
def test_hinges_that_only_rotate_are_the_pseudo_rigid_body_model(dimensions: dict[str, float]) -> None:
    leaves = TextbookBridge.of_leaves(**dimensions)
    rigid = dataclasses.replace(leaves, axial_stiffness=math.inf, sway_stiffness=math.inf)
    prb = PseudoRigidBridge(**dimensions)
    np.testing.assert_allclose(rigid.port_compliance(), prb.port_compliance(), rtol=1e-12)
    assert rigid.output_stiffness_with_input() == math.inf
    assert rigid.output_stiffness_with_input(1e7) == pytest.approx(prb.output_stiffness_with_input(1e7), rel=1e-12)


@given(LEAVES)
def test_leaves_reduce_to_thickness_over_offset(dimensions: dict[str, float]) -> None:
    """K_theta / K_l = t^2 / 12 leaves lambda = l_x l_y / (l_y^2 + t^2 / 3): no modulus, width or length."""
    l_x, l_y, t = (dimensions[name] for name in ("arm_span", "arm_offset", "hinge_thickness"))
    amplification = TextbookBridge.of_leaves(**dimensions).amplification
    assert amplification == pytest.approx(l_x * l_y / (l_y**2 + t**2 / 3), rel=1e-12)


@given(LEAVES)
def test_published_form_of_the_parallel_bridge(dimensions: dict[str, float]) -> None:
    """R = K_l L H / (4 K + K_l H^2), as Ling (2019) lists it for hinges parallel to the input."""
    bridge = TextbookBridge.of_leaves(**dimensions)
    span, height = dimensions["arm_span"], dimensions["arm_offset"]
    listed = bridge.axial_stiffness * span * height
    listed /= 4 * bridge.rotational_stiffness + bridge.axial_stiffness * height**2
    assert bridge.amplification == pytest.approx(listed, rel=1e-12)


@given(LEAVES, between(1e-3, 3e-2), between(1e-3, 1e-2))
def test_more_compliance_never_makes_energy(dimensions: dict[str, float], length: float, thickness: float) -> None:
    bridge = TextbookBridge.of_leaves(**dimensions, rod_length=length, rod_thickness=thickness)
    share = bridge.amplification**2 * bridge.output_stiffness / bridge.input_stiffness
    assert 0 < share < 1
    assert bridge.output_stiffness < bridge.output_stiffness_with_input(1e6) < bridge.output_stiffness_with_input()
    held = bridge.output_stiffness / (1 - share)
    assert bridge.output_stiffness_with_input() == pytest.approx(held, rel=1e-13 / (1 - share) + 1e-9)


@given(LEAVES, between(1e-3, 3e-2), between(1e-3, 1e-2))
def test_the_reciprocal_rod_makes_good_the_defect(
    dimensions: dict[str, float], length: float, thickness: float
) -> None:
    """C12 differs from the paper's C21 by the reciprocity defect, up to the rod's own rotation under moment.

    With x = c K_theta the residual is at most x / (2 + x) of both of C12's terms, whatever the dimensions; the lever
    between rod and hinge, which the paper's model does not know, is left out.
    """
    assume(length >= -dimensions["arm_offset"])
    paper = PseudoRigidBridge(**dimensions, rod_length=length, rod_thickness=thickness)
    leaves = TextbookBridge.of_leaves(**dimensions, rod_length=length, rod_thickness=thickness)
    rigid = dataclasses.replace(leaves, axial_stiffness=math.inf, sway_stiffness=math.inf, rod_lever=0.0)
    x = rigid.rod.moment * rigid.rotational_stiffness
    c21, defect = paper.port_compliance()[1, 0], paper.reciprocity_defect
    left = rigid.port_compliance()[0, 1] - c21 * (1 + defect)
    assert abs(left) <= abs(c21) * (1 + abs(defect)) * (x / (2 + x) + 1e-12)


@given(LEAVES, between(1e-2, 3e-2), between(1e-3, 1e-2))
def test_the_paper_has_half_of_what_tells_concave_from_convex(
    dimensions: dict[str, float], length: float, thickness: float
) -> None:
    """What is odd in l_y at the input is 4 l_y b / (2 + c K_theta) here, and l_y b by eq. (15): b = l_1^2 / 2EI.

    The paper has the rod bent by the hinge's moment, and leaves out the equal part: the hinge turned by the rod.
    """
    mirrored = {**dimensions, "arm_offset": -dimensions["arm_offset"]}
    ours, papers = (
        [kind(**sides, rod_length=length, rod_thickness=thickness).port_compliance()[0, 0] for sides in both]
        for kind, both in (
            (TextbookBridge.of_leaves, (dimensions, mirrored)),
            (PseudoRigidBridge, (dimensions, mirrored)),
        )
    )
    rod = TextbookBridge.of_leaves(**dimensions, rod_length=length, rod_thickness=thickness).rod
    x = rod.moment * TextbookBridge.of_leaves(**dimensions).rotational_stiffness
    odd, rounding = ours[0] - ours[1], 1e-13 * max(*ours, *papers)
    assert odd == pytest.approx(4 / (2 + x) * (papers[0] - papers[1]), rel=1e-9, abs=rounding)


@given(LEAVES)
def test_without_rods_a_concave_bridge_is_the_convex_one_with_its_output_reversed(
    dimensions: dict[str, float],
) -> None:
    bridge = TextbookBridge.of_leaves(**dimensions)
    other = dataclasses.replace(bridge, arm_offset=-bridge.arm_offset)
    reverse = np.diag([1.0, -1.0])
    np.testing.assert_array_equal(other.port_compliance(), reverse @ bridge.port_compliance() @ reverse)
    assert other.output_stiffness_with_input() == bridge.output_stiffness_with_input()


@pytest.mark.parametrize("dimensions", [XY, Z, STOUT])
def test_rods_tell_the_two_kinds_apart(dimensions: dict[str, float]) -> None:
    """In the frame, too: a stiffer input, and less motion per force, as the rods' tips turn against the arms."""
    convex, other = (
        frame_compliance(3, **{**dimensions, "arm_offset": sign * dimensions["arm_offset"]}, **ROD) for sign in (1, -1)
    )
    assert other[0, 0] < convex[0, 0] and abs(other[0, 1]) < convex[0, 1]
    assert other[1, 1] == pytest.approx(convex[1, 1], rel=1e-8)


@pytest.mark.parametrize(
    ("dimensions", "k_in", "amplification"),
    # Solid finite elements of the amplifier without rods: sharp roots, arms 4 mm thick, about 1 % accurate.
    [(XY, 3525e3, 15.8), (Z, 6829e3, 20.9)],
)
def test_hinge_stretch_explains_more_than_half_of_what_the_rigid_model_misses(
    dimensions: dict[str, float], k_in: float, amplification: float
) -> None:
    prb, textbook = PseudoRigidBridge(**dimensions), TextbookBridge.of_leaves(**dimensions)
    assert k_in < textbook.input_stiffness < (prb.input_stiffness() + k_in) / 2
    assert amplification < textbook.amplification < (prb.amplification() + amplification) / 2


# --- as objects


def test_rod_flexibility_of_nothing_is_zero() -> None:
    assert RodFlexibility.of_cantilever(45e9, 20e-3, math.inf, 0.0) == RodFlexibility()
    assert TextbookBridge.of_leaves(**XY).rod == RodFlexibility()


@pytest.mark.parametrize(
    "field", ["rotational_stiffness", "axial_stiffness", "arm_span", "arm_offset", "sway_stiffness"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_refuses_what_is_not_positive(field: str, value: float) -> None:
    changed: dict[str, Any] = {field: value}
    if field == "arm_offset" and value < 0:
        assert dataclasses.replace(TextbookBridge.of_leaves(**XY), **changed).amplification < 0  # a concave bridge
        return
    with pytest.raises(ValueError, match=field):
        dataclasses.replace(TextbookBridge.of_leaves(**XY), **changed)


def test_quantities_name_their_boundary_and_stay_finite() -> None:
    bridge = TextbookBridge.of_leaves(**XY)
    found = quantities(bridge, actuator_stiffness=60e6)
    assert list(found) == [
        "K_in_output_free",
        "lambda_output_free",
        "K_out_input_free",
        "K_out_input_held",
        "K_out_actuator_installed",
    ]
    assert found["K_out_actuator_installed"].value == bridge.output_stiffness_with_input(60e6)
    rigid = dataclasses.replace(bridge, axial_stiffness=math.inf, sway_stiffness=math.inf)
    assert "K_out_input_held" not in quantities(rigid)

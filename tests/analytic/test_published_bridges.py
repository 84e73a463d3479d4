"""Published amplifications against the textbook bridge, a frame of beams and another form, and in their limits."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from flexdesign.analytic import notch
from flexdesign.analytic.published_bridges import RhombicBridge, parallel, rhombic, rhombic_leaf
from flexdesign.analytic.textbook import TextbookBridge

Array = NDArray[np.float64]

YOUNG, WIDTH = 71e9, 10e-3
#: Span and offset of the arm [m]: steep, usual, flat, and concave.
ARMS = [(12e-3, 6e-3), (21.07e-3, 1.213e-3), (20e-3, 0.2e-3), (15e-3, -2.6e-3)]


# --- a quarter as a frame of Euler-Bernoulli beams


def beam(start: Array, end: Array, area: float, second_moment: float) -> Array:
    """Return a beam's 6 by 6 stiffness; freedoms x, y, rotation at either end."""
    span = end - start
    l = float(np.hypot(*span))
    stretch, bend = YOUNG * area / l, YOUNG * second_moment / l**3
    local = np.zeros((6, 6))
    local[np.ix_([0, 3], [0, 3])] = stretch * np.array([[1, -1], [-1, 1]])
    across = [[12, 6 * l, -12, 6 * l], [0, 4 * l**2, -6 * l, 2 * l**2], [0, 0, 12, -6 * l], [0, 0, 0, 4 * l**2]]
    upper = np.array(across)
    local[np.ix_([1, 2, 4, 5], [1, 2, 4, 5])] = bend * (upper + np.triu(upper, 1).T)
    c, s = span / l
    turn = np.kron(np.eye(2), np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]))
    return np.asarray(turn.T @ local @ turn)


def frame(places: list[tuple[float, float]], sections: list[tuple[float, float] | None]) -> Array:
    """Return the compliance between the first place (moves along x) and the last (along y), neither turning.

    One section, area and second moment, from each place to the next; None is rigid. The output counts inwards.
    """
    points = np.array(places)
    stiffness, tie, gone = np.zeros((3 * len(points),) * 2), np.eye(3 * len(points)), [1, 2]
    for i, section in enumerate(sections):
        at = slice(3 * i, 3 * i + 6)
        if section:
            stiffness[at, at] += beam(points[i], points[i + 1], *section)
        else:
            x, y = points[i + 1] - points[i]
            follower, leader = slice(3 * i + 3, 3 * i + 6), slice(3 * i, 3 * i + 3)
            tie[follower], gone = 0, [*gone, 3 * i + 3, 3 * i + 4, 3 * i + 5]
            tie[follower, leader] = [[1, 0, -y], [0, 1, x], [0, 0, 1]]
    last = 3 * len(points) - 3
    reduction = np.delete(tie, [*gone, last, last + 2], axis=1)
    loads = np.zeros((len(stiffness), 2))
    loads[0, 0], loads[last + 1, 1] = 1.0, -1.0
    loads = reduction.T @ loads
    return np.asarray(loads.T @ np.linalg.solve(reduction.T @ stiffness @ reduction, loads))


def leaf_section(thickness: float) -> tuple[float, float]:
    return WIDTH * thickness, WIDTH * thickness**3 / 12


def test_the_frame_itself_on_a_guided_leaf() -> None:
    """Flat, the input stretches the leaf, l / EA, and the output bends it into an S, l^3 / 12 EI. Rounding alone."""
    area, second_moment = leaf_section(1e-3)
    found = frame([(5e-3, 0.0), (3e-3, 0.0), (0.0, 0.0)], [(area, second_moment)] * 2)
    expected = [[5e-3 / (YOUNG * area), 0], [0, 5e-3**3 / (12 * YOUNG * second_moment)]]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-20)


# --- statics against the frame: the same theory on both sides, and frames with condition numbers of 1e6 to 1e9


@pytest.mark.parametrize(("span", "offset"), ARMS)
def test_an_arm_that_is_a_leaf(span: float, offset: float) -> None:
    bridge = RhombicBridge.of_leaf(YOUNG, WIDTH, 0.8e-3, span, offset)
    found = frame([(span, 0.0), (0.3 * span, 0.7 * offset), (0.0, offset)], [leaf_section(0.8e-3)] * 2)
    np.testing.assert_allclose(bridge.port_compliance(), found, rtol=1e-7)
    assert bridge.amplification == pytest.approx(found[1, 0] / found[0, 0], rel=1e-7)
    assert bridge.input_stiffness == pytest.approx(1 / found[0, 0], rel=1e-7)
    assert bridge.output_stiffness == pytest.approx(1 / found[1, 1], rel=1e-7)


@pytest.mark.parametrize(("span", "offset"), ARMS)
def test_a_rigid_arm_between_leaves(span: float, offset: float) -> None:
    length, thickness = 3e-3, 0.5e-3
    centres = np.array([span, 0.0]), np.array([0.0, offset])
    along = (centres[1] - centres[0]) / np.linalg.norm(centres[1] - centres[0])
    places = [tuple(centre + sign * along * length / 2) for centre in centres for sign in (-1, 1)]
    found = frame(places, [leaf_section(thickness), None, leaf_section(thickness)])
    bridge = RhombicBridge.of_hinges(notch.leaf(YOUNG, WIDTH, thickness, length), span, offset)
    np.testing.assert_allclose(bridge.port_compliance(), found, rtol=1e-7)


# --- published amplifications

POSITIVE = st.floats(math.log(1e-2), math.log(1e2)).map(math.exp)
DIMENSIONS = {
    "rotational": POSITIVE,  # N m/rad
    "axial": POSITIVE.map(lambda scale: 1e8 * scale),  # N/m
    "span": POSITIVE.map(lambda scale: 1e-2 * scale),
    "offset": st.one_of(*(POSITIVE.map(lambda scale, sign=sign: sign * 1e-3 * scale) for sign in (1, -1))),
}


@given(**DIMENSIONS)
def test_parallel_is_the_textbook_bridge(rotational: float, axial: float, span: float, offset: float) -> None:
    bridge = TextbookBridge(rotational, axial, span, offset)
    assert parallel(rotational, axial, span, offset) == pytest.approx(bridge.amplification, rel=1e-12)


@given(**DIMENSIONS)
def test_rhombic_is_the_other_form_that_is_listed(rotational: float, axial: float, span: float, offset: float) -> None:
    """R = L / (2 K_h cot(theta) / (K_l L) + L tan(theta)), equation (20) of Ling (2019)."""
    length, tangent = math.hypot(span, offset), offset / span
    listed = length / (2 * rotational / tangent / (axial * length) + length * tangent)
    assert rhombic(rotational, axial, span, offset) == pytest.approx(listed, rel=1e-12)


@given(**DIMENSIONS)
def test_rhombic_neglects_how_far_stretch_draws_the_output_back(
    rotational: float, axial: float, span: float, offset: float
) -> None:
    """Too large by 1 / (1 - K_t / K_l); from a share of 1 on, stretch outweighs rotation, and signs differ."""
    sway = 2 * rotational / (span**2 + offset**2)
    exact = RhombicBridge(axial, sway, span, offset).amplification
    published = rhombic(rotational, axial, span, offset)
    # 1 - K_t / K_l is rounded to 1e-16 of its larger term.
    assert exact == pytest.approx(
        published * (1 - sway / axial), rel=1e-12, abs=1e-14 * abs(published) * (1 + sway / axial)
    )


@pytest.mark.parametrize("thickness", [0.1e-3, 0.5e-3, 2e-3])
@pytest.mark.parametrize(("span", "offset"), ARMS)
def test_the_leaf_formula_is_too_large_by_its_thickness_over_length_squared(
    span: float, offset: float, thickness: float
) -> None:
    exact = RhombicBridge.of_leaf(YOUNG, WIDTH, thickness, span, offset).amplification
    published = rhombic_leaf(YOUNG, WIDTH, thickness, span, offset)
    share = thickness**2 / (span**2 + offset**2)
    assert exact / published == pytest.approx(1 - share, rel=1e-12)  # rounding


def test_hinges_without_sway_are_the_rhombic_formula_but_for_stretch() -> None:
    """Of a notch: K_theta = 1 / rotation, two stretches in series, and a sway that is a share of less than 1 %."""
    hinge = notch.lobontiu_circular(YOUNG, WIDTH, 0.5e-3, 2e-3)
    span, offset = 21e-3, 2e-3
    bridge = RhombicBridge.of_hinges(hinge, span, offset)
    published = rhombic(hinge.rotational_stiffness, hinge.axial_stiffness / 2, span, offset)
    sway = 4 / hinge.sway_stiffness / (hinge.rotation * (span**2 + offset**2))
    assert 0 < sway < 0.01
    assert bridge.amplification / published == pytest.approx(
        1.0, abs=sway + bridge.sway_stiffness / bridge.arm_stiffness
    )
    without = dataclasses.replace(bridge, sway_stiffness=bridge.sway_stiffness * (1 + sway))
    share = without.sway_stiffness / without.arm_stiffness
    assert without.amplification / published == pytest.approx(1 - share, rel=1e-12)


# --- limits


@pytest.mark.parametrize(("span", "offset"), ARMS)
def test_without_stretch_all_are_the_kinematic_ratio(span: float, offset: float) -> None:
    """The share that hinges take is 4 K_theta / (K_l l_y^2) at most: 1e-9 here."""
    stiff = 4e9 / offset**2
    for found in (parallel(1.0, stiff, span, offset), rhombic(1.0, stiff, span, offset)):
        assert found == pytest.approx(span / offset, rel=2e-9)
    thin = 1e-5 * abs(offset)
    assert rhombic_leaf(YOUNG, WIDTH, thin, span, offset) == pytest.approx(span / offset, rel=2e-10)


def test_of_leaves_no_bridge_amplifies_more_than_its_stretch_lets_it() -> None:
    """Largest lambda: l_x 3^(1/2) / 2t at l_y = t / 3^(1/2), hinges parallel; l_x / 2t at l_y = t, a flat leaf."""
    span, thickness, length = 20e-3, 0.5e-3, 3e-3
    hinge = notch.leaf(YOUNG, WIDTH, thickness, length)
    offsets = np.linspace(0.5, 2.0, 1501) * thickness
    for found, best, peak in (
        (
            [parallel(hinge.rotational_stiffness, hinge.axial_stiffness, span, offset) for offset in offsets],
            thickness / math.sqrt(3),
            span * math.sqrt(3) / (2 * thickness),
        ),
        (
            [rhombic_leaf(YOUNG, WIDTH, thickness, span, offset) for offset in offsets],
            thickness,
            span / (2 * thickness),
        ),
    ):
        # On a grid of t / 1000, and, for the leaf, to the (t / l)^2 = 6e-4 that cos^2 a takes.
        assert offsets[int(np.argmax(found))] == pytest.approx(best, abs=2e-3 * thickness)
        assert max(found) == pytest.approx(peak, rel=7e-4)


@pytest.mark.parametrize("offset", [1e-9, -1e-9])
def test_a_flat_bridge_does_not_move(offset: float) -> None:
    """lambda is odd in l_y, and l_x l_y K_l / 4 K_theta for small ones."""
    assert parallel(1.0, 1e8, 20e-3, offset) == pytest.approx(20e-3 * offset * 1e8 / 4, rel=1e-9)
    assert rhombic(1.0, 1e8, 20e-3, offset) == pytest.approx(20e-3 * offset * 1e8 / 2, rel=1e-9)


@pytest.mark.parametrize(("young", "width"), [(2.0, 1.0), (1.0, 3.0)])
def test_stiffness_goes_with_modulus_and_width_and_amplification_with_neither(young: float, width: float) -> None:
    one = RhombicBridge.of_leaf(YOUNG, WIDTH, 1e-3, 15e-3, 2.6e-3)
    other = RhombicBridge.of_leaf(young * YOUNG, width * WIDTH, 1e-3, 15e-3, 2.6e-3)
    np.testing.assert_allclose(other.port_compliance() * young * width, one.port_compliance(), rtol=1e-13)
    assert other.amplification == pytest.approx(one.amplification, rel=1e-13)
    formulas = [rhombic_leaf(y * YOUNG, w * WIDTH, 1e-3, 15e-3, 2.6e-3) for y, w in ((1.0, 1.0), (young, width))]
    assert formulas[1] == pytest.approx(formulas[0], rel=1e-13)


# --- what was left out


def test_the_arms_stretch_counts_twice_not_four_times() -> None:
    """With the arm's stretch, statics adds c K_theta K_l / K_arm to the denominator of `parallel`, c = 2.

    Ling (2019), equation (24) as transcribed, has c = 4. An arm as stiff as a hinge, which does not bend; its incline
    takes (l_y / l_x)^2 = 0.3 % of its stretch.
    """
    span, offset, thickness, length = 21.07e-3, 1.213e-3, 0.5e-3, 3.3e-3
    area, second_moment = leaf_section(thickness)
    hinge = notch.leaf(YOUNG, WIDTH, thickness, length)
    arm = math.hypot(span - length, offset)
    ends = [(span + length / 2, 0.0), (span - length / 2, 0.0), (length / 2, offset), (-length / 2, offset)]
    # Rigid in bending: 1e5 times a hinge's second moment; what bends besides shows up in the seventh digit.
    found = frame(ends, [(area, second_moment), (area * arm / length, 1e5 * second_moment), (area, second_moment)])
    k_theta, k_l = hinge.rotational_stiffness, hinge.axial_stiffness
    denominator = k_l * span * offset * found[0, 0] / found[1, 0]
    coefficient = (denominator - 4 * k_theta - k_l * offset**2) / k_theta
    assert coefficient == pytest.approx(2.0, rel=0.01)


# --- what is refused


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_refuses_what_is_not_positive(value: float) -> None:
    with pytest.raises(ValueError, match="rotational_stiffness must be positive"):
        parallel(value, 1e8, 20e-3, 1e-3)
    with pytest.raises(ValueError, match="arm_stiffness must be positive"):
        rhombic(1.0, value, 20e-3, 1e-3)
    with pytest.raises(ValueError, match="sway_stiffness must be positive"):
        RhombicBridge(1e8, value, 20e-3, 1e-3)

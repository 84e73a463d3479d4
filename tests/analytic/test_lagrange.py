"""Lagrange's sums against a linkage of rigid bodies, condensed springs, energies by differences, and eq. (21) typed in.

The linkage knows nothing of shares: seven bodies of three freedoms each, joined by pins; its one motion is the null
space of the constraints, its mass and stiffness the projections onto it.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space

from flexdesign.analytic.lagrange import (
    OPPOSED_XY,
    PARALLEL_XY,
    PRINTED_XY,
    PRINTED_Z,
    Coordinate,
    DrivenAxis,
    Elements,
    Term,
    Topology,
    amplifier,
    as_printed,
    axis,
    static_gain,
)
from flexdesign.analytic.prb import PseudoRigidBridge

Array = NDArray[np.float64]
#: Dimensions of the reconstructed X/Y amplifier; its masses are those of blocks and arms of that size.
XY = PseudoRigidBridge(45e9, 20e-3, 0.5e-3, 3.30e-3, 21.07e-3, 1.213e-3, 13.58e-3, 3e-3)
M_1, M_3, M_ARM = 3.5e-3, 4.2e-3, 2.6e-3
J, K_R, L_X, L_Y = 9e-8, 2.842, 21.07e-3, 1.213e-3
ELEMENTS = Elements(12.8e3, 2.842, 45.46e-3, amplifier_mass=6.5e-3, table_mass=60e-3, guide_mass=2e-3)


# --- a linkage of rigid bodies


def linkage(*, arms_translate: bool, inputs_ride: bool) -> tuple[Array, Array, Array]:
    """Return mass matrix, stiffness matrix and constraints of a bridge on the ground, by bodies (x, y, rotation)."""
    ground, output, left, right = -1, 0, 1, 2
    inputs = {-1: left, 1: right}
    mass, stiffness, constraints = np.zeros((21, 21)), np.zeros((21, 21)), []

    def at(body: int, point: tuple[float, float], centre: tuple[float, float]) -> Array:
        """Return the two rows that give the motion of a point of a body."""
        rows = np.zeros((2, 21))
        if body != ground:
            rows[0, 3 * body], rows[1, 3 * body + 1] = 1, 1
            rows[:, 3 * body + 2] = -(point[1] - centre[1]), point[0] - centre[0]
        return rows

    def hinge(a: int, b: int) -> None:
        turn = np.zeros(21)
        for body, sign in ((a, 1.0), (b, -1.0)):
            if body != ground:
                turn[3 * body + 2] += sign
        stiffness[:] += K_R * np.outer(turn, turn)

    block = (0.03, 0.004)  # an input block's centre and its hinges' height: of no consequence, so not symmetric ones
    for arm, (side, level) in enumerate(itertools.product((-1, 1), repeat=2), start=3):
        outer = (side * 0.025, level * block[1])
        inner = (side * (0.025 - L_X), level * (block[1] + L_Y))
        centre = ((outer[0] + inner[0]) / 2, (outer[1] + inner[1]) / 2)
        end = output if level > 0 else ground
        constraints.append(at(arm, outer, centre) - at(inputs[side], outer, (side * block[0], 0.0)))
        constraints.append(at(arm, inner, centre) - at(end, inner, (0.0, 0.01)))
        hinge(arm, inputs[side])
        hinge(arm, end)
        mass[3 * arm + 2, 3 * arm + 2] = J
        for freedom in (0, 1):
            mass[3 * arm + freedom, 3 * arm + freedom] = M_ARM * arms_translate
    mass[0, 0] = mass[1, 1] = M_3
    for body in (left, right):
        mass[3 * body, 3 * body], mass[3 * body + 1, 3 * body + 1] = M_1, M_1 * inputs_ride
    # What the symmetry of the drive holds: the blocks do not turn, the output does not go sideways.
    for freedom in (0, 3 * output + 2, 3 * left + 2, 3 * right + 2):
        constraints.append(np.eye(21)[[freedom]])
    return mass, stiffness, np.vstack(constraints)


@pytest.mark.parametrize(("arms_translate", "inputs_ride"), list(itertools.product((False, True), repeat=2)))
def test_amplifier_against_a_linkage_of_rigid_bodies(arms_translate: bool, inputs_ride: bool) -> None:
    mass, stiffness, constraints = linkage(arms_translate=arms_translate, inputs_ride=inputs_ride)
    motion = null_space(constraints)
    assert motion.shape[1] == 1  # a mechanism of one freedom
    motion /= motion[1]  # the output's travel is 1
    found = amplifier(
        input_block=M_1,
        output_block=M_3,
        arm_inertia=J,
        hinge_stiffness=K_R,
        arm_span=L_X,
        amplification=L_X / L_Y,  # rigid rods
        arm_mass=M_ARM if arms_translate else 0.0,
        riding_input=inputs_ride,
    )
    # Rounding of the null space: 1e-16 times the condition of the constraints, lengths of 1 mm beside motions of 1.
    assert found.mass == pytest.approx((motion.T @ mass @ motion).item(), rel=1e-10)
    assert found.stiffness == pytest.approx((motion.T @ stiffness @ motion).item(), rel=1e-10)
    (squared,) = eigh(motion.T @ stiffness @ motion, motion.T @ mass @ motion, eigvals_only=True)
    assert found.natural_frequency == pytest.approx(math.sqrt(squared) / (2 * math.pi), rel=1e-10)


def test_what_equation_19_leaves_out_is_no_trifle() -> None:
    """Riding input blocks add half their mass, arms at half and three quarters of the travel 1.25 times one's."""
    asked = {"input_block": M_1, "output_block": M_3, "arm_inertia": J, "hinge_stiffness": K_R, "arm_span": L_X}
    bare = amplifier(**asked, amplification=1e9)
    whole = amplifier(**asked, amplification=1e9, arm_mass=M_ARM, riding_input=True)
    assert whole.mass - bare.mass == pytest.approx(M_1 / 2 + 1.25 * M_ARM, rel=1e-9)
    named = {name: where for name, _, _, where in whole.table()}
    assert sum("not in" in where for where in named.values()) == 4
    assert not any("not in" in where for _, _, _, where in bare.table())


def test_amplifier_in_closed_form() -> None:
    found = amplifier(
        input_block=M_1, output_block=M_3, arm_inertia=J, hinge_stiffness=K_R, arm_span=L_X, amplification=4.046
    )
    assert found.mass == pytest.approx(M_1 / (2 * 4.046**2) + M_3 + J / L_X**2, rel=1e-13)
    assert found.stiffness == pytest.approx(2 * K_R / L_X**2, rel=1e-13)


@given(st.floats(1e-3, 0.1), st.floats(1e-4, 1e-2), st.floats(5e-3, 0.05))
def test_stiffness_of_the_amplifier_is_its_output_stiffness(width: float, thickness: float, span: float) -> None:
    """K_b of (19) is K_out of (5)."""
    bridge = PseudoRigidBridge(70e9, width, thickness, 3e-3, span, 1e-3)
    found = amplifier(
        input_block=0.0,
        output_block=1.0,
        arm_inertia=0.0,
        hinge_stiffness=bridge.hinge_stiffness,
        arm_span=span,
        amplification=bridge.amplification(),
    )
    assert found.stiffness == pytest.approx(bridge.output_stiffness, rel=1e-12)


# --- the stage


def test_axes_as_equation_21_prints_them() -> None:
    x, z = as_printed(ELEMENTS)
    e = ELEMENTS
    assert x.mass == pytest.approx(e.table_mass + 4 * e.amplifier_mass, rel=1e-13)
    assert x.stiffness == pytest.approx(e.amplifier_stiffness + 4 * e.hinge_stiffness / e.chain_length**2, rel=1e-13)
    assert z.mass == pytest.approx(e.table_mass + 8 * e.amplifier_mass / 4 + 8 * e.guide_mass / 4, rel=1e-13)
    assert z.stiffness == pytest.approx(8 * e.amplifier_stiffness / 4, rel=1e-13)
    assert z.natural_frequency == pytest.approx(math.sqrt(z.stiffness / z.mass) / math.tau, rel=1e-13)
    # Table 1's model row, with the reconstructed K_b, K_r and L_1; half of the last digit printed.
    assert abs(x.stiffness - 18.3e3) <= 0.05e3
    assert abs(z.stiffness - 25.6e3) <= 0.05e3


def test_series_pairs_against_condensed_springs() -> None:
    """Z without shares: four pairs of springs between ground and table, the joints between them free."""
    k, joints = ELEMENTS.amplifier_stiffness, 4
    full = np.zeros((joints + 1, joints + 1))
    for joint in range(1, joints + 1):
        full[joint, joint] = 2 * k  # the lower amplifier to the ground, the upper one to the table
        full[0, joint] = full[joint, 0] = -k
        full[0, 0] += k
    follow = -np.linalg.solve(full[1:, 1:], full[1:, 0])  # what the joints do as the table moves by 1
    stiffness = full[0, 0] + full[0, 1:] @ follow
    assert axis("Z", PRINTED_Z, ELEMENTS).stiffness == pytest.approx(stiffness, rel=1e-12)
    assert follow == pytest.approx(np.full(joints, PRINTED_Z.amplifier_share))


def test_guide_hinges_against_the_energy_of_turning_chains() -> None:
    """Second difference of K_r beta^2 / 2, sin(beta) = t / L_1, of four hinges; error of order (h / L_1)^2."""
    length, step = ELEMENTS.chain_length, 1e-5

    def energy(travel: float) -> float:
        return 4 * ELEMENTS.hinge_stiffness * math.asin(travel / length) ** 2 / 2

    curvature = (energy(step) - 2 * energy(0.0) + energy(-step)) / step**2
    hinges = axis("X/Y", Topology(0, 0, guide_hinges=4), ELEMENTS)
    assert hinges.stiffness == pytest.approx(curvature, rel=(step / length) ** 2)


def test_the_inconsistency_of_equation_21_shows() -> None:
    """Four M_b need four K_b: 57 N/mm instead of 18.3. Two opposed amplifiers with eight hinges make 2 K_x exactly."""
    assert not PRINTED_XY.consistent
    assert all(topology.consistent for topology in (PRINTED_Z, OPPOSED_XY, PARALLEL_XY))
    assert dataclasses.replace(PRINTED_XY, bending_amplifiers=4) == PARALLEL_XY
    printed, opposed, parallel = (axis("X", t, ELEMENTS) for t in (PRINTED_XY, OPPOSED_XY, PARALLEL_XY))
    assert opposed.stiffness == pytest.approx(2 * printed.stiffness, rel=1e-13)
    assert abs(parallel.stiffness - 57e3) <= 0.5e3
    assert parallel.mass == printed.mass
    assert opposed.mass == pytest.approx(printed.mass - 2 * ELEMENTS.amplifier_mass, rel=1e-13)


def test_terms_stand_in_a_table_with_their_equation() -> None:
    x, _ = as_printed(ELEMENTS)
    table = x.table()
    assert [(name, count) for name, count, _, _ in table] == [
        ("table M_s", 1),
        ("amplifiers M_b", 4),
        ("amplifiers K_b", 1),
        ("guide hinges K_r", 4),
    ]
    assert sum(quantity.value for _, _, quantity, _ in table if quantity.si == "kg") == pytest.approx(x.mass)
    assert sum(quantity.value for _, _, quantity, _ in table if quantity.si == "N/m") == pytest.approx(x.stiffness)
    assert {where for *_, where in table} == {"Lin et al. (2019), eq. (21)"}
    others = axis("X", OPPOSED_XY, ELEMENTS).table()
    assert {where for *_, where in others} == {"Lin et al. (2019), eq. (21), other counts"}
    assert table[3][2].formatted() == "5.501 N/mm"


# --- the drive


def test_driven_axis_returns_the_printed_gain() -> None:
    """The paper's case, a load as stiff as the amplifier; dimensions and stiffness are rounded to four digits."""
    x, _ = as_printed(ELEMENTS)
    driven = DrivenAxis(x, XY)
    assert driven.load == XY.output_stiffness
    assert abs(driven.input_stiffness - 1.8e6) <= 0.05e6
    assert driven.gain == pytest.approx(6.0777, rel=2e-3)  # K_x 18.30, lambda 4.046, K_in 1800: a few 1e-4 each
    assert driven.gain == static_gain(driven.input_stiffness, driven.amplification, x.stiffness)
    free = DrivenAxis(x, XY, output_load=0.0)
    assert free.input_stiffness == XY.input_stiffness()
    assert free.amplification == XY.amplification()


# --- refusals


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"count": 0}, "count"),
        ({"amount": -1.0}, "amount"),
        ({"amount": math.inf}, "amount"),
        ({"arm_length": 0.0}, "arm"),
        ({"arm_length": math.nan}, "arm"),
    ],
)
def test_terms_that_cannot_be(values: dict[str, float], words: str) -> None:
    with pytest.raises(ValueError, match=f"springs.*{words}"):
        Term(**{"name": "springs", "count": 1, "amount": 1.0, **values})


@pytest.mark.parametrize(
    "values",
    [{"guides": -1}, {"bending_amplifiers": 1.5}, {"amplifier_share": 0.0}, {"guide_share": math.nan}],
)
def test_topologies_that_cannot_be(values: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(values))):
        Topology(**{"moving_amplifiers": 1, "bending_amplifiers": 1, **values})


def test_an_amplification_is_positive() -> None:
    with pytest.raises(ValueError, match="amplification"):
        amplifier(
            input_block=M_1, output_block=M_3, arm_inertia=J, hinge_stiffness=K_R, arm_span=L_X, amplification=0.0
        )


def test_without_mass_there_is_no_frequency() -> None:
    with pytest.raises(ValueError, match="spring has no mass"):
        _ = Coordinate("spring", (), (Term("spring", 1, 1.0),)).natural_frequency

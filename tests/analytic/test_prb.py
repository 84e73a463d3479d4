"""The pseudo-rigid-body model against statics, numerical integration and the numbers of Lin et al. (2019).

Every published number is compared within half of its last printed digit, never looser. The dimensions are
reconstructed from those same numbers, so that agreement with the paper's model row is true by construction;
what it does prove is that the equations are the paper's.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from flexdesign.analytic.prb import PseudoRigidBridge, intermediates, leaf_rotational_stiffness, quantities

XY = PseudoRigidBridge(
    youngs_modulus=45e9,
    width=20e-3,
    hinge_thickness=0.5e-3,
    hinge_length=3.30e-3,
    arm_span=21.07e-3,
    arm_offset=1.213e-3,
    rod_length=13.58e-3,
    rod_thickness=3e-3,
)
Z = dataclasses.replace(XY, arm_offset=0.828e-3, rod_length=12.43e-3)


def between(low: float, high: float) -> st.SearchStrategy[float]:
    """Return numbers of every order of magnitude between `low` and `high`."""
    return st.floats(math.log(low), math.log(high)).map(math.exp)


def concave(bridge: PseudoRigidBridge) -> PseudoRigidBridge:
    """Return the bridge with its arms falling, by no more than its rods are long."""
    fall = min(bridge.arm_offset, bridge.rod_length or math.inf)
    return dataclasses.replace(bridge, arm_offset=-fall)


CONVEX = st.builds(
    PseudoRigidBridge,
    youngs_modulus=between(1e9, 4e11),
    width=between(1e-3, 0.1),
    hinge_thickness=between(1e-4, 2e-3),
    hinge_length=between(5e-4, 1e-2),
    arm_span=between(5e-3, 0.1),
    arm_offset=between(1e-4, 1e-2),
    rod_length=st.one_of(st.just(0.0), between(1e-3, 5e-2)),
    rod_thickness=between(5e-4, 2e-2),
)
BRIDGES = st.one_of(CONVEX, CONVEX.map(concave))
RODDED = BRIDGES.filter(lambda bridge: bridge.rod_length > 0)
LOADS = st.one_of(st.just(0.0), between(1.0, 1e8))
FORCES = between(1e-2, 1e4)


# --- the printed numbers


@pytest.mark.parametrize(
    ("bridge", "k_in", "amplification"),
    [
        (XY, (1.8e6, 0.05e6), (4.05, 0.005)),  # Table 1: 1.8 N/um; lambda from eqs. (30), (31)
        (Z, (2.6e6, 0.05e6), (3.99, 0.005)),  # Table 1: 2.6 N/um
    ],
)
def test_paper_case_is_a_load_as_stiff_as_the_output(
    bridge: PseudoRigidBridge, k_in: tuple[float, float], amplification: tuple[float, float]
) -> None:
    load = bridge.output_stiffness
    assert abs(bridge.input_stiffness(load) - k_in[0]) <= k_in[1]
    assert abs(bridge.amplification(load) - amplification[0]) <= amplification[1]


def test_reconstructed_xy_amplifier_to_the_digits_it_was_worked_out_to() -> None:
    assert abs(XY.input_stiffness(XY.output_stiffness) - 1800e3) <= 0.5e3
    assert abs(XY.input_stiffness() - 1431e3) <= 0.5e3
    assert abs(XY.amplification() - 6.44) <= 0.005
    assert abs(XY.output_stiffness - 12.8e3) <= 0.05e3
    assert abs(Z.output_stiffness - 12.8e3) <= 0.05e3


def test_z_output_stiffness_is_that_of_two_amplifiers() -> None:
    # Eq. (21) makes K_z = 2 K_b; Table 1 prints 25.6 N/mm.
    assert abs(2 * Z.output_stiffness - 25.6e3) <= 0.05e3


def test_published_xy_input_gives_the_output_behind_the_coupling_ratio() -> None:
    # 20 um of extension at lambda = 4.05 are 80.9 um of travel.
    force = 20e-6 * XY.input_stiffness(XY.output_stiffness)
    found = intermediates(XY, force, XY.output_stiffness)
    assert found["extension"].value == pytest.approx(20e-6, rel=1e-12)
    assert abs(found["travel"].value - 20e-6 * 4.05) <= 20e-6 * 0.005


# --- the equations


@given(BRIDGES, FORCES, LOADS)
def test_moments_balance(bridge: PseudoRigidBridge, force: float, load: float) -> None:
    """Eqs. (1), (2), (3) and (6) hold together, with the load in place of K_out."""
    rotation = bridge.rotation(force, load)
    moment = 0.0
    for _ in range(2):  # both hinges of the arm
        moment += (
            leaf_rotational_stiffness(bridge.youngs_modulus, bridge.width, bridge.hinge_thickness, bridge.hinge_length)
            * rotation
        )
    output_force = load * (bridge.arm_span * rotation)
    driving = force * bridge.arm_offset
    assert output_force * bridge.arm_span + moment == pytest.approx(driving, rel=1e-12)
    assert bridge.output_force(force, load) * bridge.arm_span + 2 * bridge.hinge_moment(force, load) == pytest.approx(
        driving, rel=1e-12
    )
    assert bridge.output_displacement(force, load) == pytest.approx(bridge.arm_span * rotation, rel=1e-12)


@given(BRIDGES, FORCES, LOADS)
def test_virtual_work(bridge: PseudoRigidBridge, force: float, load: float) -> None:
    """Eq. (8): what force and load do not cancel turns the hinges."""
    work_in = force * bridge.arm_input_displacement(force, load)
    work_out = bridge.output_force(force, load) * bridge.output_displacement(force, load)
    hinges = 2 * bridge.hinge_moment(force, load) * bridge.rotation(force, load)
    assert hinges + work_out == pytest.approx(work_in, rel=1e-12)


@given(BRIDGES, FORCES, LOADS)
def test_output_stiffness_is_the_energy_of_eight_hinges(bridge: PseudoRigidBridge, force: float, load: float) -> None:
    """Eqs. (4) and (5)."""
    travel = 2 * bridge.output_displacement(force, load)
    assert bridge.output_stiffness * travel**2 / 2 == pytest.approx(bridge.hinge_energy(force, load), rel=1e-12)


@given(BRIDGES, FORCES)
def test_the_load_of_the_paper_gives_the_printed_coefficients(bridge: PseudoRigidBridge, force: float) -> None:
    load, k_r, l_y = bridge.output_stiffness, bridge.hinge_stiffness, bridge.arm_offset
    assert bridge.rotation(force, load) == pytest.approx(force * l_y / (4 * k_r), rel=1e-12)  # (7)
    dx = bridge.arm_input_displacement(force, load)
    assert dx == pytest.approx(force * l_y**2 / (4 * k_r), rel=1e-12)  # (9)
    assert bridge.moment_arm(load) == pytest.approx(l_y / 4, rel=1e-12)  # (13)
    assert bridge.rod_coefficient(load) == pytest.approx(1.5 * l_y, rel=1e-12)  # (14)
    assert bridge.rod_coefficient(0.0) == pytest.approx(3 * l_y, rel=1e-12)


@given(RODDED)
def test_input_stiffness_and_amplification_as_printed(bridge: PseudoRigidBridge) -> None:
    """Eq. (17), typed in as the paper has it."""
    b, k_r = bridge, bridge.hinge_stiffness
    arm = b.arm_offset**2 / (4 * k_r)
    rod = 6 * b.rod_length**3 + 1.5 * b.arm_offset * b.rod_length**2 - 2 * b.rod_length**3
    sum_ = arm + rod / (b.youngs_modulus * b.width * b.rod_thickness**3)
    load = b.output_stiffness
    assert b.input_stiffness(load) == pytest.approx(1 / sum_, rel=1e-12)
    assert b.amplification(load) == pytest.approx(b.arm_span * b.arm_offset / (4 * k_r) / sum_, rel=1e-12)


@pytest.mark.parametrize("bridge", [XY, concave(XY)])
@pytest.mark.parametrize("load_share", [0.0, 0.3, 1.0, 7.0])
@pytest.mark.parametrize("place", [0.25, 0.6, 1.0])
def test_rod_against_numerical_integration(bridge: PseudoRigidBridge, load_share: float, place: float) -> None:
    """Eqs. (10), (14), (15): integrate M/(EI) of a cantilever with tip force and moment, once and twice."""
    force, y_end, length = 18.0, place * bridge.rod_length, bridge.rod_length
    leaf = 45e9 * 20e-3 * 0.5e-3**3 / (12 * 3.30e-3)
    tip_moment = force * bridge.arm_offset * leaf / (2 * leaf + load_share * 2 * leaf)
    bending = 45e9 * 20e-3 * 3e-3**3 / 12

    def curvature(y: float) -> float:
        return (force * (length - y) + tip_moment) / bending

    rotation, _ = quad(curvature, 0, y_end, epsabs=0, epsrel=1e-12)
    deflection, _ = quad(lambda y: (y_end - y) * curvature(y), 0, y_end, epsabs=0, epsrel=1e-12)
    load = load_share * bridge.output_stiffness
    assert bridge.rod_moment(y_end, force, load) == pytest.approx(curvature(y_end) * bending, rel=1e-10)
    assert bridge.rod_rotation(y_end, force, load) == pytest.approx(rotation, rel=1e-10)
    assert bridge.rod_deflection(y_end, force, load) == pytest.approx(deflection, rel=1e-10)
    if place == 1.0:
        assert bridge.rod_tip_deflection(force, load) == pytest.approx(deflection, rel=1e-10)


# --- limits


@given(BRIDGES, LOADS)
def test_without_a_rod_the_amplification_is_kinematic(bridge: PseudoRigidBridge, load: float) -> None:
    stiff = dataclasses.replace(bridge, rod_length=0.0)
    assert stiff.amplification(load) == pytest.approx(bridge.arm_span / bridge.arm_offset, rel=1e-12)


def test_a_rigid_load_leaves_a_cantilever_with_a_tip_force() -> None:
    bending = 45e9 * 20e-3 * 3e-3**3 / 12
    assert XY.input_stiffness(1e18) == pytest.approx(3 * bending / XY.rod_length**3, rel=1e-9)
    assert XY.amplification(1e18) < 1e-9


def test_a_load_stiffens_the_input_and_costs_amplification() -> None:
    loads = [0.0, 1e3, 1e4, 1e5, 1e6]
    stiffness = [XY.input_stiffness(load) for load in loads]
    amplification = [XY.amplification(load) for load in loads]
    assert all(np.diff(stiffness) > 0)
    assert all(np.diff(amplification) < 0)


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(PseudoRigidBridge)])
@pytest.mark.parametrize("value", [-1e-3, math.nan])
def test_refuses_what_is_not_positive(field: str, value: float) -> None:
    if field == "arm_offset" and value < 0:
        assert dataclasses.replace(XY, arm_offset=value).amplification() < 0  # a concave bridge
        return
    with pytest.raises(ValueError, match=field):
        dataclasses.replace(XY, **{field: value})


# --- concave bridges


@given(CONVEX, LOADS)
def test_without_a_rod_a_concave_bridge_is_the_convex_one_with_its_output_reversed(
    bridge: PseudoRigidBridge, load: float
) -> None:
    convex = dataclasses.replace(bridge, rod_length=0.0)
    other = dataclasses.replace(convex, arm_offset=-convex.arm_offset)
    assert other.input_stiffness(load) == convex.input_stiffness(load)
    assert other.amplification(load) == -convex.amplification(load)
    reverse = np.diag([1.0, -1.0])
    np.testing.assert_array_equal(other.port_compliance(), reverse @ convex.port_compliance() @ reverse)
    assert other.output_stiffness_with_input(6e7) == convex.output_stiffness_with_input(6e7)


@given(CONVEX.map(concave).filter(lambda bridge: bridge.rod_length > 0), LOADS)
def test_the_hinge_moment_relieves_the_rod_of_a_concave_bridge(bridge: PseudoRigidBridge, load: float) -> None:
    """Beside a cantilever that the force alone bends, F l_1^3 / (3 E I)."""
    alone = bridge.rod_length**3 / (3 * bridge.rod_bending_stiffness)
    assert bridge.rod_tip_deflection(1.0, load) < alone * (1 + 1e-12)
    assert bridge.rod_coefficient() == pytest.approx(3 * bridge.arm_offset, rel=1e-12)
    convex = dataclasses.replace(bridge, arm_offset=-bridge.arm_offset)
    assert bridge.input_stiffness(load) > convex.input_stiffness(load) * (1 - 1e-12)
    assert bridge.output_stiffness == convex.output_stiffness
    assert bridge.rod_tip_deflection(1.0, load) + convex.rod_tip_deflection(1.0, load) == pytest.approx(2 * alone)


def test_a_concave_bridge_has_no_rods_that_give_out_energy() -> None:
    """At l_1 = 3 |l_y| / 4 the rod's deflection is nil and the bridge passes on all energy; below it is refused."""
    shortest = dataclasses.replace(XY, arm_offset=-4e-3, rod_length=3e-3)
    assert shortest.rod_tip_deflection(1.0) == pytest.approx(0.0, abs=1e-9 / shortest.input_stiffness())
    passed_on = shortest.amplification() ** 2 * shortest.output_stiffness / shortest.input_stiffness()
    assert passed_on == pytest.approx(1.0, rel=1e-9)
    with pytest.raises(ValueError, match="rod_length of a concave bridge"):
        dataclasses.replace(shortest, rod_length=2.9e-3)
    with pytest.raises(ValueError, match="arm_offset must be positive"):
        dataclasses.replace(XY, arm_offset=0.0)


def test_intermediates_of_a_concave_bridge_move_outwards() -> None:
    found = intermediates(concave(XY), 36.0)
    outwards = {"dalpha", "M", "dy", "M(l_1)", "c", "travel", "lambda"}
    assert {name for name, quantity in found.items() if quantity.value < 0} == outwards
    assert found["F_y"].formatted() == "0 N"


# --- between the ports


@given(BRIDGES)
def test_ports_keep_the_numbers_of_the_paper_and_passivity(bridge: PseudoRigidBridge) -> None:
    compliance = bridge.port_compliance()
    assert 1 / compliance[0, 0] == pytest.approx(bridge.input_stiffness(), rel=1e-12)
    assert compliance[1, 0] / compliance[0, 0] == pytest.approx(bridge.amplification(), rel=1e-12)
    assert 1 / compliance[1, 1] == pytest.approx(bridge.output_stiffness, rel=1e-12)
    assert compliance[0, 1] == compliance[1, 0]
    # No more energy out than in; equality for a mechanism in which nothing but the hinges gives way.
    assert bridge.amplification() ** 2 * bridge.output_stiffness / bridge.input_stiffness() <= 1 + 1e-12


@given(RODDED, between(1e5, 1e9))
def test_output_behind_an_actuator_against_the_stiffness_matrix(bridge: PseudoRigidBridge, spring: float) -> None:
    c = bridge.port_compliance()
    determinant = c[0, 0] * c[1, 1] - c[0, 1] ** 2
    reference = np.array([[c[1, 1], -c[0, 1]], [-c[0, 1], c[0, 0]]]) / determinant
    reference[0, 0] += spring
    schur = reference[1, 1] - reference[0, 1] ** 2 / reference[0, 0]
    # The reference subtracts nearly equal numbers twice: leave out the cases in which it loses its digits.
    assume(c[0, 0] * c[1, 1] / determinant * reference[1, 1] / schur < 1e5)
    assert bridge.output_stiffness_with_input(spring) == pytest.approx(schur, rel=1e-9)


def test_output_with_input_held() -> None:
    compliance = XY.port_compliance()
    held = 1 / (compliance[1, 1] - compliance[0, 1] ** 2 / compliance[0, 0])
    assert XY.output_stiffness_with_input() == pytest.approx(held, rel=1e-9)
    assert XY.output_stiffness < XY.output_stiffness_with_input(60e6) < held
    rodless = dataclasses.replace(XY, rod_length=0.0)
    assert rodless.output_stiffness_with_input() == math.inf
    # A rigid mechanism hands the actuator on as lambda^-2 k, beside its own hinges.
    ratio = rodless.arm_span / rodless.arm_offset
    expected = rodless.output_stiffness + 60e6 / ratio**2
    assert rodless.output_stiffness_with_input(60e6) == pytest.approx(expected, rel=1e-12)


@settings(deadline=None)
@given(RODDED)
def test_reciprocity_defect_from_the_equations_of_the_paper(bridge: PseudoRigidBridge) -> None:
    output_force = 1.0  # along the motion, on a quarter: F_y = -1, F_x = 0
    moment = output_force * bridge.arm_span / 2  # (1)
    rotation = moment / bridge.hinge_stiffness  # (2)
    bending = bridge.youngs_modulus * bridge.width * bridge.rod_thickness**3 / 12
    length = bridge.rod_length
    tip, _ = quad(lambda y: (length - y) * moment / bending, 0, length, epsabs=0)  # (10)
    input_motion = bridge.arm_offset * rotation + tip  # (16)
    output_motion = bridge.output_displacement(1.0)
    assert bridge.reciprocity_defect == pytest.approx(input_motion / output_motion - 1, rel=1e-6, abs=1e-12)


def test_reciprocity_defect_is_not_small_in_the_reconstructed_amplifier() -> None:
    assert 0.106 < XY.reciprocity_defect < 0.107
    assert 0.130 < Z.reciprocity_defect < 0.131
    assert dataclasses.replace(XY, rod_length=0.0).reciprocity_defect == 0.0


# --- as quantities


def test_quantities_name_their_boundary() -> None:
    free = quantities(XY, actuator_stiffness=60e6)
    assert list(free) == [
        "K_in_output_free",
        "lambda_output_free",
        "K_out_input_free",
        "K_out_input_held",
        "K_out_actuator_installed",
    ]
    assert free["K_in_output_free"].formatted() == "1431 N/mm"
    assert free["lambda_output_free"].to_json()["unit"] == "1"
    assert "generalised" in free["K_in_output_free"].source
    loaded = quantities(XY, XY.output_stiffness)
    assert loaded["K_in_output_loaded_by_12.80_N/mm"].boundary == "output loaded by 12.80 N/mm"
    assert "generalised" not in loaded["lambda_output_loaded_by_12.80_N/mm"].source
    assert loaded["K_out_input_free"].value == free["K_out_input_free"].value


def test_quantities_leave_out_what_is_infinite() -> None:
    rodless = dataclasses.replace(XY, rod_length=0.0)
    assert "K_out_input_held" not in quantities(rodless)
    assert all(math.isfinite(q.value) for q in quantities(rodless, actuator_stiffness=60e6).values())


@pytest.mark.parametrize("load", [-1.0, math.nan, math.inf])
def test_quantities_refuse_a_load_that_is_no_stiffness(load: float) -> None:
    with pytest.raises(ValueError, match="output load"):
        quantities(XY, load)


def test_intermediates_are_per_total_force_and_name_their_equation() -> None:
    found = intermediates(XY, 36.0, XY.output_stiffness)
    assert found["F_x"].value == 18.0
    assert found["K_in"].value == pytest.approx(36.0 / found["extension"].value, rel=1e-12)
    assert found["lambda"].value == pytest.approx(found["travel"].value / found["extension"].value, rel=1e-12)
    assert found["F_y"].value == pytest.approx(XY.output_stiffness * found["travel"].value / 2, rel=1e-12)
    # The rod's tip bears the hinge moment.
    assert found["M(l_1)"].value == pytest.approx(found["M"].value, rel=1e-9)
    assert found["dx_in"].value == pytest.approx(found["dx"].value + found["dx_2"].value, rel=1e-12)
    named = " ".join(quantity.source for quantity in found.values())
    assert all(f"({number})" in named for number in (2, 3, 4, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15, 16, 17))
    for name, quantity in found.items():
        assert quantity.name == name
        assert math.isfinite(quantity.to_json()["value"])  # every display unit matches its SI unit
    assert found["K_out"].boundary == "input free"
    assert intermediates(XY, 36.0)["F_y"].value == 0.0

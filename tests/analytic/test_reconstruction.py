"""Dimensions from targets: the numbers worked out by hand for Lin et al. (2019), round trips, and contradictions.

That the model returns the targets of the paper is circular by construction. Round trips prove that the equations were
solved, for these targets and for any others; the equations themselves are tried in test_prb, test_lagrange and
test_coupling.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexdesign.analytic.lagrange import OPPOSED_XY, PARALLEL_XY, PRINTED_XY, PRINTED_Z
from flexdesign.analytic.prb import PseudoRigidBridge
from flexdesign.analytic.reconstruction import (
    AxisTargets,
    Choices,
    Contradiction,
    CouplingTargets,
    Targets,
    amplification_from_gain,
    reconstruct,
    rod_length,
)

GAINS = (6.0777, 6.3621)  # eq. (31)
PAPER = Targets(  # Table 1's model row
    AxisTargets(18.3e3, 1.8e6, amplification_from_gain(1.8e6, 18.3e3, GAINS[0])),
    AxisTargets(25.6e3, 2.6e6, amplification_from_gain(2.6e6, 25.6e3, GAINS[1])),
    CouplingTargets(20e-6, 0.089e-2, 0.045e-2),
)
CHOICES = Choices(youngs_modulus=45e9, width=20e-3, hinge_thickness=0.5e-3, rod_thickness=3e-3)
FOUND = reconstruct(PAPER, CHOICES)


def between(low: float, high: float) -> st.SearchStrategy[float]:
    """Return numbers of every order of magnitude between `low` and `high`."""
    return st.floats(math.log(low), math.log(high)).map(math.exp)


# --- the paper


@pytest.mark.parametrize(
    ("name", "found", "expected", "half_digit"),
    [
        # Worked out by hand from the same printed numbers, independently of the code; half of the last digit.
        ("lambda, X/Y", PAPER.xy.amplification, 4.046, 0.0005),
        ("lambda, Z", PAPER.z.amplification, 3.991, 0.0005),
        ("travel", FOUND.travel, 80.9e-6, 0.05e-6),
        ("K_b", FOUND.amplifier_stiffness, 12.8e3, 0.05e3),
        ("L_1", FOUND.chain_length_y, 45.5e-3, 0.05e-3),
        ("L_2", FOUND.chain_length_z, 89.9e-3, 0.05e-3),
        ("K_r", FOUND.hinge_stiffness, 2.842, 0.0005),
        ("l_x", FOUND.xy.arm_span, 21.07e-3, 0.005e-3),
        ("l_y, X/Y", FOUND.xy.arm_offset, 1.213e-3, 0.0005e-3),
        ("l_y, Z", FOUND.z.arm_offset, 0.828e-3, 0.0005e-3),
        ("rod, X/Y", FOUND.rod_compliance_xy, 4.262e-7, 0.0005e-7),
        ("rod, Z", FOUND.rod_compliance_z, 3.243e-7, 0.0005e-7),
        ("hinge length", FOUND.xy.hinge_length, 3.30e-3, 0.005e-3),
        ("l_1, X/Y", FOUND.xy.rod_length, 13.58e-3, 0.005e-3),
        ("l_1, Z", FOUND.z.rod_length, 12.43e-3, 0.005e-3),
    ],
)
def test_dimensions_of_the_paper_s_stage(name: str, found: float, expected: float, half_digit: float) -> None:
    assert abs(found - expected) <= half_digit, name


def test_table_1_comes_back_to_the_printed_figures() -> None:
    """18.3 / 25.6 N/mm, 1.8 / 2.6 N/um, 0.089 / 0.045 %, (31)'s gains: circular, to half of the last digit printed."""
    back = FOUND.recomputed_targets()
    assert abs(back.xy.output_stiffness - 18.3e3) <= 0.05e3
    assert abs(back.z.output_stiffness - 25.6e3) <= 0.05e3
    assert abs(back.xy.input_stiffness - 1.8e6) <= 0.05e6
    assert abs(back.z.input_stiffness - 2.6e6) <= 0.05e6
    assert abs(back.coupling.y_from_x - 0.089e-2) <= 0.0005e-2
    assert abs(back.coupling.z_from_x - 0.045e-2) <= 0.0005e-2
    assert [driven.gain for driven in FOUND.axes_under_load()] == pytest.approx(GAINS, abs=0.00005)


def test_the_rounded_dimensions_are_the_ones_in_use() -> None:
    """PRB with the dimensions as the design file has them, four digits, returns Table 1's input stiffness as well."""
    rounded = PseudoRigidBridge(45e9, 20e-3, 0.5e-3, 3.30e-3, 21.07e-3, 1.213e-3, 13.58e-3, 3e-3)
    for field in dataclasses.fields(rounded):
        assert getattr(FOUND.xy, field.name) == pytest.approx(getattr(rounded, field.name), rel=5e-4)


def test_with_the_gain_of_31_as_amplification_the_chain_is_longer() -> None:
    other = dataclasses.replace(PAPER, xy=dataclasses.replace(PAPER.xy, amplification=GAINS[0]))
    assert abs(reconstruct(other, CHOICES).chain_length_y - 68.3e-3) <= 0.05e-3


def test_other_topologies_of_the_same_elements() -> None:
    assert FOUND.axis("X", PRINTED_XY).stiffness == pytest.approx(18.3e3, rel=1e-12)
    assert FOUND.axis("X", OPPOSED_XY).stiffness == pytest.approx(36.6e3, rel=1e-12)
    assert abs(FOUND.axis("X", PARALLEL_XY).stiffness - 57e3) <= 0.5e3


# --- round trips

AXES = st.builds(AxisTargets, between(1e3, 1e6), between(1e5, 1e8), between(1.0, 20.0), st.floats(0.0, 5.0))


@st.composite
def possible_targets(draw: st.DrawFn) -> Targets:
    """Return targets that some dimensions meet: K_x above what amplifiers make, K_in above what the output holds."""
    topology_xy = draw(st.sampled_from([PRINTED_XY, OPPOSED_XY, PARALLEL_XY]))
    z = draw(AXES)
    k_b = z.output_stiffness / 2  # eight amplifiers at half the travel
    k_x = topology_xy.bending_amplifiers * k_b * (1 + draw(between(0.01, 10.0)))
    axes = []
    for wanted, stiffness in ((draw(AXES), k_x), (z, z.output_stiffness)):
        held = wanted.amplification**2 * k_b * (1 + wanted.load_ratio)
        axes.append(
            dataclasses.replace(
                wanted, output_stiffness=stiffness, input_stiffness=held * (1 + draw(between(1e-3, 100.0)))
            )
        )
    ratios = CouplingTargets(draw(between(1e-6, 1e-4)), draw(between(1e-5, 0.3)), draw(between(1e-5, 0.3)))
    return Targets(*axes, ratios, topology_xy, PRINTED_Z)


@given(possible_targets(), between(1e9, 4e11), between(1e-3, 0.1), between(5e-4, 2e-2))
def test_targets_come_back(targets: Targets, modulus: float, width: float, rod: float) -> None:
    # So thin that hinges are shorter than arms, whatever these are.
    back = reconstruct(targets, Choices(modulus, width, 1e-8, rod)).recomputed_targets()
    for part in ("xy", "z", "coupling"):
        asked, given_back = (dataclasses.astuple(getattr(each, part)) for each in (targets, back))
        # Rods that are a thousandth of the compliance are a difference that has lost three digits, and 1e-16 goes to
        # 1e-13; the guides' share of K_x loses two.
        assert given_back == pytest.approx(asked, rel=1e-11), part


@given(between(1e-9, 1e-5), between(1e-5, 0.1), st.floats(0.0, 5.0), between(1e-4, 0.02))
def test_rod_against_the_deflection_of_the_model(compliance: float, l_y: float, load: float, thickness: float) -> None:
    choices = dataclasses.replace(CHOICES, rod_thickness=thickness)
    length = rod_length(compliance, l_y, load, choices)
    bridge = PseudoRigidBridge(45e9, 20e-3, 0.5e-3, 3.3e-3, 0.02, l_y, length, thickness)
    assert bridge.rod_tip_deflection(1.0, load * bridge.output_stiffness) == pytest.approx(compliance, rel=1e-11)


@given(between(1e-9, 1e-5), between(1e-5, 0.01), st.floats(0.0, 5.0))
def test_rod_of_a_concave_bridge_is_longer(compliance: float, l_y: float, load: float) -> None:
    """(15) typed in with the moment against the force: 6 l^3 - c l^2 - 2 l^3, c = 1.5 l_y at the paper's load."""
    convex, concave = (rod_length(compliance, sign * l_y, load, CHOICES) for sign in (1, -1))
    assert convex < concave
    c = 1.5 * l_y * 2 / (1 + load)
    for length, sign in ((convex, 1), (concave, -1)):
        tip = (6 * length**3 + sign * c * length**2 - 2 * length**3) / (45e9 * 20e-3 * 3e-3**3)
        # A concave rod's two terms cancel where it is little longer than c/4: c / (4 l) of up to 1 - 1e-5 here.
        assert tip == pytest.approx(compliance, rel=1e-9)


# --- contradictions


def changed(path: str, value: Any) -> Targets:
    """Return the paper's targets with one changed."""
    table, _, name = path.partition(".")
    if not name:
        return dataclasses.replace(PAPER, **{table: value})
    return dataclasses.replace(PAPER, **{table: dataclasses.replace(getattr(PAPER, table), **{name: value})})


@pytest.mark.parametrize(
    ("path", "value", "field", "words"),
    [
        ("xy.output_stiffness", 12.8e3, "xy.output_stiffness", "nothing is left"),
        ("xy.output_stiffness", 12.7e3, "xy.output_stiffness", "12.8 N/mm"),
        ("z.output_stiffness", 40e3, "xy.output_stiffness", "less in Z"),
        ("topology_xy", PARALLEL_XY, "xy.output_stiffness", "51.2 N/mm"),
        # lambda^2 K_b (1 + 1) = 1.8e6 at lambda = 8.385
        ("xy.amplification", 9.0, "xy.amplification", "below 8.385"),
        ("z.input_stiffness", 3e5, "z.amplification", "0.4077 N/um"),
        ("coupling.y_from_x", 1.2, "coupling.y_from_x", "at most 1"),
        ("coupling.z_from_x", 0.0, "coupling.z_from_x", "positive"),
        ("xy.input_stiffness", -1.8e6, "xy.input_stiffness", "positive"),
        ("xy.load_ratio", -0.5, "xy.load_ratio", "positive"),
        ("z.amplification", math.nan, "z.amplification", "positive"),
        ("topology_xy", dataclasses.replace(PRINTED_XY, guide_hinges=0), "topology_xy.guide_hinges", "K_r"),
        ("topology_z", dataclasses.replace(PRINTED_Z, bending_amplifiers=0), "topology_z.bending_amplifiers", "K_b"),
        ("topology_z", dataclasses.replace(PRINTED_Z, guide_hinges=4), "topology_z.guide_hinges", "K_b"),
    ],
)
def test_targets_that_contradict_each_other(path: str, value: Any, field: str, words: str) -> None:
    with pytest.raises(Contradiction) as refused:
        reconstruct(changed(path, value), CHOICES)
    assert isinstance(refused.value, ValueError)
    assert refused.value.field == field
    assert words in refused.value.remedy


def test_the_limits_that_refusals_state_are_the_limits() -> None:
    with pytest.raises(Contradiction, match=r"below 8\.385"):
        reconstruct(changed("xy.amplification", 8.386), CHOICES)
    assert reconstruct(changed("xy.amplification", 8.384), CHOICES).xy.rod_length > 0
    thick = dataclasses.replace(CHOICES, hinge_thickness=1e-3)
    with pytest.raises(Contradiction, match=r"thinner than 0\.9277 mm"):
        reconstruct(PAPER, thick)
    fits = reconstruct(PAPER, dataclasses.replace(CHOICES, hinge_thickness=0.927e-3))
    assert fits.xy.hinge_length < fits.xy.arm_span


@pytest.mark.parametrize("name", [field.name for field in dataclasses.fields(Choices)])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_choices_are_positive(name: str, value: float) -> None:
    with pytest.raises(Contradiction, match=name):
        dataclasses.replace(CHOICES, **{name: value})

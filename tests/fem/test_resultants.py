"""Section forces against statics, and their compliance against Timoshenko's beam."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from flexdesign.core.model import Member
from flexdesign.design.part import SymmetryPlane
from flexdesign.fem.post_processing import resultants
from flexdesign.fem.post_processing.resultants import Section
from studies.verification.solids import CORK, METAL, Array, Solid, beam
from tests.fem.solids import Solved, solve

LENGTH, HEIGHT, WIDTH = 40e-3, 4e-3, 5e-3
E, G, AREA, INERTIA = CORK.youngs_modulus, CORK.shear_modulus, HEIGHT * WIDTH, WIDTH * HEIGHT**3 / 12
WHOLE = Member("beam", "arm", ("ground", "output"), (0.0, 0.0, 0.0), (LENGTH, 0.0, 0.0), HEIGHT, WIDTH)
MIDDLE = dataclasses.replace(WHOLE, name="middle", start=(LENGTH / 4, 0.0, 0.0), end=(LENGTH / 2, 0.0, 0.0))
#: Averages over the middle of a member are cut off at integration points instead of at its ends.
CUT = 0.01


@pytest.fixture(scope="module")
def cantilever() -> Solved:
    return solve(beam(LENGTH, HEIGHT, WIDTH, (30, 4, 3), wobble=1e-4))


def under(solved: Solved, load: Array, members: list[Member]) -> list[Section]:
    """Return the section forces under a load on the tip."""
    field = (solved.displacements[0] @ load).reshape(-1, 3)
    return resultants.sections(solved.body, solved.solid.domain, field, members)


@pytest.mark.parametrize("member", [WHOLE, MIDDLE], ids=lambda m: m.name)
def test_tip_force_and_moment_as_statics_says(cantilever: Solved, member: Member) -> None:
    """N = F_x; V = F_y; M = the moment of what acts on the tip about the member's centre.

    sigma_ss n > 0 is a fibre stretched on the side of n = y: a tip force F_y compresses it.
    """
    force_x, force_y, couple = 300.0, -70.0, 0.9
    (found,) = under(cantilever, np.array([force_x, force_y, 0, 0, 0, couple]), [member])
    arm = LENGTH - member.centre[0]
    assert found.normal == pytest.approx(force_x, rel=CUT)
    assert found.shear == pytest.approx(force_y, rel=CUT)
    assert found.moment == pytest.approx(-(couple + force_y * arm), rel=CUT)


def test_axial_force_and_couple_alone_leave_no_shear(cantilever: Solved) -> None:
    """Tension and pure bending are exact on any mesh; bending mixes into N by the mean n of the integration points."""
    (pulled,) = under(cantilever, np.eye(6)[0], [MIDDLE])
    assert pulled.normal == pytest.approx(1.0, rel=1e-8)
    assert abs(pulled.shear) < 1e-8
    assert abs(pulled.moment) < CUT * HEIGHT
    (bent,) = under(cantilever, np.eye(6)[5], [MIDDLE])
    assert bent.moment == pytest.approx(-1.0, rel=1e-8)
    assert abs(bent.shear) < 1e-6 / HEIGHT
    assert abs(bent.normal) < CUT / HEIGHT


def test_the_member_s_own_axis_counts() -> None:
    """The same beam along y, and with its member drawn from tip to root: forces in the member's own frame."""
    flat = beam(LENGTH, HEIGHT, WIDTH, (30, 4, 3))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    points = flat.mesh.points @ turn.T
    place = dataclasses.replace(flat.ports[0], point=(0.0, LENGTH, 0.0), normal=(0.0, 1.0, 0.0))
    upright = solve(Solid(dataclasses.replace(flat.mesh, points=points), flat.domain, (place, flat.ports[1]), CORK))
    member = dataclasses.replace(WHOLE, start=(0.0, LENGTH, 0.0), end=(0.0, 0.0, 0.0))  # axis -y, normal x
    (found,) = under(upright, np.array([5.0, 7.0, 0, 0, 0, 0]), [member])
    assert found.normal == pytest.approx(7.0, rel=CUT)
    assert found.shear == pytest.approx(-5.0, rel=CUT)  # sigma_sn = -sigma_yx
    assert abs(found.moment) == pytest.approx(5.0 * LENGTH / 2, rel=CUT)


def test_compliance_through_the_whole_beam_is_timoshenko_s(cantilever: Solved) -> None:
    """L^3/3EI + L/(kappa G A) from the section forces, and the same from the tip's displacement.

    N, V, M are good to 1 %, compliances, being products of two, to twice that.
    """
    (pushed,) = under(cantilever, np.eye(6)[1], [WHOLE])
    split = pushed.shared_compliance(pushed, CORK)
    assert split["bending"] == pytest.approx(LENGTH**3 / (3 * E * INERTIA), rel=2 * CUT)
    assert split["shear"] == pytest.approx(LENGTH / (5 / 6 * G * AREA), rel=2 * CUT)
    assert sum(split.values()) == pytest.approx(cantilever.matrix[1, 1], rel=2 * CUT)
    (pulled,) = under(cantilever, np.eye(6)[0], [WHOLE])
    assert sum(pulled.shared_compliance(pulled, CORK).values()) == pytest.approx(LENGTH / (E * AREA), rel=2 * CUT)


def test_mixed_compliance_is_the_mixed_entry(cantilever: Solved) -> None:
    """Deflection under a couple, L^2 / 2EI, from the section forces of both loads."""
    (pushed,), (bent,) = (under(cantilever, np.eye(6)[k], [WHOLE]) for k in (1, 5))
    mixed = sum(pushed.shared_compliance(bent, CORK).values())
    assert mixed == pytest.approx(LENGTH**2 / (2 * E * INERTIA), rel=2 * CUT)
    assert mixed == pytest.approx(sum(bent.shared_compliance(pushed, CORK).values()), rel=1e-12)


def test_shared_compliance_against_the_integral_along_the_beam() -> None:
    """int N N' / EA + V V' / kappa G A + M M' / EI ds with M linear, by Simpson's rule, exact for products of lines."""
    first, second = Section(MIDDLE, 3.0, -2.0, 0.04), Section(MIDDLE, -1.0, 5.0, 0.07)
    s = np.array([-0.5, 0.0, 0.5]) * MIDDLE.length
    simpson = np.array([1, 4, 1]) / 6 * MIDDLE.length
    lines = (first.moment + first.shear * s) * (second.moment + second.shear * s)
    expected = {
        "axial": first.normal * second.normal * MIDDLE.length / (METAL.youngs_modulus * AREA),
        "shear": first.shear * second.shear * MIDDLE.length / (5 / 6 * METAL.shear_modulus * AREA),
        "bending": simpson @ lines / (METAL.youngs_modulus * INERTIA),
    }
    assert first.shared_compliance(second, METAL) == pytest.approx(expected, rel=1e-12)


def test_less_a_multiple_of_another_load_case() -> None:
    first, second = Section(MIDDLE, 3.0, -2.0, 0.04), Section(MIDDLE, -1.0, 5.0, 0.07)
    found = first.minus(0.5, second)
    assert (found.normal, found.shear, found.moment) == pytest.approx((3.5, -4.5, 0.005), rel=1e-12)


def test_nominal_stress_is_that_of_the_root_fibre(cantilever: Solved) -> None:
    """M/W at the clamp under a tip force, plus F/A."""
    (found,) = under(cantilever, np.array([11.0, 1.0, 0, 0, 0, 0]), [WHOLE])
    expected = LENGTH / (WIDTH * HEIGHT**2 / 6) + 11.0 / AREA
    assert found.nominal_stress == pytest.approx(expected, rel=CUT)


def test_shares_add_up_to_the_total_with_images_counted() -> None:
    hinge = dataclasses.replace(MIDDLE, name="hinge_1", kind="hinge")
    second = dataclasses.replace(hinge, name="hinge_2")
    case = [Section(MIDDLE, 1.0, 2.0, 0.03), Section(hinge, 4.0, 5.0, 0.06), Section(second, 7.0, 8.0, 0.09)]
    split = resultants.shares((case, case), 1e-5, METAL, {"middle": 1, "hinge_1": 2, "hinge_2": 4})
    axial = MIDDLE.length / (METAL.youngs_modulus * AREA)
    assert split["arm axial"] == pytest.approx(1.0 * axial, rel=1e-12)
    assert split["hinge axial"] == pytest.approx((2 * 16.0 + 4 * 49.0) * axial, rel=1e-12)
    assert sum(split.values()) == pytest.approx(1e-5, rel=1e-12)
    assert len(split) == 7  # two kinds, three deformations each, and the remainder


def test_shares_of_a_beam_leave_little_unexplained(cantilever: Solved) -> None:
    case = under(cantilever, np.eye(6)[1], [WHOLE])
    split = resultants.shares((case, case), cantilever.matrix[1, 1], CORK, {"beam": 1})
    assert abs(split["roots, blocks and width"]) < 2 * CUT * cantilever.matrix[1, 1]


def test_ends_of_a_member_belong_to_its_roots() -> None:
    """A beam stretched in its last elements alone, where stresses of a root would be: its section feels nothing."""
    solved = solve(beam(LENGTH, HEIGHT, WIDTH, (30, 2, 2)))
    place = solved.body.positions[:, 0] - LENGTH / 2
    reach = 13 / 30 * LENGTH  # whole elements, beyond four fifths of the half length
    field = np.zeros((len(place), 3))
    field[:, 0] = np.sign(place) * np.maximum(np.abs(place) - reach, 0.0)
    assert solved.body.strain_energy(field) > 0
    (found,) = resultants.sections(solved.body, solved.solid.domain, field, [WHOLE])
    assert abs(found.normal) < 1e-12 * E * AREA


def test_members_beyond_a_plane_are_left_out(cantilever: Solved) -> None:
    domain = dataclasses.replace(cantilever.solid.domain, planes=(SymmetryPlane("x", {}),))
    beyond = dataclasses.replace(WHOLE, name="mirrored", start=(-LENGTH, 0.0, 0.0), end=(0.0, 0.0, 0.0))
    found = resultants.sections(
        cantilever.body, domain, cantilever.displacements[0][:, :1].reshape(-1, 3), [beyond, WHOLE]
    )
    assert [section.member.name for section in found] == ["beam"]

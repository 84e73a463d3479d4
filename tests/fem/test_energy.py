"""Strain energy by region against beam theory, and against the work of the loads."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from flexdesign.core.model import Member
from flexdesign.fem.post_processing import energy
from studies.verification.solids import CORK, METAL, beam
from tests.fem.solids import Solved, ring, solve

LENGTH, HEIGHT, WIDTH = 40e-3, 4e-3, 5e-3
AREA, INERTIA = HEIGHT * WIDTH, WIDTH * HEIGHT**3 / 12
ROOT = Member("root", "hinge", ("ground", "middle"), (0.0, 0.0, 0.0), (LENGTH / 2, 0.0, 0.0), HEIGHT, WIDTH)
TIP = dataclasses.replace(ROOT, name="tip", kind="arm", start=ROOT.end, end=(LENGTH, 0.0, 0.0))


@pytest.fixture(scope="module")
def cantilever() -> Solved:
    """Elements end where the regions do, so that none is cut."""
    return solve(beam(LENGTH, HEIGHT, WIDTH, (30, 4, 3)))


def regions(solved: Solved, members: list[Member]) -> dict[str, tuple[float, float, float]]:
    pushed, pulled = (solved.displacements[0][:, k].reshape(-1, 3) for k in (1, 0))
    return energy.by_region(solved.body, solved.solid.domain, pushed, pulled, members)


def test_halves_of_a_cantilever_hold_what_beam_theory_says(cantilever: Solved) -> None:
    """Int M^2 / 2EI + V^2 / 2 kappa GA over either half; pulled, half of L / 2EA each.

    Quadratic elements, 30 along the beam, are 1 % too stiff in bending at most; tension is exact.
    """
    found = regions(cantilever, [ROOT, TIP])
    bending = LENGTH**3 / (6 * CORK.youngs_modulus * INERTIA)
    shear = LENGTH / 2 / (2 * 5 / 6 * CORK.shear_modulus * AREA)
    assert found["hinge"][0] == pytest.approx(7 / 8 * bending + shear, rel=1e-2)
    assert found["arm"][0] == pytest.approx(1 / 8 * bending + shear, rel=1e-2)
    tension = LENGTH / (4 * CORK.youngs_modulus * AREA)
    assert found["hinge"][2] == pytest.approx(tension, rel=1e-6)
    assert found["arm"][2] == pytest.approx(tension, rel=1e-6)
    assert found["block"] == pytest.approx((0.0, 0.0, 0.0), abs=1e-9 * bending)


def test_regions_add_up_to_the_work_of_the_loads(cantilever: Solved) -> None:
    """Half the compliance, for each load and for both together; what no member claims is the blocks'."""
    found = regions(cantilever, [ROOT])
    assert set(found) == {"hinge", "block"}
    one, mixed, two = (sum(region[k] for region in found.values()) for k in range(3))
    compliance = cantilever.matrix
    assert one == pytest.approx(compliance[1, 1] / 2, rel=1e-8)
    assert two == pytest.approx(compliance[0, 0] / 2, rel=1e-8)
    assert abs(mixed - compliance[0, 1] / 2) < 1e-8 * np.sqrt(one * two)


def test_nothing_is_counted_twice(cantilever: Solved) -> None:
    """Members that overlap: the first one has what both claim."""
    again = dataclasses.replace(ROOT, name="again", kind="rod")
    found = regions(cantilever, [ROOT, again, TIP])
    assert "rod" not in found
    assert found["hinge"] == regions(cantilever, [ROOT, TIP])["hinge"]


def test_a_part_of_a_symmetric_whole_counts_for_its_images() -> None:
    """The field under a unit actuator force, on a quarter: four times its energy is half of C11."""
    solved = solve(ring(METAL))
    space, system = solved.space, solved.systems[0]
    projection = space.projection(system.cls)
    field = (solved.displacements[0] @ (space.halves * (projection @ space.extension))).reshape(-1, 3)
    found = energy.by_region(solved.body, solved.solid.domain, field, field, [])
    work = space.extension @ solved.matrix @ space.extension / 2
    assert found["block"] == pytest.approx((work, work, work), rel=1e-8)

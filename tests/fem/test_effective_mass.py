"""Effective masses of beams against closed forms, of classes against the whole, and their sum against the mass."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la

from flexdesign.fem.post_processing.effective_mass import of_mode, translated_mass
from flexdesign.fem.solving import modes
from flexdesign.fem.solving.port_compliance import classes
from studies.verification.solids import CORK, Array, beam
from tests.fem.solids import RING_PATCHES, Solved, full, ring, solve

LENGTH, HEIGHT, WIDTH = 80e-3, 4e-3, 5e-3
MASS = CORK.density * LENGTH * HEIGHT * WIDTH


def found(solved: Solved, count: int) -> list[tuple[float, Array]]:
    """Return frequencies and effective masses of the lowest modes of every class, by frequency."""
    mass = solved.body.mass()
    moved = translated_mass(mass)
    return sorted(
        (mode.frequency, np.array(of_mode(mode.shape, moved, system.cls)))
        for system in solved.systems
        for mode in modes.class_modes(system, mass, solved.space, count, 0.0)
    )


@pytest.fixture(scope="module")
def cantilever() -> list[Array]:
    """The masses of its modes; 40 elements along it."""
    return [masses for _, masses in found(solve(beam(LENGTH, HEIGHT, WIDTH, (40, 1, 1))), 16)]


@pytest.mark.parametrize(("direction", "depth"), [(1, HEIGHT), (2, WIDTH)])
def test_a_cantilever_s_bending_modes_hold_61_19_and_6_percent(
    cantilever: list[Array], direction: int, depth: float
) -> None:
    """Euler and Bernoulli: 4 (sigma_n / (beta_n L))^2 with sigma_n of Blevins (1979), table 8-1.

    Shear and rotary inertia change shapes by some (h / wave length)^2, which grows with the mode.
    """
    beta, sigma = np.array([1.87510407, 4.69409113, 7.85475744]), np.array([0.734095514, 1.018467319, 0.999224497])
    exact = 4 * (sigma / beta) ** 2
    assert exact == pytest.approx([0.613, 0.188, 0.0647], abs=5e-4)
    bending = [m[direction] / MASS for m in cantilever if m.argmax() == direction and m.max() > 1e-3 * MASS][:3]
    assert np.all(np.abs(bending - exact) < (beta * depth / LENGTH) ** 2 / 4 * exact + 1e-3)


def test_a_rod_s_first_mode_holds_8_over_pi_squared(cantilever: list[Array]) -> None:
    """A quarter wave: (2 / pi)^2 / (1/2); the elements' error is that of the frequency, 1e-7, or less."""
    along = max(m[0] for m in cantilever)
    assert along / MASS == pytest.approx(8 / np.pi**2, rel=1e-6)


def test_masses_grow_to_that_of_the_part(cantilever: list[Array]) -> None:
    """More modes leave less of the mass out, never more than all of it; sixteen hold nine tenths of bending's."""
    sums = np.cumsum(cantilever, axis=0) / MASS
    assert np.all(sums < 1.0)
    assert np.all(sums[-1, 1:] > 0.9)


@pytest.mark.parametrize("cells", [4, 8])
def test_all_modes_of_a_mesh_hold_all_but_what_its_clamped_nodes_carry(cells: int) -> None:
    """By LAPACK. Of a quadratic element's mass the end node keeps 1/9 once the others have given way: h / 9 of L.

    In one dimension (4 - 2/3) / 30; across the section nodes share theirs, which leaves somewhat more than that.
    """
    solved = solve(beam(LENGTH, HEIGHT, WIDTH, (cells, 1, 1)))
    system, mass = solved.systems[0], full(solved.body.mass())
    _, vectors = la.eigh(full(system.stiffness).toarray(), mass[system.free][:, system.free].toarray())
    moved = translated_mass(solved.body.mass())
    total = np.zeros(3)
    for vector in vectors.T:
        shape = np.zeros(solved.body.n_dofs)
        shape[system.free] = vector
        total += of_mode(shape, moved, system.cls)
    left = 1 - total / MASS
    assert np.all(left > 0)
    assert left * cells == pytest.approx(np.full(3, 1 / 9), rel=0.5)


def test_masses_of_a_quarter_s_classes_are_those_of_the_whole() -> None:
    quarter = ring()
    mass = 4 * quarter.material.density * quarter.mesh.volume
    by_class, at_once = found(solve(quarter), 6)[:6], found(solve(quarter.whole(RING_PATCHES)), 6)
    for (frequency, masses), (expected, wanted) in zip(by_class, at_once, strict=True):
        assert frequency == pytest.approx(expected, rel=1e-6)
        np.testing.assert_allclose(masses, wanted, rtol=1e-4, atol=1e-9 * mass)


def test_a_translation_stirs_only_the_class_that_fits_it() -> None:
    quarter = ring()
    stirred = {
        cls.name: [axis for axis, m in zip("xyz", of_mode(np.ones(3), np.eye(3), cls), strict=True) if m]
        for cls in classes(quarter.domain)
    }
    assert stirred == {
        "even in x, even in z": ["y"],
        "even in x, odd in z": ["z"],
        "odd in x, even in z": ["x"],
        "odd in x, odd in z": [],
    }

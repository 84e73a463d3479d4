"""Von Mises stress of known tensors and fields; peaks that are there and peaks that are not."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from flexdesign.core.model import Member
from flexdesign.fem.post_processing import stress
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.solver import factorize, times
from studies.verification.solids import CORK, METAL, Array, beam, lattice, tag_facets
from tests.fem.solids import solve

ROUNDING = 1e-12


@pytest.mark.parametrize(
    ("tensor", "expected"),
    [
        (np.diag([7.0, 0.0, 0.0]), 7.0),  # tension
        (np.diag([-7.0, 0.0, 0.0]), 7.0),  # compression
        (np.array([[0.0, 2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), 2.0 * np.sqrt(3)),  # shear
        (5.0 * np.eye(3), 0.0),  # pressure
        (np.diag([4.0, 4.0, 0.0]), 4.0),  # equal biaxial tension
        (np.diag([3.0, 2.0, -1.0]), np.sqrt(((3 - 2) ** 2 + (2 + 1) ** 2 + (3 + 1) ** 2) / 2)),  # principal stresses
    ],
)
def test_von_mises_of_known_states(tensor: Array, expected: float) -> None:
    assert stress.von_mises(tensor) == pytest.approx(expected, rel=ROUNDING, abs=1e-12)


def test_von_mises_does_not_depend_on_axes_or_pressure() -> None:
    rng = np.random.default_rng(2)
    tensors = rng.standard_normal((20, 3, 3))
    tensors += tensors.transpose(0, 2, 1)
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    expected = stress.von_mises(tensors)
    np.testing.assert_allclose(stress.von_mises(turn @ tensors @ turn.T), expected, rtol=ROUNDING)
    np.testing.assert_allclose(stress.von_mises(tensors + 3.0 * np.eye(3)), expected, rtol=1e-11)


def test_the_largest_principal_stress_is_a_tension() -> None:
    turn, _ = np.linalg.qr(np.random.default_rng(6).standard_normal((3, 3)))
    tensors = np.stack([turn @ np.diag(values) @ turn.T for values in ([3.0, -9.0, 1.0], [-4.0, -2.0, -7.0])])
    assert stress.largest_principal(tensors) == pytest.approx([3.0, -2.0], rel=1e-12)


def test_bar_in_tension_has_the_same_stress_everywhere() -> None:
    """F/A at every vertex; the solver's residual is what deviates."""
    height, width = 2e-3, 3e-3
    solved = solve(beam(10e-3, height, width, (5, 2, 2), CORK, wobble=1e-4))
    field = solved.displacements[0][:, 0].reshape(-1, 3)
    found = stress.nodal_von_mises(solved.body, field)
    np.testing.assert_allclose(found, 1 / (height * width), rtol=1e-9)


def test_peak_of_pure_bending_lies_on_the_outermost_fibre() -> None:
    """M h / 2I, linear over the height, in the element's space (no lateral contraction)."""
    height, width = 2e-3, 3e-3
    solved = solve(beam(10e-3, height, width, (5, 2, 2), CORK))
    field = solved.displacements[0][:, 5].reshape(-1, 3)
    found = stress.nodal_von_mises(solved.body, field)
    assert found.max() == pytest.approx(6 / (width * height**2), rel=1e-9)
    assert abs(solved.body.positions[found.argmax(), 1]) == pytest.approx(height / 2, rel=1e-12)


# --- peaks --------------------------------------------------------------------------------------------------------


def stretched(body: Elasticity, held: Array, values: Array) -> Array:
    """Return the nodal displacements (n, 3) with given values at the held dofs and no forces elsewhere."""
    stiffness = body.stiffness()
    found = np.zeros(body.n_dofs)
    found[held] = values
    free = np.setdiff1d(np.arange(body.n_dofs), held)
    factor = factorize(stiffness[free][:, free].tocsr())
    found[free] = factor.solve(-times(stiffness, found)[free])
    factor.free()
    return found.reshape(-1, 3)


def peak_at_a_corner(cells: int) -> float:
    """Return the peak in an L in plane strain, 270 degrees of solid about the origin, whose ends are bent apart."""
    axis = np.linspace(-1.0, 1.0, 2 * cells + 1)
    mesh, _ = tag_facets(*lattice(axis, axis, np.array([0.0, 1 / cells]), lambda c: (c[:, 0] < 0) | (c[:, 1] > 0)), {})
    body = Elasticity(mesh, METAL)
    places, motion = body.positions, np.zeros_like(body.positions)
    foot, end = np.flatnonzero(places[:, 1] < -1 + 1e-9), np.flatnonzero(places[:, 0] > 1 - 1e-9)
    motion[foot], motion[end] = (-1e-3, 0.0, 0.0), (0.0, 1e-3, 0.0)
    ends = (3 * np.concatenate([foot, end])[:, None] + np.arange(3)).ravel()
    held = np.unique(np.concatenate([ends, 3 * np.arange(len(places)) + 2]))
    found = stress.nodal_von_mises(body, stretched(body, held, motion.ravel()[held]))
    near = np.linalg.norm(places[:, :2], axis=1) < 0.5  # the ends of the held faces are singular too
    assert np.linalg.norm(places[near][found[near].argmax(), :2]) < 1 / cells
    return float(found[near].max())


def test_the_peak_at_a_sharp_corner_grows_with_williams_s_exponent() -> None:
    """h^(s - 1), s the root of sin(3 pi s / 2) = s.

    The ends move as mirror images, so that the next term of the stress is r^0.63: against the first it falls as h^1.09,
    to 0.07 at 12 cells, of which a part is left in the exponent, and less as the mesh is refined.
    """
    s = brentq(lambda s: math.sin(1.5 * math.pi * s) + s * math.sin(1.5 * math.pi), 0.4, 0.7, xtol=1e-14)
    assert pytest.approx(1 - s, rel=1e-6) == stress.SINGULAR
    cells = [8, 12, 18]
    peaks = [peak_at_a_corner(n) for n in cells]
    found = stress.peak(peaks, [1 / n for n in cells], sharp=True)
    assert found.exponent == pytest.approx(stress.SINGULAR, rel=0.02)
    coarse, fine = (stress.growth(peaks[k : k + 2], [1 / n for n in cells[k : k + 2]]) for k in (0, 1))
    assert abs(fine - stress.SINGULAR) < 0.8 * abs(coarse - stress.SINGULAR)
    assert found.error is None and found.value == peaks[-1]


def kirsch(x: Array, y: Array, radius: float) -> Array:
    """Return the displacement (n, 2) of an infinite body with a hole in plane strain, per stress along x (Kirsch)."""
    r, angle = np.hypot(x, y) / radius, np.arctan2(y, x)
    kappa = 3 - 4 * METAL.poissons_ratio
    c1, s1, c3, s3 = np.cos(angle), np.sin(angle), np.cos(3 * angle), np.sin(3 * angle)
    u = r * (kappa + 1) * c1 + 2 / r * ((1 + kappa) * c1 + c3) - 2 / r**3 * c3
    v = r * (kappa - 3) * s1 + 2 / r * ((1 - kappa) * s1 + s3) - 2 / r**3 * s3
    return radius / (8 * METAL.shear_modulus) * np.column_stack([u, v])


def peak_at_a_hole(cells: int) -> float:
    """Return the peak in a quarter of a ring about the hole, held in Kirsch's displacement where it is cut."""
    turns, radii = np.linspace(0.0, math.pi / 2, cells + 1), np.geomspace(1.0, 4.0, cells + 1)
    points, tets = lattice(np.arange(cells + 1.0), np.arange(cells + 1.0), np.array([0.0, 1 / cells]))
    r, angle = radii[points[:, 0].astype(int)], turns[points[:, 1].astype(int)]
    bent = np.column_stack([r * np.cos(angle), r * np.sin(angle), points[:, 2]])
    body = Elasticity(tag_facets(bent, tets, {})[0], METAL)
    places = body.positions
    outer = np.flatnonzero(np.hypot(places[:, 0], places[:, 1]) > 4.0 * math.cos(math.pi / 4 / cells) - 1e-9)
    exact = np.column_stack([kirsch(places[:, 0], places[:, 1], 1.0), np.zeros(len(places))])
    cuts = [3 * np.flatnonzero(np.abs(places[:, axis]) < 1e-9) + axis for axis in (0, 1)]
    held = np.unique(
        np.concatenate([(3 * outer[:, None] + np.arange(2)).ravel(), *cuts, 3 * np.arange(len(places)) + 2])
    )
    return float(stress.nodal_von_mises(body, stretched(body, held, exact.ravel()[held])).max())


def test_the_peak_at_a_hole_converges_and_its_error_holds_the_truth() -> None:
    """Three times the stress along the hole's edge, nu times that through the body: von Mises of (3, 3 nu, 0)."""
    nu, cells = METAL.poissons_ratio, (4, 6, 8, 12, 18)
    truth = 3 * math.sqrt(1 - nu + nu**2)
    peaks = [peak_at_a_hole(n) for n in cells]
    for first, last in ((0, 2), (1, 3), (2, 4), (0, 3), (1, 4), (2, 5)):
        found = stress.peak(peaks[first:last], [1 / n for n in cells[first:last]], sharp=False)
        assert found.error is not None
        assert abs(found.value - truth) <= found.error < 0.06 * truth
        assert abs(found.exponent) < 0.1


def test_round_notches_and_fillets_are_not_sharp() -> None:
    leaf = Member("leaf", "hinge", ("a", "b"), (0.0, 0.0, 0.0), (1e-3, 0.0, 0.0), 1e-4, 1e-3)
    assert stress.is_sharp(leaf)
    assert not stress.is_sharp(dataclasses.replace(leaf, root_radius=1e-5))
    assert not stress.is_sharp(dataclasses.replace(leaf, curvature_radius=1e-3))

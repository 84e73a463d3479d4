"""Elements against scikit-fem's own forms, exact fields, and a manufactured solution."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve
from skfem import Basis, ElementTetP2, ElementVector, Functional, LinearForm
from skfem.helpers import ddot, dot, sym_grad
from skfem.models.elasticity import linear_elasticity

from flexdesign.fem.meshing.mesh import TaggedMesh
from flexdesign.fem.solving.elasticity import Elasticity, stress_points
from flexdesign.fem.solving.solver import SuperLU, factorize, times
from studies.verification.solids import METAL, Array, lattice, tag_facets
from tests.fem.solids import full

BOX = np.array([4e-3, 3e-3, 2e-3])
# Sums of thousands of terms in double precision: rounding, no approximation.
ROUNDING = 1e-12


@pytest.fixture(scope="module")
def irregular() -> Elasticity:
    """A box from one corner at the origin, all inner vertices displaced."""
    axes = [np.linspace(0, size, n) for size, n in zip(BOX, (5, 5, 4), strict=True)]
    mesh, _ = tag_facets(*lattice(*axes, wobble=1.5e-4), {})
    return Elasticity(mesh, METAL)


def rigid_motions(positions: Array) -> Array:
    """Return the six rigid motions as columns over the dofs."""
    columns = [np.broadcast_to(unit, positions.shape).ravel() for unit in np.eye(3)]
    columns += [np.cross(unit, positions).ravel() for unit in np.eye(3)]
    return np.stack(columns, axis=1)


def test_stiffness_is_that_of_scikit_fem(irregular: Elasticity) -> None:
    basis = Basis(irregular.basis.mesh, ElementVector(ElementTetP2()), intorder=4)
    expected = linear_elasticity(*METAL.lame).assemble(basis)
    found = full(irregular.stiffness())
    assert abs(found - expected).max() <= ROUNDING * abs(expected).max()


def test_mass_is_that_of_scikit_fem(irregular: Elasticity) -> None:
    from skfem import BilinearForm

    basis = Basis(irregular.basis.mesh, ElementVector(ElementTetP2()), intorder=4)
    expected = BilinearForm(lambda u, v, _: METAL.density * dot(u, v)).assemble(basis)
    assert abs(full(irregular.mass()) - expected).max() <= ROUNDING * abs(expected).max()


def test_only_the_upper_triangle_is_stored(irregular: Elasticity) -> None:
    for matrix in (irregular.stiffness(), irregular.mass()):
        assert sp.tril(matrix, k=-1).nnz == 0


def test_rigid_motions_store_no_energy(irregular: Elasticity) -> None:
    stiffness = irregular.stiffness()
    motions = rigid_motions(irregular.positions)
    forces = times(stiffness, motions)
    assert np.abs(forces).max() <= ROUNDING * abs(stiffness).max() * np.abs(motions).max()


def test_there_is_no_other_mechanism() -> None:
    axis = np.linspace(0, 1e-3, 2)
    body = Elasticity(tag_facets(*lattice(axis, axis, axis), {})[0], METAL)
    eigenvalues = np.linalg.eigvalsh(full(body.stiffness()).toarray())
    assert np.all(np.abs(eigenvalues[:6]) < ROUNDING * eigenvalues[-1])
    assert eigenvalues[6] > 1e-3 * eigenvalues[-1]


def test_rigid_motions_have_the_inertia_of_a_box(irregular: Elasticity) -> None:
    """Mass m, first moments m c, and second moments of a box with a corner at the origin, m (b^2 + c^2) / 3."""
    motions = rigid_motions(irregular.positions)
    found = motions.T @ times(irregular.mass(), motions)
    m, (a, b, c) = METAL.density * BOX.prod(), BOX
    np.testing.assert_allclose(np.diag(found)[:3], m, rtol=ROUNDING)
    np.testing.assert_allclose(
        np.diag(found)[3:], m / 3 * np.array([b**2 + c**2, c**2 + a**2, a**2 + b**2]), rtol=ROUNDING
    )
    np.testing.assert_allclose(found[3, 4], -m * a * b / 4, rtol=ROUNDING)
    np.testing.assert_allclose(found[0, 4], m * c / 2, rtol=ROUNDING)
    assert found[0, 3] == pytest.approx(0.0, abs=ROUNDING * m * a)


def test_nodes_lie_on_corners_and_edge_middles(irregular: Elasticity) -> None:
    for dof in range(3):  # scikit-fem's own idea of where its dofs are
        np.testing.assert_allclose(irregular.basis.doflocs.T[dof::3], irregular.positions, atol=1e-15)
    facets = irregular.mesh.facets
    nodes = irregular.surface_nodes(facets)
    a, b, c = (irregular.mesh.points[facets[:, i]] for i in range(3))
    expected = np.stack([a, b, c, (a + b) / 2, (b + c) / 2, (a + c) / 2], axis=1)
    np.testing.assert_allclose(irregular.positions[nodes], expected, atol=1e-15)


class TestPatch:
    """A field of constant strain is in the element's space: every element must hold it, whatever its shape."""

    slope = np.array([[1e-3, 2e-3, -5e-4], [-4e-4, -7e-4, 3e-4], [9e-4, 6e-4, 1.5e-3]])

    def field(self, body: Elasticity) -> Array:
        return body.positions @ self.slope.T

    def stress(self) -> Array:
        """Hooke's law by the compliance form, solved backwards: E eps = (1 + nu) sigma - nu tr(sigma) 1."""
        strain = (self.slope + self.slope.T) / 2
        young, nu = METAL.youngs_modulus, METAL.poissons_ratio
        trace = young * np.trace(strain) / (1 - 2 * nu)
        return (young * strain + nu * trace * np.eye(3)) / (1 + nu)

    def test_strain_and_stress_are_constant(self, irregular: Elasticity) -> None:
        points, _ = stress_points()
        strain = irregular.strain(self.field(irregular), points)
        stress = irregular.stress(self.field(irregular), points)
        np.testing.assert_allclose(strain, np.broadcast_to((self.slope + self.slope.T) / 2, strain.shape), atol=1e-14)
        np.testing.assert_allclose(stress, np.broadcast_to(self.stress(), stress.shape), rtol=1e-10)

    def test_inner_nodes_feel_no_force(self, irregular: Elasticity) -> None:
        force = times(irregular.stiffness(), self.field(irregular).ravel()).reshape(-1, 3)
        outer = np.unique(irregular.surface_nodes(irregular.mesh.facets))
        inner = np.setdiff1d(np.arange(len(force)), outer)
        assert len(inner) > 100
        assert np.abs(force[inner]).max() <= ROUNDING * np.abs(force[outer]).max()

    def test_boundary_displacements_give_the_field_inside(self, irregular: Elasticity) -> None:
        exact = self.field(irregular).ravel()
        nodes = np.unique(irregular.surface_nodes(irregular.mesh.facets))
        held = (3 * nodes[:, None] + np.arange(3)).ravel()
        free = np.setdiff1d(np.arange(irregular.n_dofs), held)
        stiffness = full(irregular.stiffness())
        found = spsolve(stiffness[free][:, free].tocsc(), -stiffness[free][:, held] @ exact[held])
        np.testing.assert_allclose(found, exact[free], atol=1e-11 * np.abs(exact).max())

    def test_energy_is_that_of_the_uniform_stress(self, irregular: Elasticity) -> None:
        expected = 0.5 * np.sum(self.stress() * (self.slope + self.slope.T) / 2) * BOX.prod()
        assert irregular.strain_energy(self.field(irregular)) == pytest.approx(expected, rel=ROUNDING)


def test_strain_energy_is_half_u_k_u(irregular: Elasticity) -> None:
    field = np.random.default_rng(3).standard_normal((irregular.n_dofs // 3, 3))
    expected = field.ravel() @ times(irregular.stiffness(), field.ravel()) / 2
    assert irregular.strain_energy(field) == pytest.approx(expected, rel=ROUNDING)


def test_both_solvers_solve(irregular: Elasticity) -> None:
    """K + M is positive definite; the residual of a direct solution is rounding times the condition number (1e3)."""
    scale = abs(irregular.stiffness()).max() / abs(irregular.mass()).max()
    upper = (irregular.stiffness() + scale * irregular.mass()).tocsr()
    right = np.random.default_rng(5).standard_normal((irregular.n_dofs, 3))
    for factor in (factorize(upper), SuperLU(upper)):
        solution = factor.solve(right)
        np.testing.assert_allclose(full(upper) @ solution, right, atol=1e-10)
        np.testing.assert_allclose(
            factor.solve(right[:, 1]), solution[:, 1], rtol=1e-9, atol=1e-12 * np.abs(solution).max()
        )
        factor.free()


def plane_wave(cells: int) -> tuple[float, float]:
    """Return displacement and strain-energy error for u = a sin(k . x), whose body force is known in closed form."""
    wave, amplitude = np.array([2.1, 1.4, -1.7]), np.array([0.6, -0.5, 1.0])
    lam, mu = METAL.lame
    force = (lam + mu) * (amplitude @ wave) * wave + mu * (wave @ wave) * amplitude

    def phase(x: Array) -> Array:
        return np.einsum("i,i...->...", wave, x)

    axis = np.linspace(0, 1, cells + 1)
    body = Elasticity(TaggedMesh(*lattice(axis, axis, axis), np.empty((0, 3), int), np.empty(0, int)), METAL)
    basis = Basis(body.basis.mesh, ElementVector(ElementTetP2()), intorder=5)
    load = LinearForm(lambda v, w: np.sin(phase(w.x)) * np.einsum("i,i...->...", force, v)).assemble(basis)
    exact = np.sin(body.positions @ wave)[:, None] * amplitude
    outer = np.any((body.positions < 1e-9) | (body.positions > 1 - 1e-9), axis=1)
    held = np.flatnonzero(np.repeat(outer, 3))
    free = np.setdiff1d(np.arange(body.n_dofs), held)
    stiffness = body.stiffness()
    found = exact.ravel().copy()
    found[free] = 0.0
    upper = stiffness[free][:, free].tocsr()
    factor = factorize(upper)
    found[free] = factor.solve(load[free] - times(stiffness, found)[free])
    factor.free()

    def distance(w: dict[str, Array]) -> Array:
        return ((w["u"] - np.sin(phase(w.x)) * amplitude[:, None, None]) ** 2).sum(axis=0)

    def energy(w: dict[str, Array]) -> Array:
        slope = np.einsum("i,j->ij", amplitude, wave)
        strain = sym_grad(w["u"]) - ((slope + slope.T) / 2)[:, :, None, None] * np.cos(phase(w.x))
        trace = np.einsum("ii...->...", strain)
        return lam * trace**2 + 2 * mu * ddot(strain, strain)

    errors = [Functional(form).assemble(basis, u=basis.interpolate(found)) for form in (distance, energy)]
    return float(np.sqrt(errors[0])), float(np.sqrt(errors[1]))


def test_errors_fall_at_the_orders_of_quadratic_elements() -> None:
    """Third order in displacement, second in energy norm (Brenner and Scott, 2008, sec. 5.4).

    From 6 to 10 cells a side the waves are resolved well enough for the observed order to be within a tenth of that.
    """
    errors = np.array([plane_wave(cells) for cells in (6, 10)])
    orders = np.log(errors[0] / errors[1]) / np.log(10 / 6)
    assert orders == pytest.approx([3.0, 2.0], abs=0.1)

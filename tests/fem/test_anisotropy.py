"""Crystals: elements against scikit-fem's general form, exact fields, and the published moduli of silicon."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from skfem import Basis, BilinearForm, ElementTetP2, ElementVector
from skfem.helpers import sym_grad

from flexdesign.design import materials
from flexdesign.design.materials import Crystal, Material
from flexdesign.fem import analysis
from flexdesign.fem.meshing import domain
from flexdesign.fem.meshing.mesh import mirror_mesh
from flexdesign.fem.solving.elasticity import Elasticity, stress_points
from flexdesign.fem.solving.solver import times
from studies.verification.solids import METAL, Array, Solid, lattice, tag_facets, weld_points
from tests.fem.solids import RING_PATCHES, RING_PLANES, RING_PORTS, Bracket, full, relative, ring, solve

LENGTH, SIDE = 4e-3, 1e-3
# Sums of thousands of terms in double precision.
ROUNDING = 1e-12
#: Neither the crystal nor the part has a mirror plane in common.
ASKEW = {"x": [1, 2, 3], "z": [3, 0, -1], "turn": "20 deg"}


def silicon(orientation: object) -> Material:
    return materials.find({"like": "Si", "orientation": orientation}, Path("design.toml"))


def bar(material: Material) -> Elasticity:
    axes = [np.linspace(0, LENGTH, 6), np.linspace(0, SIDE, 4), np.linspace(0, SIDE, 4)]
    return Elasticity(tag_facets(*lattice(*axes, wobble=5e-5), {})[0], material)


def solved(body: Elasticity, held: Array, values: Array) -> Array:
    """Return the displacements with given values at the held dofs and no forces elsewhere."""
    stiffness = full(body.stiffness())
    found = np.zeros(body.n_dofs)
    found[held] = values
    free = np.setdiff1d(np.arange(body.n_dofs), held)
    found[free] = spsolve(stiffness[free][:, free].tocsc(), -stiffness[free][:, held] @ values)
    return found


@pytest.mark.parametrize("orientation", ["<100>", "<110>", ASKEW], ids=["100", "110", "askew"])
def test_stiffness_is_that_of_scikit_fem(orientation: object) -> None:
    body = bar(silicon(orientation))
    tensor = body.material.tensor

    @BilinearForm
    def form(u: Array, v: Array, _: object) -> Array:
        return np.einsum("ijkl,kl...,ij...->...", tensor, sym_grad(u), sym_grad(v))

    expected = form.assemble(Basis(body.basis.mesh, ElementVector(ElementTetP2()), intorder=4))
    assert abs(full(body.stiffness()) - expected).max() <= ROUNDING * abs(expected).max()


def test_an_isotropic_crystal_is_the_isotropic_body() -> None:
    lam, mu = METAL.lame
    crystal = dataclasses.replace(METAL, crystal=Crystal(lam + 2 * mu, lam, mu, ((1, 1, 0), (-1, 1, 0), (0, 0, 1))))
    found, expected = bar(crystal).stiffness(), bar(METAL).stiffness()
    assert abs(found - expected).max() <= ROUNDING * abs(expected).max()


@pytest.mark.parametrize(
    ("orientation", "young", "across", "through"),
    [("<100>", 130.0, 0.28, 0.28), ("<110>", 169.0, 0.064, 0.36)],
)
def test_a_silicon_bar_in_tension(orientation: str, young: float, across: float, through: float) -> None:
    """E = F L / (A dL) and the contractions along y and z of a bar free to contract, three planes held against shifts.

    Published: Hopcroft, Nix and Kenny (2010), to the digits printed there. The field is linear, hence exact.
    """
    body = bar(silicon(orientation))
    places, stretch = body.positions, 1e-4 * LENGTH
    planes = [3 * np.flatnonzero(places[:, axis] < 1e-9) + axis for axis in range(3)]
    pulled = 3 * np.flatnonzero(places[:, 0] > LENGTH - 1e-9)
    held = np.concatenate([*planes, pulled])
    values = np.concatenate([np.zeros(len(held) - len(pulled)), np.full(len(pulled), stretch)])
    found = solved(body, held, values)
    force = times(body.stiffness(), found)[pulled].sum()
    assert force * LENGTH / (SIDE**2 * stretch) / 1e9 == pytest.approx(young, abs=0.5)
    motion = found.reshape(-1, 3)
    for axis, ratio, rounded in ((1, across, 0.002), (2, through, 0.005)):
        side = places[:, axis] > SIDE - 1e-9
        contraction = -motion[side, axis].mean() / SIDE / (stretch / LENGTH)
        assert contraction == pytest.approx(ratio, abs=rounded if axis == 2 or across < 0.1 else 0.005)


@pytest.fixture(scope="module")
def body() -> Elasticity:
    return bar(silicon(ASKEW))


class TestPatch:
    """A field of constant strain is in the element's space, whatever the crystal's axes."""

    slope = np.array([[1e-3, 2e-3, -5e-4], [-4e-4, -7e-4, 3e-4], [9e-4, 6e-4, 1.5e-3]])

    def stress(self, crystal: Crystal) -> Array:
        """Hooke's law in the crystal's own axes: c11, c12 on the diagonal, 2 c44 off it; turned there and back."""
        a = crystal.cosines
        strain = a.T @ ((self.slope + self.slope.T) / 2) @ a
        normal = (crystal.c11 - crystal.c12) * np.diag(strain) + crystal.c12 * np.trace(strain)
        shear = 2 * crystal.c44 * (strain - np.diag(np.diag(strain)))
        return np.asarray(a @ (np.diag(normal) + shear) @ a.T)

    def test_stress_is_constant(self, body: Elasticity) -> None:
        assert body.material.crystal is not None
        found = body.stress(body.positions @ self.slope.T, stress_points()[0])
        expected = self.stress(body.material.crystal)
        np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), atol=1e-9 * np.abs(expected).max())

    def test_boundary_displacements_give_the_field_inside(self, body: Elasticity) -> None:
        exact = (body.positions @ self.slope.T).ravel()
        nodes = np.unique(body.surface_nodes(body.mesh.facets))
        held = (3 * nodes[:, None] + np.arange(3)).ravel()
        np.testing.assert_allclose(solved(body, held, exact[held]), exact, atol=1e-11 * np.abs(exact).max())

    def test_energy_is_that_of_the_uniform_stress(self, body: Elasticity) -> None:
        assert body.material.crystal is not None
        expected = 0.5 * np.sum(self.stress(body.material.crystal) * self.slope) * LENGTH * SIDE**2
        assert body.strain_energy(body.positions @ self.slope.T) == pytest.approx(expected, rel=ROUNDING)
        field = (body.positions @ self.slope.T).ravel()
        assert field @ times(body.stiffness(), field) / 2 == pytest.approx(expected, rel=ROUNDING)


def test_a_part_turned_with_its_crystal_is_the_same_part() -> None:
    """Objectivity: points and axes turned together turn every 3 by 3 block of the stiffness."""
    before = bar(silicon(ASKEW))
    crystal = before.material.crystal
    assert crystal is not None
    turn, _ = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    axes = turn @ crystal.cosines  # the crystal's directions along the turned part's x, y, z of space
    turned = dataclasses.replace(before.material, crystal=dataclasses.replace(crystal, axes=tuple(map(tuple, axes))))
    mesh = dataclasses.replace(before.mesh, points=before.mesh.points @ turn.T)
    after = Elasticity(mesh, turned)
    field = np.random.default_rng(5).standard_normal((before.n_dofs // 3, 3))
    forces = times(before.stiffness(), field.ravel()).reshape(-1, 3)
    found = times(after.stiffness(), (field @ turn.T).ravel()).reshape(-1, 3)
    np.testing.assert_allclose(found, forces @ turn.T, atol=ROUNDING * np.abs(forces).max())


def test_a_crystal_that_breaks_the_part_s_symmetry_is_not_solved_on_a_piece_of_it() -> None:
    solid = ring(silicon(ASKEW))
    with pytest.raises(ValueError, match="mesh the whole part"):
        analysis.solve(Bracket(), solid.material, solid.domain, solid.mesh)


#: About the wafer's normal a part may lie at any angle; then the plane of the wafer alone is left.
TURNED = {"x": [1, 0, 0], "z": [0, 0, 1], "turn": "20 deg"}


def test_a_domain_is_cut_by_the_planes_that_part_and_crystal_share() -> None:
    for orientation, planes, inputs in (
        ("<110>", "xz", {"input_right"}),
        (TURNED, "z", {"input_left", "input_right"}),
        (ASKEW, "", {"input_left", "input_right"}),
    ):
        body = domain.of_part(Bracket(), material=silicon(orientation), chord=1e-5)
        assert "".join(plane.axis for plane in body.planes) == planes
        assert body.ports.keys() == inputs | {"output", "ground"}
        assert body.copies * body.volume == pytest.approx(domain.of_part(Bracket(), chord=1e-5).volume * 4, rel=1e-9)
    assert len(domain.of_part(Bracket(), material=METAL, chord=1e-5).planes) == 2
    assert not domain.of_part(Bracket(), material=METAL, symmetric=False, chord=1e-5).planes


def test_half_a_ring_of_turned_silicon_is_the_whole_ring() -> None:
    """Two classes on the half z > 0 against the whole, on meshes that are mirror images: to rounding.

    That the crystal breaks the symmetry in x shows: an actuator on the axis moves the output sideways.
    """
    turned = silicon(TURNED)
    quarter = ring(turned)
    points, tets, _ = mirror_mesh(quarter.mesh.points, quarter.mesh.tets, RING_PLANES[:1], {})
    half = Solid.of(weld_points(points, tets), RING_PATCHES, RING_PORTS, RING_PLANES[1:], turned)
    solved, whole = solve(half), solve(half.whole(RING_PATCHES))
    assert relative(solved.matrix, whole.matrix) < 1e-8
    motion = solved.matrix @ solved.space.extension
    sideways, along = motion[solved.space.rows("output")][:2]
    assert 1e-3 < abs(sideways / along) < 1.0
    straight = solve(ring(silicon("<100>")))
    assert (straight.matrix @ straight.space.extension)[straight.space.rows("output")][0] == 0

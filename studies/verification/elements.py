"""What must hold on any mesh: exact fields, no energy in rigid motions, orders of convergence, reciprocity, scaling."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from skfem import Basis, ElementTetP2, ElementVector, Functional
from skfem.helpers import ddot, sym_grad

from flexdesign.design.part import Port
from flexdesign.fem.solving import port_compliance, statics
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.solver import factorize, times
from studies.verification import loads
from studies.verification.finding import Finding
from studies.verification.solids import METAL, Array, Bent, Solid, at, lattice, tag_facets

#: Sums of thousands of terms, and solutions of systems with a condition number of some thousands.
ROUNDING, SOLVED = 1e-12, 1e-10


def irregular() -> Elasticity:
    """Return a box of elements of which no two are alike."""
    x, y, z = (np.linspace(0, size, n) for size, n in ((4e-3, 5), (3e-3, 5), (2e-3, 4)))
    return Elasticity(tag_facets(*lattice(x, y, z, wobble=1.5e-4), {})[0], METAL)


def patch_test() -> list[Finding]:
    """Hold the surface of an irregular mesh as a linear field has it: the field must be found inside.

    Irons and Razzaque, Experience with the patch test for convergence of finite elements (1972).
    """
    body = irregular()
    slope = np.array([[1e-3, 2e-3, -5e-4], [-4e-4, -7e-4, 3e-4], [9e-4, 6e-4, 1.5e-3]])
    exact = (body.positions @ slope.T).ravel()
    outer = np.unique(body.surface_nodes(body.mesh.facets))
    free = np.setdiff1d(np.arange(body.n_dofs), (3 * outer[:, None] + np.arange(3)).ravel())
    found = _held(body, free, exact, np.zeros(body.n_dofs))
    error = float(np.abs(found - exact).max() / np.abs(exact).max())
    return [
        Finding(
            "patch test", "largest error of a linear field, over the field", "analytic",
            "Irons and Razzaque (1972)", 0.0, error, "1", 0.0, SOLVED, body.n_dofs, "rounding",
        )
    ]  # fmt: skip


def rigid_motions() -> list[Finding]:
    """Move and turn an irregular mesh: its energy must be zero, relative to that of an equal strain."""
    body = irregular()
    columns = [np.broadcast_to(unit, body.positions.shape) for unit in np.eye(3)]
    columns += [np.cross(unit, body.positions) for unit in np.eye(3)]
    scale = np.ptp(body.positions, axis=0).max()
    stretched = body.strain_energy(body.positions / scale)
    worst = max(abs(body.strain_energy(c / np.abs(c).max())) for c in columns) / stretched
    return [
        Finding(
            "rigid motions", "largest energy of six, over that of a stretch as large", "analytic",
            "no strain, no energy", 0.0, float(worst), "1", 0.0, ROUNDING, body.n_dofs, "rounding",
        )
    ]  # fmt: skip


def manufactured_solution(coarse: int = 6, fine: int = 10) -> list[Finding]:
    """Solve for a plane wave u = a sin(k . x) under the body force that belongs to it, on two meshes of a cube."""
    errors = np.array([_plane_wave(cells) for cells in (coarse, fine)])
    orders = np.log(errors[0, :2] / errors[1, :2]) / np.log(fine / coarse)
    source = "Brenner and Scott, The Mathematical Theory of Finite Element Methods (2008), section 5.4"
    return [
        Finding(
            "manufactured solution", f"order of convergence, {norm}", "analytic", source,
            right, float(found), "1", right - 0.1, right + 0.1, int(errors[1, 2]),
            f"{coarse} and {fine} cells a side; observed orders approach theirs as meshes get finer",
        )
        for norm, right, found in zip(("displacement (L2)", "strain energy (H1)"), (3.0, 2.0), orders, strict=True)
    ]  # fmt: skip


def _plane_wave(cells: int) -> tuple[float, float, int]:
    """Return displacement error, strain-energy error, both as norms, and the number of unknowns."""
    wave, amplitude = np.array([2.1, 1.4, -1.7]), np.array([0.6, -0.5, 1.0])
    lam, mu = METAL.lame
    force = (lam + mu) * (amplitude @ wave) * wave + mu * (wave @ wave) * amplitude
    axis = np.linspace(0, 1, cells + 1)
    bent = Bent.of(lattice(axis, axis, axis), lambda place: place, METAL)
    body = bent.body
    load = loads.body_force(body, lambda x: np.sin(x @ wave)[..., None] * force)
    exact = np.sin(body.positions @ wave)[:, None] * amplitude
    outer = np.unique(body.surface_nodes(body.mesh.facets))
    found = _held(body, bent.free((outer, "xyz")), exact.ravel(), load)

    def phase(x: Array) -> Array:
        return np.einsum("i,i...->...", wave, x)

    def distance(w: Any) -> Array:
        return ((w["u"] - np.sin(phase(w.x)) * amplitude[:, None, None]) ** 2).sum(axis=0)

    def energy(w: Any) -> Array:
        slope = np.outer(amplitude, wave)
        strain = sym_grad(w["u"]) - ((slope + slope.T) / 2)[:, :, None, None] * np.cos(phase(w.x))
        trace = np.einsum("ii...->...", strain)
        return lam * trace**2 + 2 * mu * ddot(strain, strain)

    basis = Basis(body.basis.mesh, ElementVector(ElementTetP2()), intorder=5)
    squares = [Functional(form).assemble(basis, u=basis.interpolate(found)) for form in (distance, energy)]
    return float(np.sqrt(squares[0])), float(np.sqrt(squares[1])), body.n_dofs


def _held(body: Elasticity, free: Array, field: Array, load: Array) -> Array:
    """Return the displacements (n_dofs,) under a load with all that is not free held where a field has it."""
    stiffness = body.stiffness()
    found = field.copy()
    found[free] = 0.0
    factor = factorize(stiffness[free][:, free].tocsr())
    found[free] = factor.solve(load[free] - times(stiffness, found)[free])
    factor.free()
    return found


def knee(scale: float = 1.0, stiffer: float = 1.0) -> tuple[Array, int]:
    """Return the compliance between both ends of an irregular knee and its number of unknowns.

    `scale` multiplies all lengths and `stiffer` Young's modulus.
    """
    x, y, z = (scale * np.linspace(0, size, n) for size, n in ((9e-3, 4), (6e-3, 3), (4e-3, 3)))
    inner = scale * 3e-3
    cells = lattice(x, y, z, lambda c: (c[:, 0] < inner) | (c[:, 1] < inner), wobble=scale * 4e-4)
    ends = (
        Port("input", "input", (scale * 9e-3, scale * 1.5e-3, scale * 2e-3), (1.0, 0.0, 0.0)),
        Port("output", "output", (scale * 1.5e-3, scale * 6e-3, scale * 2e-3), (0.0, 1.0, 0.0)),
    )
    patches = {
        "input": at("x", scale * 9e-3),
        "output": at("y", scale * 6e-3),
        "ground": at("x", 0.0, ("y", 0.0, inner)),
    }
    material = replace(METAL, youngs_modulus=stiffer * METAL.youngs_modulus)
    matrix, unknowns = compliance(Solid.of(cells, patches, ends, material=material))
    return matrix, unknowns


def compliance(solid: Solid) -> tuple[Array, int]:
    """Return the compliance between the ports of a solid without symmetry planes, and its number of unknowns."""
    body = solid.body
    stiffness = body.stiffness()
    space = port_compliance.port_space(body, solid.domain, solid.ports)
    whole = port_compliance.classes(solid.domain)[0]
    system = statics.class_system(body, solid.domain, whole, stiffness, [solid.domain.ports["ground"]])
    matrix, checks, _, _ = statics.class_compliance(body, system, stiffness, space)
    checks.require()
    system.factor.free()
    return matrix, body.n_dofs


def reciprocity_and_scaling() -> list[Finding]:
    """Compare compliances between two ports with their transposes, and those of larger and stiffer bodies.

    Forces and displacements, forces and turns, moments and turns scale with 1/L, 1/L^2, 1/L^3.
    """
    matrix, unknowns = knee()
    scale = np.sqrt(np.outer(np.diag(matrix), np.diag(matrix)))
    powers = np.tile(np.repeat([0.5, 1.5], 3), 2)
    larger, stiffer = knee(scale=3.0)[0] * np.outer(3.0**powers, 3.0**powers), knee(stiffer=2.5)[0] * 2.5
    rows = (
        ("reciprocity", "asymmetry of the compliance between two ports", "Betti (1872)", matrix.T),
        ("length scaling", "difference of K / L and its kin in a body three times as large", "dimensions", larger),
        ("stiffness scaling", "difference of K / E where E is 2.5 times as large", "linearity", stiffer),
    )
    return [
        Finding(
            problem, quantity, "analytic", source, 0.0, float(np.abs((other - matrix) / scale).max()), "1",
            0.0, SOLVED, unknowns, "rounding",
        )
        for problem, quantity, source, other in rows
    ]  # fmt: skip

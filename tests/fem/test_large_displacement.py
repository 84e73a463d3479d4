"""Large displacements: the elastica and the leaf-spring parallelogram, and derivatives against differences."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

from flexdesign.fem.solving import port_compliance, statics
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.large_displacement import LargeDisplacement
from flexdesign.fem.solving.load_path import load_path, stroke_path
from studies.verification import large
from studies.verification.finding import failures
from studies.verification.published_guide import published_guide
from studies.verification.solids import CORK, METAL, beam, hold_ground
from tests.fem import solids

Array = np.ndarray[Any, Any]


@pytest.fixture(scope="module")
def block() -> tuple[Elasticity, LargeDisplacement]:
    solid = beam(10e-3, 2e-3, 1e-3, (4, 2, 2), METAL, wobble=1e-4)
    model = hold_ground(solid)
    return model.body, model


# --- the elements ---------------------------------------------------------------------------------------------------


def test_at_rest_the_tangent_is_the_linear_stiffness(block: tuple[Elasticity, LargeDisplacement]) -> None:
    body, model = block
    forces, tangent = model.forces_and_tangent(np.zeros(body.n_dofs))
    linear = body.stiffness()[model.free][:, model.free]
    assert not forces.any()
    assert abs(tangent - linear).max() < 1e-12 * abs(linear).max()


def test_forces_are_the_derivative_of_the_energy_and_the_tangent_theirs(
    block: tuple[Elasticity, LargeDisplacement],
) -> None:
    """Central differences at displacements of a tenth of an element."""
    body, model = block
    rng = np.random.default_rng(0)
    at, way = np.zeros(body.n_dofs), np.zeros(body.n_dofs)
    at[model.free], way[model.free] = rng.normal(0, 1e-4, len(model.free)), rng.standard_normal(len(model.free))
    forces, upper = model.forces_and_tangent(at)
    h = 1e-8
    rise = (model.energy(at + h * way) - model.energy(at - h * way)) / (2 * h)
    assert rise == pytest.approx(forces @ way, rel=1e-6)
    change = (model.forces(at + h * way) - model.forces(at - h * way))[model.free] / (2 * h)
    found = (upper + sp.triu(upper, 1).T) @ way[model.free]
    assert found == pytest.approx(change, abs=1e-6 * np.abs(change).max())


def test_a_rigid_rotation_costs_nothing(block: tuple[Elasticity, LargeDisplacement]) -> None:
    body, model = block
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    turned = (body.positions @ quarter.T - body.positions).ravel()
    stretched = (1e-3 * body.positions).ravel()
    assert model.energy(turned) < 1e-15 * model.energy(stretched)
    assert np.abs(model.forces(turned)).max() < 1e-9 * np.abs(model.forces(stretched)).max()


def test_uniform_stretch_follows_the_law_of_the_material(block: tuple[Elasticity, LargeDisplacement]) -> None:
    """Stretched by s along x alone, E = (s^2 - 1) / 2 and the energy density is (lam / 2 + mu) E^2."""
    body, model = block
    lam, mu = METAL.lame
    moved = np.zeros_like(body.positions)
    moved[:, 0] = 0.2 * body.positions[:, 0]
    right = (0.5 * lam + mu) * (0.5 * (1.2**2 - 1)) ** 2 * body.mesh.volume
    assert model.energy(moved.ravel()) == pytest.approx(right, rel=1e-12)


# --- structures -----------------------------------------------------------------------------------------------------


def test_the_elastica_by_elliptic_integrals_solves_its_equation() -> None:
    """theta'' = -alpha cos(theta) in the arc length, theta = 0 at the clamp and theta' = 0 at the tip."""
    s = np.linspace(0, 1, 200)
    for alpha in (0.5, 2.0):
        found = solve_bvp(
            lambda s, y, alpha=alpha: np.vstack([y[1], -alpha * np.cos(y[0])]),
            lambda a, b: np.array([a[0], b[1]]),
            s,
            np.vstack([s, 1 - s]),
            tol=1e-10,
            max_nodes=20000,
        )
        angle = found.sol(s)[0]
        along, across = np.trapezoid(np.cos(angle), s) - 1, np.trapezoid(np.sin(angle), s)
        assert large.elastica(alpha) == pytest.approx((along, across), abs=1e-5)  # of the trapezia


def test_a_cantilever_bends_like_the_elastica() -> None:
    """At the tip 0.16 and 0.49 of the length; a beam of 1:100 stretches and shears by some 1e-4 of it."""
    assert failures(large.bent_cantilever()) == []


def test_a_parallelogram_shortens_by_three_fifths_of_the_square() -> None:
    """u_x = -(3/5) u_y^2 / L (Jones 1988, Instruments and Experiences); of that the linear solution knows nothing."""
    assert failures(large.parasitic_motion()) == []


def test_a_published_guide_moves_by_a_third_of_its_length() -> None:
    """CalculiX, on elements as large."""
    assert failures(published_guide()) == []


def test_a_block_bears_no_more_than_its_material() -> None:
    """Pressed along x a bar without lateral contraction bears E A s (1 - s^2) / 2, 0.192 E A at most."""
    solid = beam(0.5e-3, 2e-3, 2e-3, (1, 2, 2), CORK)
    body = solid.body
    load = -port_compliance.port_space(body, solid.domain, solid.ports).loads["output"][:, [0]]
    strength = CORK.youngs_modulus * 4e-6
    (found,) = load_path(hold_ground(solid), load, [0.15 * strength])
    tip = found.displacement.reshape(-1, 3)[np.isclose(body.positions[:, 0], 0.5e-3), 0]
    stretch = brentq(lambda s: 0.5 * s * (1 - s**2) - 0.15, 0.6, 1.0)
    assert tip == pytest.approx((stretch - 1) * 0.5e-3, rel=1e-6)
    with pytest.raises(ArithmeticError, match=r"no equilibrium beyond .* times the load: it buckles there"):
        list(load_path(hold_ground(solid), load, [0.2 * strength]))


# --- parts ----------------------------------------------------------------------------------------------------------


class Ring:
    """The ring of the other tests as a part."""

    ports = staticmethod(lambda: solids.RING_PORTS)


def test_the_way_of_an_actuator_begins_with_the_linear_answers() -> None:
    solid = solids.ring()
    linear = solids.solve(solid)
    compliance = statics.PortCompliance(linear.matrix, linear.space.extension, linear.space.output)
    forces = 2e3 * np.arange(1, 4)
    path = stroke_path(Ring(), METAL, solid.domain, solid.mesh, forces)  # type: ignore[arg-type]
    assert path.force.tolist() == [0.0, *forces]
    assert path.input_stiffness[0] == pytest.approx(compliance.input_stiffness, rel=1e-6)
    assert path.amplification[0] == pytest.approx(compliance.amplification, rel=1e-6)
    assert path.output_stiffness[0] == pytest.approx(1 / compliance.c22, rel=1e-6)
    # Motions are the integrals of their tangents: Simpson's rule over two steps is good to fourth order.
    rates = 1 / path.input_stiffness
    assert path.extension[2] == pytest.approx(2e3 / 3 * (rates[0] + 4 * rates[1] + rates[2]), rel=1e-6)
    assert abs(path.extension[2] / 2 / path.extension[1] - 1) > 1e-5  # it is not linear


def test_the_way_may_begin_with_a_force_far_below_the_last() -> None:
    """A nanonewton moves this ring by some 1e-17 m: what is small beside the body's size keeps its digits."""
    solid = solids.ring()
    forces = [1e-9, 1e-6, 2e3]
    path = stroke_path(Ring(), METAL, solid.domain, solid.mesh, forces)  # type: ignore[arg-type]
    linear = path.force[1:3] / path.input_stiffness[0]
    assert path.extension[1:3] == pytest.approx(linear, rel=1e-9)
    direct = stroke_path(Ring(), METAL, solid.domain, solid.mesh, [2e3])  # type: ignore[arg-type]
    assert path.extension[-1] == pytest.approx(direct.extension[-1], rel=1e-9)

"""Bars and beams against closed forms, the algebra of port compliances against springs, and the self-checks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

from flexdesign.design.part import Port
from flexdesign.fem.solving import port_compliance, statics
from flexdesign.fem.solving.statics import Checks, PortCompliance
from studies.verification.solids import CORK, METAL, Solid, at, beam, lattice
from tests.fem.solids import RING_PATCHES, Solved, full, ring, solve

LENGTH, HEIGHT, WIDTH = 60e-3, 4e-3, 6e-3
AREA, INERTIA_Z, INERTIA_Y = HEIGHT * WIDTH, WIDTH * HEIGHT**3 / 12, HEIGHT * WIDTH**3 / 12
E, G = CORK.youngs_modulus, CORK.shear_modulus
#: The exact field lies in the space of quadratic elements: rounding and the solver's residual alone.
EXACT = 1e-9


@pytest.fixture(scope="module")
def cantilever() -> Solved:
    """A beam on irregular elements, clamped at x = 0, without lateral contraction."""
    return solve(beam(LENGTH, HEIGHT, WIDTH, (30, 3, 3), wobble=2e-4))


# --- beams --------------------------------------------------------------------------------------------------------


def test_bar_in_tension_is_exact(cantilever: Solved) -> None:
    """Without lateral contraction the clamp disturbs nothing: u = F x / EA."""
    assert cantilever.matrix[0, 0] == pytest.approx(LENGTH / (E * AREA), rel=EXACT)


def test_bending_by_a_moment_is_exact(cantilever: Solved) -> None:
    """The port's moment is the linear traction of pure bending: rotation L/EI and deflection L^2/2EI.

    About y a positive rotation lowers the tip, about z it raises it.
    """
    c = cantilever.matrix
    assert c[5, 5] == pytest.approx(LENGTH / (E * INERTIA_Z), rel=EXACT)
    assert c[1, 5] == pytest.approx(LENGTH**2 / (2 * E * INERTIA_Z), rel=EXACT)
    assert c[4, 4] == pytest.approx(LENGTH / (E * INERTIA_Y), rel=EXACT)
    assert c[2, 4] == pytest.approx(-(LENGTH**2) / (2 * E * INERTIA_Y), rel=EXACT)


@pytest.mark.parametrize(("row", "height", "inertia"), [(1, HEIGHT, INERTIA_Z), (2, WIDTH, INERTIA_Y)])
def test_tip_force_follows_timoshenko(cantilever: Solved, row: int, height: float, inertia: float) -> None:
    """L^3/3EI + L/(kappa G A), kappa = 5/6 at nu = 0 (Cowper, 1966).

    The clamp holds back the warping of shear, for as far as end effects reach: h/4.2, the decay length in a strip
    (Horgan, 1989). At most all shear deflection of that piece is lost. Elements add less than that.
    """
    bending, shear = LENGTH**3 / (3 * E * inertia), LENGTH / (5 / 6 * G * AREA)
    found = cantilever.matrix[row, row]
    assert bending + shear * (1 - height / 4.2 / LENGTH) < found < bending + shear


def test_a_square_bar_twists_as_saint_venant_says() -> None:
    """Two lengths, so that both ends drop out: 1/GJ per length, J = 0.1405770 h^4 (Timoshenko and Goodier, sec. 109).

    The only error is that of the warping in the section. Energies of quadratic elements converge at the fourth order,
    on meshes as coarse as these somewhat slower: at least eightfold from 3 to 6 cells, to below a thousandth.
    """
    h = 5e-3

    def error(cells: int) -> float:
        twist = [solve(beam(n * h, h, h, (2 * n, cells, cells), METAL)).matrix[3, 3] for n in (3, 5)]
        return 1 - (twist[1] - twist[0]) / (2 * h) * METAL.shear_modulus * 0.1405770 * h**4

    coarse, fine = error(3), error(6)
    assert 0 < fine < 1e-3  # displacements of elements are too small, never too large
    assert coarse > 8 * fine


def test_force_that_pulls_the_output_reacts_at_the_ground(cantilever: Solved) -> None:
    """Newton's third law in K u: what the ground exerts is minus the load, and its moment balances it."""
    body, u = cantilever.body, cantilever.displacements[0]
    forces = statics.times(cantilever.stiffness, u).reshape(-1, 3, 6)
    held = np.unique(body.surface_nodes(body.mesh.on_face(cantilever.solid.domain.ports["ground"])))
    reaction = forces[held]
    np.testing.assert_allclose(reaction.sum(axis=0)[:, :3], -np.eye(3), atol=EXACT)
    moment_z = body.positions[held, 0] @ reaction[:, 1] - body.positions[held, 1] @ reaction[:, 0]
    assert moment_z[1] == pytest.approx(-LENGTH, rel=EXACT)  # a tip force along y, clamped at x = 0
    assert moment_z[5] == pytest.approx(-1.0, rel=EXACT)


def test_betti_between_ports_of_an_irregular_body() -> None:
    """Work of one load on another's displacement, both ways, in a body without any symmetry."""
    x, y, z = np.linspace(0, 9e-3, 4), np.linspace(0, 6e-3, 3), np.linspace(0, 4e-3, 3)
    cells = lattice(x, y, z, lambda c: (c[:, 0] < 3e-3) | (c[:, 1] < 3e-3), wobble=4e-4)
    places = (
        Port("input", "input", (9e-3, 1.5e-3, 2e-3), (1.0, 0.0, 0.0)),
        Port("output", "output", (1.5e-3, 6e-3, 2e-3), (0.0, 1.0, 0.0)),
    )
    patches = {"input": at("x", 9e-3), "output": at("y", 6e-3), "ground": at("x", 0.0, ("y", 0.0, 3e-3))}
    found = solve(Solid.of(cells, patches, places)).matrix
    scale = np.sqrt(np.outer(np.diag(found), np.diag(found)))
    assert np.abs((found - found.T) / scale).max() < 1e-10
    assert np.abs((found / scale)[:6, 6:]).max() > 0.1  # the ports do feel each other


# --- port algebra -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def spring() -> PortCompliance:
    """Three ports joined by some elastic network: any positive definite matrix is one."""
    rng = np.random.default_rng(11)
    root = rng.standard_normal((18, 18))
    extension, output = np.zeros(18), np.zeros(18)
    extension[[0, 6]] = -1.0, 1.0
    output[13] = 1.0
    return PortCompliance((root @ root.T + np.eye(18)) * 1e-7, extension, output)


def network(
    c: PortCompliance, actuator: float, free_stroke: float = 0.0, output_force: float = 0.0
) -> tuple[float, float]:
    """Solve stiffness equations with the actuator as a spring element: (extension, output motion)."""
    stiffness = np.linalg.inv(c.matrix) + actuator * np.outer(c.extension, c.extension)
    load = actuator * free_stroke * c.extension + output_force * c.output
    q = np.linalg.solve(stiffness, load)
    return float(c.extension @ q), float(c.output @ q)


# The network's matrix has a condition number of 1e3, times 1e3 with the stiffest actuator.
NETWORK = 1e-9


def test_input_stiffness_and_amplification(spring: PortCompliance) -> None:
    q = spring.matrix @ (3.0 * spring.extension)  # 3 N from the actuator
    assert spring.input_stiffness == pytest.approx(3.0 / (q[6] - q[0]), rel=NETWORK)
    assert spring.amplification == pytest.approx(q[13] / (q[6] - q[0]), rel=NETWORK)


@pytest.mark.parametrize("actuator", [0.0, 1e4, 1e6, 1e8])
def test_output_stiffness_with_an_actuator(spring: PortCompliance, actuator: float) -> None:
    _, moved = network(spring, actuator, output_force=2.0)
    assert spring.output_stiffness(actuator) == pytest.approx(2.0 / moved, rel=NETWORK)


def test_output_stiffness_between_its_limits(spring: PortCompliance) -> None:
    """Input free: the plain compliance. Input held: a constraint, solved with a Lagrange multiplier."""
    assert spring.output_stiffness(0.0) == pytest.approx(1 / spring.matrix[13, 13], rel=NETWORK)
    stiffness = np.linalg.inv(spring.matrix)
    held = np.block([[stiffness * 1e-6, spring.extension[:, None]], [spring.extension[None], np.zeros((1, 1))]])
    moved = np.linalg.solve(held, np.append(spring.output, 0.0))[13] * 1e-6
    assert spring.output_stiffness(math.inf) == pytest.approx(1 / moved, rel=NETWORK)
    steps = [spring.output_stiffness(k) for k in (0.0, 1e3, 1e5, 1e7, 1e9, math.inf)]
    assert steps == sorted(steps) and steps[0] < steps[-1]
    assert spring.output_stiffness(1e-3) == pytest.approx(steps[0], rel=1e-6)
    assert spring.output_stiffness(1e15) == pytest.approx(steps[-1], rel=1e-6)


@pytest.mark.parametrize("actuator", [1e4, 1e6, 1e8])
def test_stroke_and_actuator_force(spring: PortCompliance, actuator: float) -> None:
    stroke = 40e-6
    extended, moved = network(spring, actuator, stroke)
    assert spring.stroke(stroke, actuator) == pytest.approx(moved, rel=NETWORK)
    force = actuator * (stroke - extended)  # the rest of the free stroke squeezes the actuator
    assert spring.actuator_force(stroke, actuator) == pytest.approx(force, rel=1e-6)


def test_a_rigid_actuator_gives_its_whole_stroke(spring: PortCompliance) -> None:
    assert spring.stroke(40e-6, math.inf) == pytest.approx(40e-6 * spring.amplification, rel=NETWORK)
    assert spring.actuator_force(40e-6, math.inf) == pytest.approx(40e-6 * spring.input_stiffness, rel=NETWORK)


@pytest.mark.parametrize("actuator", [1e5, 1e7])
def test_load_line_runs_from_stroke_to_blocked_force(spring: PortCompliance, actuator: float) -> None:
    """Against an output force -F the motion falls on a straight line, to nothing at the blocked force."""
    stroke = 40e-6
    free, blocked = spring.stroke(stroke, actuator), spring.blocked_force(stroke, actuator)
    for share in (0.0, 0.3, 1.0):
        _, moved = network(spring, actuator, stroke, -share * blocked)
        assert moved == pytest.approx((1 - share) * free, abs=NETWORK * abs(free))


def test_ring_with_an_actuator_meshed_in() -> None:
    """The port algebra against FEM proper: the actuator as a rank-one spring in the stiffness matrix of all dofs.

    K + k c c^T is solved by bordering with the spring's force; both ways solve to 1e-11.
    """
    found = solve(ring().whole(RING_PATCHES))
    c = PortCompliance(found.matrix, found.space.extension, found.space.output)
    free = found.systems[0].free
    loads = np.hstack([found.space.loads[name] for name in found.space.retained])[free]
    gap, pull = loads @ c.extension, loads @ c.output
    spring, scale = 5e7, 1e8
    stiffness = full(found.systems[0].stiffness) / scale
    system = sp.bmat([[stiffness, gap[:, None]], [gap[None], np.array([[-scale / spring]])]], format="csc")
    u = spsolve(system, np.append(pull, 0.0))[:-1] / scale
    assert c.output_stiffness(spring) == pytest.approx(1 / (pull @ u), rel=1e-9)


# --- checks -------------------------------------------------------------------------------------------------------


def test_the_residual_of_a_rigid_port_does_not_depend_on_the_size_of_the_body() -> None:
    """A norm that mixed moments and forces refused a part of some micrometres; the same part in millimetres passed."""
    found = []
    for scale in (1.0, 2.0**-14):  # exact in binary numbers
        solid = beam(scale * LENGTH, scale * HEIGHT, scale * WIDTH, (6, 1, 1))
        ports = tuple(replace(port, rigid=port.role == "output") for port in solid.ports)
        body, stiffness = solid.body, solid.body.stiffness()
        space = port_compliance.port_space(body, solid.domain, ports)
        (cls,) = port_compliance.classes(solid.domain)
        rigid = [port for port in ports if port.rigid]
        system = statics.class_system(body, solid.domain, cls, stiffness, [solid.domain.ports["ground"]], rigid=rigid)
        matrix, checks, _, _ = statics.class_compliance(body, system, stiffness, space)
        found.append((matrix[0, 0] * scale, checks))
        checks.require()
    (large, of_large), (small, of_small) = found
    assert small == pytest.approx(large, rel=1e-9)  # K grows with the length
    assert of_small.residual < 10 * of_large.residual  # both are rounding


def test_checks_are_small_where_all_is_well(cantilever: Solved) -> None:
    """Rounding times a condition number of 1e7 to 1e8 for the slender beam; the ring's is lower."""
    for solved, limit in ((cantilever, 1e-8), (solve(ring()), 1e-9)):
        for checks in solved.checks:
            assert max(vars(checks).values()) < limit


def checked(solved: Solved, stiffness: sp.csr_matrix) -> Checks:
    """Return the checks made with another stiffness matrix than was solved with."""
    return statics.class_compliance(solved.body, solved.systems[0], stiffness, solved.space)[1]


def test_checks_see_what_is_wrong(cantilever: Solved) -> None:
    """A stiffness 1 % off shows in residual and balance; another Poisson's ratio shows in the energy."""
    off = checked(cantilever, cantilever.stiffness * 1.01)
    assert off.residual == pytest.approx(0.01, rel=1e-3)
    assert off.balance == pytest.approx(0.01 / 1.01, rel=1e-3)  # in tension all reactions point one way
    softer = Solid(cantilever.solid.mesh, cantilever.solid.domain, cantilever.solid.ports, METAL).body
    _, checks, _, _ = statics.class_compliance(softer, cantilever.systems[0], cantilever.stiffness, cantilever.space)
    assert checks.energy > 0.01


def test_lost_reactions_show_in_the_balance(cantilever: Solved) -> None:
    """One held dof less in the stiffness: what it carries is missing in the sum of reactions."""
    lost = cantilever.stiffness.copy().tolil()
    body = cantilever.body
    held = np.unique(body.surface_nodes(body.mesh.on_face(cantilever.solid.domain.ports["ground"])))
    lost[3 * held[0]] = 0.0
    lost[:, 3 * held[0]] = 0.0
    assert checked(cantilever, lost.tocsr()).balance > 1e-4


def test_worst_of_two_checks_keeps_the_larger_and_never_hides_a_failed_one() -> None:
    a, b = Checks(1e-9, 2e-9, 3e-9, 4e-9), Checks(4e-9, 3e-9, 2e-9, 1e-9)
    assert a.worst(b) == Checks(4e-9, 3e-9, 3e-9, 4e-9)
    failed = Checks(math.nan, 0.0, 0.0, 0.0)
    assert math.isnan(a.worst(failed).reciprocity)
    assert math.isnan(failed.worst(a).reciprocity)


def test_a_residual_may_be_what_rounding_explains_and_no_more() -> None:
    Checks(0.0, 0.0, 0.0, 2e-6, rounding=4e-7).require()
    for failed in (Checks(0.0, 0.0, 0.0, 2e-6), Checks(0.0, 0.0, 5e-6, 0.0, rounding=4e-7), Checks(math.nan, 0, 0, 0)):
        with pytest.raises(ArithmeticError, match=r"reciprocity|energy|residual"):
            failed.require()


def test_rounding_explains_the_residual_of_a_solve(cantilever: Solved) -> None:
    """A residual is a sum of some hundred products in each row: between a tenth of one rounding and ten."""
    seen = checked(cantilever, cantilever.stiffness)
    assert 0.1 * seen.rounding < seen.residual < 10 * seen.rounding


def test_motions_of_a_cut_port_by_class() -> None:
    """A port cut by both planes has in each class the motions of that class's parities, and nothing else.

    For the output: y is even in both; x and rz odd in x alone; z and rx odd in z alone; ry odd in both.
    """
    solid = ring()
    space = port_compliance.port_space(solid.body, solid.domain, solid.ports)
    for cls in port_compliance.classes(solid.domain):
        fitting = np.any(space.projection(cls) != 0, axis=1)
        expected = {(1, 1): {1}, (-1, 1): {0, 5}, (1, -1): {2, 3}, (-1, -1): {4}}[cls.signs]
        assert set(np.flatnonzero(fitting[6:])) == expected

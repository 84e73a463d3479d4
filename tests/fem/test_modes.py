"""Vibrating bars and beams against closed forms, classes against the whole, and the actuator against dense algebra.

What modes answer the actuator with, against a rod's closed form and the static compliance of the same mesh.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
import scipy.linalg as la
from numpy.linalg import det
from scipy.optimize import brentq

from flexdesign.design.part import Port, SymmetryPlane
from flexdesign.fem.analysis import ModeRecord
from flexdesign.fem.quantities import drive_share
from flexdesign.fem.solving import modes
from flexdesign.fem.solving.modes import Mode
from flexdesign.fem.solving.statics import PortCompliance
from studies.verification.solids import CORK, METAL, Array, Solid, at, beam, lattice
from tests.fem.solids import Solved, full, solve

#: Tolerance of the eigenvalue iteration is 1e-7, of frequencies half that.
ITERATION = 1e-7


def found(solved: Solved, count: int, actuator: float = 0.0) -> list[Mode]:
    """Return the lowest modes of every class, in order of frequency."""
    mass = solved.body.mass()
    everything = [m for s in solved.systems for m in modes.class_modes(s, mass, solved.space, count, actuator)]
    return sorted(everything, key=lambda mode: mode.frequency)


# --- cantilevers --------------------------------------------------------------------------------------------------

LENGTH, HEIGHT, WIDTH = 80e-3, 4e-3, 5e-3
AREA, E, G, RHO = HEIGHT * WIDTH, CORK.youngs_modulus, CORK.shear_modulus, CORK.density


@pytest.fixture(scope="module")
def cantilever() -> Solved:
    return solve(beam(LENGTH, HEIGHT, WIDTH, (24, 2, 2)))


@pytest.fixture(scope="module")
def vibrations(cantilever: Solved) -> list[Mode]:
    return found(cantilever, 9)


def timoshenko(inertia: float, count: int) -> list[float]:
    """Return the bending frequencies [Hz] of a clamped-free Timoshenko beam, kappa = 5/6.

    With deflection w and rotation p as exp(r x): kappa G A (w'' - p') = -rho A om^2 w,
    E I p'' + kappa G A (w' - p) = -rho I om^2 p; a 4 x 4 determinant of w = p = 0 at the clamp, no force and no moment
    at the tip.
    """
    shear, bend = 5 / 6 * G * AREA, E * inertia

    def determinant(om: float) -> float:
        a, b = RHO * AREA * om**2, RHO * inertia * om**2
        # (shear r^2 + a) (bend r^2 + b - shear) + shear^2 r^2 = 0
        roots = np.sqrt(
            np.roots([shear * bend, shear * (b - shear) + a * bend + shear**2, a * (b - shear)]).astype(complex)
        )
        r = np.concatenate([roots, -roots])
        p = (shear * r**2 + a) / (shear * r)  # for w = 1
        tip = np.exp(r * LENGTH)
        rows = np.array([np.ones(4), p / r[0], (r - p) * tip / r[0], r * p * tip / r[0] ** 2])
        columns = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [1, 0, -1, 0], [0, 1, 0, -1]]) / 2  # to cosh and sinh
        value = det(rows @ columns)
        return float(value.real if abs(value.real) > abs(value.imag) else value.imag)

    return [brentq(determinant, 0.8 * om, 1.01 * om) / (2 * np.pi) for om in 2 * np.pi * euler(inertia, count)]


def euler(inertia: float, count: int) -> Array:
    """Return the bending frequencies [Hz] of an Euler-Bernoulli beam (Blevins, 1979, table 8-1)."""
    roots = np.array([1.87510407, 4.69409113, 7.85475744])[:count]
    return roots**2 * np.sqrt(E * inertia / (RHO * AREA)) / LENGTH**2 / (2 * np.pi)


@pytest.mark.parametrize(("direction", "inertia"), [(1, WIDTH * HEIGHT**3 / 12), (2, HEIGHT * WIDTH**3 / 12)])
def test_bending_frequencies_follow_timoshenko(vibrations: list[Mode], direction: int, inertia: float) -> None:
    """Elements and the clamp's hold on warping only raise frequencies, here by 1e-4 for the first mode.

    That is little against what shear and rotary inertia take away from Euler and Bernoulli's frequencies: at most a
    tenth of it.
    """
    bending = [m.frequency for m in vibrations if np.abs(m.shape).max(axis=0).argmax() == direction][:2]
    for frequency, exact, slender in zip(bending, timoshenko(inertia, 2), euler(inertia, 2), strict=True):
        assert exact < frequency < exact + 0.1 * (slender - exact)


def test_axial_frequency_is_that_of_a_rod(vibrations: list[Mode]) -> None:
    """(1/4L) sqrt(E/rho) without lateral contraction; a quarter wave on 24 elements: (pi/48)^4 / 100 = 2e-7."""
    axial = next(m for m in vibrations if np.abs(m.shape).max(axis=0).argmax() == 0)
    assert axial.frequency == pytest.approx(np.sqrt(E / RHO) / (4 * LENGTH), rel=2e-7)


def test_half_the_mass_of_a_rod_moves_with_its_tip(vibrations: list[Mode]) -> None:
    """The mean of sin^2 over a quarter wave; its error is of the order of the frequency's."""
    axial = next(m for m in vibrations if np.abs(m.shape).max(axis=0).argmax() == 0)
    assert axial.output_mass == pytest.approx(RHO * AREA * LENGTH / 2, rel=1e-6)


def test_a_quarter_of_the_mass_of_a_cantilever_moves_with_its_tip() -> None:
    """Euler and Bernoulli: phi(L)^2 is four times the mean of phi^2. Shear and rotary inertia: of the order (h/L)^2."""
    upright = beam(LENGTH, HEIGHT, WIDTH, (24, 2, 2))
    sideways = (Port("output", "output", (LENGTH, 0.0, 0.0), (0.0, 1.0, 0.0)), upright.ports[1])
    first = found(solve(Solid(upright.mesh, upright.domain, sideways, CORK)), 1)[0]
    assert first.output_mass == pytest.approx(RHO * AREA * LENGTH / 4, rel=(HEIGHT / LENGTH) ** 2)


def test_a_mode_that_leaves_the_output_at_rest_has_no_output_mass(vibrations: list[Mode]) -> None:
    """The tip's average motion along the beam vanishes in bending: its mass there is none that one could push."""
    assert vibrations[0].output_mass > 1e6 * RHO * AREA * LENGTH


# --- what a mode answers the actuator with ------------------------------------------------------------------------


def compliance(solved: Solved) -> PortCompliance:
    return PortCompliance(solved.matrix, solved.space.extension, solved.space.output)


def drive_shares(solved: Solved, many: Sequence[Mode], spring: float = 0.0) -> Array:
    """Return the share of each mode in the static response to an actuator of this stiffness."""
    records = [ModeRecord.of(mode, installed=spring > 0) for mode in many]
    return np.array([drive_share(record, compliance(solved), spring) for record in records])


def driven_rod(length: float, half: float, cells: int, along: float, against: float) -> Solved:
    """A rod whose output is its tip, and whose input a strip of half-width `half` at its middle; either way round."""
    x, y, z = (np.linspace(*each) for each in ((0, length, cells + 1), (0, HEIGHT, 2), (0, WIDTH, 2)))
    patches = {
        "output": at("x", length),
        "input": at("y", HEIGHT, ("x", length / 2 - half, length / 2 + half)),
        "ground": at("x", 0.0),
    }
    rod_ports = (
        Port("output", "output", (length, HEIGHT / 2, WIDTH / 2), (along, 0.0, 0.0)),
        Port("input", "input", (length / 2, HEIGHT, WIDTH / 2), (-against, 0.0, 0.0)),
        Port("ground", "ground", (0.0, HEIGHT / 2, WIDTH / 2), (-1.0, 0.0, 0.0)),
    )
    return solve(Solid.of(lattice(x, y, z), patches, rod_ports, material=CORK))


@pytest.mark.parametrize(("along", "against"), [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)])
def test_shares_of_a_rod_driven_at_its_middle_have_both_signs(along: float, against: float) -> None:
    """Force at x = L/2, motion at the tip: phi = sin k x, k = (2n - 1) pi / 2L, over the static compliance L / 2EA.

    2 phi(L/2) phi(L) / (rho A L w^2) is then 4 / (k L)^2 sin(k L/2) sin(k L) of it: 115, -13 and -5 %. On a strip of
    half-width d, phi averages to sin(k d) / (k d) of its value in the middle. Which way the normals of output and input
    point changes signs of motions, not shares. The compliance is exact; quadratics of length h miss a wave by up to
    (k h)^3 / (72 sqrt 3), and 1/sqrt 2 is what the wave is at the strip.
    """
    length, half, cells = 20e-3, 20e-3 / 12, 24
    rod = driven_rod(length, half, cells, along, against)
    axial = [mode for mode in found(rod, 25) if mode.output_mass < RHO * AREA * length][:3]
    assert compliance(rod).c12 == pytest.approx(along * against * length / (2 * E * AREA), rel=1e-9)
    assert np.sign([m.extension for m in axial]).tolist() == [along * against * sign for sign in (1, -1, -1)]
    k = np.array([1, 3, 5]) * np.pi / (2 * length)
    exact = 4 / (k * length) ** 2 * np.sin(k * length / 2) * np.sin(k * length) * np.sinc(k * half / np.pi)
    error = np.sqrt(2) * (k * length / cells) ** 3 / (72 * np.sqrt(3))
    assert np.all(np.abs(drive_shares(rod, axial) / exact - 1) < error)


@pytest.mark.parametrize("spring", [0.0, 5e7])
def test_modes_together_answer_the_actuator_as_statics_does(forks: tuple[Solved, Solved], spring: float) -> None:
    """What the modes left out add to the compliances at the two ports, R11 and R22, are sums of squares.

    So they are positive, and by Cauchy and Schwarz what they add between the ports is at most sqrt(R11 R22): the bound
    on the shares that are missing, which more modes bring down: half of all modes to a few percent.
    """
    quarter, _ = forks
    c, bounds = compliance(quarter), []
    stiffened = 1 + spring * c.c11
    for count in (3, len(quarter.systems[0].free) // 2):
        many = modes.class_modes(quarter.systems[0], quarter.body.mass(), quarter.space, count, spring)
        w2 = np.array([(2 * np.pi * m.frequency) ** 2 for m in many])
        left_in = c.c11 / stiffened - sum(np.array([m.extension for m in many]) ** 2 / w2)
        left_out = 1 / c.output_stiffness(spring) - sum(1 / np.array([m.output_mass for m in many]) / w2)
        assert left_in > 0 and left_out > 0
        bounds.append(np.sqrt(left_in * left_out) / abs(c.c12 / stiffened))
        assert abs(1 - drive_shares(quarter, many, spring).sum()) < bounds[-1]
    assert bounds[1] < min(bounds[0], 0.03)


# --- classes and actuator -----------------------------------------------------------------------------------------

FORK_PORTS = (
    Port("input_left", "input", (-4e-3, 0.0, 0.0), (1.0, 0.0, 0.0)),
    Port("input_right", "input", (4e-3, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    Port("output", "output", (0.0, 5e-3, 0.0), (0.0, 1.0, 0.0)),
    Port("ground", "ground", (0.0, -6e-3, 0.0), (0.0, -1.0, 0.0)),
)
FORK_PATCHES = {
    "input_right": at("x", 4e-3, ("y", -3e-3, 3e-3)),
    "output": at("y", 5e-3, ("x", -4e-3, 4e-3)),
    "ground": at("y", -6e-3),
}
FORK_PLANES = (SymmetryPlane("x", {"input_left": "input_right"}), SymmetryPlane("z", {}))


@pytest.fixture(scope="module")
def forks() -> tuple[Solved, Solved]:
    """A quarter of a small ring, and the whole: few enough unknowns for dense algebra."""
    cells = lattice(
        np.array([0.0, 4e-3, 6e-3]),
        np.array([-6e-3, -3e-3, 3e-3, 5e-3]),
        np.array([0.0, 1.5e-3]),
        lambda c: (c[:, 0] > 4e-3) | (np.abs(c[:, 1]) > 3e-3),
    )
    quarter = Solid.of(cells, FORK_PATCHES, FORK_PORTS, FORK_PLANES, METAL)
    return solve(quarter), solve(quarter.whole({**FORK_PATCHES, "input_left": at("x", -4e-3, ("y", -3e-3, 3e-3))}))


def average(solved: Solved, port: str, component: int) -> Array:
    """Return the row that averages a displacement component over a port: quadratics by their edge middles."""
    body = solved.body
    nodes = body.surface_nodes(body.mesh.on_face(solved.solid.domain.ports[port]))
    a, b, c = (body.positions[nodes[:, i]] for i in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    row = np.zeros(body.n_dofs)
    np.add.at(row, 3 * nodes[:, 3:] + component, np.repeat(areas[:, None], 3, axis=1) / (3 * areas.sum()))
    return row


def dense(whole: Solved, spring: float) -> tuple[Array, Array, Array]:
    """Return frequencies [Hz], output motions and extensions of the whole with a spring between the inputs, by LAPACK.

    A motion of the right input along x and of the left one against it extends the gap; y is the output's normal.
    """
    free = whole.systems[0].free
    gap = (average(whole, "input_right", 0) - average(whole, "input_left", 0))[free]
    stiffness = full(whole.systems[0].stiffness).toarray() + spring * np.outer(gap, gap)
    mass = full(whole.body.mass())[free][:, free].toarray()
    values, vectors = la.eigh(stiffness, mass, subset_by_index=[0, 19])
    return np.sqrt(values) / (2 * np.pi), average(whole, "output", 1)[free] @ vectors, gap @ vectors


# Between nothing, a spring softer, one about as stiff as, and one stiffer than the ring itself.
@pytest.mark.parametrize("spring", [0.0, 1e6, 5e7, 1e10])
def test_classes_with_an_actuator_have_the_modes_of_the_whole(forks: tuple[Solved, Solved], spring: float) -> None:
    """Four classes and a rank-one update against one dense matrix K + k c c^T: all of the lowest 12 modes."""
    quarter, whole = forks
    frequencies, outputs, extensions = dense(whole, spring)
    masses = 1 / outputs**2
    classes = found(quarter, 12, spring)[:12]
    at_once = found(whole, 12, spring)
    assert [m.frequency for m in classes] == pytest.approx(frequencies[:12], rel=ITERATION)
    assert [m.frequency for m in at_once] == pytest.approx(frequencies[:12], rel=ITERATION)
    assert len({m.symmetry for m in classes}) == 4
    main = masses[:12] < 1.0  # kg: modes that move the output; the whole weighs a gram
    assert main.sum() >= 2
    for many in (classes, at_once):
        assert [m.output_mass < 1.0 for m in many] == main.tolist()
        assert np.array([m.output_mass for m in many])[main] == pytest.approx(masses[:12][main], rel=1e-5)
        signed = (extensions * np.sign(outputs))[:12][main]
        assert np.array([m.extension for m in many])[main] == pytest.approx(signed, abs=1e-5 * np.abs(signed).max())


def test_an_actuator_stiffens_only_what_it_feels(forks: tuple[Solved, Solved]) -> None:
    """Rayleigh: no frequency falls; those of the classes in which the inputs do not part stay."""
    quarter, _ = forks
    loose, stiff = found(quarter, 4), found(quarter, 4, 1e8)
    for cls in {mode.symmetry for mode in loose}:
        before = np.array([m.frequency for m in loose if m.symmetry == cls])
        after = np.array([m.frequency for m in stiff if m.symmetry == cls])
        if cls == "even in x, even in z":
            assert np.all(after >= before * (1 - ITERATION)) and after[0] > 1.05 * before[0]
        else:
            np.testing.assert_allclose(after, before, rtol=ITERATION)


def test_shapes_of_a_quarter_have_unit_mass_with_their_images(forks: tuple[Solved, Solved]) -> None:
    quarter, _ = forks
    mass = full(quarter.body.mass())
    for mode in found(quarter, 2):
        assert 4 * mode.shape.ravel() @ mass @ mode.shape.ravel() == pytest.approx(1.0, rel=1e-10)


def test_shapes_satisfy_the_equations_of_motion(forks: tuple[Solved, Solved]) -> None:
    quarter, _ = forks
    mass = quarter.body.mass()
    for system in quarter.systems:
        for mode in modes.class_modes(system, mass, quarter.space, 2, 0.0):
            v = mode.shape.ravel()[system.free]
            elastic = full(system.stiffness) @ v
            inertial = (2 * np.pi * mode.frequency) ** 2 * (full(mass)[system.free][:, system.free] @ v)
            assert np.abs(elastic - inertial).max() < 1e-5 * np.abs(elastic).max()


def test_the_mode_that_carries_the_output_is_found_above_those_that_do_not(cantilever: Solved) -> None:
    """The lowest modes of a cantilever bend; pulled at its tip it moves in its axial one, sqrt(E / rho) / (4 L)."""
    bending, axial = found(cantilever, 1)
    assert not np.isfinite(bending.output_mass)
    assert axial.frequency == pytest.approx(np.sqrt(E / RHO) / (4 * LENGTH), rel=1e-5)
    assert axial.output_mass == pytest.approx(RHO * AREA * LENGTH / 2, rel=1e-5)  # 8 / pi^2 of the compliance

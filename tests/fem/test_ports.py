"""Port loads and motions by statics and kinematics, and symmetry classes against the whole body."""

from __future__ import annotations

import numpy as np
import pytest

from flexdesign.design.part import Port, SymmetryPlane
from flexdesign.fem.meshing import domain, mesh, sizing
from flexdesign.fem.meshing.mesh import mirror_mesh
from flexdesign.fem.solving import port_compliance
from flexdesign.fem.solving.port_compliance import SymmetryClass, parity
from studies.verification.solids import Array, Solid, at, beam, lattice, weld_points
from tests.fem.solids import RING_PATCHES, RING_PLANES, RING_PORTS, Bracket, Solved, relative, ring, solve

ROUNDING = 1e-12
#: Different linear systems, each solved to a residual of 1e-11.
SOLVES = 1e-10


def rigid(positions: Array, about: Array) -> Array:
    """Return the displacements (n, 3, 6) of the six rigid motions about a point."""
    motions = np.zeros((len(positions), 3, 6))
    x, y, z = (positions - about).T
    motions[:, [0, 1, 2], [0, 1, 2]] = 1.0
    motions[:, 1, 3], motions[:, 2, 3] = -z, y
    motions[:, 0, 4], motions[:, 2, 4] = z, -x
    motions[:, 0, 5], motions[:, 1, 5] = -y, x
    return motions


# --- one port -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def lopsided() -> tuple[Solid, Array]:
    """A body whose L-shaped top face is a port, and the port's loads about a point that is not its centroid."""
    axis = np.linspace(0.0, 3e-3, 4)
    cells = lattice(axis, axis, axis, lambda c: (c[:, 0] < 1e-3) | (c[:, 1] < 1e-3), wobble=1e-4)
    place = Port("output", "output", (1e-3, 0.5e-3, 3e-3), (0.0, 0.0, 1.0))
    solid = Solid.of(cells, {"output": at("z", 3e-3), "ground": at("z", 0.0)}, [place])
    return solid, port_compliance.port_space(solid.body, solid.domain, solid.ports).loads["output"]


def test_unit_loads_have_unit_force_and_moment(lopsided: tuple[Solid, Array]) -> None:
    solid, loads = lopsided
    forces = loads.reshape(-1, 3, 6)
    arms = solid.body.positions - np.array(solid.ports[0].point)
    moments = np.stack([np.cross(arms, forces[:, :, k]).sum(axis=0) * 1e3 for k in range(6)], axis=1)
    np.testing.assert_allclose(forces.sum(axis=0), np.eye(6)[:3], atol=ROUNDING * np.abs(forces).sum())
    np.testing.assert_allclose(moments, np.eye(6)[3:] * 1e3, atol=ROUNDING * np.abs(forces).sum())


def test_loads_act_on_the_face_alone(lopsided: tuple[Solid, Array]) -> None:
    solid, loads = lopsided
    beside = np.abs(solid.body.positions[:, 2] - 3e-3) > 1e-9
    assert not loads.reshape(-1, 3, 6)[beside].any()


def test_a_rigid_motion_is_measured_as_itself(lopsided: tuple[Solid, Array]) -> None:
    """The motion is the loads' conjugate, q = L^T u: a translation or rotation about the port's point comes back."""
    solid, loads = lopsided
    motions = rigid(solid.body.positions, np.array(solid.ports[0].point)).reshape(-1, 6)
    np.testing.assert_allclose(loads.T @ motions, np.eye(6), atol=1e-11)


def test_translation_is_the_average_and_rotation_the_best_fit(lopsided: tuple[Solid, Array]) -> None:
    """A field quadratic on the face: the least-squares rigid motion, from an integral by a fine midpoint rule."""
    solid, loads = lopsided
    point = np.array(solid.ports[0].point)

    def field(x: Array) -> Array:
        a, b = x[:, 0], x[:, 1]
        return np.stack([a * b, b**2 - 3 * a**2, 2 * a**2 + a * b], axis=1)

    found = loads.T @ field(solid.body.positions).ravel()
    n = 600  # the midpoint rule's error falls with n^-2: 3e-6 of the largest coefficient
    grid = (np.arange(n) + 0.5) * 3e-3 / n
    places = np.stack([*np.meshgrid(grid, grid, indexing="ij"), np.full((n, n), 3e-3)], axis=-1).reshape(-1, 3)
    places = places[(places[:, 0] < 1e-3) | (places[:, 1] < 1e-3)]
    expected, *_ = np.linalg.lstsq(rigid(places, point).reshape(-1, 6), field(places).ravel())
    np.testing.assert_allclose(found[:3], expected[:3], atol=1e-5 * np.abs(expected[:3]).max())
    np.testing.assert_allclose(found[3:], expected[3:], atol=1e-5 * np.abs(expected[3:]).max())


def test_uniform_traction_on_quadratic_triangles_loads_edge_middles_alone() -> None:
    """The consistent load of a 6-node triangle under uniform traction: a third of its force on each edge middle."""
    axis = np.linspace(0.0, 1e-3, 2)
    place = Port("output", "output", (0.5e-3, 0.5e-3, 1e-3), (0.0, 0.0, 1.0))
    solid = Solid.of(lattice(axis, axis, axis), {"output": at("z", 1e-3)}, [place])
    body = solid.body
    pull = port_compliance.port_space(body, solid.domain, solid.ports).loads["output"].reshape(-1, 3, 6)[:, 2, 2]
    nodes = body.surface_nodes(body.mesh.on_face(solid.domain.ports["output"]))
    expected = np.zeros(len(pull))
    np.add.at(expected, nodes[:, 3:], 1 / 3 / len(nodes))
    np.testing.assert_allclose(pull, expected, atol=1e-13)


def test_ground_is_no_moving_port_and_rows_follow_the_order_of_ports() -> None:
    space = port_compliance.port_space(ring().body, ring().domain, RING_PORTS)
    assert [port.name for port in space.ports] == ["input_left", "input_right", "output"]
    assert space.retained == ("input_right", "output")
    assert space.size == 18 and space.rows("output") == slice(12, 18)


def test_extension_opens_the_gap_and_output_follows_its_normal() -> None:
    """Inner faces of the inputs: moved apart by 1 on the right and 2 on the left they have let in 3."""
    space = port_compliance.port_space(ring().body, ring().domain, RING_PORTS)
    motion = np.zeros(18)
    motion[space.rows("input_left")][:3] = (-2.0, 7.0, 7.0)
    motion[space.rows("input_right")][:3] = (1.0, 7.0, 7.0)
    motion[space.rows("output")][:3] = (7.0, 4.0, 7.0)
    assert space.extension @ motion == 3.0
    assert space.output @ motion == 4.0


# --- parity and classes -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", range(3))
def test_parity_is_that_of_a_mirrored_rigid_motion(axis: int) -> None:
    """v'(x) = S v(S x) for v = translation + rotation x position, worked out with vectors."""
    rng = np.random.default_rng(axis)
    motion, places = rng.standard_normal(6), rng.standard_normal((5, 3))
    mirror = np.eye(3)
    mirror[axis, axis] = -1.0
    reflected = (motion[:3] + np.cross(motion[3:], places @ mirror)) @ mirror
    image = parity(axis) * motion
    np.testing.assert_allclose(reflected, image[:3] + np.cross(image[3:], places), atol=1e-14)


def test_classes_of_two_planes() -> None:
    found = port_compliance.classes(ring().domain)
    assert [cls.signs for cls in found] == [(1, 1), (1, -1), (-1, 1), (-1, -1)]
    assert [cls.is_symmetric for cls in found] == [True, False, False, False]
    assert found[0].name == "even in x, even in z" and found[2].name == "odd in x, even in z"
    assert found[1].held_components(0) == [0] and found[1].held_components(1) == [0, 1]
    assert SymmetryClass((), ()).name == "whole part"


# --- the classes add up to the whole ------------------------------------------------------------------------------

POST = 4e-3
POST_PLANES = (
    SymmetryPlane("x", {"input_mp": "input_pp", "input_mm": "input_pm"}),
    SymmetryPlane("y", {"input_pm": "input_pp", "input_mm": "input_mp"}),
)
POST_PORTS = (
    *(
        Port(f"input_{a}{b}", "input", (sx * 7e-3, sy * 6e-3, POST), (0.0, 0.0, 1.0))
        for a, sx in (("p", 1), ("m", -1))
        for b, sy in (("p", 1), ("m", -1))
    ),
    Port("output", "output", (0.0, 0.0, 2e-3), (0.0, 0.0, 1.0)),
    Port("ground", "ground", (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
)
CROSS_PLANES = (
    SymmetryPlane("x", {"input_left": "input_right"}),
    SymmetryPlane("y", {"input_front": "input_back"}),
)
CROSS_PORTS = (
    Port("input_left", "input", (-8e-3, 0.0, 1e-3), (-1.0, 0.0, 0.0)),
    Port("input_right", "input", (8e-3, 0.0, 1e-3), (1.0, 0.0, 0.0)),
    Port("input_front", "input", (0.0, -7e-3, 1e-3), (0.0, -1.0, 0.0)),
    Port("input_back", "input", (0.0, 7e-3, 1e-3), (0.0, 1.0, 0.0)),
    Port("output", "output", (0.0, 0.0, 2e-3), (0.0, 0.0, 1.0)),
    Port("ground", "ground", (0.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
)


def posts() -> tuple[Solid, Solid]:
    """A plate with a post at each corner: one input is kept of four, the mirror image of itself in neither plane."""
    x, y = np.array([0.0, 3e-3, 5.5e-3, 8.5e-3]), np.array([0.0, 2e-3, 5e-3, 7e-3])
    z = np.array([0.0, 2e-3, POST])

    def inside(c: Array) -> Array:
        return (c[:, 2] < 2e-3) | ((c[:, 0] > 5.5e-3) & (c[:, 1] > 5e-3))

    common = {
        "output": at("z", 2e-3, ("x", -3e-3, 3e-3), ("y", -2e-3, 2e-3)),
        "ground": at("z", 0.0, ("x", -5.5e-3, 5.5e-3)),
    }
    far = (5e-3, 9e-3), (-9e-3, -5e-3)
    tops = {
        f"input_{a}{b}": at("z", POST, ("x", *far[i]), ("y", *far[j]))
        for i, a in enumerate("pm")
        for j, b in enumerate("pm")
    }
    kept = {"input_pp": tops["input_pp"], **common}
    quarter = Solid.of(lattice(x, y, z, inside, wobble=3e-4), kept, POST_PORTS, POST_PLANES)
    return quarter, quarter.whole({**tops, **common})


def cross() -> tuple[Solid, Solid]:
    """A plate with an input on each side: two are kept, each swapped in one plane and cut by the other."""
    x, y, z = np.array([0.0, 2e-3, 5e-3, 8e-3]), np.array([0.0, 3e-3, 7e-3]), np.array([0.0, 1e-3, 2e-3])
    sides = {
        "input_right": at("x", 8e-3),
        "input_back": at("y", 7e-3),
        "input_left": at("x", -8e-3),
        "input_front": at("y", -7e-3),
    }
    common = {
        "output": at("z", 2e-3, ("x", -2e-3, 2e-3), ("y", -3e-3, 3e-3)),
        "ground": at("z", 0.0, ("x", -5e-3, 5e-3)),
    }
    kept = {name: sides[name] for name in ("input_right", "input_back")}
    quarter = Solid.of(lattice(x, y, z, wobble=2e-4), {**kept, **common}, CROSS_PORTS, CROSS_PLANES)
    return quarter, quarter.whole({**sides, **common})


def halves(plane: int) -> tuple[Solid, Solid]:
    """A ring of which only one plane is known: half of it, and the whole."""
    quarter = ring()
    both = RING_PLANES[1 - plane], RING_PLANES[plane]
    points, tets, _ = mirror_mesh(quarter.mesh.points, quarter.mesh.tets, both[:1], {})
    kept = {n: p for n, p in RING_PATCHES.items() if n != "input_left" or plane == 1}
    half = Solid.of(weld_points(points, tets), kept, RING_PORTS, both[1:])
    return half, half.whole(RING_PATCHES)


@pytest.fixture(scope="module")
def rings() -> tuple[Solved, Solved]:
    return solve(ring()), solve(ring().whole(RING_PATCHES))


def test_quarter_ring_gives_every_entry_of_the_whole(rings: tuple[Solved, Solved]) -> None:
    """Both inputs and the output, lateral forces and moments too: 18 x 18 entries."""
    quarter, whole = rings
    assert whole.solid.mesh.volume == pytest.approx(4 * quarter.solid.mesh.volume, rel=ROUNDING)
    assert quarter.matrix.shape == whole.matrix.shape == (18, 18)
    assert np.all(np.diag(whole.matrix) > 0)
    assert relative(quarter.matrix, whole.matrix) < SOLVES


@pytest.mark.parametrize(
    "bodies", [posts, cross, lambda: halves(0), lambda: halves(1)], ids=["posts", "cross", "x", "z"]
)
def test_other_symmetries_give_every_entry_of_the_whole(bodies: object) -> None:
    part, whole = (solve(solid) for solid in bodies())  # type: ignore[operator]
    assert whole.space.retained == tuple(port.name for port in whole.space.ports)
    assert relative(part.matrix, whole.matrix) < SOLVES


def test_each_class_shares_what_the_others_do_not(rings: tuple[Solved, Solved]) -> None:
    """Parities of whole-part motions decide which class an entry comes from; across classes there is nothing.

    Sum and difference of the inputs' motions are even and odd in x; a matrix over those is block diagonal.
    """
    quarter, _ = rings
    turn = np.eye(18)
    turn[:6, 6:12] = np.diag(parity(0))
    turn[6:12, :6] = -np.diag(parity(0))  # rows: left + P right, right - P left
    signs_x = np.concatenate([np.ones(6), -np.ones(6), parity(0)])
    signs_z = np.tile(parity(2), 3)
    block = turn @ quarter.matrix @ turn.T
    strangers = (signs_x[:, None] != signs_x) | (signs_z[:, None] != signs_z)
    scale = np.sqrt(np.outer(np.diag(block), np.diag(block)))
    assert strangers.sum() > 18 * 18 / 2
    assert np.abs(block / scale)[strangers].max() < ROUNDING
    assert np.linalg.matrix_rank(block / scale, tol=1e-6) == 18  # no class is missing


def test_port_motion_of_a_quarter_is_that_of_the_whole(rings: tuple[Solved, Solved]) -> None:
    """One lateral load, worked out by hand: the whole part's field, averaged over the port's facets on the mesh."""
    _, whole = rings
    field = whole.displacements[0][:, whole.space.rows("input_left").start + 2].reshape(-1, 3)  # z force on the left
    body = whole.body
    nodes = body.surface_nodes(body.mesh.on_face(whole.solid.domain.ports["output"]))
    a, b, c = (body.positions[nodes[:, i]] for i in range(3))
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    average = (areas[:, None] * field[nodes[:, 3:]].mean(axis=1)).sum(axis=0) / areas.sum()  # edge middles: degree 2
    found = rings[0].matrix[12:15, 2]
    np.testing.assert_allclose(found, average, atol=SOLVES * np.abs(average).max())


def test_pytetwild_quarter_of_a_cad_part_gives_every_entry_of_the_whole() -> None:
    part = Bracket()
    quarter_domain = domain.of_part(part, chord=1e-5)
    roots = np.array([[[4e-3, 9e-3, 0.0], [4e-3, 9e-3, 3e-3]]])
    field = sizing.Sizing(roots, np.array([1e-3]), growth=0.5, largest=2e-3)
    quarter = Solid(mesh.tetrahedralize(quarter_domain, field, 5e-5), quarter_domain, part.ports())
    whole_domain = domain.of_part(part, symmetric=False, chord=1e-5)
    points, tets, _ = mirror_mesh(quarter.mesh.points, quarter.mesh.tets, quarter_domain.planes, {})
    whole = Solid(
        mesh.tag(*weld_points(points, tets), whole_domain, whole_domain.surface()), whole_domain, part.ports()
    )
    assert whole.mesh.volume == pytest.approx(whole_domain.volume, rel=ROUNDING)
    assert relative(solve(quarter).matrix, solve(whole).matrix) < SOLVES


def test_compliance_is_symmetric_and_positive(rings: tuple[Solved, Solved]) -> None:
    """Maxwell and Betti, between any two ports; and every load does work."""
    matrix = rings[0].matrix / np.sqrt(np.outer(*2 * [np.diag(rings[0].matrix)]))
    np.testing.assert_allclose(matrix, matrix.T, atol=SOLVES)
    assert np.linalg.eigvalsh(matrix)[0] > 1e-6


def test_without_symmetry_there_is_one_class() -> None:
    assert [cls.name for cls in port_compliance.classes(beam(1.0, 0.1, 0.1, (2, 1, 1)).domain)] == ["whole part"]

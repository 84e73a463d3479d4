"""The energy of condensed parts to third order: against that of the whole mesh, beams, and its own derivatives."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexdesign.design import design
from flexdesign.design.materials import Crystal, Material
from flexdesign.design.part import Port, SymmetryPlane
from flexdesign.fem.meshing import domain, methods
from flexdesign.fem.meshing.domain import Face
from flexdesign.fem.solving.large_displacement import LargeDisplacement
from flexdesign.fem.superelements import superelement
from flexdesign.fem.superelements.second_order import SecondOrder, amplitudes, of
from flexdesign.fem.superelements.superelement import Superelement
from studies.verification.solids import CORK, METAL, Solid, at, beam, lattice
from tests.fem.test_superelement import ALLOY, coarse, leaf

Array = np.ndarray[Any, Any]


@dataclasses.dataclass(frozen=True)
class Block:
    """A lattice of cells as a part: what an assembly and a superelement ask of one."""

    solid: Solid

    def ports(self) -> tuple[Port, ...]:
        return self.solid.ports

    def condensed(self) -> Superelement:
        """Return its superelement, faces rigid or uniformly strained; a face is as large as its facets."""
        mesh, index = self.solid.mesh, self.solid.domain.ports
        places = {
            face: mesh.points[np.unique(mesh.facets[mesh.faces == face])] for face in range(max(index.values()) + 1)
        }
        faces = tuple(Face(points, np.zeros((0, 3), dtype=np.int64), None) for points in places.values())
        cut = dataclasses.replace(self.solid.domain, faces=faces)
        piece: Any = self
        return superelement.condense(piece, self.solid.material, cut, mesh, degree=1, mode_count=0, interior=True)

    def mirrored(self) -> Block:
        """Return the whole of which this is a part."""
        return Block(self.solid.whole({"end": at("x", 3.5e-3), "start": at("x", -3.5e-3)}))


def strip(length: float, thickness: float, width: float, cells: int = 12, material: Material = CORK) -> Block:
    """Return a leaf without stubs along x that bends in y, its ``ground`` at x = 0 and its ``output`` at the end."""
    return Block(beam(length, thickness, width, (cells, 1, 1), material))


def dumbbell(*planes: str) -> Block:
    """Return a leaf of 4 mm between stubs of 1.5 mm, the whole or what coordinate planes cut from it."""
    half = np.array([0.0, 1.0, 2.0, 2.75, 3.5]), np.array([0.0, 0.25, 1.0]), np.array([0.0, 0.5, 1.0])
    x, y, z = (1e-3 * (h if name in planes else np.unique([-h, h])) for h, name in zip(half, "xyz", strict=True))
    cells = lattice(x, y, z, lambda c: (np.abs(c[:, 0]) > 2e-3) | (np.abs(c[:, 1]) < 0.25e-3))
    ends = (
        Port("start", "joint", (-3.5e-3, 0.0, 0.0), (-1.0, 0.0, 0.0)),
        Port("end", "joint", (3.5e-3, 0.0, 0.0), (1.0, 0.0, 0.0)),
    )
    patches = {"end": at("x", 3.5e-3)} | ({} if "x" in planes else {"start": at("x", -3.5e-3)})
    mirrors = [SymmetryPlane(name, {"start": "end"} if name == "x" else {}) for name in planes]  # type: ignore[arg-type]
    return Block(Solid.of(cells, patches, ends, mirrors, METAL))


@pytest.fixture(scope="module")
def hinge() -> Superelement:
    return coarse(leaf(), ALLOY, coarseness=1.5, degree=1, mode_count=0, interior=True)[0]


@pytest.fixture(scope="module")
def amplifier() -> Superelement:
    """The paper's amplifier on a coarse mesh of the whole: no symmetry is made use of."""
    drawn = design.read(design.find("lin2019_amplifier_xy"))
    body = domain.of_part(drawn.part(), symmetric=False, chord=domain.chord(drawn.part()))
    grading = methods.Grading(body, drawn.part().linkage().members, *methods.EXTRUDED_GRADING, None)
    mesh = methods.Extruded(grading).mesh(4.0)
    return superelement.condense(drawn.part(), drawn.material, body, mesh, degree=1, mode_count=1, interior=True)


def softness(law: SecondOrder) -> Array:
    """Return amplitudes of like energy."""
    return np.asarray(1 / np.sqrt(np.diag(law.stiffness)))


def scaled(law: SecondOrder) -> Array:
    s = softness(law)
    return np.asarray(law.tensor * s[:, None, None] * s[:, None] * s)


# --- derivatives ------------------------------------------------------------------------------------------------------


def test_forces_are_the_derivative_of_the_energy_and_the_tangent_theirs(amplifier: Superelement) -> None:
    """Central differences of a polynomial of degree four, at strains as large as the linear ones."""
    law = dataclasses.replace(of(amplifier), actuator=1e7)
    rng = np.random.default_rng(0)
    at, ways = 0.1 * rng.standard_normal((2, 3, 13)) * softness(law)
    h = 1e-3
    rise = (law.energy(at + h * ways) - law.energy(at - h * ways)) / (2 * h)
    assert rise == pytest.approx(np.sum(law.forces(at) * ways, axis=1), rel=1e-4)
    change = (law.forces(at + h * ways) - law.forces(at - h * ways)) / (2 * h)
    found = np.einsum("nij,nj->ni", law.tangent(at), ways)
    assert found == pytest.approx(change, abs=1e-4 * np.abs(change).max())
    assert law.tangent(at) == pytest.approx(law.tangent(at).swapaxes(1, 2), rel=1e-12, abs=1e-6)


def test_small_displacements_are_linear_and_the_actuator_is_a_spring(amplifier: Superelement) -> None:
    law, still = of(amplifier), np.zeros(13)
    assert not law.forces(still).any()
    assert law.tangent(still) == pytest.approx(law.stiffness)
    held = dataclasses.replace(law, actuator=1e7)
    assert held.tangent(still) - law.tangent(still) == pytest.approx(1e7 * np.outer(law.extension, law.extension))
    assert law.extension[-1] == pytest.approx(1.0)


# --- the whole mesh ---------------------------------------------------------------------------------------------------


def cubic(energy: Any, size: float) -> float:
    """Return the cubic term of an energy: its odd part over two sizes, so that the fifth order drops out."""
    once, twice = ((energy(h) - energy(-h)) / (2 * h**3) for h in (size, 2 * size))
    return float(4 * once - twice) / 3


def carried(part: Superelement, c: Array) -> Array:
    """Return the nodes' displacements with the ports' faces as rigid bodies, turned by rotation matrices."""
    basis, extension = amplitudes(part), part.extension @ amplitudes(part) @ c
    moved = np.zeros(len(basis))
    for shapes, motion in zip(part.shapes, c[: 6 * len(part.shapes)].reshape(-1, 6), strict=True):
        turn = Rotation.from_rotvec(motion[3:]).as_matrix() - np.eye(3)
        point = np.array(shapes.port.point)
        rigid = shapes.coordinates(lambda x, p=point, r=turn, d=motion[:3]: ((x - p) @ r.T + d)[:, :, None])  # type: ignore[misc]
        moved[part.rows(shapes.port.name)] = rigid[:, 0]
    if np.any(part.extension):
        moved += basis[:, -1] * (extension - part.extension @ moved)
    assert part.interior is not None
    return np.asarray(part.interior.vectors @ moved)


@pytest.mark.parametrize("which", ["dumbbell", "amplifier"])
def test_the_cubic_energy_is_that_of_the_whole_mesh(which: str, amplifier: Superelement) -> None:
    """The total-Lagrangian strain energy of the same mesh; the dumbbell's tensor is from an eighth of it.

    The orders that the differences leave out are the seventh and up: 1e-6 at strains of 1e-3.
    """
    eighth = dumbbell("x", "y", "z")
    whole = amplifier if which == "amplifier" else eighth.mirrored().condensed()
    law = of(amplifier if which == "amplifier" else eighth.condensed())
    assert whole.interior is not None
    body = whole.interior.body
    exact = LargeDisplacement(body, np.arange(body.n_dofs))
    for seed in range(3):
        c = np.random.default_rng(seed).standard_normal(len(law.stiffness)) * softness(law)
        size = 1e-3 / np.abs(c[[3, 4, 5, 9, 10, 11]]).max()
        right = cubic(lambda h, c=c: exact.energy(carried(whole, h * c)), size)
        assert cubic(lambda h, c=c: float(law.energy(h * c)), size) == pytest.approx(right, rel=1e-6)


@pytest.mark.parametrize("planes", ["y", "yz", "xyz"])
def test_a_part_of_a_symmetric_whole_tells_all(planes: str) -> None:
    """The whole is meshed by the mirror images of the part, so that both are the same but for rounding."""
    block = dumbbell(*planes)
    whole, part = of(block.mirrored().condensed()), of(block.condensed())
    assert part.stiffness == pytest.approx(whole.stiffness, abs=1e-9 * np.abs(whole.stiffness).max())
    assert scaled(part) == pytest.approx(scaled(whole), abs=1e-8 * np.abs(scaled(whole)).max())


def turned(part: Superelement, inputs: list[Port], angles: Array) -> Array:
    """Return the amplitudes of a part that is turned as a whole about the mean of its ports' points."""
    points = np.array([shapes.port.point for shapes in part.shapes])
    matrix = Rotation.from_rotvec(angles).as_matrix() - np.eye(3)
    shift = (points - points.mean(axis=0)) @ matrix.T
    moved = np.hstack([shift, np.tile(angles, (len(points), 1))]).ravel()
    if not inputs:
        return moved
    extension = -sum(np.array(p.normal) @ matrix @ (np.array(p.point) - points.mean(axis=0)) for p in inputs)
    of_ports = part.extension @ amplitudes(part)[:, :-1] @ moved
    return np.append(moved, extension - of_ports)


@pytest.mark.parametrize("which", ["hinge", "amplifier"])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_part_that_turns_as_a_whole_stores_nothing(which: str, axis: int, request: pytest.FixtureRequest) -> None:
    """Strains of third order in the turn remain, whose energy is of sixth: h^6 times the stiffest rotation, at most."""
    part: Superelement = request.getfixturevalue(which)
    drawn = design.read(design.find("lin2019_amplifier_xy")).part()
    inputs = [port for port in drawn.ports() if port.role == "input"] if which == "amplifier" else []
    law = of(part)
    stiffest = np.diag(law.stiffness)[[3, 4, 5, 9, 10, 11]].max()
    for h in (0.02, 0.04):
        rigid = turned(part, inputs, h * np.eye(3)[axis])
        assert abs(float(law.energy(rigid))) < h**6 * stiffest


# --- beams ------------------------------------------------------------------------------------------------------------


LENGTH, THICKNESS = 40e-3, 0.4e-3


@pytest.fixture(scope="module")
def thin() -> SecondOrder:
    return of(strip(LENGTH, THICKNESS, 2e-3, cells=24).condensed())


def shortening(law: SecondOrder, c: Array) -> float:
    """Return by how much a part along x gets shorter if nothing holds it."""
    first, last = law.strained(c)[[0, 6]]  # the strip's output is its first port
    return float(abs(first - last))


@pytest.mark.parametrize("bent", ["shifted", "turned"])
def test_a_leaf_shortens_as_it_bends(bent: str) -> None:
    """int w'^2 / 2 of the cubic between parallel ends, 3/5 d^2 / L, and of the parabola that turns by a, a^2 L / 24.

    Quadratic elements bend in parabolas: the cubic is met with the square of their length, the parabola at once but for
    (t / L)^2 = 1e-4, which the slope of a leaf that is not thin adds.
    """
    c, d, angle = np.zeros(12), 1e-3, 0.02
    c[[1, 7] if bent == "shifted" else [5, 11]] = np.array([0.5, -0.5]) * (d if bent == "shifted" else angle)
    right = 0.6 * d**2 / LENGTH if bent == "shifted" else angle**2 * LENGTH / 24
    laws = [of(strip(LENGTH, THICKNESS, 2e-3, cells).condensed()) for cells in (12, 24)]
    coarser, finer = (shortening(law, c) / right - 1 for law in laws)
    assert abs(finer) < 6e-4
    assert abs(finer) < 1.001 * (THICKNESS / LENGTH) ** 2 or 3.5 < coarser / finer < 5


def test_stubs_shorten_a_hinge_as_they_turn() -> None:
    """Rigid stubs on an arc of length e: (H - e / 2) a^2 / 4 + e a^2 / 24 from face to face, 2 H apart.

    e is the leaf's length with its share of the stubs, E I over the bending stiffness; there is no lateral contraction.
    The bending in the stubs is no arc, which makes (e - l) / 12 of H / 4 uncertain: 0.2 %.
    """
    piece = leaf()
    law = of(coarse(piece, CORK, coarseness=1.5, degree=1, mode_count=0, interior=True)[0])
    bend, angle = np.zeros(12), 0.02
    bend[[5, 11]] = -angle / 2, angle / 2
    stiffness = bend @ law.stiffness @ bend / angle**2
    arc = CORK.youngs_modulus * piece.width * piece.thickness**3 / 12 / stiffness
    assert piece.length < arc < piece.length + piece.thickness
    right = ((piece.reach - arc / 2) / 4 + arc / 24) * angle**2
    assert shortening(law, bend) == pytest.approx(right, rel=3e-3)


def test_a_leaf_between_walls_resists_with_the_square_of_what_it_lengthens(thin: SecondOrder) -> None:
    """E A / L (0.6 d^2 / L)^2 / 2 above 12 E I / L^3 d^2 / 2, both at a shift by its thickness."""
    shift = np.zeros(12)
    shift[[1, 7]] = THICKNESS / 2, -THICKNESS / 2
    section, inertia = THICKNESS * 2e-3, 2e-3 * THICKNESS**3 / 12
    bending = 6 * CORK.youngs_modulus * inertia / LENGTH**3 * THICKNESS**2
    stretching = CORK.youngs_modulus * section / LENGTH * (0.6 * THICKNESS**2 / LENGTH) ** 2 / 2
    assert float(thin.energy(shift)) == pytest.approx(bending + stretching, rel=2e-3)
    assert stretching > 0.3 * bending


# --- materials --------------------------------------------------------------------------------------------------------


def test_another_material_scales_the_whole_energy(hinge: Superelement) -> None:
    other = Material("other", 2 * ALLOY.youngs_modulus, ALLOY.poissons_ratio, 3540.0, None)
    law, scaled_law = of(hinge), of(hinge.with_material(other))
    assert scaled_law.stiffness == pytest.approx(2 * law.stiffness, rel=1e-12)
    assert scaled_law.tensor == pytest.approx(2 * law.tensor, rel=1e-9, abs=1e-9 * np.abs(law.tensor).max())


def test_an_isotropic_crystal_is_the_isotropic_body() -> None:
    lam, mu = METAL.lame
    crystal = dataclasses.replace(METAL, crystal=Crystal(lam + 2 * mu, lam, mu, ((1, 1, 0), (-1, 1, 0), (0, 0, 1))))
    solid = dumbbell().solid
    plain, turned_axes = (of(Block(dataclasses.replace(solid, material=m)).condensed()) for m in (METAL, crystal))
    assert scaled(turned_axes) == pytest.approx(scaled(plain), abs=1e-9 * np.abs(scaled(plain)).max())


def test_a_part_that_does_not_know_its_inside_is_refused(hinge: Superelement) -> None:
    with pytest.raises(ValueError, match="condense it again"):
        of(dataclasses.replace(hinge, interior=None))

"""Condensed parts against the solve of the whole mesh, rigid-body mechanics and beam theory; and parts put together."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg

from flexdesign.core.errors import InputError
from flexdesign.design import design, part
from flexdesign.design.assembly import Assembly, Body, Box, Element, Placement
from flexdesign.design.materials import Material
from flexdesign.design.part import Port
from flexdesign.fem import analysis
from flexdesign.fem.analysis import Solution
from flexdesign.fem.meshing import domain, methods
from flexdesign.fem.solving.port_shapes import PortShapes, rigid_motions
from flexdesign.fem.superelements import superelement
from flexdesign.fem.superelements.assembled_stage import AssembledStage
from flexdesign.fem.superelements.superelement import Superelement

ALLOY = Material("alloy", 45e9, 0.35, 1770.0, None)
GEOMETRY = Path(__file__).parents[2] / "geometry"


def coarse(piece: Any, material: Material, *, coarseness: float, **options: Any) -> tuple[Superelement, Any, Any]:
    body = domain.of_part(piece, material=material, chord=domain.chord(piece))
    grading = methods.Grading(body, piece.linkage().members, *methods.EXTRUDED_GRADING, None)
    mesh = methods.Extruded(grading).mesh(coarseness)
    return superelement.condense(piece, material, body, mesh, **options), body, mesh


def leaf(**changes: float) -> Any:
    sizes = {"length": 3e-3, "thickness": 0.5e-3, "width": 10e-3, "stub_height": 6e-3, "stub_length": 5e-3}
    return part.load("leaf_hinge", GEOMETRY, part.PIECE_METHODS)(**(sizes | changes))


@pytest.fixture(scope="module")
def amplifier() -> Any:
    return design.read(design.find("lin2019_amplifier_xy"))


@pytest.fixture(scope="module")
def condensed(amplifier: Any) -> tuple[Superelement, Solution]:
    """The paper's amplifier, condensed and solved in full on one coarse mesh."""
    found, body, mesh = coarse(amplifier.part(), amplifier.material, coarseness=3.0)
    return found, analysis.solve(amplifier.part(), amplifier.material, body, mesh, mode_count=3)


@pytest.fixture(scope="module")
def hinge() -> Superelement:
    return coarse(leaf(), ALLOY, coarseness=1.5, degree=1, mode_count=0)[0]


# --- shapes of a port ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (-1.0, 0.0, 0.0), (0.6, 0.8, 0.0)])
@pytest.mark.parametrize(("degree", "count"), [(1, 9), (2, 18), (3, 30)])
def test_shapes_hold_all_polynomials_of_a_degree(normal: Any, degree: int, count: int) -> None:
    shapes = PortShapes(Port("face", "joint", (1e-3, 2e-3, 3e-3), normal), 5e-3, degree)
    assert shapes.count == count
    assert np.linalg.matrix_rank(shapes.at(shapes._samples).reshape(-1, count)) == count
    amplitudes = np.random.default_rng(0).standard_normal((count, 2))
    assert shapes.coordinates(lambda x: shapes.at(x) @ amplitudes) == pytest.approx(amplitudes, abs=1e-12)
    assert shapes.at(shapes._samples) @ shapes.rigid == pytest.approx(
        rigid_motions(shapes._samples, np.array(shapes.port.point)), abs=1e-12
    )


def test_what_is_no_polynomial_of_the_degree_is_refused() -> None:
    shapes = PortShapes(Port("face", "joint", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), 1.0, 1)
    with pytest.raises(ValueError, match="face: not a polynomial of degree 1"):
        shapes.coordinates(lambda x: x[:, :, None] * x[:, :1, None])


# --- one part ------------------------------------------------------------------------------------------------------


def held(found: Superelement, port: str) -> Any:
    """Return the amplitudes that are left when a port is held."""
    return np.setdiff1d(np.arange(len(found.stiffness)), np.arange(len(found.stiffness))[found.rows(port)])


def test_statics_are_those_of_the_whole_mesh(condensed: tuple[Superelement, Solution]) -> None:
    """Held at the ground it gives K_in and lambda but for what the output face may not do: a few parts in 10 000."""
    found, solution = condensed
    left = held(found, "ground")
    compliance = np.linalg.inv(found.stiffness[np.ix_(left, left)])
    extension, output = found.extension[left], found.averages["output"][1, left]
    c11, c12, c22 = (a @ compliance @ b for a, b in ((extension, extension), (output, extension), (output, output)))
    exact = solution.compliance
    assert [c11, c12, c22] == pytest.approx([exact.c11, exact.c12, exact.c22], rel=2e-4)
    assert c11 <= exact.c11 * (1 + 1e-9) and c22 <= exact.c22 * (1 + 1e-9)  # holding a face to shapes stiffens


def test_modes_are_those_of_the_whole_mesh(condensed: tuple[Superelement, Solution]) -> None:
    found, solution = condensed
    left = np.ix_(held(found, "ground"), held(found, "ground"))
    squares = scipy.linalg.eigh(found.stiffness[left], found.mass[left], eigvals_only=True)
    exact = [mode.frequency for mode in solution.modes if not mode.installed][:6]
    assert np.sqrt(squares[:6]) / (2 * np.pi) == pytest.approx(exact, rel=2e-3)


def test_a_free_part_moves_as_a_rigid_body_without_force_and_with_its_mass(
    condensed: tuple[Superelement, Solution], amplifier: Any
) -> None:
    found, solution = condensed
    rigid = found.rigid()
    assert np.abs(found.stiffness @ rigid).max() < 1e-9 * np.abs(found.stiffness).max()
    inertia = rigid.T @ found.mass @ rigid
    mass, (ground, output) = solution.facts["mass"], (found.of(name).port.point[1] for name in ("ground", "output"))
    assert inertia[:3, :3] == pytest.approx(mass * np.eye(3), abs=1e-8 * mass)
    assert inertia[0, 4] == pytest.approx(0.0, abs=1e-9 * mass)  # symmetric about z = 0
    assert abs(inertia[0, 5]) < mass * max(abs(ground), output)  # the centre of mass lies within
    motion = found.averages["output"] @ rigid
    assert motion[:3, :3] == pytest.approx(np.eye(3), abs=1e-9)
    assert motion[3:, 3:] == pytest.approx(np.eye(3), abs=1e-9)
    assert motion[0, 5] == pytest.approx(-output, rel=1e-9)  # a turn about z moves it along -x


def test_a_leaf_bends_and_stretches_as_a_beam_between_its_stubs(hinge: Superelement) -> None:
    """E I / l (1 / (1 - nu^2) if wide) and at most E A / l: the stubs give way, and lengthen the leaf by part of t."""
    end = np.arange(hinge.size)[hinge.rows("end")]
    average = hinge.averages["end"][:, end]
    compliance = average @ np.linalg.solve(hinge.stiffness[np.ix_(end, end)], average.T)
    bending, axial = ALLOY.youngs_modulus * 10e-3 * 0.5e-3**3 / 12 / 3e-3, ALLOY.youngs_modulus * 5e-6 / 3e-3
    plane_strain = bending / (1 - ALLOY.poissons_ratio**2)
    assert 0.9 * bending < 1 / compliance[5, 5] < plane_strain
    assert 0.5 * axial < 1 / compliance[0, 0] < axial
    assert compliance[1, 5] == pytest.approx(compliance[5, 5] * 6.5e-3, rel=1e-3)  # it turns about its middle


def test_another_material_with_the_same_poisson_ratio_scales(hinge: Superelement) -> None:
    other = Material("other", 90e9, 0.35, 3540.0, None)
    anew = coarse(leaf(), other, coarseness=1.5, degree=1, mode_count=0)[0]
    scaled = hinge.with_material(other)
    assert scaled.stiffness == pytest.approx(anew.stiffness, rel=1e-6, abs=1e-9 * np.abs(anew.stiffness).max())
    assert scaled.mass == pytest.approx(anew.mass, rel=1e-6, abs=1e-9 * np.abs(anew.mass).max())
    with pytest.raises(ValueError, match="condense it again"):
        hinge.with_material(Material("third", 90e9, 0.3, 3540.0, None))


# --- parts put together ---------------------------------------------------------------------------------------------


FRAME = Body("frame", (Box((0.0, -1.0, 0.0), (1.0, 0.1, 1.0)),), fixed=True)
TURNED = Placement.of_axes((0.1, 0.2, 0.3), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@pytest.mark.parametrize("placement", [Placement(), TURNED], ids=["as drawn", "turned"])
def test_one_amplifier_on_a_frame_is_what_it_is_alone(
    condensed: tuple[Superelement, Solution], amplifier: Any, placement: Placement
) -> None:
    found, solution = condensed
    face = np.array(found.of("output").port.point)
    top = Body("top", (Box(tuple(placement.outside(face).tolist()), (1e-3, 1e-3, 1e-3)),))
    element = Element("amplifier", amplifier.part(), placement, {"output": "top", "ground": "frame"})
    stage = AssembledStage(Assembly((FRAME, top), (element,), "top", (0.0, 0.0, 0.0)), {"amplifier": found}, 1770.0)
    extension = stage.extension("amplifier")
    answer = np.linalg.solve(stage.stiffness, extension)
    assert extension @ answer == pytest.approx(solution.compliance.c11, rel=1e-3)
    moved = stage.motion("top", top.centre) @ answer
    along = placement.matrix[:, 1]
    assert along @ moved[:3] == pytest.approx(solution.compliance.c12, rel=1e-3)
    assert np.linalg.norm(moved[:3] - along * (along @ moved[:3])) < 1e-6 * abs(solution.compliance.c12)
    held_out = np.linalg.solve(
        stage.with_input_springs(1e15), extension
    )  # an actuator as good as rigid holds the inputs
    assert abs(extension @ held_out) < 1e-6 * solution.compliance.c11


def parallelogram(hinge: Superelement, span: float) -> AssembledStage:
    """Return a table on two arms, each with a hinge at either end, `span` apart along x, and the arms 20 mm along y."""
    bodies, elements, parts = [FRAME], [], {}
    piece, reach = leaf(), 6.5e-3
    for name, y in (("lower", -0.01), ("upper", 0.01)):
        arm = Box((span / 2, y, 0.0), (span - 2 * reach, 6e-3, 10e-3))
        bodies.append(Body(f"{name} arm", (arm,)))
        for index, (x, first, last) in enumerate(((0.0, "frame", f"{name} arm"), (span, f"{name} arm", "table"))):
            place = Placement((x, y, 0.0))
            elements.append(Element(f"{name} {index}", piece, place, {"start": first, "end": last}))
            parts[f"{name} {index}"] = hinge
    bodies.append(Body("table", (Box((span + 2 * reach, 0.0, 0.0), (2 * reach, 0.03, 0.01)),)))
    assembly = Assembly(tuple(bodies), tuple(elements), "table", (span + 2 * reach, 0.0, 0.0))
    return AssembledStage(assembly, parts, 1770.0)


def test_a_parallelogram_has_the_stiffness_of_its_four_hinges(hinge: Superelement) -> None:
    """4 K_r / L^2, K_r that of the very superelement; the rest, stretch and tilt, is 1 % at this length."""
    end = np.arange(hinge.size)[hinge.rows("end")]
    average = hinge.averages["end"][:, end]
    turn = (average @ np.linalg.solve(hinge.stiffness[np.ix_(end, end)], average.T))[5, 5]
    stage = parallelogram(hinge, 0.05)
    compliance = stage.table @ np.linalg.solve(stage.stiffness, stage.table.T)
    assert 1 / compliance[1, 1] == pytest.approx(4 / turn / 0.05**2, rel=0.02)
    assert abs(compliance[0, 1]) < 1e-9 * compliance[1, 1]  # linear: no way along the arms
    frequency = stage.modes(1)[0].frequency
    carried = ALLOY.density * (0.013 * 0.03 * 0.01 + 2 * (0.037 * 60e-6) / 4 + 2 * hinge_volume())
    assert frequency == pytest.approx(np.sqrt(1 / compliance[1, 1] / carried) / (2 * np.pi), rel=0.05)


def hinge_volume() -> float:
    return 2 * 5e-3 * 6e-3 * 10e-3 + 3e-3 * 0.5e-3 * 10e-3


def test_bodies_have_the_inertia_of_their_boxes() -> None:
    """Two cubes of 1 m beside each other are one block of 2 m."""
    pair = Body("pair", (Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), Box((1.0, 0.0, 0.0), (1.0, 1.0, 1.0))))
    block = Body("block", (Box((0.5, 0.0, 0.0), (2.0, 1.0, 1.0)),))
    assert pair.centre == pytest.approx(block.centre)
    assert pair.inertia(10.0) == pytest.approx(block.inertia(10.0))
    assert np.diag(block.inertia(10.0)) == pytest.approx([20, 20, 20, 20 / 6, 20 * 5 / 12, 20 * 5 / 12])


@pytest.mark.parametrize(
    ("change", "field", "remedy"),
    [
        ({"bonds": {"start": "frame"}}, r"elements\.a\.bonds\.end", "name the body"),
        ({"bonds": {"start": "frame", "end": "moon"}}, r"elements\.a\.bonds\.end", "name the body"),
        ({"table": "moon"}, "bodies", "no such body"),
        ({"twice": True}, "elements", "given twice"),
    ],
)
def test_what_hangs_in_the_air_is_named(change: dict[str, Any], field: str, remedy: str) -> None:
    bonds = change.get("bonds", {"start": "frame", "end": "top"})
    element = Element("a", leaf(), Placement(), bonds)
    top = Body("top", (Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),))
    with pytest.raises(InputError, match=remedy) as raised:
        Assembly((FRAME, top), (element,) * (2 if "twice" in change else 1), change.get("table", "top"), (0.0,) * 3)
    import re

    assert re.fullmatch(field, raised.value.field)

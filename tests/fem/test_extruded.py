"""Extruded meshes against the CAD solids they are made from, and the choice between the ways to mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.core.result_cache import Cache
from flexdesign.design import design, study
from flexdesign.design.part import examine
from flexdesign.fem.meshing import domain, methods, resolution_gate, section
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.extruded import Layers, stack_prisms
from flexdesign.fem.meshing.mesh import TaggedMesh, boundary, signed_volumes, tag
from flexdesign.fem.meshing.methods import EXTRUDED_GRADING, Extruded, Grading
from flexdesign.fem.meshing.planar import triangulate
from flexdesign.workflows.validation import validate
from studies.verification.solids import Array
from tests.fem.solids import Bracket

CHORD = 1e-8  # of the CAD tessellation that areas are compared with [m]
COARSE = 1.8


def amplifier(radius: str, *, symmetric: bool = True) -> tuple[Any, Domain, Extruded]:
    part = design.read(design.find("bridge_amplifier"), [f'dimensions.fillet_radius="{radius}"']).part()
    body = domain.of_part(part, symmetric=symmetric, chord=CHORD)
    return part, body, Extruded(Grading(body, part.linkage().members, *EXTRUDED_GRADING, None))


@pytest.fixture(scope="module", params=["0 mm", "0.2 mm"], ids=["sharp", "rounded"])
def found(request: pytest.FixtureRequest) -> tuple[Any, Domain, TaggedMesh]:
    part, body, method = amplifier(request.param)
    return part, body, method.mesh(COARSE)


def areas(points: Array, triangles: Array) -> Array:
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


def test_fills_the_solid(found: tuple[Any, Domain, TaggedMesh]) -> None:
    _, body, mesh = found
    assert mesh.volume == pytest.approx(body.volume, rel=1e-7)  # chords on fillets enclose their area
    assert signed_volumes(mesh.points, mesh.tets).min() > 0
    assert np.array_equal(boundary(mesh.tets), mesh.facets)
    assert areas(mesh.points, mesh.facets).sum() == pytest.approx(
        sum(areas(face.points, face.triangles).sum() for face in body.faces), rel=1e-3
    )  # a face between two tetrahedra that do not fit together would count as boundary, twice


def test_facets_know_their_cad_face(found: tuple[Any, Domain, TaggedMesh]) -> None:
    """Those on planes lie in them; those on fillets within the chord error, so that they enclose the area."""
    part, body, mesh = found
    chord = min(methods.CHORD * COARSE**2, methods.LARGEST_CHORD) * part.hinge_thickness
    for index, face in enumerate(body.faces):
        facets = mesh.on_face(index)
        assert areas(mesh.points, facets).sum() == pytest.approx(areas(face.points, face.triangles).sum(), rel=5e-3)
        corners = mesh.points[facets.ravel()]
        if face.normal is not None:
            assert np.abs(corners @ face.normal - face.offset).max() < 1e-12
        elif face.axis is not None:
            away = (corners - face.axis[0])[:, :2]
            assert np.abs(np.linalg.norm(away, axis=1) - face.radius).max() < chord


def test_tags_are_those_of_the_general_tagger(found: tuple[Any, Domain, TaggedMesh]) -> None:
    _, body, mesh = found
    nearest = tag(mesh.points, mesh.tets, body, body.surface())
    assert np.array_equal(nearest.facets, mesh.facets)
    assert np.array_equal(nearest.faces, mesh.faces)


def test_hinges_are_as_thick_as_drawn(found: tuple[Any, Domain, TaggedMesh]) -> None:
    part, body, mesh = found
    checks = resolution_gate.check(mesh, body, part.linkage().of_kind("hinge"))
    assert len(checks) == 4
    rounding = 1e-9 if part.fillet_radius == 0 else 2e-3
    assert max(abs(check.bending) for check in checks) < rounding


def test_whole_solid_has_two_free_ends() -> None:
    _, body, method = amplifier("0 mm", symmetric=False)
    heights = np.unique(method.mesh(COARSE).points[:, 2])
    assert heights == pytest.approx(-heights[::-1], abs=1e-9 * body.volume ** (1 / 3))
    assert np.diff(heights)[0] < np.diff(heights).max()


def test_layers_crowd_towards_free_ends_alone() -> None:
    layers = Layers(at_ends=0.5e-3, growth=0.5, largest=3e-3)
    thick = np.diff(layers.heights(0.0, 10e-3, (False, True)))
    assert np.all(np.diff(thick) <= 1e-15)
    assert thick[-1] <= 0.6e-3
    assert thick.sum() == pytest.approx(10e-3, rel=1e-12)
    even = np.diff(layers.heights(0.0, 10e-3, (False, False)))
    assert even == pytest.approx(2.5e-3, rel=1e-9)  # the fewest that are no thicker than 3 mm


def test_reentrant_corners() -> None:
    bracket: Any = Bracket()
    body = domain.of_part(bracket, chord=CHORD)  # its half x > 0
    assert body.section is not None
    assert body.section.reentrant_corners() == pytest.approx(np.array([[4e-3, 9e-3]]), abs=1e-12)
    rounded = amplifier("0.2 mm")[1].section
    assert rounded is not None
    assert len(rounded.reentrant_corners()) == 4  # where rods meet the input block; hinges run out into fillets


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_any_axis(axis: Any) -> None:
    import cadquery as cq

    plane = {"x": "YZ", "y": "ZX", "z": "XY"}[axis]
    shape = cq.Workplane(plane).polyline([(0, 0), (6, 0), (6, 2), (2, 2), (2, 5), (0, 5)]).close().extrude(4)
    solid = shape.solids().val()
    read = section.of_solid(solid, axis)
    assert (read.low, read.high) == pytest.approx((0.0, 4e-3), abs=1e-12)
    plan = triangulate(read.outline, lambda points: np.full(len(points), 1e-3), 1e-6)
    mesh = stack_prisms(plan, read, np.array([0.0, 1e-3, 4e-3]))
    assert mesh.volume == pytest.approx(solid.Volume() * 1e-9, rel=1e-9)
    for index, face in enumerate(solid.Faces()):
        assert areas(mesh.points, mesh.on_face(index)).sum() == pytest.approx(face.Area() * 1e-6, rel=1e-9)


@pytest.mark.parametrize("spoil", ["taper", "cross hole", "step", "slanted end"])
def test_what_is_no_extrusion_is_refused(spoil: str) -> None:
    import cadquery as cq

    block = cq.Workplane("XY").box(6, 5, 4)
    shape = {
        "taper": lambda: cq.Workplane("XY").rect(6, 5).extrude(4, taper=5),
        "cross hole": lambda: block.faces(">X").workplane().hole(1.0),
        "step": lambda: block.faces(">Z").workplane().rect(2, 2).extrude(1),
        "slanted end": lambda: block.faces(">Z").edges(">X").chamfer(3.9, 5.9),
    }[spoil]()
    with pytest.raises(InputError, match="no extrusion along z"):
        section.of_solid(shape.solids().val(), "z")


# --- the choice -------------------------------------------------------------------------------------------------


QUICK = ("mesh.levels=2", "mesh.at_root=0.5", "mesh.growth=1.5", "modes.count=1")


def test_prismatic_parts_are_extruded(tmp_path: Path) -> None:
    told: list[str] = []
    answer = validate(study.read("bridge_amplifier", QUICK), Cache(tmp_path), told.append)
    assert isinstance(answer.method, Extruded)
    assert any("extruded" in text for text in told)
    sizes = [level.size for level in answer.levels]
    assert sizes[0] / sizes[1] == pytest.approx(1.35**2, rel=1e-12)
    again = validate(study.read("bridge_amplifier", QUICK), Cache(tmp_path))
    assert all(level.cached for level in again.levels)


def test_extruding_what_is_not_prismatic_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = study.read("bridge_amplifier", [*QUICK, "mesh.method=extruded"])
    monkeypatch.setattr(asked.design.part_class, "prismatic", lambda self: None)
    with pytest.raises(InputError, match=r"mesh\.method"):
        validate(asked, Cache(tmp_path))


def test_an_axis_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    part = design.read(design.find("bridge_amplifier")).part()
    monkeypatch.setattr(type(part), "prismatic", lambda self: "w")
    with pytest.raises(InputError, match="must be x, y or z"):
        examine(part)


def test_methods_ask_different_questions() -> None:
    _, _, method = amplifier("0 mm")
    wild = methods.Unstructured(method.grading, 0.05)
    assert wild.question(1.0)[0] != method.question(1.0)[0]
    assert method.question(1.0)[0] == method.question(2.0)[0]
    assert method.finest_edge(2.0) == pytest.approx(4 * method.finest_edge(1.0), rel=1e-12)
    assert wild.finest_edge(2.0) == pytest.approx(2 * wild.finest_edge(1.0), rel=1e-12)

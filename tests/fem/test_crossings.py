"""Bores across the layers of a solid that is otherwise an extrusion: it is meshed in layers, and they are cut out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cadquery as cq
import numpy as np
import pytest

from flexdesign.core.result_cache import Cache
from flexdesign.design import study as studies
from flexdesign.fem import analysis, convergence, mesh_refinement
from flexdesign.fem.meshing import domain, local_extrusion, methods, thin_regions
from flexdesign.fem.meshing.local_extrusion import LocalExtrusion
from flexdesign.fem.meshing.local_thickness import LocalThickness
from flexdesign.fem.meshing.mesh import TaggedMesh
from flexdesign.fem.quantities.port_stiffness import port_stiffness
from tests.fem.solids import PORTS

DESIGN = PORTS.format(interface="traction")


def hinge(bored: bool = True) -> cq.Workplane:
    """Two blocks joined by a leaf, drawn out along z; the right one has a bolt hole and is drilled from y = 5 mm."""
    solid = cq.Workplane().pushPoints([(-6, 0), (6, 0)]).box(8, 10, 6).union(cq.Workplane().box(6, 0.5, 6))
    solid = solid.cut(cq.Workplane().center(5, -2.5).circle(1.0).extrude(6, both=True))
    return solid.cut(bore(1.25, (7, 5, 0.5), 4)) if bored else solid


def bore(radius: float, opening: tuple[float, float, float], depth: float) -> cq.Workplane:
    """What a drill takes away that enters along -y, all lengths in mm."""
    return cq.Workplane("XZ", origin=opening).circle(radius).extrude(depth)


def study_of(solid: cq.Workplane, folder: Path, design: str = DESIGN) -> studies.Study:
    cq.exporters.export(solid, str(folder / "part.step"))
    (folder / "part.toml").write_text(design)
    return studies.read(folder / "part.toml", ())


def method_of(study: studies.Study, *, layered: bool = True) -> tuple[domain.Domain, LocalThickness]:
    part = study.design.part()
    body = domain.of_part(part, chord=domain.chord(part))
    body = body if layered else replace(body, extrusion=None, crossings=None)
    method = mesh_refinement.method_of(study, part, body)
    assert isinstance(method, LocalThickness)
    return body, method


def area(mesh: TaggedMesh, *faces: int) -> float:
    a, b, c = np.moveaxis(mesh.points[mesh.on_face(*faces)], 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def stiffness(study: studies.Study, body: domain.Domain, mesh: TaggedMesh) -> dict[str, float]:
    solution = analysis.solve(study.design.part(), study.design.material, body, mesh)
    return {each.key: each.value for each in port_stiffness(solution.compliance)}


def test_a_part_drilled_from_the_side_is_meshed_in_layers(tmp_path: Path) -> None:
    body, method = method_of(study_of(hinge(), tmp_path))
    assert isinstance(method, LocalExtrusion)
    assert body.crossings is not None
    mesh = method.mesh(1.35)
    method.check(mesh)
    missing = 8 * 10 * 6 * 2 + 6 * 0.5 * 6 - np.pi * 6 - 1e9 * body.volume  # mm^3: exact, of the bore
    assert mesh.volume == pytest.approx(body.volume, abs=0.03 * missing * 1e-9)  # chords leave that of a bore
    for index in set(body.ports.values()):
        face = body.faces[index]
        there = mesh.points[mesh.on_face(index)].reshape(-1, 3)
        assert face.normal is not None
        assert np.abs(there @ face.normal - face.offset).max() < 1e-12
        assert area(mesh, index) == pytest.approx(60e-6, rel=1e-9)
    cylinder = next(i for i in body.crossings.faces if body.faces[i].axis is not None)
    origin, axis = body.faces[cylinder].axis  # type: ignore[misc]
    radial = mesh.points[mesh.on_face(cylinder)].reshape(-1, 3) - origin
    away = np.linalg.norm(radial - np.outer(radial @ axis, axis), axis=1)
    assert np.median(away) == pytest.approx(1.25e-3, rel=0.05)


def test_counterbores_and_blind_holes_along_the_layers_are_cut_out(tmp_path: Path) -> None:
    solid = hinge(bored=False).faces(">Z").workplane(origin=(8, 2, 3)).cboreHole(1.6, 3.0, 1.5)
    solid = solid.cut(cq.Workplane("XY", origin=(-7, 0, 3)).circle(1.0).extrude(-4))
    body, method = method_of(study_of(solid, tmp_path))
    assert isinstance(method, LocalExtrusion)
    missing = np.pi * (0.8**2 * 6 + (1.5**2 - 0.8**2) * 1.5 + 4)
    assert method.mesh(1.0).volume == pytest.approx(body.volume, abs=0.05 * missing * 1e-9)


@pytest.mark.parametrize(
    ("milled", "missing"),
    [
        (cq.Workplane().box(3, 20, 2).translate((11, 0, 2)), 3 * 20 * 2),  # a slot from side to side
        (cq.Workplane().box(4, 8, 1.5).translate((11, 1, 2.25)), 4 * 8 * 1.5),  # a pocket
        (cq.Workplane().box(5, 20, 1).translate((16.5, 0, 2.5)), 5 * 20 * 1),  # a step down to the end
        (cq.Workplane("XZ", origin=(11, 10, 3)).circle(2).extrude(20), np.pi * 2 * 20),  # a bore open to the face
    ],
    ids=["slot", "pocket", "step", "groove"],
)
def test_what_is_milled_into_a_face_is_cut_out(milled: cq.Workplane, missing: float, tmp_path: Path) -> None:
    blocks = cq.Workplane().pushPoints([(-11, 0), (11, 0)]).box(16, 20, 6).union(cq.Workplane().box(6, 0.5, 6))
    blocks = blocks.cut(cq.Workplane().center(-12, 4).circle(2).extrude(12, both=True))
    body, method = method_of(study_of(blocks.cut(milled), tmp_path))
    assert isinstance(method, LocalExtrusion)
    assert 1e-9 * (16 * 20 * 6 * 2 + 6 * 0.5 * 6 - np.pi * 4 * 6 - missing) == pytest.approx(body.volume, rel=1e-9)
    mesh = method.mesh(1.0)
    method.check(mesh)
    assert mesh.volume == pytest.approx(body.volume, abs=0.03 * missing * 1e-9)


@pytest.mark.parametrize(
    "milled",
    [
        cq.Workplane().box(3, 20, 3).translate((11, 0, 1.5)).union(cq.Workplane().box(7, 20, 1).translate((11, 0, 0))),
        cq.Workplane().box(0.6, 20, 4).translate((11, 0, 1)),
        cq.Workplane().box(4, 20, 2).translate((11, 0, 0)),
    ],
    ids=["T slot", "slit", "channel"],
)
def test_what_elements_would_bridge_stays(milled: cq.Workplane, tmp_path: Path) -> None:
    blocks = cq.Workplane().pushPoints([(-11, 0), (11, 0)]).box(16, 20, 6).union(cq.Workplane().box(6, 0.5, 6))
    body, method = method_of(study_of(blocks.cut(milled), tmp_path))
    assert body.crossings is None and not isinstance(method, LocalExtrusion)


def test_a_slot_softens_a_beam_as_on_a_mesh_of_netgen(tmp_path: Path) -> None:
    """From one side, and half as deep as the beam."""
    slot = cq.Workplane().box(5, 10, 4).translate((1, 0, 2))
    study = study_of(cq.Workplane().box(24, 10, 8).cut(slot), tmp_path)
    body, layers = method_of(study)
    assert isinstance(layers, LocalExtrusion)
    found = stiffness(study, body, layers.mesh(1.0))
    _, netgen = method_of(study, layered=False)
    assert found == pytest.approx(stiffness(study, body, netgen.mesh(0.45)), rel=5e-3)
    whole = study_of(cq.Workplane().box(24, 10, 8), tmp_path)
    without, plain = method_of(whole)
    before = stiffness(whole, without, plain.mesh(1.35))
    assert 0.3 < found["k_z_other_motions_free"] / before["k_z_other_motions_free"] < 0.8


#: Port stiffness of the bored beam below [N/m, N m/rad], other motions held and free, on 32 544 tetrahedra that Netgen
#: makes of its CAD faces (coarseness 0.65): the change from 25 928 is 0.1 % at most.
BORED = {
    "k_x_other_motions_held": 1.60571e8,
    "k_y_other_motions_held": 2.41831e7,
    "k_z_other_motions_held": 1.47939e7,
    "k_rx_other_motions_held": 746.251,
    "k_ry_other_motions_held": 3210.06,
    "k_rz_other_motions_held": 4459.9,
    "k_x_other_motions_free": 1.58768e8,
    "k_y_other_motions_free": 7.45966e6,
    "k_z_other_motions_free": 5.41064e6,
    "k_rx_other_motions_free": 744.94,
    "k_ry_other_motions_free": 1167.18,
    "k_rz_other_motions_free": 1376.44,
}


def bored_beam() -> cq.Workplane:
    """A beam with a bore that makes it 10 to 40 % softer."""
    return cq.Workplane().box(24, 10, 8).cut(bore(2.5, (2, 5, 0.5), 10))


def test_a_wide_bore_across_a_beam_softens_it_as_on_a_mesh_of_netgen(tmp_path: Path) -> None:
    """Layers change by 0.5 % at most from a mesh 1.35 times as coarse."""
    study = study_of(bored_beam(), tmp_path)
    body, method = method_of(study)
    assert isinstance(method, LocalExtrusion)
    assert stiffness(study, body, method.mesh(1.0)) == pytest.approx(BORED, rel=5e-3)


@pytest.mark.slow
def test_the_reference_of_the_bored_beam_is_that_of_netgen(tmp_path: Path) -> None:
    study = study_of(bored_beam(), tmp_path)
    body, netgen = method_of(study, layered=False)
    assert stiffness(study, body, netgen.mesh(0.65)) == pytest.approx(BORED, rel=2e-3)


def test_walls_of_bores_are_no_hinges_and_no_necks() -> None:
    found = thin_regions.find(hinge().val())
    (leaf,) = found.hinges
    assert leaf.thickness == pytest.approx(0.5e-3, rel=1e-6)
    assert not np.isfinite(
        found.curved[found.thickness < 2.5e-3]
    ).any()  # 1.75 mm from bore to end, 1.5 mm from the hole


def test_walls_of_wide_bores_bend_and_are_hinges() -> None:
    """A binocular load cell: two wide bores leave four thin walls."""
    cell = cq.Workplane().box(60, 12, 12)
    for x in (-12, 12):
        cell = cell.cut(cq.Workplane().center(x, 0).circle(5.3).extrude(12, both=True))
    assert len(thin_regions.find(cell.val()).hinges) == 4


@pytest.mark.parametrize("where", ["leaf", "port"])
def test_what_reaches_a_hinge_or_holds_a_port_stays(where: str, tmp_path: Path) -> None:
    solid, design = hinge(), DESIGN
    if where == "leaf":
        solid = solid.cut(cq.Workplane("XZ", origin=(0, 1, 0)).circle(0.5).extrude(2))
    else:
        design = DESIGN.replace('plane = "x = max"', 'point = ["7 mm", "1 mm", "0.5 mm"]\nnormal = [0, 1, 0]')
    body, method = method_of(study_of(solid, tmp_path, design))
    assert body.crossings is None
    assert not isinstance(method, LocalExtrusion)


def test_rays_are_no_more_than_most_where_all_edges_are_rounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thin_regions, "MOST", 3000)
    rays: list[int] = []
    cast = thin_regions.Rays.first

    def counted(self: thin_regions.Rays, start: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        rays.append(len(start))
        return cast(self, start, way)

    monkeypatch.setattr(thin_regions.Rays, "first", counted)
    found = thin_regions.find(hinge(bored=False).edges().fillet(0.02).val())
    assert max(rays) <= 3000
    assert found.hinges[0].thickness == pytest.approx(0.5e-3, rel=1e-3)


def slotted() -> cq.Workplane:
    """The hinge between larger blocks, with a slot from side to side and a step at its end."""
    blocks = cq.Workplane().pushPoints([(-8, 0), (8, 0)]).box(10, 12, 6).union(cq.Workplane().box(6, 0.5, 6))
    blocks = blocks.cut(cq.Workplane().box(3, 12, 2).translate((8, 0, 2)))
    return blocks.cut(cq.Workplane().box(3, 5, 3).translate((-11.5, 3.5, 1.5)))


@pytest.mark.slow
@pytest.mark.parametrize("solid", [hinge(), slotted()], ids=["drilled", "milled"])
def test_the_error_bars_of_a_hinge_hold_on_finer_meshes(
    solid: cq.Workplane, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The reference has eight layers for each free end instead of five, six across the bore, and shorter edges."""
    study = study_of(solid, tmp_path)
    body, method = method_of(study)
    assert isinstance(method, LocalExtrusion) and body.crossings is not None
    part, cache = study.design.part(), Cache(tmp_path / "cache")
    levels = mesh_refinement.refine(study, part, body, method, cache, lambda _: None)
    found = mesh_refinement.gather_quantities(study, levels, method.scatter)
    monkeypatch.setattr(local_extrusion, "ACROSS_BORE", 1 / 6)
    monkeypatch.setattr(methods, "LEAST_LAYERS_OF_NECKS", 8.0)
    meshes = [(c, method.mesh(c)) for c in (1.35, 1.0, 0.8)]
    sizes = [method.size(mesh, c) for c, mesh in meshes]
    values = [stiffness(study, body, mesh) for _, mesh in meshes]
    for one in found:
        if one.key.startswith("k_"):
            right = convergence.extrapolate([each[one.key] for each in values], sizes, mesh_noise=method.scatter)
            assert one.half_width
            assert one.half_width < 0.01 * one.value
            assert right.error < one.half_width
            assert abs(one.value - right.value) < one.half_width, one.key

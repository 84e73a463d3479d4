"""Fillets of parts from STEP files: found where drawn, meshed as finely as sharp edges, and named where unresolved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cadquery as cq
import numpy as np
import pytest

from flexdesign.core.result_cache import Cache
from flexdesign.design import study as studies
from flexdesign.fem import mesh_refinement, quantities
from flexdesign.fem.meshing import domain, thin_regions
from flexdesign.fem.quantities.port_stiffness import port_stiffness

WIDTH = 3.0
DESIGN = """format = 1
part = "guide.step"
material = "Al 7075-T6"

[ports.ground]
plane = "y = min"

[ports.output]
plane = "y = max"
interface = "rigid"
"""
#: Stiffness of a guide with fillets of 0.05 mm against x, other motions free [N/m]: that of a mesh of 594 000 unknowns,
#: with edges at fillets 0.58 times as long as on the finest by default. What is left is
#: less than 0.2 %, a quarter of the error bar that is tested.
REFERENCE = 6521.0


def guide(radius: float) -> cq.Workplane:
    """Two leaves of 0.5 x 20 x 3 mm between two blocks [mm], with fillets at their eight roots."""
    blocks = cq.Workplane().pushPoints([(0, -14), (0, 14)]).box(40, 8, WIDTH)
    solid = blocks.union(cq.Workplane().pushPoints([(-10, 0), (10, 0)]).box(0.5, 20, WIDTH))
    if not radius:
        return solid
    roots = [
        edge
        for edge in solid.edges("|Z").vals()
        if abs(abs(edge.Center().y) - 10) < 1e-6 and abs(abs(edge.Center().x) - 10) < 1
    ]
    assert len(roots) == 8
    return solid.newObject(roots).fillet(radius)


def study_of(solid: cq.Workplane, folder: Path, *changes: str) -> studies.Study:
    cq.exporters.export(solid, str(folder / "guide.step"))
    (folder / "guide.toml").write_text(DESIGN)
    return studies.read(folder / "guide.toml", changes)


def method_of(study: studies.Study, *, extruded: bool) -> tuple[domain.Domain, Any]:
    part = study.design.part()
    body = domain.of_part(part, chord=domain.chord(part))
    body = body if extruded else replace(body, extrusion=None)
    return body, mesh_refinement.method_of(study, part, body)


@pytest.mark.parametrize("radius", [0.02, 0.25])
def test_fillets_are_found_with_their_radius(radius: float) -> None:
    roots = thin_regions.find(guide(radius).val()).roots_of_hinges
    assert not roots.is_sharp
    assert roots.radii == pytest.approx(1e-3 * radius, rel=0.01)
    assert roots.thickness.min() == pytest.approx(0.5e-3, rel=1e-3)
    assert roots.thickness.max() < 0.75e-3  # where the fillet thickens the leaf; not that of the blocks
    assert np.abs(roots.ways[:, 2]) == pytest.approx(1.0)
    corners = np.array([[x, y] for x in (-10.25, -9.75, 9.75, 10.25) for y in (-10, 10)]) * 1e-3
    away = np.linalg.norm(roots.places[:, None, :2] - corners, axis=2)
    assert away.min(axis=1).max() < 1e-3 * radius  # and none along the rest of the solid
    assert set(away.argmin(axis=1)) == set(range(8))


def test_a_rounding_outside_and_a_bore_are_no_fillets() -> None:
    solid = guide(0).edges("|Z and (<X or >X)").fillet(0.1).faces("<Z").workplane().pushPoints([(0, 14)]).hole(2)
    found = thin_regions.find(solid.val()).roots
    assert len(found.radii) and found.is_sharp
    assert np.all(found.radii == 0)


def test_where_fillets_meet_none_is_smaller_than_they_are() -> None:
    """In the corners single triangles seemed to follow radii between 0.06 and 1.9 mm, and a report named such a one."""
    corner = cq.Workplane().box(20, 20, 4, centered=(True, True, False))
    for wide, long, at in ((20, 4, (0, 8, 0)), (4, 20, (8, 0, 0))):
        corner = corner.union(cq.Workplane().box(wide, long, 16, centered=(True, True, False)).translate(at))
    inner = cq.selectors.BoxSelector((-10.1, -10.1, 3.9), (6.1, 6.1, 16.1))
    radii = thin_regions.find(corner.edges(inner).fillet(0.5).val()).roots.radii
    assert radii.min() == pytest.approx(0.5e-3, rel=2e-3)
    assert radii.max() < 1e-3


@pytest.mark.parametrize("extruded, resolved", [(True, 0.45), (False, 2 / 3)])
def test_edges_asked_for_at_fillets(tmp_path: Path, extruded: bool, resolved: float) -> None:
    """Those of a sharp edge at a fillet that is as good as sharp, and shorter than the radius at one to be resolved."""
    finest = {}
    for radius in (0.0, 0.005, 0.1):
        _, method = method_of(study_of(guide(radius), tmp_path), extruded=extruded)
        finest[radius] = method.finest_edge(1.0)
    assert finest[0.005] == pytest.approx(finest[0.0], rel=1e-3)
    assert finest[0.1] == pytest.approx(1e-4 * resolved, rel=0.01)


@pytest.mark.slow
def test_the_error_bar_of_a_guide_with_small_fillets_holds(tmp_path: Path) -> None:
    study = study_of(guide(0.05), tmp_path, "mesh.accuracy=2 %")
    part, (body, method) = study.design.part(), method_of(study, extruded=True)
    levels = mesh_refinement.refine(study, part, body, method, Cache(tmp_path / "cache"), lambda _: None)
    found = {q.key: q for q in mesh_refinement.gather_quantities(study, levels, method.scatter)}
    stiffness = found["k_x_other_motions_free"]
    assert abs(stiffness.value - REFERENCE) < (stiffness.half_width or 0.0) < 0.012 * REFERENCE
    assert levels[-1].solution.peaks[0] == pytest.approx(81.9e6, rel=0.1)  # of the mesh of the reference
    assert not quantities.unresolved_fillet(levels[-1].solution)


def test_a_fillet_that_the_mesh_does_not_follow_is_named(tmp_path: Path) -> None:
    study = study_of(guide(0.05), tmp_path)
    part, (body, method) = study.design.part(), method_of(study, extruded=False)
    level = mesh_refinement._level(
        study, part, body, method, 3.0, Cache(tmp_path / "cache"), lambda _: None, all_classes=True
    )
    said = quantities.unresolved_fillet(level.solution)
    assert said.startswith("Peak stress is not resolved at a fillet of radius 0.050 mm next to a thin region")
    assert said.endswith("reduce mesh.at_root.")
    stiffness = {q.key: q.value for q in port_stiffness(level.solution.compliance)}["k_x_other_motions_free"]
    assert stiffness == pytest.approx(REFERENCE, rel=0.04)  # coarse, and a chamfer in place of the fillet


def test_small_roundings_outside_cost_no_elements(tmp_path: Path) -> None:
    """Netgen put 1.5 edges on each radius: as many on a rounding of 0.05 mm as on all the rest, and more."""
    counts = []
    for radius in (0.0, 0.05):
        solid = guide(0)
        solid = solid.edges("|Z and (<X or >X)").fillet(radius) if radius else solid
        _, method = method_of(study_of(solid, tmp_path), extruded=False)
        mesh = method.mesh(3.0)
        assert mesh.mesher == "Netgen"
        counts.append(len(mesh.tets))
    assert counts[1] < 2.5 * counts[0]

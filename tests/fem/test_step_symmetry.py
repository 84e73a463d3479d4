"""Solids from STEP files that are their own mirror images: planes are found, and halves answer as the whole does."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cadquery as cq
import numpy as np
import pytest

from flexdesign.core.model import by_key
from flexdesign.core.result_cache import Cache
from flexdesign.design import faces, mirror, study
from flexdesign.design.part import in_file
from flexdesign.fem import analysis, mesh_refinement
from flexdesign.fem.meshing import domain
from flexdesign.fem.meshing.domain import Domain
from studies.error_bars.designs import PARTS
from tests.fem.solids import PORTS

#: A plate with a notch from either side at x = 0, mirrored in x, y and z.
NOTCHES = cq.Workplane("XY", origin=(0, 0, -2)).pushPoints([(0, 3), (0, -3)]).circle(2.7).extrude(4)
NOTCHED_PLATE = cq.Workplane().box(16, 6, 4).cut(NOTCHES)
BRIDGE = """format = 1
part = "part.step"
material = "Al 7075-T6"

[ports.input_left]
point = ["-29 mm", "0 mm", "0 mm"]
normal = [1, 0, 0]

[ports.input_right]
point = ["29 mm", "0 mm", "0 mm"]
normal = [-1, 0, 0]

[ports.output]
plane = "y = max"

[ports.ground]
plane = "y = min"
"""


def study_of(folder: Path, solid: Any, text: str = PORTS.format(interface="traction"), *changes: str) -> study.Study:
    cq.exporters.export(cq.Workplane(solid), str(folder / "part.step"))
    (folder / "part.toml").write_text(text, encoding="utf-8")
    return study.read(folder / "part.toml", changes)


def axes(asked: study.Study) -> Mapping[str, Mapping[str, str]]:
    return {plane.axis: plane.swaps for plane in asked.design.part().symmetry()}


def test_planes_are_those_that_leave_solid_and_ports_in_place(tmp_path: Path) -> None:
    """The plate's ends are one ground and one output, which no mirror exchanges."""
    assert axes(study_of(tmp_path, NOTCHED_PLATE.val())) == {"y": {}, "z": {}}


def test_inputs_are_exchanged_and_the_right_one_is_kept(tmp_path: Path) -> None:
    bridge = study.read(PARTS / "notched_bridge.toml").design.part().solid()
    assert axes(study_of(tmp_path, bridge, BRIDGE)) == {"x": {"input_left": "input_right"}, "z": {}}


@pytest.mark.parametrize(
    ("spoil", "left"),
    [
        (lambda plate: plate.cut(cq.Workplane().box(0.4, 9, 0.4).translate((6, 0, 1.8))), {"y"}),
        (lambda plate: plate.rotate((0, 0, 0), (1, 0, 0), 10), set()),
        (lambda plate: plate.cut(cq.Workplane().pushPoints([(6, 2), (6, -2)]).circle(0.3).extrude(9)), {"y"}),
    ],
    ids=["a groove", "askew", "blind holes"],
)
def test_what_is_no_mirror_image_is_none(spoil: Any, left: set[str], tmp_path: Path) -> None:
    assert set(axes(study_of(tmp_path, spoil(NOTCHED_PLATE).val()))) == left


def test_a_solid_beside_the_origin_is_moved_to_where_its_planes_pass_through_it(tmp_path: Path) -> None:
    """Ports, which are sought where the file has them, and faces with it; nothing moves where there is no plane."""
    plain = study_of(tmp_path, NOTCHED_PLATE.val()).design.part()
    near = 'point = ["28 mm", "5.1 mm", "-7 mm"]\nnormal = [1, 0, 0]'
    text = PORTS.format(interface="traction").replace('plane = "x = max"', near)
    (away := tmp_path / "away").mkdir()
    part = study_of(away, NOTCHED_PLATE.translate((20, 5.1, -7)).val(), text).design.part()
    assert {plane.axis: plane.swaps for plane in part.symmetry()} == {"y": {}, "z": {}}
    for here, there in zip(plain.ports(), part.ports(), strict=True):
        assert np.array(there.point) - here.point == pytest.approx([20e-3, 0.0, 0.0], abs=1e-12)
        assert there.point[1:] == (0.0, 0.0) and there.faces == here.faces
    assert in_file(part, part.ports()[1].point) == pytest.approx((28e-3, 5.1e-3, -7e-3), abs=1e-12)
    assert in_file(plain, plain.ports()[1].point) == plain.ports()[1].point
    box = part.solid().BoundingBox()
    assert (box.xmin, box.ymin, box.zmin) == pytest.approx((12, -3, -2), abs=1e-6)
    assert part.notes()[-1].startswith("The solid was moved by -5.1 mm along y and +7 mm along z to be")
    assert "moved" not in "".join(plain.notes())


def test_it_has_the_port_stiffness_that_it_has_at_the_origin(tmp_path: Path) -> None:
    found = []
    for name, place in (("here", (0, 0, 0)), ("away", (20, 5.1, -7))):
        (folder := tmp_path / name).mkdir()
        asked = study_of(folder, NOTCHED_PLATE.translate(place).val())
        part = asked.design.part()
        found.append(solved(asked, domain.of_part(part, chord=domain.chord(part)), 1.35))
    assert found[0].facts["unknowns"] == pytest.approx(found[1].facts["unknowns"], rel=0.05)
    assert np.diag(found[0].compliance.matrix) == pytest.approx(np.diag(found[1].compliance.matrix), rel=0.005)


def test_a_rigid_port_and_one_beside_the_plane_leave_no_plane(tmp_path: Path) -> None:
    assert axes(study_of(tmp_path, NOTCHED_PLATE.val(), PORTS.format(interface="rigid"))) == {}
    beside = PORTS.format(interface="traction") + 'about = ["8 mm", "0 mm", "1 mm"]\n'
    assert set(axes(study_of(tmp_path, NOTCHED_PLATE.val(), beside))) == {"y"}


def test_a_solid_of_equal_balance_and_other_edges_is_no_mirror_image() -> None:
    """Holes of one size at (3, 1), (-3, -1) and (1, -3), (-1, 3): mass and products of inertia are as if mirrored."""
    plate = cq.Workplane().box(16, 16, 4).pushPoints([(3, 1), (-3, -1), (1, -3), (-1, 3)]).circle(0.5).cutThruAll()
    assert mirror.is_balanced(plate.val(), 0)
    planes = mirror.planes_of(plate.val(), faces.of_solid(plate.val(), {}, {}), ())
    assert [plane.axis for plane in planes] == ["z"]


def solved(asked: study.Study, body: Domain, coarseness: float) -> analysis.Solution:
    part = asked.design.part()
    method = mesh_refinement.method_of(asked, part, body)
    mesh, _ = mesh_refinement.make_mesh(method, body, coarseness, [], Cache(asked.design.file.parent), lambda _: None)
    return analysis.solve(part, asked.design.material, body, mesh, mode_count=2)


def test_a_quarter_has_the_port_stiffness_modes_and_peaks_of_the_whole(tmp_path: Path) -> None:
    """Two meshes of one fineness differ by what they leave open, less than a percent; without a class by far more."""
    asked = study_of(tmp_path, NOTCHED_PLATE.val())
    part = asked.design.part()
    quarter, whole = (
        domain.of_part(part, symmetric=symmetric, chord=domain.chord(part)) for symmetric in (True, False)
    )
    assert quarter.copies == 4 and whole.copies == 1
    assert quarter.volume == pytest.approx(whole.volume / 4, rel=1e-9)
    assert quarter.thin is not None and whole.thin is not None
    assert quarter.thin.hinges[0].thickness == whole.thin.hinges[0].thickness
    found, known = solved(asked, quarter, 1.35), solved(asked, whole, 1.35)
    assert found.whole and known.whole and found.facts["unknowns"] < 0.5 * known.facts["unknowns"]
    assert np.diag(found.compliance.matrix) == pytest.approx(np.diag(known.compliance.matrix), rel=0.01)
    assert found.peaks == pytest.approx(known.peaks, rel=0.1)
    assert found.facts["mass"] == pytest.approx(known.facts["mass"], rel=2e-3)
    lowest = [sorted(mode.frequency for mode in each.modes)[:2] for each in (found, known)]
    assert lowest[0] == pytest.approx(lowest[1], rel=0.02)


@pytest.mark.slow
def test_a_bridge_with_notches_answers_through_its_step_file_as_its_class_does(tmp_path: Path) -> None:
    """Meshes that are graded by thin places that are found, beside those that follow declared profiles."""
    known = study.read(PARTS / "notched_bridge.toml", ['mesh.accuracy="1 %"'])
    read = study_of(tmp_path, known.design.part().solid(), BRIDGE)
    answers = []
    for asked in (known, read):
        part = asked.design.part()
        body = domain.of_part(part, material=asked.design.material, chord=domain.chord(part))
        method = mesh_refinement.method_of(asked, part, body)
        levels = mesh_refinement.refine(
            asked, part, body, method, Cache(tmp_path / "cache"), lambda _: None, all_classes=False
        )
        answers.append(by_key(mesh_refinement.gather_quantities(asked, levels, method.scatter)))
    for key in ("K_in_output_free", "lambda_output_free", "K_out_input_free", "K_out_input_held"):
        one, other = (answer[key] for answer in answers)
        assert abs(one.value - other.value) < one.half_width + other.half_width, key
        assert other.half_width < 0.03 * abs(other.value), key

"""Ports on bores and shafts: found by their axis, and stiff as a bush bonded to both, by its closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cadquery as cq
import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.design import study as studies
from flexdesign.design.step_part import StepPart
from flexdesign.fem import analysis, mesh_refinement
from flexdesign.fem.meshing import domain
from flexdesign.fem.quantities.port_stiffness import matrices

BORE, SHAFT, LENGTH = 5.0, 15.0, 6.0
PLACE = (3.0, -2.0, 7.0)
PORTS = """format = 1
part = "bush.step"
material = "Al 7075-T6"

[ports.ground]
point = ["3 mm", "-2 mm", "7 mm"]
axis = [0, 0, 1]
radius = "15 mm"

[ports.output]
point = ["3 mm", "-2 mm", "7 mm"]
axis = [0, 0, -1]
"""


def bush(*, pieces: int) -> cq.Workplane:
    """A disc with a bore, the wall of which is whole or two halves, as many CAD programs write it; cut in two ends."""
    disc = cq.Workplane(origin=PLACE).circle(SHAFT).extrude(LENGTH / 2, both=True)
    drill = cq.Workplane(origin=PLACE).circle(BORE).extrude(LENGTH, both=True)
    if pieces == 1:
        return disc.cut(drill)
    half = cq.Workplane(origin=(PLACE[0] + 20, PLACE[1], PLACE[2])).box(40, 40, 40)
    return disc.cut(drill.intersect(half), clean=False).cut(drill.cut(half), clean=False)


def study_of(folder: Path, extra: str = "", *, pieces: int = 1) -> studies.Study:
    cq.exporters.export(bush(pieces=pieces), str(folder / "bush.step"))
    (folder / "bush.toml").write_text(PORTS + extra)
    return studies.read(folder / "bush.toml")


@pytest.mark.parametrize(("layers", "interface"), [
    (True, "rigid"), (False, "traction"),
    pytest.param(True, "traction", marks=pytest.mark.slow), pytest.param(False, "rigid", marks=pytest.mark.slow),
])  # fmt: skip
def test_a_bush_in_torsion_is_as_stiff_as_its_closed_form(tmp_path: Path, interface: str, *, layers: bool) -> None:
    """Circles turn as wholes, with shear alone, which free ends leave as it is: k = 4 pi G t / (1 / a^2 - 1 / b^2).

    Straight edges between nodes on a circle leave a part of 1e-3 of the stiffness.
    """
    study = study_of(tmp_path, f'interface = "{interface}"\n')
    part, material = study.design.part(), study.design.material
    body = domain.of_part(part, chord=1e-5)
    if not layers:
        body = replace(body, extrusion=None)
    mesh = mesh_refinement.method_of(study, part, body).mesh(1.0)
    stiffness, _ = matrices(analysis.solve(part, material, body, mesh).compliance)
    shear = material.youngs_modulus / 2 / (1 + material.poissons_ratio)
    exact = 4 * np.pi * shear * LENGTH * 1e-3 / ((BORE * 1e-3) ** -2 - (SHAFT * 1e-3) ** -2)
    assert stiffness[5, 5] == pytest.approx(exact, rel=5e-3)
    across = stiffness[[0, 1, 3, 4], [0, 1, 3, 4]]
    assert across[::2] == pytest.approx(across[1::2], rel=1e-2)  # about its axis all directions are alike


@pytest.mark.parametrize("pieces", [1, 2])
def test_a_bore_is_found_by_its_axis_in_all_its_pieces(tmp_path: Path, pieces: int) -> None:
    part = study_of(tmp_path, pieces=pieces).design.part()
    assert isinstance(part, StepPart)
    ground, output = part.ports()
    for port, radius in ((ground, SHAFT), (output, BORE)):  # two pieces of each, end to end or side by side
        assert port.faces == tuple(f.index for f in part.faces() if f.radius == pytest.approx(1e-3 * radius))
        assert len(port.faces) == 2
    assert 1e3 * (np.array(output.point) - part.moved()) == pytest.approx(PLACE)


def test_a_port_is_pushed_along_the_direction_that_is_given(tmp_path: Path) -> None:
    output = study_of(tmp_path, "direction = [0, 3, 4]\n").design.part().ports()[1]
    assert output.normal == pytest.approx((0, 0.6, 0.8))
    with pytest.raises(InputError, match="direction must have a length"):
        study_of(tmp_path, "direction = [0, 0, 0]\n").design.part()

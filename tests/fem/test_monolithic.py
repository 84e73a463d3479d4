"""A stage in one piece: whole parts from their domains, boxes, and ties; and beside it one of condensed parts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from flexdesign.design.assembly import Assembly, Body, Box, Element, Placement
from flexdesign.fem.meshing.mesh import signed_volumes
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.superelements.superelement import Superelement
from studies.benchmarks import monolithic
from studies.benchmarks.monolithic import MonolithicStage, WholePart, box_mesh, mirror_part
from tests.fem.test_superelement import ALLOY, FRAME, TURNED, coarse, leaf, parallelogram


@pytest.fixture(scope="module")
def hinge() -> tuple[Superelement, WholePart, Any]:
    """A leaf condensed, and its mesh whole."""
    found, body, mesh = coarse(leaf(), ALLOY, coarseness=2.5, degree=1, mode_count=0)
    return found, mirror_part(mesh, body), mesh


def test_eight_images_of_an_eighth_make_the_whole(hinge: tuple[Superelement, WholePart, Any]) -> None:
    _, whole, eighth = hinge
    assert whole.mesh.volume == pytest.approx(8 * eighth.volume, rel=1e-12)
    assert signed_volumes(whole.mesh.points, whole.mesh.tets).min() > 0
    assert len(whole.mesh.points) < 8 * len(eighth.points)  # points on the planes are shared
    for name, x in (("start", -6.5e-3), ("end", 6.5e-3)):
        corners = whole.mesh.points[whole.ports[name]]
        assert corners[..., 0] == pytest.approx(np.full(corners.shape[:2], x), abs=1e-12)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 0] / 2
        assert across.sum() == pytest.approx(np.sign(x) * 6e-3 * 10e-3)  # outwards, and the whole face


def test_a_box_is_filled_with_upright_tetrahedra() -> None:
    mesh = box_mesh(Box((1.0, 2.0, 3.0), (0.3, 0.2, 0.1)), 0.05)
    assert mesh.volume == pytest.approx(0.3 * 0.2 * 0.1, rel=1e-12)
    assert signed_volumes(mesh.points, mesh.tets).min() > 0
    assert np.ptp(mesh.points, axis=0) == pytest.approx([0.3, 0.2, 0.1])
    outer = mesh.points[mesh.facets].reshape(-1, 3) - [1.0, 2.0, 3.0]
    assert np.abs(np.abs(outer) / [0.15, 0.1, 0.05] - 1).min(axis=1).max() < 1e-9  # facets match: none inside


def test_a_place_is_found_in_its_element() -> None:
    body = Elasticity(box_mesh(Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)), 0.4), ALLOY)
    places = np.random.default_rng(0).uniform(-0.5, 0.5, (20, 3))
    elements, barycentric = monolithic._locate(body, places)
    assert np.einsum("qk,qki->qi", barycentric, body.mesh.points[body.mesh.tets[elements]]) == pytest.approx(places)
    assert barycentric.min() > -1e-12


@pytest.mark.parametrize("placement", [Placement(), TURNED], ids=["as drawn", "turned"])
def test_ties_carry_uniform_strain(placement: Placement, hinge: tuple[Superelement, WholePart, Any]) -> None:
    """A box between two hinges stretches as F l / E A between its ends, and turned it does just so."""
    found, whole, _ = hinge
    origins = [tuple(placement.outside(np.array([x, 0.0, 0.0])).tolist()) for x in (-0.02 - 6.5e-3, 0.02 + 6.5e-3)]
    size = np.abs(placement.matrix @ [0.04, 6e-3, 10e-3])
    bar = Body("bar", (Box(placement.origin, tuple(size.tolist())),))
    elements = tuple(
        Element(name, leaf(), Placement(origin, placement.rotation), bonds)  # type: ignore[arg-type]
        for name, origin, bonds in (
            ("left", origins[0], {"start": "frame", "end": "bar"}),
            ("right", origins[1], {"start": "bar", "end": "frame"}),
        )
    )
    assembly = Assembly((FRAME, bar), elements, "bar", placement.origin)
    stage = MonolithicStage(assembly, {"left": whole, "right": whole}, ALLOY, 2e-3)
    rows = stage.translation("bar")
    along = placement.matrix[:, 0] @ rows
    stiffness = 1 / float(along @ stage.statics(along[:, None])[:, 0])
    # Two hinges in parallel, each of the axial stiffness it has between rigid faces, and half the bar on either side.
    end = np.arange(found.size)[found.rows("end")]
    rigid = found.of("end").rigid
    axial = (rigid.T @ found.stiffness[np.ix_(end, end)] @ rigid)[0, 0]
    bar_half = ALLOY.youngs_modulus * 60e-6 / 0.02
    assert 2 / (1 / axial + 1 / bar_half) < stiffness < 2 * axial


def test_in_its_soft_way_a_stage_of_condensed_parts_is_that_in_one_piece(
    hinge: tuple[Superelement, WholePart, Any],
) -> None:
    """A parallelogram's arms are stout beside its hinges: a quarter of a percent; its first mode half of that."""
    found, whole, _ = hinge
    condensed = parallelogram(found, 0.05)
    assembly = condensed.assembly
    stage = MonolithicStage(assembly, {e.name: whole for e in assembly.elements}, ALLOY, 4e-3)
    rows = stage.translation("table")
    compliance = rows @ stage.statics(rows.T)
    motion = condensed.motion("table", assembly.body("table").centre)[:3]
    rigid = motion @ np.linalg.solve(condensed.stiffness, motion.T)
    assert compliance == pytest.approx(compliance.T, rel=1e-6)
    assert 1.0 < compliance[1, 1] / rigid[1, 1] < 1.004
    assert np.all(np.diag(compliance) > np.diag(rigid))  # elastic bodies give way
    assert stage.frequencies(2)[0] == pytest.approx(condensed.modes(1)[0].frequency, rel=2e-3)

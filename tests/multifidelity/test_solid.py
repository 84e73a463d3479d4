"""Fast solid FEM against the full engine on the same fine meshes, made anew."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.design import design
from flexdesign.design.design import Design
from flexdesign.design.part import Outline
from flexdesign.design.study import MeshSettings
from flexdesign.fem import analysis, convergence, mesh_refinement
from flexdesign.fem.meshing import resolution_gate
from flexdesign.fem.multifidelity import FastSolid, Planar, extrusion, solid
from flexdesign.fem.multifidelity.further import AdditionalQuantities
from flexdesign.fem.quantities import of_compliance
from flexdesign.fem.solving.elasticity import Elasticity

MIDDLE = design.read(design.find("lin2019_amplifier_xy"))
#: Coarser than the engine's own, to be quick; the truths are found on the same.
ANCHORING = (2.2, 1.7)


def scaled(**scales: float) -> Design:
    changes = {name: MIDDLE.dimensions[name] * scale for name, scale in scales.items()}
    return replace(MIDDLE, dimensions={**MIDDLE.dimensions, **changes})


NEIGHBOUR = scaled(hinge_thickness=1.12, arm_span=0.9, width=0.85)


def full(given: Design) -> dict[str, Quantity]:
    """Return the limits of the full engine on the meshes of `ANCHORING`, made anew, and how far they are in doubt."""
    part, body = extrusion.of_design(given)
    method = extrusion.method(part, body, MeshSettings())
    found = []
    for coarseness in ANCHORING:
        mesh = method.mesh(coarseness)
        solution = analysis.solve(part, given.material, body, mesh, all_classes=False)
        found.append({q.key: q for q in of_compliance(solution.compliance, given.actuator)})
    sizes = [method.finest_edge(coarseness) for coarseness in ANCHORING]
    return {q.key: q for q in mesh_refinement.extrapolate_quantities(found, sizes, method.scatter)}


@pytest.fixture(scope="module")
def fast() -> Iterator[FastSolid]:
    """An evaluator with one anchor."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solid, "ANCHORING", ANCHORING)
        yield FastSolid(accuracy=0.05, anchors=[MIDDLE])


def within(found: list[Quantity], truth: dict[str, Quantity]) -> None:
    """Both have errors of their own, and of meshes that have nothing in common."""
    for one in found:
        other = truth[one.key]
        assert one.half_width is not None and other.half_width is not None
        assert abs(one.value - other.value) <= np.hypot(one.half_width, other.half_width), (one, other)


def test_at_an_anchor_the_answer_is_the_limit(fast: FastSolid) -> None:
    """Three numbers are extrapolated, not each quantity; that is the same to second order of what meshes leave open."""
    found, truth = fast.evaluate(MIDDLE), full(MIDDLE)
    assert {q.key for q in found} == truth.keys()
    for quantity in found:
        assert quantity.value == pytest.approx(truth[quantity.key].value, rel=1e-3), quantity.key


def test_a_neighbour_is_as_right_as_it_says(fast: FastSolid) -> None:
    found, truth = fast.evaluate(NEIGHBOUR), full(NEIGHBOUR)
    assert all("corrected" in q.source for q in found)
    within(found, truth)
    for quantity in found:
        assert quantity.value == pytest.approx(truth[quantity.key].value, rel=0.01), quantity.key


def test_moved_bodies_have_the_stiffness_of_new_ones(fast: FastSolid) -> None:
    """Numbering, order of elimination and solver of the anchor, against a body of its own on the same moved mesh."""
    part, body = extrusion.of_design(NEIGHBOUR)
    method = extrusion.method(part, body, MeshSettings())
    coarse = fast.families[0].meshes[0]
    moved = coarse.numbers(NEIGHBOUR, part, body, method)
    mesh = coarse.morph(method)
    checked = resolution_gate.check(mesh, body, part.linkage().of_kind("hinge"))
    assert len(checked) == 4 and max(abs(each.deviation) for each in checked) < 1e-9
    new = analysis.solve(part, NEIGHBOUR.material, body, mesh, all_classes=False).compliance
    assert moved == pytest.approx(solid.three(new), rel=1e-9)
    patterns = [
        one.stiffness(zeros=True).indices for one in (coarse.body, coarse.body.on_mesh(mesh, NEIGHBOUR.material))
    ]
    assert np.array_equal(*patterns)


def test_morphed_meshes_leave_no_noise(fast: FastSolid) -> None:
    """Fourth differences of ln K_in over ln t; on meshes made anew they are tens of times as large."""
    designs = [scaled(hinge_thickness=s) for s in np.geomspace(0.85, 1.15, 7)]
    coarse = fast.families[0].meshes[1]
    morphed, anew = [], []
    for given in designs:
        part, body = extrusion.of_design(given)
        method = extrusion.method(part, body, MeshSettings())
        morphed.append(coarse.numbers(given, part, body, method)[0])
        compliance, factor = solid.solve(part, body, Elasticity(method.mesh(coarse.coarseness), given.material))
        factor.free()
        anew.append(compliance.c11)
    noise = [float(np.abs(np.diff(np.log(values), 4)).max()) for values in (morphed, anew)]
    assert noise[0] < 1e-4 and noise[0] < noise[1] / 10


def test_stiffer_stuff_is_stiffer_in_proportion(fast: FastSolid) -> None:
    """Corrections are ratios, so that the modulus of a neighbour's material does not enter them."""
    metal = NEIGHBOUR.material
    doubled = replace(NEIGHBOUR, material=replace(metal, youngs_modulus=2 * metal.youngs_modulus))
    one, two = ({q.key: q.value for q in fast.evaluate(given)} for given in (NEIGHBOUR, doubled))
    for key, factor in (("K_in_output_free", 2), ("lambda_output_free", 1), ("K_out_input_held", 2)):
        assert two[key] == pytest.approx(factor * one[key], rel=1e-9)


@pytest.mark.slow
def test_other_corners_make_another_family_and_doubt_another_anchor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solid, "ANCHORING", (2.46, 2.2))
    fast = FastSolid(accuracy=0.1)
    fast.evaluate(MIDDLE)
    rodless = replace(MIDDLE, dimensions={**MIDDLE.dimensions, "rod_length": 0.0, "input_block_height": 30e-3})
    fast.evaluate(rodless)
    fast.evaluate(NEIGHBOUR)
    assert [len(family.anchors) for family in fast.families] == [1, 1]
    fast.accuracy = 1e-4
    monkeypatch.setattr(solid, "DRIFT", 1.0)
    found = fast.evaluate(NEIGHBOUR)
    assert [len(family.anchors) for family in fast.families] == [2, 1]
    assert fast.evaluate(NEIGHBOUR)[0].value == pytest.approx(found[0].value, rel=1e-9)  # now known


def test_quantities_inherit_the_errors_of_three_numbers() -> None:
    """K_in = 1 / C11 has the relative error of C11; stroke's follows from two of the numbers, by calculus."""
    numbers, sigma = np.array([1e-6, -5.5, 5e-5]), np.array([0.01, 0.002, 0.03])
    found = {q.key: q for q in FastSolid()._quantities(MIDDLE, numbers, sigma, "morphed")}
    k_in, stroke = found["K_in_output_free"], found["stroke_output_free"]
    assert k_in.half_width == pytest.approx(0.01 * k_in.value, rel=0.02)
    assert MIDDLE.actuator is not None
    share = 1 / (MIDDLE.actuator.installed_stiffness * numbers[0] + 1)  # d ln s / d ln C11 of lambda C11 / (C11 + 1/k)
    expected = np.hypot(0.01 * share, 0.002) * abs(stroke.value)
    assert stroke.half_width == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("evaluator", [FastSolid(), Planar()])
def test_what_cannot_be_built_or_swept_is_refused(evaluator: FastSolid | Planar) -> None:
    with pytest.raises(InputError, match="hinge_thickness"):
        evaluator.evaluate(scaled(hinge_thickness=20.0))
    with pytest.raises(InputError, match="whole stage"):
        evaluator.evaluate(design.read(design.find("lin2019_xyz_stage")))


def test_an_outline_that_is_not_the_solid_is_refused() -> None:
    class Other(MIDDLE.part_class):  # type: ignore[misc, name-defined]
        def outline(self) -> Outline:
            told = super().outline()
            return replace(told, low=1.01 * told.low, high=1.01 * told.high)

    with pytest.raises(InputError, match="not the section of solid"):
        Planar().evaluate(replace(MIDDLE, part_class=Other))


def test_a_part_that_is_no_extrusion_is_refused() -> None:
    class Other(MIDDLE.part_class):  # type: ignore[misc, name-defined]
        def prismatic(self) -> None:
            return None

    with pytest.raises(InputError, match="no section"):
        FastSolid().evaluate(replace(MIDDLE, part_class=Other))


@pytest.mark.slow
def test_fillets_go_by_the_cad_kernel() -> None:
    """Rounded roots are not told by corners: the section is read off the solid, and morphed all the same."""
    rounded = replace(MIDDLE, dimensions={**MIDDLE.dimensions, "fillet_radius": 3e-4})
    wider = replace(rounded, dimensions={**rounded.dimensions, "width": 18e-3, "hinge_thickness": 0.55e-3})
    fast = FastSolid(accuracy=0.02)
    found = [{q.key: q for q in fast.evaluate(given)} for given in (rounded, wider)]
    assert len(fast.families) == 1 and len(fast.families[0].anchors) == 1
    truth = {q.key: q for q in FastSolid(accuracy=0.02).evaluate(wider)}
    within(list(found[1].values()), truth)


@pytest.mark.slow
def test_modes_and_stress_come_along_if_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Against a neighbour that is an anchor itself: everything that could be corrected is as right as it says."""
    monkeypatch.setattr(solid, "ANCHORING", (2.2, 1.7))
    fast = FastSolid(accuracy=0.05, modes=1, anchors=[MIDDLE])
    found = fast.evaluate(NEIGHBOUR)
    truth = {q.key: q for q in FastSolid(accuracy=0.05, modes=1).evaluate(NEIGHBOUR)}
    keys = {q.key for q in found}
    assert len(fast.families[0].anchors) == 1 and keys == truth.keys() and len(keys) == len(found)
    assert {"first_frequency_input_free", "drive_frequency_actuator_installed", "hinge_stress_full_voltage"} <= keys
    judged = [q for q in found if q.half_width is not None]
    within(judged, truth)
    assert all(abs(q.value) < 1e-9 for q in found if q.half_width is None and q.name.startswith("table_u_x"))


def test_corrections_beside_stiffness_are_those_of_the_anchors() -> None:
    """Two anchors of equal weight: the geometric mean of their corrections; what one does not know stays as it is."""

    def one(name: str, value: float, sigma: float | None = None) -> Quantity:
        return Quantity(name, value, "Hz", "Hz", half_width=sigma)

    coarse = {"f": one("f", 100.0), "zero": one("zero", 0.0), "K_in": one("K_in", 1.0)}
    asked, scatter = AdditionalQuantities(1), convergence.MeshNoise(0.0)
    known = [
        asked.anchor_errors(
            coarse, [{"f": one("f", v), "zero": one("zero", 0.0), "K_in": one("K_in", 1.0)}] * 2, [2, 1], scatter
        )
        for v in (98.0, 96.0)
    ]
    rest = {key: coarse[key] for key in ("f", "zero")}
    frequency, zero = asked.correct(rest, known, [0.5, 0.5], 0.003)
    assert frequency.value == pytest.approx(np.sqrt(98.0 * 96.0)) and frequency.half_width is not None
    assert frequency.half_width / frequency.value == pytest.approx(np.hypot(0.003, np.log(100 / frequency.value) / 2))
    assert (zero.value, zero.half_width) == (0.0, None)
    (at_anchor,) = asked.correct({"f": coarse["f"]}, known, [1.0, 0.0], 0.0)
    assert at_anchor.value == pytest.approx(98.0) and at_anchor.half_width == pytest.approx(0.0, abs=1e-12)

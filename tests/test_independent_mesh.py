"""One pytetwild mesh beside the meshes of a validation: what it says, how well, and what it is listed as."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexdesign.core.model import by_key
from flexdesign.core.result_cache import Cache
from flexdesign.design import study as studies
from flexdesign.fem.meshing import domain
from flexdesign.fem.meshing.mesh import MeshError
from flexdesign.fem.meshing.methods import Unstructured
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.report.render import to_markdown
from flexdesign.report.validation import independent_text, validation_report
from flexdesign.workflows.validation import IndependentCheck, Validation, independent_mesh, validate

#: Coarse, and without what takes time elsewhere.
QUICK = ["mesh.levels=2", "output.large_steps=0", "modes.count=1"]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    cache = Cache(tmp_path_factory.mktemp("cache"))
    cache.prepare()
    return cache


@pytest.fixture(scope="module")
def found(store: Cache) -> Validation:
    return validate(studies.read("bridge_amplifier", QUICK), store)


@pytest.fixture(scope="module")
def check(found: Validation) -> IndependentCheck:
    assert found.independent is not None
    return found.independent


def test_by_default_one_mesh_of_pytetwild_agrees_within_both_estimates(check: IndependentCheck) -> None:
    assert set(check.found) == set(independent_mesh.KEYS)
    assert check.agrees
    for key in check.found:
        assert 1e-3 < check.allowed(key) < 0.05  # a check of a few percent, no more and no less


def test_the_estimate_holds_what_the_mesh_is_too_stiff_by(check: IndependentCheck, found: Validation) -> None:
    """As solved, before it is freed of its error, the mesh is stiffer than the limit, and by more than its estimate."""
    for key in ("K_in_output_free", "K_out_input_free"):
        quantity = check.found[key]
        share = (quantity.half_width or 0.0) / quantity.value
        raw = quantity.value * (1 + independent_mesh.SHORT * share / (1 + share))
        assert raw > found.fem(key).value * (1 + share / 2)


def test_recovery_is_exact_for_a_uniform_strain(store: Cache) -> None:
    """Averages of equal stresses are those stresses: nothing is left, whatever the mesh."""
    study = studies.read("bridge_amplifier", QUICK)
    part = study.design.part()
    body = domain.of_part(part, chord=domain.chord(part))
    method = independent_mesh.mesh_refinement.method_of(study, part, body)
    mesh, _ = independent_mesh.mesh_refinement.make_mesh(
        method, body, 2.5, part.linkage().of_kind("hinge"), store, lambda _: None
    )
    elastic = Elasticity(mesh, study.design.material)
    stretched = elastic.positions @ np.array([[1.0, 0.3, 0.0], [0.0, -0.2, 0.1], [0.0, 0.0, 0.5]]) * 1e-3
    sheared = elastic.positions @ np.array([[0.2, 0.0, 0.3], [0.1, 0.6, 0.0], [0.0, 0.4, 0.1]]) * 1e-3
    assert independent_mesh.recovery_error(elastic, stretched, sheared) == pytest.approx((0.0, 0.0, 0.0), abs=1e-20)


def test_a_report_that_is_off_is_said_to_be(check: IndependentCheck) -> None:
    key = "K_in_output_free"
    off = {**check.chosen, key: replace(check.chosen[key], value=1.05 * check.chosen[key].value)}
    other = replace(check, chosen=off)
    assert not other.agrees
    said = independent_text.verdict(other)
    assert "does NOT agree" in said and "input stiffness" in said
    assert independent_text.result(other)["agrees"] is False  # type: ignore[index]


def test_report_and_result_have_it(found: Validation) -> None:
    text = to_markdown(validation_report.document(found))
    assert "One independent mesh of the same domain, by pytetwild, agrees within both error estimates" in text
    assert "## An independent mesh" in text
    result = validation_report.result(found)
    assert result["independent_mesh"]["agrees"] and len(result["independent_mesh"]["quantities"]) == 3


def test_one_setting_leaves_it_out_and_versions_name_only_what_ran(store: Cache, found: Validation) -> None:
    assert "pytetwild" in validation_report.result(found)["made_by"]["versions"]
    without = validate(studies.read("bridge_amplifier", [*QUICK, "mesh.independent=false"]), store)
    assert without.independent is None
    result = validation_report.result(without)
    assert result["independent_mesh"] is None
    assert "pytetwild" not in result["made_by"]["versions"] and "meshio" not in result["made_by"]["versions"]
    assert {"cadquery", "scikit-fem", "numpy", "scipy"} < set(result["made_by"]["versions"])
    assert "pytetwild" not in to_markdown(validation_report.document(without))


@pytest.mark.slow
def test_a_part_that_pytetwild_meshes_anyway_has_none(store: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(independent_mesh, "run", lambda *_: pytest.fail("asked"))
    coarse = ["mesh.method=wild", "mesh.at_root=1.2", "mesh.growth=1.0", "mesh.levels=2"]
    found = validate(studies.read("bridge_amplifier", [*QUICK, *coarse]), store)
    assert found.independent is None
    assert "pytetwild" in validation_report.result(found)["made_by"]["versions"]


def test_a_mesher_that_fails_is_said_and_stops_nothing(
    found: Validation, store: Cache, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refused(*_: object) -> None:
        raise MeshError("no tetrahedra")

    monkeypatch.setattr(Unstructured, "mesh", refused)
    empty = Cache(tmp_path / "cache")
    empty.prepare()
    study = found.study
    reported = by_key([c.fem for c in found.comparisons])
    check = independent_mesh.run(study, study.design.part(), found.domain, reported, empty, lambda _: None)
    assert not check.agrees and check.failure == "no tetrahedra"
    assert "gave no answer: no tetrahedra" in independent_text.verdict(check)
    assert independent_text.section(check).paragraphs


def test_a_mesh_that_would_take_minutes_is_not_made(
    found: Validation, store: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(independent_mesh, "MOST", 5_000)
    reported = by_key([c.fem for c in found.comparisons])
    study = found.study
    check = independent_mesh.run(study, study.design.part(), found.domain, reported, store, lambda _: None)
    said = re.search(r"it would have about (\d+) tetrahedra, and is made of up to 5000$", check.failure)
    assert said and 5_000 < int(said.group(1)) < 30_000
    assert "gave no answer" in independent_text.verdict(check)


# --- masses of (18) to (22) beside the modes -----------------------------------------------------------------------


def test_the_mass_of_19_stands_beside_the_modal_mass(found: Validation) -> None:
    """M_b by hand: m_1 / 2 lambda^2 + m_3 + J / l_x^2."""
    (row,) = (c for c in found.comparisons if c.fem.key == "output_mass_input_free")
    design, d = found.study.design, found.study.design.dimensions
    density = design.material.density * d["width"]
    m_1 = density * (d["input_block_depth"] * d["input_block_height"] + 2 * d["rod_thickness"] * d["rod_length"])
    m_3 = density * d["block_width"] * d["output_block_height"]
    arm = d["arm_span"] - d["hinge_length"]
    inertia = density * arm * d["arm_thickness"] * (arm**2 + d["arm_thickness"] ** 2) / 12
    ratio = next(c for c in found.comparisons if c.fem.key == "lambda_output_free").analytic["PRB"].value
    expected = m_1 / (2 * ratio**2) + m_3 + inertia / d["arm_span"] ** 2
    assert row.analytic["PRB"].value == pytest.approx(expected)
    assert row.fem.value > row.analytic["PRB"].value  # (19) leaves out that arms and input blocks translate
    frequency, stiffness = (found.fem(key).value for key in ("output_frequency_input_free", "K_out_input_free"))
    assert row.fem.value * (2 * np.pi * frequency) ** 2 >= 0.9 * stiffness
    text = to_markdown(validation_report.document(found))
    assert "modal mass at the output m_out" in text

"""Error estimates beside an independent reference: two designs of the study, and how the study judges."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from flexdesign.core.result_cache import Cache
from flexdesign.fem.meshing import domain, methods, profile
from flexdesign.report import render
from studies.error_bars import __main__ as command
from studies.error_bars import bridge, report, trial
from studies.error_bars.bridge import Fineness, Reference
from studies.error_bars.designs import (
    COUNT,
    METALS,
    NOTCHED,
    ROUNDED,
    WITHOUT_RODS,
    SampledDesign,
    curved_designs,
    designs,
)
from studies.error_bars.findings import Case, Deviation, judge
from studies.error_bars.trial import ALL, LEVELS, ORDERS, QUANTITIES, ProgramResult, ReferenceResult

#: The quickest of the study with sharp and with rounded roots: little width, thick hinges.
SHARP, FILLETED = 7, 38
VALUES = dict.fromkeys(QUANTITIES, 100.0)


def silent(_: str) -> None:
    """Tell nobody."""


@pytest.mark.parametrize("number", [SHARP, pytest.param(FILLETED, marks=pytest.mark.slow)])
def test_estimates_contain_the_reference(number: int, tmp_path: Path) -> None:
    """At an accuracy of 2 %, on the first two meshes."""
    sample = designs()[number]
    answer = trial.solve_design(sample, "extruded", tmp_path, Cache(tmp_path / "cache"), silent, accuracy=0.02)
    reference = trial.solve_reference(sample, tmp_path, silent)
    case = Case(sample, "extruded", answer, reference)
    assert [d.quantity for d in case.deviations if not d.contained] == []
    assert answer.reached <= 0.02
    for deviation in case.deviations:
        assert deviation.uncertainty < 0.4 * deviation.estimate
    assert trial.solve_reference(sample, tmp_path, pytest.fail) == reference  # from its file
    again = trial.solve_design(sample, "extruded", tmp_path, Cache(tmp_path / "none"), pytest.fail, accuracy=0.02)
    assert again.values == answer.values and again.estimates == answer.estimates


@pytest.mark.slow
@pytest.mark.parametrize("number", [8, 32])
def test_estimates_of_curved_necks_contain_the_reference(number: int, tmp_path: Path) -> None:
    """Stiffnesses, amplification and nominal hinge stress, on the first two meshes."""
    sample = curved_designs()[number]
    answer = trial.solve_design(sample, "extruded", tmp_path, Cache(tmp_path / "cache"), silent, accuracy=0.02)
    case = Case(sample, "extruded", answer, trial.solve_reference(sample, tmp_path, silent))
    assert [d.quantity for d in case.deviations] == list(ALL)
    assert [d.quantity for d in case.deviations if not d.contained] == []
    assert answer.reached <= 0.02


def test_curved_designs_are_drawn_once_and_for_all() -> None:
    samples = curved_designs()
    assert [d.number for d in samples] == list(range(COUNT, 2 * COUNT)) and curved_designs(count=3) == samples[:3]
    assert curved_designs(seed=1, count=3) != samples[:3]
    kinds = [d.kind for d in samples[:4]]
    assert kinds == ["circular notches"] * 2 + ["circular notches, declared as fillets", "long fillets"]
    assert all(d.curved and not d.is_unstructured for d in samples) and not any(d.curved for d in designs())
    for d in samples[:4]:
        hinges = d.study(0.01, "auto").design.part().linkage().of_kind("hinge")
        assert len(hinges) == 8 and all(profile.is_curved(hinge) for hinge in hinges)
        assert all(math.isfinite(hinge.curvature_radius) == (d.design == NOTCHED) for hinge in hinges)


@pytest.mark.parametrize("number", [0, 1, 2, 3, 5])
def test_the_reference_fills_what_the_program_meshes(number: int) -> None:
    """The area of the quadratic arcs, against the volume of the solid; with and without rods."""
    part = curved_designs()[number].study(0.01, "auto").design.part()
    plan, layers = bridge.mesh(part, Fineness.of(1.6))  # type: ignore[arg-type]
    assert plan.area() * layers[-1] == pytest.approx(domain.of_part(part, chord=domain.chord(part)).volume, rel=1e-6)


def test_designs_are_drawn_once_and_for_all() -> None:
    samples = designs()
    assert len(samples) == COUNT and [d.number for d in samples] == list(range(COUNT))
    assert designs(count=3) == samples[:3] and designs(seed=1, count=3) != samples[:3]
    assert {d.material for d in samples} == set(METALS)
    rounded, bare = (d for d in (samples[ROUNDED - 1], samples[WITHOUT_RODS - 1]))
    assert rounded.rounded and not samples[0].rounded
    assert bare.dimensions["rod_length"] == 0.0 and samples[0].dimensions["rod_length"] > 0.0
    assert all(0.2 <= d.dimensions["hinge_thickness"] <= 1.0 and 10 <= d.dimensions["arm_span"] <= 40 for d in samples)
    assert {True, False} == {d.rounded for d in samples if d.is_unstructured}


def test_reference_extrapolates_what_falls_with_a_power_between_its_orders() -> None:
    growths = [Fineness.of(level).growth for level in LEVELS]
    for order in (*ORDERS, 5.0):
        compliances = [1e-6 / (1 + 0.01 * growth**order) for growth in growths]
        meshes = [Reference(c, 3 * c, 10 * c, (), 0.0, 1, 1.0) for c in compliances]
        found = trial.extrapolate(*meshes)
        assert abs(found.values["K_in_output_free"] - 1e6) <= found.uncertainties["K_in_output_free"] * (1 + 1e-6)
        assert found.values["lambda_output_free"] == pytest.approx(3.0)


@pytest.mark.parametrize("radius", [0.0, 0.3])
@pytest.mark.parametrize("rods", [True, False])
def test_every_kind_of_design_fills_its_contour(rods: bool, radius: float) -> None:
    sample = designs()[0]
    dimensions = {**sample.dimensions, "fillet_radius": radius} | ({} if rods else {"rod_length": 0.0})
    part = replace(sample, dimensions=dimensions).study(0.01, "auto").design.part()
    bridge.mesh(part, Fineness.of(1))  # type: ignore[arg-type]  # raises if it does not


def invented(deviations: list[float], sample: SampledDesign, uncertainty: float = 0.1) -> Case:
    """Return a case whose values of 100 lie so many estimates of 1 off the reference."""
    references = {key: 100.0 - off for key, off in zip(QUANTITIES, deviations, strict=True)}
    answer = ProgramResult(VALUES, dict.fromkeys(QUANTITIES, 1.0), (2e-5, 1e-5), {}, (10_000, 20_000), 3.0)
    return Case(sample, "extruded", answer, ReferenceResult(references, dict.fromkeys(QUANTITIES, uncertainty), 9, 1.0))


def test_judgement_counts_what_is_contained() -> None:
    found = judge(invented([0.5, -1.5, 1.0, 0.01], designs()[0]).deviations)
    assert (found.count, found.contained, found.share, found.holds) == (4, 3, 0.75, False)
    assert found.worst == pytest.approx(1.5)
    assert found.median_estimate == pytest.approx(0.01)
    assert found.doubt == pytest.approx(0.1)
    errors = [0.5 / 99.5, 1.5 / 101.5, 1 / 99, 0.01 / 99.99]
    assert found.caution == pytest.approx(0.01 / math.sqrt(sum(e**2 for e in errors) / 4))


def test_a_report_is_written_again_from_its_result(tmp_path: Path) -> None:
    cases = [invented([0.5, -1.5, 1.0, 0.01], sample) for sample in (designs()[0], designs()[5])]
    result = json.loads(json.dumps(report.of(cases)))
    (tmp_path / "result.json").write_text(json.dumps(result), encoding="utf-8")
    assert report.of(report.cases_of(result)) == result
    assert command.main(["--result", str(tmp_path / "result.json"), "--out", str(tmp_path / "out")]) == 1
    assert json.loads((tmp_path / "out" / "result.json").read_text(encoding="utf-8"))["cases"] == result["cases"]


def test_estimates_that_say_nothing_do_not_hold() -> None:
    timid = judge(invented([0.04, -0.03, 0.0, 0.05], designs()[0]).deviations)
    assert timid.share == 1.0 and timid.caution > 20 and not timid.holds
    assert judge(invented([0.4, -0.3, 0.0, 0.5], designs()[0]).deviations).holds


def test_what_the_reference_leaves_open_is_no_excuse() -> None:
    assert not Deviation("K_in_output_free", 100.0, 1.0, 101.05, 0.1).contained


def test_kept_meshes_are_judged_by_the_estimate_of_today() -> None:
    raw = {key: [104.0, 102.0] for key in QUANTITIES}
    stale = ProgramResult(VALUES, VALUES, (1.8225e-5, 1e-5), raw, (1, 2), 1.0)
    fresh = trial.update_estimates(stale, methods.SCATTER, 0.05)
    assert fresh is not None and 98.0 < fresh.values["K_in_output_free"] < 102.0
    assert 0.0 < fresh.estimates["K_in_output_free"] < 4.0
    assert trial.update_estimates(stale, methods.SCATTER, 1e-3) is None  # it would refine further
    assert trial.update_estimates(replace(stale, error="no mesh"), methods.SCATTER, 0.05) is None


def test_files_of_other_questions_are_not_taken(tmp_path: Path) -> None:
    sample = designs()[0]
    path = tmp_path / "00-reference.json"
    trial._write_result(path, "another question", {"values": {}})
    assert trial._read_result(path, "the question") is None
    assert trial._read_result(path, "another question") == {"values": {}}
    path.write_text("{", encoding="utf-8")
    assert trial._read_result(path, "another question") is None
    trial.forget(tmp_path)
    assert not list(tmp_path.iterdir()) and sample.number == 0


def test_curved_designs_are_judged_by_themselves() -> None:
    leaf, sample = invented([0.5, 0.5, 0.5, 0.5], designs()[0]), curved_designs()[0]
    values = dict.fromkeys(ALL, 100.0)
    answer = ProgramResult(values, dict.fromkeys(ALL, 1.0), (2e-5, 1e-5), {}, (10_000, 20_000), 3.0)
    reference = ReferenceResult(dict.fromkeys(ALL, 100.5), dict.fromkeys(ALL, 0.1), 9, 1.0)
    said = report.summary([leaf, Case(sample, "extruded", answer, reference)])
    assert said[0].startswith("Extruded meshes of leaves: 4 of 4 estimates")
    assert said[1].startswith("Extruded meshes of curved necks: 5 of 5 estimates") and "all 5 of a design" in said[1]
    assert set(report.of([leaf])["judgements"]) == {"extruded"}
    assert [d.curved for d, _ in command._select_cases(2, None, curved=True)] == [True, True]
    assert not any(d.curved for d, _ in command._select_cases(2, "wild", curved=False))


def test_report_states_every_number(tmp_path: Path) -> None:
    cases = [invented([0.5, -1.5, 1.0, 0.01], designs()[0]), invented([0.2, 0.1, -0.3, 0.4], designs()[ROUNDED - 1])]
    lost = replace(cases[0], answer=ProgramResult({}, {}, (), {}, (), 1.0, error="the mesher ended without a mesh"))
    render.write(tmp_path, report.document([*cases, lost]), report.of([*cases, lost]), {})
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "7 of 8 estimates contain the reference" in text
    assert "100.0 ± 1.0" in text and "the mesher ended without a mesh" in text
    numbers = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert numbers["judgements"]["extruded"]["contained"] == 7
    assert [len(case["quantities"]) for case in numbers["cases"]] == [4, 4, 0]
    assert {file.name for file in tmp_path.glob("*.svg")} == {"bars_extruded.svg", "histogram_extruded.svg"}

"""Every way of solving one part: what counts as agreement, and four ways that must agree."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.core.result_cache import Cache
from flexdesign.design import study
from flexdesign.fem import mesh_refinement
from flexdesign.fem.meshing import methods
from flexdesign.report.validation import cross_check_text
from flexdesign.workflows.validation import CrossCheck, Validation, Way, validate
from flexdesign.workflows.validation.cross_check import KEYS

#: Hinges so stout, and meshes so coarse, that wild meshes of the whole part take a second.
STOUT = (
    'dimensions.hinge_thickness="2 mm"',
    'mesh.largest="6 mm"',
    "mesh.levels=2",
    "modes.count=1",
    "output.large_steps=0",
    "mesh.cross_check=true",
)
DEFAULT = {"UNSTRUCTURED_GRADING": methods.UNSTRUCTURED_GRADING, "EXTRUDED_GRADING": methods.EXTRUDED_GRADING}
COARSE = {"UNSTRUCTURED_GRADING": (0.8, 1.0), "EXTRUDED_GRADING": (0.2, 0.9)}


def way(k_in: float, sigma: float, planes: str = "xz", method: str = "extruded") -> Way:
    """Return a way whose input stiffness is this [N/m], and whose other answers are always the same."""
    found = [
        Quantity("K_in", k_in, "N/m", "N/mm", "output free", half_width=sigma),
        Quantity("lambda", -11.0, "1", "", "output free", half_width=0.01),
        Quantity("K_out", 1e4, "N/m", "N/mm", "input free", half_width=20.0),
    ]
    return Way(method, planes, {quantity.key: quantity for quantity in found}, 1000, 2.0)


def test_a_difference_is_relative_and_in_combined_estimates() -> None:
    """Of 2000 and 2010 +- 3 and +- 4 N/mm: half a percent, 10 of sqrt(3^2 + 4^2) = 5."""
    chosen, other = way(2000e3, 3e3), way(2010e3, 4e3)
    assert other.difference(chosen, "K_in_output_free") == (pytest.approx(5e-3), pytest.approx(2.0))
    assert other.difference(chosen, "lambda_output_free") == (0.0, 0.0)
    assert way(2010e3, 0.0).difference(way(2000e3, 0.0), "K_in_output_free")[1] == math.inf


@pytest.mark.parametrize(("k_in", "agrees"), [(2004.9e3, True), (2005.1e3, False), (1994.9e3, False)])
def test_ways_agree_within_their_combined_estimate(k_in: float, agrees: bool) -> None:
    check = CrossCheck(way(2000e3, 3e3), (way(2000e3, 1e3, ""), way(k_in, 4e3, "", "wild")))
    assert check.agrees == agrees
    told = cross_check_text.verdict(check)
    assert ("do NOT agree" in told) != agrees
    assert told.startswith("Cross-check: 3 ways") and "K_in, unstructured meshes of the whole part" in told
    assert cross_check_text.result(check)["agrees"] == agrees  # type: ignore[index]


def test_a_way_without_an_answer_is_told_and_agrees_with_nothing() -> None:
    check = CrossCheck(way(2000e3, 3e3), (Way("wild", "", {}, failure="too little memory"),))
    assert not check.agrees
    section = cross_check_text.section(check)
    assert "nothing could be cross-checked" in section.paragraphs[0]
    assert "Unstructured meshes of the whole part gave no answer: too little memory." in section.paragraphs
    assert len(section.tables[0].rows) == 1 and not section.tables[1].rows


@pytest.fixture(scope="module", autouse=True)
def coarse() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for name, grading in COARSE.items():
            patch.setattr(methods, name, grading)
        yield


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Cache:
    return Cache(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="module")
def found(cache: Cache) -> Validation:
    return validate(study.read("bridge_amplifier", STOUT), cache)


def test_an_amplifier_is_solved_in_four_ways(found: Validation) -> None:
    """Extruded and wild meshes, of the quarter and of the whole.

    Extruded meshes repeat themselves, and agree within twice the combined estimate, which is made of half-widths. Wild
    ones as coarse as these do not repeat themselves within their estimates: of them no more than an answer is asked.
    """
    check = found.cross_check
    assert check is not None
    ways = [check.chosen, *check.others]
    assert [(w.method, w.planes) for w in ways] == [("extruded", "xz"), ("wild", "xz"), ("extruded", ""), ("wild", "")]
    assert not any(w.failure for w in ways)
    by_way = {(w.method, w.planes): w for w in ways}
    for key in KEYS:
        relative, estimates = by_way["extruded", ""].difference(check.chosen, key)
        assert relative != 0 and estimates < 2.0  # meshed anew, not taken over
    for method in ("extruded", "wild"):
        assert by_way[method, ""].unknowns > 2 * by_way[method, "xz"].unknowns
    told = cross_check_text.result(check)
    assert told is not None and [w["chosen"] for w in told["ways"]] == [True, False, False, False]
    assert all(len(w["quantities"]) == 3 and w["seconds"] > 0 for w in told["ways"])


@pytest.mark.slow
def test_four_ways_to_solve_an_amplifier_agree(cache: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    """On meshes as fine as they are by default each way keeps to its estimate, which is a half-width."""
    for name, grading in DEFAULT.items():
        monkeypatch.setattr(methods, name, grading)
    check = validate(
        study.read("bridge_amplifier", ["output.large_steps=0", "mesh.cross_check=true"]), cache
    ).cross_check
    assert check is not None and len(check.answered) == 3
    assert check.worst()[2] < 2.0, cross_check_text.verdict(check)
    assert all(abs(way.difference(check.chosen, key)[0]) < 0.02 for way in check.others for key in KEYS)


def test_a_second_cross_check_comes_from_the_cache(
    found: Validation, cache: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("was solved again")

    monkeypatch.setattr(mesh_refinement.analysis, "solve", never)
    again = validate(study.read("bridge_amplifier", STOUT), cache)
    assert again.cross_check == found.cross_check


def test_a_mesh_that_cannot_be_had_is_an_answer(
    found: Validation, cache: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    solved = mesh_refinement.refine

    def refined(
        asked: study.Study, part: object, body: object, method: object, *others: object, omit: int = 0
    ) -> object:
        if method.name == "wild":  # type: ignore[attr-defined]
            raise InputError(Path("design.toml"), "mesh", None, "not enough memory")
        return solved(asked, part, body, method, *others, omit=omit)  # type: ignore[arg-type]

    monkeypatch.setattr(mesh_refinement, "refine", refined)
    check = validate(study.read("bridge_amplifier", STOUT), cache).cross_check
    assert check is not None and [w.method for w in check.answered] == ["extruded"]
    assert {w.failure for w in check.others} == {"", "not enough memory"}


def test_nobody_asks_for_one_by_default() -> None:
    assert not study.read("bridge_amplifier").mesh.cross_check
    with pytest.raises(InputError, match="expected true or false"):
        study.read("bridge_amplifier", ["mesh.cross_check=maybe"])

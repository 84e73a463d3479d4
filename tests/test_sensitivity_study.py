"""The study of decision constants: how one is changed, which cases, what is kept, and the table."""

from __future__ import annotations

import importlib
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from flexdesign.diagnosis import verdict
from flexdesign.diagnosis.effect_selection import prior_conflicts
from flexdesign.estimation import criterion
from flexdesign.estimation.model_selection import forward_selection, model_comparison, score_test
from flexdesign.estimation.uncertainty import intervals
from studies.hidden_effect_trial.folder import Answer
from studies.hidden_effect_trial.scoring import Diagnosed
from studies.sensitivity import __main__ as command
from studies.sensitivity import constants, report, settings
from studies.sensitivity.constants import CONSTANTS, Constant, chosen, holders, override_constant
from studies.sensitivity.settings import Variation, VariationOutcome

BY_KEY = {each.key: each for each in CONSTANTS}
LIMIT = Constant("gauged.limits", "LIMIT", "what is too much")
#: A package that hands a constant on: under another name, through a module between, and to one that comes late.
SOURCES = {
    "__init__": "from gauged import limits, between, after, alone",
    "limits": "LIMIT = 3\nUNUSED = 3\n\ndef near(x):\n    return x < LIMIT",
    "between": "from gauged.limits import LIMIT as MOST\n\ndef few(x):\n    return x < MOST",
    "after": "from .between import MOST\n\ndef fewer(x):\n    return x + 1 < MOST",
    "alone": "LIMIT = MOST = 3\n\ndef other(x):\n    return x < LIMIT and x < MOST",
    "late": "from gauged.limits import LIMIT",
}


@pytest.fixture
def gauged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """A package of its own."""
    (tmp_path / "gauged").mkdir()
    for name, source in SOURCES.items():
        (tmp_path / "gauged" / f"{name}.py").write_text(source, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("gauged")
    for name in [key for key in sys.modules if key.partition(".")[0] == "gauged"]:
        del sys.modules[name]


def ended(key: str = "", factor: float = 1.0, number: int = 20000, **more: Any) -> VariationOutcome:
    given = {"right": True, "false_names": 0, "said": "creep -> creep", "seconds": 2.0, "source": "now", **more}
    return VariationOutcome(
        key, factor, more.pop("value", 1.0), number, "single", **{k: given[k] for k in given if k != "value"}
    )


# --- changing a constant --------------------------------------------------------------------------------------------


def test_a_changed_constant_changes_what_every_importer_says(gauged: Any) -> None:
    def said() -> tuple[bool, ...]:
        return gauged.limits.near(4), gauged.between.few(4), gauged.after.fewer(4), gauged.alone.other(4)

    assert said() == (False, False, False, False)
    with override_constant(LIMIT, LIMIT.value(2.0)):
        assert said() == (True, True, True, False)  # the last one has a constant of its own
        assert gauged.limits.UNUSED == 3
        late = importlib.import_module("gauged.late")
        assert late.LIMIT == 6
    assert said() == (False, False, False, False)
    assert late.LIMIT == 3


def test_a_constant_comes_back_after_an_error(gauged: Any) -> None:
    with pytest.raises(ZeroDivisionError), override_constant(LIMIT, 1):
        raise ZeroDivisionError
    assert gauged.limits.LIMIT == gauged.between.MOST == gauged.after.MOST == 3


@pytest.mark.parametrize(
    "source",
    [
        "from gauged.limits import LIMIT\nTWICE = 2 * LIMIT",
        "from gauged.limits import LIMIT\ndef far(x, than=LIMIT):\n    return x > than",
        "from gauged.limits import LIMIT as MOST\nclass Far:\n    than: int = MOST",
    ],
)
def test_a_value_that_went_into_something_else_is_refused(gauged: Any, tmp_path: Path, source: str) -> None:
    (tmp_path / "gauged" / "copied.py").write_text(source, encoding="utf-8")
    importlib.import_module("gauged.copied")
    with pytest.raises(ValueError, match=r"gauged\.limits\.LIMIT cannot be changed: line \d of gauged\.copied"):
        holders("gauged.limits", "LIMIT")


def test_indistinguishable_decides_whether_two_answers_are_alike() -> None:
    a, b = (SimpleNamespace(effects=(1,), cost=cost, validation_chi2=0.0, discrepancy=1.0) for cost in (100.0, 115.0))
    assert not model_comparison.is_indistinguishable(a, b)  # type: ignore[arg-type]
    with override_constant(BY_KEY["criterion.INDISTINGUISHABLE"], 20.0):
        assert model_comparison.is_indistinguishable(a, b)  # type: ignore[arg-type]
    assert not model_comparison.is_indistinguishable(a, b)  # type: ignore[arg-type]


def test_constants_of_the_package_change_where_they_were_copied_and_nowhere_else() -> None:
    with override_constant(BY_KEY["criterion.LEVEL"], 0.5), override_constant(BY_KEY["criterion.SHARE"], 0.25):
        assert forward_selection.LEVEL == 0.5 and score_test.LEVEL == 0.5
        assert criterion.SHARE == forward_selection.SHARE == 0.25 and intervals.ACCURACY == 0.05
    with override_constant(BY_KEY["criterion.LARGE"], 7.0):
        assert prior_conflicts.LARGE == verdict.LARGE == 7.0
    assert prior_conflicts.LARGE == verdict.LARGE == 2.0


def test_every_constant_of_the_list_is_there_and_can_be_changed() -> None:
    assert chosen(None) == list(CONSTANTS)
    assert len({each.key for each in CONSTANTS}) == len(CONSTANTS)
    assert chosen("criterion.SHARE") == chosen("SHARE") == [BY_KEY["criterion.SHARE"]]


def test_values_at_half_and_twice(gauged: Any) -> None:
    gauged.limits.ONE, gauged.limits.SHARE = 1, 0.8
    of = {name: Constant("gauged.limits", name, "") for name in ("LIMIT", "ONE")}
    of |= {"SHARE": Constant("gauged.limits", "SHARE", "", most=1.0)}
    found = {name: [each.value(factor) for factor in (0.5, 1.0, 2.0)] for name, each in of.items()}
    assert found["LIMIT"] == [2, 3, 6] and found["ONE"] == [1, 1, 2] and isinstance(found["LIMIT"][0], int)
    assert found["SHARE"] == [0.4, 0.8, 1.0]


@pytest.mark.parametrize(
    ("constant", "words"),
    [
        (Constant("gauged.limits", "GONE", ""), "gauged.limits has no GONE; edit CONSTANTS"),
        (Constant("gauged.limits", "near", ""), "gauged.limits has no number near"),
        (Constant("gauged.gone", "LIMIT", ""), "there is no module gauged.gone; edit CONSTANTS"),
    ],
)
def test_a_name_that_is_gone_is_an_error(
    gauged: Any, constant: Constant, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(constants, "CONSTANTS", (constant,))
    assert command.main(["--seed", "7", "--cases", "1"]) == 2
    assert words in capsys.readouterr().err


def test_a_constant_that_is_not_in_the_list_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--only", "nothing.SUCH"]) == 2
    assert "there is no constant nothing.SUCH" in capsys.readouterr().err


# --- settings -------------------------------------------------------------------------------------------------------


def test_settings_are_all_cases_at_half_and_twice_and_once_as_they_are() -> None:
    constant = BY_KEY["criterion.LARGE"]
    found = settings.variations([constant], [10000, 20000])
    keys = [(each.key, each.factor) for each in found]
    assert keys == [("", 1.0)] * 2 + [(constant.key, 0.5)] * 2 + [(constant.key, 2.0)] * 2
    assert len(set(found)) == 6


def test_more_cases_hold_the_first_ones() -> None:
    small, large = settings.numbers(12), settings.numbers(48)
    assert set(small) < set(large) and len(set(large)) == 48


def test_what_is_kept_is_read_again_for_the_same_package(tmp_path: Path) -> None:
    first, second = ended(), ended("criterion.LARGE", 0.5, value=1.0, right=False)
    for each in (first, ended(number=1, source="before"), second):
        settings.append_outcome(each, tmp_path)
    with (tmp_path / settings.OUTCOMES).open("a") as file:
        file.write('{"key": "conf')  # a process was killed
    settings.append_outcome(third := ended(number=2), tmp_path)
    known = settings.read_outcomes(tmp_path, "now")
    assert list(known.values()) == [first, second, third]
    assert known[Variation("criterion.LARGE", 0.5, 20000)] == second
    assert not settings.read_outcomes(tmp_path / "nowhere", "now")


def test_false_names_are_those_that_are_not_there() -> None:
    creep = Answer("c", "single", {"creep": {}}, {"creep": ("sensor_drift",)}, {"creep": 5.0}, 1e-8, 1e-4)
    found = Diagnosed("effects-found", ("creep", "mains_hum"), (), 1e-8, 1e-8, {}, 1.0)
    assert settings.false_names(creep, found) == 1
    assert settings.false_names(creep, replace(found, named=("creep",), groups=(("creep", "sensor_drift"),))) == 0
    assert settings.false_names(Answer("c", "none", {}, {}, {}, 1e-8, 1e-4), found) == 2
    outside = Answer("c", "outside", {"contact_spring": {}}, {}, {"contact_spring": 5.0}, 1e-8, 1e-4)
    right = replace(found, named=("preload_loss",), remainder=1e-8)
    assert settings.false_names(outside, right) == 0
    assert settings.false_names(outside, replace(right, named=("creep",))) == 1


# --- the report -----------------------------------------------------------------------------------------------------


def test_the_report_counts_each_setting_and_names_what_changes(tmp_path: Path) -> None:
    key = "criterion.LARGE"
    every = [
        ended(),
        ended(number=10000),
        ended(key, 0.5, value=1.0),
        ended(key, 0.5, 10000, value=1.0, right=False, false_names=1, said="nothing -> payload"),
        ended(key, 2.0, value=4.0),
    ]
    cells = report.row(BY_KEY[key], every)
    assert cells[:2] == [key, "1 / 2 / 4"]
    assert cells[3:] == ["1 of 2", "2 of 2", "1 of 1", "1", "0", "0"]
    (change,) = report.changed_verdicts(every)
    assert change[:3] == [key, "1", "10000"] and change[4] == "wrong: nothing -> payload"
    (line,) = report.write(every, [BY_KEY[key]], tmp_path, 7)
    assert line.startswith(key)
    text = (tmp_path / "report.md").read_text(encoding="utf-8")
    assert "2 cases" in text and "1 of 3 diagnoses" in text


# --- the page -------------------------------------------------------------------------------------------------------


def test_the_page_of_rules_states_every_constant_with_its_value() -> None:
    page = (Path(__file__).parents[1] / "docs" / "diagnosis_rules.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| [^|]+ \| `([^`]+)` \| ([\d.]+) \|$", page, re.M))
    assert {key: float(value) for key, value in rows.items()} == {each.key: each.value() for each in CONSTANTS}
    explained = page.partition("## Which effect is added")[2]
    assert not [each.name for each in CONSTANTS if f"`{each.name}`" not in explained]

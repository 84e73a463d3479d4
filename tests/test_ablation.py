"""The ablation study: how a part is switched off, when it is said to act, what is kept, and the table."""

from __future__ import annotations

import json
import math
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from flexdesign.diagnosis import procedure
from flexdesign.estimation.model_selection import (
    fitted_model,
    forward_selection,
    model_comparison,
    stepwise_selection,
)
from studies.ablation import __main__ as command
from studies.ablation import ablation, parts, recordings, report
from studies.ablation.ablation import Ablation
from studies.ablation.parts import PARTS, switched_off, watching
from studies.hidden_effect_trial import trial
from studies.hidden_effect_trial.folder import Answer
from studies.hidden_effect_trial.scoring import Diagnosed
from studies.hidden_effect_trial.trial import Outcome
from studies.real_recordings.__main__ import Recording

BY_KEY = {part.key: part for part in PARTS}


def outcome(number: int, *named: str, seconds: float = 2.0, hits: tuple[bool, ...] = (True,)) -> Outcome:
    answer = Answer(f"single-{number}", "single", {"creep": {"share": 0.1}}, {}, {"creep": 2.0}, 1e-9, 1e-4)
    inside = {f"creep.{k}": (hit, 0.1) for k, hit in enumerate(hits)}
    found = Diagnosed("effects-found", named, (), 1e-9, 1.1e-9 * len(named), inside, seconds)
    return Outcome(number, answer, found, "", trial.source())


# --- parts ----------------------------------------------------------------------------------------------------------


def test_every_part_is_there_and_comes_back() -> None:
    assert parts.chosen(None) == list(PARTS) and len(BY_KEY) == len(PARTS)
    before = procedure.escape, forward_selection.escape, fitted_model.escape
    assert len({*before}) == 1
    with switched_off(BY_KEY["escape"]):
        assert procedure.escape is forward_selection.escape is fitted_model.escape
        assert procedure.escape("task", "fit") == "fit"  # type: ignore[arg-type, comparison-overlap]
    assert before == (procedure.escape, forward_selection.escape, fitted_model.escape)


def test_a_part_comes_back_after_an_error() -> None:
    before = fitted_model.FittedModel.discrepancy
    with pytest.raises(ZeroDivisionError), switched_off(BY_KEY["FittedModel.discrepancy"]):
        assert object.__new__(fitted_model.FittedModel).discrepancy == 1.0
        raise ZeroDivisionError
    assert fitted_model.FittedModel.discrepancy is before


def test_a_part_acts_where_it_returns_something_else_than_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_comparison, "score_of_columns", lambda *_: 7.0)
    records = SimpleNamespace(problem=SimpleNamespace(dataset=SimpleNamespace(records=[])))
    fit: Any = SimpleNamespace(solution=records, model=None)
    without: Any = SimpleNamespace(trace=None)
    sinusoid: Any = SimpleNamespace(trace=lambda model, observation: None)
    with watching() as acted:
        assert model_comparison._trace(fit, fit, without) == math.inf
    assert acted == set()
    with watching() as acted:
        assert model_comparison._trace(fit, fit, sinusoid) == 7.0
    assert acted == {"trace"}


def test_a_result_that_is_handed_through_is_no_act() -> None:
    fit: Any = SimpleNamespace(effects=(), names=())
    with watching() as acted:
        assert stepwise_selection.backward(SimpleNamespace(), fit, []) is fit  # type: ignore[arg-type]
    assert acted == set()


def test_a_part_that_is_not_in_the_list_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--only", "gone"]) == 2
    assert "there is no part gone; parts: escape" in capsys.readouterr().err


# --- running --------------------------------------------------------------------------------------------------------


def test_a_part_is_switched_off_only_where_it_acted_and_nothing_is_done_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = list[tuple[str, int]]()

    def watched(number: int, *_: Any) -> tuple[Outcome, frozenset[str]]:
        asked.append(("", number))
        return outcome(number, "creep"), frozenset({"escape"} if number > 20001 else {"modes"})

    def without(key: str, number: int, *_: Any) -> Outcome:
        asked.append((key, number))
        return outcome(number)

    monkeypatch.setattr(trial, "ProcessPoolExecutor", _Here)
    monkeypatch.setattr(ablation, "as_completed", list)
    monkeypatch.setattr(ablation, "diagnose_watched", watched)
    monkeypatch.setattr(ablation, "diagnose_without", without)
    chosen = [BY_KEY["escape"], BY_KEY["modes"], BY_KEY["backward"]]
    for _ in range(2):
        with (tmp_path / "acted.jsonl").open("a") as file:
            file.write('{"number": 2')  # as a killed process leaves it
        found = ablation.run([20001, 20002, 20003], chosen, 1, tmp_path, 1, trial.cases.SEED, lambda _: None)
    assert asked == [("", 20001), ("", 20002), ("", 20003), ("escape", 20002), ("modes", 20001)]
    assert {key: list(made) for key, made in found.without.items()} == {
        "escape": [20002],
        "modes": [20001],
        "backward": [],
    }
    assert json.loads((tmp_path / "acted.jsonl").read_text().splitlines()[1])["acted"] == ["modes"]


class _Here:
    """A pool that works at once, in this process."""

    def __init__(self, *_: Any, **__: Any) -> None: ...

    def __enter__(self) -> _Here:
        return self

    def __exit__(self, *_: object) -> None: ...

    def submit(self, function: Any, *given: Any) -> Future[Any]:
        done = Future[Any]()
        done.set_result(function(*given))
        return done


# --- the table ------------------------------------------------------------------------------------------------------


def test_the_row_of_a_part_counts_what_changes(tmp_path: Path) -> None:
    as_is = {n: outcome(n, "creep", hits=(True, True)) for n in (20001, 20002, 20003)}
    without = {
        20001: outcome(20001, "creep", seconds=1.0, hits=(True, False)),
        20002: outcome(20002, "creep", "mains_hum", seconds=4.0, hits=(False, False)),
    }
    acted = {20001: frozenset({"escape"}), 20002: frozenset({"escape"}), 20003: frozenset[str]()}
    found = Ablation(as_is, acted, {"escape": without})
    cells = report.row(BY_KEY["escape"], found)
    assert cells[2:8] == ["2 of 3", "2", "2", "1", "4 of 4", "1 of 4"]
    assert cells[8:] == ["1.5"]
    (change,) = report.changed_answers("escape", found)
    assert change[1] == "20002" and change[3] == "wrong: effects-found: creep and mains_hum"
    (line,) = report.write(found, [BY_KEY["escape"]], tmp_path, 7)
    assert line.startswith("escape  2 of 3") and (tmp_path / "report.html").is_file()


# --- recordings of others -------------------------------------------------------------------------------------------


def test_recordings_are_diagnosed_without_the_parts_that_act(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "data" / "piezo-loops").mkdir(parents=True)
    asked = list[str]()

    def answered(recording: Recording, _: Path, without: str = "") -> recordings.Answer:
        asked.append(without)
        error = {"escape": 2e-9, "modes": 1.005e-9}.get(without, 1e-9)
        acted = () if without else ("escape", "modes", "backward")
        return recordings.Answer(recording.title, without, "creep", error, f"{1e9 * error:.3g} nm", 1.0, acted)

    monkeypatch.setattr(trial, "ProcessPoolExecutor", _Here)
    monkeypatch.setattr(recordings, "as_completed", list)
    monkeypatch.setattr(recordings, "answer", answered)
    monkeypatch.setattr(parts, "PARTS", tuple(BY_KEY[key] for key in ("escape", "modes", "choose")))
    for _ in range(2):
        assert command.main(["--recordings", str(tmp_path / "data"), "--out", str(tmp_path)]) == 0
    assert asked == ["", "escape", "modes"]
    printed = capsys.readouterr().out.splitlines()
    assert printed[:4] == ["all parts  creep, 1 nm", "escape  creep, 2 nm", "modes  same", "choose  –"]
    assert "| escape | restarts" in (tmp_path / "recordings" / "report.md").read_text()


def test_a_folder_without_recordings_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--recordings", str(tmp_path)]) == 2
    assert "holds none of positioning-drive" in capsys.readouterr().err

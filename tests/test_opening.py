"""Long recordings: what is searched first is the opening of each run, and the answer is that of all of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexdesign import stage_model
from flexdesign.diagnosis import diagnose, opening
from flexdesign.diagnosis.setting import Setting, settle
from flexdesign.evidence.local_minima import BETTER
from flexdesign.runs import Run, read_runs
from flexdesign.stage_model import StageModel

ROOT = Path(__file__).parents[1]
DEMO = ROOT / "studies" / "hidden_effect_demo"
KEPT = json.loads((ROOT / "reports" / "examples" / "hidden_effect_demo" / "result.json").read_text())


def demo() -> tuple[StageModel, tuple[Run, ...]]:
    return stage_model.read(str(DEMO / "model.toml"), []), read_runs([DEMO / "runs"])


def long(monkeypatch: pytest.MonkeyPatch, enough: int) -> Setting:
    """Take recordings for long ones that are longer than so many values in all."""
    monkeypatch.setattr(opening, "ENOUGH", enough)
    monkeypatch.setattr(opening, "LONG", enough)
    return settle(*demo(), None, None)


def test_short_recordings_are_searched_whole() -> None:
    setting = settle(*demo(), None, None)
    assert sum(len(run.time) for run in setting.runs) < opening.LONG
    assert opening.opening(setting) is None


def test_recordings_of_unknown_noise_are_searched_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    # A share of what is unexplained is another one in a part of the runs: beside the cubic stiffness of a real
    # oscillator its opening showed a hysteresis which the whole recordings have no need of.
    setting = long(monkeypatch, 6_000)
    assert opening.opening(setting) is not None
    assert opening.opening(replace(setting, noise=replace(setting.noise, known=False))) is None


def test_runs_are_cut_at_one_length_and_short_ones_stay_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    setting = long(monkeypatch, 10_000)
    short = opening.opening(setting)
    assert short is not None
    lengths = [len(run.time) for run in short.runs]
    assert 10_000 - len(lengths) < sum(lengths) <= 10_000
    cut = max(lengths)
    for whole, part in zip(setting.runs, short.runs, strict=True):
        n = min(len(whole.time), cut)
        assert np.array_equal(part.time, whole.time[:n]) and np.array_equal(part.command(), whole.command()[:n])
        assert (part.name, part.role) == (whole.name, whole.role)


def test_a_run_that_begins_with_a_gap_is_cut_behind_it(monkeypatch: pytest.MonkeyPatch) -> None:
    setting = long(monkeypatch, 6_000)
    gone = setting.runs[0].measured().copy()
    gone[:1_400] = np.nan
    (name,) = setting.runs[0].responses
    late = replace(setting.runs[0], columns={**setting.runs[0].columns, name: gone})
    short = opening.opening(replace(setting, runs=(late, *setting.runs[1:])))
    assert short is not None and np.isfinite(short.runs[0].measured()).any()


def test_what_the_openings_show_is_fitted_to_the_whole_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    long(monkeypatch, 6_000)
    model, runs = demo()
    said = list[str]()
    found = diagnose(model, runs, progress=said.append)
    assert "searching in the opening of each run" in said
    whole = said.index("fitting with stress_stiffening, the whole runs")
    # With it the openings leave but noise; what is fainter is asked of all.
    assert "screening beside stress_stiffening" in said[whole:]
    assert "screening beside stress_stiffening" not in said[:whole]
    # Whatever way the search goes, the answer is where the fit of all runs ends.
    assert found.verdict == KEPT["verdict"]
    (effect,), (kept,) = found.effects, KEPT["effects"]
    (value,), (expected,) = effect.values, kept["parameters"]
    low, high = expected["interval"]
    assert effect.name == kept["name"]
    assert value.value == pytest.approx(expected["value"], abs=0.05 * (high - low))
    assert value.interval == pytest.approx((low, high), abs=0.05 * (high - low))
    # A validation run begins elsewhere only where that lowers its squares by two percent (`local_minima.BETTER`).
    assert found.validation_error == pytest.approx(KEPT["validation_error"]["value"], rel=1 - BETTER)
    assert [rung.label for rung in found.ladder] == [rung["label"] for rung in KEPT["ladder"]]

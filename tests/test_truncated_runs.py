"""Long recordings: their first part is searched first, and what it shows is confirmed by the whole runs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexdesign.diagnosis import diagnose, procedure
from flexdesign.diagnosis.preparation import dataset
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, prepare
from flexdesign.dynamics import stage_model
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.least_squares.multistart import OTHER_MINIMUM
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.forward_selection import forward
from flexdesign.estimation.model_selection.model_comparison import Step
from flexdesign.measurements.recordings import Run, read_runs
from tests.estimation.sums import NAMES, calibrated_stand, candidate, effects, task

ROOT = Path(__file__).parents[1]
DEMO = ROOT / "studies" / "hidden_effect_demo"
KEPT = json.loads((ROOT / "reports" / "examples" / "hidden_effect_demo" / "result.json").read_text())


def demo() -> tuple[StageModel, tuple[Run, ...]]:
    return stage_model.read(str(DEMO / "model.toml"), []), read_runs([DEMO / "runs"])


def long(monkeypatch: pytest.MonkeyPatch, enough: int) -> DiagnosisData:
    """Take recordings for long ones that are longer than so many values in all."""
    monkeypatch.setattr(dataset, "SAMPLES_SEARCHED", enough)
    monkeypatch.setattr(dataset, "LONG_RUNS", enough)
    return prepare(*demo(), None, None)


def test_short_recordings_are_searched_whole() -> None:
    data = prepare(*demo(), None, None)
    assert sum(len(run.time) for run in data.runs) < dataset.LONG_RUNS
    assert not dataset.is_long(data)


def test_recordings_of_unknown_noise_are_searched_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    # A share of what is unexplained is another one in a part of the runs: beside the cubic stiffness of a real
    # oscillator its opening showed a hysteresis which the whole recordings have no need of.
    data = long(monkeypatch, 6_000)
    assert dataset.is_long(data)
    assert not dataset.is_long(replace(data, noise=replace(data.noise, known=False)))


def test_runs_are_cut_at_one_length_and_short_ones_stay_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    data = long(monkeypatch, 10_000)
    short = dataset.first_part(data)
    lengths = [len(run.time) for run in short.runs]
    assert 10_000 - len(lengths) < sum(lengths) <= 10_000
    cut = max(lengths)
    for whole, part in zip(data.runs, short.runs, strict=True):
        n = min(len(whole.time), cut)
        assert np.array_equal(part.time, whole.time[:n]) and np.array_equal(part.command(), whole.command()[:n])
        assert (part.name, part.role) == (whole.name, whole.role)


@pytest.mark.parametrize(
    ("lengths", "enough", "cut"),
    [
        ([1_000, 30_000, 30_000], 21_000, 10_000),
        ([30_000, 1_000, 30_000], 21_000, 10_000),
        ([10_000, 10_000, 10_000], 12_000, 4_000),
        ([1_000, 2_000, 60_000], 12_000, 9_000),
        ([1_000, 1_000, 1_000], 12_000, 1_000),
        ([40_000], 12_000, 12_000),
        ([5, 5, 5], 2, 1),
    ],
)
def test_all_runs_are_cut_at_the_same_length(
    lengths: list[int], enough: int, cut: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that as many values are left as are searched: short runs give what is theirs to longer ones."""
    monkeypatch.setattr(dataset, "SAMPLES_SEARCHED", enough)
    monkeypatch.setattr(dataset, "LONG_RUNS", 0)
    about = prepare(*demo(), None, None)
    (name,) = about.runs[0].responses
    runs = [
        Run(f"run{k}", np.arange(float(n)), {"u": np.zeros(n), name: np.zeros(n)}, {"u": "V", name: "m"}, "hold")
        for k, n in enumerate(lengths)
    ]
    short = dataset.first_part(replace(about, runs=tuple(runs)))
    assert [len(run.time) for run in short.runs] == [min(n, max(cut, 2)) for n in lengths]


def test_a_run_that_begins_with_a_gap_is_cut_behind_it(monkeypatch: pytest.MonkeyPatch) -> None:
    data = long(monkeypatch, 6_000)
    gone = data.runs[0].measured().copy()
    gone[:1_400] = np.nan
    (name,) = data.runs[0].responses
    late = replace(data.runs[0], columns={**data.runs[0].columns, name: gone})
    short = dataset.first_part(replace(data, runs=(late, *data.runs[1:])))
    assert np.isfinite(short.runs[0].measured()).any()


@pytest.mark.slow
def test_what_the_openings_show_is_fitted_to_the_whole_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    long(monkeypatch, 6_000)
    model, runs = demo()
    said = list[str]()
    found = diagnose(model, runs, progress=said.append)
    first, whole = (
        said.index(words)
        for words in ("searching in the first part of each run", "fitting with stress_stiffening, the whole runs")
    )
    # The catalogue is screened in the first part alone; what is fainter is asked of all.
    assert said.index("screening the catalogue") in range(first, whole)
    assert "screening the catalogue" not in said[whole:]
    assert "screening with stress_stiffening" in said[whole:]
    # Whatever way the search goes, the answer is where the fit of all runs ends.
    assert found.verdict == KEPT["verdict"]
    (effect,), (kept,) = found.effects, KEPT["effects"]
    (value,), (expected,) = effect.values, kept["parameters"]
    low, high = expected["interval"]
    assert effect.name == kept["name"]
    assert value.value == pytest.approx(expected["value"], abs=0.05 * (high - low))
    assert value.interval == pytest.approx((low, high), abs=0.05 * (high - low))
    # A run begins elsewhere only where that lowers its squares by two percent (`multistart.OTHER_MINIMUM`).
    assert found.validation_error == pytest.approx(KEPT["validation_error"]["value"], rel=1 - OTHER_MINIMUM)
    assert [rung.label for rung in found.error_ladder] == [rung["label"] for rung in KEPT["ladder"]]


# --- what the first part showed, asked of the whole runs -------------------------------------------------------------


def confirmed(about: EstimationTask, steps: list[Step]) -> tuple[list[Step], list[FittedModel]]:
    return procedure._confirm(about, calibrated_stand(about), steps)


def test_what_a_part_of_the_runs_chose_is_confirmed_by_all_of_them() -> None:
    about = task({"d": 0.3})
    part = replace(about, identify=about.identify.part(NAMES[:2]))
    seen, right = (forward(each, calibrated_stand(each), effects()) for each in (part, about))
    (step,), (made,) = confirmed(about, [seen, Step(None, ())])
    assert step.chosen is not None and right.chosen is not None
    assert step.chosen.names == made.names == ("d",)
    # Of all runs: the same fit as that of a search in all of them, to a fraction of what one value of noise costs.
    assert step.chosen.gain == pytest.approx(right.chosen.gain, abs=0.05)
    assert step.chosen.error == pytest.approx(right.chosen.error, rel=1e-4)
    assert step.trials == seen.trials


def test_what_a_part_of_the_runs_chose_is_refused_where_the_others_know_better() -> None:
    part, whole = task({"d": 0.3}), task({}, seed=1)
    seen = forward(part, calibrated_stand(part), effects())
    assert seen.chosen is not None and seen.chosen.names == ("d",)
    assert confirmed(whole, [seen]) == ([], [])
    assert confirmed(whole, [forward(whole, calibrated_stand(whole), effects())]) == ([], [])


def test_a_part_is_believed_up_to_its_first_refused_step() -> None:
    """Two effects of the part, one after the other, of which the whole runs have the first, the second, or both."""
    part = task({"b": 0.4, "d": 0.3})
    one, other = (candidate(name, signed=True) for name in "bd")
    first = forward(part, calibrated_stand(part), [one])
    assert first.chosen is not None
    steps = [first, forward(part, first.chosen.fit, [other])]
    assert [step.chosen.names for step in steps if step.chosen] == [("b",), ("d",)]
    for truth, names in (({"b": 0.4, "d": 0.3}, ["b", "d"]), ({"b": 0.4}, ["b"]), ({"d": 0.3}, [])):
        found, stands = confirmed(task(truth, seed=1), steps)
        assert [name for step in found for name in step.chosen.names] == names  # type: ignore[union-attr]
        assert [fit.names for fit in stands] == [tuple(names[: k + 1]) for k in range(len(names))]

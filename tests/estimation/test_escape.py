"""How often fits of a play operator miss the global minimum, which differential evolution finds."""

from __future__ import annotations

import dataclasses
import math
from functools import cache
from typing import Any

import numpy as np
import pytest

from flexdesign.core.model import parameter_of
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.model_selection import fitted_model
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import escape, fit_model
from flexdesign.estimation.model_selection.model_comparison import compare
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.model_selection.stepwise_selection import restart_without
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.play_problems import SEEDS, problem
from tests.estimation.sums import Sum, as_sum, offset, strength
from tests.estimation.toys import Array, Run, parameter

#: A minimum is missed if chi^2 is larger by this.
MISSED = 2.0


@cache
def ends(sigma: float) -> Array:
    """Chi^2 less that of the global minimum, after one fit and after `escape`; and the escaped threshold.

    Seeds by these three; the threshold is over the best one.
    """
    found = []
    for seed in range(SEEDS):
        about = problem(seed, sigma)
        least, threshold = about.least(seed)
        once = fit_model(about.task, about.model, (about.effect,))
        assert once is not None
        last = escape(about.task, once)
        reached = last.solution.problem.where.values(last.solution.x)["r"]
        found.append([once.cost - least, last.cost - least, reached / threshold])
    return np.array(found)


@pytest.mark.parametrize("sigma", [0.05, 0.01])
def test_fits_that_escape_miss_one_global_minimum_in_five_at_most(sigma: float) -> None:
    """Of these twenty three are missed with noise of a tenth of the effect, and four with a fiftieth.

    One fit from the same start misses a third to a half of them.
    """
    found = ends(sigma)
    assert found[:, :2].min() > -1e-3  # no fit is better than the reference
    once, escaped = (found[:, :2] > MISSED).sum(axis=0)
    assert once >= SEEDS / 3  # else the problems are too easy to tell anything
    assert escaped <= SEEDS / 5
    assert escaped < once


@pytest.mark.parametrize("sigma", [0.05, 0.01])
def test_a_miss_leaves_the_threshold_near_its_best(sigma: float) -> None:
    """A fit in a local minimum is in the one beside the global minimum, less than a tenth away."""
    assert np.all(np.abs(np.log(ends(sigma)[:, 2])) < math.log(1.1))


def test_a_search_over_thresholds_ends_at_the_plausible_range_where_every_step_is_better(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    about = problem(0, 0.05)
    fit = fit_model(about.task, about.model, (about.effect,))
    assert fit is not None
    tried = list[float]()

    def always_better(task: EstimationTask, model: Any, *_: Any, **__: Any) -> Any:
        tried.append(next(p.start for p in model.parameters() if p.name == "r") or 0.0)
        return dataclasses.replace(fit.solution, cost=fit.cost - 1e3 * len(tried))

    monkeypatch.setattr(fitted_model, "solve_case", always_better)
    monkeypatch.setattr(fitted_model, "search_initial_states", lambda task, dataset, model: model)
    monkeypatch.setattr(fitted_model, "fit_model", lambda *_, **__: None)
    escape(about.task, fit)
    start, (low, high) = parameter_of(fit.model, "r").start or 0.0, parameter_of(fit.model, "r").plausible
    factors = [1.1**2**k for k in range(12)]
    up, down = ([f * start for f in fs if low < f * start < high] for fs in (factors, [1 / f for f in factors]))
    assert tried == pytest.approx([*up, *down])


def test_restarts_are_repeated_until_none_lowers_the_cost(monkeypatch: pytest.MonkeyPatch) -> None:
    about, calls = problem(0, 0.05), list[float]()
    fit = fit_model(about.task, about.model, (about.effect,))
    assert fit is not None

    def elsewhere(task: EstimationTask, dataset: Dataset, model: Any) -> Any:
        calls.append(0.0)
        return model.replace({}) if len(calls) < 4 else model

    def better(*_: Any, **__: Any) -> Any:
        lower = fit.cost - 1e3 * min(len(calls), 2)  # the third is no better
        return dataclasses.replace(fit, solution=dataclasses.replace(fit.solution, cost=lower))

    monkeypatch.setattr(fitted_model, "search_initial_states", elsewhere)
    monkeypatch.setattr(fitted_model, "fit_model", better)
    monkeypatch.setattr(fitted_model, "_search_threshold", lambda *_: None)
    assert escape(about.task, fit).cost == fit.cost - 2e3
    assert len(calls) == 3


def test_a_refused_effect_may_show_a_better_minimum_of_the_other_parameters() -> None:
    """A sine has a local minimum at every beat. A slope, which is not there, is fitted next to the right frequency."""
    t, sigma = np.arange(200) / 200, 0.01
    rng = np.random.default_rng(0)

    def sine(v: Any, run: Run) -> Any:
        return v["p"] * np.sin(2 * np.pi * v["f"] * run.t)

    def dataset(name: str) -> Dataset:
        return Dataset(
            [Run(name, t, 2 * np.sin(2 * np.pi * 3.1 * t) + sigma * rng.standard_normal(len(t)))],
            ColouredNoise(Process.white(sigma)),
            offset,
        )

    model = Sum().plus(sine, strength("p"), parameter("f", 5.3, 1.0, 10.0, scale="log"))
    slope = Candidate(
        "slope", lambda of: as_sum(of).plus(lambda v, run: v["s"] * run.t, strength("s")), "s", ("s",), ({"s": 0.1},)
    )
    task = EstimationTask(dataset("a"), dataset("b"), ("p", "f"), lambda _: {}, lambda _: model, 1e-3)
    astray = fit_model(task, model)
    right, wrong = (fit_model(task, slope.add(model.replace({"f": f})), (slope,)) for f in (3.3, 5.3))
    assert astray is not None and right is not None and wrong is not None
    refused = compare(task, astray, right, ("slope",), 10.0)
    assert refused.gain > refused.critical_gain and refused.reason
    found = restart_without(task, astray, [refused])
    assert found.solution.problem.where.values(found.solution.x)["f"] == pytest.approx(3.1, rel=1e-3)
    assert restart_without(task, astray, [compare(task, astray, wrong, ("slope",), 10.0)]) is astray
    assert restart_without(task, astray, []) is astray

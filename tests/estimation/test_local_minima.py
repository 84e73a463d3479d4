"""Local minima: initial states on a grid, of fitted and of validation runs."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from flexdesign.core.model import Model
from flexdesign.estimation.criterion import SHARE
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import SMALL_REDUCTION, Effort
from flexdesign.estimation.model_selection.estimation_task import (
    EstimationTask,
    fit_initial_states,
    grid_initial_states,
    search_initial_states,
)
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    escape,
    fit_model,
    solve_case,
)
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.sums import NAMES, N, Sum, base, column, least, offset
from tests.estimation.toys import Array, Run, parameter

SIGMA = 0.1
HELD = ("kept", "apart")
#: Where each run truly began; the model thinks all began at zero, where a fit of "two" and "apart" ends at 0.06.
TRUTH = {"one": 0.05, "two": 0.82, "three": 0.02, "kept": 0.04, "apart": 0.81}


def ripple(turn: float) -> float:
    """It rises to 1.06 near 0.06, falls, and rises again to more, so that a fit that begins at zero stays there."""
    return math.sin(8 * math.pi * turn) + turn


def from_turn(v: Mapping[str, float], run: Any) -> Array:
    return np.asarray(ripple(v[f"{run.name}:turn"]) * column(run, "start"))


def model() -> Sum:
    screen = (0.0, 0.3, 0.6, 0.9)
    own = [parameter(f"{n}:turn", 0.0, -0.1, 1.0, run=n, screen=screen) for n in TRUTH]
    return base("p", "q").plus(from_turn, *own)


def dataset(names: Sequence[str], more: Mapping[str, float] | None = None) -> Dataset:
    truth = model().replace({"p": 2.0, "q": -1.0, **{f"{n}:turn": turn for n, turn in TRUTH.items()}})
    rng = np.random.default_rng(len(names))

    def data(run: Any) -> Array:
        added = sum((amount * column(run, c) for c, amount in (more or {}).items()), start=np.zeros(N))
        return np.asarray(truth.predict(run) + added + SIGMA * rng.standard_normal(N))

    blank = [Run(name, np.arange(N) / N, None) for name in names]
    return Dataset(
        [dataclasses.replace(run, data=data(run)) for run in blank], ColouredNoise(Process.white(SIGMA)), offset
    )


def about(more: Mapping[str, float] | None = None) -> EstimationTask:
    return EstimationTask(dataset(NAMES, more), dataset(HELD, more), ("p", "q"), lambda _: {}, lambda _: model(), 1e-3)


def turns_of(model: Model) -> dict[str, float]:
    return {p.run: p.start or 0.0 for p in model.parameters() if p.run}


def turns(fit: FittedModel) -> dict[str, float]:
    return turns_of(fit.model)


def test_a_stage_that_was_never_driven_is_among_the_states() -> None:
    """Zero is no point of the grid, and no fit leads there from the present state."""
    own = parameter("one:turn", 0.9, -0.1, 1.0, run="one", screen=(0.3, 0.6, 0.9))
    present = base("p", "q").plus(from_turn, own)
    blank = Run("one", np.arange(N) / N, None)
    truth = present.replace({"one:turn": 0.0})
    measured = Dataset(
        [dataclasses.replace(blank, data=truth.predict(blank))], ColouredNoise(Process.white(SIGMA)), offset
    )
    assert turns_of(grid_initial_states(measured, present)) == {"one": 0.0}


def test_a_part_of_a_suite_has_the_records_of_the_whole() -> None:
    whole = dataset(NAMES)
    part = whole.part(["three", "one"])
    assert part.names == ["one", "three"] and whole.names == list(NAMES)
    assert part.records == (whole.records[0], whole.records[2])
    assert part.samples == 2 * N


def begun() -> Sum:
    """All numbers are right but where the run "two" began: it stays in the wrong minimum."""
    return model().replace({"p": 2.0, "q": -1.0, "one:turn": 0.05, "three:turn": 0.02})


def test_a_run_in_a_wrong_minimum_begins_elsewhere() -> None:
    """Only its own number moves: of the others no point of the grid is better by the share that counts."""
    task, start = about(), begun()
    found = turns_of(search_initial_states(task, task.identify, start))
    # The ripple is known to SIGMA over the root of N.
    assert ripple(found.pop("two")) == pytest.approx(ripple(0.82), abs=0.05)
    assert found == {run: turn for run, turn in turns_of(start).items() if run != "two"}
    assert search_initial_states(task, task.identify.part(["one", "three"]), start) is start


def test_without_a_fit_the_best_point_of_the_grid_is_taken() -> None:
    task, start = about(), begun()
    found = turns_of(grid_initial_states(task.identify, start))
    # The ripple at the points 0, 0.3, 0.6 and 0.9, beside 0.82.
    nearest = min((0.0, 0.3, 0.6, 0.9), key=lambda turn: abs(ripple(turn) - ripple(0.82)))
    assert found == {**turns_of(start), "two": nearest}
    there = start.replace({"two:turn": 0.82})
    assert grid_initial_states(task.identify, there) is there  # no point is better


@pytest.mark.parametrize(("share", "moves"), [(1 - SHARE + 0.005, False), (1 - SHARE - 0.005, True)])
def test_a_run_moves_only_where_that_is_much_better(share: float, moves: bool) -> None:
    """At the point of the grid its sum of squares is this share of what it is where the run begins now.

    Data as long as the move m, of which they hold the part a: |d - m|^2 = (2 - 2 a) |m|^2.
    """
    turn = parameter("one:turn", 0.0, -1.0, 1.0, run="one", screen=(1.0,))
    toy = Sum().plus(lambda v, run: v["one:turn"] * column(run, "start"), turn)
    run = Run("one", np.arange(N) / N, np.zeros(N))
    basis = np.linalg.qr(np.column_stack([np.ones(N), column(run, "start"), column(run, "other")]))[0][:, 1:]
    length = float(basis[:, 0] @ column(run, "start"))
    part = 1 - share / 2
    data = length * basis @ [part, math.sqrt(1 - part**2)]
    whole = Dataset([dataclasses.replace(run, data=data)], ColouredNoise(Process.white(SIGMA)), offset)
    assert (grid_initial_states(whole, toy) is not toy) is moves


def test_numbers_without_a_grid_are_tried_as_they_are_in_the_median_run() -> None:
    """All runs are late by the same; at no delay no point of the grid would be better."""

    def late(v: Mapping[str, float], run: Any) -> Array:
        turn, angle = v[f"{run.name}:turn"], v[f"{run.name}:late"]
        return np.asarray(turn * (np.cos(angle) * column(run, "start") + np.sin(angle) * column(run, "late")))

    own = [parameter(f"{n}:turn", 1.0, -2.0, 2.0, run=n, screen=(-1.0, 1.0)) for n in NAMES]
    own += [parameter(f"{n}:late", 1.5, -4.0, 4.0, run=n) for n in NAMES]
    toy = Sum().plus(late, *own)
    truth = toy.replace({"two:turn": -1.0})
    observed = [Run(name, np.arange(N) / N, None) for name in NAMES]
    whole = Dataset(
        [dataclasses.replace(r, data=truth.predict(r)) for r in observed], ColouredNoise(Process.white(SIGMA)), offset
    )
    # Its delay went astray with its turn.
    found = grid_initial_states(whole, toy.replace({"two:late": 0.1}))
    assert {p.name: p.start for p in found.parameters()} == {p.name: p.start for p in truth.parameters()}


def test_a_run_is_fitted_alone_while_all_other_numbers_stay() -> None:
    """Its own amount of a column follows from linear algebra: that of what shared numbers leave, beside an offset."""
    own = [parameter(f"{n}:own", 0.0, -9.0, 9.0, run=n) for n in NAMES]
    start = base("p").plus(lambda v, run: v[f"{run.name}:own"] * column(run, "own"), *own).replace({"p": 0.7})
    rng = np.random.default_rng(0)
    observed = [Run(name, np.arange(N) / N, rng.standard_normal(N)) for name in NAMES]
    task = EstimationTask(
        Dataset(observed, ColouredNoise(Process.white(SIGMA)), offset),
        dataset([]),
        ("p",),
        lambda _: {},
        lambda _: start,
        1e-3,
    )
    for run in observed:
        made = fit_initial_states(task, task.identify.part([run.name]), start)
        assert made is not None
        misfit, found = made.misfit, made.problem.where.values(made.x)
        matrix = np.column_stack([column(run, "own"), np.ones(N)])
        left = run.data - 0.7 * column(run, "p")
        # No step is left that promises more than this.
        small = SMALL_REDUCTION * made.problem.dataset.discrepancy(made.residuals) * SIGMA**2
        assert misfit * SIGMA**2 == pytest.approx(least(matrix, left), abs=2 * small)
        assert set(found) == {f"{run.name}:own"}
        farthest = math.sqrt(2 * small / least(matrix[:, 1:], matrix[:, 0]))
        assert found[f"{run.name}:own"] == pytest.approx(np.linalg.lstsq(matrix, left)[0][0], abs=farthest)


def test_fits_go_on_no_further_than_is_asked() -> None:
    task, start = about(), model().replace({"p": 2.0, "q": -1.0})
    exact, rough = (solve_case(task, start, effort=Effort(20, share)) for share in (1e-6, 0.5))
    assert exact is not None and rough is not None
    assert exact.cost < rough.cost < 2 * exact.cost
    assert rough.problem.evaluations < exact.problem.evaluations


def test_a_fit_escapes_with_a_run_that_begins_elsewhere() -> None:
    task = about()
    caught = fit_model(task, model())
    assert caught is not None and 1.5 < caught.scale < 30
    found = escape(task, caught)
    assert found.scale == pytest.approx(1.0, abs=4 * math.sqrt(2 / (3 * N)))
    assert all(ripple(turn) == pytest.approx(ripple(TRUTH[run]), abs=0.05) for run, turn in turns(found).items())
    assert escape(task, found) is found


def test_validation_runs_begin_where_each_fits_best() -> None:
    """Both from zero: one is found from there, the other one from the grid."""
    task, right = about(), {"p": 2.0, "q": -1.0, **{f"{name}:turn": TRUTH[name] for name in NAMES}}
    found = fit_model(task, model().replace(right))
    assert found is not None
    assert found.validation_chi2 < 2 * N + 4 * math.sqrt(4 * N)
    assert ripple(turns(found)["apart"]) == pytest.approx(ripple(TRUTH["apart"]), abs=0.05)
    # Fitted from where the model begins it stays in the wrong minimum.
    made = fit_initial_states(task, task.validate, found.model.replace({"apart:turn": 0.0}))
    assert made is not None and made.cost > 1.5 * found.validation_chi2


def test_a_run_begins_where_it_fits_best() -> None:
    """The prediction hangs on the start of each run by a cosine, so that a fit of it ends in a local minimum."""

    def from_start(v: Mapping[str, float], run: Any) -> Array:
        return np.asarray(np.cos(2 * math.pi * v[f"{run.name}:turn"]) * column(run, "p"))

    screen = (0.1, 0.5, 0.9)
    own = [
        parameter(f"{n}:turn", start, 0.0, 1.0, run=n, screen=screen)
        for n, start in zip(NAMES, (0.0, 0.45, 0.9), strict=True)
    ]
    model = Sum().plus(from_start, *own)
    truth = model.replace({"one:turn": 0.5, "two:turn": 0.4, "three:turn": 0.9})
    observed = [Run(name, np.arange(N) / N, None) for name in NAMES]
    observed = [dataclasses.replace(run, data=truth.predict(run)) for run in observed]
    dataset = Dataset(observed, ColouredNoise(Process.white(SIGMA)), offset)
    begun = grid_initial_states(dataset, model)
    assert {p.name: p.start for p in begun.parameters()} == {"one:turn": 0.5, "two:turn": 0.45, "three:turn": 0.9}
    assert grid_initial_states(dataset, truth) is truth


def test_strong_data_do_not_tell_twins_apart() -> None:
    """A delay of all runs and one of each: their sum is known to 1e-7, the delay only as well as the others' mean.

    The two are rounded otherwise, so that slopes by differences are not quite the same.
    """

    def late(v: Mapping[str, float], run: Any) -> Array:
        sum_of_both = round(v["delay"], 6) + v[f"{run.name}:late"]
        return np.asarray(1e5 * np.sin(0.5 + sum_of_both) * column(run, "start"))

    own = [parameter(f"{name}:late", 0.0, -1.0, 1.0, run=name) for name in NAMES]
    shared = dataclasses.replace(parameter("delay", 0.0, -1.0, 1.0), twin="late")
    toy, spread = base("p", "q").plus(late, shared, *own), 1e-2
    truth = toy.replace({"p": 2.0, "q": -1.0, "delay": 0.02, "two:late": 0.01})
    rng = np.random.default_rng(1)
    blank = [Run(name, np.arange(N) / N, None) for name in NAMES]
    made = [dataclasses.replace(r, data=truth.predict(r) + SIGMA * rng.standard_normal(N)) for r in blank]
    known = {f"{name}:late": (0.0, spread) for name in NAMES}
    identify = Dataset(made, ColouredNoise(Process.white(SIGMA)), offset)
    task = EstimationTask(identify, dataset([]), ("p", "q", "delay"), lambda _: known, lambda _: toy, 1e-3)
    found = fit_model(task, toy)
    assert found is not None
    j = found.solution.problem.where.names.index("delay")
    assert math.sqrt(found.solution.covariance[j, j]) == pytest.approx(spread / math.sqrt(3), rel=1e-3)

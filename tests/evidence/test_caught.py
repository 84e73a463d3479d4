"""Fits that are caught come free: a run begun elsewhere, whether it was fitted or kept apart, and a fit shaken."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from flexdesign.evidence.caught import carried_on, in_line, shaken
from flexdesign.evidence.origins import SHARE_BEFORE, begun_alone, begun_elsewhere, out_of_line

from flexdesign.evidence.case import Case, Fitting
from flexdesign.evidence.noise import White
from flexdesign.evidence.stand import Stand, fitted, solved
from flexdesign.evidence.suite import Suite
from tests.evidence.test_screening import NAMES, N, Sum, base, candidate, column, least, offset
from tests.evidence.toys import Array, Run, parameter

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


def suite(names: Sequence[str], more: Mapping[str, float] | None = None) -> Suite:
    truth = model().replace({"p": 2.0, "q": -1.0, **{f"{n}:turn": turn for n, turn in TRUTH.items()}})
    rng = np.random.default_rng(len(names))

    def data(run: Any) -> Array:
        added = sum((amount * column(run, c) for c, amount in (more or {}).items()), start=np.zeros(N))
        return np.asarray(truth.predict(run) + added + SIGMA * rng.standard_normal(N))

    blank = [Run(name, np.arange(N) / N, None) for name in names]
    return Suite([dataclasses.replace(run, data=data(run)) for run in blank], White(SIGMA), offset)


def about(more: Mapping[str, float] | None = None) -> Case:
    return Case(suite(NAMES, more), suite(HELD, more), ("p", "q"), lambda _: {}, 1e-3)


def turns(stand: Stand) -> dict[str, float]:
    return {p.run: p.start or 0.0 for p in stand.model.parameters() if p.run}


def test_a_part_of_a_suite_has_the_records_of_the_whole() -> None:
    whole = suite(NAMES)
    part = whole.part(["three", "one"])
    assert part.names == ["one", "three"] and whole.names == list(NAMES)
    assert part.records == (whole.records[0], whole.records[2])
    assert part.samples == 2 * N


def test_a_run_out_of_line_is_fitted_by_itself_from_several_places() -> None:
    """Only its own number moves; others stay where they were, though they too are not at their best."""
    case = about()
    begun = model().replace({"p": 2.0, "q": -1.0, "one:turn": 0.05, "three:turn": 0.02})
    residuals = [case.identify.residual(r, begun.predict(r.observation)) for r in case.identify.records]
    odd = out_of_line(case.identify, [r for r in residuals if r is not None])
    assert odd == ["two"]
    found = {p.name: p.start for p in begun_elsewhere(case, case.identify, begun, odd).parameters()}
    # The ripple is known to SIGMA over the root of N.
    assert ripple(found.pop("two:turn") or 0.0) == pytest.approx(ripple(0.82), abs=0.05)
    assert found == {p.name: p.start for p in begun.parameters() if p.name != "two:turn"}
    assert begun_elsewhere(case, case.identify, begun, []) is begun


def test_each_run_is_fitted_alone_while_all_other_numbers_stand() -> None:
    """Its own amount of a column follows from linear algebra: that of what shared numbers leave, beside an offset."""
    own = [parameter(f"{n}:own", 0.0, -9.0, 9.0, run=n) for n in NAMES]
    model = base("p").plus(lambda v, run: v[f"{run.name}:own"] * column(run, "own"), *own)
    rng = np.random.default_rng(0)
    observed = [Run(name, np.arange(N) / N, rng.standard_normal(N)) for name in NAMES]
    case = Case(Suite(observed, White(SIGMA), offset), Suite([], White(SIGMA), offset), ("p",), lambda _: {}, 1e-3)
    found = {p.name: p.start for p in begun_alone(case, model.replace({"p": 0.7})).parameters()}
    assert found.pop("p") == 0.7
    for run in observed:
        matrix = np.column_stack([column(run, "own"), np.ones(N)])
        left = run.data - 0.7 * column(run, "p")
        amount = np.linalg.lstsq(matrix, left)[0][0]
        # No step is left that promises more than a small share of what the run leaves.
        farthest = math.sqrt(SHARE_BEFORE * least(matrix, left)) / math.sqrt(least(matrix[:, 1:], matrix[:, 0]))
        assert found[f"{run.name}:own"] == pytest.approx(amount, abs=farthest)


def test_fits_that_spare_simulations_end_where_others_do() -> None:
    case = about()
    start = {f"{run}:turn": turn + 0.01 for run, turn in TRUTH.items()}
    plain = solved(case, model(), (), start)
    spared = solved(dataclasses.replace(case, fitting=Fitting(sparing=True)), model(), (), start)
    assert plain is not None and spared is not None
    assert spared.cost == pytest.approx(plain.cost, abs=0.1)  # a step that promises less is the last
    assert spared.x == pytest.approx(plain.x, abs=1e-3)
    assert spared.problem.evaluations < plain.problem.evaluations


def test_fits_go_on_no_further_than_the_case_asks() -> None:
    case = about()
    exact, rough = (
        solved(dataclasses.replace(case, fitting=Fitting(share=share)), model(), (), {"p": 2.0, "q": -1.0})
        for share in (1e-6, 0.5)
    )
    assert exact is not None and rough is not None
    assert exact.cost < rough.cost < 2 * exact.cost
    assert rough.problem.evaluations < exact.problem.evaluations


def test_a_rough_fit_is_carried_on_to_where_the_last_one_ends() -> None:
    case = dataclasses.replace(about({"a": 0.5}), fitting=Fitting(share=0.5))
    added = candidate("a", signed=True)
    start = {"p": 2.0, "q": -1.0, **{f"{run}:turn": turn + 0.01 for run, turn in TRUTH.items()}}
    rough = fitted(case, added.add(model()), (added,), start)
    exact = fitted(about({"a": 0.5}), added.add(model()), (added,), start)
    assert rough is not None and exact is not None and exact.cost + 1.0 < rough.cost
    assert carried_on(case, rough).cost == pytest.approx(exact.cost, abs=0.1)
    as_far = dataclasses.replace(case, fitting=Fitting(share=0.5, last=0.5))
    assert carried_on(as_far, rough) is rough


def test_a_fit_and_the_runs_kept_apart_come_free_together() -> None:
    case = about()
    caught = fitted(case, model(), (), {})
    assert caught is not None and caught.scale > 1.5
    free = in_line(case, caught)
    assert free.scale == pytest.approx(1.0, abs=4 * math.sqrt(2 / (3 * N)))
    assert all(ripple(turn) == pytest.approx(ripple(TRUTH[run]), abs=0.05) for run, turn in turns(free).items())
    assert free.held_cost < 2 * N + 4 * math.sqrt(4 * N)


def test_runs_that_fit_alike_are_all_in_line() -> None:
    case = about({"unknown": 0.5})  # missing everywhere, which begins no run elsewhere
    truth = model().replace({"p": 2.0, "q": -1.0, **{f"{n}:turn": turn for n, turn in TRUTH.items()}})
    residuals = [case.identify.residual(r, truth.predict(r.observation)) for r in case.identify.records]
    assert out_of_line(case.identify, [r for r in residuals if r is not None]) == []
    assert out_of_line(case.identify, [r for r in residuals if r is not None], usual=1.0) == list(NAMES)


def test_a_fit_is_shaken_until_it_is_good_enough() -> None:
    """Steps on the way, each a fiftieth of the range long, each of which holds a fit that comes by."""

    def stepped(v: Mapping[str, float], run: Any) -> Array:
        turn = v[f"{run.name}:turn"]
        return np.asarray(20.0 * (turn + 0.01 * math.sin(2 * math.pi * turn / 0.02)) * column(run, "start"))

    own = [parameter(f"{n}:turn", 0.0, -0.1, 1.0, run=n, screen=(0.0, 0.5)) for n in (*NAMES, *HELD)]
    toy = base("p", "q").plus(stepped, *own)
    truth = toy.replace({"p": 2.0, "q": -1.0, "one:turn": 0.315, "two:turn": 0.245, "three:turn": 0.115})
    rng = np.random.default_rng(0)

    def recorded(names: Sequence[str]) -> Suite:
        blank = [Run(name, np.arange(N) / N, None) for name in names]
        made = [dataclasses.replace(r, data=truth.predict(r) + SIGMA * rng.standard_normal(N)) for r in blank]
        return Suite(made, White(SIGMA), offset)

    said = list[str]()
    case = Case(recorded(NAMES), recorded(HELD), ("p", "q"), lambda _: {}, 1e-3, progress=said.append)
    caught = fitted(case, toy.replace({f"{n}:turn": 0.02 for n in NAMES}), (), {})
    assert caught is not None
    shaken_free = shaken(case, caught, 0.0)
    assert shaken_free.cost < caught.cost - 100 and len(said) == 4
    assert shaken(case, shaken_free, shaken_free.cost + 1.0) is shaken_free and len(said) == 4


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
    case = Case(Suite(made, White(SIGMA), offset), suite([]), ("p", "q", "delay"), lambda _: known, 1e-3)
    found = fitted(case, toy, (), {})
    assert found is not None
    j = found.solution.problem.where.names.index("delay")
    assert math.sqrt(found.solution.covariance[j, j]) == pytest.approx(spread / math.sqrt(3), rel=1e-3)

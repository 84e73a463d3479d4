"""Marquardt's method beside an independent minimiser, along narrow valleys, over kinks, and where the model fails."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares, lsq_linear
from scipy.signal import lfilter

from flexdesign.core.errors import InputError
from flexdesign.core.model import Observation
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import (
    FULL,
    INEXACT,
    ROUGH,
    SMALL_REDUCTION,
    Effort,
    Solution,
    linearise,
    solve,
)
from flexdesign.estimation.least_squares.residual_function import Problem, coordinates, value
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.toys import Array, Run, Toy, parameter

T = np.linspace(0, 2, 150)
#: A step that promises less than `SMALL_REDUCTION`, times the discrepancy, is the last: no coordinate is then farther
#: from the minimum, in its standard deviations, than the root of that, as long as the model is straight over such a
#: step; doubled for where it is not.
CLOSE = 2 * math.sqrt(SMALL_REDUCTION)


def nothing(observation: Observation) -> tuple[Array, Array]:
    return np.zeros((len(observation.measured()), 0)), np.zeros(0)


def problem(model: Toy, data: Array, sigma: float, t: Array = T, **known: tuple[float, float]) -> Problem:
    where = coordinates(model, [p.name for p in model.every], known)
    return Problem(Dataset([Run("run", t, data)], ColouredNoise(Process.white(sigma)), nothing), model, where)


def solved(task: Problem, **settings: Any) -> Solution:
    found = solve(task, task.where.start, **settings)
    assert found is not None
    return found


def values(found: Solution) -> dict[str, float]:
    return found.problem.where.values(found.x)


# --- the minimum ----------------------------------------------------------------------------------------------------


def bumps(v: Mapping[str, float], t: Array) -> Array:
    """A bump on a decay."""
    return np.asarray(v["a"] * np.exp(-v["k"] * t) + v["b"] / (1 + ((t - v["m"]) / v["s"]) ** 2))


def bumpy(rng: np.random.Generator) -> tuple[Toy, dict[str, float]]:
    """A model that starts up to 40 % off its truth; the truth of `b` may lie outside what is allowed."""
    truth = {
        "a": rng.uniform(1, 3),
        "k": 10 ** rng.uniform(-0.5, 0.8),
        "b": rng.uniform(0.3, 1.5),
        "m": rng.uniform(0.6, 1.4),
        "s": rng.uniform(0.1, 0.3),
    }
    start = {name: number * rng.uniform(0.8, 1.4) for name, number in truth.items()}
    start["m"] = truth["m"] + rng.uniform(-0.1, 0.1)
    every = (
        parameter("a", start["a"], 0.1, 10.0),
        parameter("k", start["k"], 0.01, 100.0, scale="log"),
        parameter("b", min(start["b"], 1.0), 0.0, 1.0),
        parameter("m", start["m"], 0.0, 2.0),
        parameter("s", start["s"], 1e-2, 2.0, scale="log"),
    )
    return Toy(bumps, every), truth


def by_scipy(task: Problem, data: Array, sigma: float) -> tuple[Array, float]:
    """The same least squares, written out and handed to another program with tight tolerances."""
    where, model = task.where, task.model
    assert isinstance(model, Toy)

    def residuals(x: Array) -> Array:
        v = {p.name: value(p, float(c)) for p, c in zip(where.parameters, x, strict=True)}
        known = [(v[name] - middle) / width for name, (middle, width) in where.known.items()]
        return np.append((data - model.formula(v, T)) / sigma, known)

    span = where.upper - where.lower
    start = np.clip(where.start, where.lower + 1e-9 * span, where.upper - 1e-9 * span)
    found = least_squares(residuals, start, "3-point", (where.lower, where.upper), xtol=1e-12, ftol=1e-12, gtol=1e-12)
    return found.x, float(2 * found.cost)


@pytest.mark.parametrize("seed", range(12))
def test_minimum_is_that_of_an_independent_program(seed: int) -> None:
    """Random problems with bounds, logarithms and something known of two numbers."""
    rng = np.random.default_rng(seed)
    model, truth = bumpy(rng)
    data = bumps(truth, T) + 0.02 * rng.standard_normal(len(T))
    k = (truth["k"] * rng.uniform(0.9, 1.1), 0.1 * truth["k"])
    task = problem(model, data, 0.02, k=k, a=(truth["a"] + 0.01, 0.02))
    x, cost = by_scipy(task, data, 0.02)
    found = solved(task)
    discrepancy = task.dataset.discrepancy(found.residuals)  # that of a bound that is not met, in some of them
    assert found.cost - cost < SMALL_REDUCTION * discrepancy
    assert np.all(np.abs(found.x - x) <= CLOSE * np.sqrt(np.diag(found.covariance) * discrepancy))
    residuals = task.residuals(found.x)
    assert found.cost == task.cost(found.x, residuals)
    assert np.all((found.x >= task.where.lower) & (found.x <= task.where.upper))
    if truth["b"] > 1.1:  # seven standard deviations outside
        assert found.x[2] == task.where.upper[2]


def test_some_of_these_minima_lie_at_a_bound() -> None:
    assert 0 < sum(bumpy(np.random.default_rng(seed))[1]["b"] > 1.1 for seed in range(12)) < 12


@pytest.mark.parametrize("exact", [False, True])
def test_covariance_is_the_inverse_of_the_normal_matrix(exact: bool) -> None:
    """From derivatives by hand; carried along without a last look they serve the search, not the intervals."""
    truth, sigma = {"a": 2.0, "k": 3.0}, 0.01
    model = Toy(
        lambda v, t: v["a"] * np.exp(-v["k"] * t),
        (parameter("a", 1.0, 0.1, 10.0), parameter("k", 1.0, 0.1, 100.0, scale="log")),
    )
    rng = np.random.default_rng(0)
    data = model.formula(truth, T) + sigma * rng.standard_normal(len(T))
    found = solved(problem(model, data, sigma, a=(2.02, 0.005)), effort=replace(FULL, is_exact=exact))
    v = values(found)
    decay = np.exp(-v["k"] * T)
    jacobian = np.column_stack([decay, -v["k"] * v["a"] * T * decay]) / sigma
    normal = jacobian.T @ jacobian + np.diag([1 / 0.005**2, 0.0])
    expected = np.linalg.inv(normal)
    # The error of a forward difference: see the slopes of a data set.
    assert found.covariance == pytest.approx(expected, rel=0.01 if exact else 0.5)
    part = rng.standard_normal(len(T))
    if exact:
        assert found.project([part]) == pytest.approx(-jacobian.T @ part, rel=0.01, abs=0.01 * np.abs(jacobian).sum())


# --- hard ground ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cosine", [0.9, 0.99, 0.9999])
def test_a_narrow_valley_is_followed_to_its_end(cosine: float) -> None:
    """Two columns with this cosine: the cost hardly changes along the valley, whose end is far off.

    Standard deviations are 1 across it and up to 70 along it, the root of 2 / (1 - cosine).
    """
    rng = np.random.default_rng(1)
    basis = np.linalg.qr(rng.standard_normal((len(T), 2)))[0]
    columns = basis @ np.array([[1.0, cosine], [0.0, math.sqrt(1 - cosine**2)]])
    truth = np.array([3e3, -1e3])
    model = Toy(
        lambda v, t: columns @ np.array([v["p"], v["q"]]) + 1e-4 * v["p"] ** 2 * basis[:, 0],
        (parameter("p", 1.0, -1e5, 1e5), parameter("q", 1.0, -1e5, 1e5)),
    )
    data = model.formula({"p": truth[0], "q": truth[1]}, T)
    found = solved(problem(model, data, 1.0))
    assert found.cost < SMALL_REDUCTION  # at the truth it is zero
    assert np.all(np.abs(found.x - truth) < CLOSE * np.sqrt(np.diag(found.covariance)))


def bent_valley() -> Problem:
    """Rosenbrock's function from his own start (1960, Computer Journal 3, 175-184)."""
    model = Toy(
        lambda v, t: np.array([10 * (v["y"] - v["x"] ** 2), v["x"]]),
        (parameter("x", -1.2, -10.0, 10.0), parameter("y", 1.0, -10.0, 10.0)),
    )
    return problem(model, np.array([0.0, 1.0]), 1e-2, t=T[:2])


def test_a_bent_valley_is_followed_to_its_end() -> None:
    found = solved(bent_valley())
    assert found.cost < SMALL_REDUCTION
    assert values(found)["x"] == pytest.approx(1.0, abs=CLOSE * 1e-2)


@pytest.mark.parametrize("start", [0.15, 0.5, 1.2, 1.9])
def test_a_kink_is_passed(start: float) -> None:
    """A contact: nothing before `gap`, then a ramp. The slope by the gap jumps at every sample."""

    def contact(v: Mapping[str, float], t: Array) -> Array:
        return np.asarray(v["k"] * np.maximum(t - v["gap"], 0) + 0.1 * t)

    model = Toy(contact, (parameter("gap", start, 0.0, 2.0), parameter("k", 1.0, 0.0, 10.0)))
    data = contact({"gap": 0.8, "k": 2.0}, T) + 0.01 * np.random.default_rng(2).standard_normal(len(T))
    found = solved(problem(model, data, 0.01))

    def cost(gap: float) -> float:
        ramp = np.maximum(T - gap, 0)
        left = data - 0.1 * T
        return float(np.sum((left - ramp * (ramp @ left) / (ramp @ ramp)) ** 2)) / 0.01**2

    assert found.cost - min(cost(gap) for gap in np.linspace(0.75, 0.85, 2001)) < SMALL_REDUCTION


@pytest.mark.parametrize("turned", [-0.6, -0.05])
def test_an_initial_state_beside_a_kink_does_not_stop_the_others(turned: float) -> None:
    """Friction that pulls up or down as a record begins, by where the stage had turned, and says no more of that place.

    The minimum of the other numbers is that without the kink, on the side where the search begins.
    """

    def formula(v: Mapping[str, float], t: Array) -> Array:
        side = math.tanh(v["run:turn"] / 1e-3) + 2e-7 * v["run:turn"]  # and a ringing that hardly shows
        return np.asarray(v["a"] * np.exp(-v["k"] * t) - side * np.exp(-t / 0.1))

    every = (parameter("a", 1.5, 0.1, 10.0), parameter("k", 2.5, 0.1, 100.0, scale="log"))
    turn = parameter("run:turn", turned, -500.0, 500.0, run="run", screen=(-60.0, 0.0, 60.0))
    data = 2 * np.exp(-3 * T) + np.exp(-T / 0.1) + 1e-3 * np.random.default_rng(4).standard_normal(len(T))
    found = solved(problem(Toy(formula, (*every, turn)), data, 1e-3, **{"run:turn": (25.0, 100.0)}))
    assert values(found)["run:turn"] < 0
    beside = problem(Toy(lambda v, t: formula({**v, "run:turn": turned}, t), every), data, 1e-3)
    x, cost = by_scipy(beside, data, 1e-3)
    assert sum(float(part @ part) for part in found.residuals) - cost < SMALL_REDUCTION
    assert np.all(np.abs(found.x[:2] - x) <= CLOSE * np.sqrt(np.diag(found.covariance))[:2])


def test_a_search_ends_in_a_corner_where_slopes_promise_what_no_step_keeps() -> None:
    model = Toy(lambda v, t: -10 - np.abs(v["x"] * np.ones_like(t)), (parameter("x", 0.0, -99.0, 99.0),))
    found = solve(task := problem(model, np.zeros(1), 0.1, t=T[:1]), task.where.start)
    assert found is not None
    assert values(found)["x"] == pytest.approx(0.0, abs=1e-6)
    assert task.evaluations < 2 * 15  # slopes twice, and a dozen shorter and shorter steps with each


def test_a_number_without_influence_stays_where_it_is() -> None:
    model = Toy(lambda v, t: v["a"] * t, (parameter("a", 1.0, -9.0, 9.0), parameter("idle", 0.3, -1.0, 1.0)))
    found = solved(problem(model, 2 * T, 0.1))
    assert values(found)["a"] == pytest.approx(2.0, abs=CLOSE * 0.1 / math.sqrt(T @ T))
    assert values(found)["idle"] == pytest.approx(0.3, abs=1e-9)
    assert np.isfinite(found.covariance).all()


def test_what_holds_a_number_at_its_bound_does_not_hold_the_others() -> None:
    """The best line through a parabola, its slope bounded to one: the offset is then mean(t^2) - mean(t)."""
    model = Toy(
        lambda v, t: v["offset"] + v["slope"] * t, (parameter("offset", 0, -9.0, 9.0), parameter("slope", 0.5, 0, 1.0))
    )
    found = solved(problem(model, T**2, 0.1))
    assert values(found)["slope"] == 1.0
    assert values(found)["offset"] == pytest.approx(np.mean(T**2 - T), abs=CLOSE * 0.1 / math.sqrt(len(T)))


def test_the_rest_makes_up_for_a_number_that_stops_at_its_bound() -> None:
    """Two numbers that nearly cancel, one of which reaches its bound on the way: the other must not go where it would.

    The free minimum lies at 10 and -9; cut off at the bound, the step to there would be uphill. Beside the bounded
    least squares of an independent program.
    """
    first, second = np.cos(T), np.cos(T) + 0.05 * np.sin(3 * T)
    model = Toy(
        lambda v, t: v["a"] * first + v["b"] * second,
        (parameter("a", 0.5, -99.0, 99.0), parameter("b", 0.0, -1.0, 9.0)),
    )
    data = 10 * first - 9 * second
    found = values(solved(problem(model, data, 1e-3), small=SMALL_REDUCTION))
    wanted = lsq_linear(np.column_stack([first, second]), data, ([-99.0, -1.0], [99.0, 9.0])).x
    assert [found["a"], found["b"]] == pytest.approx(wanted, abs=1e-3)
    assert found["b"] == -1.0


# --- failure, and slopes that are known -----------------------------------------------------------------------------


@pytest.mark.parametrize("failure", [np.nan, ZeroDivisionError(), InputError("model", "k", 1, "no")])
def test_there_is_no_solution_where_the_model_fails_at_the_start(failure: Any) -> None:
    def formula(v: Mapping[str, float], t: Array) -> Array:
        if isinstance(failure, Exception):
            raise failure
        return np.full(len(t), failure)

    task = problem(Toy(formula, (parameter("k", 1.0, 0.0, 2.0),)), T, 1.0)
    assert solve(task, task.where.start) is None


def test_a_start_far_off_is_no_reason_to_stop_early() -> None:
    """A cost of 1e8 at the start, zero at the end: a share of what it was once would be hundreds."""
    model = Toy(lambda v, t: np.sqrt(v["k"]) * t, (parameter("k", 0.1, 0.01, 9.0),))
    task = problem(model, T, 1e-3)
    assert task.cost(task.where.start, task.residuals(task.where.start)) > 5e7
    found = solved(task)
    assert found.cost < SMALL_REDUCTION
    assert values(found)["k"] == pytest.approx(1.0, abs=CLOSE * math.sqrt(found.covariance[0, 0]))


def test_a_region_where_the_model_fails_is_kept_out_of() -> None:
    """A motion that runs away beyond k = 1.1; the best is at 1.

    A first step on k^2 goes from k to (k + 1 / k) / 2 (Heron), from one half to 1.25.
    """
    tried = []

    def formula(v: Mapping[str, float], t: Array) -> Array:
        tried.append(v["k"])
        return np.full(len(t), np.nan) if v["k"] > 1.1 else np.asarray(v["k"] ** 2 * t)

    found = solved(problem(Toy(formula, (parameter("k", 0.5, 0.01, 9.0),)), T, 1e-3))
    assert max(tried) > 1.1
    assert values(found)["k"] == pytest.approx(1.0, abs=CLOSE * math.sqrt(found.covariance[0, 0]))


def test_slopes_from_a_fit_nearby_save_predictions_and_change_nothing() -> None:
    """Also where they are wrong by half: the fit then looks anew."""
    rng = np.random.default_rng(3)
    model, truth = bumpy(rng)
    sigma = 0.02
    first = solved(problem(model, bumps(truth, T) + sigma * rng.standard_normal(len(T)), sigma))
    again = bumps(truth, T) + sigma * rng.standard_normal(len(T))
    fresh, carried, misled = (problem(model.replace(values(first)), again, sigma) for _ in range(3))
    columns = first.columns()
    assert list(columns) == ["a", "k", "b", "m", "s"]
    wrong = {name: [None if c is None else 0.5 * c for c in parts] for name, parts in columns.items()}
    effort = replace(FULL, is_exact=False)
    ends = [solved(fresh), solved(carried, effort=effort, old=columns), solved(misled, effort=effort, old=wrong)]
    sigmas = np.sqrt(np.diag(ends[0].covariance))
    for end in ends[1:]:
        assert abs(end.cost - ends[0].cost) < SMALL_REDUCTION
        assert np.all(np.abs(end.x - ends[0].x) <= CLOSE * sigmas)
    assert carried.evaluations <= fresh.evaluations - 5  # five columns less, at least once


# --- efforts --------------------------------------------------------------------------------------------------------


def decay() -> tuple[Toy, Array]:
    """A decay whose numbers start far off, and its data."""
    model = Toy(
        lambda v, t: v["a"] * np.exp(-v["k"] * t),
        (parameter("a", 1.0, 0.1, 10.0), parameter("k", 1.0, 0.1, 100.0, scale="log")),
    )
    return model, model.formula({"a": 2.0, "k": 3.0}, T)


def looks(task: Problem, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Note the columns that are computed, each time that a Jacobian is."""
    made, jacobian = list[list[str]](), task.jacobian

    def counted(x: Array, residuals: Any, old: Any = None) -> Any:
        made.append([name for name in task.where.names if name not in (old or {})])
        return jacobian(x, residuals, old)

    monkeypatch.setattr(task, "jacobian", counted)
    return made


def test_more_effort_ends_nearer_to_the_minimum(monkeypatch: pytest.MonkeyPatch) -> None:
    """Along a bent valley, with as many Jacobians as are allowed; one that no step would use is not computed."""
    costs, counts = [], []
    for effort in (replace(ROUGH, jacobians=0), ROUGH, FULL):
        task = bent_valley()
        made = looks(task, monkeypatch)
        found = solve(task, task.where.start, effort)
        assert found is not None
        costs.append(found.cost)
        counts.append(len(made))
        assert len(made) <= 1 + effort.jacobians
    assert costs[0] > 1.5 * costs[1] > 1e3 * SMALL_REDUCTION > costs[2]
    assert counts[:2] == [1, ROUGH.jacobians] and counts[2] > counts[1]


@pytest.mark.parametrize("effort", [replace(ROUGH, jacobians=0), INEXACT])
def test_without_further_jacobians_the_known_one_is_followed(effort: Effort, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a straight model it leads to the minimum, and what is known of it is not computed again."""
    basis = np.column_stack([np.ones_like(T), T, T**2])
    model = Toy(
        lambda v, t: basis @ np.array([v["p"], v["q"], v["r"]]), tuple(parameter(n, 0.0, -99.0, 99.0) for n in "pqr")
    )
    data, sigma = basis @ [3.0, -2.0, 1.0], 0.1
    old = {name: [-basis[:, j] / sigma] for j, name in enumerate("pq")}
    task = problem(model, data, sigma)
    made = looks(task, monkeypatch)
    found = solve(task, task.where.start, effort, old)
    assert found is not None and made == [["r"]]
    assert found.cost < SMALL_REDUCTION
    assert found.x == pytest.approx([3.0, -2.0, 1.0], abs=0.01)


def test_a_share_of_the_cost_ends_a_fit() -> None:
    """No number more precise than a share of the residual allows, where much is left that no number explains."""
    model, data = decay()
    data = data + np.cos(20 * T)
    ends = {share: solved(problem(model, data, 1e-3), effort=Effort(20, share), small=1.0) for share in (1e-2, 1e-9)}
    least = ends[1e-9].cost
    assert least < ends[1e-2].cost < 1.03 * least
    assert ends[1e-2].problem.evaluations < ends[1e-9].problem.evaluations


@pytest.mark.parametrize("seed", range(4))
def test_a_fit_ends_by_what_coloured_residuals_determine(seed: int) -> None:
    """Within a third of the standard deviation that they allow of the minimum; that of white noise costs more steps."""
    rng, rho = np.random.default_rng(seed), 0.9
    t = np.linspace(0, 2, 3000)
    coloured = lfilter([math.sqrt(1 - rho**2)], [1, -rho], rng.normal(0, 0.3, len(t)))
    model, _ = decay()
    data = model.replace({"a": 1.2, "k": 1.7}).predict(Run("run", t, np.zeros(len(t)))) + coloured
    found = solved(problem(model, data, 0.01, t), effort=Effort(20, 0.0))
    least = solved(problem(model, data, 0.01, t), effort=Effort(20, 0.0), small=1e-3)
    # Reduced chi^2, and the samples of an autoregressive process of first order that count as one.
    expected = (0.3 / 0.01) ** 2 * (1 + rho**2) / (1 - rho**2)
    assert found.problem.dataset.discrepancy(found.residuals) == pytest.approx(expected, rel=0.4)
    deviations = np.sqrt(np.diag(least.covariance) * expected)
    assert np.all(np.abs(found.x - least.x) < CLOSE * deviations)
    assert found.problem.evaluations < least.problem.evaluations


def test_a_point_is_linearised_where_it_is() -> None:
    """Its Jacobian from derivatives by hand; it is no minimum, and no step is taken."""
    model, data = decay()
    task = problem(model, data, 0.1, a=(1.5, 0.05))
    found = linearise(task, task.where.start)
    assert found is not None
    assert found.x == pytest.approx(task.where.start, abs=0.0)
    assert found.cost == task.cost(found.x, task.residuals(found.x))
    wave = np.exp(-T)
    jacobian = np.column_stack([wave, -T * wave]) / 0.1
    expected = jacobian.T @ jacobian + np.diag([1 / 0.05**2, 0.0])
    assert found.normal == pytest.approx(expected, rel=1e-3)
    fails = problem(Toy(lambda v, t: np.full(len(t), np.nan), model.every), data, 0.1)
    assert linearise(fails, fails.where.start) is None

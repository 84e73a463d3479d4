"""Intervals of fits whose answer is known: classical ones, those of coloured residuals, of crooked likelihoods."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from flexdesign.core.model import Observation
from flexdesign.estimation.least_squares.dataset import Dataset, Shapes
from flexdesign.estimation.least_squares.levenberg_marquardt import SMALL_REDUCTION, Solution, solve
from flexdesign.estimation.least_squares.residual_function import Problem, coordinates
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process, Whitening
from flexdesign.estimation.uncertainty.identifiability import intervals
from flexdesign.estimation.uncertainty.intervals import _Path, uncertainty
from tests.estimation.toys import OSCILLATION, TRUTH, Array, Run, Toy, ar1, parameter, run

T = np.linspace(0, 3, 400)
Z = float(norm.ppf(0.975))


def nothing(observation: Observation) -> tuple[Array, Array]:
    return np.zeros((len(observation.measured()), 0)), np.zeros(0)


def offset(observation: Observation) -> tuple[Array, Array]:
    return np.ones((len(observation.measured()), 1)), np.array([math.inf])


def solved(
    model: Toy,
    runs: Sequence[Run],
    noise: float | Whitening,
    shapes: Shapes = nothing,
    small: float = SMALL_REDUCTION,
    **known: Any,
) -> Solution:
    where = coordinates(model, [p.name for p in model.every], known)
    problem = Problem(
        Dataset(runs, ColouredNoise(Process.white(noise)) if isinstance(noise, float) else noise, shapes), model, where
    )
    found = solve(problem, where.start, small=small)
    assert found is not None
    return found


def line(*more: Any) -> Toy:
    return Toy(lambda v, t: v["slope"] * t, (parameter("slope", 1.0, -10.0, 10.0), *more))


def test_a_white_residual_of_the_noise_has_classical_intervals() -> None:
    """The inverse of the normal matrix with the offset as a further unknown, normal quantiles."""
    noise = 0.1 * np.random.default_rng(2).standard_normal(len(T))
    found = solved(line(), [run(line(), {"slope": 2.0}, T, noise)], 0.1, offset)
    (estimate,) = intervals(found, ["slope"])
    covariance = np.linalg.inv(np.column_stack([T, np.ones_like(T)]).T @ np.column_stack([T, np.ones_like(T)])) * 0.01
    half = Z * math.sqrt(covariance[0, 0])
    assert estimate.determined and estimate.reason == "" and estimate.interval
    assert (estimate.interval[1] - estimate.interval[0]) / 2 == pytest.approx(half, rel=1e-6)
    assert estimate.sigma == pytest.approx(math.sqrt(covariance[0, 0]), rel=1e-6)
    best = np.polyfit(T, found.problem.dataset.records[0].measured, 1)[0]
    assert estimate.value == pytest.approx(best, abs=0.05 * half)


def test_what_is_known_of_a_nuisance_column_counts() -> None:
    """The offset known to 0.01: a further measurement in the normal matrix."""
    noise = 0.1 * np.random.default_rng(2).standard_normal(len(T))
    shapes: Shapes = lambda o: (np.ones((len(T), 1)), np.array([0.01]))  # noqa: E731
    found = solved(line(), [run(line(), {"slope": 2.0}, T, noise)], 0.1, shapes)
    jacobian = np.column_stack([T, np.ones_like(T)]) / 0.1
    covariance = np.linalg.inv(jacobian.T @ jacobian + np.diag([0.0, 1 / 0.01**2]))
    assert uncertainty(found).covariance == pytest.approx(covariance[:1, :1], rel=1e-6)


def test_noise_weighs_observations() -> None:
    """Two readings of one constant, 1 ± 0.1 and 2 ± 0.5: their weighted mean; 2 sigma apart, which is within chance."""
    level = Toy(lambda v, t: np.full(len(t), v["x"]), (parameter("x", 0.0, -10.0, 10.0),))
    readings = [Run("fine", np.zeros(1), np.array([1.0])), Run("coarse", np.zeros(1), np.array([2.0]))]
    noise = ColouredNoise({"fine": Process.white(0.1), "coarse": Process.white(0.5)})
    (estimate,) = intervals(solved(level, readings, noise, small=1e-9), ["x"])
    weights = 1 / 0.1**2, 1 / 0.5**2
    assert estimate.value == pytest.approx((weights[0] + 2 * weights[1]) / sum(weights), rel=1e-6)
    assert estimate.sigma == pytest.approx(1 / math.sqrt(sum(weights)), rel=1e-6)


def test_whitened_by_its_process_coloured_noise_has_the_interval_of_the_sandwich() -> None:
    """A slow parameter under AR(1) noise, by the true filter and as if it were white, from the residual."""
    t = np.linspace(0, 3, 4000)
    observed = [run(line(), {"slope": 2.0}, t, ar1(np.random.default_rng(3), len(t), 0.1, 0.9))]
    process = Process.from_coefficients(np.array([1.0, -0.9]), 0.1 * math.sqrt(1 - 0.9**2))
    found, naive = (uncertainty(solved(line(), observed, noise, offset)) for noise in (ColouredNoise(process), 0.1))
    assert found.variance == 1.0
    assert found.covariance[0, 0] == pytest.approx(naive.covariance[0, 0], rel=0.3)


@pytest.mark.parametrize("correlated", [0.0, 0.9], ids=["white", "AR(1) 0.9"])
def test_intervals_hold_the_truth_as_often_as_they_say(correlated: float) -> None:
    """200 replicas, the noise taken for white; if 95 % is right, one in 800 falls outside 90 to 99.5 % (binomial).

    Where it is coloured, classical intervals of the slow parameters would hold the truth far less often.
    """
    held, classical = dict.fromkeys(TRUTH, 0), dict.fromkeys(TRUTH, 0)
    for seed in range(200):
        noise = ar1(np.random.default_rng(seed), len(T), 0.2, correlated)
        found = solved(OSCILLATION, [run(OSCILLATION, TRUTH, T, noise)], 0.2, offset)
        sigma = np.sqrt(np.diag(found.covariance))
        true = [math.log(v) if n == "zeta" else v for n, v in TRUTH.items()]
        for j, estimate in enumerate(intervals(found, list(TRUTH))):
            assert estimate.determined and estimate.interval
            held[estimate.name] += estimate.interval[0] <= TRUTH[estimate.name] <= estimate.interval[1]
            classical[estimate.name] += abs(found.x[j] - true[j]) < Z * sigma[j]
    assert all(180 <= count <= 199 for count in held.values()), held
    assert correlated == 0 or min(classical.values()) < 160, classical


def test_a_discrepancy_that_no_model_explains_widens_intervals() -> None:
    """A slow wave of 20 times the noise is left: intervals widen by more than that, as it is no white noise either."""
    rng = np.random.default_rng(0)
    noise = 0.01 * rng.standard_normal(len(T))
    right = solved(line(), [run(line(), {"slope": 2.0}, T, noise)], 0.01, offset)
    wrong = solved(line(), [run(line(), {"slope": 2.0}, T, noise + 0.2 * np.sqrt(2) * np.sin(9 * T))], 0.01, offset)
    (narrow,), (wide,) = intervals(right, ["slope"]), intervals(wrong, ["slope"])
    assert narrow.sigma and wide.sigma and wide.interval
    assert wide.sigma > 20 * narrow.sigma
    assert wide.interval[0] <= 2.0 <= wide.interval[1]


def test_checking_costs_two_predictions_where_the_ends_are_right() -> None:
    runs = [run(line(), {"slope": 2.0}, T, 0.1 * np.random.default_rng(i).standard_normal(400), f"{i}") for i in (2, 5)]
    found = solved(line(), runs, 0.1, offset)
    before = found.problem.evaluations
    intervals(found, ["slope"])
    assert found.problem.evaluations - before <= 2 + 2 * 2  # a step and two ends, two records


def test_a_crooked_likelihood_gets_the_interval_of_its_profile() -> None:
    """A level 1 ± 0.6 is the square of the parameter, its ends the roots; beside a slope that is nearly orthogonal."""
    t = np.linspace(-1, 1, 101)
    model = Toy(
        lambda v, t: v["x"] ** 2 + v["s"] * t, (parameter("x", 1.5, 0.05, 10.0), parameter("s", 0.0, -9.0, 9.0))
    )
    noise = np.random.default_rng(0).standard_normal(len(t))
    noise -= np.polyval(np.polyfit(t, noise, 1), t)
    noise *= math.sqrt((len(t) - 2) / (noise @ noise))
    sigma = 0.6 / Z * math.sqrt(len(t))
    found = solved(model, [Run("level", t, 1 + sigma * noise)], sigma)
    s, x = intervals(found, ["s", "x"])
    assert (s.name, x.name) == ("s", "x") and s.reason == ""
    assert x.reason == "interval from the profile likelihood"
    assert x.interval == pytest.approx((math.sqrt(0.4), math.sqrt(1.6)), rel=0.02)


def test_a_search_towards_the_minimum_has_its_jacobian_and_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Jacobian from farther away leads astray; and where the rise does not fall the search ends at the minimum."""
    found = solved(line(), [run(line(), {"slope": 2.0}, T, 0.1 * np.random.default_rng(2).standard_normal(400))], 0.1)
    path, given = _Path(found, uncertainty(found), 0), list[Any]()

    def cost_increase(displacement: float, guess: Array, columns: Any) -> tuple[float, Array, Any]:
        given.append(columns)
        return 1e9, guess, {}

    monkeypatch.setattr(path, "cost_increase", cost_increase)
    end, is_open, _ = path.end(1.0)
    assert end == pytest.approx(found.x[0], abs=1e-12) and not is_open
    assert all(columns is path.columns for columns in given)


def test_prior_knowledge_is_part_of_the_profile() -> None:
    """Nothing but the prior: an interval as wide as it states, which adds nothing to the prior."""
    noise = 0.1 * np.random.default_rng(2).standard_normal(len(T))
    model = Toy(
        lambda v, t: v["a"] * np.sin(5 * t) + v["b"] * 1e-9 * t,
        (parameter("a", 1.0, -9.0, 9.0), parameter("b", 1.0, -99.0, 99.0)),
    )
    found = solved(model, [run(model, {"a": 2.0}, T, noise)], 0.1, b=(3.0, 0.5))
    a, b = intervals(found, ["a", "b"])
    assert a.determined and not b.determined
    assert "add nothing to the prior" in b.reason
    free = intervals(solved(model, [run(model, {"a": 2.0}, T, noise)], 0.1), ["b"])[0]
    assert not free.determined and free.value is None


def test_values_are_those_of_a_better_point_that_a_profile_met() -> None:
    """3.8 (x^2 - 1)^2 + (x - 1)^2 / 4 has minima near -1, where a fit gets stuck, and at 1; a hill lies between."""
    model = Toy(
        lambda v, t: np.array([math.sqrt(3.8) * (v["x"] ** 2 - 1), v["x"] / 2]), (parameter("x", -1.2, -5.0, 5.0),)
    )
    found = solved(model, [Run("two wells", T[:2], np.array([0.0, 0.5]))], 1.0)
    assert found.x[0] == pytest.approx(-1.0, abs=0.1)
    (estimate,) = intervals(found, ["x"])
    assert estimate.value == pytest.approx(1.0, abs=0.1)


def test_confounded_parameters_are_named() -> None:
    model = Toy(
        lambda v, t: v["p"] * v["q"] * np.sin(5 * t), tuple(parameter(n, 1.5, 0.1, 10.0, scale="log") for n in "pq")
    )
    noise = 0.1 * np.random.default_rng(2).standard_normal(len(T))
    (estimate,) = intervals(solved(model, [run(model, {}, T, noise)], 0.1), ["q"])
    assert not estimate.determined
    assert estimate.reason == "q and p: only their product shows in these runs"

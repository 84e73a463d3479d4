"""Suites: what may add to a record against generalised least squares written out, slopes against their formulas."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag, toeplitz
from scipy.signal import lfilter

from flexdesign.core.errors import InputError
from flexdesign.core.model import Observation
from flexdesign.estimation.least_squares.dataset import Dataset, Shapes
from flexdesign.estimation.least_squares.residual_function import Problem, coordinates
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.toys import OSCILLATION, TRUTH, Array, Run, Toy, oscillation, parameter

#: Poles at 0.9 exp(+-0.4 i).
RINGING = Process.from_coefficients(np.array([1.0, -2 * 0.9 * np.cos(0.4), 0.81]), 0.3)
T = np.linspace(0, 3, 120)
GAPS = [0, 30, 31, 77]
#: What bounds the columns of `nuisance`: nothing the offset, little the other two.
SIZES = np.array([np.inf, 0.5, 0.02])


def nothing(observation: Observation) -> tuple[Array, Array]:
    return np.zeros((len(observation.measured()), 0)), np.zeros(0)


def offset(observation: Observation) -> tuple[Array, Array]:
    return np.ones((len(observation.measured()), 1)), np.array([np.inf])


def nuisance(observation: Observation) -> tuple[Array, Array]:
    t = observation.t  # type: ignore[attr-defined]
    return np.column_stack([np.ones_like(t), np.exp(-t), np.sin(9 * t)]), SIZES


def gapped(values: Array, name: str = "run") -> Run:
    data = values.copy()
    data[GAPS] = np.nan
    return Run(name, T, data)


def inverse_root(present: Any) -> Array:
    """W with W C W' = 1, of the process on each stretch between gaps; C is the sum of h_k h_(k+lag) sigma^2."""
    response = lfilter([1.0], RINGING.coefficients, np.eye(1, 2000)[0])
    lags = np.array([response[: 2000 - k] @ response[k:] for k in range(len(T))]) * RINGING.sigma**2
    edges = np.flatnonzero(np.diff(present.astype(int), prepend=0, append=0))
    lengths = edges[1::2] - edges[::2]
    blocks = [np.linalg.inv(np.linalg.cholesky(toeplitz(lags[:n]))) for n in lengths]
    return np.asarray(block_diag(*blocks))


# --- what adds to a record ------------------------------------------------------------------------------------------


def test_taking_columns_out_is_generalised_least_squares() -> None:
    """The least of (d - C a)' N^-1 (d - C a) + sum of (a / size)^2 over the amounts a, by `lstsq` on all of it."""
    rng = np.random.default_rng(0)
    observed, predicted = gapped(5 + 2 * np.exp(-T) + rng.standard_normal(len(T))), np.sin(T)
    dataset = Dataset([observed], ColouredNoise(RINGING), nuisance)
    record, there = dataset.records[0], np.isfinite(observed.data)
    columns, difference = nuisance(observed)[0][there], (observed.data - predicted)[there]
    root = inverse_root(there)
    rows = np.vstack([root @ columns, np.diag(1 / SIZES)])
    right = np.append(root @ difference, np.zeros(3))
    amounts = np.linalg.lstsq(rows, right)[0]

    residual = dataset.residual(record, predicted)
    assert residual is not None
    assert residual @ residual == pytest.approx(np.sum((right - rows @ amounts) ** 2), rel=1e-9)
    left = dataset.remainder(record, predicted)
    assert np.array_equal(np.isnan(left), ~there)
    assert left[there] == pytest.approx(difference - columns @ amounts, abs=1e-9)
    free = np.linalg.lstsq(root @ columns, root @ difference)[0]
    assert abs(amounts[2]) < 0.5 * abs(free[2])  # what is known of it does matter
    assert dataset.samples == there.sum() == len(T) - len(GAPS)


def test_a_move_that_columns_make_up_costs_what_is_known_of_their_amounts() -> None:
    """An offset is free. As an amount grows, (a / size)^2 takes over only as far as the record lets it."""
    dataset = Dataset([gapped(np.zeros(len(T)))], ColouredNoise(Process.white(0.1)), nuisance)
    record = dataset.records[0]
    assert dataset.whitened(record, np.full(len(T), 7.0)) == pytest.approx(np.zeros(record.rows), abs=1e-10)
    kept = [
        dataset.whitened(record, np.where(record.present, nuisance(record.observation)[0][:, k], 0)) for k in (1, 2)
    ]
    for part, size in zip(kept, SIZES[1:], strict=True):
        assert 0 < part @ part < 1 / size**2
    loose = dataset.with_shapes(lambda o: (nuisance(o)[0], np.full(3, np.inf)))
    assert loose.residual(loose.records[0], 3 * np.exp(-T) + np.sin(9 * T)) == pytest.approx(np.zeros(len(T) + 3))


def test_a_column_that_a_gap_hides_changes_nothing() -> None:
    hidden = np.zeros((len(T), 1))
    hidden[GAPS] = 1.0

    def more(observation: Observation) -> tuple[Array, Array]:
        return np.hstack([offset(observation)[0], hidden]), np.array([np.inf, 2.0])

    observed = gapped(np.cos(T))
    plain, padded = (Dataset([observed], ColouredNoise(RINGING), shapes) for shapes in (offset, more))
    costs = [float(np.sum(dataset.whitened(dataset.records[0], T) ** 2)) for dataset in (plain, padded)]
    assert costs[1] == pytest.approx(costs[0], rel=1e-12)
    left = [dataset.remainder(dataset.records[0], T) for dataset in (plain, padded)]
    assert left[1] == pytest.approx(left[0], nan_ok=True)


@pytest.mark.parametrize("shapes", [nothing, offset, nuisance])
def test_gaps_stay_empty(shapes: Shapes) -> None:
    """A prediction that is wild, or even not finite, where nothing was measured is as good as any other."""
    dataset = Dataset([gapped(np.sin(T))], ColouredNoise(Process.white(0.1)), shapes)
    wild = np.sin(2 * T)
    wild[GAPS] = [1e9, np.nan, np.inf, -np.inf]
    parts = [dataset.residual(dataset.records[0], values) for values in (np.sin(2 * T), wild)]
    assert parts[0] is not None and parts[1] is not None
    assert np.array_equal(parts[0], parts[1])
    wild[GAPS[0] + 1] = np.nan
    assert dataset.residual(dataset.records[0], wild) is None


def test_an_unbounded_column_that_a_gap_hides_takes_nothing_out() -> None:
    """It acts where nothing was measured: the residual is that without it, and its amount is none."""
    data = np.sin(T)
    data[:40] = np.nan

    def early(observation: Observation) -> tuple[Array, Array]:
        return np.where(np.arange(len(T)) < 40, 1.0, 0.0)[:, None], np.array([np.inf])

    with_it, without = (
        Dataset([Run("run", T, data)], ColouredNoise(Process.white(0.5)), shapes) for shapes in (early, nothing)
    )
    residuals = [dataset.residual(dataset.records[0], np.zeros(len(T))) for dataset in (with_it, without)]
    assert residuals[0] is not None and residuals[1] is not None
    assert residuals[0][: len(T)] == pytest.approx(residuals[1])
    assert with_it.remainder(with_it.records[0], np.zeros(len(T)))[40:] == pytest.approx(data[40:])


def test_a_record_without_values_is_refused() -> None:
    with pytest.raises(InputError, match="no finite value"):
        Dataset([Run("empty", T, np.full(len(T), np.nan))], ColouredNoise(Process.white(1.0)), offset)


# --- slopes ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Staged(Toy):
    """An oscillation that begins at another phase in each run; it counts what is asked of it."""

    asked: list[str] = field(default_factory=list)

    def replace(self, values: Any) -> Staged:
        return Staged(self.formula, super().replace(values).every, self.asked)

    def predict(self, observation: Any) -> Any:
        self.asked.append(observation.name)
        v = self.values()
        return oscillation({**v, "phi": v[f"{observation.name}:phi"]}, observation.t)


def staged(names: tuple[str, ...]) -> Staged:
    own = [parameter(f"{name}:phi", 0.1 * i, -1.5, 1.5, run=name) for i, name in enumerate(names)]
    return Staged(oscillation, (*OSCILLATION.every[:3], *own))


def problem(names: tuple[str, ...] = ("one", "two", "three"), **known: tuple[float, float]) -> Problem:
    model = staged(names)
    dataset = Dataset([gapped(oscillation(TRUTH, T), name) for name in names], ColouredNoise(RINGING), nuisance)
    return Problem(dataset, model, coordinates(model, [p.name for p in model.every], known))


def analytic(v: dict[str, float], run: str) -> dict[str, Array]:
    """Derivatives of the oscillation by hand; that by zeta is by its logarithm."""
    z, w, phi = v["zeta"], 2 * np.pi * v["f"], v[f"{run}:phi"]
    root = np.sqrt(1 - z**2)
    decay, angle = np.exp(-z * w * T), w * root * T + phi
    sine, cosine = v["a"] * decay * np.sin(angle), v["a"] * decay * np.cos(angle)
    by_w = -z * T * sine + root * T * cosine
    by_zeta = -w * T * sine - w * T * z / root * cosine
    return {"a": sine / v["a"], "f": 2 * np.pi * by_w, "zeta": z * by_zeta, f"{run}:phi": cosine}


def test_slopes_are_those_of_the_formula() -> None:
    """Forward differences move the response by 3e-4 of its size once their steps have been adapted.

    Their error is half the step times the second derivative, the same share of the slope but for the ratio of second to
    first derivative, below 10 here; 0.3 % allowed.
    """
    found = problem()
    x = found.where.start
    residuals = found.residuals(x)
    assert residuals is not None
    for _ in range(3):
        jacobian = found.jacobian(x, residuals)
    values = found.where.values(x)
    for record, places, part in zip(found.dataset.records, found.places, jacobian, strict=True):
        assert np.array_equal(part.places, places)
        expected = analytic(values, record.observation.name)
        assert {found.where.names[j] for j in places} == set(expected)
        for column, j in zip(part.matrix.T, places, strict=True):
            moved = np.where(record.present, -expected[found.where.names[j]], 0.0)
            exact = found.dataset.whitened(record, moved)
            assert np.linalg.norm(column - exact) < 3e-3 * np.linalg.norm(exact)


def test_numbers_of_one_run_ask_for_that_run_alone() -> None:
    """Three shared numbers ask for every run, three of their own for one each."""
    found = problem()
    x, model = found.where.start, found.model
    assert isinstance(model, Staged)
    residuals = found.residuals(x)
    assert residuals is not None
    assert sorted(model.asked) == ["one", "three", "two"]
    model.asked.clear()
    found.jacobian(x, residuals)
    assert {name: model.asked.count(name) for name in set(model.asked)} == {"one": 4, "two": 4, "three": 4}
    assert found.evaluations == 3 + 12


def test_known_slopes_are_taken_as_they_are() -> None:
    found = problem()
    x, model = found.where.start, found.model
    assert isinstance(model, Staged)
    residuals = found.residuals(x)
    assert residuals is not None
    mine: dict[str, list[Array | None]] = {
        "f": [np.full(len(part), float(i)) for i, part in enumerate(residuals)],
        "two:phi": [None, 5 * residuals[1], None],
    }
    model.asked.clear()
    jacobian = found.jacobian(x, residuals, mine)
    assert {name: model.asked.count(name) for name in set(model.asked)} == {"one": 3, "two": 2, "three": 3}
    for i, part in enumerate(jacobian):
        by_name = dict(zip([found.where.names[j] for j in part.places], part.matrix.T, strict=True))
        assert np.all(by_name["f"] == i)
        assert i != 1 or np.array_equal(by_name["two:phi"], 5 * residuals[1])


def test_at_a_bound_differences_look_inwards() -> None:
    """A straight line has the same slope from either side; beyond its bound the model knows no answer."""

    def line(v: Any, t: Array) -> Array:
        assert v["k"] <= 2.0
        return np.asarray(v["k"] * t)

    model = Toy(line, (parameter("k", 2.0, 0.0, 2.0),))
    found = Problem(
        Dataset([Run("run", T, np.zeros(len(T)))], ColouredNoise(Process.white(0.5)), nothing),
        model,
        coordinates(model, ["k"], {}),
    )
    residuals = found.residuals(found.where.start)
    assert residuals is not None
    assert found.jacobian(found.where.start, residuals)[0].matrix[:, 0] == pytest.approx(-T / 0.5)


def test_where_a_model_fails_on_one_side_the_slope_is_looked_for_on_the_other() -> None:
    def line(v: Any, t: Array) -> Array:
        return np.asarray(v["k"] * t if v["k"] <= 2.0 else np.full(len(t), np.nan))

    model = Toy(line, (parameter("k", 2.0, 0.0, 10.0),))
    found = Problem(
        Dataset([Run("run", T, np.zeros(len(T)))], ColouredNoise(Process.white(0.5)), nothing),
        model,
        coordinates(model, ["k"], {}),
    )
    residuals = found.residuals(found.where.start)
    assert residuals is not None
    assert found.jacobian(found.where.start, residuals)[0].matrix[:, 0] == pytest.approx(-T / 0.5)


def test_what_was_known_counts_as_a_measurement() -> None:
    found = problem(f=(3.5, 0.25), zeta=(0.04, 0.02))
    x = found.where.start
    assert found.prior_residual(x) == pytest.approx([(3.0 - 3.5) / 0.25, (0.05 - 0.04) / 0.02])
    jacobian = found.prior_jacobian(x)
    j, k = found.where.names.index("f"), found.where.names.index("zeta")
    assert (jacobian[0, j], jacobian[1, k]) == pytest.approx((1 / 0.25, 0.05 / 0.02))  # by the logarithm of zeta
    assert np.count_nonzero(jacobian) == 2
    residuals = found.residuals(x)
    assert residuals is not None
    assert found.cost(x, residuals) == pytest.approx(sum(part @ part for part in residuals) + 4 + 0.25)


@pytest.mark.parametrize("failure", [np.nan, InputError("model", "k", 1, "no"), ZeroDivisionError(), OverflowError()])
def test_a_model_that_fails_has_no_residual(failure: Any) -> None:
    def formula(v: Any, t: Array) -> Array:
        if isinstance(failure, Exception):
            raise failure
        return np.where(t > 1, failure, v["k"] * t)

    model = Toy(formula, (parameter("k", 1.0, 0.0, 2.0),))
    found = Problem(
        Dataset([Run("run", T, np.zeros(len(T)))], ColouredNoise(Process.white(1.0)), offset),
        model,
        coordinates(model, ["k"], {}),
    )
    assert found.residuals(found.where.start) is None
    assert found.cost(found.where.start, None) == np.inf

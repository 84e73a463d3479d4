"""The model without physics: what it finds, what it is worth on validation runs, and that it finds nothing in noise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from flexdesign.core.model import Observation
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import SMALL_REDUCTION
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, fit_model
from flexdesign.estimation.model_selection.sparse_residual_model import MOST_TERMS, cost_of_terms, sparse_model
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.sums import NAMES, Sum, columns, least, offset
from tests.estimation.toys import Array, Run, parameter

N, SIGMA = 120, 0.02
HELD = ("kept", "apart")
T = np.arange(N) / N


def command(name: str) -> Array:
    """A slow random motion between minus one and one."""
    rng = np.random.default_rng([len(name), ord(name[0])])
    motion = sum(rng.normal() * np.sin(2 * math.pi * k * T + rng.uniform(0, 6)) for k in range(1, 6))
    return np.asarray(motion / np.abs(motion).max())


def gain(v: Mapping[str, float], run: Any) -> Array:
    return np.asarray(v["gain"] * command(run.name) + v[f"{run.name}:tilt"] * T)


def stage() -> Sum:
    tilts = [parameter(f"{name}:tilt", 0.0, -10.0, 10.0, run=name) for name in (*NAMES, *HELD)]
    return Sum().plus(gain, parameter("gain", 1.5, 0.1, 10.0), *tilts)


def features(observation: Observation, predicted: Array) -> dict[str, Array]:
    """Powers of the prediction; the first is the gain over again. One of random numbers, and one of nothing."""
    noise = np.random.default_rng(len(observation.name)).standard_normal(N)
    x = predicted / 2
    powers = {f"position^{k}": x**k for k in (1, 2, 3, 4)}
    return {**powers, "sign": np.tanh(10 * np.gradient(x, T)), "noise": noise, "nothing": np.zeros(N)}


def recorded(names: tuple[str, ...], seed: int, **amounts: float) -> list[Run]:
    rng, made = np.random.default_rng([seed, len(names)]), []
    for name in names:
        y = 2 * command(name)
        more = [
            amount * features(Run(name, T, None), y)[feature.replace("x", "position^")]
            for feature, amount in amounts.items()
        ]
        made.append(
            Run(name, T, y + np.sum([np.zeros(N), *more], axis=0) + rng.normal() + SIGMA * rng.standard_normal(N))
        )
    return made


def fit(
    seed: int = 0, *, held: Mapping[str, float] | None = None, **amounts: float
) -> tuple[EstimationTask, FittedModel]:
    kept = recorded(HELD, seed, **(amounts if held is None else held))
    suites = [
        Dataset(made, ColouredNoise(Process.white(SIGMA)), offset) for made in (recorded(NAMES, seed, **amounts), kept)
    ]
    task = EstimationTask(suites[0], suites[1], ("gain",), lambda _: {}, lambda _: stage(), 1e-3)
    found = fit_model(task, stage())
    assert found is not None
    return task, found


def test_a_quadratic_of_the_position_is_found() -> None:
    task, found = fit(x2=0.1)
    made = sparse_model(task, found, features)
    assert next(iter(made.terms)) == "position^2"
    # 360 values with noise 0.02 tell the amount of a column of size 0.4 to 0.003; what the gain imitates widens that.
    assert made.terms["position^2"] == pytest.approx(0.1, abs=0.02)
    assert made.shares["position^2"] > 0.9
    assert sum(made.shares.values()) == pytest.approx(1.0)
    assert made.held_gain > 0.8 * (found.validation_chi2 - 2 * N)


def test_gains_are_falls_of_the_cost() -> None:
    """All by linear algebra: columns as the fitted model predicts them, gain and tilts free on the fitted runs.

    On the validation runs nothing is free but the offset: amounts and gain are those of the fit, tilts those of before.
    """
    task, found = fit(x2=0.2, x3=0.15)
    made = sparse_model(task, found, features)
    names, noise = ["gain", *(f"{name}:tilt" for name in NAMES)], ColouredNoise(Process.white(SIGMA))
    observed = [record.observation for record in task.identify.records]
    right = np.concatenate([run.measured() / SIGMA for run in observed])
    before = columns(stage(), observed, names, noise)  # type: ignore[arg-type]
    made_of = [features(run, found.model.predict(run)) for run in observed]
    added = np.vstack([np.column_stack([f[name] for name in made.terms]) / SIGMA for f in made_of])
    after = np.column_stack([before, added])
    fall = least(before, right) - least(after, right)
    assert abs(math.sqrt(made.gain) - math.sqrt(fall)) < math.sqrt(
        SMALL_REDUCTION
    )  # which is what the fit left to be gained
    best, sigmas = np.linalg.lstsq(after, right)[0], np.sqrt(np.diag(np.linalg.inv(after.T @ after)))
    count = len(made.terms)
    assert np.all(np.abs(list(made.terms.values()) - best[-count:]) < sigmas[-count:])

    nudged, fall, squares = found.model.replace({"gain": best[len(observed)]}), 0.0, []
    for record in task.validate.records:
        run = record.observation
        here = found.model.predict(run)
        shapes = features(run, here)
        shift = sum(amount * shapes[name] for name, amount in made.terms.items()) + nudged.predict(run) - here
        left = [run.measured() - values for values in (here, here + shift)]
        fall += (np.var(left[0]) - np.var(left[1])) * N / SIGMA**2
        squares.append(np.var(shift))
    assert made.held_gain == pytest.approx(fall, rel=0.02)
    assert made.validation_rms == pytest.approx(math.sqrt(np.mean(squares)), rel=0.01)


def test_the_cost_of_terms_is_that_of_a_linear_fit_with_them() -> None:
    """Columns as the calibrated model predicts them, beside gain, tilts and offsets; others are not used."""
    task, found = fit(x2=0.2, x3=0.15)
    names, noise = ["gain", *(f"{name}:tilt" for name in NAMES)], ColouredNoise(Process.white(SIGMA))
    observed = [record.observation for record in task.identify.records]
    right = np.concatenate([run.measured() / SIGMA for run in observed])
    before = columns(stage(), observed, names, noise)  # type: ignore[arg-type]
    made_of = [features(run, found.model.predict(run)) for run in observed]
    for terms in (["position^2"], ["position^2", "position^3"], ["nothing"]):
        added = np.vstack([np.column_stack([f[name] for name in terms]) / SIGMA for f in made_of])
        expected = least(np.column_stack([before, added]), right)
        cost, step = cost_of_terms(task, found, features, terms)
        best = np.linalg.lstsq(np.column_stack([before, added]), right)[0]
        solution = found.solution
        gain = solution.x[solution.problem.where.names.index("gain")] + step[solution.problem.where.names.index("gain")]
        assert gain == pytest.approx(best[len(observed)], rel=1e-3)
        assert cost == pytest.approx(expected, rel=1e-3, abs=SMALL_REDUCTION)


def test_nothing_is_found_in_noise() -> None:
    """Chance takes up a term in one case of a thousand: of 40 cases one at most, at odds of 1 in 1000 for a second."""
    found = [sparse_model(*fit(seed), features) for seed in range(40)]
    assert sum(bool(made.terms) for made in found) <= 1
    assert all(made.gain == made.held_gain == made.validation_rms == 0 for made in found if not made.terms)


def test_what_the_gain_explains_is_not_explained_again() -> None:
    task, found = fit(x1=0.5)
    assert found.solution.problem.where.values(found.solution.x)["gain"] == pytest.approx(2.5, abs=0.02)
    assert "position^1" not in sparse_model(task, found, features).terms


def test_what_holds_for_the_fitted_runs_alone_gains_nothing_on_others() -> None:
    task, found = fit(x2=0.1, held={"x2": -0.1})
    made = sparse_model(task, found, features)
    assert made.gain > 0 > made.held_gain


def test_terms_are_few() -> None:
    """However much there is to explain."""

    def many(observation: Observation, predicted: Array) -> dict[str, Array]:
        rng = np.random.default_rng(len(observation.name))
        return {f"column {i}": observation.measured() + rng.standard_normal(N) for i in range(30)}

    task, found = fit(x2=1.0)
    assert len(sparse_model(task, found, many).terms) == MOST_TERMS


def test_without_runs_kept_apart_nothing_is_gained_on_them() -> None:
    task, _ = fit(x2=0.1)
    task = EstimationTask(
        task.identify,
        Dataset([], ColouredNoise(Process.white(SIGMA)), offset),
        ("gain",),
        lambda _: {},
        lambda _: stage(),
        1e-3,
    )
    found = fit_model(task, stage())
    assert found is not None
    made = sparse_model(task, found, features)
    assert "position^2" in made.terms
    assert (made.held_gain, made.validation_rms) == (0.0, 0.0)

"""Fits: of a design, without an effect, more exactly; what they leave of runs, and how far two of them differ."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from flexdesign.diagnosis.effect_selection import estimation_setup
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import SMALL_REDUCTION, linearise
from flexdesign.estimation.model_selection import fitted_model, model_comparison
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.sums import (
    HELD,
    NAMES,
    SIGMA,
    N,
    base,
    calibrated_stand,
    candidate,
    column,
    effects,
    fit_with,
    offset,
    recorded,
    stage,
    strength,
    task,
)
from tests.estimation.toys import Array, Run, parameter


def left_by_its_own(run: Run, shared: Array) -> Array:
    """What is left of a run with its own number and offset fitted, beside what is shared."""
    own = np.column_stack([np.ones(N), column(run, "own")])
    left = np.asarray(run.data) - shared
    return np.asarray(left - own @ np.linalg.lstsq(own, left)[0])


def shared(run: Run, p: float, q: float) -> Array:
    return p * column(run, "p") + q * column(run, "q")


def test_a_model_is_evaluated_with_nothing_but_initial_conditions_fitted() -> None:
    """By linear algebra; its own numbers stay, and the Jacobian holds them all the same."""
    about = task({})
    found = estimation_setup.evaluate_design(about, stage().replace({"p": 1.5, "q": -0.7}))
    assert found is not None
    values = {p.name: p.start for p in found.model.parameters()}
    assert (values["p"], values["q"]) == (1.5, -0.7)
    for dataset in (about.identify, about.validate):
        for record in dataset.records:
            run = record.observation
            expected = left_by_its_own(run, shared(run, 1.5, -0.7))  # type: ignore[arg-type]
            missed = float(np.sum((found.residuals_by_run[run.name] - expected) ** 2)) / SIGMA**2
            assert missed < SMALL_REDUCTION * found.discrepancy  # a fit ends where no step promises more
    assert {"p", "q"} <= set(found.solution.problem.where.names)
    assert set(found.solution.columns()) >= {"p", "q"}


def test_test_runs_are_predicted_in_the_end_and_change_nothing() -> None:
    about = task({})
    unseen = recorded({"p": 2.3}, 5, ("later",))
    model = stage().plus(
        lambda v, run: v["later:own"] * column(run, "own") * (run.name == "later"),
        parameter("later:own", 0.0, -10.0, 10.0, run="later"),
    )
    with_test = dataclasses.replace(about, test=Dataset(unseen, ColouredNoise(Process.white(SIGMA)), offset))
    plain, fit = (fitted_model.fit_model(each, model) for each in (about, with_test))
    assert plain is not None and fit is not None and "later" not in fit.residuals_by_run
    assert (fit.cost, fit.validation_chi2) == (plain.cost, plain.validation_chi2)
    assert fitted_model.predict_tests(about, plain) is plain
    last = fitted_model.predict_tests(with_test, fit)
    assert set(last.residuals_by_run) == {*NAMES, *HELD, "later"}
    assert (last.cost, last.validation_chi2, last.effects) == (fit.cost, fit.validation_chi2, fit.effects)
    for name in (*NAMES, *HELD):
        assert last.residuals_by_run[name] is fit.residuals_by_run[name]
    values = fit.solution.problem.where.values(fit.solution.x)
    expected = left_by_its_own(unseen[0], shared(unseen[0], values["p"], values["q"]))
    assert last.residuals_by_run["later"] == pytest.approx(expected, abs=0.02 * SIGMA)


def test_the_jacobian_of_a_design_knows_what_its_own_numbers_imitate() -> None:
    """No step is taken, so that it promises the fall of chi^2 that a calibration brings."""
    about = task({})
    found = estimation_setup.evaluate_design(about, stage().replace({"p": 1.5, "q": -0.7}))
    fitted = calibrated_stand(about)
    gradient = found.solution.project(found.solution.residuals)
    predicted_reduction = float(gradient @ found.solution.covariance @ gradient)
    assert predicted_reduction == pytest.approx(found.cost - fitted.cost, rel=1e-3)


# --- effects, with and without --------------------------------------------------------------------------------------


def test_a_model_takes_the_values_of_another_one() -> None:
    """Of numbers that both have and that have a value there; but for some."""
    model = base("p", "q", "r").replace({"p": 1.0, "q": 2.0, "r": 3.0})
    source = base("q", "r", "s", start=7.0).plus(lambda v, run: np.zeros(N), parameter("p", None, -9.0, 9.0))
    found, but = fitted_model.with_values(model, source), fitted_model.with_values(model, source, {"q"})
    assert {p.name: p.start for p in found.parameters()} == {"p": 1.0, "q": 7.0, "r": 7.0}
    assert {p.name: p.start for p in but.parameters()} == {"p": 1.0, "q": 2.0, "r": 7.0}


def test_effects_are_added_at_the_values_of_the_catalogue() -> None:
    found = fitted_model.with_effects(stage(), effects()[:2])
    assert {p.name for p in found.parameters()} - {p.name for p in stage().parameters()} == {"a", "b"}
    assert fitted_model.with_effects(found, ()) is found


def test_a_fit_is_made_again_without_an_effect_from_the_values_that_it_has() -> None:
    """The bare model has other values: it only says what there is without effects."""
    about = task({"b": 0.3, "c": 0.2})
    fit = fit_with(about, effects()[1:3])
    asked = list[list[str]]()

    def bare(model: object) -> object:
        asked.append([p.name for p in model.parameters()])  # type: ignore[attr-defined]
        return stage().replace({"p": -9.0, "q": 9.0})

    again = fitted_model.refit(dataclasses.replace(about, bare=bare), fit, fit.effects[1:])  # type: ignore[arg-type]
    assert again is not None and again.names == ("c",)
    assert asked == [[p.name for p in fit.model.parameters()]]
    assert {p.name for p in again.model.parameters()} == {p.name for p in fit.model.parameters()} - {"b"}
    # Both ended where less than a tenth of the discrepancy was to be gained.
    assert again.cost == pytest.approx(fit_with(about, effects()[2:3]).cost, abs=SMALL_REDUCTION * again.discrepancy)
    begun = again.solution.problem.model
    assert {p.name: p.start for p in begun.parameters() if p.name in "pqc"} == pytest.approx(
        {p.name: p.start for p in fit.model.parameters() if p.name in "pqc"}
    )


# --- the residual ---------------------------------------------------------------------------------------------------


def test_chi_squared_exceeds_noise_beyond_a_deviation_of_one_in_a_thousand() -> None:
    fit = calibrated_stand(task({}))
    samples = fit.solution.problem.dataset.samples
    assert samples == 3 * N and not fit.exceeds_noise
    for deviations, exceeds in ((-1.0, False), (3.2, False), (3.4, True)):
        size = math.sqrt(samples + deviations * math.sqrt(2 * samples))
        parts = tuple(size * np.eye(1, len(part))[0] * (k == 0) for k, part in enumerate(fit.solution.residuals))
        other = dataclasses.replace(fit, solution=dataclasses.replace(fit.solution, residuals=parts))
        assert other.fitted_chi2 == pytest.approx(size**2)
        assert other.excess == pytest.approx(max(deviations, 0.0) * math.sqrt(2 * samples))
        assert other.exceeds_noise is exceeds


def test_priors_of_shared_numbers_are_not_seen_and_those_of_runs_are() -> None:
    own = "one:own"
    free = calibrated_stand(task({}))
    value = free.solution.problem.where.values(free.solution.x)
    about = task({}, p=(value["p"] + 0.3, 0.1), **{own: (value[own] + 0.02, 0.01)})
    solution = about.problem(about.identify, free.model, about.free)
    held = linearise(solution, free.solution.x)
    assert held is not None
    fit = dataclasses.replace(free, solution=held)
    assert fit.cost == pytest.approx(free.cost + 3.0**2 + 2.0**2, rel=1e-6)
    assert fit.fitted_chi2 == pytest.approx(free.cost + 2.0**2, rel=1e-6)


def test_two_models_differ_by_what_no_offset_takes_away() -> None:
    """Runs begin in time in both; observations with weights count on their own."""
    model = base("p").plus(
        lambda v, run: v[f"{run.name}:late"] * column(run, "late") + v["offset"],
        strength("offset"),
        *(parameter(f"{name}:late", 0.0, -9.0, 9.0, run=name, null=0.0) for name in HELD),
    )
    about = task({})
    there = model.replace({"p": 0.3, "offset": 5.0, "kept:late": 1.0})
    parts = [0.3 * (column(record.observation, "p")) for record in about.validate.records]
    spread = math.sqrt(np.mean([np.var(part) for part in parts]))
    assert model_comparison.difference(about.validate, model, there, {}) == pytest.approx(spread, rel=1e-9)
    weights = {"apart": np.full(N, 10.0)}
    weighted = 10.0 * math.sqrt(np.mean((parts[1] + 5.0) ** 2))
    assert model_comparison.difference(about.validate, model, there, weights) == pytest.approx(weighted, rel=1e-9)
    weights = {"apart": np.full(N, 1e-3)}
    assert model_comparison.difference(about.validate, model, there, weights) == pytest.approx(
        np.std(parts[0]), rel=1e-9
    )


def test_an_effect_at_its_null_does_nothing_in_any_run() -> None:
    effect = candidate("d")
    model = effect.add(stage()).plus(  # type: ignore[attr-defined]
        lambda v, run: v.get(f"{run.name}:d", 0.0) * column(run, "d"),
        parameter("one:d", 0.4, -9.0, 9.0, run="one"),
    )
    there = model_comparison.without_effect(model.replace({"d": 0.3, "p": 2.0}), effect)
    assert {p.name: p.start for p in there.parameters() if p.name in ("d", "one:d", "p")} == {
        "d": 0.0,
        "one:d": 0.0,
        "p": 2.0,
    }

"""Strengths that differ from run to run: the rate of a drift, the effect of a temperature, a payload that was changed.

At first the strength of an effect has one value for all runs. It may instead have a mean and a deviation in each run (a
random effect, Laird and Ware 1982). The checks are those of effects, see `estimation.criterion`. The deviations must
lower chi^2 of the fitted runs by more than chance does with this number of parameters, times the discrepancy. Each
validation run has its own deviation, as it has its own initial conditions; the deviations must remove a share of the
unexplained mean square, and more than the tolerance. For an effect that is added with them the share is `SHARE`. For
one in the model it is the larger `large_share`, as the strength of an approximation differs from run to run, too.

A linear drift of each run can imitate anything slow. The deviation that is found in one half of a validation run must
therefore predict the other half (cross-validation, Stone 1974).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.special import chdtri

from flexdesign import effects
from flexdesign.core.arrays import Array, Flags
from flexdesign.core.errors import InputError
from flexdesign.core.model import Disturbance, Model, parameter_of
from flexdesign.diagnosis.result import IdentifiedEffect, Value
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.estimation.criterion import HALF_WIDTH, LEVEL, SHARE, explained_share, large_share
from flexdesign.estimation.least_squares.levenberg_marquardt import Solution, solve
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, fit_model
from flexdesign.estimation.model_selection.model_comparison import (
    Step,
    Trial,
    best_of,
    compare,
    rank,
)
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.measurements.recordings import Run


@dataclass(frozen=True)
class ByRun:
    """A parameter that differs from run to run.

    Parameters
    ----------
    mean
        Its mean over the fitted runs.
    runs
        Its value in each run, by name.
    """

    mean: Value
    runs: Mapping[str, Value]


# --- selection ------------------------------------------------------------------------------------------------------


def vary_by_run(task: EstimationTask, fit: FittedModel) -> FittedModel:
    """Return the fit with strengths that differ from run to run if the runs call for that; else the same fit."""
    tested = [
        effect  # linear ones without a parameter of each run
        for effect in fit.effects
        if not effect.has_own_trials
        and (strength := parameter_of(fit.model, effect.strength)).scale == "linear"
        and not strength.twin
    ]
    for effect in tested if (runs := _runs(task, fit)) else ():
        common = parameter_of(fit.model, effect.strength).start or 0.0
        gain, own = _score(fit, fit.solution.columns()[effect.strength], runs, common)
        level, share = LEVEL / len(tested), large_share()
        fit = _varied(task, fit, fit.model, fit.effects, effect.strength, gain, own, level, share) or fit
    return fit


def vary_step(task: EstimationTask, before: FittedModel, step: Step, *, candidates: Sequence[Candidate]) -> Step:
    """Return a step of the selection in which effects that add to the reading may differ from run to run.

    If the mean of a drift over the runs is near zero, it explains little with one rate for all runs, and another effect
    may be named in its place.
    """
    runs = _runs(task, before)
    if not runs or not (before if step.chosen is None else step.chosen.fit).exceeds_noise:
        return step
    score = step.trials[0].score if step.trials else float(chdtri(1, LEVEL))
    known = {*before.names, *(name for trial in step.trials for name in trial.names if not trial.reason)}
    varied = list[Trial]()
    for candidate in candidates:
        if candidate.name not in known and _adds(candidate):
            made = _with(task, before, candidate, runs, LEVEL / len(candidates))
            varied += [] if made is None else [compare(task, before, made, (candidate.name,), score)]
    names = [trial.names for trial in varied]
    trials = rank([*varied, *(t for t in step.trials if t.names not in names)])
    return Step(best_of(task, trials), tuple(trials)) if varied else step


def _adds(candidate: Candidate) -> bool:
    """Tell whether a candidate only adds to the reading, in proportion to its strength and the same way in each run."""
    faces = effects.find(candidate.name).faces
    only_adds = bool(faces) and all(isinstance(face, Disturbance) for face in faces)
    return only_adds and candidate.free == (candidate.strength,)


def _runs(task: EstimationTask, fit: FittedModel) -> list[str]:
    """Return the fitted runs, which may have their own strengths; none if there are too few, or no validation runs."""
    apart = cast(AxisDynamics, fit.model).apart
    fitted, validated = ([name for name in data.names if name in apart] for data in (task.identify, task.validate))
    return fitted if len(fitted) > 1 and validated else []


def _score(
    fit: FittedModel, columns: Sequence[Array | None], runs: Sequence[str], common: float
) -> tuple[float, dict[str, float]]:
    """Return the predicted fall of chi^2 if each run has its own value (score test: Rao 1948), and these values.

    A column is the derivative of the residual of a record by the strength; in each run it is also the derivative by the
    deviation.
    """
    solution, size = fit.solution, len(runs)
    changes, own, gradient = np.zeros((size, len(solution.x))), np.zeros(size), np.zeros(size)
    records = solution.problem.dataset.records
    for record, column, jacobian, residual in zip(records, columns, solution.jacobian, solution.residuals, strict=True):
        if column is not None and record.observation.name in runs:
            k = runs.index(record.observation.name)
            changes[k, jacobian.places] = jacobian.matrix.T @ column
            own[k], gradient[k] = column @ column, column @ residual
    curvature = np.diag(own) - changes @ solution.covariance @ changes.T
    # The mean is a free parameter already; without a limit its rounding would look like a deviation.
    deviations = -np.linalg.pinv(curvature, rcond=1e-8, hermitian=True) @ gradient
    return -float(gradient @ deviations), dict(zip(runs, (common + deviations).tolist(), strict=True))


def _with(
    task: EstimationTask, fit: FittedModel, candidate: Candidate, runs: Sequence[str], level: float
) -> FittedModel | None:
    """Return the fit with an effect that differs from run to run; None if the runs do not call for it."""
    values, model, dataset = candidate.trials[0], candidate.add(fit.model), fit.solution.problem.dataset
    try:
        at = model.replace(values)
        pairs = [(r, np.asarray(at.predict(r.observation)) - fit.model.predict(r.observation)) for r in dataset.records]
    except InputError:  # it needs a column that was not recorded
        return None
    columns = [-dataset.whitened(record, change) / values[candidate.strength] for record, change in pairs]
    gain, own = _score(fit, columns, runs, 0.0)
    together, exact = (*fit.effects, candidate), task.fine(model, 1.0)
    return _varied(task, fit, exact, together, candidate.strength, gain, own, level, SHARE)


def _varied(
    task: EstimationTask,
    before: FittedModel,
    model: Model,
    together: tuple[Candidate, ...],
    name: str,
    gain: float,
    own: Mapping[str, float],
    level: float,
    share: float,
) -> FittedModel | None:
    """Return the fit in which a strength differs from run to run, by about its own size (a weak prior).

    None if fitted and validation runs do not call for the values `own` of each run, which promise a gain.
    """
    if gain < max(float(chdtri(len(own), level)), share * before.excess):
        return None
    task.progress(f"asking whether {name} differs from run to run")
    values = np.array(list(own.values()))
    mean, size = float(values.mean()), float(np.sqrt(np.mean(values**2)))
    model = cast(AxisDynamics, model)
    start = {f"{run}:{name}": value - mean for run, value in own.items()}
    varied = replace(
        model.replace({name: float(np.clip(mean, *parameter_of(model, name).plausible))}),
        by_run={**model.by_run, name: size},
    )
    if (after := fit_model(task, varied.replace(start), together)) is None:
        return None
    scored = task.scored or task.validate.names
    errors = [fit.rms(scored, task.scales) for fit in (before, after)]
    runs = {p.run for p in after.model.parameters() if p.name.endswith(f":{name}")}
    fitted, validated = (
        float(chdtri(len(runs & {*dataset.names}), level)) * after.discrepancy
        for dataset in (task.identify, task.validate)
    )
    is_needed = (
        before.fitted_chi2 - after.fitted_chi2 > fitted
        and explained_share(errors[0], errors[1], task.noise_rms) > share
        and math.sqrt(max(errors[0] ** 2 - errors[1] ** 2, 0.0)) > task.tolerance
        and _predicted_gain(task, after, name) > validated
    )
    return after if is_needed else None


# --- cross-validation -----------------------------------------------------------------------------------------------


def _predicted_gain(task: EstimationTask, fit: FittedModel, name: str) -> float:
    """Return the fall of chi^2 of each half of the validation runs with the deviation fitted to the other half.

    The offset is that of the other half, too; all other parameters of the run stay.
    """
    gain, model = 0.0, cast(AxisDynamics, fit.model)
    size = model.by_run[name]
    deviations = {p.run: p.start or 0.0 for p in model.parameters() if p.name == f"{p.run}:{name}"}
    for record in task.validate.records:
        run = cast(Run, record.observation)
        if run.name not in deviations:
            continue
        deviation = deviations[run.name]
        change = np.asarray(model.replace({f"{run.name}:{name}": deviation + size}).predict(run)) - model.predict(run)
        residual = np.where(record.present, fit.residuals_by_run[run.name] + change * deviation / size, 0.0)
        table = np.column_stack([np.ones_like(change), change, residual])
        halves = [_whiten(task, run, model.name, table, half) for half in _halves(change, record.present)]
        for fitted, predicted in (halves, reversed(halves)):
            with_prior = np.vstack([fitted, [0.0, 1.0, 0.0]])  # a deviation has a prior
            both = np.linalg.lstsq(with_prior[:, :2], with_prior[:, 2], rcond=None)[0]
            offset = np.linalg.lstsq(fitted[:, :1], fitted[:, 2], rcond=None)[0]
            after, before = predicted[:, 2] - predicted[:, :2] @ both, predicted[:, 2] - predicted[:, :1] @ offset
            gain += float(before @ before - after @ after)
    return gain


def _halves(change: Array, present: Flags) -> list[Flags]:
    """Return the flags of two parts of a run, each with half the sum of squares of a change."""
    energy = np.cumsum(np.where(present, change - change[present].mean(), 0.0) ** 2)
    return [present & (energy <= energy[-1] / 2), present & (energy > energy[-1] / 2)]


def _whiten(task: EstimationTask, run: Run, axis: str, table: Array, rows: Flags) -> Array:
    """Return columns whitened as a run with gaps in all rows that are not kept."""
    part = replace(run, columns={**run.columns, axis: np.where(rows, run.measured(), np.nan)})
    return np.asarray(task.validate.noise.whiten(part, table * rows[:, None]))


# --- values ---------------------------------------------------------------------------------------------------------


def of_runs(task: EstimationTask, fit: FittedModel) -> dict[str, ByRun]:
    """Return the parameters that differ from run to run, by name, with 95 % intervals.

    Intervals of validation and test runs are conditional on the fitted values of the parameters that runs share.
    """
    names = [name for name in cast(AxisDynamics, fit.model).by_run if name in fit.solution.problem.where.names]
    if not names:
        return {}
    solutions = [fit.solution]
    for dataset in (task.validate, task.test):
        if dataset is not None and dataset.records:
            problem = task.problem(dataset, fit.model)
            solution = solve(problem, problem.where.start)
            solutions += [solution] if solution is not None else []
    return {name: _by_run(fit, solutions, name) for name in names}


def _by_run(fit: FittedModel, solutions: Sequence[Solution], name: str) -> ByRun:
    runs = {
        each.rpartition(":")[0]: _value(fit, solution, name, each)
        for solution in solutions
        for each in solution.problem.where.names
        if each.endswith(f":{name}")
    }
    mean, half = fit.mean_over_runs(name)
    return ByRun(Value(parameter_of(fit.model, name), mean, (mean - half, mean + half)), runs)


def _value(fit: FittedModel, solution: Solution, name: str, deviation: str) -> Value:
    """Return a parameter plus the deviation of a run; the parameter itself may be fitted or held in the solution."""
    where, parameter = solution.problem.where, parameter_of(fit.model, name)
    contrast = np.array([each in (name, deviation) for each in where.names], dtype=float)
    value = float(contrast @ solution.x) + (0.0 if name in where.names else float(parameter.start or 0.0))
    half = fit.half_width_of(contrast, solution)
    return Value(parameter, value, (value - half, value + half))


def with_means(fit: FittedModel) -> AxisDynamics:
    """Return a fitted model with strengths at their means over the fitted runs, without the shift by weak priors."""
    model = cast(AxisDynamics, fit.model)
    where = fit.solution.problem.where
    names = [name for name in model.by_run if name in where.names]
    return model.replace({name: fit.mean_over_runs(name)[0] for name in names})


def with_runs(named: IdentifiedEffect, by_run: Mapping[str, ByRun]) -> IdentifiedEffect:
    """Return an effect with the mean and the values of its strength, if that differs from run to run."""
    for value in named.values:
        if (found := by_run.get(value.parameter.name)) is not None:
            values = tuple(found.mean if each is value else each for each in named.values)
            return replace(named, values=values, by_run=found.runs)
    return named


def of_further_run(named: IdentifiedEffect) -> tuple[Value, ...]:
    """Return an effect's numbers with the intervals that a further run's are in: about a mean those of the runs."""
    if not named.by_run:
        return named.values
    spread = HALF_WIDTH * float(np.std([each.value for each in named.by_run.values()], ddof=1))
    varying = {each.parameter.name for each in named.by_run.values()}
    wider = {each.parameter.name: (each.value - spread, each.value + spread) for each in named.values}
    return tuple(
        replace(each, interval=wider[each.parameter.name]) if each.parameter.name in varying else each
        for each in named.values
    )

"""A model with some effects: fitted to the identification runs, evaluated on the validation runs, and restarted."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import ndtri

from flexdesign.core.arrays import Array
from flexdesign.core.model import Model, parameter_of
from flexdesign.estimation.criterion import HALF_WIDTH, LEVEL, SHARE, is_undetermined, significant_deviation
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import FULL, ROUGH, Columns, Effort, Solution, solve
from flexdesign.estimation.model_selection.estimation_task import (
    EstimationTask,
    fit_initial_states,
    search_initial_states,
)
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.noise.autoregressive import process_of

#: First factor by which thresholds are changed, up and down: smaller changes are within the reach of derivatives.
THRESHOLD_FACTOR = 1.1


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A model with some effects, fitted and evaluated.

    Parameters
    ----------
    effects
        The effects, in the order in which they were added.
    solution
        The fit to the identification runs.
    model
        The fitted model, with the initial conditions of the validation runs.
    validation_chi2
        chi^2 of the validation runs.
    residuals_by_run
        Residual of every run by name, offsets taken out; n values [response].
    """

    effects: tuple[Candidate, ...]
    solution: Solution
    model: Model
    validation_chi2: float
    residuals_by_run: Mapping[str, Array]

    @property
    def cost(self) -> float:
        """chi^2 of the fitted runs and of the priors."""
        return self.solution.cost

    @property
    def fitted_chi2(self) -> float:
        """chi^2 of the fitted runs and of the priors of their initial conditions, without other priors."""
        problem = self.solution.problem
        of_runs = {parameter.name for parameter in problem.where.parameters if parameter.run}
        own = problem.prior_residual(self.solution.x)[[name in of_runs for name in problem.where.known]]
        return float(sum(part @ part for part in self.solution.residuals) + own @ own)

    @property
    def excess(self) -> float:
        """Chi^2 of the fitted runs less the number of samples; at least zero."""
        return max(self.fitted_chi2 - self.solution.problem.dataset.samples, 0.0)

    @property
    def exceeds_noise(self) -> bool:
        """Whether chi^2 of the fitted runs is larger than white noise makes it."""
        return self.excess > significant_deviation() * math.sqrt(2.0 * self.solution.problem.dataset.samples)

    @property
    def scale(self) -> float:
        """Reduced chi^2 of the fitted runs."""
        return self.cost / self.solution.problem.dataset.samples

    @cached_property
    def discrepancy(self) -> float:
        """Factor that divides the evidence, see `Dataset.discrepancy`."""
        return self.solution.problem.dataset.discrepancy(self.solution.residuals)

    @property
    def is_white(self) -> bool:
        """Whether no residual of the fitted runs is correlated from one sample to the next."""
        pairs = zip(self.solution.problem.dataset.records, self.solution.residuals, strict=True)
        return not any(process_of(part[: len(record.measured)]).order for record, part in pairs)

    def jumps(self, runs: Collection[str]) -> int:
        """Return the number of sudden changes in the whitened residual of some of the fitted runs.

        They are the samples farther from zero than the largest one of Gaussian noise, but for the level of evidence.
        """
        count = 0
        for record, part in zip(self.solution.problem.dataset.records, self.solution.residuals, strict=True):
            if record.observation.name in runs:
                sizes = np.abs(part[: len(record.measured)][record.present])
                largest = float(ndtri(1 - LEVEL / (2 * len(sizes)))) / ndtri(0.75)
                count += int((sizes > largest * np.median(sizes)).sum())
        return count

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(effect.name for effect in self.effects)

    def rms(self, runs: Sequence[str], scales: Mapping[str, Array] | None = None) -> float:
        """Return the rms residual of some runs [response].

        Parameters
        ----------
        runs
            Names of observations.
        scales
            Factors of the values of an observation, by its name; see `EstimationTask.scales`.
        """
        residual = np.concatenate([self.residuals_by_run[name] * (scales or {}).get(name, 1.0) for name in runs])
        return float(np.sqrt(np.nanmean(residual**2)))

    def bic(self, discrepancy: float) -> float:
        """Return BIC over all runs (Schwarz 1978), times the discrepancy of the models that are compared.

        It is the same for all of them, as in QAIC (Burnham and Anderson 2002, section 2.5). It divides chi^2 of the
        runs alone: what a model lacks takes nothing from the priors of its parameters.
        """
        free = {name for effect in self.effects for name in effect.free}
        # A parameter that differs from run to run counts once for each run.
        count = sum(p.name.rpartition(":")[2] in free for p in self.solution.problem.where.parameters)
        penalty = count * math.log(self.solution.problem.dataset.samples) + self.cost - self.fitted_chi2
        return self.fitted_chi2 + self.validation_chi2 + penalty * discrepancy

    def ends(self) -> list[str]:
        """Return the parameters that the fit moved to an end of their plausible range."""
        where, x = self.solution.problem.where, self.solution.x
        near = [np.isclose(x, end, rtol=1e-6, atol=0.0) for end in (where.lower, where.upper)]
        return [name for name, is_end in zip(where.names, np.any(near, axis=0), strict=True) if is_end]

    def at_bound(self) -> list[str]:
        """Return the parameters of effects at an end of their plausible range.

        Parameters that the runs do not determine are left out, as they may end anywhere; strengths are not.
        """
        where, free = self.solution.problem.where, {name for effect in self.effects for name in effect.free}
        strengths, values = {effect.strength for effect in self.effects}, where.values(self.solution.x)
        return [
            name
            for name in self.ends()
            if name in free
            and where.parameters[where.names.index(name)].null != values[name]
            and (name in strengths or not self.is_undetermined(where.names.index(name)))
        ]

    def half_width(self, j: int) -> float:
        """Return half the 95 % interval of a coordinate; infinite if the runs do not depend on it."""
        if self.solution.normal[j, j] <= 0:
            return math.inf
        contrast = np.zeros(len(self.solution.x))
        contrast[j] = 1.0
        return self.half_width_of(contrast)

    def half_width_of(self, contrast: Array, solution: Solution | None = None) -> float:
        """Return half the 95 % interval of a linear combination of coordinates, by the covariance.

        The covariance is that for the stated noise, times the discrepancy.

        Parameters
        ----------
        contrast
            Weights of the coordinates.
        solution
            The solution with these coordinates; by default that of this fit.
        """
        covariance = (solution or self.solution).covariance
        variance = float(contrast @ covariance @ contrast) * self.discrepancy
        return HALF_WIDTH * math.sqrt(max(variance, 0.0))

    def deviations(self, name: str) -> list[str]:
        """Return the names of the deviations of the fitted runs from a parameter; none if all runs share one value."""
        return [p.name for p in self.solution.problem.where.parameters if p.run and p.name.endswith(f":{name}")]

    def mean_over_runs(self, name: str) -> tuple[float, float]:
        """Return a parameter plus the mean deviation of the fitted runs, and half its 95 % interval."""
        own = self.deviations(name)
        names = self.solution.problem.where.names
        contrast = np.array([(each == name) + (each in own) / max(len(own), 1) for each in names])
        return float(contrast @ self.solution.x), self.half_width_of(contrast)

    def is_undetermined(self, j: int) -> bool:
        """Tell whether the 95 % interval of a coordinate covers too much of its plausible range."""
        return is_undetermined(self.half_width(j), float(self.solution.problem.where.span[j]))


# --- fits -----------------------------------------------------------------------------------------------------------


def fit_model(
    task: EstimationTask,
    model: Model,
    effects: tuple[Candidate, ...] = (),
    *,
    old: Columns | None = None,
    effort: Effort = FULL,
) -> FittedModel | None:
    """Fit a model with effects, see `solve_case`, and evaluate it on the validation runs; None where that fails."""
    solution = solve_case(task, model, effects, old=old, effort=effort)
    return None if solution is None else evaluate_fit(task, solution, effects)


def solve_case(
    task: EstimationTask,
    model: Model,
    effects: tuple[Candidate, ...] = (),
    *,
    old: Columns | None = None,
    effort: Effort = FULL,
) -> Solution | None:
    """Fit a model with effects to the identification runs; None where it cannot be simulated.

    It starts at the values of the model, and perhaps with `old` columns of the Jacobian of a fit nearby.
    """
    task = task.prepared(task, model)
    free = [*task.free, *(name for effect in effects for name in effect.free)]
    problem = task.problem(task.identify, model, free)
    return solve(problem, problem.where.start, effort, old if old and _fits(old, task.identify) else None)


def _fits(old: Columns, dataset: Dataset) -> bool:
    """Tell whether columns of a Jacobian have the rows of a data set, whose initial conditions may have changed."""
    rows = [record.rows for record in dataset.records]
    return all(c is None or len(c) == n for parts in old.values() for c, n in zip(parts, rows, strict=True))


def evaluate_fit(task: EstimationTask, solution: Solution, effects: tuple[Candidate, ...]) -> FittedModel | None:
    """Predict the validation runs with a fitted model, after their initial conditions are fitted."""
    model, validation_chi2 = solution.problem.at(solution.x), 0.0
    task = task.prepared(task, model)
    task = replace(task, identify=solution.problem.dataset, validate=task.validate.at(model))
    if task.validate.records:
        initialised = fit_initial_states(task, task.validate, search_initial_states(task, task.validate, model))
        if initialised is None:
            return None
        model, validation_chi2 = initialised.problem.at(initialised.x), initialised.cost
    records = [(dataset, record) for dataset in (task.identify, task.validate) for record in dataset.records]
    residuals = task.each(lambda pair: pair[0].remainder(pair[1], model.predict(pair[1].observation)), records)
    names = [record.observation.name for _, record in records]
    return FittedModel(effects, solution, model, validation_chi2, dict(zip(names, residuals, strict=True)))


def predict_tests(task: EstimationTask, fit: FittedModel) -> FittedModel:
    """Return a fit with the residuals of the test runs, after their initial conditions are fitted."""
    if (
        task.test is None
        or (tested := evaluate_fit(replace(task, validate=task.test), fit.solution, fit.effects)) is None
    ):
        return fit
    own = {p.name: p.start for p in tested.model.parameters() if p.run in task.test.names and p.start is not None}
    residuals = {**tested.residuals_by_run, **fit.residuals_by_run}
    return replace(fit, model=fit.model.replace(own), residuals_by_run=residuals)


def refit(task: EstimationTask, fit: FittedModel, effects: tuple[Candidate, ...]) -> FittedModel | None:
    """Fit a model with some of the effects of a fit, from its values.

    An effect may be in the fit several times (`second_mode`, `second_mode.2`). The first names are then kept, with the
    values of those that were asked for.
    """
    effects, renamed = _renumber(fit, effects)
    return fit_model(task, with_other_effects(task, fit, effects).replace(renamed), effects)


def with_other_effects(task: EstimationTask, fit: FittedModel, effects: Sequence[Candidate], *others: Model) -> Model:
    """Return the model of a fit with other effects, at the values of the fit, or else at those of other models.

    A bandwidth, a delay or a limit is a parameter of the model itself. Its value is dropped with the effect that it
    belongs to.
    """
    dropped = {name for effect in fit.effects if effect not in effects for name in effect.free}
    model = with_effects(task.bare(fit.model), effects)
    for source in (*others, fit.model):
        model = with_values(model, source, dropped)
    return model


def fit_in_place(
    task: EstimationTask, fit: FittedModel, name: str, other: Candidate, source: Model
) -> FittedModel | None:
    """Return the fit with another effect in the place of one, from the values that the other has in a model."""
    effects = tuple(other if effect.name == name else effect for effect in fit.effects)
    task.progress(f"fitting with {other.name} in the place of {name}")
    return fit_model(task, with_other_effects(task, fit, effects, source), effects)


def _renumber(fit: FittedModel, effects: tuple[Candidate, ...]) -> tuple[tuple[Candidate, ...], dict[str, float]]:
    """Return the effects, repeated ones under their first names, and the values that these take over."""
    dropped = {effect.name: effect for effect in fit.effects if effect not in effects}
    kept, values = list[Candidate](), dict[str, float]()
    for effect in effects:
        if effect.after in dropped:
            first = dropped.pop(effect.after)
            values |= {
                name: parameter_of(fit.model, name.replace(first.name, effect.name, 1)).start or 0.0
                for name in first.free
            }
            dropped[effect.name], effect = effect, first
        kept.append(effect)
    return tuple(kept), values


def with_effects(model: Model, effects: Sequence[Candidate]) -> Model:
    """Return a model with effects added, at the values of the catalogue."""
    for effect in effects:
        model = effect.add(model)
    return model


def with_values(model: Model, source: Model, but: Collection[str] = ()) -> Model:
    """Return a model at the values of the parameters of another one, except for some."""
    values = {parameter.name: parameter.start for parameter in source.parameters() if parameter.name not in but}
    return model.replace({p.name: start for p in model.parameters() if (start := values.get(p.name)) is not None})


# --- restarts -----------------------------------------------------------------------------------------------------


def escape(task: EstimationTask, fit: FittedModel, names: Sequence[str] | None = None) -> FittedModel:
    """Return the best of fits restarted near one that may be in a local minimum (multistart).

    Hysteresis is not differentiable where a threshold is met or a voltage turns, so that chi^2 has local minima. Fits
    restart from other initial states, then with larger and smaller thresholds (of the effects `names`, by default all),
    each step twice as far as the last while chi^2 falls by more than one (pattern search: Hooke and Jeeves 1961). This
    is repeated until nothing lowers chi^2: other thresholds may call for other initial states.
    """
    best, model = fit, search_initial_states(task, fit.solution.problem.dataset, fit.model)
    if model is not fit.model:
        best = _better(best, fit_model(task, model, fit.effects, old=fit.solution.columns()))
    restarted = [effect for effect in fit.effects if names is None or effect.name in names]
    for name in (name for effect in restarted for name in effect.hidden):
        task.progress(f"fitting with other values of {name}")
        rough = _search_threshold(task, best, name)
        if rough is not None:
            model = task.fine(rough.problem.at(rough.x), best.scale)
            best = _better(best, fit_model(task, model, fit.effects, old=rough.columns()))
    return fit if best is fit else escape(task, best, names)


def _better(fit: FittedModel, other: FittedModel | None) -> FittedModel:
    return other if other is not None and other.cost < fit.cost - fit.discrepancy else fit


def _search_threshold(task: EstimationTask, fit: FittedModel, name: str) -> Solution | None:
    """Return the best of rough fits that start with another value of a threshold; None if none is better."""
    model, best = task.coarse(fit.model), None
    cost = fit.solution.problem.cost_of(model, fit.solution.x)
    if not abs(cost - fit.cost) < SHARE * fit.cost:  # coarse steps change the cost by too much
        model, cost = fit.model, fit.cost
    low, high = parameter_of(model, name).plausible
    for factor in (THRESHOLD_FACTOR, 1 / THRESHOLD_FACTOR):
        while low < (elsewhere := factor * (parameter_of(model, name).start or 0.0)) < high:
            rough = solve_case(task, model.replace({name: elsewhere}), fit.effects, effort=ROUGH)
            if rough is None or rough.cost >= cost - fit.discrepancy:
                break
            best, cost, model, factor = rough, rough.cost, rough.problem.at(rough.x), factor * factor
    return best

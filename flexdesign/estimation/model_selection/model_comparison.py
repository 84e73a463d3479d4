"""Effects fitted in addition to those of the present model, and compared by `flexdesign.estimation.criterion`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Model, parameter_of
from flexdesign.estimation import criterion
from flexdesign.estimation.criterion import Evidence
from flexdesign.estimation.least_squares.dataset import Dataset, Record
from flexdesign.estimation.least_squares.residual_function import coordinate, null_of, value
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.score_test import Candidate, score_of_columns


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate, fitted in addition to the effects of the present model.

    Parameters
    ----------
    names
        Effects added at this step, one or two.
    fit
        The fit.
    gain
        Fall of chi^2 of the fitted runs, less what further initial conditions explain by chance; or the score of the
        columns of `Candidate.trace`, if that is less.
    share
        Share of the unexplained mean square of the validation runs that it removes.
    error
        Rms residual of the validation runs [response].
    critical_gain, score
        Critical value of the gain, with the discrepancy; and of the largest score of the catalogue.
    reason
        Why the trial is not accepted; empty if it is.
    is_small
        Whether the trial is refused because it changes the prediction by less than the tolerance.
    """

    names: tuple[str, ...]
    fit: FittedModel
    gain: float
    share: float
    error: float
    critical_gain: float
    score: float
    reason: str
    is_small: bool = False


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the selection: its trials, and the one that was chosen.

    Parameters
    ----------
    chosen
        The trial whose effects were added; None at the last step, where none was accepted.
    trials
        All trials, best first.
    """

    chosen: Trial | None
    trials: tuple[Trial, ...]

    @property
    def alike(self) -> tuple[Trial, ...]:
        """Accepted trials that these runs do not distinguish from the chosen one."""
        if self.chosen is None:
            return ()
        others = (trial for trial in self.trials if trial.names != self.chosen.names and not trial.reason)
        return tuple(trial for trial in others if is_indistinguishable(self.chosen.fit, trial.fit))


def compare(
    task: EstimationTask, before: FittedModel, after: FittedModel, names: tuple[str, ...], score: float
) -> Trial:
    """Return the trial of the effects `names`, by which the fit `after` extends the fit `before`.

    `score` is the critical value of the largest score, see `criterion.critical_value`.
    """
    # Priors do not count: an effect is not needed because it lets a parameter stay at its prior.
    more_nuisance = after.solution.problem.dataset.nuisance_dof - before.solution.problem.dataset.nuisance_dof
    gain = before.fitted_chi2 - after.fitted_chi2 - max(more_nuisance, 0.0)
    is_validated = bool(task.validate.records)
    scored = task.scored or (task.validate if is_validated else task.identify).names
    errors = [fit.rms(scored, task.scales) for fit in (before, after)]
    added = [effect for effect in after.effects if effect.name in names]
    bounds = after.at_bound()
    share = criterion.explained_share(errors[0], errors[1], task.noise_rms)
    # The prediction of new runs has no trigger delay. A lag that each old run fitted as its trigger delay therefore
    # changes the prediction of new runs; it must improve that of the old runs as well.
    improvement = math.sqrt(max(errors[0] ** 2 - errors[1] ** 2, 0.0))
    evidence = Evidence(
        gain=gain,
        needed=criterion.critical_value(score, sum(len(effect.free) for effect in added)) * after.discrepancy,
        helps=not is_validated or after.validation_chi2 < before.validation_chi2,
        share=share if is_validated else 1.0,
        change=min(improvement, largest_difference(task, before.model, after.model)),
        own_change=min(largest_difference(task, without_effect(after.model, effect), after.model) for effect in added),
        tolerance=task.tolerance,
        trace=min((_trace(before, after, effect) for effect in added), default=math.inf),
        at_bound=tuple(effect.strength for effect in added if effect.strength in bounds),
        open=tuple(effect.strength for effect in added if not is_determined(after, effect)),
    )
    gain = min(gain, evidence.trace)
    return Trial(names, after, gain, share, errors[1], evidence.needed, score, evidence.refusal, evidence.is_small)


def _trace(before: FittedModel, after: FittedModel, effect: Candidate) -> float:
    """Return the score of the columns of `Candidate.trace` in the fit without the effect; infinite without columns.

    A sinusoid too small to be seen may still smooth the law of a friction (dither), as another law of friction does.
    """
    if effect.trace is None:
        return math.inf
    records = before.solution.problem.dataset.records
    return score_of_columns(before.solution, [effect.trace(after.model, record.observation) for record in records])


def is_determined(fit: FittedModel, effect: Candidate) -> bool:
    """Tell whether the 95 % interval of the strength of an effect excludes its null, with the discrepancy.

    A strength that differs from run to run is determined if it is determined in one run: its mean may be near zero.
    """
    solution = fit.solution
    where = solution.problem.where
    j = where.names.index(effect.strength)
    parameter = where.parameters[j]
    null = 0.0 if parameter.scale == "inverse" else null_of(parameter)
    if parameter.scale == "log":  # its null is infinitely far away; zero is one relative unit away
        null = float(solution.x[j]) - 1.0
    elif parameter.scale == "linear":
        null = coordinate(parameter, null)
    deviations = [k for k, name in enumerate(where.names) if name.endswith(f":{effect.strength}")]
    for summands in [[j, k] for k in deviations] or [[j]]:
        contrast = np.zeros(len(solution.x))
        contrast[summands] = 1.0
        if criterion.excludes(float(solution.x[summands].sum()), null, fit.half_width_of(contrast)):
            return True
    return False


def rank(trials: Sequence[Trial]) -> list[Trial]:
    """Return trials with the best one first, by BIC at the least discrepancy among them."""
    least = min((trial.fit.discrepancy for trial in trials), default=1.0)
    return sorted(trials, key=lambda trial: trial.fit.bic(least))


def bic_lead(one: FittedModel, other: FittedModel) -> float:
    """Return by how much BIC prefers one fit to another, at the lesser discrepancy of both."""
    least = min(one.discrepancy, other.discrepancy)
    return other.bic(least) - one.bic(least)


def best_of(task: EstimationTask, trials: Sequence[Trial]) -> Trial | None:
    """Return the best accepted trial, or None.

    A trial ranked behind one that changes the prediction by less than the tolerance is no finding. A pair must exceed
    the best single effect by as much as a further effect must explain to be named.
    """
    accepted = list[Trial]()
    for trial in rank(trials):
        if trial.is_small:
            break
        accepted += [] if trial.reason else [trial]
    single = _choose(task, [trial for trial in accepted if len(trial.names) == 1])
    if not accepted or single is None or len(accepted[0].names) == 1:
        return single or _choose(task, accepted)
    pair = _choose(task, [trial for trial in accepted if len(trial.names) == 2])
    assert pair is not None  # the first of the accepted trials is a pair
    is_validated = bool(task.validate.records)
    explained = criterion.explained_share(single.error, pair.error, task.noise_rms) if is_validated else 1.0
    is_more = bic_lead(pair.fit, single.fit) >= pair.critical_gain and explained >= criterion.large_share()
    return pair if is_more else single


def _choose(task: EstimationTask, accepted: Sequence[Trial]) -> Trial | None:
    """Return the best of accepted trials, of which the first has the least BIC.

    If all are approximations, a trial that BIC does not distinguish from the first comes before it in two cases: all
    its parameters are within their plausible ranges, and those of the first are not; or it predicts the validation
    runs better by `criterion.SHARE`. If none of these trials is plausible, a plausible one is taken that predicts worse
    by less than `criterion.SHARE`.
    """
    if not accepted or not accepted[0].fit.exceeds_noise or not task.validate.records:
        return next(iter(accepted), None)
    first = accepted[0]
    alike = [t for t in accepted if criterion.cannot_tell_apart(bic_lead(first.fit, t.fit), first.fit.discrepancy)]
    close = [t for t in accepted if criterion.explained_share(t.error, first.error, task.noise_rms) < criterion.SHARE]
    plausible = _plausible(task, alike) or _plausible(task, close) or alike
    first, best = plausible[0], min(plausible, key=lambda trial: trial.error)
    return best if criterion.explained_share(first.error, best.error, task.noise_rms) >= criterion.SHARE else first


def _plausible(task: EstimationTask, trials: Sequence[Trial]) -> list[Trial]:
    """Return the trials without a relevant parameter at the end of its plausible range."""
    return [trial for trial in trials if not relevant_ends(task, trial.fit)]


def is_indistinguishable(a: FittedModel, b: FittedModel) -> bool:
    """Return whether the runs do not distinguish two results."""
    if len(a.effects) != len(b.effects):
        return False
    difference = (b.cost + b.validation_chi2) - (a.cost + a.validation_chi2)
    return criterion.cannot_tell_apart(difference, a.discrepancy)


# --- changes of the prediction ----------------------------------------------------------------------------------------


def difference(dataset: Dataset, before: Model, after: Model, weights: Mapping[str, Array]) -> float:
    """Return the rms difference of the predictions of two models for new runs, without offsets [response].

    New runs have the initial conditions of the old ones, except for the trigger delay. Observations with weights (see
    `EstimationTask`) are compared separately: the larger difference is returned.
    """
    weighted = [record for record in dataset.records if record.observation.name in weights]
    plain = [record for record in dataset.records if record.observation.name not in weights]
    return max(_rms_difference(records, before, after, weights) for records in (plain, weighted) if records)


def largest_difference(task: EstimationTask, before: Model, after: Model) -> float:
    """Return the larger of the differences for the fitted and for the validation runs, see `difference`."""
    datasets = [dataset for dataset in (task.identify, task.validate) if dataset.records]
    return max(difference(dataset, before, after, task.weights) for dataset in datasets)


def _rms_difference(records: Sequence[Record], before: Model, after: Model, weights: Mapping[str, Array]) -> float:
    squares, count = 0.0, 0
    nulls = [{p.name: p.null for p in model.parameters() if p.run and p.null is not None} for model in (before, after)]
    models = [model.replace(values) for model, values in zip((before, after), nulls, strict=True)]
    for record in records:
        first, second = (np.asarray(model.predict(record.observation)) for model in models)
        change = without_offset(record, second - first, weights)
        squares, count = squares + float(np.sum(change**2)), count + len(change)
    return math.sqrt(squares / count)


def without_effect(model: Model, effect: Candidate) -> Model:
    """Return a model in which an effect is at its null in all runs; all other parameters stay."""
    null = null_of(parameter_of(model, effect.strength))
    deviations = {p.name: 0.0 for p in model.parameters() if p.run and p.name.endswith(f":{effect.strength}")}
    return model.replace({effect.strength: null, **deviations})


def without_offset(record: Record, values: Array, weights: Mapping[str, Array]) -> Array:
    """Return the present values less their mean; for an observation with weights, the weighted values."""
    weight = weights.get(record.observation.name)
    if weight is not None:
        return np.asarray((values * weight)[record.present])
    present = values[record.present]
    return np.asarray(present - np.mean(present))


def relevant_ends(task: EstimationTask, fit: FittedModel) -> list[str]:
    """Return the parameters of effects that end at a limit of their plausible range, and are relevant there.

    A strength is always relevant. Another parameter is relevant if its value a factor e from the limit changes a
    prediction: friction without presliding is as plausible as friction with little of it.
    """
    strengths = {effect.strength for effect in fit.effects}
    return [name for name in fit.at_bound() if name in strengths or is_end_relevant(task, fit, name)]


def is_end_relevant(task: EstimationTask, fit: FittedModel, name: str) -> bool:
    """Tell whether the value of a parameter a factor e from its limit is a relevant change."""
    where = fit.solution.problem.where
    j = where.names.index(name)
    if where.parameters[j].scale != "log":
        return True
    inside = fit.solution.x[j] + (1.0 if math.isclose(fit.solution.x[j], where.lower[j], rel_tol=1e-6) else -1.0)
    return is_relevant(task, fit, {name: value(where.parameters[j], inside)})


def is_relevant(task: EstimationTask, fit: FittedModel, values: Mapping[str, float]) -> bool:
    """Tell whether other values of some parameters change a prediction by the tolerance or more.

    If the residual exceeds the noise, the change must also be at least `SHARE` of its mean square.
    """
    after = fit.model.replace(values)
    scored = task.scored or task.validate.names or task.identify.names
    unexplained = fit.rms(scored, task.scales) if fit.exceeds_noise else 0.0
    return largest_difference(task, fit.model, after) >= max(task.tolerance, math.sqrt(criterion.SHARE) * unexplained)

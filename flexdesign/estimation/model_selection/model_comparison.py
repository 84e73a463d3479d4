"""Whether an effect is added to a model: the one criterion of selection.

An effect is accepted if it passes four checks.

1. *Evidence.* It lowers chi^2 of the fitted runs by more than the largest of all candidates would by chance: the
   family-wise critical value of the score test (`score_test`). The fall is divided by the
   discrepancy of the model: reduced chi^2 times the number of samples that count as one (Bartlett 1946). What no model
   explains is coloured noise, and a thousand correlated samples are not a thousand proofs.
2. *Share.* On the validation runs it removes a stated share of the unexplained mean square.
3. *Relevance.* It moves the prediction of the fitted or of the validation runs by more than the tolerance, also by
   itself.
4. *Determination.* The 95 % interval of its strength excludes the null, and it is not at the end of its range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from flexdesign.core.model import Model
from flexdesign.estimation.least_squares.parameter_transforms import coordinate
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, difference, without_effect
from flexdesign.estimation.model_selection.score_test import Candidate

#: Family-wise probability of a false effect in one step. Half of it or twice it moves the critical value by 1.4.
LEVEL = 1e-3
#: Least share of the unexplained mean square of the validation runs; what explains less is no finding for a user.
SHARE = 0.05
#: Two answers cannot be told apart if BIC prefers one by less: "very strong" begins at 10 (Kass and Raftery 1995).
INDISTINGUISHABLE = 10.0
#: Standard deviations of a 95 % interval.
HALF_WIDTH = 1.96


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate, fitted beside the effects of the present model.

    Parameters
    ----------
    names
        Effects added at this step, one or two.
    fit
        The fit.
    gain
        Fall of chi^2 of the fitted runs, less what the freedom of further initial conditions explains by chance.
    share
        Share of the unexplained mean square of the validation runs that it removes.
    error
        Rms residual of the validation runs [response].
    needed, score
        Critical value of the gain, discrepancy counted; and of the largest score of the catalogue.
    reason
        Why it is not accepted; empty if it is.
    is_small
        Whether it is refused because it moves the prediction by less than the tolerance.
    """

    names: tuple[str, ...]
    fit: FittedModel
    gain: float
    share: float
    error: float
    needed: float
    score: float
    reason: str
    is_small: bool = False


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the selection: the best trial, and those that do as well.

    Parameters
    ----------
    chosen
        The trial whose effects were added; None at the last step, where none was accepted.
    trials
        All that were evaluated, best first.
    """

    chosen: Trial | None
    trials: tuple[Trial, ...]

    @property
    def alike(self) -> tuple[Trial, ...]:
        """Accepted trials that these runs cannot tell from the chosen one."""
        if self.chosen is None:
            return ()
        others = (trial for trial in self.trials if trial.names != self.chosen.names and not trial.reason)
        return tuple(trial for trial in others if is_alike(self.chosen.fit, trial.fit))


def critical_value(score: float, effects: Sequence[Candidate]) -> float:
    """Return the fall of chi^2 that chance does not reach.

    Parameters
    ----------
    score
        Critical value of the largest score of the catalogue, each with one free number.
    effects
        What is added; each further free number has a quantile of chi^2 of its own.
    """
    free = sum(len(effect.free) for effect in effects)
    return score + float(chdtri(max(free, 1), LEVEL) - chdtri(1, LEVEL))


def compare(
    task: EstimationTask, before: FittedModel, after: FittedModel, names: tuple[str, ...], score: float
) -> Trial:
    """Return the trial of effects that one fit has and the one before has not; see `critical_value` for `score`."""
    # Judged by the data alone: an effect is not needed because it lets a number stay at its prior.
    gain = before.fitted_chi2 - after.fitted_chi2 - max(after.nuisance_dof - before.nuisance_dof, 0.0)
    new = task.validate if task.validate.records else task.identify
    errors = [fit.rms(task.scored or new.names, task.scales) for fit in (before, after)]
    added = [effect for effect in after.effects if effect.name in names]
    needed = critical_value(score, added) * after.discrepancy
    far = _relevance(task, before.model, after.model)
    alone = min(_relevance(task, without_effect(after.model, effect), after.model) for effect in added)
    share, is_small, reason = explained_share(task, *errors), False, ""
    if gain < needed:
        reason = "no more than chance gives"
    elif task.validate.records and after.validation_chi2 >= before.validation_chi2:
        reason = "does not help on the validation runs"
    elif task.validate.records and share < SHARE:
        reason = f"explains less than {100 * SHARE:.0f} % of what is unexplained"
    elif min(far, alone) < task.tolerance:
        is_small = far < task.tolerance
        reason = f"{'' if is_small else 'itself '}moves the prediction by less than the tolerance"
    elif ends := [effect.strength for effect in added if effect.strength in after.at_bound()]:
        # Other numbers may come back as further effects are added.
        reason = f"{' and '.join(ends)} at the end of what is plausible"
    elif open_ := [effect.strength for effect in added if not is_determined(after, effect)]:
        reason = f"{' and '.join(open_)} is not determined: its 95 % interval includes the null"
    return Trial(names, after, gain, share, errors[1], needed, score, reason, is_small)


def _relevance(task: EstimationTask, before: Model, after: Model) -> float:
    """Return how far two models differ in what they predict of the fitted or of the validation runs, the larger one."""
    suites = [dataset for dataset in (task.identify, task.validate) if dataset.records]
    return max(difference(dataset, before, after, task.weights) for dataset in suites)


def is_determined(fit: FittedModel, effect: Candidate) -> bool:
    """Tell whether the 95 % interval of an effect's strength excludes its null, discrepancy counted.

    One that differs from run to run is determined where it is so in a run: its mean may be next to nothing.
    """
    solution = fit.solution
    where = solution.problem.where
    j = where.names.index(effect.strength)
    parameter = where.parameters[j]
    null = 0.0 if parameter.scale == "inverse" else parameter.null
    assert null is not None  # that is what makes it the strength
    if parameter.scale == "log":  # its null is infinitely far away; zero is one relative unit away
        null = float(solution.x[j]) - 1.0
    elif parameter.scale == "linear":
        null = coordinate(parameter, null)
    deviations = [k for k, name in enumerate(where.names) if name.endswith(f":{effect.strength}")]
    covariance = solution.covariance * fit.discrepancy
    for places in [[j, k] for k in deviations] or [[j]]:
        sigma = math.sqrt(max(float(covariance[np.ix_(places, places)].sum()), 0.0))
        if abs(float(solution.x[places].sum()) - null) > HALF_WIDTH * sigma:
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

    What explains no more than an effect that hardly moves the prediction is no finding. A pair must beat the best
    single effect as an effect beside it would have to.
    """
    accepted = list[Trial]()
    for trial in rank(trials):
        if trial.is_small:
            break
        accepted += [] if trial.reason else [trial]
    single = next((trial for trial in accepted if len(trial.names) == 1), None)
    if not accepted or single is None or len(accepted[0].names) == 1:
        return accepted[0] if accepted else None
    pair = accepted[0]
    explained = explained_share(task, single.error, pair.error) if task.validate.records else 1.0
    is_more = bic_lead(pair.fit, single.fit) >= pair.needed and explained >= SHARE
    return pair if is_more else single


def explained_share(task: EstimationTask, before: float, after: float) -> float:
    """Return the share of the unexplained mean square that goes where an rms residual falls."""
    return (before**2 - after**2) / max(before**2 - task.floor**2, 1e-300)


def is_alike(a: FittedModel, b: FittedModel) -> bool:
    """Tell whether the runs cannot tell two answers apart."""
    if len(a.effects) != len(b.effects):
        return False
    return (b.cost + b.validation_chi2) - (a.cost + a.validation_chi2) < INDISTINGUISHABLE * a.discrepancy

"""Whether an effect earns its place in a model: the one criterion of selection.

An effect is accepted if it passes four checks.

1. *Evidence.* It lowers chi^2 of the fitted runs by more than the largest of all candidates would by chance: the
   family-wise critical value of the score test (`flexdesign.evidence.screening`). The fall is divided by the
   discrepancy of the model: reduced chi^2 times the number of samples that count as one (Bartlett 1946). What no model
   explains is coloured noise, and a thousand correlated samples are not a thousand proofs.
2. *Share.* On the validation runs it removes a stated share of the unexplained mean square.
3. *Relevance.* It moves the prediction of the validation runs by more than the tolerance, also by itself.
4. *Determination.* The 95 % interval of its strength excludes the null, and it is not at the end of its range.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtri

from flexdesign.evidence.case import Case
from flexdesign.evidence.coordinates import coordinate
from flexdesign.evidence.screening import Candidate, Moves
from flexdesign.evidence.stand import Stand, at_null, moved

#: Family-wise probability of a false effect in one step. Half of it or twice it moves the critical value by 1.4.
LEVEL = 1e-3
#: Least share of the unexplained mean square of the validation runs; what explains less is no finding for a user.
SHARE = 0.05
#: Two answers cannot be told apart if BIC prefers one by less: "very strong" begins at 10 (Kass and Raftery 1995).
INDISTINGUISHABLE = 10.0
#: Standard deviations of a 95 % interval.
HALF_WIDTH = 1.96
#: Reason for refusing an effect that may be there and does not matter.
SMALL = "moves the prediction by less than the tolerance"
#: Reason for refusing one that passes all checks, but is not the best.
LESS = "explains less"


@dataclass(frozen=True, eq=False)
class Trial:
    """A candidate, fitted beside the effects of the present model.

    Parameters
    ----------
    names
        Effects added at this step, one or two.
    stand
        The fit.
    gain
        Fall of chi^2 of the fitted runs, less what the freedom of further initial conditions explains by chance.
    held_gain
        Fall of chi^2 of the validation runs.
    moved
        By how much it moves the prediction of the validation runs, rms [response].
    share
        Share of the unexplained mean square of the validation runs that it removes.
    error
        Rms residual of the validation runs [response].
    needed, score
        Critical value of the gain, discrepancy counted; and of the largest score of the catalogue.
    reason
        Why it is not accepted; empty if it is.
    """

    names: tuple[str, ...]
    stand: Stand
    gain: float
    held_gain: float
    moved: float
    share: float
    error: float
    needed: float
    score: float
    reason: str


@dataclass(frozen=True, eq=False)
class Step:
    """One step of the selection: the best trial, and those that do as well.

    Parameters
    ----------
    chosen
        The trial whose effects were added; None at the last step, where none was accepted.
    trials
        All that were fitted, best first.
    alike
        Trials that these runs cannot tell from the chosen one.
    moves
        What effects do, where nothing was chosen and that may be asked again.
    """

    chosen: Trial | None
    trials: tuple[Trial, ...]
    alike: tuple[Trial, ...] = ()
    moves: Moves | None = field(default=None, repr=False)


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


def evaluate(case: Case, before: Stand, after: Stand, names: tuple[str, ...], score: float) -> Trial:
    """Return the trial of effects that one fit has and the one before has not; see `critical_value` for `score`."""
    # Judged by the data alone: an effect is not needed because it lets a number stay at its prior.
    gain = before.seen_cost - after.seen_cost - max(after.nuisance_dof - before.nuisance_dof, 0.0)
    held = before.held_cost - after.held_cost
    new = case.validate if case.validate.records else case.identify
    judges = case.judging or [record.observation.name for record in new.records]
    errors = [stand.rms(judges, case.scales) for stand in (before, after)]
    added = [effect for effect in after.effects if effect.name in names]
    needed = critical_value(score, added) * after.discrepancy
    far = moved(new, before.model, after.model, case.weights)
    alone = min(moved(new, at_null(after.model, effect), after.model, case.weights) for effect in added)
    share = explained_share(case, *errors)
    reason = ""
    if gain < needed:
        reason = "no more than chance gives"
    elif case.validate.records and held <= 0:
        reason = "does not help on the validation runs"
    elif case.validate.records and share < SHARE:
        reason = f"explains less than {100 * SHARE:.0f} % of what is unexplained"
    elif min(far, alone) < case.tolerance:
        reason = SMALL if far < case.tolerance else f"itself {SMALL}"
    elif ends := [effect.strength for effect in added if effect.strength in after.at_bound()]:
        # Other numbers may come back as further effects are added.
        reason = f"{' and '.join(ends)} at the end of what is plausible"
    elif open_ := [effect.strength for effect in added if not is_determined(after, effect)]:
        reason = f"{' and '.join(open_)} is not determined: its 95 % interval includes the null"
    return Trial(names, after, gain, held, far, share, errors[1], needed, score, reason)


def is_determined(stand: Stand, effect: Candidate) -> bool:
    """Tell whether the 95 % interval of an effect's strength excludes its null, discrepancy counted.

    One that differs from run to run is determined where it is so in a run: its mean may be next to nothing.
    """
    solution = stand.solution
    where = solution.problem.where
    j = where.names.index(effect.strength)
    parameter = where.parameters[j]
    null = 0.0 if parameter.scale == "inverse" else parameter.null
    assert null is not None  # that is what makes it the strength
    if parameter.scale == "log":
        return True  # its null is infinitely far away
    null = null if parameter.scale == "inverse" else coordinate(parameter, null)
    deviations = [k for k, name in enumerate(where.names) if name.endswith(f":{effect.strength}")]
    covariance = solution.covariance * stand.discrepancy
    for places in [[j, k] for k in deviations] or [[j]]:
        sigma = math.sqrt(max(float(covariance[np.ix_(places, places)].sum()), 0.0))
        if abs(float(solution.x[places].sum()) - null) > HALF_WIDTH * sigma:
            return True
    return False


def overruled(trials: Sequence[Trial]) -> list[Trial]:
    """Return trials, best first, without those that explain no more than one that hardly moves the prediction."""
    first = next((trial for trial in trials if trial.reason == SMALL), None)
    if first is None:
        return list(trials)
    reason = f"explains no more than {' and '.join(first.names)}, which {SMALL}"
    place = trials.index(first)
    weaker = [trial if trial.reason else replace(trial, reason=reason) for trial in trials[place:]]
    return [*trials[:place], *weaker]


def best_of(case: Case, trials: Sequence[Trial]) -> Trial | None:
    """Return the best accepted trial; a pair must beat the best single effect as an effect beside it would have to."""
    accepted = sorted((trial for trial in trials if not trial.reason), key=lambda trial: trial.stand.total)
    single = next((trial for trial in accepted if len(trial.names) == 1), None)
    if not accepted or single is None or len(accepted[0].names) == 1:
        return accepted[0] if accepted else None
    pair = accepted[0]
    explained = explained_share(case, single.error, pair.error) if case.validate.records else 1.0
    return single if behind(single, pair) < pair.needed or explained < SHARE else pair


def explained_share(case: Case, before: float, after: float) -> float:
    """Return the share of the unexplained mean square that goes where an rms residual falls."""
    return (before**2 - after**2) / max(before**2 - case.floor**2, 1e-300)


def behind(trial: Trial, best: Trial) -> float:
    """Return by how much a trial is worse than the best."""
    return trial.stand.total - best.stand.total


def is_alike(a: Stand, b: Stand) -> bool:
    """Tell whether the runs cannot tell two answers apart."""
    if len(a.effects) != len(b.effects):
        return False
    return (b.cost + b.held_cost) - (a.cost + a.held_cost) < INDISTINGUISHABLE * a.discrepancy

"""Numbers of effects that the runs do not determine: an effect is dropped, or a number is held at its default."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from flexdesign.core.model import parameter_of
from flexdesign.estimation.criterion import HALF_WIDTH, LEVEL, SHARE, WORSE
from flexdesign.estimation.least_squares.parameter_transforms import null_of, value
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    evaluate_fit,
    fit_model,
    refit,
    with_effects,
)
from flexdesign.estimation.model_selection.prediction_change import largest_difference
from flexdesign.estimation.uncertainty.identifiability import Estimate, better_fit, intervals


def restart_from_profiles(task: EstimationTask, fit: FittedModel) -> FittedModel:
    """Return a fit restarted from a better point, where the profile of a strength meets one; else the same."""
    names = [effect.strength for effect in fit.effects if not fit.deviations(effect.strength)]
    better = better_fit(fit.solution, names) if names else None
    return fit if better is None else evaluate_fit(task, better, fit.effects) or fit


def drop_undetermined(task: EstimationTask, fit: FittedModel) -> tuple[FittedModel, tuple[str, ...]]:
    """Return the fit without effects whose strength has no interval, or one that holds its null; and the numbers held.

    Intervals are those that are stated. A number of the same effect that can replace the strength is held first, where
    the fit has it.
    """
    for effect in reversed(fit.effects):
        strength = _strength(fit, effect.strength)
        if _excludes_null(fit, strength):
            continue
        held = tuple(name for name in strength.confounded if name in effect.free)
        if held:
            less = replace(effect, free=tuple(name for name in effect.free if name not in held))
            made = fit_model(task, fit.model, tuple(less if e.name == effect.name else e for e in fit.effects))
        else:
            made = refit(task, fit, tuple(other for other in fit.effects if other.name != effect.name))
        if made is None:
            return fit, ()
        made, more = drop_undetermined(task, made)
        return made, (*held, *more)
    return fit, ()


def _strength(fit: FittedModel, name: str) -> Estimate:
    """Return a strength with its interval by the profile likelihood, as the covariance may mislead in imitations.

    Where it differs from run to run, the mean over the fitted runs, with its interval by the covariance.
    """
    if not fit.deviations(name):
        return intervals(fit.solution, [name])[0]
    mean, half = fit.mean_over_runs(name)
    return Estimate(parameter_of(fit.model, name), mean, half / HALF_WIDTH, (mean - half, mean + half), True)


def _excludes_null(fit: FittedModel, strength: Estimate) -> bool:
    """Tell whether a strength has an interval without its null, or the end of the plausible range next to that.

    The mean of one that differs from run to run may be anything, where the residual is noise: an approximation differs
    from run to run because it is one.
    """
    if strength.interval is None:
        return False
    low, high = strength.interval
    null = float(np.clip(null_of(strength.parameter), *strength.parameter.plausible))
    holds_null = low <= null <= high or any(math.isclose(null, end, rel_tol=1e-6) for end in (low, high))
    return (bool(fit.deviations(strength.name)) and not fit.exceeds_noise) or not holds_null


def hold_undetermined(task: EstimationTask, fit: FittedModel) -> tuple[FittedModel, tuple[str, ...]]:
    """Return the fit with undetermined numbers of its effects held, and their names; the same fit if there are none."""
    present = {p.name: p.start for p in with_effects(task.bare(fit.model), fit.effects).parameters()}
    defaults = {
        name: float(present[name] or 0.0)
        for effect in fit.effects
        for name in effect.free
        if name != effect.strength and present.get(name) is not None and _is_open(fit, name, present[name] or 0.0)
    }
    if not defaults:
        return fit, ()
    effects = tuple(replace(e, free=tuple(n for n in e.free if n not in defaults)) for e in fit.effects)
    made = fit_model(task, fit.model.replace(defaults), effects)
    # A default that contradicts the runs is none to hold.
    if made is None or made.cost - fit.cost > -2.0 * math.log(LEVEL) * fit.discrepancy:
        return fit, ()
    scored = task.scored or task.validate.names
    if scored and made.rms(scored, task.scales) > WORSE * fit.rms(scored, task.scales):
        made = fit_model(task, fit.model, effects) or made  # others are predicted worse: its fitted value is held
    return made, tuple(defaults)


def relevant_ends(task: EstimationTask, fit: FittedModel) -> list[str]:
    """Return the numbers at the end of what is plausible that are relevant there.

    Strengths are, and numbers that move a prediction.
    A number that a factor e from its end moves no prediction by the tolerance says that it is small, or large: friction
    without presliding is as plausible as with little of it.
    """
    strengths = {effect.strength for effect in fit.effects}
    return [name for name in fit.at_bound() if name in strengths or is_end_relevant(task, fit, name)]


def is_end_relevant(task: EstimationTask, fit: FittedModel, name: str) -> bool:
    """Tell whether a number a factor e from the end of its range predicts otherwise, by the tolerance or more.

    Where a residual remains, a change by less than the stated share of it, in squares, is none either.
    """
    where = fit.solution.problem.where
    j = where.names.index(name)
    if where.parameters[j].scale != "log":
        return True
    inside = fit.solution.x[j] + (1.0 if math.isclose(fit.solution.x[j], where.lower[j], rel_tol=1e-6) else -1.0)
    after = fit.model.replace({name: value(where.parameters[j], inside)})
    scored = task.scored or task.validate.names or task.identify.names
    unexplained = fit.rms(scored, task.scales) if fit.exceeds_noise else 0.0
    return largest_difference(task, fit.model, after) >= max(task.tolerance, math.sqrt(SHARE) * unexplained)


def _is_open(fit: FittedModel, name: str, default: float) -> bool:
    """Tell whether the interval of a number holds a default of zero, or nearly all that is plausible."""
    where = fit.solution.problem.where
    j = where.names.index(name)
    if fit.is_undetermined(j):
        return True
    is_linear = where.parameters[j].scale == "linear"
    return default == 0 and is_linear and abs(float(fit.solution.x[j])) < fit.half_width(j)

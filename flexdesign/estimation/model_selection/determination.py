"""Parameters of effects that the runs do not determine: an effect is dropped, or a parameter is held at its default."""

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
    """Return the fit restarted from a better point if the profile of a strength meets one; else the same fit."""
    names = [effect.strength for effect in fit.effects if not fit.deviations(effect.strength)]
    better = better_fit(fit.solution, names) if names else None
    return fit if better is None else evaluate_fit(task, better, fit.effects) or fit


def drop_undetermined(task: EstimationTask, fit: FittedModel) -> tuple[FittedModel, tuple[str, ...]]:
    """Return the fit without effects whose interval of the strength includes the null, and the parameters held.

    An effect without an interval is dropped as well. Intervals are those of the report. A parameter of the same effect
    that is confounded with the strength is held at its fitted value first.
    """
    for effect in reversed(fit.effects):
        strength = _strength(fit, effect.strength)
        if _excludes_null(fit, strength):
            continue
        held = tuple(name for name in strength.confounded if name in effect.free)
        if held:
            reduced = replace(effect, free=tuple(name for name in effect.free if name not in held))
            refitted = fit_model(task, fit.model, tuple(reduced if e.name == effect.name else e for e in fit.effects))
        else:
            refitted = refit(task, fit, tuple(other for other in fit.effects if other.name != effect.name))
        if refitted is None:
            return fit, ()
        refitted, others_held = drop_undetermined(task, refitted)
        return refitted, (*held, *others_held)
    return fit, ()


def _strength(fit: FittedModel, name: str) -> Estimate:
    """Return a strength with its interval by the profile likelihood: of imitations the covariance may mislead.

    For a strength that differs from run to run, return the mean over the fitted runs, with the interval by the
    covariance.
    """
    if not fit.deviations(name):
        return intervals(fit.solution, [name])[0]
    mean, half = fit.mean_over_runs(name)
    return Estimate(parameter_of(fit.model, name), mean, half / HALF_WIDTH, (mean - half, mean + half), True)


def _excludes_null(fit: FittedModel, strength: Estimate) -> bool:
    """Tell whether the interval of a strength excludes its null, and the end of the plausible range next to the null.

    If the residual is noise, the mean of a strength that differs from run to run may be anything. If it exceeds the
    noise, the mean must exclude the null, too: the strength of an approximation also differs from run to run.
    """
    if strength.interval is None:
        return False
    low, high = strength.interval
    null = float(np.clip(null_of(strength.parameter), *strength.parameter.plausible))
    includes_null = low <= null <= high or any(math.isclose(null, end, rel_tol=1e-6) for end in (low, high))
    return (bool(fit.deviations(strength.name)) and not fit.exceeds_noise) or not includes_null


def hold_undetermined(task: EstimationTask, fit: FittedModel) -> tuple[FittedModel, tuple[str, ...]]:
    """Return the fit with undetermined parameters of its effects held, and their names; the same fit without any."""
    catalogue = {p.name: p.start for p in with_effects(task.bare(fit.model), fit.effects).parameters()}
    defaults = {
        name: float(catalogue[name] or 0.0)
        for effect in fit.effects
        for name in effect.free
        if name != effect.strength and catalogue.get(name) is not None and _is_open(fit, name, catalogue[name] or 0.0)
    }
    if not defaults:
        return fit, ()
    effects = tuple(replace(e, free=tuple(n for n in e.free if n not in defaults)) for e in fit.effects)
    refitted = fit_model(task, fit.model.replace(defaults), effects)
    # A default that contradicts the fitted runs is not held.
    if refitted is None or refitted.cost - fit.cost > -2.0 * math.log(LEVEL) * fit.discrepancy:
        return fit, ()
    scored = task.scored or task.validate.names
    if scored and refitted.rms(scored, task.scales) > WORSE * fit.rms(scored, task.scales):
        # The defaults predict the validation runs worse: the fitted values are held.
        refitted = fit_model(task, fit.model, effects) or refitted
    return refitted, tuple(defaults)


def relevant_ends(task: EstimationTask, fit: FittedModel) -> list[str]:
    """Return the parameters of effects that end at a limit of their plausible range, and are relevant there.

    A strength is always relevant. Another parameter is relevant if its value a factor e from the limit changes a
    prediction: friction without presliding is as plausible as friction with little of it.
    """
    strengths = {effect.strength for effect in fit.effects}
    return [name for name in fit.at_bound() if name in strengths or is_end_relevant(task, fit, name)]


def is_end_relevant(task: EstimationTask, fit: FittedModel, name: str) -> bool:
    """Tell whether the value of a parameter a factor e from its limit changes a prediction by the tolerance or more.

    If the residual exceeds the noise, the change must also be at least `SHARE` of its mean square.
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
    """Tell whether the interval of a parameter includes a default of zero, or most of the plausible range."""
    where = fit.solution.problem.where
    j = where.names.index(name)
    if fit.is_undetermined(j):
        return True
    is_linear = where.parameters[j].scale == "linear"
    return default == 0 and is_linear and abs(float(fit.solution.x[j])) < fit.half_width(j)

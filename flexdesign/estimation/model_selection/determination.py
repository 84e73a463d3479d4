"""Parameters of effects that the runs do not determine are held at their defaults."""

from __future__ import annotations

import math
from dataclasses import replace

from flexdesign.estimation.criterion import LEVEL, SHARE, WORSE
from flexdesign.estimation.least_squares.parameter_transforms import value
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    fit_model,
    with_effects,
)
from flexdesign.estimation.model_selection.prediction_change import largest_difference


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

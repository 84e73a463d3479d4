"""What the runs do not determine of the named effects: a parameter is held at its default, or an effect is dropped."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from flexdesign.core.model import parameter_of
from flexdesign.estimation.criterion import LEVEL, WORSE
from flexdesign.estimation.least_squares.parameter_transforms import null_of
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, fit_model, refit, with_effects
from flexdesign.estimation.uncertainty.identifiability import intervals


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


def _is_open(fit: FittedModel, name: str, default: float) -> bool:
    """Tell whether the interval of a parameter includes a default of zero, or most of the plausible range."""
    where = fit.solution.problem.where
    j = where.names.index(name)
    if fit.is_undetermined(j):
        return True
    is_linear = where.parameters[j].scale == "linear"
    return default == 0 and is_linear and abs(float(fit.solution.x[j])) < fit.half_width(j)


def drop_undetermined(task: EstimationTask, fit: FittedModel) -> FittedModel:
    """Return the fit without effects whose strength has an interval that includes the null, or none.

    Effects are added by the covariance, which may mislead. These intervals are those of the report.
    """
    for effect in reversed(fit.effects):
        if not _excludes_null(fit, effect.strength):
            without = refit(task, fit, tuple(other for other in fit.effects if other is not effect))
            return fit if without is None else drop_undetermined(task, without)
    return fit


def _excludes_null(fit: FittedModel, name: str) -> bool:
    """Tell whether the interval of a strength excludes its null, and the end of the plausible range next to the null.

    If the residual is noise, the mean of a strength that differs from run to run may be anything. If it exceeds the
    noise, the mean must exclude the null, too: the strength of an approximation also differs from run to run.
    """
    if fit.deviations(name) and not fit.exceeds_noise:
        return True
    if fit.deviations(name):
        mean, half_width = fit.mean_over_runs(name)
        interval: tuple[float, float] | None = (mean - half_width, mean + half_width)
    else:
        interval = intervals(fit.solution, [name])[0].interval
    if interval is None:
        return False
    parameter, (low, high) = parameter_of(fit.model, name), interval
    null = float(np.clip(null_of(parameter), *parameter.plausible))
    return not (low <= null <= high or any(math.isclose(null, end, rel_tol=1e-6) for end in (low, high)))

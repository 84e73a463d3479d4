"""Restarts of fits that may be in a local minimum."""

from __future__ import annotations

from collections.abc import Sequence

from flexdesign.core.model import parameter_of
from flexdesign.estimation.criterion import SHARE
from flexdesign.estimation.least_squares.levenberg_marquardt import ROUGH, Solution
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    fit_model,
    refit,
    search_initial_states,
    solve_case,
)
from flexdesign.estimation.model_selection.model_comparison import Trial

#: First factors by which thresholds are changed: smaller changes are within the reach of derivatives; and the largest
#: number of times that such a step is doubled, to a factor of 1e5.
THRESHOLD_FACTORS, MOST_DOUBLINGS = (1.1, 0.9), 8


def escape(task: EstimationTask, fit: FittedModel, names: Sequence[str] | None = None) -> FittedModel:
    """Return the best of fits restarted near one that may be in a local minimum (multistart).

    Hysteresis is not differentiable where a threshold is met or a voltage turns, so that chi^2 has local minima. Fits
    restart from other initial states, then with larger and smaller thresholds (of the effects `names`, by default all),
    each step twice as far as the last while chi^2 falls by more than one (pattern search: Hooke and Jeeves 1961).
    """
    model = search_initial_states(task, fit.solution.problem.dataset, fit.model)
    if model is not fit.model:
        fit = _better(fit, fit_model(task, model, fit.effects, old=fit.solution.columns()))
    restarted = [effect for effect in fit.effects if names is None or effect.name in names]
    for name in (name for effect in restarted for name in effect.hidden):
        task.progress(f"fitting with other values of {name}")
        rough = _search_threshold(task, fit, name)
        if rough is not None:
            model = task.fine(rough.problem.at(rough.x))
            fit = _better(fit, fit_model(task, model, fit.effects, old=rough.columns()))
    return fit


def _better(fit: FittedModel, other: FittedModel | None) -> FittedModel:
    return other if other is not None and other.cost < fit.cost - fit.discrepancy else fit


def restart_without(task: EstimationTask, fit: FittedModel, trials: Sequence[Trial]) -> FittedModel:
    """Return the fit restarted from the best of refused trials, without its effects, if all runs then fit better.

    A further effect may only have moved the other parameters out of a local minimum.
    """
    if not trials or trials[0].gain <= trials[0].critical_gain:
        return fit
    task.progress("fitting from other values")
    restarted = refit(task, trials[0].fit, fit.effects)
    if restarted is None or restarted.validation_chi2 > fit.validation_chi2:
        return fit
    return restarted if fit.cost - restarted.cost > trials[0].critical_gain else fit


def _search_threshold(task: EstimationTask, fit: FittedModel, name: str) -> Solution | None:
    """Return the best of rough fits that start with another value of a threshold; None if none is better."""
    model, best = task.coarse(fit.model), None
    cost = fit.solution.problem.cost_of(model, fit.solution.x)
    if not abs(cost - fit.cost) < SHARE * fit.cost:  # coarse steps change the cost by too much
        model, cost = fit.model, fit.cost
    for factor in THRESHOLD_FACTORS:
        for doublings in range(MOST_DOUBLINGS):
            start = parameter_of(model, name).start or 0.0
            elsewhere = model.replace({name: factor**2**doublings * start})
            rough = solve_case(task, elsewhere, fit.effects, effort=ROUGH)
            if rough is None or rough.cost >= cost - fit.discrepancy:
                break
            best, cost, model = rough, rough.cost, rough.problem.at(rough.x)
    return best

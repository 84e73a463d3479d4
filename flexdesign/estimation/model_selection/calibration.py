"""Calibration: the numbers of the model itself, fitted from several starts; or left as they are."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from flexdesign.core.model import Model
from flexdesign.estimation.least_squares.levenberg_marquardt import Effort, linearise
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, evaluate_fit, fit_initial_states, solve_case

#: A start ends where a step lowers chi^2 by less than 1e-4 of it; the calibration is refined afterwards.
STARTED = Effort(20, 1e-4, is_exact=False)
#: Starts in addition to the design: the best of this number of points of a Sobol sample.
STARTS, SAMPLED = 3, 16


def evaluate_design(task: EstimationTask, model: Model) -> FittedModel | None:
    """Return the fit of a model whose own numbers stay; only the initial conditions of the runs are fitted.

    Its Jacobian contains the free parameters all the same, so that a screening there knows what they can imitate.
    """
    task = task.prepared(task, model)
    begun = fit_initial_states(task, task.identify, model)
    if begun is None:
        return None
    here = begun.problem.at(begun.x)
    where = task.coordinates(here, task.free, begun.problem.dataset)
    solution = linearise(task.problem(begun.problem.dataset, here, where), where.start)
    return None if solution is None else evaluate_fit(task, solution, ())


def calibrate(
    task: EstimationTask, model: Model, seed: int = 0, nominal: FittedModel | None = None
) -> FittedModel | None:
    """Fit the model's own numbers from several starts; return the best fit.

    The first start is the model as it is. Where the design with the initial states that suit it explains more than the
    fit from there, it is the second start. Where the residual exceeds the noise, others are the best points of a sample
    of the plausible ranges.
    """
    first = solve_case(task, model, effort=STARTED)
    if nominal is not None and (first is None or nominal.cost < first.cost):
        first = solve_case(task, nominal.model, effort=STARTED) or first
    best = None if first is None else evaluate_fit(task, first, ())
    if best is not None and not best.exceeds_noise:
        return best
    found = [] if first is None else [first]
    for k, values in enumerate(_sample(task, model, seed)):
        task.progress(f"calibrating: start {k + 2} of {STARTS + 1}")
        made = solve_case(task, model.replace(values), effort=STARTED)
        found += [] if made is None else [made]
    solution = min(found, key=lambda solution: solution.cost, default=None)
    return best if solution is None or solution is first else evaluate_fit(task, solution, ())


def _sample(task: EstimationTask, model: Model, seed: int) -> Iterator[dict[str, float]]:
    """Yield values of the free parameters: the best points of a Sobol sample of their plausible ranges."""
    from scipy.stats.qmc import Sobol

    where = task.coordinates(model, task.free, task.identify)
    shared = [j for j, parameter in enumerate(where.parameters) if not parameter.run]
    if not shared:
        return
    problem = task.problem(task.identify, model, where)
    low, high = where.sampled()
    tried = []
    for unit in Sobol(len(shared), rng=np.random.default_rng(seed)).random(SAMPLED):
        x = where.start.copy()
        x[shared] = low[shared] + unit * (high - low)[shared]
        tried.append((problem.cost(x, problem.residuals(x)), x))
    tried.sort(key=lambda pair: pair[0])
    for cost, x in tried[:STARTS]:
        if math.isfinite(cost):
            yield where.values(x)

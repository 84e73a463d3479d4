"""Calibration: the numbers of the model itself, fitted; or left as they are."""

from __future__ import annotations

from flexdesign.core.model import Model
from flexdesign.estimation.least_squares.levenberg_marquardt import Effort, linearise
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, evaluate_fit, fit_initial_states, solve_case

#: A fit ends where a step lowers chi^2 by less than 1e-4 of it; the calibration is refined afterwards.
CALIBRATION_EFFORT = Effort(20, 1e-4, is_exact=False)


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


def calibrate(task: EstimationTask, model: Model, nominal: FittedModel | None = None) -> FittedModel | None:
    """Fit the model's own parameters from their present values.

    Where the design with the initial states that suit it explains more than that fit, it is another start. Samples of
    the plausible ranges are none: measured on recordings of others they led to the same minimum.
    """
    found = solve_case(task, model, effort=CALIBRATION_EFFORT)
    if nominal is not None and (found is None or nominal.cost < found.cost):
        found = solve_case(task, nominal.model, effort=CALIBRATION_EFFORT) or found
    return None if found is None else evaluate_fit(task, found, ())

"""Calibration: the numbers of the model itself, fitted; or left as they are.

What finite elements know is fitted within its uncertainty, before any effect is added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

from flexdesign.core.errors import InputError
from flexdesign.core.model import Model
from flexdesign.diagnosis.effect_selection.estimation_setup import PRIOR_BOUND, find_undetermined, with_beginnings
from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.diagnosis.preparation.initial_conditions import grid_delay, grid_frequency
from flexdesign.diagnosis.result import SelectionHistory
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.estimation.criterion import INDISTINGUISHABLE, WORSE
from flexdesign.estimation.least_squares.levenberg_marquardt import CALIBRATION, linearise
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    evaluate_fit,
    fit_initial_states,
    fit_model,
    solve_case,
    with_values,
)
from flexdesign.estimation.model_selection.forward_selection import GROSS_MISFIT
from flexdesign.estimation.model_selection.restarts import escape


@dataclass(frozen=True, eq=False)
class CalibratedTask:
    """A task with the fit of the model's own numbers, to which effects are added.

    Parameters
    ----------
    task
        The task, with the numbers that the runs can show, and the initial conditions of the calibrated model.
    nominal, fit, calibrated
        The model as designed, with its own numbers fitted, and the one of both that is kept.
    undetermined
        The model's own numbers that the runs cannot show.
    is_refused
        Whether calibration made the validation runs worse, so that the design values are kept.
    """

    task: EstimationTask
    nominal: FittedModel
    fit: FittedModel
    calibrated: FittedModel
    undetermined: tuple[str, ...]
    is_refused: bool

    @property
    def origins(self) -> tuple[FittedModel, ...]:
        """Where additions start from as well: at a gross misfit, parameters may have moved far to imitate an effect."""
        return (self.nominal,) if self.fit.scale > GROSS_MISFIT and not self.is_refused else ()


def calibrate_task(
    data: DiagnosisData,
    task: EstimationTask,
    dynamics: AxisDynamics,
    preliminary: SelectionHistory | None = None,
) -> CalibratedTask:
    """Fit the model's own numbers.

    Raises
    ------
    InputError
        If the model cannot be simulated at the values it has.
    """
    task.progress("predicting with the model as it is")
    held = find_undetermined(task, dynamics)
    task = replace(task, free=tuple(name for name in task.free if name not in held))
    nominal = evaluate_design(replace(task, prior_bound=PRIOR_BOUND), dynamics)
    task.progress("calibrating")
    if preliminary is None:
        fit = calibrate(task, grid_frequency(task, grid_delay(task, dynamics)), nominal)
    else:
        fit = fit_model(task, with_values(dynamics, preliminary.calibration.model))
    if fit is not None:  # how a mode rings as a record begins follows from its calibrated numbers
        task = with_beginnings(task, cast(AxisDynamics, fit.model), data.rounded(fit))
        fit = fit_model(task, fit.model)
    if fit is not None and fit.exceeds_noise:
        fit = escape(task, fit)
    if fit is None:
        raise _not_simulated(dynamics)
    increase = fit.validation_chi2 - nominal.validation_chi2
    is_refused = (
        bool(task.validate.records)
        and data.error(fit) > WORSE * data.error(nominal)
        and increase > INDISTINGUISHABLE * fit.discrepancy
    )
    if is_refused or fit.scale > GROSS_MISFIT:
        nominal = evaluate_design(with_beginnings(task, dynamics, data.rounded(nominal)), nominal.model)
    calibrated = nominal if is_refused else fit
    task = replace(task, calibrated_excess=calibrated.excess)
    return CalibratedTask(task, nominal, fit, calibrated, held, is_refused)


def evaluate_design(task: EstimationTask, model: Model) -> FittedModel:
    """Return the fit of a model whose own numbers stay; only the initial conditions of the runs are fitted.

    Its Jacobian contains the free parameters all the same, so that a screening there knows what they can imitate.

    Raises
    ------
    InputError
        If the model cannot be simulated at the values it has.
    """
    task = task.prepared(task, model)
    if (begun := fit_initial_states(task, task.identify, model)) is not None:
        here = begun.problem.at(begun.x)
        problem = task.problem(begun.problem.dataset, here, task.free)
        solution = linearise(problem, problem.where.start)
        if solution is not None and (found := evaluate_fit(task, solution, ())) is not None:
            return found
    raise _not_simulated(cast(AxisDynamics, model))


def _not_simulated(model: AxisDynamics) -> InputError:
    return InputError("model", f"axis.{model.name}", None, "cannot be simulated at the values it has")


def calibrate(task: EstimationTask, model: Model, nominal: FittedModel | None = None) -> FittedModel | None:
    """Fit the model's own parameters from their present values.

    Where the design with the initial states that suit it explains more than that fit, it is another start. Samples of
    the plausible ranges are none: measured on recordings of others they led to the same minimum.
    """
    found = solve_case(task, model, effort=CALIBRATION)
    if nominal is not None and (found is None or nominal.cost < found.cost):
        found = solve_case(task, nominal.model, effort=CALIBRATION) or found
    return None if found is None else evaluate_fit(task, found, ())

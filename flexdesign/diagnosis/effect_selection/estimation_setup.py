"""What a diagnosis fits: the model of an axis with numbers of its own for each run, the data sets, and the priors.

The numbers of the model itself are fitted first (calibration), what finite elements know within its uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal, cast

import numpy as np
from threadpoolctl import threadpool_limits

from flexdesign.core.errors import InputError
from flexdesign.core.model import Model
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, line_weights
from flexdesign.diagnosis.preparation.initial_conditions import (
    grid_delay,
    grid_frequency,
    initial_conditions,
    modes,
    prior_of_initial_condition,
    relaxing,
    with_initial_conditions,
)
from flexdesign.diagnosis.result import SelectionHistory
from flexdesign.dynamics.axis.axis_model import STEPS_PER_PERIOD, AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import HYSTERESIS_PARAMETERS, LINEAR_PARAMETERS, stroke_of
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.estimation.criterion import INDISTINGUISHABLE, WORSE
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import CALIBRATION, linearise
from flexdesign.estimation.least_squares.parallel_map import ParallelMap, shared_pool
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
from flexdesign.estimation.model_selection.prediction_change import difference
from flexdesign.estimation.model_selection.restarts import escape
from flexdesign.estimation.noise.autoregressive import Whitening
from flexdesign.measurements.recordings import Run

#: Largest error that a prediction may have, in shares of the noise; and in shares of the stroke, at least and at most.
#: The rms error is about a tenth of the largest: chi^2 of ten thousand samples is then off by one.
PREDICTION_ERROR, FINEST_TOLERANCE, COARSEST_TOLERANCE = 0.1, 1e-6, 1e-4
#: Most steps in a sample for fits, and steps for screening; slow samples may have as many as a step of this length asks
#: for [s], or of a twentieth of a period of a slow mode.
MOST_STEPS, STEPS_OF_SCREENING, SHORTEST_STEP = 16, 2, 4.4e-4
#: The same for the final values: many samples determine them far better than their noise.
FINAL_PREDICTION_ERROR, MOST_FINAL_STEPS = 0.002, 64
#: A run is late by at most this number of standard deviations, in the model as it was designed and where one record is
#: all there is: it would be late by many samples for the lag that the model lacks. Several that are all late share a
#: delay.
PRIOR_BOUND = 4.0
#: A plausible change of a number of which nothing is known, relative.
PLAUSIBLE_CHANGE = 0.3
#: What is said where nobody stated what a command does between its samples, by what fits better than straight lines.
INTERPOLATION_TEXTS = {
    "smooth": "the command is taken as smooth between its samples, which fits better than straight lines",
    "hold": (
        "nobody says what the command does between its samples: that it is held fits better than straight lines, which "
        'would need a delay of half a sample; if it is held, write between_samples = "hold" in measurements.toml'
    ),
}


@contextmanager
def simulating(threads: int = 2) -> Iterator[ParallelMap]:
    """Give a map shared among a number of threads; those of linear algebra would fight with them, on small matrices."""
    with threadpool_limits(1), shared_pool(threads) as each:
        yield each


def choose_interpolation(
    model: StageModel, data: DiagnosisData, each: Any, progress: Callable[[str], None]
) -> DiagnosisData:
    """Return the data set with what fits better between the samples of commands, where nobody said what they do.

    A measured command is smooth: straight lines make a sine of frequency w smaller by (w h)^2 / 12, which would pass
    for a lag or a further mode. A command that was sent is often held: straight lines are half a sample early, which
    would pass for a delay.
    """
    unsaid = [run for run in data.runs if not run.between_is_stated]
    if not unsaid:
        return data
    progress("asking what commands do between their samples")
    other, found = replace(data, runs=tuple(map(_otherwise, data.runs))), list[FittedModel]()
    for tried in (data, other):
        dynamics, task = case_of(model, tried, each, lambda _: None)
        if (fit := fit_model(task, dynamics, effort=CALIBRATION)) is None:
            return data
        found.append(fit)
    critical = INDISTINGUISHABLE * max(found[0].scale, 1.0)
    return other if found[1].cost < found[0].cost - critical else data


def _otherwise(run: Run) -> Run:
    """Return a run whose command is not straight between its samples, where nobody said what it does."""
    if run.between_is_stated:
        return run
    shape: Literal["hold", "smooth"] = "hold" if run.command_is == "dac" else "smooth"
    return replace(run, between_samples=shape, remarks=(*run.remarks, INTERPOLATION_TEXTS[shape]))


def _from_rest(axis: AxisModel) -> AxisModel:
    """Return an axis that begins as it was never driven; where each run came from is a number of its own."""
    if "bouc_wen" not in axis.effects:
        return axis
    return replace(axis, effects={**axis.effects, "bouc_wen": {**axis.effects["bouc_wen"], "rest": 0.0}})


def correct_steps(of: AxisDynamics, runs: Sequence[Run], tolerance: float, each: Any) -> AxisDynamics:
    """Return a model with predictions corrected by what finer steps change at its present values.

    Nearby the correction hardly differs, so that a fit has the accuracy of fine steps at the cost of its own (defect
    correction: Stetter 1978, Numerische Mathematik 29, 425-443).
    """
    plain, fine = replace(of, corrections={}), of.refined(tolerance).with_steps(MOST_FINAL_STEPS)
    changes = each(lambda run: fine.predict(run) - plain.predict(run), runs)
    return replace(plain, corrections={run.name: change for run, change in zip(runs, changes, strict=True)})


def case_of(
    model: StageModel, data: DiagnosisData, each: Any, progress: Callable[[str], None]
) -> tuple[AxisDynamics, EstimationTask]:
    """Return the model of the axis, with numbers of its own for each run, and what it is confronted with."""
    max_command = data.max_command
    stroke = stroke_of(data.axis, max_command)
    step = max(SHORTEST_STEP, 1 / (STEPS_PER_PERIOD * data.axis.natural_frequency))
    slow = math.ceil(max(data.periods) / step)
    is_fast = slow <= 2 * STEPS_OF_SCREENING
    screening, fine = STEPS_OF_SCREENING if is_fast else slow, max(MOST_STEPS, 2 * slow)
    exact = float(np.clip(PREDICTION_ERROR * data.noise_rms / stroke, FINEST_TOLERANCE, COARSEST_TOLERANCE))
    at_last = FINAL_PREDICTION_ERROR / PREDICTION_ERROR * exact
    dynamics = AxisDynamics(
        data.name,
        _from_rest(data.axis),
        max_command,
        tolerance=exact,
        delay=model.controller.delay,
        finest=fine,
        margin=1,  # the final values are found with far more steps
        apart=tuple(run.name for run in data.runs),
        highest=max(0.5 / max(data.periods), *(float(each.frequencies[-1]) for each in data.responses), 0.0),
        bipolar=any(bool(np.min(run.command()) < -0.05 * max_command) for run in data.runs),
    )
    # Small sines do not show how a loop bends.
    free = LINEAR_PARAMETERS + (HYSTERESIS_PARAMETERS[:-1] if "bouc_wen" in data.axis.effects and data.runs else ())
    noise, shapes = data.whitening, initial_conditions(data.axis, stroke)

    def known(of: Model) -> Mapping[str, tuple[float, float]]:
        own = {p.name: prior_of_initial_condition(p, data.runs, max_command, of) for p in of.parameters() if p.run}
        return {**data.known, **{name: about for name, about in own.items() if about}}

    return dynamics, EstimationTask(
        identify=Dataset(data.observed("identify"), noise, shapes),
        validate=Dataset(data.observed("validate"), noise, shapes),
        test=Dataset(test_runs, noise, shapes) if (test_runs := data.observed("test")) else None,
        free=free,
        known=known,
        bare=lambda of: replace(dynamics, by_run=cast(AxisDynamics, of).by_run),
        tolerance=data.tolerance,
        # Of slow samples few steps do in most cases: how many is found, up to the shortest that could be needed.
        coarse=lambda of: cast(AxisDynamics, of).with_steps(screening, fixed=is_fast),
        fine=lambda of: cast(AxisDynamics, of).with_steps(fine),
        finest=lambda of: correct_steps(cast(AxisDynamics, of), data.runs, at_last, each),
        each=each,
        progress=progress,
        noise_rms=data.known_noise_rms,
        prior_bound=PRIOR_BOUND if data.is_one_record or not data.noise.known else math.inf,
        null_errors=data.null_errors,
        weights=line_weights(data),
        scales=data.scales,
        scored=tuple(data.selecting) if data.responses else (),
    )


def find_undetermined(task: EstimationTask, dynamics: AxisDynamics) -> tuple[str, ...]:
    """Return the free parameters that the runs cannot show: a plausible change moves no prediction by the tolerance.

    A change is plausible within one standard deviation of the prior, or `PLAUSIBLE_CHANGE` without one. Numbers of
    hysteresis are not asked: they act together.
    """
    known, found = task.known(dynamics), list[str]()
    for name in LINEAR_PARAMETERS:
        value = dynamics.axis.numbers[name]
        relative = min(known[name][1] / abs(value), PLAUSIBLE_CHANGE) if name in known else PLAUSIBLE_CHANGE
        after = dynamics.replace({name: value * (1 + relative)})
        if difference(task.identify, dynamics, after, task.weights) < task.tolerance:
            found.append(name)
    return tuple(found)


def with_beginnings(task: EstimationTask, model: AxisDynamics, noise: Whitening | None = None) -> EstimationTask:
    """Return the case with the initial conditions of a calibrated model, and of modes and slow effects added to it."""
    calibrated = len(modes(model.axis))

    def prepared(own: EstimationTask, other: Model) -> EstimationTask:
        its = cast(AxisDynamics, other)
        if not relaxing(its.axis) and len(modes(its.axis)) == calibrated:
            return own
        return with_initial_conditions(own, its, noise)

    return replace(with_initial_conditions(task, model, noise), prepared=prepared)


# --- calibration -----------------------------------------------------------------------------------------------------


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
    if fit is None:
        raise _not_simulated(dynamics)
    fit = escape(task, fit) if fit.exceeds_noise else fit
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

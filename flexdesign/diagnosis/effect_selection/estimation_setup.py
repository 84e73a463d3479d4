"""The estimation problem of a diagnosis: the model of an axis with parameters for each run, data sets, and priors.

The parameters of the model itself are fitted first (calibration), those from finite elements within their uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
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
from flexdesign.diagnosis.preparation.windows import is_very_long, windows
from flexdesign.dynamics.axis.axis_model import STEPS_PER_PERIOD, AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import (
    HYSTERESIS_PARAMETERS,
    LINEAR_PARAMETERS,
    is_beyond_sampling,
    stroke_of,
)
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.estimation.criterion import INDISTINGUISHABLE, WORSE
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import CALIBRATION, linearise
from flexdesign.estimation.least_squares.parallel_map import ParallelMap, shared_pool
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    escape,
    evaluate_fit,
    fit_initial_states,
    fit_model,
    solve_case,
)
from flexdesign.estimation.model_selection.forward_selection import GROSS_MISFIT
from flexdesign.estimation.model_selection.model_comparison import difference
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.noise.autoregressive import Whitening
from flexdesign.measurements.recordings import Run

#: Largest error of a prediction, as a share of the noise; and its limits, as shares of the stroke. The rms error is a
#: tenth of the largest or so: chi^2 of ten thousand samples is then off by one.
PREDICTION_ERROR, FINEST_TOLERANCE, COARSEST_TOLERANCE = 0.1, 1e-6, 1e-4
#: Most steps in a sample for fits, and steps for screening; slow samples may have as many as a step of this length asks
#: for [s], or of a twentieth of a period of a slow mode.
MOST_STEPS, STEPS_OF_SCREENING, SHORTEST_STEP = 16, 2, 4.4e-4
#: Largest trigger delay of a run, in standard deviations of its prior, in the model as designed and if there is only
#: one run: otherwise the trigger delay would stand for a lag that the model lacks. Several runs may share a delay.
PRIOR_BOUND = 4.0
#: Plausible relative change of a parameter without a prior.
PLAUSIBLE_CHANGE = 0.3
#: Remarks if the intersample behaviour is not stated, by the behaviour that fits better than straight lines.
INTERPOLATION_TEXTS = {
    "smooth": "the command is taken as smooth between its samples, which fits better than straight lines",
    "hold": (
        "nobody says what the command does between its samples: that it is held fits better than straight lines, which "
        'would need a delay of half a sample; if it is held, write between_samples = "hold" in measurements.toml'
    ),
}


@contextmanager
def simulating(threads: int = 2) -> Iterator[ParallelMap]:
    """Yield a map over a number of threads; linear algebra has one thread, as more slow down small matrices."""
    with threadpool_limits(1), shared_pool(threads) as each:
        yield each


def choose_interpolation(
    model: StageModel, data: DiagnosisData, each: Any, progress: Callable[[str], None]
) -> DiagnosisData:
    """Return the data set with the intersample behaviour that fits better, for commands for which none is stated.

    A measured command is smooth: straight lines reduce a sine of frequency w by the factor (w h)^2 / 12, which looks
    like a lag or a further mode. A command that was sent is often held: straight lines are half a sample early, which
    looks like a delay.
    """
    if all(run.between_is_stated for run in data.runs):
        return data
    progress("asking what commands do between their samples")
    alternative, fits = replace(data, runs=tuple(map(_interpolated_otherwise, data.runs))), list[FittedModel]()
    for variant in (data, alternative):
        searched = windows(variant, {}) if is_very_long(variant) else variant
        dynamics, task = case_of(model, searched, each, lambda _: None)
        if (fit := fit_model(task, dynamics, effort=CALIBRATION)) is None:
            return data
        fits.append(fit)
    critical = INDISTINGUISHABLE * max(fits[0].scale, 1.0)
    return alternative if fits[1].cost < fits[0].cost - critical else data


def _interpolated_otherwise(run: Run) -> Run:
    """Return a run with a command that is not linear between its samples, unless the behaviour is stated."""
    if run.between_is_stated:
        return run
    shape: Literal["hold", "smooth"] = "hold" if run.command_is == "dac" else "smooth"
    return replace(run, between_samples=shape, remarks=(*run.remarks, INTERPOLATION_TEXTS[shape]))


def _from_rest(axis: AxisModel) -> AxisModel:
    """Return an axis whose hysteresis starts at zero; the initial state of each run is a parameter of its own."""
    if "bouc_wen" not in axis.effects:
        return axis
    return replace(axis, effects={**axis.effects, "bouc_wen": {**axis.effects["bouc_wen"], "rest": 0.0}})


def case_of(
    model: StageModel, data: DiagnosisData, each: Any, progress: Callable[[str], None]
) -> tuple[AxisDynamics, EstimationTask]:
    """Return the model of the axis, with parameters for each run, and the estimation task."""
    max_command = data.max_command
    stroke = stroke_of(data.axis, max_command)
    step = max(SHORTEST_STEP, 1 / (STEPS_PER_PERIOD * data.axis.natural_frequency))
    slow = math.ceil(max(data.periods) / step)
    is_fast = slow <= 2 * STEPS_OF_SCREENING
    screening, fine = STEPS_OF_SCREENING if is_fast else slow, max(MOST_STEPS, 2 * slow)
    exact = float(np.clip(PREDICTION_ERROR * data.noise_rms / stroke, FINEST_TOLERANCE, COARSEST_TOLERANCE))
    dynamics = AxisDynamics(
        data.name,
        _from_rest(data.axis),
        max_command,
        tolerance=exact,
        delay=model.controller.delay,
        finest=fine,
        margin=1,
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
        # Long sampling periods mostly need few steps: their number is found, up to the largest that may be needed.
        coarse=lambda of: cast(AxisDynamics, of).with_steps(screening, fixed=is_fast),
        fine=lambda of: cast(AxisDynamics, of).with_steps(fine),
        each=each,
        progress=progress,
        noise_rms=data.known_noise_rms,
        prior_bound=PRIOR_BOUND if data.is_one_record or not data.noise.known else math.inf,
        weights=line_weights(data),
        scales=data.scales,
        scored=tuple(data.selecting) if data.responses else (),
    )


def find_undetermined(task: EstimationTask, dynamics: AxisDynamics) -> tuple[str, ...]:
    """Return the parameters that the runs do not show: no plausible change alters a prediction by the tolerance.

    A change is plausible within one standard deviation of the prior, or `PLAUSIBLE_CHANGE` without one. Parameters of
    hysteresis are not tested, because they act together. Samples in time do not show a mode beyond their rate.
    """
    known, undetermined = task.known(dynamics), list[str]()
    is_beyond = bool(dynamics.apart) and is_beyond_sampling(dynamics.first, dynamics.highest)
    for name in LINEAR_PARAMETERS:
        if is_beyond and name == "natural_frequency":
            undetermined.append(name)
            continue
        value = dynamics.axis.numbers[name]
        relative = min(known[name][1] / abs(value), PLAUSIBLE_CHANGE) if name in known else PLAUSIBLE_CHANGE
        after = dynamics.replace({name: value * (1 + relative)})
        if difference(task.identify, dynamics, after, task.weights) < task.tolerance:
            undetermined.append(name)
    return tuple(undetermined)


def with_calibrated_conditions(
    task: EstimationTask, model: AxisDynamics, noise: Whitening | None = None
) -> EstimationTask:
    """Return the task with the initial conditions of a calibrated model, and of modes and slow effects added to it."""
    calibrated = len(modes(model.axis))

    def prepared(own: EstimationTask, other: Model) -> EstimationTask:
        dynamics = cast(AxisDynamics, other)
        if not relaxing(dynamics.axis) and len(modes(dynamics.axis)) == calibrated:
            return own
        return with_initial_conditions(own, dynamics, noise)

    return replace(with_initial_conditions(task, model, noise), prepared=prepared)


# --- calibration -----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CalibratedTask:
    """A task with its calibrated model, to which effects are added.

    Parameters
    ----------
    task
        The task, with the free parameters that the runs show, and the initial conditions of the calibrated model.
    nominal, fit, calibrated
        The model as designed, the fit of its parameters, and the one of both that is kept.
    undetermined
        Parameters of the model that the runs do not show.
    is_refused
        Whether calibration increased the validation error, so that the design values are kept.
    """

    task: EstimationTask
    nominal: FittedModel
    fit: FittedModel
    calibrated: FittedModel
    undetermined: tuple[str, ...]
    is_refused: bool

    @property
    def origins(self) -> tuple[FittedModel, ...]:
        """Further fits from which effects are added: at a gross misfit, calibration may have imitated an effect."""
        return (self.nominal,) if self.fit.scale > GROSS_MISFIT and not self.is_refused else ()


def calibrate_task(
    data: DiagnosisData,
    task: EstimationTask,
    dynamics: AxisDynamics,
) -> CalibratedTask:
    """Fit the parameters of the model itself, and prepare the task for added effects.

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
    fit = calibrate(task, grid_frequency(task, grid_delay(task, dynamics)), nominal)
    if fit is not None:  # the ringing of a mode follows from its calibrated frequency and damping
        task = with_calibrated_conditions(task, cast(AxisDynamics, fit.model), data.rounded(fit))
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
        nominal = evaluate_design(with_calibrated_conditions(task, dynamics, data.rounded(nominal)), nominal.model)
    calibrated = nominal if is_refused else fit
    task = replace(task, calibrated_excess=calibrated.excess)
    return CalibratedTask(task, nominal, fit, calibrated, held, is_refused)


def evaluate_design(task: EstimationTask, model: Model, effects: tuple[Candidate, ...] = ()) -> FittedModel:
    """Return a fit of the initial conditions alone, with the parameters of the model and of its added effects held.

    Its Jacobian contains the free parameters of the model, too, so that screening can project them out.

    Raises
    ------
    InputError
        If the model cannot be simulated at the values it has.
    """
    task = task.prepared(task, model)
    if (initialised := fit_initial_states(task, task.identify, model)) is not None:
        problem = task.problem(
            initialised.problem.dataset,
            initialised.problem.at(initialised.x),
            [*task.free, *(name for effect in effects for name in effect.free)],
        )
        solution = linearise(problem, problem.where.start)
        if solution is not None and (fit := evaluate_fit(task, solution, effects)) is not None:
            return fit
    raise _not_simulated(cast(AxisDynamics, model))


def _not_simulated(model: AxisDynamics) -> InputError:
    return InputError("model", f"axis.{model.name}", None, "cannot be simulated at the values it has")


def calibrate(task: EstimationTask, model: Model, nominal: FittedModel | None = None) -> FittedModel | None:
    """Fit the parameters of the model itself from their present values.

    If the design with fitted initial states explains more than that fit, the fit starts from there as well. Random
    starts in the plausible ranges are not used: with measured recordings they led to the same minimum.
    """
    solution = solve_case(task, model, effort=CALIBRATION)
    if nominal is not None and (solution is None or nominal.cost < solution.cost):
        solution = solve_case(task, nominal.model, effort=CALIBRATION) or solution
    return None if solution is None else evaluate_fit(task, solution, ())

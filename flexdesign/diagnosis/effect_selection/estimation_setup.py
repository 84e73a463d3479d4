"""What a diagnosis fits: the model of an axis with numbers of its own for each run, the data sets, and the priors."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Literal, cast

import numpy as np
from threadpoolctl import threadpool_limits

from flexdesign.core.model import Model
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, line_weights
from flexdesign.diagnosis.preparation.initial_conditions import (
    initial_conditions,
    modes,
    prior_of_initial_condition,
    relaxing,
    with_initial_conditions,
)
from flexdesign.dynamics.axis.axis_model import STEPS_PER_PERIOD, AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import HYSTERESIS_PARAMETERS, LINEAR_PARAMETERS, stroke_of
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.estimation.criterion import INDISTINGUISHABLE
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import CALIBRATION
from flexdesign.estimation.least_squares.parallel_map import ParallelMap, shared_pool
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, difference, fit_model
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

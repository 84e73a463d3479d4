"""The estimation problem of a diagnosis: the model of an axis, data sets, priors, and initial conditions of runs.

The initial conditions of a run are its trigger delay, amplitudes of modes, slow states, and reversal voltages.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from threadpoolctl import threadpool_limits

from flexdesign import effects
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Block, Model, Observation, Parameter
from flexdesign.core.parallel_map import ParallelMap, shared_pool
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, line_weights
from flexdesign.dynamics.axis.axis_model import REVERSALS, STEPS_PER_PERIOD, TOLERANCE, AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import (
    HYSTERESIS_PARAMETERS,
    LINEAR_PARAMETERS,
    TRIGGER,
    is_beyond_sampling,
    stroke_of,
)
from flexdesign.dynamics.signal_chain.partial_fractions import parts
from flexdesign.dynamics.stage_dynamics import chain
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import linearise
from flexdesign.estimation.model_selection.estimation_task import EstimationTask, fit_initial_states
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    evaluate_fit,
)
from flexdesign.estimation.model_selection.model_comparison import difference
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.noise.autoregressive import Whitening
from flexdesign.measurements.recordings import FrequencyResponse, Run

#: Largest error of a prediction, as a share of the noise, or of the residual if that is larger. The rms error is a
#: tenth of the largest or so: chi^2 of ten thousand samples is then off by one.
PREDICTION_ERROR = 0.1
#: Most steps in a sample for fits, and steps for screening; slow samples may have as many as a step of this length asks
#: for [s], or of a twentieth of a period of a slow mode.
MOST_STEPS, STEPS_OF_SCREENING, SHORTEST_STEP = 16, 2, 4.4e-4
#: Largest trigger delay of a run, in standard deviations of its prior, in the model as designed and if there is only
#: one run: otherwise the trigger delay would stand for a lag that the model lacks. Several runs may share a delay.
PRIOR_BOUND = 4.0
#: Plausible relative change of a parameter without a prior, and amplitude of a mode at the beginning of a run over the
#: stroke.
PLAUSIBLE_CHANGE = 0.3


@contextmanager
def simulating(threads: int = 2) -> Iterator[ParallelMap]:
    """Yield a map over a number of threads; linear algebra has one thread, as more slow down small matrices."""
    with threadpool_limits(1), shared_pool(threads) as each:
        yield each


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
    screening, most = STEPS_OF_SCREENING if is_fast else slow, max(MOST_STEPS, 2 * slow)
    tolerance = max(PREDICTION_ERROR * data.noise_rms / stroke, TOLERANCE)
    dynamics = AxisDynamics(
        data.name,
        _from_rest(data.axis),
        max_command,
        tolerance=tolerance,
        delay=model.controller.delay,
        finest=most,
        margin=1,
        apart=tuple(run.name for run in data.runs),
        highest=max(0.5 / max(data.periods), *(float(each.frequencies[-1]) for each in data.responses), 0.0),
        bipolar=any(bool(np.min(run.command()) < -0.05 * max_command) for run in data.runs),
    )
    # Small sines do not show how a loop bends.
    free = LINEAR_PARAMETERS + (HYSTERESIS_PARAMETERS[:-1] if "bouc_wen" in data.axis.effects and data.runs else ())
    noise, shapes = data.whitening, initial_conditions(data.axis, stroke)

    def bare(of: Model) -> Model:
        own = cast(AxisDynamics, of)
        return replace(dynamics, by_run=own.by_run, tolerance=own.tolerance)

    def fine(of: Model, scale: float) -> Model:
        return cast(AxisDynamics, of).with_steps(most, tolerance=tolerance * math.sqrt(max(scale, 1.0)))

    def known(of: Model) -> Mapping[str, tuple[float, float]]:
        own = {p.name: prior_of_initial_condition(p, data.runs, max_command, of) for p in of.parameters() if p.run}
        return {**data.known, **{name: about for name, about in own.items() if about}}

    return dynamics, EstimationTask(
        identify=Dataset(data.observed("identify"), noise, shapes),
        validate=Dataset(data.observed("validate"), noise, shapes),
        test=Dataset(test_runs, noise, shapes) if (test_runs := data.observed("test")) else None,
        free=free,
        known=known,
        bare=bare,
        tolerance=data.tolerance,
        # Long sampling periods mostly need few steps: their number is found, up to the largest that may be needed.
        coarse=lambda of: cast(AxisDynamics, of).with_steps(screening, fixed=is_fast),
        fine=fine,
        each=each,
        progress=progress,
        noise_rms=data.known_noise(data.selecting),
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
    raise not_simulated(cast(AxisDynamics, model))


def not_simulated(model: AxisDynamics) -> InputError:
    """Return the error of a model that cannot be simulated."""
    return InputError("model", f"axis.{model.name}", None, "cannot be simulated at the values it has")


# --- initial conditions ----------------------------------------------------------------------------------------------


def prior_of_initial_condition(
    parameter: Parameter, runs: Sequence[Run], max_command: float, model: Model
) -> tuple[float, float] | None:
    """Return the prior of a parameter of one run: trigger delay, reversal voltage, or deviation of a strength.

    None if the parameter has no prior.
    """
    run, _, number = parameter.name.rpartition(":")
    if number in (by_run := cast(AxisDynamics, model).by_run):
        return 0.0, by_run[number]
    if number == TRIGGER:  # at any moment of a sample
        period = next(each.period for each in runs if each.name == run)
        return _uniform(-period / 2, period / 2)
    if number in REVERSALS:  # anywhere in the range of the commands
        return _uniform(-max_command if cast(AxisDynamics, model).bipolar else 0.0, max_command)
    return None


def _uniform(low: float, high: float) -> tuple[float, float]:
    """Return mean and standard deviation of a uniform distribution."""
    return (low + high) / 2, (high - low) / math.sqrt(12)


@dataclass(frozen=True)
class InitialConditions:
    """Nuisance columns of unknown initial conditions: offset, ringing of modes, relaxation of slow states.

    Parameters
    ----------
    modes
        Frequency [Hz] and damping ratio of each mode.
    slow
        Time constants [s] of slow states, and the standard deviation of each [strokes].
    stroke
        Gain times the largest command [response].
    """

    modes: tuple[tuple[float, float], ...]
    slow: tuple[tuple[float, float], ...]
    stroke: float

    def __call__(self, observation: Observation) -> tuple[Array, Array]:
        """Return the columns, samples by k, and their standard deviations [response]; a frequency response has none."""
        if isinstance(observation, FrequencyResponse):
            return np.zeros((len(observation.measured()), 0)), np.zeros(0)
        run = cast(Run, observation)
        t = run.time - run.time[0]
        columns = [np.ones_like(t)]
        for frequency, damping_ratio in self.modes:
            w = 2 * math.pi * frequency
            damped, decay = w * math.sqrt(max(1 - damping_ratio**2, 0.0)), np.exp(-damping_ratio * w * t)
            columns += [decay * np.cos(damped * t), decay * np.sin(damped * t)]
        columns += [np.exp(-t / tau) for tau, _ in self.slow]
        ringing = 2 * len(self.modes) * [PLAUSIBLE_CHANGE * self.stroke]
        sizes = [math.inf, *ringing, *(share * self.stroke for _, share in self.slow)]
        return np.column_stack(columns), np.array(sizes)

    def at(self, model: Model) -> InitialConditions:
        """Return the initial conditions with the modes of a model, if it is linear and has the same number of modes.

        A nonlinear effect changes the frequency of ringing with amplitude; the calibrated mode is then nearer. Slow
        states stay as they are.
        """
        axis = cast(AxisDynamics, model).axis
        is_linear = all(effects.find(name).is_linear for name in axis.effects)
        present = modes(axis) if is_linear else self.modes
        return replace(self, modes=present) if len(present) == len(self.modes) else self


def initial_conditions(axis: AxisModel, stroke: float) -> InitialConditions:
    """Return the initial conditions of runs of an axis; `stroke` is its gain times the largest command [response]."""
    return InitialConditions(modes(axis), tuple(relaxing(axis)), stroke)


def modes(axis: AxisModel) -> tuple[tuple[float, float], ...]:
    """Return frequency [Hz] and damping ratio of the modes of an axis with its effects, linear forces among them."""
    # A mode that grows is none that rings.
    swinging = [(math.sqrt(part.a0), part.a1) for part in parts(chain("", axis)) if part.a0 > 0 <= part.a1]
    return tuple((w / (2 * math.pi), decay / (2 * w)) for w, decay in swinging)


def relaxing(axis: AxisModel) -> list[tuple[float, float]]:
    """Return time constants [s] and sizes [strokes] of the slow linear states that the effects of an axis have."""
    found = list[tuple[float, float]]()
    for name, values in axis.effects.items():
        effect = effects.find(name)
        if not effect.is_null(values):
            blocks = (face for face in effect.faces if isinstance(face, Block))
            found += [pair for block in blocks if block.relaxing for pair in block.relaxing(values)]
    return found


def with_initial_conditions(
    task: EstimationTask, model: AxisDynamics, noise: Whitening | None = None
) -> EstimationTask:
    """Return the task with the initial conditions that a model has, and perhaps with other noise."""
    shapes = initial_conditions(model.axis, model.stroke)
    identify, validate = (dataset.with_shapes(shapes, noise) for dataset in (task.identify, task.validate))
    test = task.test.with_shapes(shapes, noise) if task.test else None
    return replace(task, identify=identify, validate=validate, test=test)


def offset_rms(dynamics: AxisDynamics, runs: Sequence[Run]) -> float:
    """Return the rms residual of runs if only their offsets are fitted [response]."""
    residuals = [run.measured() - replace(dynamics, apart=(), own={}).predict(run) for run in runs]
    return float(np.sqrt(np.nanmean(np.concatenate([residual - np.nanmean(residual) for residual in residuals]) ** 2)))

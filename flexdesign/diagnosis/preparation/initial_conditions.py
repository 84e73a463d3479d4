"""Initial conditions of runs: trigger delay, amplitudes of modes, slow states, and reversal voltages."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from flexdesign import effects
from flexdesign.core.arrays import Array
from flexdesign.core.model import Block, Model, Observation, Parameter
from flexdesign.dynamics.axis.axis_model import REVERSALS, TRIGGERED_WITHIN, AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import TRIGGER
from flexdesign.dynamics.signal_chain.partial_fractions import parts
from flexdesign.dynamics.stage_dynamics import chain
from flexdesign.dynamics.stage_model import AxisModel
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.noise.autoregressive import Whitening
from flexdesign.measurements.recordings import FrequencyResponse, Run

#: Standard deviations of the priors: of a trigger delay in samples, of a reversal voltage as a share of the largest
#: command, and of the amplitude of a mode as a share of the stroke.
TRIGGER_DEVIATION, REVERSAL_DEVIATION, RINGING_DEVIATION = 0.3, 0.4, 0.1
#: Largest delay that is tried before the first fit, and the spacing, both in periods of the mode.
LARGEST_DELAY, DELAY_SPACING = 2.0, 0.125
#: Largest relative change of the natural frequency that is tried, and the spacing: farther away than the width of the
#: resonance, derivatives mislead. A payload or a loose part may change the frequency by this much.
LARGEST_DETUNING, DETUNING_SPACING = 0.24, 0.03


def prior_of_initial_condition(
    parameter: Parameter, runs: Sequence[Run], max_command: float, model: Model
) -> tuple[float, float] | None:
    """Return the prior of a parameter of one run: trigger delay, reversal voltage, or deviation of a strength.

    None if the parameter has no prior.
    """
    run, _, number = parameter.name.rpartition(":")
    if number in (by_run := cast(AxisDynamics, model).by_run):
        return 0.0, by_run[number]
    if number == TRIGGER:
        return 0.0, TRIGGER_DEVIATION * next(each.period for each in runs if each.name == run)
    if number in REVERSALS:
        return REVERSALS[number] * max_command, REVERSAL_DEVIATION * max_command
    return None


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
        ringing = 2 * len(self.modes) * [RINGING_DEVIATION * self.stroke]
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
    swinging = [(math.sqrt(part.a0), part.a1) for part in parts(chain("", axis)) if part.a0 > 0]
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


def offset_residual(dynamics: AxisDynamics, run: Run) -> Array:
    """Return the residual of a run if only its offset is fitted, n values [response]; NaN at gaps."""
    residual = run.measured() - replace(dynamics, apart=(), own={}).predict(run)
    return np.asarray(residual - np.nanmean(residual))


def grid_delay(task: EstimationTask, dynamics: AxisDynamics) -> AxisDynamics:
    """Return the model with the common trigger delay or lead that fits best on a grid, if that is more than one step.

    If the delay exceeds half a period of the mode, a fit that starts from zero ends in another minimum.
    """
    if not math.isinf(task.prior_bound):
        return dynamics

    def late_by(late: float) -> AxisDynamics:
        return dynamics.replace({f"{run}:{TRIGGER}": late for run in dynamics.apart})

    step = DELAY_SPACING / dynamics.first.natural_frequency
    farthest = min(LARGEST_DELAY / dynamics.first.natural_frequency, TRIGGERED_WITHIN[1])
    delays = np.arange(0.0, farthest, step)
    every = sorted([*delays.tolist(), *(-delays[1:]).tolist()], key=abs)
    best = min(every, key=lambda late: _cost(task, late_by(late)))
    return late_by(best) if abs(best) > step else dynamics


def grid_frequency(task: EstimationTask, dynamics: AxisDynamics) -> AxisDynamics:
    """Return the model with the natural frequency that fits best on a grid, if that is more than one step away."""
    if "natural_frequency" not in task.free:  # the runs do not show it
        return dynamics
    nominal = dynamics.first.natural_frequency

    def tuned(factor: float) -> AxisDynamics:
        return dynamics.replace({"natural_frequency": factor * nominal})

    factors = (1 + np.arange(-LARGEST_DETUNING, LARGEST_DETUNING + DETUNING_SPACING / 2, DETUNING_SPACING)).tolist()
    best = min(factors, key=lambda factor: _cost(task, tuned(factor)))
    return tuned(best) if abs(best - 1) > 1.5 * DETUNING_SPACING else dynamics


def _cost(task: EstimationTask, model: AxisDynamics) -> float:
    """Return chi^2 of the fitted runs, with only the nuisance columns fitted."""
    problem = task.problem(task.identify, model)
    residuals = problem.residuals(problem.where.start)
    return math.inf if residuals is None else float(sum(part @ part for part in residuals))

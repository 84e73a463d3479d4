"""Models without physics in the place of effects: a linear system, a static curve, and sums of smooth functions.

*Linear system.* A model may lack linear dynamics that no effect of the catalogue describes: a sensor of velocity or
acceleration, or a part that responds at once. Hysteresis then imitates their phase. The reading of the linear system is
a linear combination of the command, and of the position and the velocity of a mode whose frequency and damping are free
(output-error model with three numerator and two denominator coefficients: Ljung, System Identification, 1999, section
4.2). The coefficients are linear and are eliminated (variable projection: Golub and Pereyra 1973).

*Static curve.* Several effects that are functions of position or voltage, without memory, may be the first terms of a
series for one curve that no effect describes, such as a contact within the stroke. The curve is a regression spline:
piecewise linear functions of position and of voltage that add up (Ruppert, Wand and Carroll, Semiparametric Regression,
2003).

*Smooth functions* depend on position, velocity, voltage and time; for frequency responses, on frequency.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from flexdesign import effects
from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.model import Observation, parameter_of
from flexdesign.diagnosis.comparison.error_location import REGIONS
from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.estimation.criterion import LARGE
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import linearise
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, refit
from flexdesign.estimation.model_selection.sparse_residual_model import (
    SparseModel,
    cost_of_terms,
    sparse_model,
    without_columns,
)
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.measurements.recordings.command_segments import jumps
from flexdesign.measurements.recordings.frequency_response import parts, whole

#: Why effects are not named if another kind of model explains more.
LINEAR_IS_BETTER = (
    "a linear system of second order explains more than the effects that were tried, so that the model lacks linear "
    "dynamics, such as a sensor of velocity or acceleration, or a part of the reading that follows the command at once"
)
CURVE_IS_BETTER = (
    "a static curve of position and voltage explains more than the effects that were tried, so that the model lacks a "
    "nonlinearity without memory, such as a contact within a part of the stroke, or a sensor that is not straight"
)
SMOOTH_IS_BETTER = "smooth functions of position, velocity, voltage and time explain as much in the place of effects"


# --- linear system --------------------------------------------------------------------------------------------------


def is_better_linear(data: DiagnosisData, base: FittedModel, fit: FittedModel) -> bool:
    """Tell whether chi^2 of the best linear system is no larger than that of a fit with nonlinear effects."""
    if not data.runs or data.responses or all(effects.find(name).is_linear for name in fit.names):
        return False
    model, axis = cast(AxisDynamics, base.model), data.axis
    starts = [(each.natural_frequency, each.damping_ratio) for each in (model.axis, axis)]
    dataset = fit.solution.problem.dataset
    return min(_chi2(dataset, model, *start) for start in starts) <= fit.fitted_chi2


def _chi2(dataset: Dataset, model: AxisDynamics, frequency: float, damping_ratio: float) -> float:
    """Return chi^2 of the linear system that fits a data set best, from a starting frequency and damping ratio."""
    from scipy.optimize import least_squares

    measured = np.concatenate([dataset.whitened(record, record.measured) for record in dataset.records])

    def residual(logarithms: Array) -> Array:
        columns = [
            dataset.whitened_columns(record, _columns(model, cast(Run, record.observation), *np.exp(logarithms)))
            for record in dataset.records
        ]
        return without_columns(measured, np.vstack(columns))

    numbers = [parameter_of(model, name) for name in ("natural_frequency", "damping_ratio")]
    bounds = np.log([number.plausible for number in numbers]).T
    start = np.clip(np.log([frequency, damping_ratio]), *bounds)
    return float(2 * least_squares(residual, start, bounds=bounds, diff_step=1e-3, max_nfev=40).cost)


def _columns(model: AxisDynamics, run: Run, frequency: float, damping_ratio: float) -> Array:
    """Return the command, and position and velocity of the mode that it drives from rest: n by 3."""
    command = model.command(run)
    return np.column_stack([command - command[0], *mode_response(command, frequency, damping_ratio, run.period)])


def mode_response(
    force: Array, frequency: float, damping_ratio: float, period: float, *, held: bool = True
) -> tuple[Array, Array]:
    """Return position, and velocity over 2 pi times the frequency, of a mode from rest under a force.

    Parameters
    ----------
    force
        Over the stiffness, n values; its change from the first one acts.
    frequency, damping_ratio
        Of the mode [Hz, 1].
    period
        Of the samples [s].
    held
        Whether the force is held between samples; otherwise it goes straight to the next. A force that follows a motion
        and is taken as held is late by half a sample, which matters near a resonance.
    """
    from scipy.signal import cont2discrete, lfilter, ss2tf

    w = 2 * math.pi * frequency
    mode = w * np.array([[0.0, 1.0], [-1.0, -2 * damping_ratio]]), np.array([[0.0], [w]]), np.eye(2), np.zeros((2, 1))
    *sampled, _ = cont2discrete(mode, period, "zoh" if held else "foh")
    numerators, denominator = ss2tf(*sampled)
    position, velocity = (np.asarray(lfilter(numerator, denominator, force - force[0])) for numerator in numerators)
    return position, velocity


# --- static curve ----------------------------------------------------------------------------------------------------


def is_better_curve(data: DiagnosisData, task: EstimationTask, base: FittedModel, fit: FittedModel) -> bool:
    """Tell whether a static curve explains more in place of several effects of a fit that are terms of one.

    One effect is no series: it may be there, next to more that the model lacks.
    """
    terms = [effect for effect in fit.effects if effects.find(effect.name).is_curve]
    if len(terms) < 2 or not data.runs or data.responses:
        return False
    others = tuple(effect for effect in fit.effects if effect not in terms)
    if (begun := refit(task, fit, others) if others else base) is None:
        return False
    everywhere = _over_all_runs(task, begun)
    dataset, model = everywhere.solution.problem.dataset, cast(AxisDynamics, begun.model)
    runs = [cast(Run, record.observation) for record in dataset.records]
    positions, voltages = (_knots([of(run) for run in runs]) for of in (model.predict, model.command))

    def curve(observation: Observation, predicted: Array) -> dict[str, Array]:
        """Return piecewise linear functions of position, also of the force on the table, and of voltage, by name."""
        run = cast(Run, observation)
        of_position = {f"position {j}": np.maximum(predicted - knot, 0.0) for j, knot in enumerate(positions)}
        of_voltage = {f"voltage {j}": np.maximum(model.command(run) - knot, 0.0) for j, knot in enumerate(voltages)}
        forces = {f"force: {n}": force_response(model, run, n, v) for n, v in (of_position | of_voltage).items()}
        return {**{f"reading: {name}": values for name, values in of_position.items()}, **forces}

    names = list(curve(runs[0], model.predict(runs[0])))
    of_curve, _ = cost_of_terms(task, everywhere, curve, names)
    samples = dataset.samples
    return LARGE * (of_curve + len(names) - samples) < fit.fitted_chi2 + fit.validation_chi2 - samples


def _knots(values: Sequence[Array]) -> Array:
    """Return the knots of a spline over the range of some values, at even distances within it."""
    every = np.concatenate(values)
    return np.linspace(every.min(), every.max(), knot_count(len(every)) + 2)[1:-1]


def knot_count(values: int) -> int:
    """Return the default number of knots of a regression spline for some values (Ruppert, Wand and Carroll 2003)."""
    return min(values // 4, 35)


# --- smooth functions ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class BasisFunctions:
    """Smooth functions that may add to the reading of an axis, or to the force on its table.

    Parameters
    ----------
    model
        The axis.
    centres
        Frequencies at which piecewise linear functions of the logarithm of frequency meet [Hz]; they multiply a
        frequency response.
    """

    model: AxisDynamics
    centres: tuple[float, ...] = ()

    def __call__(self, observation: Observation, predicted: Array) -> dict[str, Array]:
        """Return the functions for one observation by name, n values of size one each."""
        if isinstance(observation, FrequencyResponse):
            return self._of_frequency(observation.frequencies, predicted)
        run = cast(Run, observation)
        functions = self._of_motion(run, predicted)
        forces = {f"force: {name}": force_response(self.model, run, name, functions[name]) for name in functions}
        readings = {f"reading: {name}": values for name, values in functions.items()}
        return {**readings, **forces, **self._of_time(run)}

    def _of_frequency(self, frequencies: Array, predicted: Array) -> dict[str, Array]:
        """Return hat functions of the logarithm of frequency times the response, in phase and 90 degrees ahead."""
        functions, centres = dict[str, Array](), self.centres
        for centre, hat in zip(centres, np.eye(len(centres)), strict=True):
            place = f"near {units.hertz(centre, 3)}"
            values = whole(predicted) * np.interp(np.log(frequencies), np.log(centres), hat)
            functions[f"magnitude {place}"], functions[f"phase {place}"] = parts(values), parts(1j * values)
        return functions

    def _of_motion(self, run: Run, predicted: Array) -> dict[str, Array]:
        """Return the functions of position x, velocity v and voltage u, each over what is largest, or natural."""
        x = predicted / self.model.stroke
        v = np.gradient(x, run.period) / (2 * math.pi * self.model.axis.natural_frequency)
        u = self.model.command(run) / self.model.max_command
        powers = {f"position^{k}": x**k for k in (2, 3, 4)}
        regions = np.arange(1, REGIONS) / REGIONS
        hinges = {f"position beyond {100 * h:.0f} %": np.maximum(x - h, 0.0) for h in regions}
        moving = {"velocity": v, "velocity^2": v**2, "velocity |velocity|": v * np.abs(v), "velocity^3": v**3}
        dry = {"sign of velocity": np.tanh(100 * v), "position x velocity": x * v, "position^2 x velocity": x**2 * v}
        of_voltage = {f"voltage^{k}": u**k for k in (1, 2, 3)} | {"voltage x position": u * x}
        return {**powers, **hinges, **moving, **dry, **of_voltage}

    def _of_time(self, run: Run) -> dict[str, Array]:
        """Return the functions of time, and of time since the last step of the command."""
        command = self.model.command(run)
        jumped = np.append(False, jumps(command))
        last = np.maximum.accumulate(np.where(jumped, np.arange(len(command)), 0))
        since = (np.arange(len(command)) - last) * run.period
        return {
            "reading: log of time since a step": np.log10(1 + since / 0.01),
            "reading: time": run.time - run.time[0],
        }


def force_response(model: AxisDynamics, run: Run, name: str, force: Array) -> Array:
    """Return the position of the main mode under a force over the stiffness.

    The force follows the motion; one that is named after the voltage follows the command, which may be held.
    """
    axis, held = model.axis, run.between_samples == "hold" and name.startswith("voltage")
    return mode_response(force, axis.natural_frequency, axis.damping_ratio, run.period, held=held)[0]


def basis_functions_of(data: DiagnosisData, fit: FittedModel) -> BasisFunctions:
    """Return the smooth functions for the recordings of a diagnosis."""
    lines = max((int(each.present.sum()) for each in data.fitted_responses), default=0)
    centres = np.geomspace(*data.band, max(knot_count(lines), 2)).tolist() if lines else []
    return BasisFunctions(cast(AxisDynamics, fit.model), tuple(centres))


# --- comparison -----------------------------------------------------------------------------------------------------


def smooth_residual_model(data: DiagnosisData, task: EstimationTask, fit: FittedModel) -> SparseModel:
    """Return the smooth functions that explain most of the residual of a fit."""
    # A later fit may have more initial conditions than the task.
    task = replace(task.prepared(task, fit.model), identify=fit.solution.problem.dataset)
    return sparse_model(task, fit, basis_functions_of(data, fit))


def better_kind(data: DiagnosisData, task: EstimationTask, base: FittedModel, fit: FittedModel) -> str:
    """Return what kind of model explains more than the effects of a fit, in words; empty if none does."""
    if is_better_linear(data, base, fit):
        return LINEAR_IS_BETTER
    if is_better_curve(data, task, base, fit):
        return CURVE_IS_BETTER
    return SMOOTH_IS_BETTER if is_better_smooth(data, task, base, fit) else ""


def is_better_smooth(data: DiagnosisData, task: EstimationTask, base: FittedModel, fit: FittedModel) -> bool:
    """Tell whether smooth functions explain more in place of the effects of a fit, which they make needless.

    The functions are those that explain most of the residual of the fit. They must explain more of all runs, fitted to
    all of them, because they have more coefficients than an effect. A bench may lack an effect and more besides:
    the functions then explain what it lacks besides, and imitate the effect. So the effects are needed next to the
    functions on two conditions. Their unique contribution to the fall of chi^2 is larger for each parameter than that
    of the functions (commonality analysis: Newton and Spurrell 1967, Appl. Stat. 16, 51-64). And their strengths keep
    their signs: what imitates the functions has nothing left, or the opposite, once they are there.
    """
    terms = smooth_residual_model(data, task, fit).terms
    if not terms:
        return False
    everywhere, functions = _over_all_runs(task, base), basis_functions_of(data, base)
    samples = everywhere.solution.problem.dataset.samples
    of_all, _ = cost_of_terms(task, everywhere, functions, terms)
    if LARGE * (of_all - samples) >= fit.fitted_chi2 + fit.validation_chi2 - samples:
        return False
    alone, _ = cost_of_terms(task, base, functions, terms)
    together, step = cost_of_terms(task, fit, basis_functions_of(data, fit), terms)
    of_effects = (alone - together) / sum(len(effect.free) for effect in fit.effects)
    of_functions = (fit.fitted_chi2 - together) / len(terms)
    return of_effects < of_functions or not all(_keeps_sign(fit, effect.strength, step) for effect in fit.effects)


def _over_all_runs(task: EstimationTask, fit: FittedModel) -> FittedModel:
    """Return a fit with Jacobian and residuals of the validation runs, too, at the values that it has.

    Functions of position and velocity describe the loop of one sine whatever its cause. That they do not hold for a
    second amplitude shows in all runs together.
    """
    problem = fit.solution.problem
    own = task.validate.with_shapes(problem.dataset.shapes)
    free = [parameter.name for parameter in problem.where.parameters if not parameter.run]
    problem = task.problem(problem.dataset.joined(own), fit.model, free)
    solution = linearise(problem, problem.where.start)
    return fit if solution is None else replace(fit, solution=solution)


def _keeps_sign(fit: FittedModel, name: str, step: Array) -> bool:
    """Tell whether a strength keeps its sign after a step of the coordinates, linearised."""
    where = fit.solution.problem.where
    j = where.names.index(name)
    # The derivative of a logarithm is the relative change.
    change = step[j] if where.parameters[j].scale == "log" else step[j] / (fit.solution.x[j] or 1.0)
    return bool(1 + change > 0)

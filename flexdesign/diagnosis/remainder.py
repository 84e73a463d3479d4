"""What a fitted model leaves unexplained: compared with the noise, and with what models without physics explain.

A model may lack linear dynamics that no effect of the catalogue describes: a sensor of velocity or acceleration, parts
that respond at once. Hysteresis then imitates their phase. The reading of a linear system is an amount of the command,
and one each of the position and the velocity of a mode whose frequency and damping are free (output-error model with
three numerator and two denominator coefficients: Ljung, System Identification, 1999, section 4.2). Amounts are linear
and are eliminated (variable projection: Golub and Pereyra 1973). Smooth functions are of where a stage is and how it
moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np

from flexdesign import effects
from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.model import Observation
from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.signal_chain import exact_step
from flexdesign.estimation.criterion import BETTER
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.sparse_residual_model import (
    SparseModel,
    cost_of_terms,
    sparse_model,
    without_columns,
)
from flexdesign.measurements.noise_level import allowed_excess
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.measurements.recordings.frequency_response import parts, whole

#: Damping ratios of the linear system, and the factor by which its frequency may leave where it starts.
DAMPING_RATIOS, LARGEST_FREQUENCY_FACTOR = (1e-3, 3.0), 20.0
#: Velocities are counted in this share of stroke times natural frequency; dry friction turns at a tenth of it.
VELOCITY_SCALE = 0.1
#: Where thresholds are tried, in shares of the stroke.
THRESHOLDS = (0.15, 0.3, 0.5, 0.7, 0.85)
#: Numbers of bumps over the band of frequency responses, and lines for each at least; how broad each is, as a standard
#: deviation in distances to the next.
BUMP_COUNTS, FEWEST_LINES, BUMP_WIDTH = (6, 12, 24, 48), 4, 0.6
#: A sample this number of standard deviations of its run from zero is a jump; this number of jumps is not random: in
#: Gaussian noise one sample in five hundred million lies as far.
JUMP_DEVIATIONS, FEWEST_JUMPS = 6.0, 3
#: Standard deviation of Gaussian noise over the median of its size.
DEVIATION_PER_MEDIAN = 1.4826


@dataclass(frozen=True)
class Remainder:
    """How a fitted model's remainder compares with the noise.

    Parameters
    ----------
    excess
        Mean square of the residual, whitened, less that of noise: the larger one of fitted and
        validation runs.
    allowed
        What counts as none.
    jumps
        Sudden changes in the residual, whitened, of the runs that were fitted.
    """

    excess: float
    allowed: float
    jumps: int = 0

    @property
    def is_noise(self) -> bool:
        """Tell whether nothing but noise is left."""
        return self.excess <= self.allowed and self.jumps < FEWEST_JUMPS


def remainder(data: DiagnosisData, fit: FittedModel) -> Remainder:
    """Return how what a fitted model leaves compares with the noise."""
    margins = [(ratio - 1, allowed_excess(count, level)) for ratio, count, level in _ratios(data, fit)]
    excess, allowed = max(margins, key=lambda pair: pair[0] - pair[1])
    return Remainder(excess, allowed, _jumps(data, fit))


def _ratios(data: DiagnosisData, fit: FittedModel) -> Iterator[tuple[float, int, float]]:
    """Yield mean squares of the residual, whitened, with their counts and twice the relative error of the noise.

    Runs and frequency responses are judged apart: these have so few values that they would drown among those.
    """
    level = 2 * data.noise.relative_error
    pairs = list(zip(fit.solution.problem.dataset.records, fit.solution.residuals, strict=True))
    kinds = [(level, [pair for pair in pairs if pair[0].observation.name not in data.lines])]
    kinds += [(_line_level(data), [pair for pair in pairs if pair[0].observation.name in data.lines])]
    for error, seen in kinds:
        if count := int(sum(record.present.sum() for record, _ in seen)):
            yield sum(float(part @ part) for _, part in seen) / count, count, error
    held = 0.0
    scored = [each for each in data.responses if each.role == "validate"]
    if scored:
        left = [(fit.residuals_by_run[e.name] / data.lines[e.name].of_values)[np.tile(e.present, 2)] for e in scored]
        held = float(sum(part @ part for part in left))
        values = sum(len(part) for part in left)
        yield held / values, values, _line_level(data)
    if samples := sum(int(np.isfinite(run.measured()).sum()) for run in data.of("validate")):
        yield (fit.validation_chi2 - held) / samples, samples, level


def _line_level(data: DiagnosisData) -> float:
    """Return twice the relative error of the noise of frequency responses."""
    return max((math.sqrt(2 / noise.dof) if noise.dof else math.inf for noise in data.lines.values()), default=0.0)


def _jumps(data: DiagnosisData, fit: FittedModel) -> int:
    """Count the jumps in the residual; a reading in coarse steps has them by itself."""
    if data.coarse_step is not None:
        return 0
    count = 0
    for record, part in zip(fit.solution.problem.dataset.records, fit.solution.residuals, strict=True):
        if record.observation.name in data.lines:  # neighbouring lines are no neighbours in time
            continue
        left = np.abs(part[: len(record.measured)][record.present])
        count += int((left > JUMP_DEVIATIONS * DEVIATION_PER_MEDIAN * np.median(left)).sum())
    return count


def unexplained_rms(data: DiagnosisData, fit: FittedModel) -> float:
    """Return the rms residual above the noise of the runs that judge [response]; all of it where that is unknown."""
    return math.sqrt(max(data.error(fit) ** 2 - data.known_noise_rms**2, 0.0))


def is_adequate(data: DiagnosisData, fit: FittedModel, left: SparseModel) -> bool:
    """Return whether the residual is noise, or below what matters to the user."""
    if (data.is_asked or not data.noise.known) and unexplained_rms(data, fit) <= data.tolerance:
        return True
    # Smooth functions that explain something show that there is something, however small it is compared with the noise.
    explainable = left.held_gain > 0 and left.validation_rms > data.tolerance and left.gain > 0
    if not data.noise.known:  # a white residual may be noise, whatever its size
        return fit.is_white and not explainable
    return remainder(data, fit).is_noise and not explainable


def describe_size(data: DiagnosisData, final: Remainder) -> str:
    """Return how much a model leaves."""
    if not data.noise.known:
        return "the residual remains"
    return f"{math.sqrt(1 + max(final.excess, 0.0)):.3g} times the noise remains"


def describe(data: DiagnosisData, final: Remainder, left: SparseModel) -> str:
    """Return how much a model leaves, and which smooth functions explain most of it."""
    share = describe_size(data, final)
    if data.noise.known and any(data.noise.whitening.process(run.name).order for run in data.runs):
        share += " (whitened: of each sample counts what those before it do not predict; the errors stated are raw)"
    if final.jumps >= FEWEST_JUMPS:
        share += f", with {final.jumps} sudden jumps"
    if not left.terms:
        return f"{share}; no smooth function of position, velocity, voltage or time explains it"
    best = sorted(left.shares, key=lambda name: -left.shares[name])[:3]
    return f"{share}; of smooth functions these explain most: {', '.join(best)}"


# --- models without physics -----------------------------------------------------------------------------------------


def is_better_linear(data: DiagnosisData, base: FittedModel, fit: FittedModel) -> bool:
    """Tell whether the best linear system leaves no more than a fit with nonlinear effects."""
    if not data.runs or data.responses or all(effects.find(name).is_linear for name in fit.names):
        return False
    model, axis = cast(AxisDynamics, base.model), data.axis
    starts = [(each.natural_frequency, each.damping_ratio) for each in (model.axis, axis)]
    dataset = fit.solution.problem.dataset
    return min(_chi2(dataset, model, *start) for start in starts) <= fit.fitted_chi2


def _chi2(dataset: Dataset, model: AxisDynamics, frequency: float, damping_ratio: float) -> float:
    """Return chi^2 of the linear system that fits a data set best, searched from a frequency and a damping ratio."""
    from scipy.optimize import least_squares

    measured = np.concatenate([dataset.whitened(record, record.measured) for record in dataset.records])

    def residual(logarithms: Array) -> Array:
        columns = [
            dataset.whitened_columns(record, _columns(model, cast(Run, record.observation), *np.exp(logarithms)))
            for record in dataset.records
        ]
        return without_columns(measured, np.vstack(columns))

    start = np.log([frequency, np.clip(damping_ratio, 1.01 * DAMPING_RATIOS[0], 0.99 * DAMPING_RATIOS[1])])
    far = math.log(LARGEST_FREQUENCY_FACTOR)
    bounds = np.array([[start[0] - far, math.log(DAMPING_RATIOS[0])], [start[0] + far, math.log(DAMPING_RATIOS[1])]])
    return float(2 * least_squares(residual, start, bounds=bounds, diff_step=1e-3, max_nfev=40).cost)


def _columns(model: AxisDynamics, run: Run, frequency: float, damping_ratio: float) -> Array:
    """Return the command, and position and velocity of the mode that it drives from rest: n by 3."""
    command = model.command(run)
    return np.column_stack([command - command[0], *mode_response(command, frequency, damping_ratio, run.period)])


def mode_response(force: Array, frequency: float, damping_ratio: float, period: float) -> tuple[Array, Array]:
    """Return position, and velocity over 2 pi times the frequency, of a mode from rest under a held force.

    Parameters
    ----------
    force
        Over the stiffness, n values; its change from the first one acts.
    frequency, damping_ratio
        Of the mode [Hz, 1].
    period
        Of the samples [s].
    """
    from scipy.signal import lfilter

    w = 2 * math.pi * frequency
    a = w * np.array([[0.0, 1.0], [-1.0, -2 * damping_ratio]])
    passage = exact_step.step(a, w * np.array([0.0, 1.0]), period)
    f, g = passage.transition, passage.weights.sum(axis=1)
    # Each state of x' = F x + g u as a difference equation.
    denominator = [1.0, -np.trace(f), np.linalg.det(f)]
    numerators = ([0.0, g[0], f[0, 1] * g[1] - f[1, 1] * g[0]], [0.0, g[1], f[1, 0] * g[0] - f[0, 0] * g[1]])
    position, velocity = (np.asarray(lfilter(above, denominator, force - force[0])) for above in numerators)
    return position, velocity


@dataclass(frozen=True, eq=False)
class BasisFunctions:
    """Functions of position, velocity, voltage and time that add to the reading, or to the force on the table.

    Parameters
    ----------
    model
        The axis.
    band
        Lowest and highest frequency of all frequency responses [Hz], and the number of their lines; None if there are
        none. Then there are smooth functions of the logarithm of frequency, too, by which a response is multiplied.
    is_time_domain
        Whether there are runs in time.
    """

    model: AxisDynamics
    band: tuple[float, float, int] | None = None
    is_time_domain: bool = True

    def __call__(self, observation: Observation, predicted: Array) -> dict[str, Array]:
        """Return the functions by name, n values each, about as large as one; zero where they are not meant."""
        if isinstance(observation, FrequencyResponse):
            there = self._of_frequency(observation, predicted)
        else:
            there = self._in_time(observation, predicted)
        if self.band is None:
            return there
        return {name: there.get(name, np.zeros(len(predicted))) for name in self._names}

    @cached_property
    def _names(self) -> list[str]:
        """Names of all functions, those in time first."""
        made = list(self._of_frequency(None, np.zeros(0))) if self.band else []
        if not self.is_time_domain:
            return made
        t = self.model.first.natural_frequency**-1 * np.arange(4.0)
        blank = Run("blank", t, {"u": np.zeros(4), self.model.name: np.zeros(4)}, {"u": "V"})
        return [*self._in_time(blank, np.zeros(4)), *made]

    def _of_frequency(self, response: FrequencyResponse | None, predicted: Array) -> dict[str, Array]:
        """Return bumps over the logarithm of frequency times the response, in step with it and a quarter ahead."""
        assert self.band is not None
        low, high, lines = self.band
        made = dict[str, Array]()
        for count in (many for many in BUMP_COUNTS if many <= max(lines // FEWEST_LINES, BUMP_COUNTS[0])):
            centres = np.geomspace(low, high, count)
            for centre in centres.tolist():
                about = f"near {units.hertz(centre, 3)}, 1/{count} of the band"
                if response is None:
                    made |= {f"magnitude {about}": predicted, f"phase {about}": predicted}
                    continue
                width = math.log(high / low) / (count - 1)
                bump = np.exp(-0.5 * (np.log(response.frequencies / centre) / (BUMP_WIDTH * width)) ** 2)
                made[f"magnitude {about}"] = parts(bump * whole(predicted))
                made[f"phase {about}"] = parts(1j * bump * whole(predicted))
        return made

    def _in_time(self, observation: Observation, predicted: Array) -> dict[str, Array]:
        assert isinstance(observation, Run)
        made = self._functions(observation, predicted)
        forces = {f"force: {name}": self._through(values, observation.period) for name, values in made.items()}
        readings = {f"reading: {name}": values for name, values in made.items()}
        return {**readings, **forces, **self._of_time(observation)}

    def _functions(self, run: Run, predicted: Array) -> dict[str, Array]:
        x = predicted / self.model.stroke
        fast = 2 * math.pi * self.model.axis.natural_frequency * VELOCITY_SCALE
        v = np.gradient(x, run.period) / fast
        u = self.model.command(run) / self.model.max_command
        powers = {f"position^{k}": x**k for k in (2, 3, 4)}
        knees = {f"position beyond {100 * knee:.0f} %": np.maximum(x - knee, 0.0) for knee in THRESHOLDS}
        moving = {"velocity": v, "velocity^2": v**2, "velocity |velocity|": v * np.abs(v), "velocity^3": v**3}
        dry = {"sign of velocity": np.tanh(10 * v), "position x velocity": x * v, "position^2 x velocity": x**2 * v}
        of_voltage = {f"voltage^{k}": u**k for k in (1, 2, 3)} | {"voltage x position": u * x}
        return {**powers, **knees, **moving, **dry, **of_voltage}

    def _of_time(self, run: Run) -> dict[str, Array]:
        command = self.model.command(run)
        jumps = np.abs(np.diff(command, prepend=command[0])) > 0.02 * self.model.max_command
        last = np.maximum.accumulate(np.where(jumps, np.arange(len(command)), 0))
        since = (np.arange(len(command)) - last) * run.period
        return {
            "reading: log of time since a step": np.log10(1 + since / 0.01),
            "reading: time": run.time - run.time[0],
        }

    def _through(self, force: Array, period: float) -> Array:
        """Return what a force over the stiffness does to the main mode, held between samples."""
        axis = self.model.axis
        return mode_response(force, axis.natural_frequency, axis.damping_ratio, period)[0]


def basis_functions_of(data: DiagnosisData, fit: FittedModel) -> BasisFunctions:
    """Return the smooth functions that recordings of a kind may show."""
    lines = [int(each.present.sum()) for each in data.taught]
    band = (*data.band, max(lines)) if lines else None
    return BasisFunctions(cast(AxisDynamics, fit.model), band, bool(data.runs))


# --- comparison -----------------------------------------------------------------------------------------------------


def smooth_residual_model(data: DiagnosisData, task: EstimationTask, fit: FittedModel) -> SparseModel:
    """Return the smooth functions that explain most of what a fit leaves."""
    seen = fit.solution.problem.dataset  # records may begin in more ways in a later fit
    task = replace(task.prepared(task, fit.model), identify=seen)
    return sparse_model(task, fit, basis_functions_of(data, fit))


def is_better_without_physics(data: DiagnosisData, task: EstimationTask, base: FittedModel, fit: FittedModel) -> bool:
    """Tell whether a linear system or smooth functions explain more in the place of the effects of a fit."""
    return is_better_linear(data, base, fit) or is_better_smooth(data, task, base, fit)


def is_better_smooth(data: DiagnosisData, task: EstimationTask, base: FittedModel, fit: FittedModel) -> bool:
    """Tell whether the smooth functions of what a fit with effects leaves explain more in the place of the effects."""
    terms = smooth_residual_model(data, task, fit).terms
    if not terms:
        return False
    alone = cost_of_terms(task, base, basis_functions_of(data, base), terms)
    samples = base.solution.problem.dataset.samples
    return alone - samples < BETTER * (fit.fitted_chi2 - samples)

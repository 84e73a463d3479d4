"""The data of a diagnosis: runs and frequency responses with roles, noise, priors and tolerance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.axis import axis_response
from flexdesign.dynamics.axis.axis_choice import choose_axis
from flexdesign.dynamics.axis.axis_parameters import HYSTERESIS_PARAMETERS, LINEAR_PARAMETERS
from flexdesign.dynamics.axis.axis_run import is_at_stack, measured_stroke, noise_of_axis, of_axis
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process, Whitening, burg
from flexdesign.measurements.noise_level import LineNoise, Mixed, NoiseFloor, line_noise
from flexdesign.measurements.noise_level.lines import noise_of_lines, with_lines
from flexdesign.measurements.recordings import FrequencyResponse, Run, split, split_lines

#: An effect must change a prediction by this share of the noise, or of the stroke if that is less or the noise is
#: unknown. If the noise is unknown, a residual below the latter counts as zero.
OF_NOISE, OF_STROKE = 0.3, 5e-4
#: Number of values above which recordings are very long: each further hundred thousand would take minutes. They are
#: searched in the second number of values; from as many on, runs are tested for oversampling.
VERY_LONG, SAMPLES_SEARCHED = 100_000, 12_000
#: Readings come in whole steps if each level is within this share of a step of a grid.
GRID_TOLERANCE = 0.05


@dataclass(frozen=True, eq=False)
class DiagnosisData:
    """The data of a diagnosis of one axis.

    Parameters
    ----------
    name, axis
        Name and model of the axis.
    runs
        Runs of this axis, with roles.
    noise
        The noise floor.
    tolerance
        Least change of a prediction by an effect [response].
    known
        Priors of the parameters of the model itself: mean and standard deviation, SI, by name.
    responses
        Frequency responses of this axis, with roles.
    lines
        The noise of each frequency response, by name.
    default_limit
        The default of `tolerance` [response].
    is_asked
        Whether the user stated the tolerance: then a residual below it counts as zero.
    stroke
        The largest peak-to-peak reading of a run, or of frequency responses alone the size of their lines [response].
        It does not depend on the gain of the model, which may be wrong.
    """

    name: str
    axis: AxisModel
    runs: tuple[Run, ...]
    noise: NoiseFloor
    tolerance: float
    known: Mapping[str, tuple[float, float]]
    responses: tuple[FrequencyResponse, ...] = ()
    lines: Mapping[str, LineNoise] = field(default_factory=dict)
    default_limit: float = 0.0
    is_asked: bool = False
    stroke: float = 0.0

    @property
    def recorded(self) -> tuple[Run | FrequencyResponse, ...]:
        """Runs, then frequency responses."""
        return (*self.runs, *self.responses)

    @property
    def whitening(self) -> Whitening:
        """Whitening of runs and frequency responses."""
        return Mixed(self.noise.whitening, self.lines) if self.lines else self.noise.whitening

    @property
    def is_loaded(self) -> bool:
        """Whether some runs carry a known mass on an axis whose mass is known."""
        return self.axis.mass is not None and any(each.payload for each in self.recorded)

    @property
    def is_at_stack(self) -> bool:
        """Whether the voltage at the stack is known of every run that moves, and of every frequency response."""
        moving = [run for run in self.runs if np.ptp(run.command())]
        behind = [is_at_stack(run) for run in moving] + [each.command_is != "dac" for each in self.responses]
        return bool(behind) and all(behind)

    @property
    def is_one_record(self) -> bool:
        """Whether only one moving run, or windows of it, is fitted.

        Then its own delay is indistinguishable from a common delay.
        """
        moving = [run.name for run in self.of("identify") if np.ptp(run.command())]
        return len({name.rpartition(":")[0] or name for name in moving}) < 2

    @cached_property
    def coarse_step(self) -> float | None:
        """The step of readings that come in whole steps larger than the noise [response]; else None."""
        if not self.runs:
            return None
        readings = np.concatenate([run.measured() for run in self.runs])
        return coarse_step(readings, self.noise.rms[self.runs[0].name], self.axis.sensor.resolution)

    @property
    def values(self) -> int:
        """Number of values in time; the parts of one recording count once."""
        return sum(len(run.time) for run in {run.record: run for run in self.runs}.values())

    @property
    def is_very_long(self) -> bool:
        """Whether effects are searched in windows."""
        return self.values > VERY_LONG

    def rounded(self, fit: FittedModel) -> Whitening | None:
        """Return the noise with the rounding of the predicted motion, if readings come in coarse steps; else None.

        Test runs, which no fit predicts before the end, keep their estimated noise.
        """
        if self.coarse_step is None:
            return None
        processes = dict[str, Process]()
        for run in self.runs:
            process, residual = self.noise.whitening.process(run.name), fit.residuals_by_run.get(run.name)
            processes[run.name] = (
                process
                if residual is None
                else rounding_noise(run.measured() - residual, process.rms, self.coarse_step)
            )
        noise = ColouredNoise(processes)
        return Mixed(noise, self.lines) if self.lines else noise

    def of(self, role: str) -> list[Run]:
        """Return the runs of a role."""
        return [run for run in self.runs if run.role == role]

    def observed(self, role: str) -> list[Run | FrequencyResponse]:
        """Return runs and frequency responses of a role."""
        return [*self.of(role), *(each for each in self.responses if each.role == role)]

    @property
    def fitted_responses(self) -> Sequence[FrequencyResponse]:
        """The frequency responses that are fitted, or all if none is."""
        return [each for each in self.responses if each.role == "identify"] or self.responses

    @property
    def band(self) -> tuple[float, float]:
        """Lowest and highest frequency of the fitted frequency responses [Hz]."""
        ends = [(float(each.frequencies[0]), float(each.frequencies[-1])) for each in self.fitted_responses]
        return min(low for low, _ in ends), max(high for _, high in ends)

    @property
    def selecting(self) -> list[str]:
        """Names of what chooses the model: validation runs, or all runs without any; without runs, responses."""
        every = self.runs or self.responses
        return [each.name for each in every if each.role == "validate"] or [each.name for each in every]

    @property
    def scored(self) -> list[str]:
        """Names of the observations whose errors are stated: test runs, or without any those of `selecting`."""
        every = self.runs or self.responses
        return [each.name for each in every if each.role == "test"] or self.selecting

    @property
    def scales(self) -> dict[str, Array]:
        """Roots of the weights of frequency responses, whose mean square is one: each line counts by its noise."""
        return {e.name: self.noise.rms[e.name] / self.lines[e.name].of_values for e in self.responses}

    def error(self, fit: FittedModel) -> float:
        """Return the rms residual of the observations that choose the model [response]."""
        return fit.rms(self.selecting, self.scales)

    def unexplained_rms(self, fit: FittedModel) -> float:
        """Return the rms residual above the noise [response]; all of it if the noise is unknown."""
        return math.sqrt(max(self.error(fit) ** 2 - self.known_noise(self.selecting) ** 2, 0.0))

    def is_negligible(self, fit: FittedModel) -> bool:
        """Tell whether what is unexplained is below a stated tolerance, or below the usual one if noise is unknown."""
        return (self.is_asked or not self.noise.known) and self.unexplained_rms(fit) <= self.tolerance

    def test_error(self, fit: FittedModel) -> float:
        """Return the rms residual of the observations whose errors are stated [response]."""
        return fit.rms(self.scored, self.scales)

    @property
    def max_command(self) -> float:
        """Largest command [V], to which plausible ranges are scaled; without runs, the limit that the model states."""
        driven = [float(np.abs(run.command()).max()) for run in self.runs]
        driven += [abs(each.bias) + (each.amplitude or 0.0) for each in self.responses]
        if not self.runs:
            driven += [abs(limit) for limit in stages.command_limits(self.axis) if math.isfinite(limit)]
        return max(driven) or 1.0

    @property
    def periods(self) -> list[float]:
        """Sampling periods of the runs; without runs half of that of the highest line [s]."""
        highest = max((float(each.frequencies[-1]) for each in self.responses), default=0.0)
        return [run.period for run in self.runs] or [0.5 / highest]

    def known_noise(self, names: Sequence[str]) -> float:
        """Return the rms noise of some observations; zero if the noise is unknown [response]."""
        return self._rms_noise(names) if self.noise.known else 0.0

    @property
    def line_size(self) -> float:
        """Size of the lines that choose the model, each weighted by its noise as in `error` [response/V]."""
        selecting = [each for each in self.responses if each.name in self.selecting]
        sizes = np.concatenate([each.measured() * self.scales[each.name] for each in selecting])
        return float(np.sqrt(np.nanmean(sizes**2)))

    @property
    def noise_rms(self) -> float:
        """Rms noise of the observations whose errors are stated [response]."""
        return self._rms_noise(self.scored)

    def _rms_noise(self, names: Sequence[str]) -> float:
        sizes = {each.name: np.isfinite(each.measured()).sum() for each in self.recorded}
        squares = [self.noise.rms[name] ** 2 * sizes[name] for name in names]
        return float(np.sqrt(sum(squares) / sum(sizes[name] for name in names)))


def prepare(
    model: StageModel,
    recorded: Sequence[Run | FrequencyResponse],
    axis: str | None,
    tolerance: float | None,
    stated: float | None = None,
) -> DiagnosisData:
    """Return the data of a diagnosis, with their noise floor.

    Parameters
    ----------
    model, recorded, axis
        The stage model, the recordings, and the name of the axis; None if model and recordings leave no choice.
    tolerance
        Stated tolerance [response]; None for the default.
    stated
        Stated standard deviation of the noise of runs [response]; None if it is to be estimated.
    """
    name = choose_axis(model, recorded, axis)
    axis_model = model.axes[name]
    runs = [each for each in recorded if isinstance(each, Run)]
    axis_runs = tuple(of_axis(run, name, axis_model) for run in split(runs, test=True)) if runs else ()
    measured = [
        axis_response.of_axis(each, name, axis_model) for each in recorded if isinstance(each, FrequencyResponse)
    ]
    responses = split_lines(measured)
    if "identify" not in [*(run.role for run in axis_runs), *(each.role for each in responses)]:
        raise InputError("command line", "RUNS", None, "all are kept for validation; name a run with role identify")
    noise_of_all_lines = {each.name: line_noise(each) for each in measured}
    lines = {  # a part of a split response has the noise of the whole
        each.name: noise_of_all_lines.get(each.name) or noise_of_all_lines[each.name.rpartition(":")[0]]
        for each in responses
    }
    if not axis_runs:
        noise = noise_of_lines(responses, lines)
        data = DiagnosisData(name, axis_model, (), noise, 0.0, _priors(axis_model), responses, lines)
        return _with_tolerance(replace(data, stroke=data.line_size), tolerance)
    noise = noise_of_axis(runs, name, axis_model)
    if stated is not None:
        level = {run.name: stated * run.noise_gain for run in runs}
        white = ColouredNoise({name: Process(np.zeros(0), rms) for name, rms in level.items()})
        noise = NoiseFloor(white, level, "as stated", known=True, lines=noise.lines, dof=math.inf)
    noise = of_blocks(noise, axis_runs)
    first = DiagnosisData(
        name, axis_model, axis_runs, noise, 0.0, _priors(axis_model), stroke=measured_stroke(runs, name)
    )
    if (step := first.coarse_step) is not None:  # a quiet run may show no rounding
        at_least = {run: max(rms, step / math.sqrt(12)) for run, rms in noise.rms.items()}
        first = replace(first, noise=replace(noise, rms=at_least))
    data = _with_tolerance(first, tolerance)
    return replace(data, noise=with_lines(data.noise, responses, lines), responses=responses, lines=lines)


def usual_tolerance(stroke: float, noise: float | None) -> float:
    """Return the default tolerance, rms [response].

    Parameters
    ----------
    stroke, noise
        Stroke, and rms noise; None if it is unknown [response].
    """
    return OF_STROKE * stroke if noise is None else min(OF_NOISE * noise, OF_STROKE * stroke)


def _with_tolerance(data: DiagnosisData, asked: float | None) -> DiagnosisData:
    """Return the data set with a stated tolerance, or with the default."""
    least = usual_tolerance(data.stroke, data.noise_rms if data.noise.known else None)
    return replace(data, tolerance=least if asked is None else asked, default_limit=least, is_asked=asked is not None)


def line_weights(data: DiagnosisData) -> dict[str, Array]:
    """Return the weights of frequency responses relative to the tolerance.

    As in time, an effect must change a line by a share of its noise, or of its size if that is less; multiplied by the
    ratio of the stated tolerance to the default.
    """
    found = {}
    for each in data.responses:
        sigma = data.lines[each.name].of_values
        size = np.hypot(np.tile(np.abs(np.nan_to_num(each.response)), 2), sigma)
        known = data.noise.known or bool(data.runs)
        least = np.minimum(OF_NOISE * sigma, OF_STROKE * size) if known else OF_STROKE * size
        found[each.name] = data.default_limit / least
    return found


def of_blocks(noise: NoiseFloor, runs: Sequence[Run]) -> NoiseFloor:
    """Return the noise under the names of runs that are blocks, or windows, of a longer run."""
    records = {run.name: run.name if run.name in noise.rms else run.name.rpartition(":")[0] for run in runs}
    processes = {name: noise.whitening.process(record) for name, record in records.items()}
    return replace(noise, whitening=ColouredNoise(processes), rms={n: noise.rms[r] for n, r in records.items()})


def _priors(axis: AxisModel) -> dict[str, tuple[float, float]]:
    return axis.prior([*LINEAR_PARAMETERS, *(HYSTERESIS_PARAMETERS[:-1] if "bouc_wen" in axis.effects else ())])


# --- readings in coarse steps ----------------------------------------------------------------------------------------


def coarse_step(readings: Array, noise: float, resolution: float) -> float | None:
    """Return the step of readings that come in whole steps, larger than noise and resolution; else None.

    Parameters
    ----------
    readings
        Of all runs [response]; NaN at gaps.
    noise, resolution
        Rms noise, and what the sensor is stated to resolve [response].
    """
    levels = np.unique(readings[np.isfinite(readings)])
    gaps = np.diff(levels)
    step = float(np.median(gaps)) if len(gaps) else 0.0
    if step <= max(noise, 2 * resolution):
        return None
    counts = np.round(gaps / step)
    if np.abs(gaps / step - counts).max() > GRID_TOLERANCE:
        return None
    # The levels lie on a line whose slope is the step, which a file that rounds its readings shows no gap of.
    return float(np.polyfit(np.concatenate([[0.0], np.cumsum(counts)]), levels, 1)[0])


def rounding_noise(motion: Array, noise: float, step: float) -> Process:
    """Return the noise that rounding makes of a motion: no white noise, and a fit would see effects in it.

    Parameters
    ----------
    motion
        As it is predicted, n values [response]; NaN at gaps.
    noise, step
        Rms noise of the readings, most of which is rounding where steps are coarse; and the step [response].
    """
    rng = np.random.default_rng(0)
    beneath = min(noise, step / math.sqrt(12))  # rounding hides what is smaller than its own noise
    disturbed = motion + rng.uniform(0, step)  # where the grid lies beneath an unknown offset is drawn, too
    error = step * np.round((disturbed + beneath * rng.standard_normal(len(motion))) / step) - disturbed
    error = error[np.isfinite(error)] - np.nanmean(error)
    process = Process(burg([error]), 1.0)
    return replace(process, sigma=float(np.sqrt(np.mean(process.whiten(error[:, None]) ** 2))))

"""The noise of a response, from the best source that its runs hold."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from flexdesign.estimation.noise.quiet_stretches import HIGHEST_ORDER, Sinusoid, Stretch, estimate, remove_sinusoids
from flexdesign.measurements.noise_level.sources import (
    SHORTEST_SETTLING,
    Source,
    differences_of_periods,
    differences_of_repeats,
    stationary_stretches,
)
from flexdesign.measurements.recordings import Run
from flexdesign.measurements.recordings.reading_steps import ROUNDING, smallest_step

#: A source with fewer effective samples gives way to one with more: its level is known to 22 % only.
ENOUGH = 10.0
#: Sources, or runs, whose levels differ by more than this factor, and by more than chance, disagree.
DISAGREES = 1.5
#: Standard errors that chance does not exceed.
STANDARD_ERRORS = 4.0
#: Where the noise is unknown: samples in a segment of the spectrum, and which of its quantiles counts as noise.
SEGMENT, LOWEST = 1024, 0.1
#: A residual counts as noise if its mean square, whitened, exceeds one by no more than this, which no bench is free of,
#: and this number of standard errors, of chance and of the level of the noise together.
ADEQUATE, ERRORS = 0.09, 3.5


@dataclass(frozen=True, eq=False)
class NoiseFloor:
    """The noise of one response in some runs.

    Parameters
    ----------
    whitening
        What turns it into independent numbers of variance one; it knows the runs by their names.
    rms
        Its standard deviation in each run [response SI].
    source
        Where it was measured, in words.
    known
        Whether it was measured or stated; else it is guessed from the band in which the response is quietest.
    lines
        Sinusoids found in the quiet record. They are no part of the noise.
    dof
        Effective number of samples behind the level; infinite where it was stated, zero where it is unknown.
    remarks
        Where sources or runs disagree.
    """

    whitening: ColouredNoise
    rms: Mapping[str, float]
    source: str
    known: bool
    lines: tuple[Sinusoid, ...]
    dof: float
    remarks: tuple[str, ...] = field(default=())

    @property
    def relative_error(self) -> float:
        """Relative standard error of the level."""
        return math.sqrt(0.5 / self.dof) if self.dof > 0 else math.inf

    def allowed_excess(self, count: float) -> float:
        """Return by how much the mean square of `count` whitened values may exceed one and count as noise."""
        return allowed_excess(count, 2 * self.relative_error)

    def density(self, run: Run, frequency: Array) -> Array:
        """Return the one-sided power spectral density of a run's noise [SI^2/Hz] at frequencies [Hz]."""
        return self.whitening.process(run.name).density(frequency, run.period)


def allowed_excess(count: float, error: float) -> float:
    """Return by how much a mean square may exceed that of noise, which is known with a relative standard error."""
    return ADEQUATE + ERRORS * math.hypot(math.sqrt(2 / count), error)


@dataclass(frozen=True, eq=False)
class _Level:
    """What one source says: a process for each run, lines, and the effective number of samples."""

    source: Source
    processes: Mapping[str, Process]
    lines: tuple[Sinusoid, ...]
    dof: float
    remarks: tuple[str, ...]


def noise_floor(
    runs: Sequence[Run],
    axis: str,
    *,
    settling_time: float = SHORTEST_SETTLING,
    sensor_noise: float = 0.0,
    remove_lines: bool = True,
) -> NoiseFloor:
    """Return the noise of one response, from the best source there is.

    Parameters
    ----------
    runs
        With all their columns: a stretch is quiet only where every command stands still.
    axis
        The response.
    settling_time
        How long the stage rings after its command has come to rest [s]; where no model says it, it is sought from a
        short one on.
    sensor_noise
        Standard deviation that the sensor is stated to have [response]; used where the runs show none. If it is zero,
        what the runs say of their sensors counts.
    remove_lines
        Whether sinusoids are separated from noise.

    Raises
    ------
    InputError
        If there is no run, or one lacks the response.
    """
    if not runs:
        raise InputError("noise", "runs", None, "name at least one recorded run")
    for run in runs:
        if axis not in run.columns:
            remedy = f"the run has no response of axis {axis}; leave the run out"
            raise InputError(run.name, axis, None, remedy)
    smallest = _smallest(runs, axis)
    stated = sensor_noise or max((run.sensors[axis].noise or 0.0 for run in runs if axis in run.sensors), default=0.0)
    sources = [
        stationary_stretches(runs, axis, settling_time),
        differences_of_periods(runs, axis, settling_time),
        differences_of_repeats(runs, axis, settling_time),
    ]
    levels = [_level(source, runs, smallest, remove_lines) for source in sources if source.stretches]
    if not levels:
        return _without_source(runs, axis, stated, smallest)
    gains = [run.noise_gain for run in runs]
    chosen = next((level for level in levels if level.dof >= ENOUGH), max(levels, key=lambda level: level.dof))
    return NoiseFloor(
        whitening=ColouredNoise(chosen.processes),
        rms={run.name: chosen.processes[run.name].rms for run in runs},
        source=chosen.source.words,
        known=True,
        lines=chosen.lines,
        dof=chosen.dof,
        remarks=(*chosen.remarks, *_disagreements(chosen, levels, stated * float(np.median(gains)))),
    )


def _level(source: Source, runs: Sequence[Run], smallest: float, remove_lines: bool) -> _Level:
    """Return what a source says of every run, those of other sampling periods among them."""
    periods: dict[str, float] = {}  # clocks that differ by less than a thousandth have one period
    for run in runs:
        alike = (known for known in periods.values() if math.isclose(known, run.period, rel_tol=1e-3))
        periods[run.name] = next(alike, run.period)
    processes: dict[str, Process] = {}
    pooled: dict[float, Process] = {}
    lines: list[Sinusoid] = []
    remarks: list[str] = []
    dof = 0.0
    for period in dict.fromkeys(periods[s.run] for s in source.stretches):
        left: Sequence[Stretch] = [s for s in source.stretches if periods[s.run] == period]
        if remove_lines:
            found, left = remove_sinusoids(left, period)
            lines += [replace(line, amplitude=line.amplitude * source.amplitude(line.frequency)) for line in found]
        process, left, effective = _process(left, smallest)
        pooled[period] = process
        if process.rms <= smallest:
            remarks.append("the record shows no noise of its own; taken is what readings in steps have")
        dof += effective
        for name in (name for name, own_period in periods.items() if own_period == period):
            own = [s for s in left if s.run == name]
            factor = max(_own_level(process, own), smallest / process.rms) if process.rms > smallest else 1.0
            processes[name] = replace(process, sigma=process.sigma * factor)
            if factor != 1:
                remarks.append(f"the noise of {name} is {factor:.2g} times that of all runs together")
    for name, period in periods.items():
        if name not in processes:
            nearest = min(pooled, key=lambda p: abs(math.log(p / period)))
            processes[name] = resample(pooled[nearest], nearest, period)
            remarks.append(f"the noise of {name} follows from runs with another sampling period")
    return _Level(source, processes, _merge(lines), dof, tuple(remarks))


def _process(stretches: Sequence[Stretch], smallest: float) -> tuple[Process, Sequence[Stretch], float]:
    """Return the process behind stretches, these with the trends it was found with, and its effective samples.

    Creep and drift are no noise. Each stretch may bend if the stretches together bend beyond chance; else they are
    taken as straight, which costs less.
    """
    straight = [replace(s, trend=s.trend[:, :2]) for s in stretches]
    if max(float(np.abs(s.residual).max()) for s in straight) < smallest:
        return Process.white(smallest), straight, float(sum(s.dof for s in straight))
    curved, effective = estimate(stretches)
    gain = sum(_squares(curved, s) - _squares(curved, bent) for s, bent in zip(straight, stretches, strict=True))
    extra = sum(s.trend.shape[1] - 2 for s in stretches)
    bends = gain > extra + STANDARD_ERRORS * math.sqrt(2 * extra)
    process, effective = (curved, effective) if bends else estimate(straight)
    if process.rms <= smallest:
        process = Process.white(smallest)
    return process, stretches if bends else straight, effective


def _squares(process: Process, stretch: Stretch) -> float:
    """Return the sum of squares of a whitened stretch, its trend taken out."""
    return float(np.sum(stretch.whitened(process, stretch.residual) ** 2))


def _own_level(process: Process, own: Sequence[Stretch]) -> float:
    """Return how many times louder than the pooled noise a run is; 1 where it is so by chance."""
    dof = sum(s.dof for s in own)
    if not dof:
        return 1.0
    factor = math.sqrt(max(sum(_squares(process, s) for s in own) / dof, 1e-12))
    differs = abs(math.log(factor))
    return factor if differs > math.log(DISAGREES) and differs > STANDARD_ERRORS * math.sqrt(0.5 / dof) else 1.0


def resample(process: Process, period: float, to: float) -> Process:
    """Return the process that noise of one sampling period is when sampled with another.

    Its correlation is taken as linear between the lags that are known, which is a correlation, too.
    """
    lags = np.arange(HIGHEST_ORDER + 1) * to / period
    known = np.arange(math.ceil(lags[-1]) + 1)
    correlation = np.interp(lags, known, process.autocorrelation(len(known)))
    return Process.from_covariances(process.rms**2 * correlation)


def _merge(lines: Sequence[Sinusoid]) -> tuple[Sinusoid, ...]:
    """Return lines without those that another sampling period shows again."""
    merged: list[Sinusoid] = []
    for line in sorted(lines, key=lambda line: line.frequency):
        if not merged or line.frequency - merged[-1].frequency > 0.01 * line.frequency:
            merged.append(line)
    return tuple(merged)


def _disagreements(chosen: _Level, levels: Sequence[_Level], stated: float) -> list[str]:
    remark = []
    median = float(np.median([process.rms for process in chosen.processes.values()]))
    for other in levels:
        if other is chosen:
            continue
        factor = float(np.median([process.rms for process in other.processes.values()])) / median
        error = math.sqrt(0.5 / chosen.dof + 0.5 / other.dof)
        if abs(math.log(factor)) > max(math.log(DISAGREES), STANDARD_ERRORS * error):
            why = "; noise grows with motion, or the motion does not repeat itself" if factor > 1 else ""
            remark.append(f"{other.source.words} would give {factor:.2g} times this noise{why}")
    if stated and not 1 / 3 < median / stated < 3:
        remark.append(f"the noise is {median / stated:.2g} times what the sensor is stated to have")
    return remark


def _smallest(runs: Sequence[Run], axis: str) -> float:
    """Return the noise that reading in steps makes at least: the smallest step over the root of 12 (Bennett 1948)."""
    span = max(float(np.nanmax(run.columns[axis]) - np.nanmin(run.columns[axis])) for run in runs)
    size = max(float(np.nanmax(np.abs(run.columns[axis]))) for run in runs)
    grain = max(ROUNDING * span, 1e-15 * size, 1e-30)
    steps = [smallest_step(run.columns[axis], grain) for run in runs if axis not in run.steps]
    steps += [run.noise_gain * run.steps[axis] for run in runs if axis in run.steps]
    return max(min((step for step in steps if step > 0), default=grain), grain) / math.sqrt(12)


def _without_source(runs: Sequence[Run], axis: str, stated: float, smallest: float) -> NoiseFloor:
    if stated > 0:
        levels = {run.name: stated * run.noise_gain for run in runs}
        whitening = ColouredNoise({name: Process.white(level) for name, level in levels.items()})
        return NoiseFloor(whitening, levels, "the sensor's stated noise", known=True, lines=(), dof=math.inf)
    process = Process.white(max(min(_quietest_band(run, axis) for run in runs), smallest))
    levels = {run.name: process.rms for run in runs}
    return NoiseFloor(ColouredNoise(process), levels, "unknown", known=False, lines=(), dof=0.0)


def _quietest_band(run: Run, axis: str) -> float:
    """Return the white noise whose spectrum is as low as that of the response where little is left of the motion.

    Where motion reaches all frequencies, this is too large; where the sensor's low-pass cuts noise off, too small.
    """
    from scipy.signal import welch

    values = run.columns[axis][np.isfinite(run.columns[axis])]
    _, density = welch(values, 1 / run.period, nperseg=min(SEGMENT, max(len(values) // 8, 8)))
    return math.sqrt(float(np.quantile(density[1:], LOWEST)) / (2 * run.period))

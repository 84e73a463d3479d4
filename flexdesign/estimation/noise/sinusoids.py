"""Sinusoids in records that should be quiet, such as mains hum: found against the noise around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.fft import next_fast_len
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc, gammainccinv, gammaincinv

from flexdesign.core.arrays import Array
from flexdesign.estimation.criterion import LEVEL
from flexdesign.estimation.noise.autoregressive import Process, burg
from flexdesign.estimation.noise.restricted_likelihood import HIGHEST_ORDER, Stretch

#: Share of its squares that fading must be worth, or noise that is not quite autoregressive lets a strong sinusoid seem
#: to fade: where the amplitude changes by a sixth either way it is a hundredth.
LEAST_FADING = 0.01
#: Most sinusoids, and most peaks that are tried before each: what has more is no sinusoid with a few harmonics.
MOST_SINUSOIDS = 8
#: A sinusoid turns at least so often in the longest stretch: slower ones are drift, which the trends take out in part.
FEWEST_PERIODS = 6


@dataclass(frozen=True)
class Sinusoid:
    """A sinusoid: frequency [Hz] and amplitude [SI], the root of the mean square over the runs that hold it."""

    frequency: float
    amplitude: float


@dataclass(frozen=True, eq=False)
class _Fit:
    """A fitted sinusoid, what it explains of the whitened squares, and the stretches without it."""

    sinusoid: Sinusoid
    explained: float
    without: tuple[Stretch, ...]


def remove_sinusoids(stretches: Sequence[Stretch], period: float) -> tuple[tuple[Sinusoid, ...], tuple[Stretch, ...]]:
    """Find the sinusoids in quiet stretches, and return the stretches without them.

    A peak that stands out of the median around it is fitted together with a noise process; it is a sinusoid if noise
    exceeds its likelihood ratio less often than `LEVEL`. Within a run it keeps its phase; between runs it has
    any. All stretches have the same sampling period [s].
    """
    found, left = list[Sinusoid](), tuple(stretches)
    while len(found) < MOST_SINUSOIDS:
        tested = (_test_peak(left, peak, period) for peak in _peaks(left, period))
        fit = next((fit for fit in tested if fit is not None), None)
        if fit is None:
            break
        found.append(fit.sinusoid)
        left = fit.without
    return tuple(sorted(found, key=lambda each: each.frequency)), left


def _runs(stretches: Sequence[Stretch]) -> list[list[Stretch]]:
    return [[s for s in stretches if s.run == name] for name in dict.fromkeys(s.run for s in stretches)]


def _peaks(stretches: Sequence[Stretch], period: float) -> list[float]:
    """Return the frequencies that stand out most [Hz], of the periodograms of all runs added up.

    The sum over R runs of noise is distributed as Gamma(R); what it is expected to exceed somewhere is no candidate.
    """
    from scipy.signal import find_peaks

    runs = _runs(stretches)
    begins = [min(s.first for s in run) for run in runs]
    spans = [max(s.first + len(s.values) for s in run) - begin for run, begin in zip(runs, begins, strict=True)]
    length = next_fast_len(4 * max(spans), real=True)
    power = np.zeros(length // 2 + 1)
    for run, begin, span in zip(runs, begins, spans, strict=True):
        record = np.zeros(span)
        for s in run:
            record[s.first - begin : s.first - begin + len(s.values)] = s.residual
        power += np.abs(np.fft.rfft(record, length)) ** 2 / sum(len(s.values) for s in run)
    resolution = length / max(len(s.values) for s in stretches)
    lowest = int(FEWEST_PERIODS * resolution)
    ratio = power / np.maximum(_local_median(power, 2 * lowest), np.finfo(float).tiny)
    median_ratio = gammainccinv(len(runs), 1 / len(power)) / gammaincinv(len(runs), 0.5)
    places = lowest + find_peaks(ratio[lowest:], height=median_ratio, distance=2 * resolution)[0]
    places = places[np.argsort(-ratio[places])][:MOST_SINUSOIDS]
    before, at, after = power[places - 1], power[places], power[places + 1]
    vertices = places + 0.5 * (before - after) / (before - 2 * at + after)  # of parabolas
    return [float(vertex) / (length * period) for vertex in vertices]


def _local_median(power: Array, width: int) -> Array:
    """Return the medians of blocks, interpolated: the middle of the first is the lowest frequency that is looked at."""
    width = min(width, len(power))
    blocks = power[: len(power) // width * width].reshape(-1, width)
    return np.interp(np.arange(len(power)), width * (np.arange(len(blocks)) + 0.5), np.median(blocks, axis=1))


def _test_peak(stretches: Sequence[Stretch], peak: float, period: float) -> _Fit | None:
    """Return the sinusoid at a peak [Hz]; None if noise, or a mode that dies away, explains the peak."""
    frequency = _refine(stretches, peak, period)
    without = _fit(stretches, frequency, period, Process.white(1.0)).without
    process = Process(burg([s.residual for s in without], HIGHEST_ORDER), 1.0)
    squares = sum(float(np.sum(s.whitened(process, s.residual) ** 2)) for s in without)
    if squares == 0:
        return None
    process = replace(process, sigma=float(np.sqrt(squares / sum(s.dof for s in without))))
    fit = _fit(stretches, frequency, period, process)
    dof = 2 * len(_runs(stretches))
    frequencies = max(s.first + len(s.values) for s in stretches) - min(s.first for s in stretches)
    is_noise = chdtrc(dof, max(fit.explained, 0.0)) * frequencies > LEVEL
    fades = _fit(fit.without, frequency, period, process, fading=True).explained
    dies_away = fades > LEAST_FADING * fit.explained and chdtrc(dof, max(fades, 0.0)) < LEVEL
    return None if is_noise or dies_away else fit


def _refine(stretches: Sequence[Stretch], peak: float, period: float) -> float:
    """Return the frequency at which a sinusoid explains most [Hz], within half a resolution of a peak.

    The peak alone is not precise: of a strong sinusoid it would leave a beat, which would seem to fade.
    """
    resolution = 1 / (max(len(s.values) for s in stretches) * period)
    found = minimize_scalar(
        lambda shift: -_fit(stretches, peak + shift * resolution, period, Process.white(1.0)).explained,
        bounds=(-0.5, 0.5),
        method="bounded",
    )
    return float(peak + found.x * resolution)


def _fit(stretches: Sequence[Stretch], frequency: float, period: float, process: Process, fading: bool = False) -> _Fit:
    """Fit a sinusoid in each run by generalised least squares, together with the trends.

    A `fading` one has an amplitude that falls or grows from minus one to one within each stretch.
    """
    explained, without, squares = 0.0, list[Stretch](), list[float]()
    for run in _runs(stretches):
        waves = []
        for s in run:
            angle = 2 * np.pi * frequency * period * (s.first + np.arange(len(s.values)))
            size = np.linspace(-1, 1, len(angle)) if fading else 1.0
            waves.append(np.column_stack([size * np.cos(angle), size * np.sin(angle)]))
        tables = [np.column_stack([wave, s.residual]) for wave, s in zip(waves, run, strict=True)]
        whitened = np.concatenate([s.whitened(process, table) for s, table in zip(run, tables, strict=True)])
        weights = np.linalg.lstsq(whitened[:, :2], whitened[:, 2], rcond=None)[0]
        explained += float(np.sum((whitened[:, :2] @ weights) ** 2))
        squares.append(float(weights @ weights))
        without += [replace(s, values=s.values - wave @ weights) for s, wave in zip(run, waves, strict=True)]
    return _Fit(Sinusoid(frequency, float(np.sqrt(np.mean(squares)))), explained, tuple(without))

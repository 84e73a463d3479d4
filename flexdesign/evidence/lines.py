"""Lines: sinusoids in records that should be quiet, such as mains hum; found against the noise around them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar
from scipy.stats import chi2, gamma

from flexdesign.evidence.coloured import Process
from flexdesign.evidence.quiet import Stretch, burg

Array = NDArray[np.float64]
#: How often quiet noise may show a line, over all frequencies.
FALSE_ALARM = 1e-3
#: A peak that quiet noise reaches more often than this is not looked at.
COMMON = 0.1
#: How often a steady line may seem to fade, and what share of its squares that must be worth: noise that is not quite
#: as it was taken to be lets a strong one seem to. Where the amplitude changes by a sixth either way it is a hundredth.
FADES, FADING = 1e-3, 0.01
#: Most lines that are taken out, and peaks that are tried before each.
MOST, TRIED = 8, 5
#: Width over which the spectrum around a peak is judged, in resolutions of the longest stretch.
AROUND = 24
#: A line's frequency is found to this share of half a resolution.
PRECISE = 1e-4
#: A line turns at least so often in the longest stretch: slower ones are drift.
FEWEST_TURNS = 6


@dataclass(frozen=True)
class Line:
    """A sinusoid: frequency [Hz] and amplitude [SI], the root of the mean square over the runs that hold it."""

    frequency: float
    amplitude: float


def remove(stretches: Sequence[Stretch], period: float) -> tuple[tuple[Line, ...], tuple[Stretch, ...]]:
    """Find the sinusoids in quiet stretches, and return the stretches without them.

    A peak that stands out of the median around it is fitted together with a noise process; it is a line if its
    likelihood ratio is one that noise exceeds, over all frequencies, once in a thousand records. Within a run a line
    keeps its phase; between runs it has any.

    Parameters
    ----------
    stretches
        Quiet stretches of one sampling period.
    period
        The sampling period [s].
    """
    found: list[Line] = []
    left = tuple(stretches)
    while len(found) < MOST:
        for frequency in _peaks(left, period):
            if (taken := _tested(left, frequency, period)) is not None:
                found.append(taken[0])
                left = taken[1]
                break
        else:
            break
    return tuple(sorted(found, key=lambda line: line.frequency)), left


def _runs(stretches: Sequence[Stretch]) -> list[list[Stretch]]:
    return [[s for s in stretches if s.run == name] for name in dict.fromkeys(s.run for s in stretches)]


def _peaks(stretches: Sequence[Stretch], period: float) -> list[float]:
    """Return the frequencies that stand out most [Hz], of the periodograms of all runs added up.

    The sum over R runs of noise is distributed as Gamma(R); what it exceeds often enough is no candidate.
    """
    runs = _runs(stretches)
    spans = [max(s.first + len(s.values) for s in run) - min(s.first for s in run) for run in runs]
    longest = max(len(s.values) for s in stretches)
    length = next_fast_len(4 * max(spans), real=True)
    power = np.zeros(length // 2 + 1)
    for run, span in zip(runs, spans, strict=True):
        record, start = np.zeros(span), min(s.first for s in run)
        for s in run:
            record[s.first - start : s.first - start + len(s.values)] = s.residual
        power += np.abs(np.fft.rfft(record, length)) ** 2 / sum(len(s.values) for s in run)
    width = int(min(AROUND * length / longest, len(power) // 2)) | 1
    ratio = power / np.maximum(_running_median(power, width), 1e-300)
    ratio[: int(FEWEST_TURNS * length / longest) + 1] = 0.0
    ratio[-1] = 0.0
    usual = gamma.isf(COMMON / len(power), len(runs)) / gamma.median(len(runs))
    peaks: list[float] = []
    while len(peaks) < TRIED and ratio[place := int(ratio.argmax())] > usual:
        a, b, c = power[place - 1 : place + 2]
        peaks.append(float(place + 0.5 * (a - c) / (a - 2 * b + c)) / (length * period))  # vertex of a parabola
        near = int(2 * length / longest) + 1
        ratio[max(place - near, 0) : place + near] = 0.0
    return peaks


def _running_median(power: Array, width: int) -> Array:
    """Return the median around each point; of a wide window by blocks, as a long record has a million points."""
    coarse = max(1, width // 64)
    blocks = power[: len(power) // coarse * coarse].reshape(-1, coarse).mean(axis=1)
    medians = median_filter(blocks, max(width // coarse, 3) | 1, mode="reflect")
    return np.asarray(np.interp(np.arange(len(power)), (np.arange(len(blocks)) + 0.5) * coarse - 0.5, medians))


def _tested(stretches: Sequence[Stretch], frequency: float, period: float) -> tuple[Line, tuple[Stretch, ...]] | None:
    """Return the line at a frequency and the stretches without it; None if noise explains the peak."""
    span = max(s.first + len(s.values) for s in stretches) - min(s.first for s in stretches)
    frequency = _refined(stretches, frequency, period)
    _, without, _ = _explained(stretches, frequency, period, Process(np.zeros(0), 1.0))
    reflections = burg([s.residual for s in without])
    unit = Process(reflections, 1.0)
    whitened = np.concatenate([unit.whiten(s.residual[:, None])[:, 0] for s in without])
    sigma = float(np.sqrt(whitened @ whitened / sum(s.freedom for s in without)))
    if not sigma > 0:
        return None
    process = Process(reflections, sigma)
    gain, without, amplitude = _explained(stretches, frequency, period, process)
    if chi2.sf(gain, 2 * len(_runs(stretches))) * span > FALSE_ALARM:
        return None
    fades, _, _ = _explained(without, frequency, period, process, fading=True)
    if fades > FADING * gain and chi2.sf(fades, 2 * len(_runs(stretches))) < FADES:
        return None  # what dies away is a mode that still rings
    return Line(frequency, amplitude), without


def _refined(stretches: Sequence[Stretch], frequency: float, period: float) -> float:
    """Return the frequency at which a sinusoid explains most, within a resolution of a peak of the periodogram.

    The peak is known to a share of the resolution only: of a strong line that leaves a beat, which would seem to fade.
    """
    reach = 0.5 / (max(len(s.values) for s in stretches) * period)
    white = Process(np.zeros(0), 1.0)
    found = minimize_scalar(
        lambda at: -_explained(stretches, at, period, white)[0],
        bounds=(frequency - reach, frequency + reach),
        method="bounded",
        options={"xatol": PRECISE * reach},
    )
    return float(found.x)


def _explained(
    stretches: Sequence[Stretch], frequency: float, period: float, process: Process, fading: bool = False
) -> tuple[float, tuple[Stretch, ...], float]:
    """Return what a sinusoid in each run explains of the whitened squares, the stretches without it, its amplitude.

    A `fading` one has an amplitude that falls or grows from minus one to one within each stretch.
    """
    gain, without, squares = 0.0, [], []
    for run in _runs(stretches):
        waves, values, columns = [], [], []
        for s in run:
            angle = 2 * np.pi * frequency * period * (s.first + np.arange(len(s.values)))
            size = np.linspace(-1, 1, len(angle)) if fading else 1.0
            wave = np.column_stack([size * np.cos(angle), size * np.sin(angle)])
            together = process.whiten(np.column_stack([s.trend, wave, s.residual]))
            basis = np.linalg.qr(together[:, : s.trend.shape[1]])[0]
            free = together[:, s.trend.shape[1] :]
            free = free - basis @ (basis.T @ free)
            waves.append(wave)
            columns.append(free[:, :2])
            values.append(free[:, 2])
        stacked, value = np.concatenate(columns), np.concatenate(values)
        weights = np.linalg.lstsq(stacked, value, rcond=None)[0]
        gain += float(np.sum((stacked @ weights) ** 2))
        squares.append(float(weights @ weights))
        without += [replace(s, values=s.values - wave @ weights) for s, wave in zip(run, waves, strict=True)]
    return gain, tuple(without), float(np.sqrt(np.mean(squares)))

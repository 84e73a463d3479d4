"""Spectra of recordings: oversampled runs, and frequencies at which something unknown may act.

*Oversampling.* A simulation takes a step or more in every sample, so that the time of a diagnosis grows with the
sampling rate. The band that matters is that in which the response follows its command. It is found from the coherence:
the coherent power above the band is negligible.

*Modes and periodic disturbances.* A lightly damped mode is narrower than the grid of the catalogue, so that no fit that
starts from the grid comes to it: peaks of what a calibrated model does not predict are tried (peak picking). A quiet
record shows mains hum or a floor that moves, unless there is none, or readings come in steps so coarse that they hide a
sinusoid or show its harmonics instead. The residual of records in motion is rounded at ever other places.

Spectra are averaged over segments of records (Welch 1967).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array, Complex
from flexdesign.diagnosis.preparation.dataset import SAMPLES_SEARCHED, DiagnosisData
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.estimation.criterion import LEVEL
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.noise.autoregressive import stretches
from flexdesign.estimation.noise.quiet_stretches import Stretch, remove_sinusoids
from flexdesign.measurements.recordings import Run
from flexdesign.measurements.recordings.run import commanded_by

#: Number of frequencies at which modes are tried: the highest peaks of a residual, or points of a band.
FREQUENCIES_TRIED = 10
#: The longest record is split into this number of segments: fewer leave the spectrum noisy, more make peaks wide.
SEGMENTS = 4
#: Fewest samples in a period of the highest frequency that matters; fewer distort a sine. A segment has two periods.
FEWEST_PER_PERIOD = 8


# --- oversampling ----------------------------------------------------------------------------------------------------


def oversampling_of(runs: Sequence[Run], axis: str, negligible: float) -> tuple[str, str] | None:
    """Return by how much the runs of an axis are oversampled, and the remedy, each a sentence without its full stop.

    None if they are not oversampled, are few, or are decimated already. A run no longer than a segment of the longest
    has no say: all motion in it seems as fast as its lines are wide.

    Parameters
    ----------
    runs
        As they were recorded.
    axis
        Name of the response.
    negligible
        What counts as nothing, rms [response].
    """
    there = [run for run in runs if axis in run.columns]
    samples, rates = sum(len(run.time) for run in there), [1 / run.period for run in there]
    if samples <= SAMPLES_SEARCHED or any(run.noise_gain != 1 for run in there):
        return None
    longest = max(len(run.time) for run in there)
    factors = [_factor(run, axis, negligible) for run in there if SEGMENTS * len(run.time) >= longest]
    if (factor := min((factor for factor in factors if factor), default=1)) < 2:
        return None
    band = units.hertz(min(rates) / (FEWEST_PER_PERIOD * factor), 3)
    return (
        f"{axis} follows its command up to about {band} and is sampled at {units.hertz(max(rates), 5)}",
        f"write decimate = {factor} in measurements.toml: one sample in {factor}, behind a low-pass, shows the same "
        f"motion, and a diagnosis of {samples // factor} samples is about {factor} times as fast",
    )


def _factor(run: Run, axis: str, negligible: float) -> int | None:
    """Return the decimation factor of a run; None if its command is constant or nothing follows it."""
    column, values = commanded_by(axis, run.columns), run.columns[axis]
    there = np.isfinite(values)
    if column is None or not np.ptp(run.columns[column]) or not there.any():
        return None
    filled = np.interp(np.arange(len(values)), np.flatnonzero(there), values[there])
    if not (length := _segment_length(len(values))):
        return 1
    spectra = cross_spectra([(run.columns[column], filled - filled.mean())], run.period, length)
    related = spectra.coherence > spectra.exceeded_by_chance(LEVEL)
    power = np.where(related, spectra.coherent_power, 0.0) * spectra.frequencies[1]
    above = np.cumsum(power[::-1])[::-1]
    matters = np.flatnonzero(above > negligible**2)
    if not len(matters):
        return None
    highest = float(spectra.frequencies[matters[-1]]) + float(spectra.frequencies[1])
    return max(1, math.floor(1 / (run.period * FEWEST_PER_PERIOD * highest)))


def _segment_length(samples: int) -> int:
    """Return the number of samples in a segment of a record; zero if the record is too short for a spectrum."""
    length = samples // SEGMENTS
    return length if length >= 2 * FEWEST_PER_PERIOD else 0


# --- frequencies of modes and lines -----------------------------------------------------------------------------------


def mode_frequencies(data: DiagnosisData, fit: FittedModel) -> tuple[float, ...]:
    """Return the frequencies [Hz] of the highest peaks of the residual of runs, or else of frequency responses."""
    found = _of_runs(data, fit) if data.runs else _of_responses(data, fit)
    return tuple(frequency for _, frequency in sorted(found, reverse=True)[:FREQUENCIES_TRIED])


def _of_runs(data: DiagnosisData, fit: FittedModel) -> list[tuple[float, float]]:
    """Return prominence and frequency [Hz] of the peaks of what in the residual follows the command linearly.

    Runs that are sampled as the longest one is are averaged.
    """
    from scipy.signal import find_peaks

    runs, model = data.of("identify"), cast(AxisDynamics, fit.model)
    longest = max(runs, key=lambda run: len(run.time))
    if not (length := _segment_length(len(longest.time))):
        return []
    alike = [run for run in runs if abs(run.period / longest.period - 1) < 1e-6 and len(run.time) >= length]
    pairs = [(model.command(run), fit.residuals_by_run[run.name]) for run in alike]
    spectra = cross_spectra(pairs, longest.period, length)
    places, about = find_peaks(spectra.coherent_power, prominence=0.0)
    return list(zip(about["prominences"].tolist(), spectra.frequencies[places].tolist(), strict=True))


def _of_responses(data: DiagnosisData, fit: FittedModel) -> list[tuple[float, float]]:
    """Return prominence and frequency [Hz] of the peaks of the residual over what is predicted.

    Away from a resonance, where the response is small, the residual also exceeds the noise.
    """
    from scipy.signal import find_peaks

    found = list[tuple[float, float]]()
    for each in data.responses:
        if each.role == "identify":
            left = np.hypot(*fit.residuals_by_run[each.name].reshape(2, -1)[:, each.present])
            predicted = np.hypot(*(each.measured() - fit.residuals_by_run[each.name]).reshape(2, -1)[:, each.present])
            places, about = find_peaks(left / predicted, prominence=0.0)
            there = each.frequencies[each.present][places]
            found += zip(about["prominences"].tolist(), there.tolist(), strict=True)
    return found


def line_frequencies(data: DiagnosisData, fit: FittedModel) -> tuple[float, ...]:
    """Return the frequencies of lines [Hz]: those of quiet records, and of residuals where these show nothing."""
    seen = tuple(line.frequency for line in data.noise.lines)
    if data.noise.known and data.coarse_step is None:
        return seen
    periods = {run.name: run.period for run in data.of("identify")}
    found = set(seen)
    for period in sorted(set(periods.values())):
        parts = [_longest(name, fit.residuals_by_run[name]) for name, own in periods.items() if own == period]
        long = [part for part in parts if _segment_length(len(part.values)) and np.ptp(part.values) > 0]
        if long:
            found |= {line.frequency for line in remove_sinusoids(long, period)[0]}
    return tuple(sorted(found))


def _longest(name: str, remainder: np.ndarray) -> Stretch:
    """Return the longest part of a remainder without gaps, which may drift."""
    present = stretches(np.isfinite(remainder))
    first, last = max(present, key=lambda stretch: stretch[1] - stretch[0], default=(0, 0))
    straight = np.column_stack([np.ones(last - first), np.linspace(-1, 1, last - first)])
    return Stretch(name, first, remainder[first:last], np.linalg.qr(straight)[0])


# --- spectra ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class CrossSpectra:
    """Averaged spectra of a command and of a signal.

    Parameters
    ----------
    frequencies
        n of them [Hz].
    command, signal
        Their power densities, n values each.
    across
        Density of their cross spectrum, n complex values.
    segments
        Number of segments that were averaged.
    """

    frequencies: Array
    command: Array
    signal: Array
    across: Complex
    segments: int

    @property
    def coherence(self) -> Array:
        """The share of the signal that follows the command linearly, n values; NaN where the command has no power."""
        product = np.maximum(self.command * self.signal, 1e-300)
        return np.where(self.command > 1e-9 * self.command.max(), np.abs(self.across) ** 2 / product, np.nan)

    @property
    def coherent_power(self) -> Array:
        """The density of what in the signal follows the command, n values; 0 where the command has no power."""
        return np.asarray(np.nan_to_num(self.coherence) * self.signal)

    def exceeded_by_chance(self, probability: float) -> float:
        """Return the coherence that unrelated signals exceed with a probability (Carter, Knapp and Nuttall 1973)."""
        return float(1 - probability ** (1 / max(self.segments - 1, 1)))


def cross_spectra(pairs: Sequence[tuple[Array, Array]], period: float, length: int) -> CrossSpectra:
    """Return the spectra of commands and signals, averaged over all segments of all records.

    Parameters
    ----------
    pairs
        Command and signal of each record, at least `length` values each; gaps of the signal are NaN, and count as zero.
    period
        Of the samples of all records [s].
    length
        Samples of a segment; half of them are in the next one, too.
    """
    from scipy.signal import csd

    total, segments, frequencies = np.zeros((3, length // 2 + 1), dtype=complex), 0, np.zeros(0)
    for command, signal in pairs:
        u, s = command - command.mean(), np.nan_to_num(signal)
        count = max((len(u) - length // 2) // (length - length // 2), 1)
        for row, (a, b) in enumerate(((u, u), (s, s), (u, s))):
            frequencies, density = csd(a, b, fs=1 / period, nperseg=length)
            total[row] += count * density
        segments += count
    return CrossSpectra(frequencies, total[0].real / segments, total[1].real / segments, total[2] / segments, segments)

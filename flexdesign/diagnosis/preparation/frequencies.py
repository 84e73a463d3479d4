"""Frequencies at which something unknown may act: further modes, and periodic disturbances.

A lightly damped mode is narrower than the grid of the catalogue, so that no fit that starts from the grid comes to it:
peaks of what a calibrated model does not predict are tried (peak picking). A quiet record shows mains hum or a floor
that moves, unless there is none, or readings come in steps so coarse that they hide a sinusoid or show its harmonics
instead. The residual of records in motion is rounded at ever other places.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.noise.autoregressive import stretches
from flexdesign.estimation.noise.cross_spectra import cross_spectra
from flexdesign.estimation.noise.restricted_likelihood import Stretch
from flexdesign.estimation.noise.sinusoids import remove_sinusoids

#: Number of peaks at which modes are tried.
PEAKS_TRIED = 6
#: The longest record is split into this number of segments: fewer leave the spectrum noisy, more make peaks wide. A
#: segment has at least this number of samples.
SEGMENTS, SHORTEST_SEGMENT = 4, 16
#: A line in the residual is sought in records of at least this number of samples without a gap.
FEWEST_SAMPLES = 200


def mode_frequencies(data: DiagnosisData, fit: FittedModel) -> tuple[float, ...]:
    """Return the frequencies [Hz] of the highest peaks of the residual of runs, or else of frequency responses."""
    found = _of_runs(data, fit) if data.runs else _of_responses(data, fit)
    return tuple(frequency for _, frequency in sorted(found, reverse=True)[:PEAKS_TRIED])


def _of_runs(data: DiagnosisData, fit: FittedModel) -> list[tuple[float, float]]:
    """Return prominence and frequency [Hz] of the peaks of what in the residual follows the command linearly.

    Runs that are sampled as the longest one is are averaged.
    """
    from scipy.signal import find_peaks

    runs, model = data.of("identify"), cast(AxisDynamics, fit.model)
    longest = max(runs, key=lambda run: len(run.time))
    if (length := len(longest.time) // SEGMENTS) < SHORTEST_SEGMENT:
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
        long = [part for part in parts if len(part.values) >= FEWEST_SAMPLES and np.ptp(part.values) > 0]
        if long:
            found |= {line.frequency for line in remove_sinusoids(long, period)[0]}
    return tuple(sorted(found))


def _longest(name: str, remainder: np.ndarray) -> Stretch:
    """Return the longest part of a remainder without gaps, which may drift."""
    present = stretches(np.isfinite(remainder))
    first, last = max(present, key=lambda stretch: stretch[1] - stretch[0], default=(0, 0))
    straight = np.column_stack([np.ones(last - first), np.linspace(-1, 1, last - first)])
    return Stretch(name, first, remainder[first:last], np.linalg.qr(straight)[0])

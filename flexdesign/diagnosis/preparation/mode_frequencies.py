"""Frequencies at which a further mode may be: peaks of what a calibrated model does not predict (peak picking).

A lightly damped mode is narrower than the grid of the catalogue, so that no fit that starts from the grid comes to it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.noise.cross_spectra import cross_spectra

if TYPE_CHECKING:
    from flexdesign.diagnosis.preparation.dataset import DiagnosisData

#: Number of peaks at which modes are tried.
PEAKS_TRIED = 6
#: The longest record is split into this number of segments: fewer leave the spectrum noisy, more make peaks wide. A
#: segment has at least this number of samples.
SEGMENTS, FEWEST_SAMPLES = 4, 16


def peaks(data: DiagnosisData, fit: FittedModel) -> tuple[float, ...]:
    """Return the frequencies [Hz] of the highest peaks of the residual, those of runs or else of frequency responses.

    Parameters
    ----------
    data
        What is diagnosed.
    fit
        The calibrated model, without effects.
    """
    found = _of_runs(data, fit) if data.runs else _of_responses(data, fit)
    return tuple(frequency for _, frequency in sorted(found, reverse=True)[:PEAKS_TRIED])


def _of_runs(data: DiagnosisData, fit: FittedModel) -> list[tuple[float, float]]:
    """Return prominence and frequency [Hz] of the peaks of what in the residual follows the command linearly.

    Runs that are sampled as the longest one is are averaged.
    """
    from scipy.signal import find_peaks

    runs, model = data.of("identify"), cast(AxisDynamics, fit.model)
    longest = max(runs, key=lambda run: len(run.time))
    if (length := len(longest.time) // SEGMENTS) < FEWEST_SAMPLES:
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

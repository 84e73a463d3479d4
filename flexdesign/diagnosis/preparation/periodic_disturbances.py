"""Frequencies at which something periodic may act: seen in quiet records, or in what a calibrated model leaves.

A quiet record shows mains hum or a floor that moves, unless there is none, or readings come in steps so coarse that
they hide a sinusoid or show its harmonics instead. The residual of records in motion is rounded at ever other places.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.noise.restricted_likelihood import Stretch
from flexdesign.estimation.noise.sinusoids import remove_sinusoids
from flexdesign.estimation.noise.whitening import stretches

if TYPE_CHECKING:
    from flexdesign.diagnosis.preparation.dataset import DiagnosisData

#: A line in the residual is sought in records of at least this number of samples without a gap.
FEWEST_SAMPLES = 200


def frequencies(data: DiagnosisData, fit: FittedModel) -> tuple[float, ...]:
    """Return the frequencies of lines [Hz]: those of quiet records, and those of remainders where these show nothing.

    Parameters
    ----------
    data
        What is diagnosed.
    fit
        The calibrated model, without effects.
    """
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

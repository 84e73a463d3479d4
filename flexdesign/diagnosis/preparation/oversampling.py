"""Oversampled runs, and the factor by which they may be decimated.

A simulation takes a step or more in every sample, so that the time of a diagnosis grows with the sampling rate. The
band that matters is that in which the response follows its command. It is found from the coherence: the coherent power
above the band is negligible.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexdesign.core import units
from flexdesign.diagnosis.preparation.dataset import SAMPLES_SEARCHED
from flexdesign.diagnosis.preparation.frequencies import cross_spectra
from flexdesign.measurements.recordings import Run
from flexdesign.measurements.recordings.run import commanded_by

#: Fewest samples in a period of the highest frequency that matters; fewer distort a sine.
FEWEST_PER_PERIOD = 8
#: Number of segments of a run, with an overlap of one half; and the probability that unrelated signals seem coherent at
#: one frequency.
SEGMENTS, CHANCE = 8, 1e-3
#: A run is short if the longest has more than this many times its samples.
SHORT = 10


@dataclass(frozen=True)
class Oversampling:
    """The statement that runs are oversampled.

    Parameters
    ----------
    what, remedy
        The finding and the remedy, each a sentence without its full stop.
    """

    what: str
    remedy: str


def oversampling_of(runs: Sequence[Run], axis: str, negligible: float) -> Oversampling | None:
    """Return how far the runs of an axis are oversampled; None if they are not, are short, or decimated already.

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
    if any(run.noise_gain != 1 for run in there):
        return None
    samples, rates = sum(len(run.time) for run in there), [1 / run.period for run in there]
    if samples <= SAMPLES_SEARCHED or (factor := decimation_factor(there, axis, negligible)) < 2:
        return None
    band = units.hertz(min(rates) / (FEWEST_PER_PERIOD * factor), 3)
    what = f"{axis} follows its command up to about {band} and is sampled at {units.hertz(max(rates), 5)}"
    remedy = (
        f"write decimate = {factor} in measurements.toml: one sample in {factor}, behind a low-pass, shows the same "
        f"motion, and a diagnosis of {samples // factor} samples is about {factor} times as fast"
    )
    return Oversampling(what, remedy)


def decimation_factor(runs: Sequence[Run], axis: str, negligible: float) -> int:
    """Return the common decimation factor of runs; 1 if they are not oversampled; see `oversampling_of`.

    A short run among longer ones has no say: all motion in it seems as fast as the width of its spectral lines.
    """
    longest = max((len(run.time) for run in runs), default=0)
    factors = [_factor(run, axis, negligible) for run in runs if SHORT * len(run.time) >= longest]
    return min((factor for factor in factors if factor), default=1)


def _factor(run: Run, axis: str, negligible: float) -> int | None:
    """Return the decimation factor of a run; None if its command is constant or nothing follows it."""
    column, values = commanded_by(axis, run.columns), run.columns[axis]
    there = np.isfinite(values)
    if column is None or not np.ptp(run.columns[column]) or not there.any():
        return None
    filled = np.interp(np.arange(len(values)), np.flatnonzero(there), values[there])
    length = len(values) // SEGMENTS
    if length < 2 * FEWEST_PER_PERIOD:
        return 1
    spectra = cross_spectra([(run.columns[column], filled - filled.mean())], run.period, length)
    related = spectra.coherence > spectra.exceeded_by_chance(CHANCE)
    power = np.where(related, spectra.coherent_power, 0.0) * spectra.frequencies[1]
    above = np.cumsum(power[::-1])[::-1]
    matters = np.flatnonzero(above > negligible**2)
    if not len(matters):
        return None
    highest = float(spectra.frequencies[matters[-1]]) + float(spectra.frequencies[1])
    return max(1, math.floor(1 / (run.period * FEWEST_PER_PERIOD * highest)))

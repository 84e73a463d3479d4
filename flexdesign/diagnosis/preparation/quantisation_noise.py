"""Readings in coarse steps: rounding is no white noise in slow motion, and a fit would see effects in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from flexdesign.measurements.recordings import Run

#: Samples of its past that rounding is predicted from; and how often it is drawn, with another noise beneath each time.
PREDICTION_ORDER, NOISE_DRAWS = 12, 4
#: Noise of a sensor whose steps hide it is no more than this share of a step.
HIDDEN_NOISE = 0.3
#: Steps of a reading are coarse where they are this many times the noise, which rounding alone makes 0.29 of them; and
#: real where readings take no more levels than this share of their number, each within this share of a step.
COARSE_STEP, MOST_LEVELS, GRID_TOLERANCE = 1.2, 0.5, 0.05


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
    if step <= max(COARSE_STEP * noise, 2 * resolution) or len(levels) > MOST_LEVELS * len(readings):
        return None
    counts = np.round(gaps / step)
    if np.abs(gaps / step - counts).max() > GRID_TOLERANCE:
        return None
    # The levels lie on a line whose slope is the step, which a file that rounds its readings shows no gap of.
    return float(np.polyfit(np.concatenate([[0.0], np.cumsum(counts)]), levels, 1)[0])


def add_rounding(
    runs: Mapping[str, Run], noise: ColouredNoise, residuals: Mapping[str, Array], step: float
) -> ColouredNoise:
    """Return noise with the rounding that the predicted motion goes through, run by run.

    Parameters
    ----------
    runs
        By name.
    noise
        As it was found in the readings; of a sensor with coarse steps most of it is rounding.
    residuals
        Measured less predicted of each run, by name [response].
    step
        Of the readings [response].
    """
    rng, processes = np.random.default_rng(0), dict[str, Process]()
    for name, run in runs.items():
        beneath, errors = min(noise.process(name).rms, HIDDEN_NOISE * step), list[Array]()
        for _ in range(NOISE_DRAWS):
            # Where the grid lies beneath an unknown offset is drawn, too.
            disturbed = run.measured() - residuals[name] + rng.uniform(0, step)
            noisy = disturbed + beneath * rng.standard_normal(len(disturbed))
            error = step * np.round(noisy / step) - disturbed
            errors.append(error[np.isfinite(error)])
        processes[name] = _process(errors)
    return ColouredNoise(processes)


def _process(realisations: list[Array]) -> Process:
    """Return the autoregressive process with the correlations of some records, and the innovations that they show."""
    count = sum(len(record) for record in realisations)
    mean = sum(float(record.sum()) for record in realisations) / count
    centred = [record - mean for record in realisations]
    lags = [sum(float(e[k:] @ e[: len(e) - k]) for e in centred) / count for k in range(PREDICTION_ORDER + 1)]
    process = Process.from_covariances(np.array(lags))
    innovations = np.concatenate([process.whiten(e[:, None])[PREDICTION_ORDER:] for e in centred])
    return replace(process, sigma=process.sigma * float(np.sqrt(np.mean(innovations**2))))

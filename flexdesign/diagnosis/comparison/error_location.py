"""Where a model fails: what residuals have above the noise floor, by run, frequency and operating region."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from flexdesign.core.arrays import Array, Places
from flexdesign.estimation.criterion import SHARE
from flexdesign.measurements.noise_level import NoiseFloor
from flexdesign.measurements.recordings import Run
from flexdesign.measurements.recordings.command_segments import steps

#: Regions of position and of voltage.
REGIONS = 5


@dataclass(frozen=True)
class Part:
    """One run, band or region, and what of the unexplained error it holds.

    Parameters
    ----------
    label
        What it is called; empty where the limits say it.
    lower, upper
        Its limits, SI; NaN where it has none.
    share
        Of the unexplained error, 0 to 1; all zero where nothing is above the noise floor.
    weight
        Of the samples, each run counting the same, or of the frequencies; 0 to 1.
    rms
        Of the residual in it [response].
    """

    label: str
    lower: float
    upper: float
    share: float
    weight: float
    rms: float


@dataclass(frozen=True)
class Breakdown:
    """The unexplained error, divided by one thing; the shares sum to one.

    Parameters
    ----------
    by
        run, frequency, position, velocity, voltage, or time since the last step.
    si
        SI unit of the limits; empty if there are none.
    parts
        In their order.
    covers
        Share of the unexplained error that was divided: after steps, that of samples under a command that has jumped
        and stands still.
    """

    by: str
    si: str
    parts: tuple[Part, ...]
    covers: float = 1.0

    @property
    def concentrated(self) -> tuple[Part, ...]:
        """The parts that hold more of the error than of the samples, but for traces of it."""
        return tuple(p for p in self.parts if p.share > max(p.weight, SHARE))

    @property
    def contrast(self) -> float:
        """How unevenly the error lies, 0 to 1: what these parts hold beyond their weight (total variation)."""
        return sum(p.share - p.weight for p in self.concentrated)

    def dominant(self) -> tuple[Part, ...]:
        """Return the fewest neighbours that hold more than half of the error; none where there is no error."""
        every = [self.parts[a:b] for a in range(len(self.parts)) for b in range(a + 1, len(self.parts) + 1)]
        held = {parts: sum(part.share for part in parts) for parts in every}
        return min((p for p in every if 2 * held[p] > 1), key=lambda p: (len(p), -held[p]), default=())


def parts_of(
    place: Places,
    limits: Sequence[tuple[float, float]],
    squares: Array,
    noise: Array,
    weight: Array,
    labels: Sequence[str] = (),
) -> tuple[Part, ...]:
    """Return the parts to which the squares of an error belong, their shares summing to one.

    Within a part, noise is subtracted from the sum of squares, and what falls below zero counts as none.

    Parameters
    ----------
    place
        Index of the part to which each of n squares belongs.
    limits, labels
        Of each part; without labels the limits say what it is.
    squares, noise, weight
        n values each: weighted squares of the error, what noise gives of them, and their weights.
    """
    total, floor, weights = (np.bincount(place, each, len(limits)) for each in (squares, noise, weight))
    excess = np.maximum(total - floor, 0.0)
    rms = np.sqrt(total / np.where(weights > 0, weights, 1.0))
    shares, weights = excess / (excess.sum() or 1.0), weights / (weights.sum() or 1.0)
    numbers = zip(labels or [""] * len(limits), limits, shares.tolist(), weights.tolist(), rms.tolist(), strict=True)
    return tuple(Part(label, *ends, share, of_all, size) for label, ends, share, of_all, size in numbers)


def where(
    residuals: Mapping[str, Array], runs: Sequence[Run], predictions: Mapping[str, Array], noise_floor: NoiseFloor
) -> tuple[Breakdown, ...]:
    """Divide the unexplained error: the mean square above the noise floor, summed over runs.

    A run counts by its mean square, however long it is.

    Parameters
    ----------
    residuals
        Measured less predicted of each run, its offset taken out [response]; NaN at gaps.
    runs
        What was compared; each with one command and one response.
    predictions
        Predicted responses [response], from which position and velocity are taken: they hold no noise.
    noise_floor
        Of these runs.

    Returns
    -------
    tuple of Breakdown
        By run, frequency, position, velocity and voltage; and by time since the last step where a command jumps.
    """
    each = [_samples(run, residuals[run.name], predictions[run.name], noise_floor.rms[run.name]) for run in runs]
    number = np.repeat(np.arange(len(runs)), [samples.shape[1] for samples in each])
    squares, noise, weight, position, velocity, command, since = np.concatenate(each, axis=1)

    def between(values: Array, edges: Sequence[float], labels: Sequence[str] = ()) -> tuple[Part, ...]:
        there = np.isfinite(values)
        place, limits = np.digitize(values[there], edges[1:-1]), [*pairwise(edges)]
        return parts_of(place, limits, squares[there], noise[there], weight[there], labels)

    def in_regions(values: Array) -> tuple[Part, ...]:
        return between(values, np.linspace(values.min(), values.max(), REGIONS + 1).tolist())

    response = runs[0].si[runs[0].responses[0]] if len(runs[0].responses) == 1 else "m"
    # The stage rests below the speed of a ramp over the longest run, and is fast above the geometric mean of this and
    # its highest speed.
    most = float(np.abs(velocity).max())
    slow = min(float(np.ptp(position)) / max(run.time[-1] - run.time[0] for run in runs), most)
    fast = math.sqrt(slow * most)
    motions = ["down fast", "down slowly", "at rest", "up slowly", "up fast"]
    nowhere = [(math.nan, math.nan)] * len(runs)
    made = [
        Breakdown("run", "", parts_of(number, nowhere, squares, noise, weight, [run.name for run in runs])),
        _by_frequency(residuals, runs, noise_floor),
        Breakdown("position", response, in_regions(position)),
        Breakdown("velocity", f"{response}/s", between(velocity, [-most, -fast, -slow, slow, fast, most], motions)),
        Breakdown("voltage", "V", in_regions(command)),
    ]
    if (after := np.isfinite(since)).any():
        first, last = (math.log10(value) for value in (min(run.period for run in runs), since[after].max()))
        decades = range(math.floor(first) + 1, max(math.ceil(last - 1e-9), math.floor(first) + 2) + 1)
        excess, total = float((squares - noise)[after].sum()), float((squares - noise).sum())
        covers = min(max(excess / total, 0.0), 1.0) if total > 0 else 0.0
        parts = between(since, [0.0, *(10.0**k for k in decades)])
        made.append(Breakdown("time since the last step", "s", parts, covers))
    return tuple(made)


def _samples(run: Run, residual: Array, prediction: Array, noise: float) -> Array:
    """Return what is known of each sample of a run that was compared.

    The square of its residual, that of the noise, and its weight, for a mean over the run; then position, velocity,
    command, and the time since the last step (NaN if none).
    """
    seen, command, since = np.isfinite(residual), run.command(), np.full(len(residual), np.nan)
    for first, last, _ in steps(command):
        since[first:last] = run.period * np.arange(last - first)
    weight = 1 / max(int(seen.sum()), 1)
    squares = weight * residual**2, weight * noise**2, weight
    state = prediction, np.gradient(prediction, run.period), command, since
    return np.stack(np.broadcast_arrays(*squares, *state))[:, seen]


def _by_frequency(residuals: Mapping[str, Array], runs: Sequence[Run], noise_floor: NoiseFloor) -> Breakdown:
    """Divide by octaves, see `octaves`."""
    from scipy.signal import periodogram

    edges = octaves(0.0, max(0.5 / run.period for run in runs))
    lines = []
    for run in runs:
        residual, count = residuals[run.name], len(run.time)
        frequency, power = periodogram(np.nan_to_num(residual), 1 / run.period, detrend=False, scaling="spectrum")
        noise = noise_floor.density(run, frequency) / (count * run.period)
        noise[0] = 0.0  # the offset is taken out
        seen = max(int(np.isfinite(residual).sum()), 1)
        lines.append([frequency, power * count / seen, noise, np.full(len(frequency), 1 / len(frequency))])
    frequency, power, noise, weight = np.concatenate(lines, axis=1)
    parts = parts_of(np.digitize(frequency, edges[1:-1]), [*pairwise(edges)], power, noise, weight)
    # The rms of a band is its part of the rms of all.
    return Breakdown("frequency", "Hz", tuple(replace(p, rms=p.rms * math.sqrt(p.weight)) for p in parts))


def octaves(lowest: float, highest: float) -> list[float]:
    """Return the edges of octaves around 1, 2, 4 Hz and so on: the middle of a band is a round number.

    >>> octaves(0.0, 3.5)
    [0.0, 0.7071067811865476, 1.4142135623730951, 2.8284271247461903, 3.5]
    """
    centres = range(math.floor(math.log2(lowest or 1.0)), max(math.ceil(math.log2(highest)), 0) + 2)
    return [lowest, *(edge for k in centres if lowest < (edge := 2.0 ** (k - 0.5)) < highest), highest]

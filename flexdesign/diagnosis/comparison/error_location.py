"""Where a model fails: what residuals have above the noise floor, by run, frequency and operating region."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexdesign.core.arrays import Array, Flags
from flexdesign.measurements.noise_level import NoiseFloor
from flexdesign.measurements.recordings import Run

#: Regions of position and of voltage.
REGIONS = 5
#: Speeds, as shares of the largest: below the first the stage rests, above the second it is fast.
SPEED_AT_REST, FAST_SPEED = 0.01, 0.25
#: The largest speed is this quantile of all: single samples do not count.
SPEED_QUANTILE = 0.98
#: A command makes a step if it jumps by this share of its span between two samples, and then stays for this number of
#: samples within this share.
STEP_JUMP, STEP_SAMPLES, STEP_STILL = 0.05, 20, 5e-3
#: Parts next to each other that hold this share together are where the error mostly is.
DOMINANT_SHARE = 0.6
#: A part with less of the error than this is not worth a word.
NEGLIGIBLE_SHARE = 0.02


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
        Of the samples, each run counting the same, or of the frequency range; 0 to 1.
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
        return tuple(p for p in self.parts if p.share > max(p.weight, NEGLIGIBLE_SHARE))

    @property
    def contrast(self) -> float:
        """How unevenly the error lies, 0 to 1: what these parts hold beyond their weight (total variation)."""
        return sum(p.share - p.weight for p in self.concentrated)

    def dominant(self) -> tuple[Part, ...]:
        """Return the fewest neighbours that hold most of the error; none where there is no error."""
        ends = [(a, b) for a in range(len(self.parts)) for b in range(a + 1, len(self.parts) + 1)]
        held = {(a, b): sum(p.share for p in self.parts[a:b]) for a, b in ends}
        enough = [ab for ab in ends if held[ab] >= DOMINANT_SHARE]
        if not enough:
            return ()
        first, last = min(enough, key=lambda ab: (ab[1] - ab[0], -held[ab]))
        return self.parts[first:last]


def where(
    residuals: Mapping[str, Array], runs: Sequence[Run], predictions: Mapping[str, Array], noise_floor: NoiseFloor
) -> tuple[Breakdown, ...]:
    """Divide the unexplained error: the mean square above the noise floor, summed over runs.

    A run counts by its mean square, however long it is. Within a part, noise is subtracted from the sum of squares,
    and what falls below zero counts as none.

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
    samples = [_Samples.of(run, residuals[run.name], predictions[run.name], noise_floor) for run in runs]
    total = sum(s.excess(s.present) for s in samples)
    response = runs[0].si[runs[0].responses[0]] if len(runs[0].responses) == 1 else "m"
    made = [_by_run(samples), _by_frequency(samples, noise_floor)]
    made.append(Breakdown("position", response, _in_regions(samples, [s.position for s in samples])))
    made.append(_by_velocity(samples, response))
    made.append(Breakdown("voltage", "V", _in_regions(samples, [s.command for s in samples])))
    if any(s.since.size and np.isfinite(s.since).any() for s in samples):
        made.append(_by_time_since_step(samples, total))
    return tuple(made)


@dataclass(frozen=True, eq=False)
class _Samples:
    """A run sample by sample: residual, prediction, velocity, command, time since the last step (NaN if none)."""

    run: Run
    present: Flags
    residual: Array
    position: Array
    velocity: Array
    command: Array
    since: Array
    noise: float

    @classmethod
    def of(cls, run: Run, residual: Array, prediction: Array, noise_floor: NoiseFloor) -> _Samples:
        present = np.isfinite(residual)
        velocity = np.gradient(prediction, run.period)
        filled = np.where(present, residual, 0.0)
        command = run.command()
        since = _since_step(command, run.period)
        return cls(run, present, filled, prediction, velocity, command, since, noise_floor.rms[run.name])

    @property
    def count(self) -> int:
        return max(int(self.present.sum()), 1)

    def energy(self, at: Flags) -> float:
        """Return the share of the mean square that some samples have."""
        return float(np.sum(self.residual[at & self.present] ** 2)) / self.count

    def excess(self, at: Flags) -> float:
        """Return the same without the noise."""
        return self.energy(at) - self.noise**2 * int((at & self.present).sum()) / self.count


def holds(command: Array) -> list[tuple[int, int, float]]:
    """Return the steps of a command after which it stands still: first index, the one after the last, and the jump [V].

    >>> holds(np.repeat([0.0, 5.0, 2.0], 30))
    [(30, 60, 5.0), (60, 90, -3.0)]
    """
    found = []
    change, span = np.diff(command), float(np.ptp(command))
    for jump in (np.flatnonzero(np.abs(change) > STEP_JUMP * span) + 1).tolist():
        # Of a lively command most jumps are followed by another soon, and nothing beyond that is looked at.
        if np.abs(command[jump : jump + STEP_SAMPLES] - command[jump]).max() > STEP_STILL * span:
            continue
        changed = np.flatnonzero(np.abs(command[jump:] - command[jump]) > STEP_STILL * span)
        last = jump + int(changed[0]) if changed.size else len(command)
        if last - jump >= STEP_SAMPLES:
            found.append((jump, last, float(change[jump - 1])))
    return found


def _since_step(command: Array, period: float) -> Array:
    """Return the time since the last step of a command that stands still since [s]; NaN elsewhere."""
    since = np.full(len(command), np.nan)
    for first, last, _ in holds(command):
        since[first:last] = period * np.arange(last - first)
    return since


def _parts(samples: Sequence[_Samples], bins: Sequence[tuple[str, float, float, Sequence[Flags]]]) -> tuple[Part, ...]:
    """Return the parts that flags for each run make, their shares summing to one."""
    excess, weights, powers = [], [], []
    for _, _, _, flags in bins:
        excess.append(max(sum(s.excess(at) for s, at in zip(samples, flags, strict=True)), 0.0))
        weight = sum(float((at & s.present).sum()) / s.count for s, at in zip(samples, flags, strict=True))
        energy = sum(s.energy(at) for s, at in zip(samples, flags, strict=True))
        weights.append(weight)
        powers.append(energy / weight if weight else 0.0)
    total, whole = sum(excess) or 1.0, sum(weights) or 1.0
    return tuple(
        Part(label, lower, upper, e / total, w / whole, math.sqrt(p))
        for (label, lower, upper, _), e, w, p in zip(bins, excess, weights, powers, strict=True)
    )


def _by_run(samples: Sequence[_Samples]) -> Breakdown:
    bins = [(s.run.name, math.nan, math.nan, [o.present & (o is s) for o in samples]) for s in samples]
    return Breakdown("run", "", _parts(samples, bins))


def _by_frequency(samples: Sequence[_Samples], noise_floor: NoiseFloor) -> Breakdown:
    """Divide by octaves around 1, 2, 4 Hz and so on, and what is below: the middle of a band is a round number."""
    fastest = max(0.5 / s.run.period for s in samples)
    edges = [0.0, *(2.0 ** (k - 0.5) for k in range(max(math.ceil(math.log2(fastest)), 1) + 2))]
    edges = [*[e for e in edges if e < fastest], fastest]
    powers, noises = np.zeros(len(edges) - 1), np.zeros(len(edges) - 1)
    for s in samples:
        n = len(s.residual)
        power = np.abs(np.fft.rfft(s.residual)) ** 2 / (n * s.count)
        power[1 : (n + 1) // 2] *= 2
        frequency = np.asarray(np.fft.rfftfreq(n, s.run.period), dtype=float)
        noise = noise_floor.density(s.run, frequency) / (n * s.run.period)
        noise[0] = 0.0  # the offset is taken out
        place = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, len(powers) - 1)
        powers += np.bincount(place, power, len(powers))
        noises += np.bincount(place, noise, len(powers))
    excess = np.maximum(powers - noises, 0.0)
    total = float(excess.sum()) or 1.0
    return Breakdown(
        "frequency",
        "Hz",
        tuple(
            Part("", low, high, float(e) / total, (high - low) / fastest, math.sqrt(float(p) / len(samples)))
            for (low, high), e, p in zip(pairwise(edges), excess, powers, strict=True)
        ),
    )


def _in_regions(samples: Sequence[_Samples], values: Sequence[Array]) -> tuple[Part, ...]:
    """Return parts of equal width over the whole range of some values."""
    low, high = min(float(v.min()) for v in values), max(float(v.max()) for v in values)
    return _between(samples, values, np.linspace(low, high, REGIONS + 1).tolist(), [""] * REGIONS)


def _between(
    samples: Sequence[_Samples], values: Sequence[Array], edges: Sequence[float], labels: Sequence[str]
) -> tuple[Part, ...]:
    """Return parts between edges, the first and the last of which are the ends of some values."""
    places = [np.searchsorted(edges[1:-1], v, side="right") for v in values]
    limits = zip(labels, pairwise(edges), strict=True)
    return _parts(
        samples, [(label, a, b, [place == k for place in places]) for k, (label, (a, b)) in enumerate(limits)]
    )


def _by_velocity(samples: Sequence[_Samples], si: str) -> Breakdown:
    speeds = np.concatenate([np.abs(s.velocity) for s in samples])
    largest = float(np.quantile(speeds, SPEED_QUANTILE)) or float(speeds.max()) or 1.0
    slow, fast, most = SPEED_AT_REST * largest, FAST_SPEED * largest, float(speeds.max())
    labels = ["down fast", "down slowly", "at rest", "up slowly", "up fast"]
    edges = [-most, -fast, -slow, slow, fast, most]
    return Breakdown("velocity", f"{si}/s", _between(samples, [s.velocity for s in samples], edges, labels))


def _by_time_since_step(samples: Sequence[_Samples], total: float) -> Breakdown:
    """Divide by decades of the time since a step, over samples under a command that stands still since."""
    longest = max(float(np.nanmax(s.since, initial=0.0)) for s in samples)
    shortest = max(min(s.run.period for s in samples), 1e-6)
    first, last = math.floor(math.log10(shortest)), math.ceil(math.log10(max(longest, 2 * shortest)) - 1e-9)
    edges = [10.0**k for k in range(first, last + 1)]
    edges[0] = 0.0
    bins = [("", a, b, [(s.since >= a) & (s.since < b) for s in samples]) for a, b in pairwise(edges)]
    bins[-1] = (*bins[-1][:3], [(s.since >= edges[-2]) & (s.since <= edges[-1]) for s in samples])
    after = sum(s.excess(np.isfinite(s.since)) for s in samples)
    covers = min(max(after, 0.0) / total, 1.0) if total > 0 else 0.0
    return Breakdown("time since the last step", "s", _parts(samples, bins), covers)

"""Where recorded runs show their noise alone: quiet stretches, differences of periods, differences of repeats."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from flexdesign.core.arrays import Array
from flexdesign.estimation.noise.autoregressive import process_of
from flexdesign.estimation.noise.autoregressive import stretches as where_up
from flexdesign.estimation.noise.quiet_stretches import Stretch
from flexdesign.measurements.recordings import Run

#: Least number of samples of a stretch.
FEWEST = 24
#: A still command moves by no more than these shares of its span, while it is looked at and in a whole stretch.
STILL, DRIFTED = 5e-4, 2e-3


@dataclass(frozen=True)
class Duration:
    """How long something must last: some seconds, or less where the samples are close and the stage is fast.

    Parameters
    ----------
    seconds
        At most.
    samples, share
        The larger one of this number of samples and this share of the time in which the stage settles is enough.
    """

    seconds: float
    samples: int
    share: float

    def in_samples(self, period: float, settling_time: float) -> int:
        """Return it in samples of a period [s] on a stage that settles in some time [s]."""
        enough = max(self.samples * period, self.share * settling_time)
        return max(1, math.ceil(min(self.seconds, enough) / period))


#: Least duration of a stretch; and how long a command is looked at.
SHORTEST, LOOK = Duration(0.15, 150, 0.5), Duration(0.05, 50, 0.2)
#: A command jitters if at least this share of its samples differ by little from the one before, and if this share of
#: these changes go back.
JITTERS, TURNS = 0.02, 0.5
#: Two readings of a command are the same if they differ by less than this share of its span; it moves if by more.
SAME, MOVES = 1e-4, 0.02
#: How often noise alone may look as if it decayed.
SIGNIFICANCE = 1e-4
#: The same of all stretches together, where a mistake costs but a few samples.
JOINT_SIGNIFICANCE = 0.05
#: Where no model says how long a stage takes to settle, it is sought from here on [s].
SHORTEST_SETTLING = 0.2
#: By how much the time to settle is lengthened at a time, and which part of the samples must be left.
LONGER, KEPT = 1.25, 0.3
#: Most samples that count as one in differences of noise.
NARROWEST = 8.0
#: Most lags that are tried for a period: the lag of a periodic command is among the first few.
LAGS = 40


@dataclass(frozen=True, eq=False)
class Source:
    """Stretches that hold noise alone.

    Parameters
    ----------
    words
        Where they were found.
    stretches
        In the order of the runs; trends are constant, slope and a bend.
    lags
        Times [s] between the halves of which each is a difference; empty if none is.
    """

    words: str
    stretches: tuple[Stretch, ...]
    lags: tuple[float, ...] = ()

    def amplitude(self, frequency: float) -> float:
        """Return how many times larger a sinusoid [Hz] is in the record than in these stretches."""
        if not self.lags:
            return 1.0
        squares = [2 * math.sin(math.pi * frequency * lag) ** 2 for lag in self.lags]
        return 1 / max(math.sqrt(float(np.mean(squares))), 0.1)


def stationary_stretches(runs: Sequence[Run], axis: str, settling_time: float) -> Source:
    """Return where all commands stand still and nothing rings.

    Parameters
    ----------
    runs
        With all their commands.
    axis
        The response.
    settling_time
        How long the stage rings after a command has come to rest [s]; more where the stretches, taken together, still
        decay. A record that begins at rest is taken from its first sample, unless it rings.
    """
    found = _stationary(runs, axis, settling_time)
    fewest, longest = KEPT * sum(len(s.values) for s in found), max(len(run.time) * run.period for run in runs)
    while settling_time < longest and _are_settling([s.values for s in found if s.first]):
        settling_time *= LONGER
        fewer = _stationary(runs, axis, settling_time)
        if sum(len(s.values) for s in fewer) < fewest:
            break
        found = fewer
    return Source(_describe("quiet stretches", runs, found), tuple(found))


def _stationary(runs: Sequence[Run], axis: str, settling_time: float) -> list[Stretch]:
    spans, found = _spans(runs), []
    for run in runs:
        window = LOOK.in_samples(run.period, settling_time)
        finite = np.isfinite(run.columns[axis])
        for first, last in where_up(_still(run, spans, window)):
            last_motion = None if first == 0 else first - window  # the look goes back: here the command came to rest
            begin = 0 if last_motion is None else max(first, last_motion + math.ceil(settling_time / run.period))
            if begin >= last or any(np.ptp(run.columns[c][begin:last]) > DRIFTED * spans[c] for c in run.commands):
                continue
            for a, b in where_up(finite[begin:last]):
                found += _after_decay(
                    run, begin + a, run.columns[axis][begin + a : begin + b], last_motion, settling_time
                )
    return found


def differences_of_periods(runs: Sequence[Run], axis: str, settling_time: float) -> Source:
    """Return half the difference of one half of a periodic record and the other, by the root of two.

    What the first period still has of the time before is left out: all of it where there are three or more, else up to
    where modes have rung down and, if the difference is larger before, where the command has passed both its extremes,
    which wipes out the memory of hysteresis.
    """
    spans, found, lags = _spans(runs), [], []
    for run in runs:
        repeated = _period(run, spans)
        if repeated is None:
            continue
        first, last, period = repeated
        begin = first + math.ceil(settling_time / run.period)
        if (last - first) // period >= 3:
            begin = max(begin, first + period)
        lag = max((last - begin) // period // 2, 1) * period
        end = min(begin + lag, last - lag)
        response = run.columns[axis]
        difference = (response[begin + lag : end + lag] - response[begin:end]) / math.sqrt(2)
        if begin < first + period:
            extremes = [f(run.columns[c][first : first + period]) for c in run.commands for f in (np.argmax, np.argmin)]
            passed = max(first + int(max(extremes)) - begin, 0)
            if _is_louder(difference[:passed], difference[passed:]):
                begin, difference = begin + passed, difference[passed:]
        for a, b in where_up(np.isfinite(difference)):
            made = _after_decay(run, begin + a, difference[a:b], first, settling_time)
            found += made
            lags += [lag * run.period] * len(made)
    return Source(_describe("difference of periods", runs, found), tuple(found), tuple(lags))


def differences_of_repeats(runs: Sequence[Run], axis: str, settling_time: float) -> Source:
    """Return differences, by the root of two, of pairs of runs that had the same commands."""
    spans, found = _spans(runs), []
    left = list(runs)
    while left:
        one = left.pop(0)
        other = next((run for run in left if _same(one, run, spans)), None)
        if other is None:
            continue
        left.remove(other)
        difference = (other.columns[axis] - one.columns[axis]) / math.sqrt(2)
        for a, b in where_up(np.isfinite(difference)):
            found += _after_decay(one, a, difference[a:b], None, settling_time)
    return Source(_describe("difference of repeats", runs, found), tuple(found))


def _spans(runs: Sequence[Run]) -> dict[str, float]:
    """Return how far each command goes in all runs together [V]."""
    names = dict.fromkeys(name for run in runs for name in run.commands)
    ends = {name: [run.columns[name] for run in runs if name in run.columns] for name in names}
    return {name: max(float(c.max()) for c in all_) - min(float(c.min()) for c in all_) for name, all_ in ends.items()}


def _still(run: Run, spans: dict[str, float], window: int) -> NDArray[np.bool_]:
    """Return where no command has moved since `window` samples ago."""
    still = np.ones(len(run.time), dtype=bool)
    for name in run.commands:
        command = run.columns[name]
        allowed = max(STILL * spans[name], 1.05 * _jitter(command, DRIFTED * spans[name]))
        for back in {1, window}:
            still[back:] &= np.abs(command[back:] - command[:-back]) <= allowed
        early = command[:window]
        still[:window] &= np.abs(early - early[0]) <= allowed
    return still


def _jitter(command: Array, largest: float) -> float:
    """Return by how much the readings of a command jitter where it stands still; zero if they do not.

    A command that was read back goes up and down by the noise or the steps of its converter. One that moves in small
    steps goes on in one direction.
    """
    changes = np.diff(command)
    changes = changes[changes != 0]
    is_small = np.abs(changes) <= largest
    turns = np.sign(changes[1:]) != np.sign(changes[:-1])
    pairs = is_small[1:] & is_small[:-1]
    if is_small.sum() < JITTERS * len(command) or not pairs.any() or np.mean(turns[pairs]) < TURNS:
        return 0.0
    return float(np.quantile(np.abs(changes[is_small]), 0.99))


def _after_decay(run: Run, first: int, values: Array, last_motion: int | None, settling_time: float) -> list[Stretch]:
    """Return a stretch without the part of it in which something still decays; nothing if too little is left.

    Parameters
    ----------
    run, first
        Where it comes from: the index of its first sample.
    values
        Its samples.
    last_motion
        Index at which a command came to rest or a period began: from there creep goes with the logarithm of time.
    settling_time
        See `stationary_stretches`.
    """
    fewest = fewest_samples(run.period, settling_time)
    while len(values) >= fewest and _decay([values], SIGNIFICANCE):
        dropped = len(values) // 4
        first, values = first + dropped, values[dropped:]
    if len(values) < fewest:
        return []
    place = np.linspace(-1, 1, len(values))
    bend = place**2 if last_motion is None else np.log(first - last_motion + 1.0 + np.arange(len(values)))
    trend = np.linalg.qr(np.column_stack([np.ones(len(values)), place, bend]))[0]
    return [Stretch(run.name, first, values, trend)]


def fewest_samples(period: float, settling_time: float = SHORTEST_SETTLING) -> int:
    """Return the least number of samples of a stretch, of a period [s] on a stage that settles in some time [s]."""
    return max(FEWEST, SHORTEST.in_samples(period, settling_time))


def _is_louder(one: Array, other: Array) -> bool:
    """Tell whether a part of a record has more power than another, beyond chance."""
    from scipy.stats import f as ratio_of_variances

    if min(len(one), len(other)) < FEWEST:
        return len(one) > 0
    powers, counted = [], []
    for part in (one - one.mean(), other - other.mean()):
        powers.append(float(part @ part) / len(part))
        counted.append(max(len(part) / process_of(part).inflation(len(part)), 1.0))
    return powers[0] > ratio_of_variances.isf(SIGNIFICANCE**0.5, *counted) * powers[1]


def _decay(records: Sequence[Array], probability: float) -> bool:
    """Tell whether the first thirds of records move more than the last ones do, beyond chance.

    What is too small to be seen in one of them may be seen in all.
    """
    from scipy.stats import f as ratio_of_variances

    early, late, counted = np.array([_is_moving(values) for values in records]).T
    dof = counted.sum()
    return bool(counted @ early > ratio_of_variances.isf(probability, dof, dof) * (counted @ late))


def _are_settling(records: Sequence[Array]) -> bool:
    """Tell whether records, taken together, still decay.

    A decay that is much slower than the samples shows in means of blocks: half the mean square of the differences of
    neighbours is the Allan variance (Allan 1966).
    """
    if not records:
        return False
    blocks = [values[: len(values) // FEWEST * FEWEST].reshape(FEWEST, -1).mean(axis=1) for values in records]
    return _decay(records, JOINT_SIGNIFICANCE) or _decay(blocks, JOINT_SIGNIFICANCE)


def _is_moving(values: Array) -> tuple[float, float, float]:
    """Return the mean square of neighbours' differences in the first and in the last third, and how many count.

    Differences of slow noise are nearly independent, so that even short stretches show what decays.
    """
    steps = np.diff(values)
    third = len(steps) // 3
    early, late = steps[:third] - steps[:third].mean(), steps[-third:] - steps[-third:].mean()
    counted = third / min(process_of(late).inflation(len(late)), NARROWEST)  # what rings is narrow itself
    return float(early @ early) / third, float(late @ late) / third, counted


def _period(run: Run, spans: dict[str, float]) -> tuple[int, int, int] | None:
    """Return where a run's commands are periodic, first index and the one after the last, and the period [samples]."""
    commands = np.stack([run.columns[c] / (spans[c] or 1.0) for c in run.commands])
    best = None
    for lag in sorted(_candidates(commands)):
        same = np.all(np.abs(commands[:, lag:] - commands[:, :-lag]) <= SAME, axis=0)
        for first, last in where_up(same):
            long_enough = last - first >= lag and (best is None or last - first + lag > 1.2 * (best[1] - best[0]))
            if long_enough and np.ptp(commands[:, first:last], axis=1).max() > MOVES:
                best = (first, last + lag, lag)
    return best


def _candidates(commands: Array) -> list[int]:
    """Return the lags at which commands (m by n) are most like themselves."""
    n = commands.shape[1]
    length = next_fast_len(2 * n, real=True)
    centred = commands - commands.mean(axis=1, keepdims=True)
    correlation = irfft(np.sum(np.abs(rfft(centred, length, axis=1)) ** 2, axis=0), length)[: n // 2 + 2]
    energy = np.concatenate([[0.0], np.cumsum(np.sum(centred**2, axis=0))])
    lags = np.arange(n // 2 + 2)
    overlap = np.sqrt((energy[-1] - energy[lags]) * energy[n - lags])  # what the two shifted parts have
    alike = correlation / np.maximum(overlap, 1e-300 + 1e-12 * energy[-1])
    peaks = 1 + np.flatnonzero((alike[1:-1] >= alike[:-2]) & (alike[1:-1] > alike[2:]))
    peaks = peaks[peaks > 3]
    return [int(lag) for lag in peaks[np.argsort(alike[peaks])[::-1][:LAGS]]]


def _same(one: Run, other: Run, spans: dict[str, float]) -> bool:
    """Tell whether two runs had the same commands, which moved."""
    if len(one.time) != len(other.time) or one.commands != other.commands:
        return False
    if not math.isclose(one.period, other.period, rel_tol=1e-6):
        return False
    pairs = [(one.columns[c], other.columns[c], spans[c]) for c in one.commands]
    return all(np.abs(a - b).max() <= SAME * span for a, b, span in pairs) and any(
        np.ptp(a) > MOVES * span for a, _, span in pairs
    )


def _describe(what: str, runs: Sequence[Run], found: Sequence[Stretch]) -> str:
    period = {run.name: run.period for run in runs}
    seconds = sum(len(s.values) * period[s.run] for s in found)
    count = len({s.run for s in found})
    return f"{what}, {seconds:.3g} s in {count} run{'' if count == 1 else 's'}"

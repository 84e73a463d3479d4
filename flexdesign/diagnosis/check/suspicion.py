"""What would mislead a fit: commands that repeat, clipped or held ones, filtered noise, readings that do not follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array, Places
from flexdesign.diagnosis.check.coverage import STEP_CHANGE, STILL_CHANGE
from flexdesign.diagnosis.check.timing import timing_of
from flexdesign.estimation.noise.autoregressive import stretches
from flexdesign.measurements.noise_level.noise_floor import NoiseFloor
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.measurements.recordings.run import commanded_by

#: A command is clipped if it stands at an end of its range in this number of separate stretches, and this share of the
#: record.
CLIPPED_STRETCHES, CLIPPED_SHARE = 3, 0.02
#: Noise is filtered if its density in the upper part of the band is below this share of that in the middle.
FILTERED_NOISE = 0.1
#: A coherence below this: the response does not follow its command.
LEAST_COHERENCE = 0.2
#: A command that is held changes so often, and is held for no more samples: else it is one of levels.
HELD_CHANGES, LONGEST_HOLD = 50, 20
#: Lines with a coherence below this say little.
COHERENT_LINE = 0.8
#: What to do about a remark of a reader, by a word in it.
_REMEDIES = {
    "saturated": "record again with a smaller motion; these samples are not used",
    "end of its range": "record again with a smaller motion; these samples are not used",
    "stuck": "check the sensor; these samples are not used",
    "resampled": "record with a fixed clock: interpolation adds errors that a fit may take for an effect",
    "missing before": "samples were dropped; a slower rate, or a larger buffer",
    "bridged": "samples of the command were dropped; a slower rate, or a larger buffer",
    "out of order": "check how the file was put together",
    "copies": "check how the file was put together",
    "beyond the limits": "correct limits, scale or bias in measurements.toml",
    "rounded": "write times with more digits",
}
#: No more samples lie between a jump and the jump back: a stage that moves on its own comes back slowly.
LONGEST = 20
#: Samples before and after that a jump is compared with.
AROUND = 25
#: A jump is this many times the largest one around it. Of a resonance, successive jumps differ by less: even at a
#: damping ratio of 0.4 a swing is a quarter of the one before. Of 50 samples of normal noise none is twice the largest
#: other.
BEYOND = 8.0
#: And it is this share of the motion.
SHARE = 0.05


@dataclass(frozen=True)
class Suspicion:
    """Something that may be wrong.

    Parameters
    ----------
    recording
        Where; empty if it concerns all.
    what
        What was seen, in a sentence without its full stop.
    remedy
        What to do about it.
    """

    recording: str
    what: str
    remedy: str


def of_runs(runs: Sequence[Run]) -> list[Suspicion]:
    """Return what is suspicious of runs, once roles are given: see `splitting.split`."""
    remarks = dict.fromkeys((run.name.partition(":")[0], remark) for run in runs for remark in run.remarks)
    found = [
        Suspicion(name, remark, next((remedy for word, remedy in _REMEDIES.items() if word in remark), ""))
        for name, remark in remarks
        if "blocks of one record" not in remark and "behind a low-pass" not in remark
    ]
    found += _equal_commands(runs)
    whole = {run.name.partition(":")[0]: run for run in runs}
    for name, run in whole.items():
        found += _of_command(name, run)
        for response in run.responses:
            found += _of_response(name, run, response)
    return found


def _equal_commands(runs: Sequence[Run]) -> list[Suspicion]:
    """Return pairs of a fitted and another run with one command: the second tests memory, not the model."""
    found = []
    fitted = [run for run in runs if run.role == "identify"]
    for other in (run for run in runs if run.role != "identify"):
        for run in fitted:
            if run.name.partition(":")[0] != other.name.partition(":")[0] and _same(run, other):
                what = f"has the same command as {run.name}, which is fitted"
                remedy = "validate on another command, or swap roles: a repeated run cannot show what the model lacks"
                found.append(Suspicion(other.name, what, remedy))
                break
    return found


def _same(one: Run, other: Run) -> bool:
    count = min(len(one.time), len(other.time))
    if one.commands != other.commands or count < 0.9 * max(len(one.time), len(other.time)):
        return False
    pairs = [(one.columns[name], other.columns[name][:count]) for name in one.commands]
    differ = any(np.abs(a[:count] - b).max() > STILL_CHANGE * np.ptp(a) for a, b in pairs)
    return not differ and any(np.ptp(a) for a, _ in pairs)


def _of_command(name: str, run: Run) -> list[Suspicion]:
    found = []
    for column in run.commands:
        values = run.columns[column]
        if np.ptp(values) == 0:
            continue
        if (every := held_for(values)) > 1:
            rate = 1 / (every * run.period)
            what = f"{column} changes at every {every}. sample only: it is held, at {units.hertz(rate, 5)}"
            remedy = "" if run.between_is_stated else 'write between_samples = "hold" in measurements.toml'
            found.append(Suspicion(name, what, remedy))
        for end, remarks in ((values.max(), "largest"), (values.min(), "smallest")):
            if _is_clipped(values, float(end)):
                what = f"{column} stays at its {remarks} value, {end:.5g} V, in many stretches: it looks clipped"
                remedy = "state the limits of the driver in the model, or record the voltage behind it"
                found.append(Suspicion(name, what, remedy))
    return found


def held_for(values: Array) -> int:
    """Return after how many samples a command changes, if it changes at multiples of them alone; else 1.

    >>> held_for(np.repeat(np.arange(60.0) % 7, 4))
    4
    """
    places = np.flatnonzero(np.diff(values) != 0) + 1
    if len(places) < HELD_CHANGES:
        return 1
    every = int(np.gcd.reduce(np.diff(places)))
    return every if 1 < every <= LONGEST_HOLD and len(places) * every > 0.5 * len(values) else 1


def _is_clipped(values: Array, end: float) -> bool:
    """Tell whether a smooth command rests at one end in several stretches, and nowhere else as long."""
    near = 1e-9 * float(np.ptp(values))
    at_end = np.abs(values - end) <= near
    rests = np.diff(values) == 0
    between = (values > values.min() + near) & (values < values.max() - near)
    reached = between[1:-1] & ~rests[:-1]  # by a sample on the way, which a square wave has not
    long = [last - first for first, last in stretches(at_end) if last - first >= 3 and first > 1 and reached[first - 2]]
    elsewhere = int(np.count_nonzero(rests & between[1:]))
    return len(long) >= CLIPPED_STRETCHES and sum(long) > CLIPPED_SHARE * len(values) and elsewhere < 0.2 * sum(long)


def _of_response(name: str, run: Run, response: str) -> list[Suspicion]:
    found = []
    values, column = run.columns[response], commanded_by(response, run.columns)
    if run.si[response] == "V" and column is not None:
        remedy = "if that is the voltage of a sensor, give its scale when you import it"
        found.append(Suspicion("", f"{response} is in volts", remedy))
    found += _of_outliers(name, run, response)
    if column is None or np.ptp(run.columns[column]) == 0:
        return found
    if (agrees := coherence(run.columns[column], values)) is not None and agrees < LEAST_COHERENCE:
        what = f"{response} hardly follows {column}: their coherence is {agrees:.2f}"
        found.append(Suspicion(name, what, "check that both were recorded together, and the names of the columns"))
        return found
    if (timing := timing_of(run, response)) is not None:
        if timing.ahead:
            what = f"{response} answers {column} before it changes: the columns are shifted by a sample"
            what += f", or {column} is no command but follows from {response}, as in a closed loop"
            remedy = (
                "check the trigger; shift one of the columns by a row; write closed_loop = true where it was closed"
            )
            found.append(Suspicion(name, what, remedy))
        elif timing.held and not run.between_is_stated:
            what = f"{response} answers {column} half a sample later than straight lines between its samples make it"
            remedy = 'the command was held: write between_samples = "hold" in measurements.toml; else it looks late'
            found.append(Suspicion(name, what, remedy))
    return found


def _of_outliers(name: str, run: Run, response: str) -> list[Suspicion]:
    samples = outliers(run, response)
    if not len(samples):
        return []
    values, si = run.columns[response][samples], run.si[response]
    factor, unit = (1e6, f"u{si}") if si in ("m", "rad") else (1.0, si)
    said = " to ".join(dict.fromkeys(f"{factor * value:.5g}" for value in (values.min(), values.max())))
    count = f"{len(samples)} sample{'s' if len(samples) > 1 else ''}"
    what = (
        f"{response} jumps to {said} {unit} and back in {count}, the first at {run.time[samples[0]]:.6g} s, while no "
    )
    what += "command jumps: these are no motion"
    remedy = "leave their cells empty; if the sensor writes that beyond its range, state its range in measurements.toml"
    return [Suspicion(name, what, remedy)]


def coherence(command: Array, response: Array) -> float | None:
    """Return how much of a response follows its command linearly, in the band in which the command has its power.

    Or over the whole record, if that is more: of a slow ramp each stretch is little but the steps of a converter, while
    the response follows the ramp. Then it is the square of their correlation.
    """
    from scipy.signal import coherence as spectrum
    from scipy.signal import welch

    there = np.isfinite(response)
    if there.mean() < 0.9 or len(command) < 64:
        return None
    filled = np.interp(np.arange(len(response)), np.flatnonzero(there), response[there])
    if np.ptp(filled) == 0:
        return 0.0
    length = min(max(64, len(command) // 8), 4096)
    _, power = welch(command, nperseg=length, detrend="linear")
    _, agrees = spectrum(command, filled, nperseg=length, detrend="linear")
    usable = np.isfinite(agrees)
    weight = np.where(usable, power, 0.0)
    correlation = float(np.corrcoef(command, filled)[0, 1])
    return max(float((weight @ np.nan_to_num(agrees)) / weight.sum()), correlation**2) if weight.sum() > 0 else None


def of_noise(response: str, noise: NoiseFloor) -> list[Suspicion]:
    """Return what is suspicious of the noise of a response."""
    found = [Suspicion("", f"noise of {response}: {remark}", "") for remark in noise.remarks]
    if not noise.known:
        remedy = 'record a quiet stretch or one command twice, or write noise = "3 nm" in measurements.toml'
        return [
            *found,
            Suspicion("", f"the noise of {response} is unknown, as no part of the recordings shows it alone", remedy),
        ]
    for name in noise.rms:
        if (density := _upper_density(noise, name)) < FILTERED_NOISE:
            what = f"the noise of {response} is filtered: near the Nyquist frequency its density falls to {density:.2g}"
            remedy = "switch filters and averaging off, or give the sensor its bandwidth in the model: filters delay"
            return [*found, Suspicion(name, what, remedy)]
    return found


def _upper_density(noise: NoiseFloor, name: str) -> float:
    """Return the density of the noise near the Nyquist frequency over that in the middle of the band."""
    process = noise.whitening.process(name)
    upper, middle = (process.density(np.linspace(low, high, 20), 1.0) for low, high in ((0.42, 0.5), (0.1, 0.2)))
    return float(np.mean(upper) / np.mean(middle))


def of_response(response: FrequencyResponse) -> list[Suspicion]:
    """Return what is suspicious of a frequency response."""
    remarks = (remark for remark in response.remarks if "lines outside of" not in remark)  # somebody chose that
    found = [Suspicion(response.name, remark, "") for remark in remarks]
    if response.coherence is None:
        remedy = "record the coherence and the number of averages: they determine the noise of each line"
        found.append(Suspicion(response.name, "has no coherence", remedy))
    elif (share := float(np.mean(response.coherence < COHERENT_LINE))) > 0.1:
        what = f"{100 * share:.0f} % of its lines have a coherence below {COHERENT_LINE:g}"
        found.append(Suspicion(response.name, what, "average longer, or drive harder"))
    if response.coherence is not None and response.averages is None:
        remedy = "write averages = ... for it in measurements.toml: with the coherence it determines the noise"
        found.append(Suspicion(response.name, "nobody says how many averages it is the mean of", remedy))
    step = float(np.median(np.diff(response.frequencies)))
    if (sharp := _sharpest(response)) and sharp[1] < 3 * step:
        peak, width, apart = units.hertz(sharp[0]), units.hertz(sharp[1], 3), units.hertz(step, 3)
        what = f"its peak at {peak} is {width} wide, its lines are {apart} apart"
        found.append(Suspicion(response.name, what, "measure more lines about the peak: damping is read from them"))
    return found


def _sharpest(response: FrequencyResponse) -> tuple[float, float] | None:
    """Return frequency and width at half the power of the largest peak inside the band."""
    size = np.abs(np.nan_to_num(response.response))
    top = int(np.argmax(size))
    left, right = next((a, b) for a, b in stretches(size >= size[top] / np.sqrt(2)) if a <= top < b)
    ends = response.frequencies[max(left - 1, 0)], response.frequencies[min(right, len(size) - 1)]
    return (float(response.frequencies[top]), float(ends[1] - ends[0])) if 0 < top < len(size) - 1 else None


# --- outliers --------------------------------------------------------------------------------------------------------


def outliers(run: Run, response: str) -> Places:
    """Return the samples of a response that jump away from those around them and back, while no command jumps.

    Codes for overrange and lost bits do that.

    >>> t = np.arange(400) * 1e-3
    >>> x = np.sin(9 * t) + np.where(np.abs(t - 0.2) < 1.5e-3, 50, 0)
    >>> outliers(Run("a", t, {"u": t, "x": x}, {"u": "V", "x": "m"}), "x")
    array([199, 200, 201])
    """
    values = run.columns[response]
    there = np.flatnonzero(np.isfinite(values))
    reading = values[there]
    steps = np.diff(reading)
    sizes = np.abs(steps)
    if len(reading) < 2 * AROUND or not sizes.any():
        return there[:0]
    low, high = np.percentile(reading, (2, 98))
    smallest = float(sizes[sizes > 0].min())  # the resolution, where readings have one
    least = max(BEYOND * max(smallest, float(np.median(sizes))), SHARE * float(high - low))
    jumps = np.flatnonzero(sizes > least)
    away, back = jumps[:-1], jumps[1:]
    is_pair = (back - away <= LONGEST) & (steps[away] * steps[back] < 0)
    found = [
        there[first + 1 : last + 1]
        for first, last in zip(away[is_pair].tolist(), back[is_pair].tolist(), strict=True)
        if _stands_out(sizes, first, last)
        and not _is_driven(run, int(there[max(first - AROUND, 0)]), int(there[last + 1]))
    ]
    return np.concatenate(found) if found else there[:0]


def _stands_out(sizes: Array, first: int, last: int) -> bool:
    """Tell whether a jump at `first` and one back at `last` are far larger than those around them."""
    around = np.concatenate([sizes[max(first - AROUND, 0) : first], sizes[last + 1 : last + 1 + AROUND]])
    return bool(min(sizes[first], sizes[last]) > BEYOND * around.max(initial=0.0))


def _is_driven(run: Run, first: int, last: int) -> bool:
    """Tell whether a command jumps from `first` to `last`: by a share of its span, and as it does not all the time."""
    for name in run.commands:
        changes = np.abs(np.diff(run.columns[name][first : last + 1]))
        least = STEP_CHANGE * float(np.ptp(run.columns[name]))
        if changes.max() > max(least, BEYOND * float(np.median(changes))):
            return True
    return False

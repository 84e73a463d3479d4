"""What would mislead a fit: commands that repeat, filtered noise, readings that do not follow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array, Places
from flexdesign.diagnosis.check.timing import timing_of
from flexdesign.diagnosis.preparation.spectra import FEWEST_PER_PERIOD, SEGMENTS, CrossSpectra, cross_spectra
from flexdesign.estimation.criterion import LEVEL
from flexdesign.estimation.noise.autoregressive import FEWEST_SAMPLES, stretches
from flexdesign.measurements.noise_level.noise_floor import NoiseFloor
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.measurements.recordings.command_segments import JUMP, RECORD_PARTS
from flexdesign.measurements.recordings.run import commanded_by

#: Noise is filtered if its density in the upper part of the band is below this share of that in the middle.
FILTERED_NOISE = 0.1
#: A coherence below this: less than half of the power of the response follows the command.
LEAST_COHERENCE = 0.5
#: A jump away and back is this many times the largest change around it. Of a resonance, successive jumps differ by
#: less: even at a damping ratio of 0.4 a swing is a quarter of the one before. Of 50 samples of normal noise none is
#: twice the largest other.
BEYOND = 8.0
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


def of_runs(runs: Sequence[Run], parts: Sequence[Run]) -> list[Suspicion]:
    """Return what is suspicious of runs, and of their parts, which have roles: see `splitting.split`."""
    found = [
        Suspicion(name, remark, next((remedy for word, remedy in _REMEDIES.items() if word in remark), ""))
        for name, remark in dict.fromkeys((part.record, remark) for part in parts for remark in part.remarks)
        if "blocks of one record" not in remark and "behind a low-pass" not in remark
    ]
    found += _equal_commands(parts)
    for run in runs:
        for response in run.responses:
            found += _of_outliers(run, response) + _of_response(run, response)
    return found


def _equal_commands(runs: Sequence[Run]) -> list[Suspicion]:
    """Return runs that have the command of a fitted run: they test memory, not the model."""
    found = []
    for other in (run for run in runs if run.role != "identify"):
        fitted = [run for run in runs if run.role == "identify" and run.record != other.record and _same(run, other)]
        if fitted:
            what = f"has the same command as {fitted[0].record}, which is fitted"
            remedy = "validate on another command, or swap roles: a repeated run cannot show what the model lacks"
            found.append(Suspicion(other.name, what, remedy))
    return found


def _same(one: Run, other: Run) -> bool:
    count = min(len(one.time), len(other.time))
    if one.commands != other.commands or count < 0.9 * max(len(one.time), len(other.time)):
        return False
    pairs = [(one.columns[name][:count], other.columns[name][:count]) for name in one.commands]
    differ = any(np.abs(a - b).max() > np.ptp(a) / RECORD_PARTS for a, b in pairs)
    return not differ and any(np.ptp(a) > 0 for a, _ in pairs)


def _of_response(run: Run, response: str) -> list[Suspicion]:
    found, column = list[Suspicion](), commanded_by(response, run.columns)
    if column is None:
        return found
    if run.si[response] == "V":
        remedy = "if that is the voltage of a sensor, give its scale when you import it"
        found.append(Suspicion("", f"{response} is in volts", remedy))
    if (spectra := _spectra(run, response, column)) is None:
        return found
    if (agrees := _coherence(run, response, column, spectra)) < LEAST_COHERENCE:
        what = f"{response} hardly follows {column}: their coherence is {agrees:.2f}"
        remedy = "check that both were recorded together, and the names of the columns"
        return [*found, Suspicion(run.name, what, remedy)]
    related = spectra.coherence > spectra.exceeded_by_chance(LEVEL)
    size = np.where(related, np.abs(spectra.across) / np.where(related, spectra.command, 1.0), np.nan)
    if (peak := _highest_peak(spectra.frequencies, size)) and FEWEST_PER_PERIOD * peak[0] * run.period > 1:
        what = f"{response} rings at about {units.hertz(peak[0], 2)} and is sampled at {units.hertz(1 / run.period, 5)}"
        found.append(Suspicion(run.name, what, f"sample {FEWEST_PER_PERIOD} times in a period or more"))
    timing = timing_of(run, response)
    if timing == "early":
        what = (
            f"{response} answers {column} before it changes: the columns are shifted by a sample, or {column} is no "
            f"command but follows from {response}, as in a closed loop"
        )
        remedy = "check the trigger; shift one of the columns by a row; write closed_loop = true where it was closed"
        found.append(Suspicion(run.name, what, remedy))
    elif timing == "held" and not run.between_is_stated:
        what = f"{response} answers {column} half a sample later than straight lines between its samples make it"
        remedy = 'the command was held: write between_samples = "hold" in measurements.toml; else it looks late'
        found.append(Suspicion(run.name, what, remedy))
    return found


def _spectra(run: Run, response: str, column: str) -> CrossSpectra | None:
    """Return the spectra of a command and a response; None of one at rest, a short record or one with many gaps."""
    command, values, length = run.columns[column], run.columns[response], len(run.time) // SEGMENTS
    if not np.ptp(command) or np.isfinite(values).mean() < 0.9 or length < FEWEST_PER_PERIOD:
        return None
    return cross_spectra([(command, values - np.nanmean(values))], run.period, length)


def _coherence(run: Run, response: str, column: str, spectra: CrossSpectra) -> float:
    """Return how much of a response follows its command linearly: the mean coherence, weighted by the command's power.

    Or the square of their correlation, if that is more: each segment of a slow ramp is little but the steps of a
    converter.
    """
    there = np.isfinite(run.columns[response])
    command, values = run.columns[column][there], run.columns[response][there]
    correlation = np.corrcoef(command, values)[0, 1] if np.ptp(command) * np.ptp(values) else 0.0
    weighted = spectra.command @ np.nan_to_num(spectra.coherence) / spectra.command.sum()
    return float(max(weighted, correlation**2))


def _of_outliers(run: Run, response: str) -> list[Suspicion]:
    if not len(samples := outliers(run, response)):
        return []
    values, si = run.columns[response][samples], run.si[response]
    unit = f"u{si}" if si in ("m", "rad") else si
    said = " to ".join(dict.fromkeys(f"{end / units.factor(unit, si):.5g}" for end in (values.min(), values.max())))
    what = (
        f"{response} jumps to {said} {unit} and back in {len(samples)} sample{'s' if len(samples) > 1 else ''}, the "
        f"first at {run.time[samples[0]]:.6g} s, while no command jumps: these are no motion"
    )
    remedy = "leave their cells empty; if the sensor writes that beyond its range, state its range in measurements.toml"
    return [Suspicion(run.name, what, remedy)]


def of_noise(response: str, noise: NoiseFloor) -> list[Suspicion]:
    """Return what is suspicious of the noise of a response."""
    found = [Suspicion("", f"noise of {response}: {remark}", "") for remark in noise.remarks]
    if not noise.known:
        what = f"the noise of {response} is unknown, as no part of the recordings shows it alone"
        remedy = 'record a quiet stretch or one command twice, or write noise = "3 nm" in measurements.toml'
        return [*found, Suspicion("", what, remedy)]
    for name in noise.rms:
        density = noise.whitening.process(name).density(np.array([0.15, 0.45]), 1.0)
        if (share := float(density[1] / density[0])) < FILTERED_NOISE:
            what = f"the noise of {response} is filtered: near the Nyquist frequency its density falls to {share:.2g}"
            remedy = "switch filters and averaging off, or give the sensor its bandwidth in the model: filters delay"
            return [*found, Suspicion(name, what, remedy)]
    return found


def of_response(response: FrequencyResponse) -> list[Suspicion]:
    """Return what is suspicious of a frequency response."""
    remarks = (remark for remark in response.remarks if "lines outside of" not in remark)  # somebody chose that
    found = [Suspicion(response.name, remark, "") for remark in remarks]
    if response.coherence is None:
        remedy = "record the coherence and the number of averages: they determine the noise of each line"
        found.append(Suspicion(response.name, "has no coherence", remedy))
    else:
        if share := float(np.mean(response.coherence < LEAST_COHERENCE)):
            what = f"{100 * share:.0f} % of its lines have a coherence below {LEAST_COHERENCE:g}"
            found.append(Suspicion(response.name, what, "average longer, or drive harder"))
        if response.averages is None:
            remedy = "write averages = ... for it in measurements.toml: with the coherence it determines the noise"
            found.append(Suspicion(response.name, "nobody says how many averages it is the mean of", remedy))
    step = float(np.median(np.diff(response.frequencies)))
    peak = _highest_peak(response.frequencies, np.abs(response.response))
    if peak and peak[1] < 3 * step:
        at, width, apart = units.hertz(peak[0]), units.hertz(peak[1], 3), units.hertz(step, 3)
        what = f"its peak at {at} is {width} wide, its lines are {apart} apart"
        found.append(Suspicion(response.name, what, "measure more lines about the peak: damping is read from them"))
    return found


def _highest_peak(frequencies: Array, size: Array) -> tuple[float, float] | None:
    """Return frequency and width of the highest peak; None if it does not fall to half the power on both sides."""
    if np.isnan(size).all():
        return None
    top = int(np.nanargmax(size))
    left, right = next((a, b) for a, b in stretches(size >= size[top] / np.sqrt(2)) if a <= top < b)
    if left == 0 or right == len(size) or np.isnan(size[[left - 1, right]]).any():
        return None
    return float(frequencies[top]), float(frequencies[right] - frequencies[left - 1])


# --- outliers --------------------------------------------------------------------------------------------------------


def outliers(run: Run, response: str) -> Places:
    """Return the samples of a response that jump away from those around them and back, while no command jumps.

    Codes for overrange and lost bits do that.

    >>> t = np.arange(400) * 1e-3
    >>> x = np.sin(9 * t) + np.where(np.abs(t - 0.2) < 1.5e-3, 50, 0)
    >>> outliers(Run("a", t, {"u": t, "x": x}, {"u": "V", "x": "m"}), "x")
    array([199, 200, 201])
    """
    there = np.flatnonzero(np.isfinite(run.columns[response]))
    reading = run.columns[response][there]
    steps, sizes = np.diff(reading), np.abs(np.diff(reading))
    if not sizes.any():
        return there[:0]
    smallest = float(sizes[sizes > 0].min())  # the resolution, where readings have one
    jumps = np.flatnonzero(sizes > max(BEYOND * smallest, JUMP * np.ptp(reading)))
    found = [there[:0]]
    for away, back in pairwise(jumps.tolist()):
        if back - away <= FEWEST_SAMPLES and steps[away] * steps[back] < 0:
            first, last = max(away - FEWEST_SAMPLES, 0), back + 1 + FEWEST_SAMPLES
            around = max(sizes[first:away].max(initial=0.0), sizes[back + 1 : last].max(initial=0.0))
            stands_out = min(sizes[away], sizes[back]) > BEYOND * around
            if stands_out and not _is_driven(run, there[first], there[back]):
                found.append(there[away + 1 : back + 1])
    return np.concatenate(found)


def _is_driven(run: Run, first: int, last: int) -> bool:
    """Tell whether a command jumps from `first` to `last`: by a share of its span, and as it does not all the time."""
    commands = [run.columns[name] for name in run.commands]
    changes = [np.abs(np.diff(command[first : last + 2])) for command in commands]
    spans = zip(changes, commands, strict=True)
    return any(size.max() > max(JUMP * np.ptp(command), BEYOND * np.median(size)) for size, command in spans)

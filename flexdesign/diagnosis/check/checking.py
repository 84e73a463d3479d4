"""The check of recordings: their contents, what is suspicious, and the effects a diagnosis can identify."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexdesign.core.errors import InputError
from flexdesign.diagnosis.check import coverage, suspicion
from flexdesign.diagnosis.check.coverage import Coverage
from flexdesign.diagnosis.check.suspicion import Suspicion
from flexdesign.diagnosis.check.tables import TableFacts
from flexdesign.diagnosis.preparation.dataset import usual_tolerance
from flexdesign.diagnosis.preparation.spectra import oversampling_of
from flexdesign.dynamics.axis.axis_run import measured_stroke
from flexdesign.measurements.noise_level.noise_floor import NoiseFloor, noise_floor
from flexdesign.measurements.recordings import FrequencyResponse, Run, split


@dataclass(frozen=True)
class Channel:
    """One column of a recording.

    Parameters
    ----------
    name, si
        Its name and its SI unit.
    low, high
        Smallest and largest value, SI.
    missing
        Share of samples without a value.
    noise
        Standard deviation, SI; None where it is unknown or the column is no response.
    """

    name: str
    si: str
    low: float
    high: float
    missing: float = 0.0
    noise: float | None = None


@dataclass(frozen=True)
class Recorded:
    """One recording as it is.

    Parameters
    ----------
    name
        Of the recording.
    kind
        What somebody said it is; empty if nobody did.
    kinds
        Which kinds of experiment it is, as found.
    role
        ``identify``, ``validate`` or ``test``; with both for one that is split in blocks.
    samples
        How many samples, or lines of a frequency response.
    rate
        Samples per second; of a frequency response zero.
    seconds
        How long it is; of a frequency response zero.
    channels
        What was recorded.
    band
        Lowest and highest frequency of a frequency response [Hz]; None of a run.
    """

    name: str
    kind: str
    kinds: tuple[str, ...]
    role: str
    samples: int
    rate: float
    seconds: float
    channels: tuple[Channel, ...]
    band: tuple[float, float] | None = None


@dataclass(frozen=True)
class Check:
    """What was found.

    Parameters
    ----------
    recordings
        What is there.
    suspicions
        What may be wrong, in order of the recordings.
    shown
        Which effects of the catalogue the recordings can reveal, and which not.
    noise
        Where the noise of each response was taken from, in words.
    tables
        Static tables, each with what is suspicious about it.
    data
        The runs and frequency responses themselves.
    """

    recordings: tuple[Recorded, ...]
    suspicions: tuple[Suspicion, ...]
    shown: tuple[Coverage, ...]
    noise: dict[str, str]
    tables: tuple[TableFacts, ...] = ()
    data: tuple[Run | FrequencyResponse, ...] = ()

    @property
    def hidden(self) -> tuple[str, ...]:
        """Effects that the recordings cannot reveal."""
        return tuple(each.effect for each in self.shown if not each.kinds)


def check(recordings: Sequence[Run | FrequencyResponse], tables: Sequence[TableFacts] = ()) -> Check:
    """Return the contents of recordings, what is suspicious, and the effects a diagnosis can identify.

    Parameters
    ----------
    recordings
        Runs and frequency responses.
    tables
        What static tables hold.

    Raises
    ------
    InputError
        If there is no recording and no table.
    """
    if not recordings and not tables:
        raise InputError("command line", "RUNS", None, "name at least one recorded run")
    runs = [each for each in recordings if isinstance(each, Run)]
    responses = [each for each in recordings if isinstance(each, FrequencyResponse)]
    parts = split(runs, test=True) if runs else ()
    suspicions = suspicion.of_runs(runs, parts)
    floors = dict[str, NoiseFloor]()
    for axis in dict.fromkeys(axis for run in runs for axis in run.responses):
        there = [run for run in runs if axis in run.columns]
        floors[axis] = noise = noise_floor(there, axis)
        suspicions += suspicion.of_noise(axis, noise)
        level = min(noise.rms.values()) if noise.known else None
        if found := oversampling_of(there, axis, usual_tolerance(measured_stroke(there, axis), level)):
            suspicions.append(Suspicion("", *found))
    suspicions += [each for response in responses for each in suspicion.of_response(response)]
    suspicions += [*_of_all(runs, parts), *(each for table in tables for each in table.suspicions)]
    kinds = dict.fromkeys(kind for each in recordings for kind in coverage.kinds_of(each))
    return Check(
        tuple(_run(each, parts, floors) if isinstance(each, Run) else _lines(each) for each in recordings),
        tuple(dict.fromkeys(suspicions)),
        coverage.coverage(list(kinds)) if recordings else (),
        {axis: noise.source if noise.known else "unknown" for axis, noise in floors.items()},
        tuple(tables),
        tuple(recordings),
    )


def _run(run: Run, parts: Sequence[Run], floors: dict[str, NoiseFloor]) -> Recorded:
    channels = []
    for name, values in run.columns.items():
        there = values[np.isfinite(values)]
        noise = floors[name].rms.get(run.name) if name in floors and floors[name].known else None
        low, high = (float(there.min()), float(there.max())) if len(there) else (float("nan"), float("nan"))
        channels.append(Channel(name, run.si[name], low, high, 1 - len(there) / len(values), noise))
    role = " and ".join(part.role for part in parts if part.record == run.name)
    kinds, seconds = coverage.kinds_of(run), float(run.time[-1] - run.time[0])
    return Recorded(run.name, run.kind, kinds, role, len(run.time), 1 / run.period, seconds, tuple(channels))


def _lines(response: FrequencyResponse) -> Recorded:
    size = np.abs(response.response[response.present])
    unit = "1" if response.si == "V" else f"{response.si}/V"
    channel = Channel(f"response of {response.axis or 'the axis'}", unit, float(size.min()), float(size.max()))
    band = (float(response.frequencies[0]), float(response.frequencies[-1]))
    count = len(response.frequencies)
    return Recorded(response.name, response.kind, ("multisine",), response.role, count, 0.0, 0.0, (channel,), band)


def _of_all(runs: Sequence[Run], parts: Sequence[Run]) -> list[Suspicion]:
    """Return what is suspicious of runs together."""
    found = []
    if runs and all(part.role == "identify" for part in parts):
        remedy = (
            'record a second run, or state role = "validate" for one: a model is validated on runs that were not fitted'
        )
        found.append(Suspicion("", "no run can be kept for validation", remedy))
    for name in dict.fromkeys(name for run in runs for name in run.commands):
        moving = [run for run in runs if name in run.commands and np.ptp(run.columns[name]) > 0]
        sizes = sorted(float(np.ptp(run.columns[name])) for run in moving)
        has_steps = any("staircase" in coverage.kinds_of(run) for run in moving)  # of several sizes
        if sizes and len(runs) > 1 and sizes[-1] < 1.5 * sizes[0] and not has_steps:
            low, high = f"{sizes[0]:.4g}", f"{sizes[-1]:.4g}"
            size = f"one size, {high}" if low == high else f"nearly one size, {low} to {high}"
            remedy = "record the same command small and large: nonlinear effects show in the difference"
            found.append(Suspicion("", f"{name} has {size} V peak to peak", remedy))
    return found

"""Which kinds of experiment recordings are, and which effects of the catalogue these can reveal.

The kinds are those of `KIND_WORDS` in `experiment_design.effect_strength`, by which the catalogue says what reveals an
effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexdesign import effects
from flexdesign.core.arrays import Array, Flags
from flexdesign.diagnosis.experiment_design.effect_strength import KIND_WORDS, names_kind
from flexdesign.diagnosis.experiment_design.experiments import STEP_HOLD, WARMING
from flexdesign.measurements.noise_level.sources import fewest_samples
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.measurements.recordings.command_segments import JUMP, RECORD_PARTS, jumps, rests

#: The ends of the band that holds nine tenths of the power of a multisine, or of noise, have at least this ratio.
BROAD_RATIO = 4.0
#: What the catalogue calls each kind, in words of the result.
KIND_TEXTS = {
    "quiet": "a quiet stretch",
    "steps": "steps",
    "multisine": "a broad band of frequencies",
    "triangle": "a slow command that turns",
    "staircase": "several levels, with motion about them",
    "hold": f"a step held for {STEP_HOLD:.0f} s or more",
    "push": "a force on the stage",
    "temperature": f"a change of temperature of {WARMING:g} K",
    "other axis": "another axis driven",
}


@dataclass(frozen=True)
class Coverage:
    """Whether recordings can reveal an effect.

    Parameters
    ----------
    effect
        Its name.
    kinds
        Kinds of experiment that are there and reveal it; empty if none does.
    lacking
        What would reveal it, in the catalogue's words.
    """

    effect: str
    kinds: tuple[str, ...]
    lacking: str = ""


def coverage(kinds: Sequence[str]) -> tuple[Coverage, ...]:
    """Return what some kinds of experiment reveal of every effect of the catalogue that acts in time."""
    found = []
    for name in effects.names():
        effect = effects.find(name)
        if effect.acts_in_time:
            there = tuple(kind for kind in KIND_WORDS if kind in kinds and names_kind(effect.reveal, kind))
            found.append(Coverage(name, there, "" if there else effect.reveal))
    return tuple(found)


def kinds_of(recording: Run | FrequencyResponse) -> tuple[str, ...]:
    """Return which kinds of experiment a recording is.

    >>> t = np.arange(2000) * 1e-3
    >>> kinds_of(Run("loop", t, {"u": np.abs(t % 1 - 0.5), "x": t}, {"u": "V", "x": "m"}))
    ('triangle',)
    """
    if isinstance(recording, FrequencyResponse):
        return ("multisine",)
    found = set()
    commands = {name: recording.columns[name] for name in recording.commands}
    if sum(np.ptp(values) > 0 for values in commands.values()) and len(recording.responses) > 1 and len(commands) > 1:
        found.add("other axis")
    for values in commands.values():
        found |= _of_command(values, recording.period)
    if _span(recording, "T") >= WARMING:
        found.add("temperature")
    if any(_span(recording, name) > 0 for name in ("f", "fx", "fy", "fz")):
        found.add("push")
    return tuple(kind for kind in KIND_WORDS if kind in found)


def _span(run: Run, column: str) -> float:
    values = run.columns.get(column, np.zeros(0))
    there = values[np.isfinite(values)]
    return float(np.ptp(there)) if len(there) else 0.0


def _of_command(values: Array, period: float) -> set[str]:
    if np.ptp(values) == 0:
        return {"quiet"} if len(values) >= fewest_samples(period) else set()
    jumped, resting = jumps(values), rests(values)
    lengths = [last - first for first, last in resting]
    rests_mostly = 2 * sum(lengths) > len(values)
    levels = {round(float(values[first:last].mean() / np.ptp(values)), 2) for first, last in resting}
    ends = [0, *(end for rest in resting for end in rest), len(values)]
    moving = max(zip(ends[::2], ends[1::2], strict=True), key=lambda part: part[1] - part[0])
    is_broad = not rests_mostly and _is_broad(values[slice(*moving)])
    longest, has_steps = max(lengths, default=0), not is_broad and bool(resting) and bool(jumped.any())
    found = {
        "quiet": longest >= fewest_samples(period),
        "steps": has_steps,
        "hold": has_steps and longest * period >= STEP_HOLD,
        "staircase": rests_mostly and len(levels) > 2,
        "multisine": is_broad,
        "triangle": not is_broad and _turns(values, jumped),
    }
    return {kind for kind, there in found.items() if there}


def _is_broad(values: Array) -> bool:
    """Tell whether a command without rests is a band of frequencies; straight lines, whose spectrum is wide, are none.

    Most squares of the second differences of straight lines lie at their corners: the kurtosis exceeds that of normal
    noise, three, by far.
    """
    power = np.cumsum(np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2)
    lowest, highest = np.searchsorted(power, [0.05 * power[-1], 0.95 * power[-1]])
    bends = np.diff(_outline(values), 2) ** 2
    is_straight = not jumps(values).any() and len(bends) * np.sum(bends**2) > 2 * 3 * np.sum(bends) ** 2
    return bool(highest >= BROAD_RATIO * max(lowest, 1)) and not is_straight


def _turns(values: Array, jumped: Flags) -> bool:
    """Tell whether a command rises and falls, apart from its jumps."""
    from scipy.signal import find_peaks

    gentle = _outline(np.cumsum(np.where(jumped, 0.0, np.diff(values))))
    return any(len(find_peaks(way * gentle, prominence=JUMP * np.ptp(values))[0]) for way in (-1, 1))


def _outline(values: Array) -> Array:
    """Return about a thousand samples of a command: of more, its rounding is a curve."""
    return values[:: max(1, len(values) // RECORD_PARTS)]

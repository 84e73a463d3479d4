"""Which kinds of experiment recordings are, and which effects of the catalogue these can reveal.

The kinds are those of `KIND_WORDS` in `experiment_design.effect_strength`, by which the catalogue says what reveals an
effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from flexdesign import effects
from flexdesign.core.arrays import Array
from flexdesign.diagnosis.experiment_design.effect_strength import KIND_WORDS, names_kind
from flexdesign.estimation.noise.autoregressive import stretches
from flexdesign.measurements.recordings import FrequencyResponse, Run

#: A command stands still where it moves by less than this share of its span, and equals another that differs by less; a
#: step moves by more than that share.
STILL_CHANGE, STEP_CHANGE = 1e-3, 0.02
#: Number of quiet samples; time [s] held after a step: a decade of creep.
QUIET_SAMPLES, STEP_HOLD = 100, 10.0
#: A spectrum this wide in octaves, at half a percent of its largest line, is that of a multisine or noise.
BROAD_OCTAVES, LINE_LEVEL = 2.0, 5e-3
#: A command is made of straight lines if, of this number of its samples, this share holds all squares of the second
#: differences but for this part. Of normal noise a tenth holds less than half. Of more samples, rounding is a curve,
#: and a slow ramp stands still.
STRAIGHT_SAMPLES, CORNERS, CURVED = 1000, 0.1, 0.02
#: Least number of samples of a rise, a fall or a rest.
STROKE_SAMPLES = 10
#: Levels at which a staircase rests; rises and falls of a slow command: one of each is a loop.
STAIRCASE_LEVELS, LOOP_STROKES = 4, 2
#: A temperature that changes by so much [K] shows what heat does.
TEMPERATURE_CHANGE = 0.5
#: What the catalogue calls each kind, in words of the result.
KIND_TEXTS = {
    "quiet": "a quiet stretch",
    "steps": "steps",
    "multisine": "a broad band of frequencies",
    "triangle": "a slow command that turns",
    "staircase": "several levels, with motion about them",
    "hold": f"a step held for {STEP_HOLD:.0f} s or more",
    "push": "a force on the stage",
    "temperature": f"a change of temperature of {TEMPERATURE_CHANGE:g} K",
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
            there = tuple(kind for kind in KIND_WORDS if kind in kinds and _reveals(kind, effect.reveal))
            found.append(Coverage(name, there, "" if there else effect.reveal))
    return tuple(found)


def _reveals(kind: str, reveal: str) -> bool:
    """Tell whether a kind of experiment reveals what the catalogue says: steps, too, make a stage ring."""
    return names_kind(reveal, kind) or (kind == "steps" and ("resonance" in reveal or "a step recorded" in reveal))


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
    if _span(recording, "T") > TEMPERATURE_CHANGE:
        found.add("temperature")
    if any(_span(recording, name) > 0 for name in ("f", "fx", "fy", "fz")):
        found.add("push")
    return tuple(kind for kind in KIND_WORDS if kind in found)


def _span(run: Run, column: str) -> float:
    values = run.columns.get(column, np.zeros(0))
    there = values[np.isfinite(values)]
    return float(np.ptp(there)) if len(there) else 0.0


def _of_command(values: Array, period: float) -> set[str]:
    span = float(np.ptp(values))
    if span == 0:
        return {"quiet"} if len(values) >= QUIET_SAMPLES else set()
    found = set()
    rests = resting(values)
    lengths = [last - first for first, last in rests]
    jumps = np.abs(np.diff(values)) > STEP_CHANGE * span
    if max(lengths, default=0) >= QUIET_SAMPLES:
        found.add("quiet")
    if lengths and 0 < np.count_nonzero(jumps) <= len(values) / 20:
        found.add("steps")
        if max(lengths) * period >= STEP_HOLD:
            found.add("hold")
    is_straight = not jumps.any() and _is_straight(values)  # corners of a triangle are no band of frequencies
    rests_mostly = sum(lengths) > 0.5 * len(values)
    if _octaves(values) >= BROAD_OCTAVES and not rests_mostly and not is_straight:
        found.add("multisine")
    levels = {round(float(np.mean(values[first:last])) / span, 2) for first, last in rests}
    if len(levels) >= STAIRCASE_LEVELS:
        found.add("staircase")
    if "multisine" not in found and _strokes(values) >= LOOP_STROKES:
        found.add("triangle")
    return found


def _is_straight(values: Array) -> bool:
    """Tell whether a command is made of straight lines: ramps, triangles of any heights, rests between them."""
    squares = np.sort(np.diff(values[:: max(1, len(values) // STRAIGHT_SAMPLES)], 2) ** 2)
    corners = max(1, int(CORNERS * len(squares)))
    return bool(squares.sum() > 0 and squares[:-corners].sum() <= CURVED * squares.sum())


def _strokes(values: Array) -> int:
    """Return how often a command rises or falls for a while, without a jump."""
    rising = np.sign(np.diff(values))
    ends = np.flatnonzero(np.diff(rising, prepend=2, append=2) != 0)
    steps = [(int(a), int(b)) for a, b in pairwise(ends) if rising[a] != 0 and b - a >= STROKE_SAMPLES]
    return sum(abs(values[b] - values[a]) > STEP_CHANGE * np.ptp(values) for a, b in steps)


def resting(values: Array) -> list[tuple[int, int]]:
    """Return first and one past the last sample of each stretch of some samples in which a command rests.

    It does so over a part of the record: a slow ramp has many samples, each near the one before.
    """
    far = len(values) // STRAIGHT_SAMPLES + 1
    window = {"size": far + 1, "origin": -((far + 1) // 2)}  # from each sample on
    spans = (maximum_filter1d(values, **window) - minimum_filter1d(values, **window))[: len(values) - far]
    found = [(first, last + far) for first, last in stretches(spans <= STILL_CHANGE * float(np.ptp(values)))]
    return [(first, last) for first, last in found if last - first > STROKE_SAMPLES]


def _octaves(values: Array) -> float:
    """Return over how many octaves a command is spread, each with a part of its power."""
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)))) ** 2
    edges = np.unique(np.geomspace(1, len(power), 2 * int(np.log2(max(len(power), 2))) + 1).astype(int))
    bands = np.add.reduceat(power, edges[edges < len(power)]) if len(power) > 1 else power
    return 0.5 * float(np.count_nonzero(bands > LINE_LEVEL * bands.sum()) - 1)

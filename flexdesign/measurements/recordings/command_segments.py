"""Segments of a command: where it jumps, where it rests, and the steps after which it rests."""

from __future__ import annotations

import numpy as np

from flexdesign.core.arrays import Array, Flags
from flexdesign.estimation.noise.autoregressive import FEWEST_SAMPLES, stretches

#: A command rests while it moves more slowly than a ramp over its whole record. Motion is compared over a thousandth of
#: the record, and the slowest ramp moves by a thousandth of the span there.
RECORD_PARTS = 1000
#: A command jumps if it changes by more than this share of its span between two samples.
JUMP = 0.02


def jumps(command: Array) -> Flags:
    """Return whether each sample of a command, from the second one on, is that after a jump."""
    return np.asarray(np.abs(np.diff(command)) > JUMP * np.ptp(command))


def rests(command: Array) -> list[tuple[int, int]]:
    """Return first and one past the last sample of each stretch in which a command rests."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    far = len(command) // RECORD_PARTS + 1
    window = {"size": far + 1, "origin": -((far + 1) // 2)}  # from each sample on
    spans = (maximum_filter1d(command, **window) - minimum_filter1d(command, **window))[: len(command) - far]
    found = [(first, last + far) for first, last in stretches(spans <= np.ptp(command) / RECORD_PARTS)]
    return [(first, last) for first, last in found if last - first >= FEWEST_SAMPLES]


def steps(command: Array) -> list[tuple[int, int, float]]:
    """Return the jumps of a command after which it rests: first index, the one after the last, and the jump [V].

    >>> steps(np.repeat([0.0, 5.0, 2.0], 30))
    [(30, 60, 5.0), (60, 90, -3.0)]
    """
    jumped = np.append(False, jumps(command))
    return [
        (first, last, float(command[first] - command[first - 1])) for first, last in rests(command) if jumped[first]
    ]

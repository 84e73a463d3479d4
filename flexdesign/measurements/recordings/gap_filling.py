"""Commands across gaps: a simulation needs them at every moment, and a few follow from their neighbours."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from flexdesign.core.arrays import Array, Flags, Places
from flexdesign.core.unit_tables import Sheet
from flexdesign.measurements.recordings.run import COMMANDS, Between
from flexdesign.measurements.recordings.time_base import fit_grid

#: A gap of this number of samples is bridged for any command.
SHORT = 3
#: A command goes straight if it varies about a line by no more than this share of its range: a recorded one has noise.
STRAIGHT = 0.01


def fill_gaps(
    sheet: Sheet, time: Array, placed: dict[str, Array], between: Between
) -> tuple[dict[str, Array], list[str]]:
    """Return columns whose commands have no gap, and remarks.

    A `SHORT` gap is bridged as the command goes between its samples. A longer one is bridged straight, if the command
    stands still or goes along one straight line before and after it, each time in as many samples: then it most likely
    did so in between.

    Raises
    ------
    InputError
        If a gap is longer.
    """
    remarks, whole = [], dict(placed)
    for name in (name for name in COMMANDS if name in placed):
        values = placed[name]
        missing = ~np.isfinite(values)
        if not missing.any():
            continue
        spans = gaps(missing)
        for first, last in spans:
            if last - first > SHORT and not _goes_straight(values, int(first), int(last)):
                row = int(np.searchsorted(sheet.moments(), time[first] - 1e-9))
                lasts = f"is missing from {time[first]:.6g} s to {time[last - 1]:.6g} s, {last - first} samples"
                remedy = f"{lasts}, in which it may have done anything; split the recording there"
                raise sheet.cell_error(min(row, len(sheet.lines) - 1), name, None, remedy)
        known = np.flatnonzero(~missing)
        whole[name] = np.interp(np.arange(len(values)), known, values[known])
        if between == "hold":
            for first, last in spans:
                if last - first <= SHORT:  # along a longer gap a held command goes straight from level to level
                    whole[name][first:last] = values[known[np.searchsorted(known, first) - 1]]
        count = int(missing.sum())
        samples = f"{count} sample{'s' if count > 1 else ''}, the first at {time[spans[0, 0]]:.6g} s"
        remarks.append(f"{name} is missing in {samples}; bridged")
    return whole, remarks


def gaps(missing: Flags) -> Places:
    """Return where each gap begins, and the place behind its end, (m, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(int))).reshape(-1, 2)


def _goes_straight(values: Array, first: int, last: int) -> bool:
    """Tell whether a command never moves, or keeps to one line for as many samples as a gap has before and after it."""
    count, span = last - first, float(np.nanmax(values) - np.nanmin(values))
    known = np.flatnonzero(np.isfinite(values))
    before, after = known[known < first][-count:], known[known >= last][:count]
    if span > 0 and min(len(before), len(after)) < count:
        return False
    about = np.concatenate([before, after])
    line = np.polynomial.Polynomial.fit(about, values[about], 1)(about) if span > 0 else values[about]
    return float(np.ptp(values[about] - line)) <= STRAIGHT * span


def recordings_apart(time: Array, commands: Sequence[Array]) -> list[slice]:
    """Return the rows of each recording in a file, which ends at a gap that no command can be bridged over.

    Data loggers that wait for a trigger, or pass their buffer on, write such files.

    Parameters
    ----------
    time
        n moments, increasing [s].
    commands
        n values of each command.

    >>> moments = np.concatenate([np.arange(50), np.arange(90, 140)]) * 1e-3
    >>> recordings_apart(moments, [np.sin(700 * moments)]), recordings_apart(moments, [np.zeros(100)])
    ([slice(0, 50, None), slice(50, 100, None)], [slice(0, 100, None)])
    """
    steps = np.diff(time)
    if not len(steps) or not (steps > 0).all():
        return [slice(0, len(time))]
    # Rows at odd times are resampled; then up to as many samples lie between two rows as there are periods.
    missing = np.rint(steps / np.median(steps)) - (fit_grid(time) is not None)
    ends = [0]
    for row in (np.flatnonzero(missing > SHORT) + 1).tolist():
        count = int(missing[row - 1])
        # The gap takes up no rows; as many as are missing before and after it are to go straight.
        padded = (np.insert(values, row, np.full(min(count, len(values)), np.nan)) for values in commands)
        if not all(_goes_straight(values, row, row + min(count, len(time))) for values in padded):
            ends.append(row)
    return [slice(first, last) for first, last in pairwise([*ends, len(time)])]

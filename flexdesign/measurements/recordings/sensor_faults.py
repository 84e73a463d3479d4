"""Sensor faults: readings pinned at the end of their range, or stuck while the command moves.

A reading that repeats itself proves nothing: a coarse sensor repeats at every turn of the motion, and a perfect one
while the stage rests. So a plateau, a stretch of equal readings, is taken for a fault only if neither explains it:

- While the command moves, and not only at the end, as it does after a rest while the response is still to follow, the
  reading must have moved on both sides of the plateau by many of its smallest steps. At the turn of a smooth motion it
  cannot: a parabola that stays within one step q for n samples is at most 9 q away within the n samples before and
  after.
- While all commands stand still, the reading must move again by several steps before a command does: a stage that has
  come to rest has no reason to. (That it is quieter than elsewhere says nothing: elsewhere it may ring.)

What moves in hops of its own, a stage that sticks and slips under a sensor without noise, would be mistaken for a
sensor that sticks if it waited for `MANY` samples and `SHARE` of its span; noise of one step distinguishes them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.unit_tables import Sheet
from flexdesign.measurements.recordings.run import AXES, COMMANDS, Sensor, commanded_by

Mask = NDArray[np.bool_]
#: Fewest equal readings in a row that can be a fault: at the extreme of the record, and elsewhere.
FEW, MANY = 3, 20
#: What counts as many of the sensor's smallest steps; 9 are natural at the turn of a motion.
STEPS = 20
#: What counts as a movement of the command: it would move the response by this share of its span.
SHARE = 0.01
#: A command stands still where it changes by less than this share of its span from one sample to the next.
STILL = 1e-5
#: Noise of which a reading cannot repeat itself many times: median change between this number of readings, in smallest
#: steps.
NOISY, RESUMED = 2.0, 5


def mask_faults(sheet: Sheet, sensors: Mapping[str, Sensor]) -> tuple[Sheet, list[str]]:
    """Return a sheet with NaN where a response cannot be believed, and remarks that name what was found, and where.

    Parameters
    ----------
    sheet
        Rows in the order of time.
    sensors
        By column; a range that is stated is believed.

    Raises
    ------
    InputError
        If the only response never changes although its command moves, or none of it can be believed.
    """
    values, remarks = dict(sheet.values), list[str]()
    responses = [name for name in AXES if name in values]
    resting = _resting([values[name] for name in COMMANDS if name in values])
    for name in responses:
        reading, column = values[name], commanded_by(name, values)
        missing = ~np.isfinite(reading)
        if missing.any():
            remarks.append(f"{name} is missing in {sheet.where(missing)}")
        command = values[column] if column else np.zeros(len(reading))
        if missing.all():
            raise InputError(sheet.path, f"column {name}", None, "has no reading at all; remove the column")
        if _span(reading) == 0 and len(reading) >= MANY:
            if _span(command) == 0:
                continue
            stuck = f"reads {reading[~missing][0]:.6g} {sheet.si[name]} in every row while {column} moves"
            if not any(other in values for other in responses if other != name):
                raise InputError(sheet.path, f"column {name}", None, f"{stuck}; check the sensor and its connection")
            remarks.append(f"{name} {stuck}; left out")
            del values[name]
            continue
        found = _find_faults(reading, command, resting, sensors.get(name, Sensor()).range)
        for what, rows in found.items():
            if rows.any():
                remarks.append(f"{name} {what} in {sheet.where(rows)}; not used there")
                values[name] = np.where(rows, np.nan, values[name])
                values[name].setflags(write=False)
        if not np.isfinite(values[name]).any():
            raise InputError(sheet.path, f"column {name}", None, f"has no reading that can be used: {remarks[-1]}")
    return Sheet(sheet.path, values, sheet.si, sheet.unit, sheet.lines, sheet.counted), remarks


def _span(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(np.ptp(known)) if len(known) else 0.0


def _resting(commands: Sequence[Array]) -> Mask:
    """Tell between which rows and the next no command changes."""
    return np.all([np.abs(np.diff(each)) <= STILL * _span(each) for each in commands], axis=0)


def _find_faults(reading: Array, command: Array, resting: Mask, span: tuple[float, float] | None) -> dict[str, Mask]:
    """Return by what is wrong where it is."""
    step = _smallest_step(reading)
    low, high = float(np.nanmin(reading)), float(np.nanmax(reading))
    beyond = np.zeros(len(reading), dtype=bool)
    if span:
        near = min(step, 1e-6 * (span[1] - span[0]))
        beyond = (reading >= span[1] - near) | (reading <= span[0] + near)
    found = {"is at the end of its range": beyond, "is saturated": np.zeros_like(beyond), "is stuck": beyond & False}
    for first, last in _plateaus(reading):
        if beyond[first]:
            continue
        ignored = _ignores(reading, command, first, last, step)
        if ignored or (last - first >= MANY and _resumes(reading, resting, first, last, step)):
            found["is saturated" if reading[first] in (low, high) else "is stuck"][first:last] = True
    return found


def _ignores(reading: Array, command: Array, first: int, last: int, step: float) -> bool:
    """Tell whether the equal readings first, ... last - 1 are no turn of a motion although the command moves."""
    count, total = last - first, _span(command)
    # At the start of the record nothing states how long the command has rested.
    driven = command[first : last - (count // 2 if first else 3 * count // 4)]
    if total == 0 or not np.isfinite(driven).all() or len(driven) < 2:
        return False
    expected = _span(reading) * _span(driven) / total
    sides = (reading[max(first - count, 0) : first], reading[last : last + count])
    away = [float(np.nanmax(np.abs(s - reading[first]))) for s in sides if np.isfinite(s).any()]
    return expected > max(STEPS * step, SHARE * _span(reading)) and min(away, default=0.0) > STEPS * step


def _resumes(reading: Array, resting: Mask, first: int, last: int, step: float) -> bool:
    """Tell whether the reading moves again after the equal readings first, ... last - 1 while the commands rest on."""
    after = np.abs(np.diff(reading[last - 1 : last + RESUMED]))
    rests = resting[first : last + RESUMED - 1]
    return len(after) == RESUMED and bool(rests.all()) and bool(np.median(after) > NOISY * step)


def _plateaus(reading: Array) -> list[tuple[int, int]]:
    """Return first and one past the last row of each stretch of equal readings that is long enough to be a fault."""
    ends = np.concatenate([[0], np.flatnonzero(reading[1:] != reading[:-1]) + 1, [len(reading)]])
    length = np.diff(ends)
    extreme = np.isin(reading[ends[:-1]], (np.nanmin(reading), np.nanmax(reading)))
    chosen = (length >= np.where(extreme, FEW, MANY)) & np.isfinite(reading[ends[:-1]])
    return [(int(ends[k]), int(ends[k + 1])) for k in np.flatnonzero(chosen)]


def _smallest_step(reading: Array) -> float:
    """Return the step of which small changes from one reading to the next are multiples; zero if there is none."""
    changes = np.abs(np.diff(reading))
    changes = changes[changes > 1e-12 * float(np.nanmax(np.abs(reading)))]
    if not len(changes):
        return 0.0
    multiples = changes[changes < 8.5 * changes.min()] / changes.min()
    # Of numbers that are no multiples three in ten would pass for some.
    return float(changes.min()) if np.mean(np.abs(multiples - np.rint(multiples)) < 0.15) > 0.9 else 0.0

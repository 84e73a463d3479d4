"""The clock of a recording: rows that come twice, late, out of order or at odd times, brought to a uniform time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.arrays import Array
from flexdesign.core.unit_tables import Sheet
from flexdesign.measurements.recordings.run import COMMANDS, Between

#: How far a time may lie from its place on the uniform grid, in periods.
UNIFORM = 1e-3
#: Rows that are farther apart than this have a gap between them, in periods; responses are not read across it.
GAP = 2.0
#: Rows are lost one by one no more often than this; more of them are no rows lost but times that are rounded.
RARE = 0.1
#: A record is no longer than this multiple of all its rows at their median period; else its times cannot be right.
LONGEST = 10.0
#: Rows that are closer than this are at one time, in periods.
SAME = 1e-9
#: The share of the resampled times at which there may be no reading.
MOSTLY = 0.5


def in_order(sheet: Sheet) -> tuple[Sheet, list[str]]:
    """Return a sheet whose time increases: rows that are exact copies left out, rows out of order sorted; and remarks.

    Rows are sorted only where they then stand on a uniform time. Anything else is two recordings in one file or a
    clock that was set back, and nobody can know which readings belong together.

    Raises
    ------
    InputError
        If time runs backwards or stands still in another way.
    """
    time = sheet.moments()
    if (np.diff(time) > 0).all():
        return sheet, []
    remarks, written = list[str](), len(time)
    table = np.ascontiguousarray(np.stack(list(sheet.values.values()), axis=1))
    # Compared by their bits, so that a gap equals a gap.
    _, first = np.unique(table.view([("", np.void, table.itemsize * table.shape[1])]).ravel(), return_index=True)
    copies = np.ones(len(time), dtype=bool)
    copies[first] = False
    if copies.any():
        remarks.append(f"{sheet.where(copies)}: copies of earlier rows; left out")
        sheet = sheet.rows(~copies)
        time = sheet.moments()
    if (np.diff(time) > 0).all():
        return sheet, remarks
    order = np.argsort(time, kind="stable")
    if not (np.diff(time[order]) > 0).all() or fit_grid(time[order]) is None:
        _refuse_rounded(sheet, written)
        sheet.time()  # refuses, and names the row
    remarks.append(f"{sheet.where(time < np.maximum.accumulate(time))}: out of order; sorted by time")
    return sheet.rows(order), remarks


def _refuse_rounded(sheet: Sheet, written: int) -> None:
    """Raise the error of times with too few digits: they never fall, and many rows have that of the row before.

    `written` is the number of rows with copies, which are samples as well where times are rounded.
    """
    time = sheet.moments()
    steps = np.diff(time)
    equal = np.flatnonzero(steps == 0)
    if (steps < 0).any() or len(equal) <= RARE * len(steps) or len(equal) == len(steps):
        return
    rate = f"{float(f'{(written - 1) / (time[-1] - time[0]):.3g}'):g} Hz"
    remedy = f"is that of the row before, as in {len(equal)} rows of {len(time)}: the time is rounded; write it with "
    remedy += f'more digits, or import without it and give the sampling rate in the map: rate = "{rate}"?'
    row = int(equal[0]) + 1
    raise sheet.cell_error(row, "t", f"{time[row]:.9g} s", remedy)


@dataclass(frozen=True, eq=False)
class Grid:
    """A uniform time, and where the rows of a sheet stand on it.

    Parameters
    ----------
    time
        n moments, uniform [s].
    index
        The sample at which each row stands; None where rows lie between samples, and readings are interpolated.
    rounded
        The last digit of the written times [s], where it hides that they are uniform; zero otherwise.
    """

    time: Array
    index: NDArray[np.intp] | None
    rounded: float = 0.0


def fit_grid(time: Array) -> Grid | None:
    """Return the uniform time on which moments stand, some of which may be missing; None if there is none.

    Moments may be off by `UNIFORM`, or by half the last digit with which they are written.

    >>> fit_grid(np.array([0.0, 0.1, 0.2, 0.5])).index
    array([0, 1, 2, 5])
    """
    median_step = float(np.median(np.diff(time)))
    if not _is_one_record(time, median_step):
        return None
    digit = _last_digit(time)
    counted = np.arange(len(time))
    lost = np.concatenate([[0], np.cumsum(np.maximum(np.rint(np.diff(time) / median_step), 1.0))]).astype(np.intp)
    few = np.mean(np.diff(lost) > 1) <= RARE
    exact, written = UNIFORM * median_step, 0.51 * digit  # half a digit, and a little for the arithmetic
    # Times in whole periods fit as exactly as rounded ones with many rows lost: that is the last explanation.
    explanations = [(counted, exact), *([(lost, exact)] if few else []), (counted, written), (lost, written)]
    for index, most in [*explanations, (lost, exact)]:
        period, start = np.polyfit(index - index.mean(), time, 1)
        off = 0.5 * float(np.ptp(time - (start + period * (index - index.mean()))))
        if off <= most:
            if index is counted and off <= exact:
                return Grid(time, index)
            made = start + period * (np.arange(index[-1] + 1) - index.mean())
            return Grid(made, index, digit if off > exact else 0.0)
    return None


def _is_one_record(time: Array, median_step: float) -> bool:
    """Tell whether the moments of a record are as many as its length asks for, but for some that are missing."""
    return bool(time[-1] - time[0] <= LONGEST * len(time) * median_step)


def grid_of(sheet: Sheet) -> tuple[Grid, list[str]]:
    """Return the uniform time of a sheet, at the median period where its rows are irregular, and remarks.

    Raises
    ------
    InputError
        If a gap is longer than all rows together, all gaps together are much longer, or two rows are at one time.
    """
    time = sheet.time()
    steps = np.diff(time)
    median_step, row = float(np.median(steps)), int(np.argmax(steps)) + 1
    if steps[row - 1] > len(time) * median_step or not _is_one_record(time, median_step):
        apart = f"comes {steps[row - 1]:.6g} s after the row before, where {median_step:.6g} s is usual"
        raise sheet.cell_error(row, "t", f"{time[row]:.9g} s", f"{apart}; split the file there into two recordings")
    if steps.min() < SAME * median_step:
        row = int(np.argmin(steps)) + 1
        apart = f"comes {steps[row - 1]:.3g} s after the row before, where {median_step:.6g} s is usual"
        raise sheet.cell_error(row, "t", f"{time[row]:.9g} s", f"{apart}; remove one of the two")
    grid = fit_grid(time)
    if grid is None:
        made = time[0] + median_step * np.arange(int((time[-1] - time[0]) / median_step + 1e-9) + 1)
        farthest = sheet.where(np.array([row]))
        remark = f"rows are {steps.min():.4g} s to {steps.max():.4g} s apart, farthest before {farthest}"
        return Grid(made, None), [f"{remark}; resampled to {median_step:.6g} s"]
    remarks = []
    if grid.rounded:
        period = grid.time[1] - grid.time[0]
        remarks.append(f"times are rounded to {grid.rounded:.0e} s; taken as uniform, {period:.6g} s apart")
    assert grid.index is not None
    late = np.concatenate([[False], np.diff(grid.index) > 1])
    if late.any():
        lost = len(grid.time) - len(time)
        remarks.append(f"{lost} row{'s are' if lost > 1 else ' is'} missing before {sheet.where(late)}")
    return grid, remarks


def on_grid(sheet: Sheet, grid: Grid, between: Between) -> dict[str, Array]:
    """Return every column at the moments of a grid, NaN where there is nothing to take it from.

    Where rows lie between samples, readings are interpolated by cubic splines, commands as they went between their
    samples: a straight line between rows would flatten what moves fast, by (w h)^2 / 8 of a sine of frequency w.

    Raises
    ------
    InputError
        If that leaves most of a column without a value.
    """
    placed = {}
    for name, values in sheet.values.items():
        if name == "t":
            continue
        if grid.index is not None:
            placed[name] = np.full(len(grid.time), np.nan)
            placed[name][grid.index] = values
        else:
            there = np.isfinite(values)
            hold = between == "hold" and name in COMMANDS
            placed[name] = _resample(sheet.moments()[there], values[there], grid.time, hold, name in COMMANDS)
            if there.mean() > MOSTLY > np.isfinite(placed[name]).mean():
                remedy = f"is too irregular: most rows are farther than {GAP:g} median periods apart; record it again"
                raise sheet.cell_error(0, "t", None, remedy)
    return placed


def _resample(rows: Array, values: Array, time: Array, hold: bool, straight: bool) -> Array:
    if not len(rows):
        return np.full(len(time), np.nan)
    before = np.clip(np.searchsorted(rows, time, side="right") - 1, 0, max(len(rows) - 2, 0))
    step = GAP * (time[1] - time[0])
    near = 1e-9 * step
    inside = (time >= rows[0] - near) & (time <= rows[-1] + near)
    if len(rows) > 1:
        inside &= np.diff(rows)[before] <= step
    if hold:
        found = values[np.clip(np.searchsorted(rows, time + near, side="right") - 1, 0, None)]
    elif straight:
        found = np.interp(time, rows, values)
    else:
        found = _interpolate(rows, values, time, step)
    return np.where(inside, found, np.nan)


def _interpolate(rows: Array, values: Array, time: Array, longest: float) -> Array:
    """Interpolate piece by piece, so that no curve is bent by a gap."""
    from scipy.interpolate import CubicSpline

    found = np.interp(time, rows, values)
    for piece in np.split(np.arange(len(rows)), np.flatnonzero(np.diff(rows) > longest) + 1):
        if len(piece) >= 4:
            among = (time >= rows[piece[0]]) & (time <= rows[piece[-1]])
            found[among] = CubicSpline(rows[piece], values[piece])(time[among])
    return found


def _last_digit(time: Array) -> float:
    """Return the power of ten of which all moments are multiples; zero if there is none above 1e-12 s.

    >>> _last_digit(np.array([0.25, 0.5, 12.0]))
    0.01
    """
    accuracy = 4 * np.finfo(float).eps * float(np.abs(time).max())
    for digit in 10.0 ** np.arange(0, -13, -1):
        if float(np.abs(time - digit * np.rint(time / digit)).max()) <= accuracy:
            return float(digit)
    return 0.0


def trim(time: Array, placed: dict[str, Array]) -> tuple[Array, dict[str, Array], list[str]]:
    """Return time and columns from the first to the last sample at which all commands are known, and remarks."""
    known = np.flatnonzero(np.all([np.isfinite(placed[name]) for name in COMMANDS if name in placed], axis=0))
    if len(known) and known[0] == 0 and known[-1] == len(time) - 1:
        return time, placed, []
    rows = slice(int(known[0]), int(known[-1]) + 1) if len(known) else slice(0, 0)
    remark = f"the command is missing at an end: {len(time) - len(time[rows])} samples are left out"
    return time[rows], {name: values[rows] for name, values in placed.items()}, [remark]

"""Times of day in tables, ``2024-05-02 12:00:00.250``, as seconds."""

from __future__ import annotations

import re

import numpy as np

from flexdesign.core.arrays import Array

#: Seconds of a day.
DAY = 86400.0
_MOMENT = re.compile(
    r"(?:\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[T ]+)?(\d{1,2}):(\d{2})(?::(\d{2})(?:[.,:](\d{1,9}))?)?\s*([AaPp][Mm])?"
    r"(?:Z|[+-]\d{2}:?\d{2})?"
)


def seconds(cell: str) -> float:
    """Return the time of day that a cell says [s]; NaN if it says none.

    >>> seconds("2024-05-02 12:00:00.250"), seconds("02.05.2024 12:00:01,5"), seconds("12.5")
    (43200.25, 43201.5, nan)
    """
    match = _MOMENT.fullmatch(cell)
    if not match:
        return float("nan")
    hour, minute, second, fraction, half = match.groups()
    if half:
        hour = str(int(hour) % 12 + 12 * (half.lower() == "pm"))
    if int(hour) > 24 or int(minute) > 59:
        return float("nan")
    return 3600.0 * int(hour) + 60.0 * int(minute) + float(f"{second or 0}.{fraction or 0}")


def since_first(times: Array) -> Array:
    """Return times of day as seconds since the first of them [s]; a fall by more than half a day is midnight."""
    known = np.flatnonzero(np.isfinite(times))
    if not len(known):
        return times
    nights = np.cumsum(np.diff(times[known], prepend=times[known[0]]) < -DAY / 2)
    found = times.copy()
    found[known] += DAY * nights
    return found - found[known[0]]

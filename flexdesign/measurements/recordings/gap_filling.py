"""Commands across gaps: a simulation needs them at every moment, and a few follow from their neighbours."""

from __future__ import annotations

import numpy as np

from flexdesign.core.unit_tables import Sheet
from flexdesign.measurements.recordings.run import COMMANDS, Array, Between

#: A gap of this number of samples is bridged for any command.
SHORT = 3


def bridged(
    sheet: Sheet, time: Array, placed: dict[str, Array], between: Between
) -> tuple[dict[str, Array], list[str]]:
    """Return columns whose commands have no gap, and remarks.

    A gap is bridged as the command goes between its samples. It may be `SHORT`; or as long as the command stands still
    at one value before and after it, each time for as long as the gap: then it most likely stood still in between.

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
        ends = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(int)))
        for first, last in ends.reshape(-1, 2):
            if last - first > SHORT and not _stands(values, int(first), int(last)):
                row = int(np.searchsorted(sheet.moments(), time[first] - 1e-9))
                lasts = f"is missing from {time[first]:.6g} s to {time[last - 1]:.6g} s, {last - first} samples"
                remedy = f"{lasts}, in which it may have done anything; split the recording there"
                raise sheet.cell_error(min(row, len(sheet.lines) - 1), name, None, remedy)
        known = np.flatnonzero(~missing)
        if between == "hold":
            filled = values[known[np.searchsorted(known, np.arange(len(values)), side="right") - 1]]
        else:
            filled = np.interp(np.arange(len(values)), known, values[known])
        whole[name] = filled
        count = int(missing.sum())
        samples = f"{count} sample{'s' if count > 1 else ''}, the first at {time[ends[0]]:.6g} s"
        remarks.append(f"{name} is missing in {samples}; bridged")
    return whole, remarks


def _stands(values: Array, first: int, last: int) -> bool:
    """Tell whether a command stands at one value as long before as after the gap that begins at `first`."""
    around = np.concatenate([values[max(first - (last - first), 0) : first], values[last : last + (last - first)]])
    return len(around) == 2 * (last - first) and float(np.ptp(around)) == 0

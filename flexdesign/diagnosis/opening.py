"""The opening of each run: what long recordings show is mostly in their first seconds, and found there sooner.

A search fits hundreds of models, each of which is simulated over all of the runs. Where these are long it is made in
their openings first; what it finds is then fitted to the whole runs, which confirm it or refuse it, and are searched
themselves for what they still leave. Where the noise is unknown an effect is weighed by its share of what was
unexplained, and a part of the runs has shares of its own: those are searched whole.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexdesign.diagnosis.setting import Setting
from flexdesign.runs import Run

#: So many values are enough to search in; runs of fewer than so many in all are searched whole.
ENOUGH, LONG = 12_000, 40_000


def opening(setting: Setting) -> Setting | None:
    """Return the setting with its runs cut after a number of values, the same for all; None if they are not cut."""
    lengths = [len(run.time) for run in setting.runs]
    if sum(lengths) < LONG or not setting.noise.known:
        return None
    cut = _cut(lengths, ENOUGH)
    return replace(setting, runs=tuple(_opening(run, cut) for run in setting.runs))


def _cut(lengths: list[int], enough: int) -> int:
    """Return the length beyond which runs are cut, so that about `enough` values are left.

    >>> _cut([1_000, 30_000, 30_000], 21_000)
    10000
    """
    left = enough
    for place, length in enumerate(ordered := sorted(lengths)):
        if length * (len(ordered) - place) >= left:
            return max(1, left // (len(ordered) - place))
        left -= length
    return ordered[-1]


def _opening(run: Run, cut: int) -> Run:
    """Return a run up to a number of values; the first to be read there, if it begins with a gap as long."""
    read = np.flatnonzero(np.isfinite(run.measured()))
    cut = max(cut, int(read[0]) + 2 if len(read) else cut)
    columns = {name: values[:cut] for name, values in run.columns.items()}
    return replace(run, time=run.time[:cut], columns=columns)

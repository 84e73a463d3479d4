"""Windows of very long recordings, in which the effect of the next step is searched.

A search fits dozens of models, and a simulation of all values takes as long as they are many. It therefore uses
windows, more of them where the present model fails: systematic sampling with probability proportional to size (Madow
1949, Ann. Math. Statist. 20, 333-354). The size of a block is the sum of its squared residuals plus the mean of all
blocks, so that half of the windows are spread evenly. A window is simulated from its own initial state, after a lead
of the recorded command in which the mode forgets what happened before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.diagnosis.preparation.dataset import SAMPLES_SEARCHED, DiagnosisData, of_blocks
from flexdesign.measurements.recordings import Run

#: Number of values above which recordings are searched in windows: each further hundred thousand would take minutes.
VERY_LONG = 100_000
#: By these words a report finds the statement of `describe` among the remarks on a run.
SEARCHED = "effects were searched in"
#: Least length of a window [values], and in periods of the mode: a ring-down fits into it.
WINDOW, PERIODS = 1_000, 10.0


def is_very_long(data: DiagnosisData) -> bool:
    """Tell whether recordings are searched in windows."""
    return _recorded(data) > VERY_LONG


def describe(data: DiagnosisData) -> str:
    """Return what is done with very long recordings, a sentence without its full stop."""
    return (
        f"of {_recorded(data)} samples, {SEARCHED} {_count(data)} windows of {_length(data)} where the model "
        "fails most, and slow ones in all; what was found is fitted to all samples and checked on all"
    )


def windows(data: DiagnosisData, residuals: Mapping[str, Array]) -> DiagnosisData:
    """Return the data set with windows in the place of its runs, without test runs.

    Parameters
    ----------
    data
        The data set.
    residuals
        Residual of each run by its name, n values [response], NaN at gaps; without one, windows are spread evenly.
    """
    searched, chosen = [*data.of("identify"), *data.of("validate")], list[Run]()
    for runs in (data.of("identify"), data.of("validate")):
        share = _present(runs) / _present(searched)
        chosen += _sample(data, runs, residuals, max(1, round(share * _count(data)))) if runs else []
    return replace(data, runs=tuple(chosen), noise=of_blocks(data.noise, chosen))


def _recorded(data: DiagnosisData) -> int:
    """Return the number of values; the halves of one recording count once."""
    return sum(len(run.time) for run in {run.name.partition(":")[0]: run for run in data.runs}.values())


def _present(runs: Iterable[Run]) -> int:
    return int(sum(np.isfinite(run.measured()).sum() for run in runs))


def _length(data: DiagnosisData) -> int:
    """Return the number of values in a window, without its lead."""
    period = min(run.period for run in data.runs)
    return min(max(WINDOW, math.ceil(PERIODS / (data.axis.natural_frequency * period))), SAMPLES_SEARCHED // 2)


def _count(data: DiagnosisData) -> int:
    return SAMPLES_SEARCHED // _length(data)


def _sample(data: DiagnosisData, runs: Sequence[Run], residuals: Mapping[str, Array], count: int) -> list[Run]:
    """Return windows of runs at equal steps of their accumulated size."""
    length, places, sizes = _length(data), list[tuple[Run, int]](), list[float]()
    for run in runs:
        squares, there = residuals.get(run.name, np.zeros(len(run.time))) ** 2, np.isfinite(run.measured())
        for first in range(0, max(len(run.time) - length, 0) + 1, length):
            if 2 * there[first : first + length].sum() >= min(length, len(run.time)):
                places.append((run, first))
                sizes.append(float(np.nansum(squares[first : first + length])))
    if not places:
        return list(runs)
    reached = np.cumsum(np.array(sizes) + (np.mean(sizes) or 1.0))
    at = np.unique(np.searchsorted(reached, reached[-1] * (np.arange(count) + 0.5) / count))
    return [_window(data, places[k][0], places[k][1], length) for k in at]


def _window(data: DiagnosisData, run: Run, first: int, length: int) -> Run:
    """Return a window of a run, with a lead without readings."""
    lead = min(math.ceil(data.axis.settling_time / run.period), length, first)
    part = slice(first - lead, first + length)
    columns = {name: values[part].copy() for name, values in run.columns.items()}
    for name in run.responses:
        columns[name][:lead] = np.nan
    return replace(run, name=f"{run.name}:{first}", time=run.time[part], columns=columns)

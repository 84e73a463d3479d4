"""The first part of long runs: what they show is mostly there, and is found sooner.

A selection fits hundreds of models, each of which is simulated over all runs. Long runs are searched in their first
part; what is found there is fitted to the whole runs, which confirm or refuse it, and are searched for the rest. Where
the noise is unknown an effect is weighed by its share of the residual, which is another in a part of the runs: those
are searched whole.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from flexdesign.diagnosis.preparation.dataset import DiagnosisData
from flexdesign.measurements.recordings import Run

#: Number of values that are searched; runs of more than `LONG_RUNS` values in all are cut.
SAMPLES_SEARCHED, LONG_RUNS = 12_000, 40_000


def truncate(data: DiagnosisData) -> DiagnosisData | None:
    """Return the data set with its runs cut after a number of values, the same for all; None if they are not cut."""
    lengths = sorted(len(run.time) for run in data.runs)
    if sum(lengths) < LONG_RUNS or not data.noise.known:
        return None
    cut, left = 0, SAMPLES_SEARCHED
    for count, length in zip(range(len(lengths), 0, -1), lengths, strict=True):
        cut = max(1, left // count)
        if cut <= length:
            break
        left -= length
    return replace(data, runs=tuple(_part(run, cut) for run in data.runs))


def _part(run: Run, cut: int) -> Run:
    """Return a run up to a number of values; the first to be read there, if it begins with a gap as long."""
    read = np.flatnonzero(np.isfinite(run.measured()))
    cut = max(cut, int(read[0]) + 2 if len(read) else cut)
    columns = {name: values[:cut] for name, values in run.columns.items()}
    return replace(run, time=run.time[:cut], columns=columns)

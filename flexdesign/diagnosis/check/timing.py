"""The command between its samples, estimated from the response, without a model.

The response of a linear system in the next samples is a sum of its last samples and of those of the command. If the
command is held from one sample to the next, the sample at the same moment has no weight; if it goes straight to the
next one, a sixth of all, of a mass on a spring sampled fast; if the reading comes a sample too early, the sample that
is still to come has weight (Astrom and Wittenmark, Computer-Controlled Systems, 1997, chapter 2).
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from flexdesign.estimation.criterion import SHARE
from flexdesign.estimation.noise.quiet_stretches import HIGHEST_ORDER
from flexdesign.measurements.noise_level.noise_floor import STANDARD_ERRORS
from flexdesign.measurements.recordings import Run
from flexdesign.measurements.recordings.run import commanded_by

#: The reading answers a sample of the command that is still to come; the command is held, or linear, between samples.
Timing = Literal["early", "held", "linear"]


def timing_of(run: Run, response: str) -> Timing | None:
    """Return how a response follows its command; None if that is unknown, as in a closed loop.

    The sum has as many past samples as a model of noise may have; what is found must hold with a quarter of them.
    """
    found = {_timing(run, response, order) for order in (HIGHEST_ORDER // 4, HIGHEST_ORDER)}
    return found.pop() if len(found) == 1 else None


def _timing(run: Run, response: str, order: int) -> Timing | None:
    column = commanded_by(response, run.columns)
    moving = [name for name in run.commands if np.ptp(run.columns[name]) > 0]
    if column is None or run.closed_loop or moving != [column]:
        return None
    y, u = run.columns[response], run.columns[column]
    y, u = (y - np.nanmean(y)) / (np.nanstd(y) or 1.0), (u - u.mean()) / u.std()
    rows = np.arange(order, len(y) - 1)
    sent = [u[rows - k] for k in range(-1, order + 1)]
    matrix = np.column_stack([*sent, *(y[rows - k] for k in range(1, order + 1)), np.ones(len(rows))])
    usable = np.isfinite(matrix).all(axis=1) & np.isfinite(y[rows])
    matrix, target = matrix[usable], y[rows][usable]
    if len(target) < 20 * order or np.linalg.matrix_rank(matrix) < matrix.shape[1]:
        return None
    weights = np.linalg.lstsq(matrix, target, rcond=None)[0]
    variance = np.sum((target - matrix @ weights) ** 2) / (len(target) - len(weights))
    errors = STANDARD_ERRORS * np.sqrt(np.maximum(variance * np.diag(np.linalg.pinv(matrix.T @ matrix)), 0.0))
    # A smaller share of the largest weight is no finding.
    least = SHARE * np.abs(weights[: len(sent)]).max()
    coming, same, last = np.abs(weights[:3]) > np.maximum(errors[:3], least)
    if coming:
        return "early"
    if same:
        return "linear"
    return "held" if last and errors[1] < least else None

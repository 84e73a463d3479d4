"""The command between its samples, estimated from the response, without a model.

The response of a linear system in the next samples is a sum of its last samples and of those of the command. If the
command is held from one sample to the next, the sample at the same moment has no weight; if it goes straight to the
next one, a sixth of all, of a mass on a spring sampled fast; if the reading comes a sample too early, the sample that
is still to come has weight (Astrom and Wittenmark, Computer-Controlled Systems, 1997, chapter 2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.measurements.recordings import Run
from flexdesign.measurements.recordings.run import commanded_by

#: Past samples in the sum: one mode has two, and what is found must hold with more; most rows that are looked at.
MODEL_ORDERS, MOST_ROWS = (4, 8, 16), 20_000
#: A weight counts if it is this number of standard errors from zero.
CLEAR_DEVIATIONS = 6.0
#: A weight below this share of the largest is none; one of a sample still to come is above that share, as the error of
#: one that is none is below it.
ZERO_WEIGHT, NONCAUSAL_WEIGHT = 0.02, 0.1


@dataclass(frozen=True)
class Timing:
    """How a response follows its command.

    Parameters
    ----------
    ahead
        Whether the reading answers a sample of the command that is still to come.
    held
        Whether the sample of the same moment has no weight although the next one clearly has; None if unclear.
    """

    ahead: bool
    held: bool | None


def timing_of(run: Run, response: str) -> Timing | None:
    """Return how a response follows its command; None if that is unknown, as in a closed loop."""
    found = {_timing(run, response, order) for order in MODEL_ORDERS}
    return found.pop() if len(found) == 1 else None


def _timing(run: Run, response: str, order: int) -> Timing | None:
    column = commanded_by(response, run.columns)
    moving = [name for name in run.commands if np.ptp(run.columns[name]) > 0]
    if column is None or run.closed_loop or moving != [column]:
        return None
    y = run.columns[response][:MOST_ROWS]
    there = np.isfinite(y)
    if there.sum() < 50 * order or np.ptp(run.columns[column][:MOST_ROWS]) == 0 or np.ptp(y[there]) == 0:
        return None
    y = (y - np.nanmean(y)) / np.ptp(y[there])
    rows = np.arange(order, len(y) - 1)
    past = np.stack([y[rows - k] for k in range(1, order + 1)], axis=1)
    u = run.columns[column][:MOST_ROWS]
    u = (u - u.mean()) / np.ptp(u)
    sent = np.stack([u[rows - k] for k in range(-1, order + 1)], axis=1)
    matrix = np.column_stack([past, sent, np.ones(len(rows))])
    usable = np.isfinite(matrix).all(axis=1) & np.isfinite(y[rows])
    matrix, target = matrix[usable], y[rows][usable]
    if len(target) < 20 * order or np.linalg.matrix_rank(matrix) < matrix.shape[1]:
        return None
    weights, errors = _least_squares(matrix, target)
    sent_weights, sent_errors = weights[order : 2 * order + 2], errors[order : 2 * order + 2]
    clear = np.abs(sent_weights) > CLEAR_DEVIATIONS * sent_errors
    large = clear & (np.abs(sent_weights) > ZERO_WEIGHT * np.abs(sent_weights).max())
    largest = float(np.abs(sent_weights).max())
    if clear[0] and abs(sent_weights[0]) > NONCAUSAL_WEIGHT * largest:
        return Timing(True, None)
    if not large[1] and large[2]:
        return Timing(False, True if CLEAR_DEVIATIONS * sent_errors[1] < NONCAUSAL_WEIGHT * largest else None)
    return Timing(False, False if large[1] else None)


def _least_squares(matrix: Array, target: Array) -> tuple[Array, Array]:
    """Return weights of a least-squares fit, and their standard errors."""
    weights, *_ = np.linalg.lstsq(matrix, target, rcond=None)
    residual = target - matrix @ weights
    variance = float(residual @ residual) / max(len(target) - matrix.shape[1], 1)
    inverse = np.linalg.pinv(matrix.T @ matrix)
    return np.asarray(weights), np.sqrt(np.maximum(np.diag(inverse), 0.0) * variance)

"""A model without physics: how much of the residual is explainable at all, as a sum of smooth functions.

Terms are taken up one by one, each time the one that lowers the cost most (orthogonal matching pursuit: Pati, Rezaiifar
and Krishnaprasad 1993), while they lower it by more than chance does. What the model's own numbers can imitate is taken
out of them first. The sum is judged on runs that the fit did not see.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from flexdesign.core.arrays import Array, Flags
from flexdesign.core.model import Observation
from flexdesign.estimation.criterion import LEVEL
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.prediction_change import without_offset

#: Functions of what a model predicts of an observation, by name: n values each, of size one.
BasisFunctions = Callable[[Observation, Array], Mapping[str, Array]]
#: No more terms than these.
MOST_TERMS = 10
#: A function of which the model's own numbers leave less than this, in squares, is one that they can imitate.
INDEPENDENT_SHARE = 1e-4


@dataclass(frozen=True)
class SparseModel:
    """What smooth functions explain of the residual.

    Parameters
    ----------
    terms
        Amounts of the terms, in the order in which they were taken up [response].
    gain, held_gain
        Fall of the cost of what the fit saw, and of the validation runs.
    validation_rms
        How large the sum is on the validation runs, rms [response].
    shares
        Share of the fall that each term brought.
    """

    terms: Mapping[str, float]
    gain: float
    held_gain: float
    validation_rms: float
    shares: Mapping[str, float]


def sparse_model(task: EstimationTask, fit: FittedModel, features: BasisFunctions) -> SparseModel:
    """Return the sum of smooth functions that explains most of what a fitted model leaves."""
    names, parts = _columns(task.identify, fit, features)
    solution, seen = fit.solution, np.vstack(parts)
    projection, inverse = solution.project(parts), solution.covariance
    gram = seen.T @ seen - projection.T @ inverse @ projection
    predicted_gain = seen.T @ np.concatenate(solution.residuals)
    own = np.diag(gram) > INDEPENDENT_SHARE * np.sum(seen**2, axis=0)
    chosen, gains = _pursuit(gram, predicted_gain, own, float(chdtri(1, LEVEL / max(len(names), 1))))
    if not chosen:
        return SparseModel({}, 0.0, 0.0, 0.0, {})
    amounts = np.asarray(np.linalg.solve(gram[np.ix_(chosen, chosen)], predicted_gain[chosen]), dtype=np.float64)
    gain = float(amounts @ predicted_gain[chosen])
    held, rms = _held(task, fit, features, chosen, amounts, inverse @ projection[:, chosen] @ amounts)
    terms = {names[j]: float(coefficient) for j, coefficient in zip(chosen, amounts, strict=True)}
    return SparseModel(terms, gain, held, rms, {names[j]: g / sum(gains) for j, g in zip(chosen, gains, strict=True)})


def cost_of_terms(task: EstimationTask, fit: FittedModel, features: BasisFunctions, terms: Collection[str]) -> float:
    """Return chi^2 of the fitted runs if smooth functions (`terms` of them) take the place of effects.

    The own numbers of the fit, which has no effects, move along their Jacobian.
    """
    dataset = fit.solution.problem.dataset
    names, seen = _columns(dataset, fit, features)
    parts = list[Array]()
    for part in fit.solution.jacobian:
        whole = np.zeros((len(part.matrix), len(fit.solution.x)))
        whole[:, part.places] = part.matrix
        parts.append(whole)
    residual = np.concatenate(fit.solution.residuals)
    columns = np.hstack([np.vstack(parts), np.vstack(seen)[:, [name in terms for name in names]]])
    rest = without_columns(residual, columns)
    return float(rest @ rest)


def without_columns(values: Array, columns: Array) -> Array:
    """Return n values less the amounts of k columns (n by k) that explain them best."""
    lengths = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(lengths > 0, lengths, 1.0)
    return np.asarray(values - unit @ np.linalg.lstsq(unit, values, rcond=1e-10)[0])


def _columns(dataset: Dataset, fit: FittedModel, features: BasisFunctions) -> tuple[list[str], list[Array]]:
    """Return the names of smooth functions, and their whitened columns in each record."""
    names, parts = list[str](), list[Array]()
    for record in dataset.records:
        made = features(record.observation, np.asarray(fit.model.predict(record.observation)))
        names = list(made)
        parts.append(dataset.whitened_columns(record, np.column_stack(list(made.values()))))
    return names, parts


def _pursuit(gram: Array, predicted_gain: Array, own: Flags, critical_gain: float) -> tuple[list[int], list[float]]:
    chosen, gains, before = list[int](), list[float](), 0.0
    size = np.diag(gram).copy()
    for _ in range(MOST_TERMS):
        best, reached = -1, before
        for j in range(len(predicted_gain)):
            if j in chosen or not own[j]:
                continue
            trial = [*chosen, j]
            inner = gram[np.ix_(trial, trial)]
            scale = np.sqrt(size[trial])
            scaled = inner / np.outer(scale, scale)
            if np.linalg.cond(scaled) > 1e6:
                continue
            fall = float((predicted_gain[trial] / scale) @ np.linalg.solve(scaled, predicted_gain[trial] / scale))
            if fall > reached:
                best, reached = j, fall
        if best < 0 or reached - before < critical_gain:
            break
        chosen.append(best)
        gains.append(reached - before)
        before = reached
    return chosen, gains


def _held(
    task: EstimationTask, fit: FittedModel, features: BasisFunctions, chosen: list[int], amounts: Array, steps: Array
) -> tuple[float, float]:
    """Return by how much the sum lowers the cost of the validation runs, and how large it is there.

    The model's own numbers move with the sum as the fit lets them; the move of the prediction is found by a small one.
    """
    dataset = task.validate
    if not dataset.records:
        return 0.0, 0.0
    where, x, step = fit.solution.problem.where, fit.solution.x, 1e-3
    # A sum that the model's own numbers can imitate asks for moves without end: these stay where they are plausible.
    shifted = np.clip(x + step * steps, np.maximum(where.lower, x - 1.0), np.minimum(where.upper, x + 1.0))
    shared = {n: v for n, v in where.values(shifted).items() if ":" not in n}
    nudged = fit.model.replace(shared)
    gained, sizes = 0.0, {True: np.zeros(2), False: np.zeros(2)}  # squares and count, with and without weights
    for record in dataset.records:
        here = np.asarray(fit.model.predict(record.observation))
        made = list(features(record.observation, here).values())
        added = sum(coefficient * made[j] for j, coefficient in zip(chosen, amounts, strict=True))
        added = added + (np.asarray(nudged.predict(record.observation)) - here) / step
        before, after = dataset.residual(record, here), dataset.residual(record, here + added)
        if before is None or after is None:
            return 0.0, 0.0
        gained += float(before @ before - after @ after)
        free = without_offset(record, added, task.weights)
        sizes[record.observation.name in task.weights] += float(free @ free), len(free)
    return gained, max(float(np.sqrt(squares / count)) for squares, count in sizes.values() if count)

"""Sparse regression of a residual on smooth functions: an upper estimate of what can be explained without physics.

Terms are added one by one, each time the one that lowers the cost most (orthogonal matching pursuit: Pati, Rezaiifar
and Krishnaprasad 1993), while it falls by more than chance explains. The part of a function that the free parameters of
the model can imitate is projected out first. The sum is evaluated on the validation runs.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtri

from flexdesign.core.arrays import Array
from flexdesign.core.model import Observation
from flexdesign.estimation.criterion import LEVEL
from flexdesign.estimation.least_squares.dataset import DIFFERENCE_STEP, Dataset
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel
from flexdesign.estimation.model_selection.model_comparison import without_offset

#: Returns the smooth functions that act on an observation, from its prediction, by name: n values each, of size one.
BasisFunctions = Callable[[Observation, Array], Mapping[str, Array]]
#: Largest number of terms.
MOST_TERMS = 10


@dataclass(frozen=True)
class SparseModel:
    """What smooth functions explain of the residual.

    Parameters
    ----------
    terms
        Coefficients of the terms, in the order in which they were added [response].
    gain, held_gain
        Fall of the cost of the fitted runs, and of the validation runs.
    validation_rms
        Rms of the sum on the validation runs [response].
    shares
        Share of each term in the fall.
    """

    terms: Mapping[str, float]
    gain: float
    held_gain: float
    validation_rms: float
    shares: Mapping[str, float]


def sparse_model(task: EstimationTask, fit: FittedModel, features: BasisFunctions) -> SparseModel:
    """Return the sum of smooth functions that explains most of the residual of a fitted model."""
    names, parts = _columns(task.identify, fit, features)
    solution, columns = fit.solution, np.vstack(parts)
    projection, inverse = solution.project(parts), solution.covariance
    gram = columns.T @ columns - projection.T @ inverse @ projection
    predicted_gain = solution.predicted_gain(columns, projection)
    # With a smaller remainder the free parameters, and the functions that were added, can imitate a function.
    least = DIFFERENCE_STEP * np.sum(columns**2, axis=0)
    chosen, gains = _pursuit(gram, predicted_gain, least, float(chdtri(1, LEVEL / max(len(names), 1))))
    if not chosen:
        return SparseModel({}, 0.0, 0.0, 0.0, {})
    coefficients = np.asarray(np.linalg.solve(gram[np.ix_(chosen, chosen)], predicted_gain[chosen]), dtype=np.float64)
    gain = float(coefficients @ predicted_gain[chosen])
    steps = inverse @ projection[:, chosen] @ coefficients
    terms = {names[j]: float(coefficient) for j, coefficient in zip(chosen, coefficients, strict=True)}
    shares = {names[j]: fall / sum(gains) for j, fall in zip(chosen, gains, strict=True)}
    return SparseModel(terms, gain, *_validate(task, fit, features, terms, steps), shares)


def cost_of_terms(
    task: EstimationTask, fit: FittedModel, features: BasisFunctions, terms: Collection[str]
) -> tuple[float, Array]:
    """Return chi^2 of the fitted runs with smooth functions next to the model of a fit, and the step of its parameters.

    The free parameters of the fit, with those of its effects, are fitted with the functions along their Jacobian.

    Parameters
    ----------
    task, fit
        What is fitted, and the fit.
    features
        The smooth functions.
    terms
        Names of those that are fitted.
    """
    dataset, solution = fit.solution.problem.dataset, fit.solution
    names, functions = _columns(dataset, fit, features)
    parts = list[Array]()
    for part in solution.jacobian:
        whole = np.zeros((len(part.matrix), len(solution.x)))
        whole[:, part.places] = part.matrix
        parts.append(whole)
    residual = solution.residual
    columns = np.hstack([np.vstack(parts), np.vstack(functions)[:, [name in terms for name in names]]])
    weights = _least_squares(residual, columns)
    rest = residual - columns @ weights
    return float(rest @ rest), -weights[: len(solution.x)]


def without_columns(values: Array, columns: Array) -> Array:
    """Return n values less their least-squares fit by k columns (n by k)."""
    return np.asarray(values - columns @ _least_squares(values, columns))


def _least_squares(values: Array, columns: Array) -> Array:
    """Return the k weights of columns of any size, n by k, that fit n values best."""
    lengths = np.linalg.norm(columns, axis=0)
    lengths = np.where(lengths > 0, lengths, 1.0)
    return np.asarray(np.linalg.lstsq(columns / lengths, values, rcond=1e-10)[0] / lengths)


def _columns(dataset: Dataset, fit: FittedModel, features: BasisFunctions) -> tuple[list[str], list[Array]]:
    """Return the names of smooth functions, and their whitened columns in each record; zero where they do not act."""
    records = dataset.records
    functions = [features(r.observation, np.asarray(fit.model.predict(r.observation))) for r in records]
    names = list(dict.fromkeys(name for each in functions for name in each))
    parts = list[Array]()
    for record, each in zip(records, functions, strict=True):
        nothing = np.zeros(len(record.measured))
        parts.append(dataset.whitened_columns(record, np.column_stack([each.get(name, nothing) for name in names])))
    return names, parts


def _pursuit(gram: Array, predicted_gain: Array, least: Array, critical_gain: float) -> tuple[list[int], list[float]]:
    """Return the functions that are added, and the fall of the cost by each; `least` are their least squares."""
    chosen, gains = list[int](), list[float]()
    rest, left = gram, predicted_gain
    for _ in range(MOST_TERMS):
        size = np.diag(rest)
        falls = np.divide(left**2, size, out=np.zeros(len(size)), where=size > least)
        best = int(np.argmax(falls))
        if falls[best] < critical_gain:
            break
        chosen.append(best)
        gains.append(float(falls[best]))
        # What the new function explains is projected out of the others.
        column = rest[:, best] / size[best]
        rest, left = rest - np.outer(column, rest[best]), left - column * left[best]
    return chosen, gains


def _validate(
    task: EstimationTask, fit: FittedModel, features: BasisFunctions, terms: Mapping[str, float], steps: Array
) -> tuple[float, float]:
    """Return the fall of the cost of the validation runs by the sum, and the rms of the sum there.

    The free parameters change with the sum by `steps`; the change of the prediction is a directional difference.
    """
    dataset = task.validate
    if not dataset.records:
        return 0.0, 0.0
    where, x, step = fit.solution.problem.where, fit.solution.x, 1e-3
    # Steps towards a sum that the free parameters can imitate are without bound: they are clipped to plausible values.
    shifted = np.clip(x + step * steps, np.maximum(where.lower, x - 1.0), np.minimum(where.upper, x + 1.0))
    shared = {n: v for n, v in where.values(shifted).items() if ":" not in n}
    shifted_model = fit.model.replace(shared)
    gain, sizes = 0.0, {True: np.zeros(2), False: np.zeros(2)}  # squares and count, with and without weights
    for record in dataset.records:
        predicted = np.asarray(fit.model.predict(record.observation))
        functions = features(record.observation, predicted)
        added = sum(coefficient * functions[name] for name, coefficient in terms.items() if name in functions)
        added = added + (np.asarray(shifted_model.predict(record.observation)) - predicted) / step
        before, after = dataset.residual(record, predicted), dataset.residual(record, predicted + added)
        if before is None or after is None:
            return 0.0, 0.0
        gain += float(before @ before - after @ after)
        varying = without_offset(record, added, task.weights)
        sizes[record.observation.name in task.weights] += float(varying @ varying), len(varying)
    return gain, max(float(np.sqrt(squares / count)) for squares, count in sizes.values() if count)

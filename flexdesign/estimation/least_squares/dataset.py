"""A data set: observations with their noise, and nuisance columns that may add to each.

Coefficients of nuisance columns, such as an offset, enter linearly and are eliminated exactly by variable projection
(Golub and Pereyra 1973). Coefficients of known size are penalised as in ridge regression.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from flexdesign.core.arrays import Array, Flags
from flexdesign.core.errors import InputError
from flexdesign.core.model import Model, Observation
from flexdesign.estimation.noise.autoregressive import Whitening, process_of

#: Relative error of the simulator: residuals smaller than this share of the data are rounding.
SIMULATION_ROUNDING = 1e-7
#: Relative change of the response by a finite difference, which balances that error and curvature, and the relative
#: error of the derivative then (Gill, Murray and Wright, Practical Optimization, 1981, section 8.6).
DIFFERENCE_STEP = math.sqrt(SIMULATION_ROUNDING)
#: Returns the nuisance columns of an observation (samples by k), and the standard deviation of the coefficient of each
#: [response].
Shapes = Callable[[Observation], tuple[Array, Array]]


@runtime_checkable
class ModelShapes(Protocol):
    """Nuisance columns that depend on the parameters of a model; their number does not."""

    def __call__(self, observation: Observation) -> tuple[Array, Array]:
        """Return the columns, samples by k, and the standard deviation of each coefficient [response]."""

    def at(self, model: Model) -> ModelShapes:
        """Return the columns of a model; equal to these if nothing changes."""


@dataclass(frozen=True, eq=False)
class Record:
    """One observation of n values with its nuisance columns.

    Parameters
    ----------
    observation
        The observation.
    measured
        n values, SI; zero at gaps.
    present
        False at gaps.
    columns
        Nuisance columns: n by k, SI.
    basis
        Orthonormal basis of the whitened columns, with a row for the prior of each coefficient: n + k by k or fewer.
    amounts
        Matrix that takes a vector of length n + k to the k coefficients: k by n + k.
    """

    observation: Observation
    measured: Array
    present: Flags
    columns: Array
    basis: Array
    amounts: Array

    @property
    def rows(self) -> int:
        """Length of a residual: a row for each value, and one for each column."""
        return len(self.basis)

    def difference(self, predicted: Array) -> Array:
        """Return measured less predicted, n values in SI; zero at gaps.

        Raises
        ------
        InputError
            If the prediction has another shape than the measurement.
        """
        if predicted.shape != self.measured.shape:
            remedy = f"the model predicts values shaped {predicted.shape}, measured are {self.measured.shape}"
            raise InputError("fit", self.observation.name, None, remedy)
        return np.where(self.present, self.measured - predicted, 0.0)


class Dataset:
    """Records with their noise.

    Parameters
    ----------
    observations
        Each of n values.
    noise
        Whitens residuals to independent numbers of variance one.
    shapes
        Returns the nuisance columns of an observation.

    Raises
    ------
    InputError
        If an observation holds no finite value.
    """

    def __init__(self, observations: Sequence[Observation], noise: Whitening, shapes: Shapes) -> None:
        self.noise, self.shapes = noise, shapes
        self.records = tuple(self._record(observation, *shapes(observation)) for observation in observations)
        parts = [self.whitened(record, record.measured) for record in self.records]
        #: Norm of the measured data, whitened.
        self.size = float(np.sqrt(sum(part @ part for part in parts))) or 1.0
        #: Costs that differ by less are equal but for rounding.
        self.floor = (SIMULATION_ROUNDING * self.size) ** 2

    def with_shapes(self, shapes: Shapes, noise: Whitening | None = None) -> Dataset:
        """Return the data set with other nuisance columns, and perhaps with other noise."""
        return Dataset([record.observation for record in self.records], noise or self.noise, shapes)

    def at(self, model: Model) -> Dataset:
        """Return the data set with the nuisance columns of a model."""
        shapes = self._shapes_at(model)
        return self if shapes == self.shapes else self.with_shapes(shapes)

    def record_at(self, record: Record, model: Model) -> Record:
        """Return one of its records with the nuisance columns of a model."""
        shapes = self._shapes_at(model)
        return record if shapes == self.shapes else self._record(record.observation, *shapes(record.observation))

    def part(self, names: Sequence[str]) -> Dataset:
        """Return the data set of some of its observations."""
        part = copy(self)
        part.records = tuple(record for record in self.records if record.observation.name in names)
        return part

    def joined(self, other: Dataset) -> Dataset:
        """Return the data set with the records of another one, too."""
        joint = copy(self)
        joint.records = (*self.records, *other.records)
        return joint

    @property
    def names(self) -> list[str]:
        """Names of the observations."""
        return [record.observation.name for record in self.records]

    @property
    def samples(self) -> int:
        """Number of values present."""
        return int(sum(record.present.sum() for record in self.records))

    @property
    def nuisance_dof(self) -> float:
        """Effective degrees of freedom of the nuisance columns."""
        return float(sum(np.sum(record.basis[: len(record.measured)] ** 2) for record in self.records))

    def whitened(self, record: Record, difference: Array) -> Array:
        """Return n values (SI) whitened, gaps as zeros, without the nuisance columns: `record.rows` values."""
        values = np.where(record.present, difference, 0.0)
        vector = self._whiten(record.observation, record.present, values[:, None])[:, 0]
        padded = np.concatenate([vector, np.zeros(record.columns.shape[1])])
        return np.asarray(padded - record.basis @ (record.basis.T @ padded))

    def whitened_columns(self, record: Record, columns: Array) -> Array:
        """Return columns (n by k, SI), each treated as by `whitened`: `record.rows` by k."""
        return np.column_stack([self.whitened(record, column) for column in columns.T])

    def residual(self, record: Record, predicted: Array) -> Array | None:
        """Return the whitened residual of a prediction; None where it is not finite."""
        difference = record.difference(predicted)
        return self.whitened(record, difference) if np.isfinite(difference).all() else None

    def remainder(self, record: Record, predicted: Array) -> Array:
        """Return measured less predicted less the fitted nuisance columns, n values in SI; NaN at gaps."""
        difference = record.difference(predicted)
        vector = self._whiten(record.observation, record.present, difference[:, None])[:, 0]
        amounts = record.amounts @ np.concatenate([vector, np.zeros(record.columns.shape[1])])
        return np.where(record.present, difference - record.columns @ amounts, np.nan)

    def discrepancy(self, residuals: Sequence[Array]) -> float:
        """Return the reduced chi^2 of whitened residuals times the number of samples that count as one; at least one.

        It is one if they are white noise. The unexplained residual is treated as coloured noise.
        """
        pairs = zip(self.records, residuals, strict=True)
        parts = [part[: len(record.measured)] for record, part in pairs]
        weighted = sum(float(part @ part) * process_of(part).inflation(len(part)) for part in parts)
        return max(weighted / self.samples, 1.0)

    def _shapes_at(self, model: Model) -> Shapes:
        return self.shapes.at(model) if isinstance(self.shapes, ModelShapes) else self.shapes

    def _record(self, observation: Observation, columns: Array, sizes: Array) -> Record:
        measured = np.asarray(observation.measured(), dtype=float)
        present = np.isfinite(measured)
        if not present.any():
            raise InputError("runs", observation.name, None, "holds no finite value")
        whitened = self._whiten(observation, present, columns * present[:, None])
        stacked = np.vstack([whitened, np.diag(1 / sizes)])
        # A column that is zero but in gaps, or a combination of others, is left out and has no coefficient of its own.
        lengths = np.linalg.norm(stacked, axis=0)
        lengths = np.where(lengths > 0, lengths, 1.0)
        unit = stacked / lengths
        left, singular, right = np.linalg.svd(unit, full_matrices=False)
        significant = singular > len(unit) * np.finfo(float).eps * singular.max(initial=0.0)
        basis = left[:, significant]
        amounts = (right[significant].T / singular[significant]) @ basis.T / lengths[:, None]
        return Record(observation, np.where(present, measured, 0.0), present, columns, basis, amounts)

    def _whiten(self, observation: Observation, present: Flags, columns: Array) -> Array:
        return np.asarray(self.noise.whiten(observation, columns) * present[:, None])

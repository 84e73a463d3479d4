"""A suite of observations beside a model: whitened residuals and their derivatives, record by record.

Numbers that act on one record alone (where it began, how late it was started) are many, and cost little: their
derivatives ask for one record each, and the normal equations are filled block by block. What enters linearly, such as
an offset, is eliminated exactly (Golub and Pereyra 1973); where something is known of it, as in ridge regression.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.errors import InputError
from flexdesign.evidence.coordinates import Coordinates
from flexdesign.evidence.noise import Whitening
from flexdesign.evidence.residuals import LARGEST, MOVED, SMALLEST, STEP, Map
from flexdesign.model import Model, Observation

Array = NDArray[np.float64]
#: A combination of columns so small, beside the largest, is hidden.
HIDDEN = 1e-10
#: Columns that add to what was measured of an observation (samples by k), and how large each may be [response].
Shapes = Callable[[Observation], tuple[Array, Array]]
#: Makes another model of one, with the same numbers.
Made = Callable[[Model], Model]


@dataclass(frozen=True, eq=False)
class Record:
    """One observation of n values, and what adds to it in an unknown amount.

    Parameters
    ----------
    observation
        The observation.
    measured
        n values, SI; zero at gaps.
    present
        False at gaps.
    columns
        What may add to it: n by k, SI.
    basis
        Orthonormal basis of these columns, whitened, with a row for what is known of each: n + k by k or fewer.
    amounts
        Takes a vector of length n + k to the k amounts of the columns that it holds.
    freedom
        Logarithm of the volume, in units of the noise, of what the columns may add: the price of their freedom in the
        marginal likelihood, but for columns of which nothing is known.
    """

    observation: Observation
    measured: Array
    present: NDArray[np.bool_]
    columns: Array
    basis: Array
    amounts: Array
    freedom: float

    @property
    def rows(self) -> int:
        """Length of a residual: a row for each value, and one for each column."""
        return len(self.basis)


class Suite:
    """Records with their noise.

    Parameters
    ----------
    observations
        Each of n values.
    noise
        What turns residuals into independent numbers of variance one.
    shapes
        What may add to each observation in an unknown amount.

    Raises
    ------
    InputError
        If an observation holds no finite value.
    """

    def __init__(self, observations: Sequence[Observation], noise: Whitening, shapes: Shapes) -> None:
        self.noise = noise
        self.records = tuple(self._record(observation, *shapes(observation)) for observation in observations)
        parts = [self.whitened(record, record.measured) for record in self.records]
        #: Norm of the measured data, whitened.
        self.size = float(np.sqrt(sum(part @ part for part in parts))) or 1.0

    def with_shapes(self, shapes: Shapes, noise: Whitening | None = None) -> Suite:
        """Return the suite with other columns that may add to its observations, and perhaps with other noise."""
        return Suite([record.observation for record in self.records], noise or self.noise, shapes)

    def part(self, names: Sequence[str]) -> Suite:
        """Return the suite of some of its observations."""
        part = copy(self)
        part.records = tuple(record for record in self.records if record.observation.name in names)
        return part

    @property
    def names(self) -> list[str]:
        """Names of the observations."""
        return [record.observation.name for record in self.records]

    @property
    def samples(self) -> int:
        """Number of values present."""
        return int(sum(record.present.sum() for record in self.records))

    @property
    def freedom(self) -> float:
        """What the freedom of the columns costs, in the units of the sum of squares: twice the sum over the records."""
        return 2 * sum(record.freedom for record in self.records)

    def whitened(self, record: Record, difference: Array) -> Array:
        """Return a difference (n, SI) whitened, what may add to it taken out: a vector of `record.rows`."""
        vector = self._whitened(record.observation, record.present, difference)
        padded = np.concatenate([vector, np.zeros(record.columns.shape[1])])
        return np.asarray(padded - record.basis @ (record.basis.T @ padded))

    def residual(self, record: Record, predicted: Array) -> Array | None:
        """Return the whitened residual of a prediction; None where it is not finite."""
        difference = np.where(record.present, record.measured - predicted, 0.0)
        return self.whitened(record, difference) if np.isfinite(difference).all() else None

    def remainder(self, record: Record, predicted: Array) -> Array:
        """Return measured less predicted and the best amounts of the columns, n values in SI; NaN at gaps."""
        difference = np.where(record.present, record.measured - predicted, 0.0)
        vector = self._whitened(record.observation, record.present, difference)
        added = record.columns @ (record.amounts @ np.concatenate([vector, np.zeros(record.columns.shape[1])]))
        return np.where(record.present, difference - added, np.nan)

    def _record(self, observation: Observation, columns: Array, sizes: Array) -> Record:
        measured = np.asarray(observation.measured(), dtype=float)
        present = np.isfinite(measured)
        if not present.any():
            raise InputError("runs", observation.name, None, "holds no finite value")
        whitened = self.noise.whiten(observation, columns * present[:, None]) * present[:, None]
        stacked = np.vstack([whitened, np.diag(1 / sizes)])
        # A column that a gap hides, or that others make up, takes nothing out and has no amount of its own.
        lengths = np.linalg.norm(stacked, axis=0)
        unit = stacked / np.where(lengths > 0, lengths, 1.0)
        left, singular, right = np.linalg.svd(unit, full_matrices=False)
        kept = singular > HIDDEN * singular.max(initial=0.0)
        basis = left[:, kept]
        amounts = (right[kept].T / singular[kept]) @ basis.T / np.where(lengths > 0, lengths, 1.0)[:, None]
        freedom = (
            np.log(singular[kept]).sum() + np.log(lengths[lengths > 0]).sum() + np.log(sizes[np.isfinite(sizes)]).sum()
        )
        return Record(observation, np.where(present, measured, 0.0), present, columns, basis, amounts, float(freedom))

    def _whitened(self, observation: Observation, present: NDArray[np.bool_], difference: Array) -> Array:
        return np.asarray(self.noise.whiten(observation, difference[:, None])[:, 0] * present)


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivative of the residual of one record: rows by some of the coordinates, whose places are `places`."""

    places: NDArray[np.intp]
    matrix: Array


def _itself(model: Model) -> Model:
    return model


class Problem:
    """A model with free numbers, to be laid beside a suite.

    Parameters
    ----------
    suite
        The records.
    model
        The model.
    where
        Its free numbers as coordinates; those that act on one run alone carry its name.
    each
        Maps simulations, over threads perhaps.
    moved
        How far a finite difference should move the data, relative.
    sloping
        Makes a model whose slopes serve in the place of a model's own: how far a number moves what is predicted need
        not be known as exactly as where it is.
    """

    def __init__(
        self,
        suite: Suite,
        model: Model,
        where: Coordinates,
        each: Map = map,
        moved: float = MOVED,
        sloping: Made = _itself,
    ) -> None:
        self.suite, self.model, self.where, self.each, self.moved = suite, model, where, each, moved
        self.sloping = sloping
        self.evaluations = 0
        runs = [parameter.run for parameter in where.parameters]
        names = [record.observation.name for record in suite.records]
        self.places = [
            np.array([j for j, run in enumerate(runs) if run in ("", name)], dtype=np.intp) for name in names
        ]
        self.steps = STEP * where.sizes(where.start)
        self._known = [(where.names.index(name), *about) for name, about in where.known.items()]

    def at(self, x: Array) -> Model:
        """Return the model at a point."""
        return self.model.replace(self.where.values(x))

    def even(self, slopes: Sequence[Slopes]) -> None:
        """Make the slopes of a number and of its twin in each run the same, as they are but for rounding.

        What tells them apart is known of them beforehand; beside strong data the rounding would seem to know better.
        """
        for parameter in self.where.parameters:
            for record, part in zip(self.suite.records, slopes, strict=True) if parameter.twin else ():
                name = f"{record.observation.name}:{parameter.twin}"
                if name not in self.where.names:
                    continue
                both = [self.where.names.index(each) for each in (parameter.name, name)]
                mine, other = (int(np.flatnonzero(part.places == place)[0]) for place in both)
                if part.matrix[:, mine].any():
                    part.matrix[:, mine] = part.matrix[:, other]

    def residuals(self, x: Array) -> list[Array] | None:
        """Return the whitened residual of each record; None where the model fails."""
        return self._residuals(self.at(x))

    def _residuals(self, model: Model) -> list[Array] | None:
        found = list(self.each(lambda record: self._residual(model, record), self.suite.records))
        return None if any(part is None for part in found) else found

    def _residual(self, model: Model, record: Record) -> Array | None:
        self.evaluations += 1
        try:
            with np.errstate(all="ignore"):
                return self.suite.residual(record, np.asarray(model.predict(record.observation)))
        except (ArithmeticError, InputError):
            return None

    def before(self, x: Array) -> Array:
        """Return how many standard deviations each known number is from what was known."""
        values = self.where.values(x)
        names = self.where.names
        return np.array([(values[names[j]] - middle) / sigma for j, middle, sigma in self._known])

    def before_slopes(self, x: Array) -> Array:
        """Return the derivative of `before`: known numbers by coordinates."""
        slopes, rows = self.where.slopes(x), np.zeros((len(self._known), len(x)))
        for row, (j, _, sigma) in enumerate(self._known):
            rows[row, j] = slopes[j] / sigma
        return rows

    def cost(self, x: Array, residuals: list[Array] | None) -> float:
        """Return the sum of squares; infinite where the model fails."""
        if residuals is None:
            return np.inf
        before = self.before(x)
        return float(sum(part @ part for part in residuals) + before @ before)

    def _sloping_at(self, x: Array, residuals: Sequence[Array]) -> tuple[Made, Sequence[Array]]:
        """Return what makes models to take slopes from, and their residuals: a model's own where another one fails."""
        own = self.at(x)
        if (other := self.sloping(own)) is own or (found := self._residuals(other)) is None:
            return _itself, residuals
        return self.sloping, found

    def _moved(
        self, x: Array, pairs: Sequence[tuple[int, int]], forward: Array, make: Made
    ) -> dict[tuple[int, int], Array | None]:
        """Return the residual of each record with one coordinate moved by its step; None where the model fails."""
        models = self._moved_models(x, sorted({j for _, j in pairs}), forward * self.steps, make)
        found = self.each(lambda pair: self._residual(models[pair[1]], self.suite.records[pair[0]]), pairs)
        return dict(zip(pairs, found, strict=True))

    def _moved_models(self, x: Array, places: Sequence[int], steps: Array, make: Made) -> dict[int, Model]:
        """Return for some coordinates the model with that one moved; those of different runs are moved together."""
        groups = dict[tuple[str, str | int], list[int]]()
        for j in places:
            parameter = self.where.parameters[j]
            run, _, number = parameter.name.rpartition(":")
            groups.setdefault(("run", number) if run == parameter.run != "" else ("all", j), []).append(j)
        models = dict[int, Model]()
        for together in groups.values():
            to = x.copy()
            to[together] += steps[together]
            models |= dict.fromkeys(together, make(self.at(to)))
        return models

    def slopes(
        self, x: Array, residuals: Sequence[Array], old: Mapping[str, Sequence[Array | None]] | None = None
    ) -> list[Slopes]:
        """Return the derivative of each record's residual at `x`, by forward differences, or backward at a bound.

        Parameters
        ----------
        x, residuals
            Where, and the residuals there.
        old
            Columns that are known well enough, by the name of the number: one for each record, or None.
        """
        old = old or {}
        fresh = [j for j, name in enumerate(self.where.names) if name not in old]
        forward = np.where(x + self.steps <= self.where.upper, 1.0, -1.0)
        pairs = [(r, int(j)) for r, places in enumerate(self.places) for j in places if int(j) in fresh]
        make, here = self._sloping_at(x, residuals) if pairs else (_itself, residuals)
        parts = self._moved(x, pairs, forward, make)
        if failed := {j for (_, j), part in parts.items() if part is None}:
            # On the other side the model may not fail; where it does on both, nothing is known of this slope.
            forward[list(failed)] *= -1.0
            parts |= self._moved(x, [pair for pair in pairs if pair[1] in failed], forward, make)
        moved, columns = np.zeros(len(x)), dict[tuple[int, int], Array]()
        for (r, j), part in parts.items():
            column = np.zeros_like(here[r]) if part is None else (part - here[r]) * forward[j]
            moved[j] += column @ column
            columns[r, j] = column / self.steps[j]
        for j, name in enumerate(self.where.names):
            for r, column in enumerate(old.get(name, ())):
                if column is not None:
                    columns[r, j] = column
        # The next steps move the whitened response by a small share of it.
        sizes, wanted = self.where.sizes(x), self.moved * self.suite.size
        by = np.where(moved > 0, np.clip(wanted / np.maximum(np.sqrt(moved), 1e-300), 0.1, 10.0), 1.0)
        self.steps = np.clip(self.steps * by, SMALLEST * sizes, LARGEST * sizes)
        return [
            Slopes(places, np.array([columns[r, int(j)] for j in places]).reshape(len(places), len(residuals[r])).T)
            for r, places in enumerate(self.places)
        ]

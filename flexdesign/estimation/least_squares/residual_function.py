"""A model and a data set: coordinates of the free parameters, whitened residuals and their derivatives.

A coordinate is the value of a parameter, its logarithm or its reciprocal. Residuals are those of each record.
Parameters that act on one record alone (its initial state, its trigger delay) are many, and cost little: their
derivatives need one record each, and the normal equations are filled block by block.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexdesign.core.arrays import Array, Places
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Model, Parameter
from flexdesign.estimation.least_squares.dataset import DIFFERENCE_STEP, SIMULATION_ROUNDING, Dataset, Record

#: Applies a function to each item of a list, over threads perhaps.
Map = Callable[..., Any]
#: Step of a finite difference per size of its coordinate: where it begins, and how large it may become.
FIRST_STEP, LARGEST_STEP = 1e-4, 1e-2


# --- coordinates ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Coordinates:
    """The free parameters of a fit as a vector.

    Parameters
    ----------
    parameters
        The free parameters, in the order of the vector; their `start` is the present value.
    known
        Priors by name: mean and standard deviation, SI.
    lower, upper
        Bounds of the vector; the plausible ranges, possibly infinite.
    start
        The present values, moved into the bounds.
    """

    parameters: tuple[Parameter, ...]
    known: Mapping[str, tuple[float, float]]
    lower: Array
    upper: Array
    start: Array

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the free parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def span(self) -> Array:
        """Return the width of the plausible range of each coordinate, possibly infinite."""
        return self.upper - self.lower

    def values(self, x: Array) -> dict[str, float]:
        """Return the values in SI at the point `x`."""
        return {p.name: value(p, float(c)) for p, c in zip(self.parameters, x, strict=True)}

    def jacobian(self, x: Array) -> Array:
        """Return the derivative of each value in SI by its coordinate."""
        return np.array([_derivative(p, float(c)) for p, c in zip(self.parameters, x, strict=True)])

    def sizes(self, x: Array) -> Array:
        """Return the change of each coordinate as its parameter changes by about itself.

        For a linear parameter near zero, a tenth of its plausible range.
        """
        tenth = np.where(np.isfinite(self.span), 0.1 * self.span, 0.0)
        own = [1.0 if p.scale == "log" else abs(c) for p, c in zip(self.parameters, x, strict=True)]
        sizes = np.minimum(np.maximum(own, tenth), np.where(np.isfinite(self.span), self.span, math.inf))
        return np.where(sizes > 0, sizes, 1.0)


def coordinates(model: Model, free: Sequence[str], known: Mapping[str, tuple[float, float]]) -> Coordinates:
    """Return the coordinates of the parameters `free` of a model.

    Raises
    ------
    InputError
        If a name is unknown or repeated, nothing is free, a scale does not suit its range, or a parameter has
        neither a present value nor a finite range.
    """
    every = {parameter.name: parameter for parameter in model.parameters()}
    for name in [*free, *known]:
        if name not in every:
            raise InputError("model", name, None, f"is not a parameter of this model{suggest(name, list(every))}")
    if not free or len(set(free)) < len(free):
        raise InputError("fit", "free", list(free), "name one or more parameters, each once")
    for name, (middle, sigma) in known.items():
        if not (math.isfinite(middle) and 0 < sigma < math.inf and exists(every[name], middle)):
            raise InputError("fit", f"known.{name}", (middle, sigma), "is a value and a standard deviation above zero")
    chosen = tuple(every[name] for name in free)
    bounds = np.array([_bounds(parameter) for parameter in chosen])
    start = np.array([_start(p, low, high) for p, (low, high) in zip(chosen, bounds, strict=True)])
    return Coordinates(chosen, {k: known[k] for k in free if k in known}, bounds[:, 0], bounds[:, 1], start)


def coordinate(parameter: Parameter, number: float) -> float:
    """Return the coordinate of a value in SI.

    >>> coordinate(Parameter("f", "Hz", "Hz", "limit", scale="inverse"), 4.0)
    0.25
    """
    if parameter.scale == "log":
        return math.log(number)
    return 1 / number if parameter.scale == "inverse" else number


def value(parameter: Parameter, coordinate: float) -> float:
    """Return the value in SI of a coordinate; the coordinate zero of a reciprocal is infinity."""
    if parameter.scale == "log":
        return math.exp(coordinate) if coordinate < 700 else math.inf
    if parameter.scale == "inverse":
        return 1 / coordinate if coordinate else math.inf
    return coordinate


def null_of(strength: Parameter) -> float:
    """Return the value in SI at which an effect vanishes; a strength is a parameter that has one."""
    assert strength.null is not None
    return strength.null


def _derivative(parameter: Parameter, coordinate: float) -> float:
    if parameter.scale == "log":
        return value(parameter, coordinate)
    return -(value(parameter, coordinate) ** 2) if parameter.scale == "inverse" else 1.0


def exists(parameter: Parameter, number: float) -> bool:
    """Tell whether a value has a coordinate."""
    return parameter.scale == "linear" or number > 0


def _bounds(parameter: Parameter) -> tuple[float, float]:
    low, high = parameter.plausible
    if parameter.scale == "linear":
        ends = [low, high]
    elif low < 0 or (low == 0 and math.isfinite(high)):
        if parameter.plausible != (-math.inf, math.inf):
            raise InputError(
                "model", parameter.name, parameter.plausible, f"a {parameter.scale} scale needs a range above zero"
            )
        ends = [-math.inf, math.inf] if parameter.scale == "log" else [0.0, math.inf]
    elif parameter.scale == "log":
        ends = [math.log(low) if low else -math.inf, math.log(high) if math.isfinite(high) else math.inf]
    else:
        ends = sorted([1 / low if low else math.inf, 1 / high])
    if not ends[0] < ends[1]:
        raise InputError(
            "model", parameter.name, parameter.plausible, "the plausible range of a free parameter is empty"
        )
    return ends[0], ends[1]


def _start(parameter: Parameter, low: float, high: float) -> float:
    present = parameter.start
    if present is not None and not math.isnan(present) and (exists(parameter, present)):
        return float(np.clip(coordinate(parameter, present), low, high))
    if math.isfinite(high - low):
        return low if present == 0 else (low + high) / 2
    raise InputError("model", parameter.name, present, "a free parameter needs a start or a plausible range")


# --- residuals and derivatives ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class JacobianBlock:
    """Derivative of the residual of one record, rows by coordinates; `places` are the indices of the coordinates."""

    places: Places
    matrix: Array


class _Count:
    """Counts predictions, of several threads."""

    def __init__(self) -> None:
        self.total, self._lock = 0, threading.Lock()

    def add(self) -> None:
        """Count one more."""
        with self._lock:
            self.total += 1


class Problem:
    """A model with free parameters, and a data set.

    Parameters
    ----------
    dataset
        The records.
    model
        The model.
    where
        Its free parameters as coordinates; `Parameter.run` names the run of those that act on one run alone.
    each
        Maps simulations, over threads perhaps.
    central
        Whether differences are central, at twice the cost of forward ones: their error is then far below that of the
        simulator.
    count
        Counter of predictions, shared with the problem from which this one is derived; None for a new one.
    """

    def __init__(
        self,
        dataset: Dataset,
        model: Model,
        where: Coordinates,
        each: Map = map,
        central: bool = False,
        count: _Count | None = None,
    ) -> None:
        self.dataset, self.model, self.where, self.each = dataset, model, where, each
        self.central, self._count = central, count or _Count()
        runs = [parameter.run for parameter in where.parameters]
        names = [record.observation.name for record in dataset.records]
        self.places = [
            np.array([j for j, run in enumerate(runs) if run in ("", name)], dtype=np.intp) for name in names
        ]
        self.steps = FIRST_STEP * where.sizes(where.start)
        self._known = [(where.names.index(name), *about) for name, about in where.known.items()]

    @property
    def evaluations(self) -> int:
        """Number of predictions so far, with those of problems derived from this one."""
        return self._count.total

    def fresh(self, dataset: Dataset | None = None, central: bool | None = None) -> Problem:
        """Return the problem with its own finite-difference steps; perhaps with another data set."""
        central = self.central if central is None else central
        return Problem(dataset or self.dataset, self.model, self.where, self.each, central, self._count)

    def at_solution(self, x: Array) -> Problem:
        """Return the problem with the columns that the model has at a point."""
        made = copy(self)
        made.dataset = self.dataset.at(self.at(x))
        return made

    def fixed(self, j: int, coordinate: float, x: Array) -> Problem:
        """Return the problem of the other coordinates, which start from `x`, with one of them held."""
        where = self.where
        left = [i for i in range(len(x)) if i != j]
        held = where.parameters[j]
        others = Coordinates(
            tuple(where.parameters[i] for i in left),
            {name: about for name, about in where.known.items() if name != held.name},
            where.lower[left],
            where.upper[left],
            x[left],
        )
        model = self.model.replace({held.name: value(held, coordinate)})
        return Problem(self.dataset, model, others, self.each, self.central, self._count)

    def at(self, x: Array) -> Model:
        """Return the model at a point."""
        return self.model.replace(self.where.values(x))

    def symmetrise(self, jacobian: Sequence[JacobianBlock]) -> None:
        """Make the derivatives of a parameter and of its twin in each run equal, as they are but for rounding.

        Only their priors distinguish them. With precise data, rounding errors would seem to distinguish them, too.
        """
        for parameter in self.where.parameters:
            for record, part in zip(self.dataset.records, jacobian, strict=True) if parameter.twin else ():
                name = f"{record.observation.name}:{parameter.twin}"
                if name not in self.where.names:
                    continue
                twins = [self.where.names.index(each) for each in (parameter.name, name)]
                own, other = (int(np.flatnonzero(part.places == place)[0]) for place in twins)
                if part.matrix[:, own].any():
                    part.matrix[:, own] = part.matrix[:, other]

    def residuals(self, x: Array) -> list[Array] | None:
        """Return the whitened residual of each record; None where the model fails."""
        return self._residuals(self.at(x))

    def _residuals(self, model: Model) -> list[Array] | None:
        found = list(self.each(lambda record: self._residual(model, record), self.dataset.records))
        return None if any(part is None for part in found) else found

    def _residual(self, model: Model, record: Record) -> Array | None:
        self._count.add()
        try:
            with np.errstate(all="ignore"):
                record = self.dataset.record_at(record, model)
                return self.dataset.residual(record, np.asarray(model.predict(record.observation)))
        except (ArithmeticError, np.linalg.LinAlgError, InputError):
            return None

    def prior_residual(self, x: Array) -> Array:
        """Return the distance of each parameter with a prior from its mean, in standard deviations."""
        values = self.where.values(x)
        names = self.where.names
        return np.array([(values[names[j]] - middle) / sigma for j, middle, sigma in self._known])

    def prior_jacobian(self, x: Array) -> Array:
        """Return the derivative of `prior_residual`: parameters with a prior by coordinates."""
        jacobian, rows = self.where.jacobian(x), np.zeros((len(self._known), len(x)))
        for row, (j, _, sigma) in enumerate(self._known):
            rows[row, j] = jacobian[j] / sigma
        return rows

    def cost(self, x: Array, residuals: list[Array] | None) -> float:
        """Return the sum of squares; infinite where the model fails."""
        if residuals is None:
            return np.inf
        prior_residual = self.prior_residual(x)
        return float(sum(part @ part for part in residuals) + prior_residual @ prior_residual)

    def cost_of(self, model: Model, x: Array) -> float:
        """Return the sum of squares of another model with the same parameters; infinite where it fails."""
        return self.cost(x, self._residuals(model))

    def _perturbed_residuals(
        self, x: Array, pairs: Sequence[tuple[int, int]], forward: Array
    ) -> dict[tuple[int, int], Array | None]:
        """Return the residual of each record with one coordinate moved by its step; None where the model fails."""
        models = self._perturbed_models(x, sorted({j for _, j in pairs}), forward * self.steps)
        found = self.each(lambda pair: self._residual(models[pair[1]], self.dataset.records[pair[0]]), pairs)
        return dict(zip(pairs, found, strict=True))

    def _perturbed_models(self, x: Array, places: Sequence[int], steps: Array) -> dict[int, Model]:
        """Return for each of some coordinates the model with a step of it; those of different runs share a model."""
        groups = dict[tuple[str, str | int], list[int]]()
        for j in places:
            parameter = self.where.parameters[j]
            run, _, number = parameter.name.rpartition(":")
            groups.setdefault(("run", number) if run == parameter.run != "" else ("all", j), []).append(j)
        models = dict[int, Model]()
        for together in groups.values():
            to = x.copy()
            to[together] += steps[together]
            models |= dict.fromkeys(together, self.at(to))
        return models

    def jacobian(
        self, x: Array, residuals: Sequence[Array], old: Mapping[str, Sequence[Array | None]] | None = None
    ) -> list[JacobianBlock]:
        """Return the derivative of each record's residual at `x`, by differences, which look inwards at a bound.

        Parameters
        ----------
        x, residuals
            Where, and the residuals there.
        old
            Columns that need not be computed, by the name of the parameter: one for each record, or None.
        """
        old = old or {}
        fresh = [j for j, name in enumerate(self.where.names) if name not in old]
        forward = np.where(x + self.steps <= self.where.upper, 1.0, -1.0)
        pairs = [(r, int(j)) for r, places in enumerate(self.places) for j in places if int(j) in fresh]
        parts = self._perturbed_residuals(x, pairs, forward)
        if failed := {j for (_, j), part in parts.items() if part is None}:
            # The model may not fail on the other side; if it fails on both, the derivative is taken as zero.
            forward[list(failed)] *= -1.0
            parts |= self._perturbed_residuals(x, [pair for pair in pairs if pair[1] in failed], forward)
        opposite = dict[tuple[int, int], Array | None]()
        if self.central:
            back = x - forward * self.steps
            inside = (back >= self.where.lower) & (back <= self.where.upper)
            opposite = self._perturbed_residuals(
                x, [(r, j) for r, j in pairs if inside[j] and j not in failed], -forward
            )
        steps, columns = np.zeros(len(x)), dict[tuple[int, int], Array]()
        for (r, j), part in parts.items():
            other = opposite.get((r, j))
            column = np.zeros_like(residuals[r]) if part is None else (part - residuals[r]) * forward[j]
            if part is not None and other is not None:
                column = (part - other) * forward[j] / 2
            steps[j] += column @ column
            columns[r, j] = column / self.steps[j]
        for j, name in enumerate(self.where.names):
            for r, column in enumerate(old.get(name, ())):
                if column is not None:
                    columns[r, j] = column
        # The next steps move the whitened response by a small share of it; the error of central ones is smaller.
        wanted = (float(np.cbrt(SIMULATION_ROUNDING)) if self.central else DIFFERENCE_STEP) * self.dataset.size
        by = np.where(steps > 0, np.clip(wanted / np.maximum(np.sqrt(steps), 1e-300), 0.1, 10.0), 1.0)
        sizes = self.where.sizes(x)
        self.steps = np.clip(self.steps * by, SIMULATION_ROUNDING * sizes, LARGEST_STEP * sizes)
        return [
            JacobianBlock(
                places, np.array([columns[r, int(j)] for j in places]).reshape(len(places), len(residuals[r])).T
            )
            for r, places in enumerate(self.places)
        ]

"""The coordinates in which a fit moves its parameters: the value, its logarithm or its reciprocal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Model, Parameter


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

    def sampled(self) -> tuple[Array, Array]:
        """Return the lower and upper ends of the box from which other starts are drawn.

        The box is the plausible range; for a parameter with a prior, two standard deviations about its mean. On a side
        without a bound it reaches three times the present value, or a factor of ten for a logarithm.
        """
        reach = np.array([math.log(10.0) if p.scale == "log" else 3.0 for p in self.parameters]) * self.sizes(
            self.start
        )
        low = np.where(np.isfinite(self.lower), self.lower, self.start - reach)
        high = np.where(np.isfinite(self.upper), self.upper, self.start + reach)
        for i, p in enumerate(self.parameters):
            if p.name in self.known:
                middle, sigma = self.known[p.name]
                ends = [coordinate(p, v) for v in (middle - 2 * sigma, middle + 2 * sigma) if _exists(p, v)]
                ends = ends if len(ends) == 2 else [*ends, coordinate(p, middle)]
                low[i], high[i] = (float(np.clip(end, low[i], high[i])) for end in sorted(ends))
        return low, high


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
        if not (math.isfinite(middle) and 0 < sigma < math.inf and _exists(every[name], middle)):
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


def _exists(parameter: Parameter, number: float) -> bool:
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
    if present is not None and not math.isnan(present) and (_exists(parameter, present)):
        return float(np.clip(coordinate(parameter, present), low, high))
    if math.isfinite(high - low):
        return low if present == 0 else (low + high) / 2
    raise InputError("model", parameter.name, present, "a free parameter needs a start or a plausible range")

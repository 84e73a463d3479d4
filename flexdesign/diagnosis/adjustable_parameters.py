"""Parameters of a fitted model that may be set by hand, each with the range for a slider."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from flexdesign.core.model import Parameter
from flexdesign.estimation.criterion import CONFLICT
from flexdesign.estimation.model_selection.fitted_model import FittedModel

#: A parameter may be set within `CONFLICT` standard deviations of its prior; else from a half to twice its value.
DEFAULT_FACTOR = 2.0


@dataclass(frozen=True)
class AdjustableParameter:
    """A parameter of a model that may be set by hand.

    Parameters
    ----------
    parameter
        The parameter.
    value
        Its present value, SI.
    low, high
        The ends of its range, SI.
    """

    parameter: Parameter
    value: float
    low: float
    high: float


def adjustable_parameters(fit: FittedModel, by_hand: Mapping[str, float]) -> tuple[AdjustableParameter, ...]:
    """Return the parameters of a fit that belong to no run; those in `by_hand` have these values, SI."""
    where, x = fit.solution.problem.where, fit.solution.x
    values, known, adjustable = where.values(x), where.known, []
    for parameter in where.parameters:
        if parameter.run:
            continue
        fitted = values[parameter.name]
        reach = abs(fitted) * (1 - 1 / DEFAULT_FACTOR) or 1.0
        low, high = fitted - reach, fitted + DEFAULT_FACTOR * reach
        if parameter.name in known and parameter.scale == "linear":
            middle, sigma = known[parameter.name]
            low, high = min(fitted, middle - CONFLICT * sigma), max(fitted, middle + CONFLICT * sigma)
        if parameter.null is not None and math.isfinite(parameter.null):
            low, high = min(low, parameter.null), max(high, parameter.null)
        low, high = max(low, parameter.plausible[0]), min(high, parameter.plausible[1])
        present = by_hand.get(parameter.name, fitted)
        adjustable.append(AdjustableParameter(parameter, present, min(low, fitted), max(high, fitted)))
    return tuple(adjustable)

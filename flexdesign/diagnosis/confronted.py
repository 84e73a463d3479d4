"""What a confrontation of a model with runs returns: how the model stands, what may be set, what may be added."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from flexdesign.core.model import Parameter
from flexdesign.diagnosis.comparison import Comparison, RunComparison
from flexdesign.diagnosis.result import ErrorStep, ModelResiduals, compare_model, compared_runs
from flexdesign.estimation.criterion import CONFLICT
from flexdesign.estimation.model_selection.fitted_model import FittedModel

#: A parameter may be set within `CONFLICT` standard deviations of its prior; else from a half to twice its value.
DEFAULT_FACTOR = 2.0


@dataclass(frozen=True)
class AdjustableParameter:
    """A number of a model that may be set by hand, SI.

    Parameters
    ----------
    parameter
        What it is, and its unit.
    value
        What it is now.
    low, high
        Between what it may be set.
    """

    parameter: Parameter
    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Confronted(ModelResiduals):
    """A model with some effects, compared with the runs.

    Parameters
    ----------
    effects
        Names of the effects that were added.
    error_ladder
        Errors on the runs that judge, from the model as designed to this one [response].
    noise_floor
        Rms noise of these runs [response].
    settings
        The numbers that were fitted.
    reason
        Why the effect that was added last is not needed; empty if it is, or if the fit is rough.
    is_rough
        Whether the effect that was added last is fitted roughly only.
    """

    effects: tuple[str, ...]
    error_ladder: tuple[ErrorStep, ...]
    noise_floor: float
    settings: tuple[AdjustableParameter, ...]
    reason: str
    is_rough: bool = False

    @property
    def error(self) -> float:
        """Rms residual of the runs that judge [response]."""
        return self.error_ladder[-1].error

    @property
    def ratio(self) -> float:
        """That error over the noise floor."""
        return self.error / self.noise_floor

    @cached_property
    def compared_runs(self) -> tuple[RunComparison, ...]:
        """Measured against modelled, run by run."""
        return compared_runs(self, "found")

    @cached_property
    def comparison(self) -> Comparison:
        """The same, and where the model fails."""
        return compare_model(self, "found")


def settings_of(fit: FittedModel, by_hand: Mapping[str, float]) -> tuple[AdjustableParameter, ...]:
    """Return the numbers of a fit that may be set by hand; some of them have been, SI."""
    where, x = fit.solution.problem.where, fit.solution.x
    present, known = where.values(x), where.known
    found = []
    for parameter in where.parameters:
        if parameter.run:
            continue
        fitted = present[parameter.name]
        reach = abs(fitted) * (1 - 1 / DEFAULT_FACTOR) or 1.0
        low, high = fitted - reach, fitted + DEFAULT_FACTOR * reach
        if parameter.name in known and parameter.scale == "linear":
            middle, sigma = known[parameter.name]
            low, high = min(fitted, middle - CONFLICT * sigma), max(fitted, middle + CONFLICT * sigma)
        if parameter.null is not None and math.isfinite(parameter.null):
            low, high = min(low, parameter.null), max(high, parameter.null)
        low, high = max(low, parameter.plausible[0]), min(high, parameter.plausible[1])
        found.append(
            AdjustableParameter(parameter, by_hand.get(parameter.name, fitted), min(low, fitted), max(high, fitted))
        )
    return tuple(found)

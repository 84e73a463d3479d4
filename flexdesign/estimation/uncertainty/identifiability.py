"""Identifiability of each parameter: a value with its interval, or a sentence that says why there is none.

Intervals are those of the covariance, checked and corrected by the profile likelihood.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import join_names
from flexdesign.core.model import Parameter
from flexdesign.estimation.criterion import CONFIDENCE, large_share
from flexdesign.estimation.least_squares.levenberg_marquardt import Solution, refine_minimum, solve
from flexdesign.estimation.least_squares.residual_function import coordinate, value
from flexdesign.estimation.uncertainty.intervals import ACCURACY, Profile, Uncertainty, profile, uncertainty


@dataclass(frozen=True)
class Estimate:
    """What a fit says about one parameter.

    Parameters
    ----------
    parameter
        The parameter.
    value, sigma
        The value and its standard deviation in SI; None if the data do not determine it. If the interval is from the
        profile likelihood, the standard deviation is that of a normal interval as wide.
    interval
        95 % interval in SI. If the data only bound a parameter on one side, the other end is that of the plausible
        range; None if the data do not bound it.
    determined, reason
        Whether the data determine the parameter; and why not, or the method of the interval; may be empty.
    """

    parameter: Parameter
    value: float | None
    sigma: float | None
    interval: tuple[float, float] | None
    determined: bool
    reason: str = ""

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.parameter.name

    @property
    def value_text(self) -> str:
        """The value with its unit, to two digits of its standard deviation; empty if there is none."""
        return "" if self.value is None else _text(self.parameter, self.value, self.sigma)

    @property
    def interval_text(self) -> str:
        """The interval with its unit; empty if there is none."""
        if self.interval is None:
            return ""
        width = self.interval[1] - self.interval[0]
        return _pair_text(self.parameter, self.interval, sigma=width / 4)


def estimates(
    solution: Solution,
    uncertainty: Uncertainty,
    profiles: Mapping[int, Profile | None],
    minima: Sequence[Array] = (),
) -> tuple[Estimate, ...]:
    """Return what the fit says about some parameters, in the order of `profiles`.

    Parameters
    ----------
    solution, uncertainty, minima
        The fit, its covariance, and the points at which all its starts ended.
    profiles
        The intervals of the coordinates, by index; None in the null space.
    """
    check = _Check(solution, uncertainty, profiles, minima)
    return tuple(check.estimate(j) for j in profiles)


class _Check:
    """Says of each parameter its value and interval, or why there is none."""

    def __init__(
        self,
        solution: Solution,
        uncertainty: Uncertainty,
        profiles: Mapping[int, Profile | None],
        minima: Sequence[Array],
    ) -> None:
        self.solution, self.uncertainty, self.profiles = solution, uncertainty, profiles
        self.where = solution.problem.where
        self.parameters, self.names = self.where.parameters, self.where.names
        self.values = self.where.values(solution.x)
        self.correlation = uncertainty.correlation
        self.floor = solution.problem.dataset.floor
        self.equal_minima = [other for other in minima if self._is_equal_minimum(other)]

    def estimate(self, j: int) -> Estimate:
        """Return what the fit says about a parameter."""
        parameter, profile = self.parameters[j], self.profiles[j]
        reason, interval = self.reason(j)
        if reason or profile is None or interval is None:
            return Estimate(parameter, None, None, interval, False, reason)
        sigma, number = self.sigma(j), self.values[parameter.name]
        if not profile.corrected:
            return Estimate(parameter, number, sigma, interval, True)
        sigma = (interval[1] - interval[0]) / (2 * self.uncertainty.quantile)
        return Estimate(parameter, number, sigma, interval, True, "interval from the profile likelihood")

    def reason(self, j: int) -> tuple[str, tuple[float, float] | None]:
        """Return why there is no value (empty if there is one), and the interval if any."""
        parameter, profile = self.parameters[j], self.profiles[j]
        if profile is None or (self.uncertainty.in_null_space(j) and profile.open_low and profile.open_high):
            others, null = self.uncertainty.confounded_with(j), self.uncertainty.null_space
            reason = self.confounded([j, *others], null.T @ null[:, j]) if others else "does not show in these runs"
            return reason, None
        width = profile.high - profile.low
        for other in self.equal_minima:
            if not profile.low - width <= other[j] <= profile.high + width:
                here, there = (_text(parameter, value(parameter, float(x[j]))) for x in (self.solution.x, other))
                return f"{here} and {there} fit alike", None
        # Parameters are named together if one explains a large share of the variance of the other.
        others = [i for i in range(len(self.names)) if i != j and self.correlation[i, j] ** 2 > large_share()]
        reason, interval = self.too_wide(j, profile)
        if not others or not (reason or (profile.corrected and self._are_undetermined(others))):
            return reason, interval
        sentence = self.confounded([j, *others], self.correlation[:, j])
        # The end of a bent valley is not the end of the interval: another branch may extend farther.
        return (sentence, None) if profile.corrected else (f"{reason}; {sentence}", interval)

    def too_wide(self, j: int, profile: Profile) -> tuple[str, tuple[float, float] | None]:
        """Return why an interval is too wide (empty if it is not), and the interval if it bounds the parameter.

        The 95 % interval of a uniform prior, without any data, covers 95 % of the plausible range.
        """
        parameter, interval = self.parameters[j], self.interval(j, profile)
        known = self.where.known.get(parameter.name)
        if known and self.sigma(j) > CONFIDENCE * known[1]:
            return f"these runs add nothing to the prior, {_pair_text(parameter, known, ' ± ', known[1])}", None
        is_all = profile.open_low and profile.open_high
        if is_all or profile.high - profile.low > CONFIDENCE * self.where.span[j]:
            nearly, plausible = "" if is_all else "nearly ", _pair_text(parameter, parameter.plausible)
            return f"these runs allow {nearly}all that is plausible, {plausible}", None if is_all else interval
        if profile.open_low or profile.open_high:
            # The value falls as its coordinate rises on an inverse scale.
            has_upper = profile.open_low != (parameter.scale == "inverse")
            bound, end = interval if has_upper else interval[::-1]
            limit = f"{'at most' if has_upper else 'at least'} {_text(parameter, end, digits=2)}"
            if parameter.null is not None and bound == parameter.null:
                return f"{limit}: these runs do not distinguish it from {_text(parameter, bound)}", interval
            side = "lower" if has_upper else "upper"
            return f"{limit}: it may be at the {side} end of what is plausible, {_text(parameter, bound)}", interval
        return ("any value in the interval fits alike" if self.uncertainty.in_null_space(j) else ""), interval

    def sigma(self, j: int) -> float:
        """Return the standard deviation in SI from the covariance."""
        return abs(float(self.where.jacobian(self.solution.x)[j])) * math.sqrt(self.uncertainty.covariance[j, j])

    def interval(self, j: int, profile: Profile) -> tuple[float, float]:
        """Return the interval in SI."""
        low, high = sorted(value(self.parameters[j], end) for end in (profile.low, profile.high))
        return low, high

    def confounded(self, group: list[int], direction: Array) -> str:
        """Return a sentence on parameters that replace one another along a direction."""
        names = [self.names[i] for i in group]
        listed = join_names(names)
        relation = self._relation(*group) if len(group) == 2 else ""
        if relation:
            return f"{listed}: only their {relation} shows in these runs"
        length = np.linalg.norm(direction[group])
        weights = ", ".join(f"{self.names[i]} {direction[i] / length:+.2f}" for i in group)
        return f"{listed} are confounded in these runs (weights {weights})"

    def _relation(self, i: int, j: int) -> str:
        """Return the only combination of two parameters that changes the prediction, found by changing both."""
        first, second = self.parameters[i], self.parameters[j]
        a, b = self.values[first.name], self.values[second.name]
        if not (a and b and math.isfinite(a) and math.isfinite(b)):
            return ""
        variations = {"product": (1.1 * a, b / 1.1), "ratio": (1.1 * a, 1.1 * b)}
        if first.si == second.si:
            shift = 0.1 * min(abs(a), abs(b))
            variations |= {"sum": (a + shift, b - shift), "difference": (a + shift, b + shift)}
        for name, (to_a, to_b) in variations.items():
            alone, both = self._change({i: to_a}), self._change({i: to_a, j: to_b})
            if self.floor < alone < math.inf and both < 1e-3 * alone:
                return name
        return ""

    def _change(self, values: Mapping[int, float]) -> float:
        """Return the squared change of the data's residual when some values change; infinite where the model fails."""
        x = self.solution.x.copy()
        for i, number in values.items():
            x[i] = coordinate(self.parameters[i], number)
        if (found := self.solution.problem.residuals(x)) is None:
            return math.inf
        return sum(float(np.sum((a - b) ** 2)) for a, b in zip(found, self.solution.residuals, strict=True))

    def _are_undetermined(self, places: list[int]) -> bool:
        """Tell whether some of these parameters have neither a value nor a prior."""
        unknown = (
            (i, self.profiles[i]) for i in places if i in self.profiles and self.names[i] not in self.where.known
        )
        return any(profile is None or self.too_wide(i, profile)[0] for i, profile in unknown)

    def _is_equal_minimum(self, other: Array) -> bool:
        """Tell whether a distant minimum has an equal cost, against the parabola about this one."""
        allowed = self.uncertainty.quantile**2 * self.uncertainty.variance + self.floor
        distance, problem = other - self.solution.x, self.solution.problem
        if distance @ self.solution.normal @ distance <= 25 * allowed:
            return False
        return problem.cost(other, problem.residuals(other)) - self.solution.cost < allowed


def _pair_text(parameter: Parameter, pair: tuple[float, float], word: str = " to ", sigma: float | None = None) -> str:
    """Write two values in one unit, which is named once."""
    finite = [abs(number) for number in pair if math.isfinite(number)]
    unit = units.suitable(parameter.unit, max(finite, default=0.0), parameter.si)
    first, second = (_text(parameter, number, sigma, unit=unit) for number in pair)
    return f"{first.removesuffix(unit).rstrip()}{word}{second}"


def _text(
    parameter: Parameter, number: float, sigma: float | None = None, digits: int = 4, unit: str | None = None
) -> str:
    """Write a value in a unit, or in that which suits it, to two digits of its standard deviation if that is given."""
    if sigma and number and math.isfinite(sigma) and math.isfinite(number):
        digits = int(np.clip(2 + math.floor(math.log10(abs(number))) - math.floor(math.log10(sigma)), 2, 9))
    unit = units.suitable(parameter.unit, number, parameter.si) if unit is None else unit
    return units.to_text(number, unit, digits, si=parameter.si)


#: Intervals by index of the coordinate; None in the null space.
Profiles = dict[int, Profile | None]


# --- intervals -------------------------------------------------------------------------------------------------------


def intervals(
    solution: Solution,
    names: Sequence[str],
) -> tuple[Estimate, ...]:
    """Return value, standard deviation, 95 % interval and identifiability of some parameters of a fit.

    If the residual is white and as large as the given noise, the intervals are the classical ones. If it is coloured or
    larger, as it is if physics is missing, they are wider. Two predictions of all records per parameter check the ends;
    more are made if an end is wrong. The fit is refined first, and repeated if a profile finds a better point: the
    values are those of the best point.

    Parameters
    ----------
    solution
        The fit. Its Jacobian may be approximate; it gives the covariance and the first estimate of each end.
    names
        Names of the parameters; the others are nuisance parameters.
    """
    places = [solution.problem.where.names.index(name) for name in names]
    solution, found, made, _ = check_intervals(solution, places, _refine)
    return estimates(solution, found, made)


@lru_cache(maxsize=4)
def _refine(near: Solution) -> tuple[Solution, Uncertainty]:
    """Return a fit with values accurate to `ACCURACY` standard deviations, and its uncertainty."""
    accuracy = ACCURACY**2 * uncertainty(near).variance
    polished = refine_minimum(near, accuracy + near.problem.dataset.floor)
    return polished, uncertainty(polished)


def check_intervals(
    solution: Solution, places: Sequence[int], refine: Callable[[Solution], tuple[Solution, Uncertainty]]
) -> tuple[Solution, Uncertainty, Profiles, bool]:
    """Return a fit, its uncertainty, the intervals of some coordinates, and whether the fit was repeated.

    The fit is repeated from a better point that a profile finds, twice at most.
    """
    for refits in range(3):
        solution, found = refine(solution)
        made = profiles_of(solution, found, places)
        better = next((p.better for p in made.values() if p is not None and p.better is not None), None)
        if better is None or refits == 2:
            break
        solution = solve(solution.problem.fresh(), better) or solution
    return solution, found, made, refits > 0


def profiles_of(solution: Solution, found: Uncertainty, places: Sequence[int]) -> Profiles:
    """Return the intervals of some coordinates, with the ends checked by profiles; None in the null space."""
    # A coordinate without influence in small steps may have some in large ones: a limit far above all readings.
    chosen = [j for j in places if not found.in_null_space(j) or not found.confounded_with(j)]
    made = dict(zip(chosen, solution.problem.each(lambda j: profile(solution, found, j), chosen), strict=True))
    return {j: made.get(j) for j in places}

"""Identifiability of each parameter: a number with its interval, or a sentence that says why there is none."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign import units
from flexdesign.evidence.coordinates import coordinate, value
from flexdesign.evidence.marquardt import Solution
from flexdesign.evidence.profile_likelihood import Profile
from flexdesign.evidence.uncertainty import Uncertainty
from flexdesign.model import Parameter

Array = NDArray[np.float64]
#: An interval this wide, relative to what was plausible or known, says nothing that was not believed before.
TOO_WIDE = 0.9
#: Parameters correlated more than this are named together when one of them is undetermined.
CORRELATED = 0.9


@dataclass(frozen=True)
class Estimate:
    """What a fit says about one parameter.

    Parameters
    ----------
    parameter
        The parameter.
    value, sigma
        The number and its standard deviation in SI; None if the data do not determine it. Where the covariance is not
        to be trusted the standard deviation is that of a normal interval as wide as the one stated.
    interval
        95 % interval in SI. Where the data only bound a parameter the other end is that of the plausible range; None
        if they say nothing.
    determined
        Whether the data determine it.
    reason
        Why it has no number, or what its interval rests on; may be empty.
    entangled
        The other parameters with which it is entangled.
    """

    parameter: Parameter
    value: float | None
    sigma: float | None
    interval: tuple[float, float] | None
    determined: bool
    reason: str = ""
    entangled: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the parameter."""
        return self.parameter.name

    @property
    def value_text(self) -> str:
        """The value with its unit, to two digits of its standard deviation; empty if there is none."""
        if self.value is None:
            return ""
        return _text(self.parameter, self.value, self.sigma)

    @property
    def interval_text(self) -> str:
        """The interval with its unit; empty if there is none."""
        if self.interval is None:
            return ""
        width = self.interval[1] - self.interval[0]
        return _spanned(self.parameter, self.interval, sigma=width / 4)


def estimates(
    solution: Solution,
    uncertainty: Uncertainty,
    profiles: Mapping[int, Profile | None],
    minima: Sequence[Array] = (),
    reveal: Mapping[str, str] | None = None,
) -> tuple[Estimate, ...]:
    """Return what the fit says about some parameters, in the order of `profiles`.

    Parameters
    ----------
    solution, uncertainty
        The fit.
    profiles
        The intervals of these coordinates, by their place; None in the null space.
    minima
        Where all starts ended.
    reveal
        The experiment that would show a parameter, by name.
    """
    check = _Check(solution, uncertainty, profiles, minima)
    made = []
    for j in profiles:
        parameter = solution.problem.where.parameters[j]
        reason, interval, entangled = check.reason(j)
        if reason:
            advice = f"; would show it: {reveal[parameter.name]}" if reveal and parameter.name in reveal else ""
            made.append(Estimate(parameter, None, None, interval, False, reason + advice, entangled))
            continue
        note, interval, sigma = "", check.interval(j), check.sigma(j)
        if _of(profiles, j).corrected:
            note = "interval from the profile likelihood"
            sigma = (interval[1] - interval[0]) / (2 * uncertainty.quantile)
        made.append(Estimate(parameter, check.values[parameter.name], sigma, interval, True, note))
    return tuple(made)


class _Check:
    """Looks for reasons not to report a number."""

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
        self.floor = solution.problem.suite.floor
        self.rivals = [other for other in minima if self._fits_alike(other)]

    def reason(self, j: int) -> tuple[str, tuple[float, float] | None, tuple[str, ...]]:
        """Return why there is no number (empty if there is one), the interval if any, and the confounded parameters."""
        parameter = self.parameters[j]
        profile = self.profiles[j]
        if profile is None or (self.uncertainty.in_null_space(j) and profile.open_low and profile.open_high):
            others, null = self.uncertainty.confounded_with(j), self.uncertainty.null_space
            reason = self.entangled([j, *others], null.T @ null[:, j]) if others else "does not show in these runs"
            return reason, None, tuple(self.names[i] for i in others)
        for rival in self.rivals:
            if self._is_outside(rival[j], j):
                other = _text(parameter, value(parameter, float(rival[j])))
                here = _text(parameter, self.values[parameter.name])
                return f"{here} and {other} fit alike", None, ()
        others = [i for i in range(len(self.names)) if i != j and abs(self.correlation[i, j]) > CORRELATED]
        reason, interval = self.too_wide(j)
        names = tuple(self.names[i] for i in others)
        if not others or not (reason or self._rests_on_unknowns(j, others)):
            return reason, interval, ()
        sentence = self.entangled([j, *others], self.correlation[:, j])
        if profile.corrected:
            return sentence, None, names
        return f"{reason}; {sentence}", interval, names

    def too_wide(self, j: int) -> tuple[str, tuple[float, float] | None]:
        """Return why an interval says too little, and what it says nevertheless."""
        parameter, profile = self.parameters[j], _of(self.profiles, j)
        interval = self.interval(j)
        falling = parameter.scale == "inverse"
        open_low, open_high = (profile.open_low, profile.open_high)[:: -1 if falling else 1]
        known = self.where.known.get(parameter.name)
        if known and self.sigma(j) > TOO_WIDE * known[1]:
            return f"these runs add nothing to what was known, {_spanned(parameter, known, ' ± ', known[1])}", None
        if open_low and open_high:
            return f"these runs allow all that is plausible, {_spanned(parameter, parameter.plausible)}", None
        if profile.high - profile.low > TOO_WIDE * self.where.span[j]:
            return (
                f"these runs allow nearly all that is plausible, {_spanned(parameter, parameter.plausible)}",
                interval,
            )
        if open_low or open_high:
            end = interval[1] if open_low else interval[0]
            limit = f"{'at most' if open_low else 'at least'} {_text(parameter, end, digits=2)}"
            bound = interval[0] if open_low else interval[1]
            if parameter.null is not None and bound == parameter.null:
                return f"{limit}: these runs do not tell it from {_text(parameter, bound)}", interval
            where = f"the {'lower' if open_low else 'upper'} end of what is plausible, {_text(parameter, bound)}"
            return f"{limit}: the interval runs into {where}", interval
        return ("any value in the interval fits alike" if self.uncertainty.in_null_space(j) else ""), interval

    def sigma(self, j: int) -> float:
        """Return the standard deviation in SI from the covariance."""
        return abs(float(self.where.slopes(self.solution.x)[j])) * math.sqrt(self.uncertainty.covariance[j, j])

    def interval(self, j: int) -> tuple[float, float]:
        """Return the interval in SI."""
        profile = _of(self.profiles, j)
        low, high = sorted(value(self.parameters[j], end) for end in (profile.low, profile.high))
        return low, high

    def entangled(self, group: list[int], direction: Array) -> str:
        """Return a sentence on parameters that stand in for one another along a direction."""
        names = [self.names[i] for i in group]
        listed = f"{', '.join(names[:-1])} and {names[-1]}"
        relation = self._relation(*group) if len(group) == 2 else ""
        if relation:
            return f"{listed}: only their {relation} shows in these runs"
        length = np.linalg.norm(direction[group])
        weights = ", ".join(f"{self.names[i]} {direction[i] / length:+.2f}" for i in group)
        return f"{listed} stand in for one another in these runs (weights {weights})"

    def _relation(self, i: int, j: int) -> str:
        """Return what of two parameters stays fixed while both move without a trace, found by moving them."""
        first, second = self.parameters[i], self.parameters[j]
        a, b = self.values[first.name], self.values[second.name]
        if not (a and b and math.isfinite(a) and math.isfinite(b)):
            return ""
        moves = {"product": (1.1 * a, b / 1.1), "ratio": (1.1 * a, 1.1 * b)}
        if first.si == second.si:
            shift = 0.1 * min(abs(a), abs(b))
            moves |= {"sum": (a + shift, b - shift), "difference": (a + shift, b + shift)}
        traces = {}
        for name, (to_a, to_b) in moves.items():
            alone, both = self._rise({i: to_a}), self._rise({i: to_a, j: to_b})
            traces[name] = both / alone if self.floor < alone < math.inf else math.inf
        best = min(traces, key=lambda name: traces[name])
        return best if traces[best] < 1e-3 else ""

    def _rise(self, changed: Mapping[int, float]) -> float:
        """Return the squared change of the data's residual when some values change; infinite where the model fails."""
        x = self.solution.x.copy()
        for i, number in changed.items():
            x[i] = coordinate(self.parameters[i], number)
        if (found := self.solution.problem.residuals(x)) is None:
            return math.inf
        return sum(float(np.sum((a - b) ** 2)) for a, b in zip(found, self.solution.residuals, strict=True))

    def _rests_on_unknowns(self, j: int, others: list[int]) -> bool:
        """Tell whether an interval rests on parameters without a number, and not on the covariance.

        Its ends were then found along a bent valley that is not closed, and another branch of it may lead further.
        """
        if not _of(self.profiles, j).corrected:
            return False
        unknown = [i for i in others if self.names[i] not in self.where.known and i in self.profiles]
        return any(self.profiles[i] is None or self.too_wide(i)[0] for i in unknown)

    def _fits_alike(self, other: Array) -> bool:
        allowed = self.uncertainty.quantile**2 * self.uncertainty.variance + self.floor
        apart = other - self.solution.x
        if float(apart @ self.uncertainty.information @ apart) <= 25 * allowed:
            return False
        problem = self.solution.problem
        return problem.cost(other, problem.residuals(other)) - self.solution.cost < allowed

    def _is_outside(self, x: float, j: int) -> bool:
        profile = _of(self.profiles, j)
        width = profile.high - profile.low
        return not profile.low - width <= x <= profile.high + width


def _of(profiles: Mapping[int, Profile | None], j: int) -> Profile:
    profile = profiles[j]
    assert profile is not None  # only asked of coordinates with an interval
    return profile


def _spanned(parameter: Parameter, pair: tuple[float, float], word: str = " to ", sigma: float | None = None) -> str:
    """Write two values in the parameter's unit, which is named once."""
    first, second = (_text(parameter, number, sigma) for number in pair)
    return f"{first.removesuffix(parameter.unit).rstrip()}{word}{second}"


def _text(parameter: Parameter, number: float, sigma: float | None = None, digits: int = 4) -> str:
    """Write a value in its unit, to two digits of its standard deviation if that is given."""
    if sigma and number and math.isfinite(sigma) and math.isfinite(number):
        digits = int(np.clip(2 + math.floor(math.log10(abs(number))) - math.floor(math.log10(sigma)), 2, 9))
    return units.to_text(number, parameter.unit, digits, si=parameter.si)

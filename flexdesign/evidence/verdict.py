"""The verdict on each parameter: a number with its interval, or a sentence that says why there is none."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign import units
from flexdesign.evidence.coordinates import coordinate, value
from flexdesign.evidence.covariance import Spread
from flexdesign.evidence.profile import Profile
from flexdesign.evidence.residuals import Residuals
from flexdesign.evidence.search import ROUNDING, Minimum
from flexdesign.model import Parameter

Array = NDArray[np.float64]
#: An interval this wide, relative to what was plausible or known, says nothing that was not believed before.
TELLS = 0.9
#: Parameters correlated more than this are named together when one of them is undetermined.
TOGETHER = 0.9


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
    residuals: Residuals,
    minimum: Minimum,
    spread: Spread,
    profiles: Sequence[Profile | None],
    minima: Sequence[Minimum],
    reveal: Mapping[str, str],
) -> tuple[Estimate, ...]:
    """Return the verdict on every free parameter.

    Parameters
    ----------
    residuals, minimum, spread
        The fit.
    profiles
        The intervals of the coordinates; None where a direction is open.
    minima
        Where all starts ended.
    reveal
        The experiment that would show a parameter, by name.
    """
    judge = _Judge(residuals, minimum, spread, profiles, minima)
    made = []
    for j, parameter in enumerate(residuals.where.parameters):
        reason, interval, entangled = judge.refusal(j)
        if reason:
            advice = f"; would show it: {reveal[parameter.name]}" if parameter.name in reveal else ""
            made.append(Estimate(parameter, None, None, interval, False, reason + advice, entangled))
            continue
        number = judge.values[parameter.name]
        sigma = abs(float(residuals.where.slopes(minimum.x)[j])) * math.sqrt(spread.covariance[j, j])
        note, interval = "", judge.interval(j)
        if _of(profiles, j).corrected:
            note, sigma = "interval from the profile likelihood", (interval[1] - interval[0]) / (2 * spread.quantile)
        made.append(Estimate(parameter, number, sigma, interval, True, note))
    return tuple(made)


class _Judge:
    """Looks for reasons not to report a number."""

    def __init__(
        self,
        residuals: Residuals,
        minimum: Minimum,
        spread: Spread,
        profiles: Sequence[Profile | None],
        minima: Sequence[Minimum],
    ) -> None:
        self.residuals, self.minimum, self.spread, self.profiles = residuals, minimum, spread, profiles
        self.parameters, self.names = residuals.where.parameters, residuals.where.names
        self.values = residuals.where.values(minimum.x)
        self.correlation = correlation(spread.covariance)
        self.floor = (ROUNDING * residuals.size()) ** 2
        self.rivals = [other for other in minima if self._fits_alike(other)]

    def refusal(self, j: int) -> tuple[str, tuple[float, float] | None, tuple[str, ...]]:
        """Return why there is no number (empty if there is one), the interval if it says something, and the company."""
        parameter = self.parameters[j]
        profile = self.profiles[j]
        if profile is None or (self.spread.is_open(j) and profile.open_low and profile.open_high):
            company = self.spread.company(j)
            direction = self.spread.open.T @ self.spread.open[:, j]
            reason = self.entangled([j, *company], direction) if company else "does not show in these runs"
            return reason, None, tuple(self.names[i] for i in company)
        for rival in self.rivals:
            if self._is_outside(rival.x[j], j):
                other = _text(parameter, value(parameter, float(rival.x[j])))
                here = _text(parameter, self.values[parameter.name])
                return f"{here} and {other} fit alike", None, ()
        company = [i for i in range(len(self.names)) if i != j and abs(self.correlation[i, j]) > TOGETHER]
        reason, interval = self.too_wide(j)
        names = tuple(self.names[i] for i in company)
        if not company or not (reason or self._leans_on(j, company)):
            return reason, interval, ()
        shares = self.spread.covariance[:, j] / np.sqrt(np.diag(self.spread.covariance))
        sentence = self.entangled([j, *company], shares)
        if profile.corrected:
            return sentence, None, names
        return f"{reason}; {sentence}", interval, names

    def too_wide(self, j: int) -> tuple[str, tuple[float, float] | None]:
        """Return why an interval says too little, and what it says nevertheless."""
        parameter, profile = self.parameters[j], _of(self.profiles, j)
        interval = self.interval(j)
        falling = parameter.scale == "inverse"
        open_low, open_high = (profile.open_low, profile.open_high)[:: -1 if falling else 1]
        known = self.residuals.where.known.get(parameter.name)
        if known:
            slope = abs(float(self.residuals.where.slopes(self.minimum.x)[j]))
            if slope * math.sqrt(self.spread.covariance[j, j]) > TELLS * known[1]:
                return f"these runs add nothing to what was known, {_spanned(parameter, known, ' ± ', known[1])}", None
        if open_low and open_high:
            return f"these runs allow all that is plausible, {_spanned(parameter, parameter.plausible)}", None
        if profile.high - profile.low > TELLS * self.residuals.where.span[j]:
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
        return ("any value in the interval fits alike" if self.spread.is_open(j) else ""), interval

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
            traces[name] = both / alone if alone > self.floor else math.inf
        best = min(traces, key=lambda name: traces[name])
        return best if traces[best] < 1e-3 else ""

    def _rise(self, changed: Mapping[int, float]) -> float:
        """Return the squared change of the data's residual when some values change."""
        x = self.minimum.x.copy()
        for i, number in changed.items():
            x[i] = coordinate(self.parameters[i], number)
        change = self.residuals.data(x) - self.residuals.data(self.minimum.x)
        return float(change @ change)

    def _leans_on(self, j: int, company: list[int]) -> bool:
        """Tell whether an interval rests on parameters without a number, and not on the covariance.

        Its ends were then found along a bent valley that is not closed, and another branch of it may lead further.
        """
        unknown = [i for i in company if self.names[i] not in self.residuals.where.known]
        is_open = any(self.profiles[i] is None or self.too_wide(i)[0] for i in unknown)
        return is_open and _of(self.profiles, j).corrected

    def _fits_alike(self, other: Minimum) -> bool:
        allowed = self.spread.quantile**2 * self.spread.variance + self.floor
        apart = self.spread.jacobian @ (other.x - self.minimum.x)
        return float(apart @ apart) > 25 * allowed and self.residuals.cost(other.x) - self.minimum.cost < allowed

    def _is_outside(self, x: float, j: int) -> bool:
        profile = _of(self.profiles, j)
        width = profile.high - profile.low
        return not profile.low - width <= x <= profile.high + width


def correlation(covariance: Array) -> Array:
    """Return the correlation matrix; rows without variance are zero off the diagonal."""
    sigma = np.sqrt(np.diag(covariance))
    sigma = np.where(sigma > 0, sigma, 1.0)
    matrix = covariance / np.outer(sigma, sigma)
    np.fill_diagonal(matrix, 1.0)
    return np.asarray(matrix)


def _of(profiles: Sequence[Profile | None], j: int) -> Profile:
    profile = profiles[j]
    assert profile is not None  # only asked of coordinates that are not open
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

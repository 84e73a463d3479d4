"""Profile likelihood: whether an interval from the covariance can be trusted, and the interval to state if not.

The covariance supposes that the cost is a parabola. To check it, a parameter is displaced to the end of its interval
and the others are fitted again; the cost must then have risen by the square of the quantile (Venzon and Moolgavkar
1988; Raue et al. 2009, Bioinformatics 25, 1923-1929). Where the residual is coloured that rise is scaled by the ratio
of the sandwich variance to the bread (Rotnitzky and Jewell 1990). Elsewhere the end is a root of the profile, which is
bracketed and found by Brent's method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.estimation.least_squares.levenberg_marquardt import FOLLOWING, Columns, Effort, Solution, solve
from flexdesign.estimation.uncertainty.covariance import Uncertainty

#: An end from the covariance is kept if it is right to this share of its distance; of an end that is searched for, and
#: of the rise there, the relative accuracy. One sees no tenth of an interval, and the search must be better than that.
COVARIANCE_TOLERANCE, PROFILE_ACCURACY = 0.1, 0.03
#: Rises relative to that at the end are limited to this and its inverse: zero and infinity have no logarithm.
LEAST_RISE = 1e-6


@dataclass(frozen=True, eq=False)
class Profile:
    """The interval of one coordinate after its ends were checked.

    Parameters
    ----------
    low, high
        The ends; a bound of the coordinate where the interval is open on that side.
    open_low, open_high
        Whether the cost rises too little all the way to the bound.
    corrected
        Whether an end differs from that of the covariance.
    better
        A point that fits better than the supposed minimum, if one was met.
    """

    low: float
    high: float
    open_low: bool
    open_high: bool
    corrected: bool
    better: Array | None = None


def quadratic(solution: Solution, uncertainty: Uncertainty, j: int) -> Profile:
    """Return the interval of coordinate `j` as the covariance gives it; open where it leaves the bounds."""
    low, high = solution.problem.where.lower[j], solution.problem.where.upper[j]
    ends = solution.x[j] - uncertainty.half_width[j], solution.x[j] + uncertainty.half_width[j]
    return Profile(max(ends[0], low), min(ends[1], high), ends[0] <= low, ends[1] >= high, False)


@lru_cache(maxsize=16)  # the strength of an effect is asked for before all numbers are
def profile(solution: Solution, uncertainty: Uncertainty, j: int) -> Profile:
    """Return the interval of coordinate `j`, each end checked by fitting the others again."""
    path = _Path(solution, uncertainty, j)
    low, open_low, corrected_low = path.end(-1.0)
    high, open_high, corrected_high = path.end(1.0)
    return Profile(low, high, open_low, open_high, corrected_low or corrected_high, path.better)


class _Path:
    """The profile of one coordinate: the best fit of the others at each of its values."""

    def __init__(self, solution: Solution, uncertainty: Uncertainty, j: int) -> None:
        self.minimum, self.problem, self.j = solution, solution.problem, j
        self.others = np.array([i for i in range(len(solution.x)) if i != j], dtype=int)
        where, variance = self.problem.where, uncertainty.inverse_hessian[j, j]
        if uncertainty.in_null_space(j):  # without influence nearby: no other follows, and the whole range is searched
            self.tangent = np.eye(len(solution.x))[j]
            self.half = math.inf if math.isfinite(where.span[j]) else float(where.sizes(solution.x)[j])
            self.expected = uncertainty.quantile**2 * uncertainty.variance
        else:
            # Parameters of one run stay: the response is not smooth in its initial state.
            shared = [parameter.run in ("", where.parameters[j].run) for parameter in where.parameters]
            self.tangent = np.where(shared, uncertainty.inverse_hessian[:, j] / variance, 0.0)
            self.half = float(uncertainty.half_width[j])
            self.expected = float(self.half**2 / variance)
        self.floor = self.problem.dataset.floor
        self.columns: Columns = {k: parts for k, parts in solution.columns().items() if k != where.names[j]}
        self.better: Array | None = None

    def end(self, side: float) -> tuple[float, bool, bool]:
        """Return the end of the interval on one side, whether it is open, and whether the covariance erred."""
        from scipy.optimize import brentq

        x, where = float(self.minimum.x[self.j]), self.problem.where
        bound = float((where.lower if side < 0 else where.upper)[self.j])
        room = abs(bound - x)
        if room == 0 or self.expected <= self.floor:  # only rounding is left to compare
            return x + side * min(self.half, room), self.half >= room, False
        # By distance from the minimum: the derivatives of all coordinates there; and by its logarithm the root of the
        # relative rise, as a logarithm: a straight line where the cost is any power of the distance.
        derivatives, met = {0.0: side * self.tangent}, dict[float, float]()
        columns = {0.0: self.columns}

        def excess(at: float) -> float:
            distance = math.exp(at)
            if x + side * distance == x:  # without displacement no rise
                return math.log(LEAST_RISE) / 2
            if at not in met:
                nearest = max(d for d in derivatives if d < distance)
                guess = derivatives[nearest] * distance
                increase, displacement, columns[distance] = self.cost_increase(side * distance, guess, columns[nearest])
                found = math.log(min(max(increase / self.expected, LEAST_RISE), 1 / LEAST_RISE)) / 2
                is_end = abs(found) <= PROFILE_ACCURACY or self.better is not None  # from there the fit is repeated
                met[at], derivatives[distance] = (0.0 if is_end else found), displacement / distance
            return met[at]

        first = min(self.half, where.span[self.j] / 8, room)
        if first == self.half and abs(excess(math.log(first))) <= COVARIANCE_TOLERANCE:
            return x + side * first, False, False
        bracket = _bracket(excess, math.log(first), math.log(room))
        if bracket is None:
            return bound, True, self.half < room
        root = brentq(excess, *bracket, xtol=PROFILE_ACCURACY, maxiter=8, disp=False)
        return x + side * math.exp(float(root)), False, True

    def cost_increase(self, displacement: float, guess: Array, columns: Columns) -> tuple[float, Array, Columns]:
        """Return how far the profile rises above the minimum, the displacement of all coordinates, and the Jacobian.

        The others take steps with a Jacobian from nearer to the minimum, each at the price of one simulation. Where
        they end the cost can only be too high: if it is, they are fitted with a Jacobian found there, which then serves
        further on; nearer to the minimum it would lead them astray.
        """
        where, small = self.problem.where, PROFILE_ACCURACY * self.expected + self.floor
        x = np.clip(self.minimum.x + guess, where.lower, where.upper)
        x[self.j] = np.clip(self.minimum.x[self.j] + displacement, where.lower[self.j], where.upper[self.j])
        others = self.problem.fixed(self.j, float(x[self.j]), x)
        found = solve(others, x[self.others], FOLLOWING, columns, small=small)
        if found is None:
            return math.inf, x - self.minimum.x, columns
        if self._above_minimum(x, found) > (1 + COVARIANCE_TOLERANCE) ** 2 * self.expected and self.others.size:
            found = solve(others, found.x, Effort(2, 0.0, is_exact=False), found.columns(), small=small) or found
            columns = found.columns()
        increase = self._above_minimum(x, found)
        if -increase > small:
            self.better = x
        return increase, x - self.minimum.x, columns

    def _above_minimum(self, x: Array, found: Solution) -> float:
        """Move the others to where they were fitted, and return the cost there less the minimum's."""
        x[self.others] = found.x
        return self.problem.cost(x, list(found.residuals)) - self.minimum.cost


def _bracket(excess: Callable[[float], float], first: float, last: float) -> tuple[float, float] | None:
    """Return logarithms of distances between which the end is; None if it is beyond the last.

    A long way outwards is gone in some steps of a factor of two, so that the others can follow where the valley bends;
    one inwards, from a covariance that is far too wide, in steps of eight.
    """
    inside = outside = first
    if excess(first) < 0:
        doubled = [first + k * math.log(2) for k in range(1, 7)]
        for outside in [*(d for d in doubled if d < last), *([last] if math.isfinite(last) else [])]:
            if excess(outside) >= 0:
                return inside, outside
            inside = outside
        return None
    while excess(inside) > 0:
        inside, outside = inside - math.log(8), inside
    return inside, outside

"""Profile likelihood: whether an interval from the covariance can be trusted, and the interval to state if not.

The covariance supposes that the cost is a parabola. To check it, a parameter is displaced to the end of its interval
and the others are fitted again; the cost must then have risen by the square of the quantile (Venzon and Moolgavkar
1988; Raue et al. 2009, Bioinformatics 25, 1923-1929). Where the residual is coloured that rise is scaled by the ratio
of the sandwich variance to the bread (Rotnitzky and Jewell 1990).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.evidence.coordinates import value
from flexdesign.evidence.marquardt import FOLLOWING, Columns, Effort, Solution, solve
from flexdesign.evidence.uncertainty import Uncertainty

Array = NDArray[np.float64]
#: Bounds on the root of the rise over the expected rise within which an end of the interval is kept as it is: intervals
#: are then wrong by a tenth of their width at most.
TRUSTED = (0.9, 1.1)
#: How close that root must come to one where an end is searched for.
CLOSE = 0.03
#: Accuracy of the cost along a profile, as a share of the expected rise: it moves an end by half of that.
SHARE_OF_RISE = 0.02
#: Steps on the way to an end, outwards and back; share of the plausible range that the first may cover.
OUTWARD, BACK, LEGS = 6, 6, 8


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


def profile(solution: Solution, uncertainty: Uncertainty, j: int) -> Profile:
    """Return the interval of coordinate `j`, each end checked by fitting the others again."""
    walk = _Walk(solution, uncertainty, j)
    low, open_low, corrected_low = walk.end(-1.0)
    high, open_high, corrected_high = walk.end(1.0)
    return Profile(low, high, open_low, open_high, corrected_low or corrected_high, walk.better)


class _Walk:
    """The way from the minimum along one coordinate, the others following."""

    def __init__(self, solution: Solution, uncertainty: Uncertainty, j: int) -> None:
        self.minimum, self.problem, self.j = solution, solution.problem, j
        self.others = np.array([i for i in range(len(solution.x)) if i != j], dtype=int)
        where, variance = self.problem.where, uncertainty.bread[j, j]
        if uncertainty.in_null_space(j):  # without influence nearby nothing follows, and the whole range is searched
            self.direction = np.eye(len(solution.x))[j]
            self.half = math.inf if math.isfinite(where.span[j]) else float(where.sizes(solution.x)[j])
            self.rise = uncertainty.quantile**2 * uncertainty.variance
        else:
            # Numbers of one run stay: where a record began is not smooth, and what little they gain is found later.
            shared = [parameter.run in ("", where.parameters[j].run) for parameter in where.parameters]
            self.direction = np.where(shared, uncertainty.bread[:, j] / variance, 0.0)
            self.half = float(uncertainty.half_width[j])
            self.rise = float(self.half**2 / variance)
        self.floor = self.problem.suite.floor
        self.columns: Columns = {k: parts for k, parts in solution.columns().items() if k != where.names[j]}
        self.better: Array | None = None

    def end(self, side: float) -> tuple[float, bool, bool]:
        """Return the end of the interval on one side, whether it is open, and whether the covariance erred."""
        at = float(self.minimum.x[self.j])
        where = self.problem.where
        bound = float((where.lower if side < 0 else where.upper)[self.j])
        room = abs(bound - at)
        if room == 0:
            return bound, True, False
        if self.rise <= self.floor:  # nothing but rounding is left to compare
            return at + side * min(self.half, room), self.half >= room, False
        # A long way is gone in steps, so that the others can follow where the valley bends.
        way = min(self.half, room, where.span[self.j] / LEGS)
        height, follows = self.height(side * way, self.direction * side * way)
        if way == self.half and TRUSTED[0] <= height <= TRUSTED[1]:
            return at + side * way, False, False
        low, high = (0.0, 0.0, self.direction * side), (way, height, follows / way)
        for leg in range(1, OUTWARD + 1):
            if high[1] >= 1 or high[0] == room:
                break
            low, way = high, room if leg == OUTWARD and math.isfinite(room) else min(2 * high[0], room)
            height, follows = self.height(side * way, high[2] * way)
            high = way, height, follows / way
        if high[1] < 1:
            return (bound if high[0] == room else side * math.inf), True, self.half < room
        for _ in range(BACK):
            # False position, kept off the ends so that a steep rise on one side does not stall it.
            share = (1 - low[1]) / (high[1] - low[1]) if math.isfinite(high[1]) else 0.5
            way = low[0] + float(np.clip(share, 0.1, 0.9)) * (high[0] - low[0])
            height, follows = self.height(side * way, low[2] * way)
            if abs(height - 1) < CLOSE:
                break
            low, high = ((way, height, follows / way), high) if height < 1 else (low, (way, height, follows / way))
        return at + side * way, False, True

    def height(self, displacement: float, guess: Array) -> tuple[float, Array]:
        """Return the root of the rise over the expected rise, and how the others have followed.

        The others take steps with the Jacobian of the minimum, each at the price of one simulation. Where they end
        the cost can only be too high: if it is not, they are there; if it is, they are fitted with a Jacobian of the
        place, which then serves further on.
        """
        where, small = self.problem.where, SHARE_OF_RISE * self.rise + self.floor
        x = np.clip(self.minimum.x + guess, where.lower, where.upper)
        x[self.j] = np.clip(self.minimum.x[self.j] + displacement, where.lower[self.j], where.upper[self.j])
        others = self.problem.fixed(self.j, float(x[self.j]), x)
        found = solve(others, x[self.others], FOLLOWING, self.columns, small=small)
        if found is None:
            return math.inf, x - self.minimum.x
        if self.rise_to(found, x) > TRUSTED[1] ** 2 * self.rise and self.others.size:
            found = solve(others, found.x, Effort(30, 0.0, is_exact=False), found.columns(), small=small) or found
            self.columns = found.columns()
        x[self.others] = found.x
        rise = self.rise_to(found, x)
        if -rise > small:
            self.better = x
        return math.sqrt(max(rise, 0.0) / self.rise), x - self.minimum.x

    def rise_to(self, found: Solution, x: Array) -> float:
        """Return how far the cost is above the minimum's, that of the held parameter's prior knowledge among it."""
        parameter = self.problem.where.parameters[self.j]
        middle, sigma = self.problem.where.known.get(parameter.name, (0.0, math.inf))
        return found.cost + ((value(parameter, float(x[self.j])) - middle) / sigma) ** 2 - self.minimum.cost

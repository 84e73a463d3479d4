"""Profile likelihood: whether an interval from the covariance can be trusted, and what to state if not.

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

from flexdesign.evidence.covariance import Spread
from flexdesign.evidence.residuals import STEP, Residuals
from flexdesign.evidence.search import ROUNDING, Minimum

Array = NDArray[np.float64]
#: Bounds on the root of the rise over the expected rise within which an end of the interval is kept as it is.
TRUSTED = (0.9, 1.1)
#: How close that root must come to one where an end is searched for.
CLOSE = 0.03
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


def quadratic(residuals: Residuals, minimum: Minimum, spread: Spread, j: int) -> Profile:
    """Return the interval of coordinate `j` as the covariance gives it; open where it leaves the bounds."""
    low, high = residuals.where.lower[j], residuals.where.upper[j]
    ends = minimum.x[j] - spread.half[j], minimum.x[j] + spread.half[j]
    return Profile(max(ends[0], low), min(ends[1], high), ends[0] <= low, ends[1] >= high, False)


def profile(residuals: Residuals, minimum: Minimum, spread: Spread, j: int) -> Profile:
    """Return the interval of coordinate `j`, each end checked by fitting the others again."""
    walk = _Walk(residuals, minimum, spread, j)
    low, open_low, corrected_low = walk.end(-1.0)
    high, open_high, corrected_high = walk.end(1.0)
    return Profile(low, high, open_low, open_high, corrected_low or corrected_high, walk.better)


class _Walk:
    """The way from the minimum along one coordinate, the others following."""

    def __init__(self, residuals: Residuals, minimum: Minimum, spread: Spread, j: int) -> None:
        self.residuals, self.minimum, self.spread, self.j = residuals, minimum, spread, j
        variance = spread.bread[j, j]
        self.others = np.array([i for i in range(len(minimum.x)) if i != j], dtype=int)
        if spread.is_open(j):  # without influence nearby: nobody follows, and the whole range is asked
            self.follow = np.eye(len(minimum.x))[j]
            self.half = (
                math.inf if math.isfinite(residuals.where.span[j]) else float(residuals.where.sizes(minimum.x)[j])
            )
            self.rise = spread.quantile**2 * spread.variance
        else:
            self.follow = spread.bread[:, j] / variance
            self.half = float(spread.half[j])
            self.rise = float(self.half**2 / variance)
        self.floor = (ROUNDING * residuals.size()) ** 2
        jacobian = spread.jacobian[:, self.others]
        self.slopes = jacobian
        self.solve = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-12, hermitian=True)
        self.better: Array | None = None

    def end(self, side: float) -> tuple[float, bool, bool]:
        """Return the end of the interval on one side, whether it is open, and whether the covariance erred."""
        at = float(self.minimum.x[self.j])
        where = self.residuals.where
        bound = float((where.lower if side < 0 else where.upper)[self.j])
        room = abs(bound - at)
        if room == 0:
            return bound, True, False
        if self.rise <= self.floor:  # nothing but rounding is left to compare
            return at + side * min(self.half, room), self.half >= room, False
        # A long way is gone in steps, so that the others can follow where the valley bends.
        way = min(self.half, room, where.span[self.j] / LEGS)
        height, follow = self.height(side * way, self.follow * side * way)
        if way == self.half and TRUSTED[0] <= height <= TRUSTED[1]:
            return at + side * way, False, False
        low, high = (0.0, 0.0, self.follow * side), (way, height, follow / way)
        for leg in range(1, OUTWARD + 1):
            if high[1] >= 1 or high[0] == room:
                break
            low, way = high, room if leg == OUTWARD and math.isfinite(room) else min(2 * high[0], room)
            height, follow = self.height(side * way, high[2] * way)
            high = way, height, follow / way
        if high[1] < 1:
            return (bound if high[0] == room else side * math.inf), True, self.half < room
        for _ in range(BACK):
            # False position, kept off the ends so that a steep rise on one side does not stall it.
            share = (1 - low[1]) / (high[1] - low[1]) if math.isfinite(high[1]) else 0.5
            way = low[0] + float(np.clip(share, 0.1, 0.9)) * (high[0] - low[0])
            height, follow = self.height(side * way, low[2] * way)
            if abs(height - 1) < CLOSE:
                break
            low, high = ((way, height, follow / way), high) if height < 1 else (low, (way, height, follow / way))
        return at + side * way, False, True

    def height(self, displacement: float, guess: Array) -> tuple[float, Array]:
        """Return the root of the rise over the expected rise, and how the others have followed.

        The others take steps with the Jacobian of the minimum, each at the price of one simulation. Where they end
        the cost can only be too high: if it is not, they are there; if it is, they are fitted with a Jacobian of the
        place.
        """
        where = self.residuals.where
        x = np.clip(self.minimum.x + guess, where.lower, where.upper)
        x[self.j] = np.clip(self.minimum.x[self.j] + displacement, where.lower[self.j], where.upper[self.j])
        x, cost = self.chords(x)
        if cost - self.minimum.cost > TRUSTED[1] ** 2 * self.rise:
            x, cost = self.refit(x, cost)
        drop = self.minimum.cost - cost
        if drop > 0.02 * self.rise + self.floor:
            self.better = x
        return math.sqrt(max(-drop, 0.0) / self.rise), x - self.minimum.x

    def chords(self, x: Array) -> tuple[Array, float]:
        """Return where steps with the Jacobian of the minimum lead while they pay, and the cost there."""
        where = self.residuals.where
        best, lowest = x, math.inf
        for _ in range(6):
            residual = self.residuals(x)
            cost = float(residual @ residual) if math.isfinite(residual[0]) else math.inf
            if cost >= lowest:
                break
            best, lowest = x, cost
            gradient = self.slopes.T @ residual
            step = self.solve @ gradient
            if gradient @ step <= 0.02 * self.rise + self.floor:
                break
            x = best.copy()
            x[self.others] -= step
            x = np.clip(x, where.lower, where.upper)
        return best, lowest

    def refit(self, x: Array, cost: float) -> tuple[Array, float]:
        """Return the minimum over the others, and its cost."""
        from scipy.optimize import least_squares

        where, others = self.residuals.where, self.others
        if not math.isfinite(cost) or not others.size:
            return x, cost
        steps = STEP * where.sizes(x)

        def full(part: Array) -> Array:
            whole = x.copy()
            whole[others] = part
            return whole

        def jacobian(part: Array) -> Array:
            at = full(part)
            data = self.residuals.jacobian(at, steps, fixed=[self.j])
            return np.vstack([data, self.residuals.before_jacobian(at)[:, others]])

        gap = 1e-9 * np.where(np.isfinite(where.span), where.span, 0.0)[others]
        found = least_squares(
            lambda part: self.residuals(full(part)),
            np.clip(x[others], where.lower[others] + gap, where.upper[others] - gap),
            jacobian,
            bounds=(where.lower[others], where.upper[others]),
            x_scale="jac",
            ftol=1e-4,
            xtol=1e-6,
            gtol=1e-15,
            max_nfev=20,
        )
        return (full(found.x), 2 * float(found.cost)) if 2 * found.cost < cost else (x, cost)

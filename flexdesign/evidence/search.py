"""The search for the best minimum: least squares from several starts, and how many of them agree."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.errors import InputError
from flexdesign.evidence.residuals import Residuals
from flexdesign.evidence.suite import STEP, Map

Array = NDArray[np.float64]
#: Points whose cost is looked at, and of these points that take a step, for each start that may be polished.
SCREENED, STEPPED = 8, 4
#: Polished starts that must agree on the best minimum for the search to stop early.
ENOUGH = 3
#: Two minima are one if their costs differ by less than this share of the noise's variance.
ALIKE = 0.1
#: A residual below this share of the data is rounding: costs are not told apart there.
ROUNDING = 1e-7


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where one start ended.

    Parameters
    ----------
    x
        The point; coordinates.
    cost
        Sum of squared residuals there.
    steps
        Steps of the finite differences there.
    """

    x: Array
    cost: float
    steps: Array


@dataclass(frozen=True)
class Starts:
    """How the starts of a fit ended.

    Parameters
    ----------
    asked
        How many starts were asked for.
    polished
        How many were followed to their minimum before enough of them agreed.
    agreed
        How many of these ended at the best minimum.
    """

    asked: int
    polished: int
    agreed: int

    @property
    def is_stuck(self) -> bool:
        """Tell whether nothing confirms that the minimum is the best: no second start ended there."""
        return self.agreed < 2

    def __str__(self) -> str:
        if self.polished == 1:
            return "one start only: nothing confirms that this minimum is the best"
        text = f"{self.agreed} of {self.polished} starts ended at the best minimum"
        return text + ("; the fit may be stuck: ask for more starts" if self.is_stuck else "")


def polish(
    residuals: Residuals, x: Array, *, each: Map = map, tolerance: float = 1e-8, central: bool = False, most: int = 60
) -> Minimum:
    """Return the minimum that a trust-region search reaches from `x`.

    Branch, Coleman and Li (1999): SIAM J. Sci. Comput. 21, 1-23, as implemented by scipy; the coordinates are scaled
    by the Jacobian and kept within their bounds. `most` is the largest number of points tried.
    """
    from scipy.optimize import least_squares

    where = residuals.where
    steps = STEP * where.sizes(x)

    def jacobian(at: Array) -> Array:
        data = residuals.jacobian(at, steps, each=each, central=central)
        return np.vstack([data, residuals.before_jacobian(at)])

    found = least_squares(
        residuals,
        _inside(x, where.lower, where.upper),
        jacobian,
        bounds=(where.lower, where.upper),
        method="trf",
        x_scale="jac",
        ftol=tolerance,
        xtol=tolerance,
        gtol=1e-15,  # the cost has the unit of nothing in particular
        max_nfev=most,
    )
    return Minimum(found.x, 2 * float(found.cost), steps)


def search(
    residuals: Residuals, starts: int, seed: int, each: Map, progress: Callable[[str], None]
) -> tuple[Minimum, Starts, list[Minimum]]:
    """Return the best minimum, how the starts ended, and the minima of all starts.

    The first start is the model's own values. The others come from a scrambled Sobol sample of the plausible ranges
    (Owen 1998): the best of it first; and if these disagree, those that are best after a step of their own. The cost
    alone misleads where a small amplitude fits better than a large one at the wrong frequency.

    Raises
    ------
    InputError
        If the model fails at every point.
    """
    minima: list[Minimum] = []
    agreed = 0
    for point in _points(residuals, starts, seed, each):
        minima.append(polish(residuals, point, each=each))
        agreed = sum(_alike(residuals, minima))
        progress(f"start {len(minima)} of {starts}: {agreed} at the best minimum")
        if agreed == ENOUGH:
            break
    if not minima:
        remedy = "the model cannot be simulated at its present values nor elsewhere in the plausible ranges"
        raise InputError("fit", "model", None, remedy)
    return min(minima, key=lambda minimum: minimum.cost), Starts(starts, len(minima), agreed), minima


def _alike(residuals: Residuals, minima: list[Minimum]) -> list[bool]:
    """Tell of each minimum whether it is as good as the best of them."""
    best = min(minimum.cost for minimum in minima)
    variance = best / max(residuals.samples - len(minima[0].x) - residuals.offsets, 1)
    floor = (ROUNDING * residuals.size()) ** 2
    return [minimum.cost <= best + ALIKE * variance + floor for minimum in minima]


def _points(residuals: Residuals, starts: int, seed: int, each: Map) -> Iterator[Array]:
    """Yield the points to start from, no more than `starts`; later ones are sought only when they are asked for."""
    first = residuals.where.start
    left = starts
    if math.isfinite(residuals.cost(first)):
        yield first
        left -= 1
    if not left:
        return
    sampled = _sampled(residuals, starts, seed, each)
    early = sampled[: min(left, ENOUGH - 1)]
    yield from early
    left -= len(early)
    if left:
        stepped = list(each(lambda x: polish(residuals, x, most=2), sampled))
        for start in sorted(stepped, key=lambda minimum: minimum.cost)[:left]:
            yield start.x


def _sampled(residuals: Residuals, starts: int, seed: int, each: Map) -> list[Array]:
    """Return the best points of a sample of the plausible ranges, best first, with some distance between them."""
    from scipy.stats.qmc import Sobol

    low, high = residuals.where.sampled()
    wanted = STEPPED * starts
    power = math.ceil(math.log2(SCREENED * starts))
    sample = Sobol(len(low), rng=np.random.default_rng(seed)).random_base2(power)
    costs = np.array(list(each(lambda unit: residuals.cost(low + unit * (high - low)), sample)))
    order = [i for i in np.argsort(costs, kind="stable") if math.isfinite(costs[i])]
    apart = 0.5 * wanted ** (-1 / len(low))  # half the distance between as many points on a grid
    chosen: list[int] = []
    for i in order:
        if len(chosen) < wanted and all(np.max(np.abs(sample[i] - sample[k])) > apart for k in chosen):
            chosen.append(i)
    return [low + sample[i] * (high - low) for i in chosen]


def _inside(x: Array, low: Array, high: Array) -> Array:
    """Return the point moved off its bounds, as the search asks."""
    gap = np.where(np.isfinite(high - low), 1e-6 * (high - low), 0.0)
    return np.clip(x, low + gap, high - gap)

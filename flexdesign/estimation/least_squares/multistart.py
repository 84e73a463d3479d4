"""Local minima: least squares from several starting points."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.estimation.least_squares.levenberg_marquardt import SMALL_REDUCTION, Solution, solve
from flexdesign.estimation.least_squares.residual_function import Coordinates, Problem, coordinate, exists

#: Points whose cost is computed for each start that may be followed: a tone of 15 periods with unknown amplitude,
#: frequency and phase is then found in 38 of 40 fits, with half as many in 25.
STARTING_POINTS = 32


@dataclass(frozen=True)
class Starts:
    """How the starts of a fit ended.

    Parameters
    ----------
    asked
        How many starts were asked for.
    refined
        How many were followed to their minimum before three of them agreed.
    converged
        How many of these ended at the best minimum.
    """

    asked: int
    refined: int
    converged: int

    @property
    def is_unconfirmed(self) -> bool:
        """Tell whether nothing confirms that the minimum is the best: no second start ended there."""
        return self.converged < 2

    def __str__(self) -> str:
        if self.refined == 1:
            return "one start only: nothing confirms that this minimum is the best"
        text = f"{self.converged} of {self.refined} starts ended at the best minimum"
        return text + ("; the fit may be stuck: ask for more starts" if self.is_unconfirmed else "")


def multistart(problem: Problem, starts: int, progress: Callable[[str], None]) -> tuple[Solution, Starts, list[Array]]:
    """Return the best minimum, how the starts ended, and the minima of all starts.

    The first start is the model's own values. The others are the best points of a scrambled Sobol sample of the
    plausible ranges (Owen 1998). The search stops when three starts agree on the best minimum: with two, it would often
    not meet another minimum that fits alike.

    Raises
    ------
    InputError
        If the model fails at every point, or refuses the observations.
    """
    found: list[Solution] = []
    summary = Starts(starts, 0, 0)
    for point in _points(problem, starts):
        if (minimum := solve(problem.fresh(), point, small=problem.dataset.floor)) is not None:
            found.append(minimum)
        summary = Starts(starts, len(found), _count_converged(problem, found))
        progress(f"start {len(found)} of {starts}: {summary.converged} at the best minimum")
        if summary.converged == 3:
            break
    if not found:
        remedy = "the model cannot be simulated at its present values nor elsewhere in the plausible ranges"
        raise InputError("fit", "model", None, remedy)
    return min(found, key=lambda solution: solution.cost), summary, [solution.x for solution in found]


def _count_converged(problem: Problem, found: list[Solution]) -> int:
    """Return how many minima are as good as the best, by the reduction at which the search for each ends."""
    best = min((solution.cost for solution in found), default=0.0)
    parameters = len(problem.where.names) + sum(record.columns.shape[1] for record in problem.dataset.records)
    variance = best / max(problem.dataset.samples - parameters, 1)
    return sum(solution.cost <= best + SMALL_REDUCTION * variance + problem.dataset.floor for solution in found)


def _points(problem: Problem, starts: int) -> Iterator[Array]:
    """Yield the points to start from, no more than `starts`; the sample is drawn only when it is asked for."""
    first, others = problem.where.start, starts
    if problem.residuals(first) is not None:
        yield first
        others -= 1
    else:  # a model that refuses the observations says why
        for record in problem.dataset.records:
            with suppress(ArithmeticError, np.linalg.LinAlgError), np.errstate(all="ignore"):
                record.difference(np.asarray(problem.at(first).predict(record.observation)))
    if others:
        yield from _sample_starts(problem, starts)[:others]


def _sample_starts(problem: Problem, starts: int) -> list[Array]:
    """Return points of a sample of the plausible ranges, best first, with some distance between them."""
    from scipy.stats.qmc import Sobol

    low, high = _box(problem.where)
    sample = Sobol(len(low), rng=np.random.default_rng(0)).random_base2(math.ceil(math.log2(STARTING_POINTS * starts)))
    points = [low + unit * (high - low) for unit in sample]
    costs = np.array(list(problem.each(lambda x: problem.cost(x, problem.residuals(x)), points)))
    apart = 0.25 * starts ** (-1 / len(low))  # a quarter of the distance between as many points on a grid
    chosen: list[int] = []
    for i in np.argsort(costs, kind="stable"):
        if math.isfinite(costs[i]) and all(np.max(np.abs(sample[i] - sample[k])) > apart for k in chosen):
            chosen.append(i)
    return [points[i] for i in chosen]


def _box(where: Coordinates) -> tuple[Array, Array]:
    """Return the lower and upper ends of the box from which other starts are drawn.

    The box is the plausible range; for a parameter with a prior, two standard deviations about its mean. On a side
    without a bound it reaches three times the present value, or a factor of ten for a logarithm.
    """
    reach = np.array([math.log(10.0) if p.scale == "log" else 3.0 for p in where.parameters]) * where.sizes(where.start)
    low = np.where(np.isfinite(where.lower), where.lower, where.start - reach)
    high = np.where(np.isfinite(where.upper), where.upper, where.start + reach)
    for i, p in enumerate(where.parameters):
        if p.name in where.known:
            middle, sigma = where.known[p.name]
            ends = [coordinate(p, v) for v in (middle - 2 * sigma, middle + 2 * sigma) if exists(p, v)]
            ends = ends if len(ends) == 2 else [*ends, coordinate(p, middle)]
            low[i], high[i] = (float(np.clip(end, low[i], high[i])) for end in sorted(ends))
    return low, high

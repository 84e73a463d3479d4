"""Least squares from several starting points: the best minimum, and how many starts agree on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.errors import InputError
from flexdesign.evidence.marquardt import FOLLOWING, MINIMUM, Solution, solve
from flexdesign.evidence.suite import Problem

Array = NDArray[np.float64]
#: Points whose cost is computed, and of these points that take steps, for each start that may be followed.
SCREENED, STEPPED = 8, 4
#: Minima that must agree on the best one for the search to stop early.
ENOUGH = 3
#: Two minima are one if their costs differ by less than this share of the noise's variance.
ALIKE = 0.1


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


def multistart(
    problem: Problem, starts: int, seed: int, progress: Callable[[str], None]
) -> tuple[Solution, Starts, list[Array]]:
    """Return the best minimum, how the starts ended, and the minima of all starts.

    The first start is the model's own values. The others come from a scrambled Sobol sample of the plausible ranges
    (Owen 1998): the best of it first; and if these disagree, those that are best after steps of their own. The cost
    alone misleads where a small amplitude fits better than a large one at the wrong frequency.

    Raises
    ------
    InputError
        If the model fails at every point, or refuses the observations.
    """
    found: list[Solution] = []
    agreed = 0
    for point in _points(problem, starts, seed):
        if (ended := solve(problem.anew(), point, MINIMUM, small=problem.suite.floor)) is not None:
            found.append(ended)
        agreed = _agreed(problem, found)
        progress(f"start {len(found)} of {starts}: {agreed} at the best minimum")
        if agreed == ENOUGH:
            break
    if not found:
        remedy = "the model cannot be simulated at its present values nor elsewhere in the plausible ranges"
        raise InputError("fit", "model", None, remedy)
    best = min(found, key=lambda solution: solution.cost)
    return best, Starts(starts, len(found), agreed), [solution.x for solution in found]


def _agreed(problem: Problem, found: list[Solution]) -> int:
    """Return how many minima are as good as the best of them."""
    best = min((solution.cost for solution in found), default=0.0)
    fitted = len(problem.where.names) + sum(record.columns.shape[1] for record in problem.suite.records)
    variance = best / max(problem.suite.samples - fitted, 1)
    return sum(solution.cost <= best + ALIKE * variance + problem.suite.floor for solution in found)


def _points(problem: Problem, starts: int, seed: int) -> Iterator[Array]:
    """Yield the points to start from, no more than `starts`; later ones are sought only when they are asked for."""
    first, left = problem.where.start, starts
    if problem.residuals(first) is not None:
        yield first
        left -= 1
    else:  # a model that refuses the observations says why
        for record in problem.suite.records:
            with suppress(ArithmeticError, np.linalg.LinAlgError), np.errstate(all="ignore"):
                record.difference(np.asarray(problem.at(first).predict(record.observation)))
    if not left:
        return
    sampled = _sampled(problem, starts, seed)
    early = sampled[: min(left, ENOUGH - 1)]
    yield from early
    if left := left - len(early):
        stepped = list(problem.each(lambda x: solve(problem.anew(), x, FOLLOWING, small=problem.suite.floor), sampled))
        for solution in sorted(filter(None, stepped), key=lambda solution: solution.cost)[:left]:
            yield solution.x


def _sampled(problem: Problem, starts: int, seed: int) -> list[Array]:
    """Return the best points of a sample of the plausible ranges, best first, with some distance between them."""
    from scipy.stats.qmc import Sobol

    low, high = problem.where.sampled()
    wanted = STEPPED * starts
    power = math.ceil(math.log2(SCREENED * starts))
    sample = Sobol(len(low), rng=np.random.default_rng(seed)).random_base2(power)
    points = [low + unit * (high - low) for unit in sample]
    costs = np.array(list(problem.each(lambda x: problem.cost(x, problem.residuals(x)), points)))
    order = [i for i in np.argsort(costs, kind="stable") if math.isfinite(costs[i])]
    apart = 0.5 * wanted ** (-1 / len(low))  # half the distance between as many points on a grid
    chosen: list[int] = []
    for i in order:
        if len(chosen) < wanted and all(np.max(np.abs(sample[i] - sample[k])) > apart for k in chosen):
            chosen.append(i)
    return [points[i] for i in chosen]

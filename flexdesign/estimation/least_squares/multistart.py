"""Local minima: least squares from several starting points, and initial states of runs from a grid.

The initial state of a hysteresis is not recorded, and chi^2 has local minima with respect to it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from statistics import median

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Model
from flexdesign.estimation.least_squares.dataset import Dataset, Record
from flexdesign.estimation.least_squares.levenberg_marquardt import Solution, solve
from flexdesign.estimation.least_squares.residual_function import Map, Problem

#: Points whose cost is computed for each start that may be followed: a tone of 15 periods with unknown amplitude,
#: frequency and phase is then found in 38 of 40 fits, with half as many in 25.
STARTING_POINTS = 32
#: A run begins elsewhere where that lowers its chi^2 to less than this share: less is no other minimum.
OTHER_MINIMUM = 0.98
#: Points of the grid from which the initial state of a run is fitted.
GRID_POINTS = 4
#: Fits the initial state of one run from that of a model; returns chi^2 of the run, and the model with it.
FitState = Callable[[Model, Record], tuple[float, Model]]


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
    """Return how many minima are as good as the best: to a tenth of the noise's variance, a third of its sigma."""
    best = min((solution.cost for solution in found), default=0.0)
    parameters = len(problem.where.names) + sum(record.columns.shape[1] for record in problem.dataset.records)
    variance = best / max(problem.dataset.samples - parameters, 1)
    return sum(solution.cost <= best + 0.1 * variance + problem.dataset.floor for solution in found)


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

    low, high = problem.where.sampled()
    sample = Sobol(len(low), rng=np.random.default_rng(0)).random_base2(math.ceil(math.log2(STARTING_POINTS * starts)))
    points = [low + unit * (high - low) for unit in sample]
    costs = np.array(list(problem.each(lambda x: problem.cost(x, problem.residuals(x)), points)))
    apart = 0.25 * starts ** (-1 / len(low))  # a quarter of the distance between as many points on a grid
    chosen: list[int] = []
    for i in np.argsort(costs, kind="stable"):
        if math.isfinite(costs[i]) and all(np.max(np.abs(sample[i] - sample[k])) > apart for k in chosen):
            chosen.append(i)
    return [points[i] for i in chosen]


# --- initial states of runs ------------------------------------------------------------------------------------------


def grid_initial_states(dataset: Dataset, model: Model, each: Map = map, fit_state: FitState | None = None) -> Model:
    """Return a model whose runs begin where each fits best: where they do, or at a point of the grid of initial states.

    Numbers of a run that have no grid are tried at their median over the runs; those that have one, also at zero.

    Parameters
    ----------
    dataset, model
        The runs, and the model; all its other numbers stay.
    each
        Maps simulations.
    fit_state
        Fits the initial state of one run from the best points of the grid; by default the best point is taken.
    """
    own, starts, grids = dict[str, list[str]](), dict[str, list[float]](), dict[str, tuple[float, ...]]()
    for parameter in model.parameters():
        if parameter.run:
            own.setdefault(parameter.run, []).append(parameter.name)
            starts.setdefault(_number(parameter.name), []).append(parameter.start or 0.0)
            grids |= {_number(parameter.name): parameter.screen} if parameter.screen else {}
    records = [record for record in dataset.records if record.observation.name in own]
    if not grids or not records:
        return model
    medians = {number: median(values) for number, values in starts.items()}
    # Zero is the state of a stage that was never driven before.
    values = [*itertools.product(*grids.values()), (0.0,) * len(grids)]
    points = [{**medians, **dict(zip(grids, point, strict=True))} for point in values]
    changed = dict[str, float]()
    trials = [
        (record, values)
        for record in records
        for values in ({}, *({name: p[_number(name)] for name in own[record.observation.name]} for p in points))
    ]
    costs = list(each(lambda trial: _cost(dataset, model.replace(trial[1]), trial[0]), trials))
    for k, record in enumerate(records):
        first, last = k * (len(points) + 1), (k + 1) * (len(points) + 1)
        best = sorted(range(first + 1, last), key=costs.__getitem__)[: GRID_POINTS if fit_state else 1]
        found = [(costs[at], model.replace(trials[at][1])) for at in best]
        if fit_state is not None:
            found = list(each(lambda pair, record=record: fit_state(pair[1], record), found))
        cost, there = min(found, key=lambda pair: pair[0])
        if cost < OTHER_MINIMUM * costs[first]:
            names = own[record.observation.name]
            changed |= {p.name: p.start for p in there.parameters() if p.name in names and p.start is not None}
    return model.replace(changed) if changed else model


def _number(name: str) -> str:
    """Return what a number of a run is called, without the run."""
    return name.rpartition(":")[2]


def _cost(dataset: Dataset, model: Model, record: Record) -> float:
    residual = dataset.residual(record, np.asarray(model.predict(record.observation)))
    return math.inf if residual is None else float(residual @ residual)

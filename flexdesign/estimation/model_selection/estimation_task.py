"""The estimation problem of a diagnosis: runs, free parameters and their priors, and the initial states of runs.

The initial state of a hysteresis is not recorded, and chi^2 has local minima with respect to it: it is fitted from the
points of a grid.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import median

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Model
from flexdesign.estimation.criterion import SHARE
from flexdesign.estimation.least_squares.dataset import Dataset, Record
from flexdesign.estimation.least_squares.levenberg_marquardt import FULL, Effort, Solution, solve
from flexdesign.estimation.least_squares.residual_function import Coordinates, Map, Problem, coordinate, coordinates

#: How many of the best are fitted to convergence: points of a grid of initial states, and rough fits with further
#: effects. Twice as many are fitted roughly, and as many more by other rankings.
FINALISTS = 3
#: Fits the initial state of one run from that of a model; returns chi^2 of the run, and the model with it.
FitState = Callable[[Model, Record], tuple[float, Model]]


@dataclass(frozen=True, eq=False)
class EstimationTask:
    """The estimation problem of a diagnosis.

    Parameters
    ----------
    identify, validate
        Runs that are fitted, and runs by which models are chosen.
    free
        Names of the free parameters of the model itself.
    known
        Returns the priors of the parameters of a model: mean and standard deviation, SI, by name.
    bare
        Returns a model without the effects that were added to it.
    tolerance
        Least change of the prediction of a validation run by an effect, rms [response].
    coarse
        Returns a model that is simulated less exactly and faster, for screening.
    fine
        Returns a model that is simulated as exactly as a residual of a reduced chi^2 asks for.
    each
        Maps simulations, and fits, perhaps over threads; see `core.parallel_map`.
    progress
        Receives the progress as text.
    calibrated_excess
        Chi^2 of the fitted runs less the number of samples, for the model without effects; see `forward`.
    noise_rms
        Rms noise of the runs by which models are chosen [response]; zero if it is unknown.
    test
        Runs that are neither fitted nor choose a model; None if there are none.
    prepared
        Returns the task with the initial conditions that the effects of a model need.
    prior_bound
        Largest distance of a parameter of one run from the mean of its prior, in standard deviations.
    weights
        Weights of the values of an observation, by its name, in addition to `tolerance`; one where it is missing.
    scales
        For an observation whose values are not equally noisy, by its name: typical noise over the noise of each value.
        Its rms residual is stated with these factors.
    scored
        Names of the observations whose rms residual is stated; by default those of `validate`, or all without any.
    """

    identify: Dataset
    validate: Dataset
    free: tuple[str, ...]
    known: Callable[[Model], Mapping[str, tuple[float, float]]]
    bare: Callable[[Model], Model]
    tolerance: float
    coarse: Callable[[Model], Model] = lambda model: model
    fine: Callable[[Model, float], Model] = lambda model, scale: model
    each: Map = map
    progress: Callable[[str], None] = lambda _: None
    calibrated_excess: float = 0.0
    noise_rms: float = 0.0
    test: Dataset | None = None
    prepared: Callable[[EstimationTask, Model], EstimationTask] = lambda task, _: task
    prior_bound: float = math.inf
    weights: Mapping[str, Array] = field(default_factory=dict)
    scales: Mapping[str, Array] = field(default_factory=dict)
    scored: tuple[str, ...] = ()

    def problem(self, dataset: Dataset, model: Model, free: Sequence[str] = ()) -> Problem:
        """Return the least-squares problem of a data set: a model with free parameters, and with those of each run."""
        return Problem(dataset, model, self._coordinates(model, free, dataset), self.each)

    def _coordinates(self, model: Model, free: Sequence[str], dataset: Dataset) -> Coordinates:
        runs = {record.observation.name for record in dataset.records}
        own = [parameter.name for parameter in model.parameters() if parameter.run in runs]
        names = [*free, *own]
        if not names:  # frequency responses have no parameters of their own
            return Coordinates((), {}, np.zeros(0), np.zeros(0), np.zeros(0))
        known = {name: about for name, about in self.known(model).items() if name in names}
        return _bound_by_priors(coordinates(model, names, known), self.prior_bound)


def _bound_by_priors(where: Coordinates, prior_bound: float) -> Coordinates:
    """Return coordinates with parameters of one run within this number of standard deviations of their priors."""
    lower, upper = where.lower.copy(), where.upper.copy()
    for j, parameter in enumerate(where.parameters):
        if parameter.run and parameter.name in where.known:
            middle, sigma = where.known[parameter.name]
            lower[j] = max(lower[j], coordinate(parameter, middle - prior_bound * sigma))
            upper[j] = min(upper[j], coordinate(parameter, middle + prior_bound * sigma))
    return replace(where, lower=lower, upper=upper, start=np.clip(where.start, lower, upper))


# --- initial states of runs ------------------------------------------------------------------------------------------


def fit_initial_states(task: EstimationTask, dataset: Dataset, model: Model, effort: Effort = FULL) -> Solution | None:
    """Fit the initial states of the runs of a data set, with all other parameters held; None where the model fails."""
    problem = task.problem(dataset, model)
    # Nothing is derived from the Jacobian at the end, so that it need not be exact.
    return solve(problem, problem.where.start, replace(effort, is_exact=False))


def search_initial_states(task: EstimationTask, dataset: Dataset, model: Model) -> Model:
    """Return a model with the initial state of each run that fits best, fitted from the best points of a grid."""

    def fit_state(model: Model, record: Record) -> tuple[float, Model]:
        solution = fit_initial_states(task, dataset.part([record.observation.name]), model, Effort(6, 1e-3))
        return (math.inf, model) if solution is None else (solution.misfit, solution.problem.at(solution.x))

    return grid_initial_states(dataset, model, task.each, fit_state)


def grid_initial_states(dataset: Dataset, model: Model, each: Map = map, fit_state: FitState | None = None) -> Model:
    """Return a model whose runs begin where each fits best: where they do, or at a point of the grid of initial states.

    Numbers of a run that have no grid are tried at their median over the runs; those that have one, also at zero. A run
    begins elsewhere if that lowers its chi^2 by `criterion.SHARE`: less is no other minimum.

    Parameters
    ----------
    dataset, model
        The runs, and the model; all its other numbers stay.
    each
        Maps simulations.
    fit_state
        Fits the initial state of one run from the best points of the grid; by default the best one is taken.
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
        best = sorted(range(first + 1, last), key=costs.__getitem__)[: FINALISTS if fit_state else 1]
        found = [(costs[at], model.replace(trials[at][1])) for at in best]
        if fit_state is not None:
            found = list(each(lambda pair, record=record: fit_state(pair[1], record), found))
        cost, there = min(found, key=lambda pair: pair[0])
        if cost < (1 - SHARE) * costs[first]:
            names = own[record.observation.name]
            changed |= {p.name: p.start for p in there.parameters() if p.name in names and p.start is not None}
    return model.replace(changed) if changed else model


def _number(name: str) -> str:
    """Return what a number of a run is called, without the run."""
    return name.rpartition(":")[2]


def _cost(dataset: Dataset, model: Model, record: Record) -> float:
    residual = dataset.residual(record, np.asarray(model.predict(record.observation)))
    return math.inf if residual is None else float(residual @ residual)

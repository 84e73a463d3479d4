"""Initial states of runs on a grid: where a hysteresis began is not in a record, and chi^2 has local minima there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from statistics import median

import numpy as np

from flexdesign.core.model import Model, Parameter
from flexdesign.estimation.least_squares.dataset import Dataset, Record
from flexdesign.estimation.least_squares.residual_function import Map

#: A run begins elsewhere where that lowers its chi^2 to less than this share: less is no other minimum.
OTHER_MINIMUM = 0.98
#: Points of the grid from which the initial state of a run is fitted.
GRID_POINTS = 4
#: Fits the initial state of one run from that of a model; returns chi^2 of the run, and the model with it.
FitState = Callable[[Model, Record], tuple[float, Model]]


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
    own = _by_run(model)
    records = [record for record in dataset.records if record.observation.name in own]
    grids = {_number(p): p.screen for parameters in own.values() for p in parameters if p.screen}
    if not grids or not records:
        return model
    medians = _medians([p for parameters in own.values() for p in parameters])
    # Zero is the state of a stage that was never driven before.
    values = [*itertools.product(*grids.values()), (0.0,) * len(grids)]
    points = [{**medians, **dict(zip(grids, point, strict=True))} for point in values]
    changed = dict[str, float]()
    trials = [(record, values) for record in records for values in ({}, *(_of_run(own, record, p) for p in points))]
    costs = list(each(lambda trial: _cost(dataset, model.replace(trial[1]), trial[0]), trials))
    for k, record in enumerate(records):
        first, last = k * (len(points) + 1), (k + 1) * (len(points) + 1)
        best = sorted(range(first + 1, last), key=costs.__getitem__)[: GRID_POINTS if fit_state else 1]
        found = [(costs[at], model.replace(trials[at][1])) for at in best]
        if fit_state is not None:
            found = list(each(lambda pair, record=record: fit_state(pair[1], record), found))
        cost, there = min(found, key=lambda pair: pair[0])
        if cost < OTHER_MINIMUM * costs[first]:
            names = {p.name for p in own[record.observation.name]}
            changed |= {p.name: p.start for p in there.parameters() if p.name in names and p.start is not None}
    return model.replace(changed) if changed else model


def _by_run(model: Model) -> dict[str, list[Parameter]]:
    """Return the numbers of each run."""
    found: dict[str, list[Parameter]] = {}
    for parameter in model.parameters():
        if parameter.run:
            found.setdefault(parameter.run, []).append(parameter)
    return found


def _of_run(own: dict[str, list[Parameter]], record: Record, point: dict[str, float]) -> dict[str, float]:
    return {p.name: point[_number(p)] for p in own[record.observation.name]}


def _number(parameter: Parameter) -> str:
    return parameter.name.rpartition(":")[2]


def _medians(parameters: list[Parameter]) -> dict[str, float]:
    """Return the median over the runs of each number that runs have of their own."""
    starts: dict[str, list[float]] = {}
    for parameter in parameters:
        starts.setdefault(_number(parameter), []).append(parameter.start or 0.0)
    return {number: median(values) for number, values in starts.items()}


def _cost(dataset: Dataset, model: Model, record: Record) -> float:
    residual = dataset.residual(record, np.asarray(model.predict(record.observation)))
    return math.inf if residual is None else float(residual @ residual)

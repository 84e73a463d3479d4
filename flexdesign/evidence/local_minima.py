"""Local minima of models with hysteresis, and fits that leave them.

A hysteresis is not differentiable where a threshold is met or a voltage turns, and the state in which a run began is
unknown: chi^2 has local minima there. Fits are begun again from a grid of initial states, run by run, and with
thresholds a little larger and smaller (multistart).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from statistics import median

import numpy as np
from numpy.typing import NDArray

from flexdesign.evidence.residuals import Map
from flexdesign.evidence.suite import Record, Suite
from flexdesign.model import Model, Parameter

Array = NDArray[np.float64]
#: A run begins elsewhere where that lowers its misfit to less than this share: less is no other minimum.
BETTER = 0.98
#: Points of the grid from which the initial state of a run is fitted.
FOLLOWED = 4
#: Fits the initial state of one run; returns its sum of squares, and the values.
Refine = Callable[[Model, Record], tuple[float, dict[str, float]]]
#: A run is an outlier where its mean square is so many times that of the median run, and of the noise.
OUTLIER = 1.5


def outlier_runs(suite: Suite, residuals: Sequence[Array], usual: float = 0.0) -> list[str]:
    """Return the names of runs that fit worse than the others.

    Parameters
    ----------
    suite, residuals
        The runs, and the whitened residual of each.
    usual
        Mean square that a run leaves; by default that of the median run.
    """
    squares = [float(part @ part) / record.present.sum() for record, part in zip(suite.records, residuals, strict=True)]
    limit = OUTLIER * max(usual or median(squares), 1.0)
    return [record.observation.name for record, square in zip(suite.records, squares, strict=True) if square > limit]


def grid_initial_states(
    suite: Suite, model: Model, runs: Sequence[str], each: Map = map, refine: Refine | None = None
) -> Model:
    """Return a model whose runs begin where each fits best: where they do, or at a point of the grid of initial states.

    Numbers of a run that have no grid are tried at their median over the runs.

    Parameters
    ----------
    suite, model
        The runs, and the model; all its other numbers stay.
    runs
        Names of those that may begin elsewhere.
    each
        Maps simulations.
    refine
        Fits the initial state of one run from the best points of the grid; by default the best point is taken.
    """
    own = _by_run(model)
    records = [record for record in suite.records if record.observation.name in runs and record.observation.name in own]
    grids = {_number(p): p.screen for parameters in own.values() for p in parameters if p.screen}
    if not grids:
        return model
    usual = _usual([p for parameters in own.values() for p in parameters])
    places = [dict(zip(grids, values, strict=True)) for values in itertools.product(*grids.values())]
    tried = list[tuple[Record, dict[str, float]]]()
    for record in records:
        mine = [p for p in own[record.observation.name] if p.si != "rad"]
        tried += [(record, {}), *((record, {p.name: {**usual, **place}[_number(p)] for p in mine}) for place in places)]
    misfits = list(each(lambda trial: _misfit(suite, model.replace(trial[1]), trial[0]), tried))
    changed = dict[str, float]()
    for k in range(len(records)):
        first, last = k * (len(places) + 1), (k + 1) * (len(places) + 1)
        best = sorted(range(first + 1, last), key=misfits.__getitem__)[: FOLLOWED if refine else 1]
        found = [(misfits[at], tried[at][1]) for at in best]
        if refine is not None:
            found = list(each(lambda at: refine(model.replace(tried[at][1]), tried[at][0]), best))
        misfit, values = min(found, key=lambda pair: pair[0])
        if misfit < BETTER * misfits[first]:
            changed |= values
    return model.replace(changed) if changed else model


def _by_run(model: Model) -> dict[str, list[Parameter]]:
    found: dict[str, list[Parameter]] = {}
    for parameter in model.parameters():
        if parameter.run:
            found.setdefault(parameter.run, []).append(parameter)
    return found


def _number(parameter: Parameter) -> str:
    return parameter.name.rpartition(":")[2]


def _usual(parameters: Sequence[Parameter]) -> dict[str, float]:
    """Return the median over the runs of each number that runs have of their own."""
    starts: dict[str, list[float]] = {}
    for parameter in parameters:
        starts.setdefault(_number(parameter), []).append(parameter.start or 0.0)
    return {number: median(values) for number, values in starts.items()}


def _misfit(suite: Suite, model: Model, record: Record) -> float:
    residual = suite.residual(record, np.asarray(model.predict(record.observation)))
    return math.inf if residual is None else float(residual @ residual)

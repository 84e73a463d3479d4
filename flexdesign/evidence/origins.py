"""Where each run came from: numbers of one run alone, found by itself while all other numbers stand.

What a voltage had done before a record is not in the record, and the way back to it has corners: a fit of all runs may
be caught where one of them seems to have come from elsewhere. That run alone is then begun from several places.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from statistics import median

import numpy as np
from numpy.typing import NDArray

from flexdesign.evidence.case import Case
from flexdesign.evidence.marquardt import Solution, solve
from flexdesign.evidence.residuals import Map
from flexdesign.evidence.suite import Record, Suite
from flexdesign.model import Model, Parameter

Array = NDArray[np.float64]
#: A run begins elsewhere where that lowers its misfit to less than this share.
BETTER = 0.98
#: A run is out of line where its mean square is so many times that of the middle one, and of the noise.
OUT_OF_LINE = 1.5
#: So many of the values to be tried become starts of a fit of the run by itself, which finds slopes so often, and ends
#: where a step lowers its misfit by less than this share.
FOLLOWED, SLOPES, SHARE = 4, 6, 1e-3
#: The same for runs that are all fitted alone before all numbers are.
SLOPES_BEFORE, SHARE_BEFORE = 4, 1e-4


def out_of_line(suite: Suite, residuals: Sequence[Array], usual: float = 0.0) -> list[str]:
    """Return the names of runs that fit worse than the others.

    Parameters
    ----------
    suite, residuals
        The runs, and the whitened residual of each.
    usual
        Mean square that a run leaves; by default that of the middle one.
    """
    squares = [float(part @ part) / record.present.sum() for record, part in zip(suite.records, residuals, strict=True)]
    limit = OUT_OF_LINE * max(usual or median(squares), 1.0)
    return [record.observation.name for record, square in zip(suite.records, squares, strict=True) if square > limit]


def begun_elsewhere(case: Case, suite: Suite, model: Model, runs: Sequence[str]) -> Model:
    """Return a model where some runs begin where each, fitted by itself from several places, fits best.

    Parameters
    ----------
    case, suite
        What is known of the numbers of runs, and the runs.
    model
        All its other numbers stay.
    runs
        Names of those that may begin elsewhere.
    """
    numbers = _by_run(model)
    grids = {_number(p): p.screen for own in numbers.values() for p in own if p.screen}
    if not grids:
        return model
    usual = {name: _usual(numbers, name) for name in {_number(p) for own in numbers.values() for p in own}}
    places = [dict(zip(grids, values, strict=True)) for values in itertools.product(*grids.values())]

    records = [
        record for record in suite.records if record.observation.name in runs and record.observation.name in numbers
    ]
    # One flat list at a time, so that simulations of one run, too, are made side by side.
    tried = list[tuple[Record, dict[str, float]]]()
    for record in records:
        own = [p for p in numbers[record.observation.name] if p.si != "rad"]
        tried += [(record, {p.name: place.get(_number(p), usual[_number(p)]) for p in own}) for place in places]
    least = list(case.each(lambda record: _misfit(suite, model, record), records))
    misfits = list(case.each(lambda begun: _misfit(suite, model.replace(begun[1]), begun[0]), tried))
    followed = list[tuple[int, Record, dict[str, float]]]()
    for k, record in enumerate(records):
        of_run = sorted(range(k * len(places), (k + 1) * len(places)), key=misfits.__getitem__)
        followed += [(k, record, tried[at][1]) for at in of_run[:FOLLOWED]]
    best: list[dict[str, float]] = [{} for _ in records]
    ended = case.each(lambda at: _alone(case, suite, model.replace(at[2]), at[1], SLOPES, SHARE), followed)
    for (k, _, _), solution in zip(followed, ended, strict=True):
        if solution is not None and solution.misfit < BETTER * least[k]:
            best[k], least[k] = solution.problem.where.values(solution.x), solution.misfit
    changed = {name: value for values in best for name, value in values.items()}
    return model.replace(changed) if changed else model


def begun_alone(case: Case, model: Model) -> Model:
    """Return a model with the numbers of each run fitted to that one while all others stand.

    They are few, and a corner that one of them meets stops none of the others.
    """

    def found(record: Record) -> dict[str, float]:
        ended = _alone(case, case.identify, model, record, SLOPES_BEFORE, SHARE_BEFORE)
        return {} if ended is None else ended.problem.where.values(ended.x)

    records = [record for record in case.identify.records if record.observation.name in _by_run(model)]
    return model.replace({name: value for own in case.each(found, records) for name, value in own.items()})


def _alone(case: Case, suite: Suite, model: Model, record: Record, slopes: int, share: float) -> Solution | None:
    """Return a fit of one run by itself: its own numbers move, all others stand."""
    alone = suite.part([record.observation.name])
    where = case.coordinates(model, (), alone)
    return solve(case.problem(alone, model, where), where.start, most=slopes, share=share, exact=False)


def _by_run(model: Model) -> dict[str, list[Parameter]]:
    found: dict[str, list[Parameter]] = {}
    for parameter in model.parameters():
        if parameter.run:
            found.setdefault(parameter.run, []).append(parameter)
    return found


def _number(parameter: Parameter) -> str:
    return parameter.name.rpartition(":")[2]


def _usual(numbers: Mapping[str, Sequence[Parameter]], number: str) -> float:
    """Return what a number of each run is in the middle one."""
    return median(p.start or 0.0 for own in numbers.values() for p in own if _number(p) == number)


def begun_anew(suite: Suite, model: Model, each: Map = map) -> Model:
    """Return a model whose runs begin where it fits them best: where they are, or at one of the values to be tried.

    A fit may be caught where a run seems to have come from elsewhere, which is a matter of that run alone. Simulations
    are mapped by `each`.
    """
    own = [parameter for parameter in model.parameters() if parameter.run]
    names = sorted({_number(p) for p in own if p.screen})
    grids = {_number(p): p.screen for p in own if p.screen}
    changes = [dict(zip(names, values, strict=True)) for values in itertools.product(*(grids[name] for name in names))]
    models = [model, *(model.replace({p.name: c.get(_number(p), 0.0) for p in own if p.si != "rad"}) for c in changes)]
    pairs = [(tried, record) for tried in models for record in suite.records]
    misfits = iter(each(lambda pair: _misfit(suite, *pair), pairs))
    best = {record.observation.name: (next(misfits), dict[str, float]()) for record in suite.records}
    for change in changes:
        for record in suite.records:
            run = record.observation.name
            if (misfit := next(misfits)) < best[run][0] * BETTER:
                new = {p.name: change.get(_number(p), 0.0) for p in own if p.run == run}
                best[run] = misfit, {name: value for name, value in new.items() if not name.endswith("phase")}
    changed = {name: value for _, new in best.values() for name, value in new.items()}
    return model.replace(changed) if changed else model


def _misfit(suite: Suite, model: Model, record: Record) -> float:
    residual = suite.residual(record, np.asarray(model.predict(record.observation)))
    return math.inf if residual is None else float(residual @ residual)

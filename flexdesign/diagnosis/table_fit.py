"""Static effects fitted to a table, alone and in pairs: what each leaves, and what it must lower to count."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from flexdesign.diagnosis.findings import Value
from flexdesign.effects import statics
from flexdesign.evidence.coordinates import Coordinates, coordinate, coordinates, value
from flexdesign.evidence.dataset import Suite
from flexdesign.evidence.intervals import profiles_of
from flexdesign.evidence.marquardt import MINIMUM, Solution, solve
from flexdesign.evidence.suite import Problem
from flexdesign.evidence.uncertainty import uncertainty
from flexdesign.model import Observation, Parameter
from flexdesign.static_tables import StaticModel, StaticTable, Uncertainty

Array = NDArray[np.float64]
#: With nothing missing, some effect counts in one of a hundred tables; a sum of squares is no chance where noise makes
#: as large a one in one of a thousand.
LEVEL, INADEQUATE = 0.01, 1e-3
#: Where a strength has no size of its own, fits begin this many decades below and above its start.
DECADES = (-3, -2, -1, 0, 1, 2, 3)
#: The coordinates of a model without free numbers.
NOTHING = Coordinates((), {}, np.zeros(0), np.zeros(0), np.zeros(0))
#: A fit ends where a step promises to lower the sum of squares by less: a hundredth of a standard deviation.
SMALL = 1e-4


@dataclass(frozen=True, eq=False)
class Trial:
    """A model with some effects added, fitted to a table.

    Parameters
    ----------
    names
        Of the effects.
    model
        With the fitted values.
    cost
        Sum of squares, whitened; infinite where the model gives no numbers.
    rows
        Number of measurements.
    solution
        The fit; None if nothing was free.
    """

    names: tuple[str, ...]
    model: StaticModel
    cost: float
    rows: int
    solution: Solution | None = None

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The fitted parameters."""
        return self.solution.problem.where.parameters if self.solution else ()

    @cached_property
    def values(self) -> tuple[Value, ...]:
        """The fitted numbers with 95 % profile intervals; the plausible range where the table says nothing."""
        if self.solution is None:
            return ()
        where, x = self.solution.problem.where, self.solution.x
        found = profiles_of(self.solution, uncertainty(self.solution), range(len(x)))
        made = []
        for j, parameter in enumerate(where.parameters):
            profile = found[j]
            ends = (profile.low, profile.high) if profile else (where.lower[j], where.upper[j])
            low, high = sorted(value(parameter, float(end)) for end in ends)
            made.append(Value(parameter, value(parameter, float(x[j])), (low, high)))
        return tuple(made)

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the numbers that the fit pushes to the end of what is plausible."""
        if self.solution is None:
            return ()
        where, x = self.solution.problem.where, self.solution.x
        return tuple(
            name for name, held in zip(where.names, (x == where.lower) | (x == where.upper), strict=True) if held
        )

    @property
    def dof(self) -> int:
        """Measurements less fitted numbers."""
        return self.rows - len(self.free)

    @property
    def is_adequate(self) -> bool:
        """Tell whether chance makes as large a sum of squares often enough."""
        return self.dof > 0 and float(chi2.sf(self.cost, self.dof)) > INADEQUATE

    def counts_beside(self, less: Trial, candidates: int) -> bool:
        """Tell whether the effects that another lacks lower the sum of squares by more than chance does."""
        more = max(len(self.free) - len(less.free), 1)
        return less.cost - self.cost > float(chi2.isf(LEVEL / max(candidates, 1), more))


def as_it_is(model: StaticModel, table: StaticTable, noise: Uncertainty, names: Sequence[str] = ()) -> Trial:
    """Return the model without anything fitted."""
    problem = _problem(model, (), table, noise)
    return Trial(tuple(names), model, problem.cost(np.zeros(0), problem.residuals(np.zeros(0))), len(table.rows))


def fitted(
    model: StaticModel, names: Sequence[str], table: StaticTable, noise: Uncertainty, near: Trial | None = None
) -> Trial | None:
    """Fit a model with some effects more, from the values of a trial perhaps.

    None where no values of theirs give numbers, or there are too few rows.
    """
    with_them = model
    for name in names:
        with_them = with_them.with_effect(statics.find(name), name)
    theirs = [p for p in with_them.parameters() if p.name.rpartition(".")[0] in names]
    free = [p for p in theirs if not _is_switch(p)]
    with_them = with_them.replace({p.name: 1.0 for p in theirs if _is_switch(p)})
    if not free:
        return as_it_is(with_them, table, noise, names)
    if len(free) >= len(table.rows):
        return None
    problem = _problem(with_them, [p.name for p in free], table, noise)
    starts = [_values_of(near)] if near else _starts(free)
    points = [np.array([coordinate(p, start[p.name]) for p in problem.where.parameters]) for start in starts]
    costs = [problem.cost(x, problem.residuals(x)) for x in points]
    found = solve(problem, points[int(np.argmin(costs))], MINIMUM, small=SMALL)
    if found is None:
        return None
    return Trial(tuple(names), cast(StaticModel, problem.at(found.x)), found.cost, len(table.rows), found)


def _problem(model: StaticModel, free: Sequence[str], table: StaticTable, noise: Uncertainty) -> Problem:
    return Problem(Suite([table], noise, _exact), model, coordinates(model, free, {}) if free else NOTHING)


def _exact(table: Observation) -> tuple[Array, Array]:
    """Return no nuisance columns: a table has no offset."""
    return np.zeros((len(table.measured()), 0)), np.zeros(0)


def _values_of(trial: Trial) -> dict[str, float]:
    assert trial.solution is not None  # only what was fitted is fitted again
    return trial.solution.problem.where.values(trial.solution.x)


def _is_switch(parameter: Parameter) -> bool:
    """Tell whether an effect is there or not, and has no strength to be fitted."""
    return parameter.name.rpartition(".")[2] == "share"


def _starts(free: Sequence[Parameter]) -> Iterator[dict[str, float]]:
    grids = []
    for parameter in free:
        effect, _, name = parameter.name.rpartition(".")
        start = next(p.start for p in statics.find(effect).parameters if p.name == name) or 1.0
        tried = [start * 10.0**power for power in DECADES]
        if parameter.scale == "linear":
            tried = [0.1 * start, start, 5 * start, 20 * start]
            tried += [-s for s in tried] if parameter.plausible[0] < 0 else []
            tried += [start * 10.0**power for power in (2, 4)]
        grids.append([(parameter.name, s) for s in tried if parameter.is_plausible(s)])
    for starts in itertools.product(*grids):
        yield dict(starts)

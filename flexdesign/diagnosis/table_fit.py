"""Static effects fitted to a table, alone and in pairs: what each leaves, and what it must lower to count."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import chi2, t

from flexdesign.diagnosis.findings import Value
from flexdesign.effects import statics
from flexdesign.errors import InputError
from flexdesign.evidence.coordinates import Coordinates, coordinates, value
from flexdesign.model import Parameter
from flexdesign.static_tables import StaticModel, StaticTable, Uncertainty

Array = NDArray[np.float64]
#: With nothing missing, some effect counts in one of a hundred tables; a sum of squares is no chance where noise makes
#: as large a one in one of a thousand.
LEVEL, INADEQUATE = 0.01, 1e-3
#: Where a strength has no size of its own, fits begin this many decades below and above its start.
DECADES = (-3, -2, -1, 0, 1, 2, 3)


@dataclass(frozen=True, eq=False)
class Trial:
    """A model with some effects added, fitted to a table.

    Parameters
    ----------
    names
        Of the effects.
    model
        With the fitted values.
    residuals
        Measured less predicted, whitened.
    values
        The fitted numbers with their 95 % intervals.
    at_bound
        Names of those that the fit pushes to the end of what is plausible.
    """

    names: tuple[str, ...]
    model: StaticModel
    residuals: Array
    values: tuple[Value, ...] = ()
    at_bound: tuple[str, ...] = ()

    @property
    def cost(self) -> float:
        """Sum of squares, whitened."""
        return float(self.residuals @ self.residuals)

    @property
    def dof(self) -> int:
        """Measurements less fitted numbers."""
        return len(self.residuals) - len(self.values)

    @property
    def is_adequate(self) -> bool:
        """Tell whether chance makes as large a sum of squares often enough."""
        return self.dof > 0 and float(chi2.sf(self.cost, self.dof)) > INADEQUATE

    def counts_beside(self, less: Trial, candidates: int) -> bool:
        """Tell whether the effects that another lacks lower the sum of squares by more than chance does."""
        more = max(len(self.values) - len(less.values), 1)
        return less.cost - self.cost > float(chi2.isf(LEVEL / max(candidates, 1), more))


def as_it_is(model: StaticModel, table: StaticTable, noise: Uncertainty) -> Trial:
    """Return the model without anything added."""
    return Trial((), model, _residuals(model, table, noise))


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
    on = {p.name: 1.0 for p in theirs if _is_switch(p)}
    with_them = with_them.replace(on)
    if not free:
        return Trial(tuple(names), with_them, _residuals(with_them, table, noise))
    if len(free) >= len(table.rows):
        return None
    starts = [{v.parameter.name: v.value for v in near.values}] if near else _starts(free)
    begun = [(_cost(with_them.replace(start), table, noise), number, start) for number, start in enumerate(starts)]
    lowest, _, best = min(begun)
    if not math.isfinite(lowest):
        return None
    where = coordinates(with_them.replace(best), [p.name for p in free], {})
    return _solved(with_them, where, tuple(names), table, noise)


def _solved(
    model: StaticModel, where: Coordinates, names: tuple[str, ...], table: StaticTable, noise: Uncertainty
) -> Trial:
    sizes = where.sizes(where.start)

    def residuals(x: Array) -> Array:
        found = _residuals(model.replace(where.values(x)), table, noise)
        return np.where(np.isfinite(found), found, 1e6)

    inside = np.clip(where.start, where.lower + 1e-9 * sizes, where.upper - 1e-9 * sizes)
    ended = least_squares(residuals, inside, bounds=(where.lower, where.upper), x_scale=sizes)
    curvature = ended.jac.T @ ended.jac
    sigma = np.sqrt(np.maximum(np.diag(np.linalg.pinv(curvature)), 0.0))
    factor = float(t.isf(0.025, max(len(table.rows) - len(ended.x), 1)))
    values = []
    for j, parameter in enumerate(where.parameters):
        reach = np.clip(ended.x[j] + factor * sigma[j] * np.array([-1, 1]), where.lower[j], where.upper[j])
        low, high = sorted(value(parameter, float(end)) for end in reach)
        values.append(Value(parameter, value(parameter, float(ended.x[j])), (low, high)))
    held = tuple(p.name for p, active in zip(where.parameters, ended.active_mask, strict=True) if active)
    return Trial(names, model.replace(where.values(ended.x)), residuals(ended.x), tuple(values), held)


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


def _cost(model: StaticModel, table: StaticTable, noise: Uncertainty) -> float:
    left = _residuals(model, table, noise)
    return float(left @ left) if np.isfinite(left).all() else math.inf


def _residuals(model: StaticModel, table: StaticTable, noise: Uncertainty) -> Array:
    try:
        difference = table.measured() - model.predict(table)
    except (ArithmeticError, InputError):
        return np.full(len(table.rows), np.inf)
    if not np.isfinite(difference).all():
        return np.full(len(table.rows), np.inf)
    return noise.whiten(table, difference)

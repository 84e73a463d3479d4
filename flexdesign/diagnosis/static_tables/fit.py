"""Static effects fitted to a table, alone and in pairs, and their significance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
from scipy.special import chdtri

from flexdesign.analytic import static_model
from flexdesign.analytic.static_model import StaticModel, StaticTable, Uncertainty
from flexdesign.analytic.static_model.uncertainty import LEVEL
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Member, Parameter, Reshape
from flexdesign.diagnosis.result import Value
from flexdesign.effects import statics
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import Solution, solve
from flexdesign.estimation.least_squares.residual_function import Problem, coordinates, value
from flexdesign.estimation.uncertainty.identifiability import profiles_of
from flexdesign.estimation.uncertainty.intervals import uncertainty

#: Effects to be fitted, each with the value of its discrete constant, if it has one, and others that do the same.
Cases = Mapping[str, tuple[float, ...]]


@dataclass(frozen=True, eq=False)
class Trial:
    """A model with some effects added, fitted to a table.

    Parameters
    ----------
    cases
        The effects.
    model
        With the fitted values.
    table, noise
        The table, and the uncertainty of the difference of a complete model from it.
    solution
        The fit; None if nothing was free.
    """

    cases: Cases
    model: StaticModel
    table: StaticTable
    noise: Uncertainty
    solution: Solution | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(self.cases)

    @property
    def free(self) -> tuple[Parameter, ...]:
        """The fitted parameters."""
        return self.solution.problem.where.parameters if self.solution else ()

    @cached_property
    def difference(self) -> Array:
        """Predicted less measured, SI."""
        return np.asarray(self.model.predict(self.table) - self.table.measured())

    @cached_property
    def cost(self) -> float:
        """Sum of squares, whitened."""
        return self.noise.squares(self.difference)

    @property
    def bic(self) -> float:
        """BIC (Schwarz 1978): an effect that is there or not has no free parameter."""
        return self.cost + len(self.free) * math.log(len(self.table.rows))

    @cached_property
    def values(self) -> tuple[Value, ...]:
        """The fitted numbers with 95 % profile intervals; the plausible range if the table does not determine one."""
        if self.solution is None:
            return ()
        where, x = self.solution.problem.where, self.solution.x
        profiles = profiles_of(self.solution, uncertainty(self.solution), range(len(x)))
        made = []
        for j, parameter in enumerate(where.parameters):
            profile = profiles[j]
            ends = (profile.low, profile.high) if profile else (where.lower[j], where.upper[j])
            low, high = sorted(value(parameter, float(end)) for end in ends)
            made.append(Value(parameter, value(parameter, float(x[j])), (low, high)))
        return tuple(made)

    @cached_property
    def is_adequate(self) -> bool:
        """Tell whether the model agrees with the table."""
        return static_model.uncertainty(self.model, self.table).agrees(self.difference, len(self.free))

    def is_significant_against(self, less: Trial, candidates: int) -> bool:
        """Tell whether the effects that another lacks lower the sum of squares by more than chance does."""
        more = max(len(self.free) - len(less.free), 1)
        return less.cost - self.cost > float(chdtri(more, LEVEL / max(candidates, 1)))

    def excess_modulus(self, before: Trial) -> float:
        """Return by how much the modulus is above that of another model, relative, where the design rules that out."""
        ratio = self.model.compliance({}).base["modulus"] / before.model.compliance({}).base["modulus"]
        return ratio - 1 if abs(ratio - 1) > self.model.design.tolerances.modulus else 0.0

    def members(self, name: str) -> tuple[Member, ...]:
        """Return the members of which an effect changes one, unknown from the table; none if it changes all."""
        faces = [face for face in statics.find(name).faces if isinstance(face, Reshape) and face.number]
        every = self.model.design.part().linkage().members if faces else ()
        return tuple(m for face in faces for n in self.cases[name] for m in face.changed(every, {face.number: n}))


def constant(name: str) -> Parameter | None:
    """Return the discrete constant of an effect, which is not fitted but tried at the values of its grid."""
    return next((p for p in statics.find(name).parameters if p.null is None and p.screen), None)


def cases(model: StaticModel, name: str, table: StaticTable) -> list[dict[str, tuple[float, ...]]]:
    """Return an effect with each value of its discrete constant that changes the predicted table differently.

    An effect without such a constant is one case, if its start values change the table.
    """
    own, with_it = constant(name), model.with_effect(statics.find(name), name)
    found = dict[int, tuple[float, ...]]()
    predictions = [model.predict(table)]  # of the model itself: what changes nothing is not tried
    for choice in [(float(each),) for each in own.screen] if own else [()]:
        try:
            predictions.append(with_it.replace(_start_values(name, choice)).predict(table))
        except InputError:  # cannot be built
            continue
        same = next(i for i, other in enumerate(predictions) if np.allclose(other, predictions[-1], rtol=1e-9, atol=0))
        found[same] = found.get(same, ()) + choice
    return [{name: numbers} for same, numbers in found.items() if same]


def fit_with(before: Trial, cases: Cases, near: Trial | None = None) -> Trial | None:
    """Fit a model with further effects to the same table, from their start values or those of a trial that is near.

    An effect that is there or not, a ``share``, is there. None where the start values give no numbers, or there are too
    few rows.
    """
    with_them, free = before.model, list[str]()
    for name, choice in cases.items():
        with_them = with_them.with_effect(statics.find(name), name).replace(_start_values(name, choice))
        fitted = [p for p in statics.find(name).parameters if p != constant(name) and p.name != "share"]
        free += [f"{name}.{parameter.name}" for parameter in fitted]
    if not free:
        return replace(before, cases=cases, model=with_them)
    if len(free) >= len(before.table.rows):
        return None
    no_offsets = np.zeros((len(before.table.rows), 0)), np.zeros(0)
    dataset = Dataset([before.table], before.noise, lambda _: no_offsets)
    problem = Problem(dataset, with_them, coordinates(with_them, free, {}))
    start = near.solution.x if near and near.solution else problem.where.start
    found = solve(problem, start, small=1e-4)  # a hundredth of a standard deviation
    if found is None:
        return None
    return replace(before, cases=cases, model=cast(StaticModel, problem.at(found.x)), solution=found)


def _start_values(name: str, choice: tuple[float, ...]) -> dict[str, float]:
    """Return the values at which an effect is shown, by dotted name; its discrete constant is the first of a choice."""
    own = constant(name)
    chosen = {own.name: choice[0]} if own else {}
    return {f"{name}.{p.name}": chosen.get(p.name, float(p.start or 0.0)) for p in statics.find(name).parameters}

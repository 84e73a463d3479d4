"""From the pseudo-rigid model to finite elements, effect by effect, in the order that earns most.

Each rung has one effect of the drawing more, the one that lowers the error most; the error is the root mean square of
the logarithms of model over FEM, of K_in and lambda with a free output and K_out with free inputs; of a stage those of
each axis that is not as another. Effects that work against each other (roots make hinges softer, width makes them
stiffer) may raise it before they lower it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from flexdesign.analytic.frame import Mechanism
from flexdesign.analytic.static_model import Row, StaticModel, StaticTable, nominal_effects, of_design, uncertainty
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.design.design import Design

#: What is compared: of a part, and of each axis of a stage.
COMPARED = ("K_in_output_free", "lambda_output_free", "K_out_input_free")
OF_AXIS = ("K_in_{}_table_free", "lambda_{}_table_free", "K_out_{}_inputs_free")
#: Axes are as each other if their quantities differ by less than this, relative.
SAME_AXIS = 1e-6
#: A model that is so much stiffer than FEM, or softer, is a rigid frame and rounding: hinges that only rotate do not
#: move a part whose leaves end in bodies that cannot turn.
SMALLEST = 1e-6


@dataclass(frozen=True)
class ErrorStep:
    """The model with one effect more.

    Parameters
    ----------
    effect
        What was added; empty for the pseudo-rigid model.
    errors
        Model over FEM less one, by the quantity's key.
    """

    effect: str
    errors: Mapping[str, float]

    @property
    def size(self) -> float:
        """Root mean square of the logarithms of model over FEM; infinite where the model does not move."""
        if not all(SMALLEST < 1 + error < 1 / SMALLEST for error in self.errors.values()):
            return math.inf
        return float(np.sqrt(np.mean([math.log1p(error) ** 2 for error in self.errors.values()])))

    def differs_from(self, other: ErrorStep) -> bool:
        """Tell whether a quantity is another, beyond rounding."""
        return any(abs(error - other.errors[key]) > 1e-9 * (1 + abs(error)) for key, error in self.errors.items())


@dataclass(frozen=True)
class ModelHierarchy:
    """Every rung, and what tolerances do to the quantities.

    Parameters
    ----------
    rungs
        From the pseudo-rigid model, or the first that can move, to all effects of the drawing.
    tolerances
        Twice the standard deviation that tolerances of dimensions and modulus give a quantity, relative, by its key.
    """

    rungs: Sequence[ErrorStep]
    tolerances: Mapping[str, float]


def model_hierarchy(design: Design, fem: Mapping[str, Quantity]) -> ModelHierarchy | None:
    """Return the model hierarchy of a design compared with FEM; None where it is no frame, or has no formula."""
    try:
        model = of_design(design, bare=True)
    except InputError:
        return None
    keys = _compared_keys(design, fem)
    known = {key: fem[key].value for key in keys if key in fem and fem[key].value}
    if not known:
        return None
    effects = nominal_effects(design)
    left = list(effects)
    there: dict[str, Mapping[str, float]] = {}
    rungs = [_model_step("", model, known, there)]
    while left:
        trials = [_model_step(name, model, known, {**there, name: effects[name]}) for name in left]
        best = min(trials, key=lambda step_of_ladder: step_of_ladder.size)
        there[best.effect] = effects[best.effect]
        left.remove(best.effect)
        rungs.append(best)
    rungs = [rung for rung in rungs if math.isfinite(rung.size)] or rungs[-1:]
    # What has nothing to act on, such as the bending of rods where there are none, is no step.
    rungs = [rungs[0], *(rung for before, rung in pairwise(rungs) if rung.differs_from(before))]
    if design.is_stage:
        axes = {fem[key].boundary.partition(", ")[0] for key in keys}
        fem = {key: quantity for key, quantity in fem.items() if quantity.boundary.partition(", ")[0] in axes}
    return ModelHierarchy(rungs, _tolerances(of_design(design), fem))


def _compared_keys(design: Design, fem: Mapping[str, Quantity]) -> list[str]:
    """Return the keys of what is compared."""
    if not design.is_stage:
        return list(COMPARED)
    distinct: list[list[str]] = []
    for axis in design.stage().assembly().axes:
        keys = [key.format(axis) for key in OF_AXIS if key.format(axis) in fem]
        values = [fem[key].value for key in keys]
        if not any(
            np.allclose([fem[key].value for key in other], values, rtol=SAME_AXIS, atol=0) for other in distinct
        ):
            distinct.append(keys)
    return [key for keys in distinct for key in keys]


def _model_step(
    name: str, model: StaticModel, known: Mapping[str, float], effects: Mapping[str, Mapping[str, float]]
) -> ErrorStep:
    try:
        found = replace(model, effects=effects).compliance({}).quantities()
    except Mechanism:  # held twice without giving way
        found = {}
    return ErrorStep(name, {k: found[k].value / value - 1 if k in found else math.inf for k, value in known.items()})


def _tolerances(model: StaticModel, fem: Mapping[str, Quantity]) -> dict[str, float]:
    predicted = model.compliance({}).quantities()
    quantities = {key: q for key, q in fem.items() if key in predicted and q.value}
    table = StaticTable("", tuple(Row(q.name, q.boundary, q.value, abs(q.value), q.unit) for q in quantities.values()))
    inputs = uncertainty(model, table).inputs
    return {key: float(2 * u / abs(q.value)) for (key, q), u in zip(quantities.items(), inputs, strict=True)}

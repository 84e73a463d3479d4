"""A design as a model of static tables: what its compliance model says of each row."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from flexdesign.analytic import frame
from flexdesign.analytic.compliance import ComplianceModel, drawn
from flexdesign.design import Design
from flexdesign.effects import statics
from flexdesign.errors import InputError
from flexdesign.model import Effect, Observation, Parameter
from flexdesign.static_tables.table import Row, StaticTable

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StaticModel:
    """A design with static effects; a `Model`.

    Parameters
    ----------
    design
        The design.
    effects
        Values of their parameters, SI, by effect and parameter.
    made_larger
        By how much every part is larger than drawn, in some dimensions [m].
    """

    design: Design
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    made_larger: Mapping[str, float] = field(default_factory=dict)
    _built: dict[tuple[tuple[str, float], ...], ComplianceModel] = field(default_factory=dict, repr=False)

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters of its effects, named ``effect.parameter``."""
        return tuple(
            replace(parameter, name=f"{name}.{parameter.name}", start=values[parameter.name])
            for name, values in self.effects.items()
            for parameter in statics.find(name).parameters
        )

    def replace(self, values: Mapping[str, float]) -> StaticModel:
        """Return the model with some values changed."""
        changed = {name: dict(own) for name, own in self.effects.items()}
        for dotted, value in values.items():
            name, _, parameter = dotted.rpartition(".")
            changed[name][parameter] = value
        return replace(self, effects=changed)

    def with_effect(self, effect: Effect, name: str = "") -> StaticModel:
        """Return the model with an effect, at its null; what has none is at its start.

        `name` is that under which `flexdesign.effects.statics.find` has it; by default its own.
        """
        nulls = {p.name: float(p.start or 0.0) if p.null is None else p.null for p in effect.parameters}
        return replace(self, effects={**self.effects, name or effect.name: nulls})

    def predict(self, observation: Observation) -> Array:
        """Return what the model expects of each row of a `StaticTable`, SI."""
        table = cast(StaticTable, observation)
        models = {part: self.compliance(dict(part)) for part in dict.fromkeys(row.part for row in table.rows)}
        return np.array([_value(models[row.part], row) for row in table.rows])

    def compliance(self, dimensions: Mapping[str, float]) -> ComplianceModel:
        """Return the compliance model of a part that differs in some dimensions from the design.

        Raises
        ------
        InputError
            If such a part cannot be built.
        """
        varied = {**self.design.dimensions, **dimensions}
        varied |= {name: varied[name] + by for name, by in self.made_larger.items()}
        key = tuple(varied.items())
        if key not in self._built:
            stiffness = self.design.actuator.installed_stiffness if self.design.actuator else None
            part = replace(self.design, dimensions=varied).part()
            self._built[key] = ComplianceModel.of_part(part, self.design.material, stiffness)
        return self._built[key].having(self.effects)


def of_design(design: Design, *, bare: bool = False) -> StaticModel:
    """Return the model of a design with all that its drawing tells, and what it says it has besides.

    Parameters
    ----------
    design
        The design.
    bare
        Whether to begin with the pseudo-rigid model instead: hinges that only rotate.

    Raises
    ------
    InputError
        If the compliance model cannot say anything of the part.
    """
    if design.is_stage:
        raise InputError(design.file, "part", None, "is a whole stage; static tables are of one part, its amplifier")
    effects = {} if bare else drawn(design.part())
    model = StaticModel(design, {**effects, **design.effects})
    try:
        model.compliance({}).quantities()
    except frame.Mechanism as error:
        remedy = f"the part's linkage is no frame: {error}; name every hinge, arm and rod in linkage()"
        raise InputError(design.file, "part", design.part_class.__name__, remedy) from error
    return model


def _value(model: ComplianceModel, row: Row) -> float:
    if row.quantity == "lambda":
        return model.amplification()
    if row.quantity == "K_in":
        return model.input_stiffness(math.inf if row.boundary == "output held" else 0.0)
    if row.boundary == "actuator installed":
        if model.actuator_stiffness is None:
            raise InputError("design", "actuator", None, f"{row.key} needs an actuator in the design")
        return model.output_stiffness(model.actuator_stiffness)
    return model.output_stiffness(math.inf if row.boundary == "input held" else 0.0)

"""A design, of a part or a whole stage, as a model of static tables: what its compliance model says of each row."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np

from flexdesign.analytic import compliance, frame, large_frame, stage_compliance
from flexdesign.analytic.compliance import ComplianceModel
from flexdesign.analytic.stage_compliance import StageCompliance
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Effect, Observation, Parameter
from flexdesign.design.design import Design
from flexdesign.effects import statics
from flexdesign.effects.hinge_compliance import roots
from flexdesign.measurements.static_table import DISPLACEMENTS, Row, StaticTable


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
    guessed
        Whether what its linkage does not state of hinges and rods is guessed
        (`hinge_compliance.roots.with_guessed_roots`).
    """

    design: Design
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    made_larger: Mapping[str, float] = field(default_factory=dict)
    guessed: bool = False
    _built: dict[tuple[object, ...], ComplianceModel | StageCompliance] = field(default_factory=dict, repr=False)
    _states: dict[object, large_frame.State] = field(default_factory=dict, repr=False)

    @property
    def unstated(self) -> tuple[str, ...]:
        """Names of hinges and rods of which the linkage does not say what they run into."""
        built = self.compliance({})
        parts = built.models.values() if isinstance(built, StageCompliance) else [built]
        members = [member for part in parts for member in part.linkage.members]
        return tuple(dict.fromkeys(member.name for member in members if roots.with_guessed_roots(member) != member))

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
        loaded = dict.fromkeys((row.part, row.load) for row in table.rows if row.load is not None)
        moved = {key: self._displacement(models[key[0]], *key) for key in loaded}
        found = []
        for row in table.rows:
            if row.load is None:
                found.append(self._stiffness(models[row.part], row))
            else:
                found.append(float(moved[row.part, row.load][list(DISPLACEMENTS).index(row.quantity)]))
        return np.array(found)

    def _stiffness(self, model: ComplianceModel | StageCompliance, row: Row) -> float:
        try:
            return _value(model, row)
        except frame.Mechanism as error:
            remedy = f"has no finite {row.key} in this model: {error}; begin with the effects of the drawing"
            raise InputError(self.design.file, "part", self.design.part_class.__name__, remedy) from error

    def _displacement(
        self, model: ComplianceModel | StageCompliance, part: object, load: tuple[float, ...] | None
    ) -> Array:
        """Return how the output moves under a load [m, m, rad]; a state found before for it is where it begins."""
        assert isinstance(model, ComplianceModel) and load is not None
        moved, self._states[part, load] = large_frame.displacement(model, load, self._states.get((part, load)))
        return moved

    def compliance(self, dimensions: Mapping[str, float]) -> ComplianceModel | StageCompliance:
        """Return the compliance model of a part or stage that differs in some dimensions from the design.

        Raises
        ------
        InputError
            If such a part cannot be built.
        """
        varied = {**self.design.dimensions, **dimensions}
        varied |= {name: varied[name] + by for name, by in self.made_larger.items()}
        key = (self.guessed, *varied.items())
        if key not in self._built:
            stiffness = self.design.actuator.installed_stiffness if self.design.actuator else None
            is_drawn, material = varied == dict(self.design.dimensions), self.design.material
            other = self.design if is_drawn else replace(self.design, dimensions=varied)
            if other.is_stage:
                whole = StageCompliance.of_assembly(other.assembly(), material, stiffness)
                guessed = (
                    {id(part): _with_guessed_roots(part) for part in whole.models.values()} if self.guessed else {}
                )
                models = {name: guessed.get(id(part), part) for name, part in whole.models.items()}
                self._built[key] = replace(whole, models=models)
            else:
                part = ComplianceModel.of_part(other.part(), material, stiffness)
                self._built[key] = _with_guessed_roots(part) if self.guessed else part
        return self._built[key].having(self.effects)


def of_design(design: Design, *, bare: bool = False) -> StaticModel:
    """Return the model of a design with all effects that follow from its drawing, and those that the design states.

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
    whole = StaticModel(design, {**nominal_effects(design), **design.effects})
    try:  # hinges that only rotate may hold a part that moves with all effects of the drawing: a parallelogram
        whole.compliance({}).quantities()
    except frame.Mechanism as error:
        remedy = f"the part's linkage is no frame: {error}; name every hinge, arm and rod in linkage()"
        if design.is_stage:
            remedy = f"the parts are no frame together: {error}"
        raise InputError(design.file, "part", design.part_class.__name__, remedy) from error
    return replace(whole, effects=dict(design.effects)) if bare else whole


def nominal_effects(design: Design) -> dict[str, dict[str, float]]:
    """Return the effects that a part or a stage has by its drawing, in full strength."""
    if design.is_stage:
        return stage_compliance.nominal_effects(design.assembly())
    return compliance.nominal_effects(design.part())


def _with_guessed_roots(part: ComplianceModel) -> ComplianceModel:
    members = tuple(roots.with_guessed_roots(member) for member in part.linkage.members)
    return replace(part, linkage=replace(part.linkage, members=members))


def _of_stage(model: StageCompliance, row: Row) -> float:
    axis, _, boundary = row.boundary.partition(", ")
    if row.quantity == "lambda":
        return model.amplification(axis)
    if row.quantity == "K_in":
        return model.input_stiffness(axis)
    if boundary == "actuators installed":
        return model.output_stiffness(axis, _installed_stiffness(model, row))
    return model.output_stiffness(axis, math.inf if boundary == "inputs held" else 0.0)


def _installed_stiffness(model: ComplianceModel | StageCompliance, row: Row) -> float:
    if model.actuator_stiffness is None:
        raise InputError("design", "actuator", None, f"{row.key} needs an actuator in the design")
    return model.actuator_stiffness


def _value(model: ComplianceModel | StageCompliance, row: Row) -> float:
    if isinstance(model, StageCompliance):
        return _of_stage(model, row)
    if row.quantity == "lambda":
        return model.amplification()
    if row.quantity == "K_in":
        return model.input_stiffness(math.inf if row.boundary == "output held" else 0.0)
    if row.boundary == "actuator installed":
        return model.output_stiffness(_installed_stiffness(model, row))
    return model.output_stiffness(math.inf if row.boundary == "input held" else 0.0)

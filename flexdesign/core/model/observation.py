"""What evidence asks of a model, and of a measurement: two protocols that keep the two sides strangers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Protocol

from flexdesign.core.model.effect import Effect
from flexdesign.core.model.parameter import Parameter


class Observation(Protocol):
    """Something that was measured: a run in time, a static table, a frequency response."""

    @property
    def name(self) -> str:
        """Name of the observation, e.g. its file's stem."""

    @property
    def role(self) -> Literal["identify", "validate", "test"]:
        """Whether a fit may see it."""

    def measured(self) -> Any:
        """Return the measured response as an array, in SI."""


class Model(Protocol):
    """Something that predicts observations; immutable, so that every change is a new model."""

    def parameters(self) -> tuple[Parameter, ...]:
        """Return every number that can be changed, with dotted names."""

    def replace(self, values: Mapping[str, float]) -> Model:
        """Return the model with some values changed."""

    def with_effect(self, effect: Effect) -> Model:
        """Return the model with an effect added, at its null."""

    def predict(self, observation: Observation) -> Any:
        """Return what the model expects to be measured, shaped as ``observation.measured()``."""


def parameter_of(model: Model, name: str) -> Parameter:
    """Return a parameter of a model by its name."""
    return next(parameter for parameter in model.parameters() if parameter.name == name)

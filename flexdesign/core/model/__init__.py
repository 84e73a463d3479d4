"""The nouns everything speaks: quantities, parameters, effects, linkages, observations, models."""

from flexdesign.core.model.effect import (
    ACTUATORS,
    OTHER,
    PIEZO,
    Adjust,
    Block,
    Controller,
    Disturbance,
    Effect,
    Elastic,
    Maxwell,
    Reshape,
    Resonance,
    Socket,
    Term,
)
from flexdesign.core.model.formulas import Formulas
from flexdesign.core.model.linkage import Linkage, Member, Root
from flexdesign.core.model.notch import Notch
from flexdesign.core.model.observation import Model, Observation, parameter_of
from flexdesign.core.model.parameter import Parameter
from flexdesign.core.model.quantity import Quantity, by_key, output_boundary

__all__ = [
    "ACTUATORS",
    "OTHER",
    "PIEZO",
    "Adjust",
    "Block",
    "Controller",
    "Disturbance",
    "Effect",
    "Elastic",
    "Formulas",
    "Linkage",
    "Maxwell",
    "Member",
    "Model",
    "Notch",
    "Observation",
    "Parameter",
    "Quantity",
    "Reshape",
    "Resonance",
    "Root",
    "Socket",
    "Term",
    "by_key",
    "output_boundary",
    "parameter_of",
]

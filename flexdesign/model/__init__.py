"""The nouns everything speaks: quantities, parameters, effects, linkages, observations, models."""

from flexdesign.model.effect import OTHER, Adjust, Block, Controller, Disturbance, Effect, Resonance, Socket, Term
from flexdesign.model.linkage import Linkage, Member
from flexdesign.model.observation import Model, Observation
from flexdesign.model.parameter import Parameter
from flexdesign.model.quantity import Quantity, output_boundary

__all__ = [
    "OTHER",
    "Adjust",
    "Block",
    "Controller",
    "Disturbance",
    "Effect",
    "Linkage",
    "Member",
    "Model",
    "Observation",
    "Parameter",
    "Quantity",
    "Resonance",
    "Socket",
    "Term",
    "output_boundary",
]

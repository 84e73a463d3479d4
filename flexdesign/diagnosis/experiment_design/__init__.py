"""The bench: command files within an axis' limits, effect signatures, and which distinguish two effects."""

from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.experiment_design.discrimination import (
    NOISE,
    Resolved,
    Separation,
    required_experiments,
    resolve_effects,
)
from flexdesign.diagnosis.experiment_design.effect_strength import EffectAtStrength, on, reading
from flexdesign.diagnosis.experiment_design.experiments import elsewhere, suite_of
from flexdesign.diagnosis.experiment_design.limits import Asked, Limits, axis, dynamics, of_axis, refuse_unlimited
from flexdesign.diagnosis.experiment_design.signature import EffectResponse, Signature, signature_of

__all__ = [
    "NOISE",
    "Asked",
    "Command",
    "EffectAtStrength",
    "EffectResponse",
    "Limits",
    "Resolved",
    "Separation",
    "Signature",
    "axis",
    "dynamics",
    "elsewhere",
    "of_axis",
    "on",
    "reading",
    "refuse_unlimited",
    "required_experiments",
    "resolve_effects",
    "signature_of",
    "suite_of",
]

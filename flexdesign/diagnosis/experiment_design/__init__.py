"""The bench: command files within an axis' limits, effect signatures, and which distinguish two effects."""

from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.experiment_design.discrimination import Resolved, proposals, resolve_effects
from flexdesign.diagnosis.experiment_design.effect_strength import (
    EffectAtStrength,
    Signature,
    on,
    reading,
    signature_of,
)
from flexdesign.diagnosis.experiment_design.experiments import suite_of
from flexdesign.diagnosis.experiment_design.limits import Limits, dynamics, of_axis

__all__ = [
    "Command",
    "EffectAtStrength",
    "Limits",
    "Resolved",
    "Signature",
    "dynamics",
    "of_axis",
    "on",
    "proposals",
    "reading",
    "resolve_effects",
    "signature_of",
    "suite_of",
]

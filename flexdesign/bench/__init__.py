"""The bench: command files within an axis' limits, what effects change in them, and which tell two effects apart."""

from flexdesign.bench.acting import Acting, on, reading
from flexdesign.bench.commands import Command
from flexdesign.bench.limits import Asked, Limits, axis, dynamics, of_axis, refuse_unlimited
from flexdesign.bench.resolve import NOISE, Resolved, Separation, needed, resolve_effects
from flexdesign.bench.signature import Seen, Signature, signature_of
from flexdesign.bench.suite import elsewhere, suite_of

__all__ = [
    "NOISE",
    "Acting",
    "Asked",
    "Command",
    "Limits",
    "Resolved",
    "Seen",
    "Separation",
    "Signature",
    "axis",
    "dynamics",
    "elsewhere",
    "needed",
    "of_axis",
    "on",
    "reading",
    "refuse_unlimited",
    "resolve_effects",
    "signature_of",
    "suite_of",
]

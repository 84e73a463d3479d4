"""Diagnosis: which physical effect a model lacks, judged by recorded runs.

The names are imported when they are first used: a simulation needs parts of this package, but no diagnosis.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flexdesign.diagnosis.procedure import diagnose
    from flexdesign.diagnosis.result import CandidateRecord, Diagnosis, ErrorStep, IdentifiedEffect, Value

__all__ = ["CandidateRecord", "Diagnosis", "ErrorStep", "IdentifiedEffect", "Value", "diagnose"]


def __getattr__(name: str) -> Any:
    """Import a name when it is first used (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{'procedure' if name == 'diagnose' else 'result'}"), name)

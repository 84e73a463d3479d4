"""How numbers and names are written in the report."""

from __future__ import annotations

import math

from flexdesign.core.units import significant, to_text
from studies.lin2019_gains.findings import Candidate, Findings, Step


def axis_and_plant(found: Findings, candidate: Candidate) -> str:
    """Return axis and plant."""
    return f"{found.axis.name}, {candidate.label}"


def n(value: float, digits: int = 4) -> str:
    """Return a number without unit."""
    return significant(value, digits)


def settling(step: Step | None) -> float:
    """Return the settling time [s]; nan for no step."""
    return step.settling if step else math.nan


def hz(value: float) -> str:
    """Return a frequency."""
    return to_text(value, "Hz", 4)


def ms(value: float, digits: int = 3) -> str:
    """Return a time; a dash for none."""
    return "–" if math.isnan(value) else to_text(value, "ms", digits)

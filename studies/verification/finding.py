"""One number that is known, and what is found for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

#: Where a reference comes from: mathematics or a beam formula, a published benchmark, another program, or limits that a
#: theorem or an argument gives.
Kind = Literal["analytic", "benchmark", "independent code", "bound"]


@dataclass(frozen=True)
class Finding:
    """A row of the table.

    Parameters
    ----------
    problem, quantity
        What is solved, and what is asked of it.
    kind, source
        What sort of reference it is, and where it comes from.
    reference, found
        The known number and ours.
    unit
        Their unit.
    low, high
        What `found` must lie between.
    unknowns
        Degrees of freedom of the finest mesh.
    note
        What the range follows from, or what explains the difference.
    seconds
        What the problem took; rows of one problem share it.
    """

    problem: str
    quantity: str
    kind: Kind
    source: str
    reference: float
    found: float
    unit: str
    low: float
    high: float
    unknowns: int
    note: str = ""
    seconds: float = 0.0

    @property
    def holds(self) -> bool:
        """Whether what was found lies in the range."""
        return self.low <= self.found <= self.high

    @property
    def difference(self) -> float | None:
        """Found against reference, relative; None where the reference is zero."""
        return self.found / self.reference - 1 if self.reference else None


def range_around(reference: float, relative: float) -> tuple[float, float]:
    """Return the range of a reference give or take a share of it.

    >>> range_around(-2.0, 0.5)
    (-3.0, -1.0)
    """
    return reference - relative * abs(reference), reference + relative * abs(reference)


def failures(findings: Sequence[Finding]) -> list[str]:
    """Return what lies outside its range, in words."""
    return [
        f"{f.problem}, {f.quantity}: {f.found:.6g} {f.unit}, not in {f.low:.6g} to {f.high:.6g}"
        for f in findings
        if not f.holds
    ]

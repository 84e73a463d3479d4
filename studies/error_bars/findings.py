"""How far the program's answers lie from the reference's, in units of what it estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from studies.error_bars.designs import SampledDesign
from studies.error_bars.trial import Method, ProgramResult, ReferenceResult

#: What is asked: estimates that contain the truth.
REQUIRED_COVERAGE = 0.95
#: Estimates this multiple of the errors, by root mean squares, are not honest either.
OVERCAUTIOUS = 20.0


@dataclass(frozen=True)
class Deviation:
    """One quantity of one design.

    Parameters
    ----------
    quantity
        Its key.
    value, estimate
        The program's, SI.
    reference, uncertainty
        The reference's, SI.
    """

    quantity: str
    value: float
    estimate: float
    reference: float
    uncertainty: float

    @property
    def error(self) -> float:
        """How far the value lies from the reference, relative and with its sign."""
        return (self.value - self.reference) / abs(self.reference)

    @property
    def relative_estimate(self) -> float:
        """The estimate, relative."""
        return self.estimate / abs(self.value)

    @property
    def in_estimates(self) -> float:
        """How far the value lies from the reference, in estimates and with its sign."""
        return (self.value - self.reference) / self.estimate

    @property
    def contained(self) -> bool:
        """Whether the estimate contains the reference; what the reference leaves open is no excuse."""
        return abs(self.in_estimates) <= 1.0


@dataclass(frozen=True)
class Case:
    """One design, solved by one method and by the reference."""

    sample: SampledDesign
    method: Method
    answer: ProgramResult
    reference: ReferenceResult

    @property
    def group(self) -> str:
        """What it is judged with: designs with curved necks, or those with leaves by the method of their meshes."""
        return "curved" if self.sample.curved else self.method

    @property
    def deviations(self) -> list[Deviation]:
        """One for each quantity; none if the program gave no answer."""
        answer, reference = self.answer, self.reference
        return [
            Deviation(
                key, answer.values[key], answer.estimates[key], reference.values[key], reference.uncertainties[key]
            )
            for key in answer.values
        ]


@dataclass(frozen=True)
class Judgement:
    """What many deviations come to.

    Parameters
    ----------
    count, contained
        How many there are, and how many estimates contain the reference.
    median_estimate, worst_estimate
        Relative.
    median_error, worst_error
        Relative.
    caution
        Estimate over error, of the root mean squares: what a user pays for the bar.
    worst
        Largest deviation in estimates.
    doubt
        Largest uncertainty of the reference in estimates.
    """

    count: int
    contained: int
    median_estimate: float
    worst_estimate: float
    median_error: float
    worst_error: float
    caution: float
    worst: float
    doubt: float

    @property
    def share(self) -> float:
        """The share of estimates that contain the reference."""
        return self.contained / self.count

    @property
    def holds(self) -> bool:
        """Whether that is as much as is asked, by estimates that say something."""
        return self.share >= REQUIRED_COVERAGE and self.caution < OVERCAUTIOUS


def judge(deviations: Sequence[Deviation]) -> Judgement:
    """Judge deviations; there must be one."""
    errors = np.array([abs(deviation.error) for deviation in deviations])
    estimates = np.array([deviation.relative_estimate for deviation in deviations])
    doubts = np.array([deviation.uncertainty / deviation.estimate for deviation in deviations])
    return Judgement(
        count=len(deviations),
        contained=sum(deviation.contained for deviation in deviations),
        median_estimate=float(np.median(estimates)),
        worst_estimate=float(estimates.max()),
        median_error=float(np.median(errors)),
        worst_error=float(errors.max()),
        caution=float(np.sqrt((estimates**2).mean() / (errors**2).mean())),
        worst=max(abs(deviation.in_estimates) for deviation in deviations),
        doubt=float(doubts.max()),
    )

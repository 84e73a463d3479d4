"""Tracking of a reference by one axis, with its lag or without."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Quantity
from flexdesign.dynamics.metrics.common import need_positive, need_same_length, quantity, ratio, rms


@dataclass(frozen=True)
class Tracking:
    """How far a response stays from its reference.

    Parameters
    ----------
    max, rms
        Largest and root-mean-square error [m].
    at
        When the error is largest, from the first sample [s].
    range
        What the reference spans [m].
    lag
        The delay that was given to the reference before comparing [s]; 0 if none was sought.
    """

    max: float
    rms: float
    at: float
    range: float
    lag: float

    @property
    def max_relative(self) -> float:
        """Largest error over the range; inf for a reference that stands still and a response that does not."""
        return ratio(self.max, self.range)

    @property
    def rms_relative(self) -> float:
        """Root-mean-square error over the range."""
        return ratio(self.rms, self.range)

    def quantities(self, source: str = "", si: str = "m") -> tuple[Quantity, ...]:
        """Return the numbers as quantities; `si` is the unit of the response, ``V`` for an analogue."""
        boundary = "lag removed" if self.lag else ""
        errors = {"max_error": (self.max, si), "rms_error": (self.rms, si)}
        errors |= {"max_error_relative": (self.max_relative, "1"), "rms_error_relative": (self.rms_relative, "1")}
        of_errors = (quantity(name, value, unit, source, boundary) for name, (value, unit) in errors.items())
        return (*of_errors, quantity("lag", self.lag, "s", source))


def tracking(reference: Array, response: Array, period: float, *, longest_lag: float = 0.0) -> Tracking:
    """Compare a response with its reference.

    Parameters
    ----------
    reference, response
        n samples [m].
    period
        Sampling period [s].
    longest_lag
        If positive, the reference is delayed first, by the lag from 0 to `longest_lag` [s] that leaves the smallest
        root-mean-square error. All lags are judged on the same samples, those after `longest_lag`.

    Raises
    ------
    ValueError
        If an array is unfit, the period is not positive, or the longest lag leaves less than half the record.
    """
    need_same_length(reference, response)
    need_positive(period)
    skipped = math.ceil(longest_lag / period - 1e-9)
    if not 0 <= 2 * skipped <= len(reference):
        raise ValueError(f"a longest lag of {longest_lag:g} s does not fit a record of {len(reference) * period:g} s")
    lag = _best_lag(reference, response, skipped, longest_lag / period) if skipped else 0.0
    error = np.abs(response[skipped:] - _delay(reference, lag, skipped))
    worst = int(np.argmax(error))
    return Tracking(
        max=float(error[worst]),
        rms=rms(error),
        at=(skipped + worst) * period,
        range=float(np.ptp(reference)),
        lag=lag * period,
    )


def _best_lag(reference: Array, response: Array, skipped: int, longest: float) -> float:
    """Return the lag with the smallest error, in samples: first to a whole sample, then refined.

    Between two whole lags the delayed reference goes straight from one to the other, so that the squared error is a
    parabola of the lag, and its lowest point known.
    """

    def error(lag: float) -> float:
        return rms(response[skipped:] - _delay(reference, lag, skipped))

    best = float(min(range(math.floor(longest + 1e-9) + 1), key=error))
    lags = [best]
    for low in (best - 1, best):
        if 0 <= low < skipped:
            early, late = _delay(reference, low, skipped), _delay(reference, low + 1, skipped)
            change = late - early
            part = ratio(float(np.dot(response[skipped:] - early, change)), float(np.dot(change, change)))
            lags.append(min(low + min(max(part, 0.0), 1.0), longest))
    return min(lags, key=error)


def _delay(reference: Array, lag: float, skipped: int) -> Array:
    """Return the samples from `skipped` on, delayed by at most as many."""
    whole = math.floor(lag)
    part = lag - whole
    count = len(reference)
    delayed = reference[skipped - whole : count - whole]
    if part == 0:
        return delayed
    return (1 - part) * delayed + part * reference[skipped - whole - 1 : count - whole - 1]

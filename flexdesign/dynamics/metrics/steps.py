"""Step responses: rise, overshoot, settling, steady error."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Quantity
from flexdesign.dynamics.metrics.common import need_same_length, quantity


@dataclass(frozen=True)
class StepResponse:
    """What a response to a step does.

    Parameters
    ----------
    rise_time
        From 10 % to 90 % of the step, first crossings [s]; inf if 90 % is not reached.
    overshoot
        How far it goes beyond the target at most, 0 or more [m].
    settling_time
        From the step to the moment after which it stays within the band [s]; inf if it is outside when the record ends.
    steady_error
        Target less the mean response over the last part of the record [m].
    band
        Half-width of the band around the target, as a share of the step.
    """

    rise_time: float
    overshoot: float
    settling_time: float
    steady_error: float
    band: float

    def quantities(self, source: str = "", si: str = "m") -> tuple[Quantity, ...]:
        """Return the numbers as quantities; `si` is the unit of the response, ``V`` for an analogue."""
        return (
            quantity("rise_time", self.rise_time, "s", source),
            quantity("overshoot", self.overshoot, si, source),
            quantity("settling_time", self.settling_time, "s", source, f"band {100 * self.band:g} %"),
            quantity("steady_error", self.steady_error, si, source),
        )


def step_response(
    time: Array, response: Array, target: float, *, at: float, start: float | None = None, band: float = 0.02
) -> StepResponse:
    """Measure the response to a step.

    Parameters
    ----------
    time, response
        n samples [s], [m].
    target
        What the step asks for [m]; for an open loop, the level at which it comes to rest.
    at
        The moment of the step [s].
    start
        The level before the step [m]; by default the mean of the samples before `at`, or the first sample.
    band
        Half-width of the band for settling, as a share of the step.

    Raises
    ------
    ValueError
        If an array is unfit, the step is none, fewer than three samples follow it, or the band is not between 0 and 1.
    """
    need_same_length(time, response)
    if not 0 < band < 1:
        raise ValueError(f"a band is a share of the step between 0 and 1, found {band!r}")
    first = int(np.searchsorted(time, at - 1e-9 * (time[-1] - time[0])))
    if len(time) - first < 3:
        raise ValueError(f"fewer than three samples follow the step at {at:g} s")
    if start is None:
        start = float(response[:first].mean() if first else response[0])
    if start == target:
        raise ValueError(f"the step goes from {start:g} to {target:g}, which is none")
    moments, share = time[first:], (response[first:] - start) / (target - start)
    tail = share[-max(1, len(share) // 10) :]
    return StepResponse(
        rise_time=_risen(moments, share),
        overshoot=max(0.0, float(share.max()) - 1.0) * abs(target - start),
        settling_time=_settling_time(moments, share, band) - at,
        steady_error=float(1.0 - tail.mean()) * (target - start),
        band=band,
    )


def _risen(time: Array, share: Array) -> float:
    """Return the time from 10 % to 90 %; inf if 90 % is not reached."""
    reached = _time_to_level(time, share, 0.9)
    return reached - _time_to_level(time, share, 0.1) if reached < math.inf else math.inf


def _time_to_level(time: Array, share: Array, level: float) -> float:
    """Return when a level is first reached; inf if never."""
    above = share >= level
    if not above.any():
        return math.inf
    k = int(np.argmax(above))
    if k == 0:
        return float(time[0])
    part = (level - share[k - 1]) / (share[k] - share[k - 1])
    return float(time[k - 1] + part * (time[k] - time[k - 1]))


def _settling_time(time: Array, share: Array, band: float) -> float:
    """Return the moment after which the response stays within the band; inf if it is outside at the end."""
    error = share - 1.0
    outside = np.flatnonzero(np.abs(error) > band)
    if not outside.size:
        return float(time[0])
    k = int(outside[-1])
    if k == len(time) - 1:
        return math.inf
    edge = math.copysign(band, error[k])
    part = (error[k] - edge) / (error[k] - error[k + 1])
    return float(time[k] + part * (time[k + 1] - time[k]))

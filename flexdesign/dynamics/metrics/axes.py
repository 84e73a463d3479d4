"""Several axes together: contours, and coupling between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from flexdesign.core.arrays import Array
from flexdesign.core.model import Quantity
from flexdesign.dynamics.metrics.common import need_finite, need_positive, need_same_length, quantity, rms


@dataclass(frozen=True)
class Contour:
    """How far a motion strays from its path, whatever its delay along it.

    Parameters
    ----------
    max, rms
        Largest and root-mean-square distance [m].
    at
        When it is largest, from the first sample [s].
    """

    max: float
    rms: float
    at: float

    def quantities(self, source: str = "", si: str = "m") -> tuple[Quantity, ...]:
        """Return the numbers as quantities; `si` is the unit of the motion, ``V`` for an analogue."""
        return (
            quantity("max_contour_error", self.max, si, source),
            quantity("rms_contour_error", self.rms, si, source),
        )


def contour(reference: Array, motion: Array, period: float, *, within: float) -> Contour:
    """Measure the distance of a motion of several axes from its path.

    The path is the line through the samples of the reference. Each sample of the motion is compared with that part of
    it that the reference passes at most `within` before or after, so that a way back along the same line is not taken
    for the way there.

    Parameters
    ----------
    reference, motion
        axes x n samples [m].
    period
        Sampling period [s].
    within
        How far in time the nearest point may lie [s]; more than the lag of the motion.

    Raises
    ------
    ValueError
        If the arrays are unfit, or one of the times is not positive.
    """
    if reference.ndim != 2 or reference.shape != motion.shape or reference.shape[1] < 2:
        raise ValueError(f"two arrays axes x n are needed, found {reference.shape} and {motion.shape}")
    need_finite(reference, motion)
    need_positive(period)
    need_positive(within, "time within which the nearest point is sought")
    count = reference.shape[1]
    reach = min(math.ceil(within / period), count - 1)
    longest = float(np.sqrt((np.diff(reference, axis=1) ** 2).sum(axis=0)).max())
    distance = _nearest(np.ascontiguousarray(reference), np.ascontiguousarray(motion), longest, reach)
    worst = int(np.argmax(distance))
    return Contour(float(distance[worst]), rms(distance), worst * period)


@njit(cache=True, error_model="numpy")
def _nearest(path: Array, motion: Array, longest: float, reach: int) -> Array:
    """Return the distance [m] of each sample from the pieces of the path at most `reach` samples away.

    No piece of the path is longer than `longest` [m]. A piece whose beginning is farther away than the nearest one by
    several times that length is followed by as many pieces that cannot be nearer; they are skipped.
    """
    axes, count = path.shape
    nearest = np.full(count, np.inf)
    for sample in range(count):
        first, last = max(0, sample - reach), min(count - 2, sample + reach - 1)
        for begin, way in ((min(sample, last), 1), (min(sample, last) - 1, -1)):
            piece = begin
            while first <= piece <= last:
                along, length, start = 0.0, 0.0, 0.0
                for axis in range(axes):
                    side, away = path[axis, piece + 1] - path[axis, piece], motion[axis, sample] - path[axis, piece]
                    along += away * side
                    length += side * side
                    start += away * away
                part = min(1.0, max(0.0, along / length)) if length > 0.0 else 0.0
                square = 0.0
                for axis in range(axes):
                    side, away = path[axis, piece + 1] - path[axis, piece], motion[axis, sample] - path[axis, piece]
                    square += (away - part * side) ** 2
                nearest[sample] = min(nearest[sample], math.sqrt(square))
                skipped = (math.sqrt(start) - nearest[sample]) / longest if longest > 0.0 else count
                piece += way * max(1, int(min(skipped, count)))
    return nearest


@dataclass(frozen=True)
class Coupling:
    """How much an axis moves that should not.

    Parameters
    ----------
    driven, other
        From lowest to highest position, of the driven axis and of the other [m].
    """

    driven: float
    other: float

    @property
    def ratio(self) -> float:
        """Motion of the other axis over that of the driven one."""
        return self.other / self.driven

    def quantities(self, source: str = "") -> tuple[Quantity, ...]:
        """Return the ratio as a quantity."""
        return (quantity("coupling", self.ratio, "1", source),)


def coupling(driven: Array, other: Array) -> Coupling:
    """Compare the motion of an axis that should stand still with that of the driven axis; n samples each [m].

    Noise adds its whole peak-to-peak to the other axis: the ratio of a quiet pair is that of the sensors.

    Raises
    ------
    ValueError
        If an array is unfit, or the driven axis stands still.
    """
    need_same_length(driven, other)
    if not np.ptp(driven) > 0:
        raise ValueError("the driven axis stands still")
    return Coupling(float(np.ptp(driven)), float(np.ptp(other)))

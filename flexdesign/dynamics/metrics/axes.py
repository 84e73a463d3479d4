"""Several axes together: contours, and coupling between them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

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
    sides = np.diff(reference, axis=1)
    squares = np.maximum((sides**2).sum(axis=0), np.finfo(np.float64).tiny)
    nearest = np.full(count, np.inf)
    reach = min(math.ceil(within / period), count - 1)
    for offset in range(-reach, reach):
        # Sample k against the piece of path from k + offset to k + offset + 1, for all k that have one.
        samples = slice(max(0, -offset), min(count, count - 1 - offset))
        pieces = slice(samples.start + offset, samples.stop + offset)
        away = motion[:, samples] - reference[:, pieces]
        along = np.clip((away * sides[:, pieces]).sum(axis=0) / squares[pieces], 0.0, 1.0)
        square = ((away - along * sides[:, pieces]) ** 2).sum(axis=0)
        np.minimum(nearest[samples], square, out=nearest[samples])
    distance = np.sqrt(nearest)
    worst = int(np.argmax(distance))
    return Contour(float(distance[worst]), rms(distance), worst * period)


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

"""Moves from level to level: hold, step, staircase, and straight lines of one or several axes."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, model_validator

from flexdesign.core.arrays import Array
from flexdesign.core.toml_files import whole
from flexdesign.dynamics.trajectories.base import AnyLevel, AnyVelocity, Duration, Level, Pause, Trajectory

#: A moment this close before a jump, in dwells, is at the jump: what rounding does to a time on the sampling grid.
_ROUNDING = 1e-7


class Hold(Trajectory):
    """One level for the time `time`."""

    shape: Literal["hold"] = "hold"
    level: AnyLevel
    time: Duration

    def _moving(self) -> float:
        return float(self.time)

    def _at(self, time: Array) -> Array:
        return np.full(time.shape, self.level.value)


class Step(Trajectory):
    """`start` for the time `wait`, then `target` for the time `hold`."""

    shape: Literal["step"] = "step"
    start: AnyLevel
    target: AnyLevel
    wait: Duration
    hold: Duration

    def _moving(self) -> float:
        return float(self.wait + self.hold)

    def _fastest(self) -> float:
        return float(0.5 / min(self.wait, self.hold))

    def _at(self, time: Array) -> Array:
        return np.where(time < self.wait * (1 - _ROUNDING), self.start.value, self.target.value)


class Staircase(Trajectory):
    """From `low` to `high` in `steps` equal steps, and back down unless `back` is false.

    Every level is held for the time `dwell`, the first and the last too; `high` is not held twice.
    """

    shape: Literal["staircase"] = "staircase"
    low: AnyLevel
    high: AnyLevel
    steps: whole(1, 100_000)  # type: ignore[valid-type]
    dwell: Duration
    back: bool = True

    def _stairs(self) -> Array:
        up = np.linspace(self.low.value, self.high.value, self.steps + 1)
        return np.concatenate([up, up[-2::-1]]) if self.back else up

    def _moving(self) -> float:
        return float(len(self._stairs()) * self.dwell)

    def _fastest(self) -> float:
        return float(0.5 / self.dwell)

    def _at(self, time: Array) -> Array:
        stairs = self._stairs()
        number = np.floor(time / self.dwell + _ROUNDING).astype(np.intp)
        return stairs[np.minimum(number, len(stairs) - 1)]


def _points(given: Any) -> Any:
    """Read a point of one axis written as bare text as a point with one coordinate."""
    if not isinstance(given, (list, tuple)):
        raise ValueError('expected a list of points: [["0 um", "0 um"], ["100 um", "100 um"]]')
    return [[point] if isinstance(point, (str, Level)) else point for point in given]


class Line(Trajectory):
    """Straight lines from point to point at constant velocity along the path.

    ``points = [["0 um", "0 um"], ["262 um", "262 um"], ["0 um", "0 um"]]``: one number per axis in the order that the
    experiment gives; ``["0 V", "60 V", "0 V"]`` will do for one axis. At each point after the first it waits for the
    time `dwell`.
    """

    shape: Literal["line"] = "line"
    points: Annotated[tuple[tuple[AnyLevel, ...], ...], BeforeValidator(_points)]
    velocity: AnyVelocity
    dwell: Pause = 0.0

    @model_validator(mode="after")
    def _leads_somewhere(self) -> Self:
        if len(self.points) < 2:
            raise ValueError("needs at least two points")
        if not self.points[0] or len({len(point) for point in self.points}) > 1:
            raise ValueError("needs the same number of axes, at least one, in every point")
        same = next((n for n, (a, b) in enumerate(pairwise(self.points), start=1) if a == b), None)
        if same:
            raise ValueError(f"has the same point twice, as points {same} and {same + 1}; to wait there use dwell")
        return self

    def levels(self) -> tuple[Level, ...]:
        """Return every coordinate, and the velocity."""
        return (*(level for point in self.points for level in point), self.velocity)

    @property
    def axes(self) -> int:
        """How many coordinates a point has."""
        return len(self.points[0])

    def corners(self) -> Array:
        """Return the points, axes x points [V or m]."""
        return np.array([[level.value for level in point] for point in self.points]).T

    def _knots(self) -> tuple[Array, Array]:
        """Return arrival and departure at each point, in turn, and the points there; knots, axes x knots."""
        corners = self.corners()
        legs = np.linalg.norm(np.diff(corners, axis=1), axis=0) / self.velocity.value
        times = np.zeros((corners.shape[1], 2))
        times[1:, 0] = np.cumsum(legs) + self.dwell * np.arange(len(legs))
        times[1:, 1] = times[1:, 0] + self.dwell
        return times.ravel(), np.repeat(corners, 2, axis=1)

    def _moving(self) -> float:
        return float(self._knots()[0][-1])

    def _fastest(self) -> float:
        lengths = np.linalg.norm(np.diff(self.corners(), axis=1), axis=0)
        return float(0.5 * self.velocity.value / lengths.min())

    def _at(self, time: Array) -> Array:
        times, points = self._knots()
        points_at = np.stack([np.interp(time, times, along) for along in points])
        return points_at[0] if self.axes == 1 else points_at

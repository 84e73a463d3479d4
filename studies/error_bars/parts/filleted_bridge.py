"""The bridge amplifier with long fillets: its leaves become curved necks, up to right-circular notches.

Each root of a leaf has a quarter of a circle; where two of them fill the leaf they make a half circle.
"""

from __future__ import annotations

import math
from typing import Any

from flexdesign.design import part

Point = tuple[float, float]
Straight = part.load("bridge_amplifier")


class FilletedBridge(Straight):  # type: ignore[misc, valid-type]
    """A bridge amplifier whose fillets are as long as half a leaf at most; declared by `Member.root_radius`."""

    def _require(self, name: str, lower: float = -math.inf, upper: float = math.inf, why: str = "") -> None:
        if name == "fillet_radius" and math.isfinite(upper) and lower == -math.inf:
            upper = min(self.hinge_length, self.arm_thickness - self.hinge_thickness) / 2
        super()._require(name, lower, upper, why)

    def solid(self) -> Any:
        """Return the amplifier as one closed solid [mm]."""
        import cadquery as cq

        half = self.hinge_thickness / 2
        roots = [
            (x, y + side * half)
            for leaf in self.linkage().of_kind("hinge")
            for x, y, _ in (leaf.start, leaf.end)
            for side in (1, -1)
        ]
        front = cq.Workplane("XY")
        for loop in self._loops():
            front = _draw_contour(front, loop, roots, self.fillet_radius)
        return front.extrude(1e3 * self.width / 2, both=True).solids().val()


def _draw_contour(plane: Any, loop: list[Point], roots: list[Point], radius: float) -> Any:
    """Draw a closed contour, rounded at the roots."""
    pieces: list[list[Point]] = []
    for index, corner in enumerate(loop):
        if min(math.dist(corner, root) for root in roots) > 1e-9:
            pieces.append([corner])
            continue
        before, after = (_towards(corner, loop[(index + step) % len(loop)]) for step in (-1, 1))
        first, last = (_shift(corner, way, radius) for way in (before, after))
        centre = _shift(first, after, radius)
        across = (before[0] + after[0], before[1] + after[1])
        middle = _shift(centre, across, -radius / math.sqrt(2))
        pieces.append([first, middle, last])
    at = pieces[0][0]
    plane = plane.moveTo(*_mm(at))
    for piece in [*pieces, pieces[0][:1]]:
        if math.dist(at, piece[0]) > 1e-9:
            plane = plane.lineTo(*_mm(piece[0]))
        if len(piece) == 3:
            plane = plane.threePointArc(_mm(piece[1]), _mm(piece[2]))
        at = piece[-1]
    return plane.close()


def _towards(start: Point, end: Point) -> Point:
    length = math.dist(start, end)
    return (end[0] - start[0]) / length, (end[1] - start[1]) / length


def _shift(point: Point, way: Point, distance: float) -> Point:
    return point[0] + distance * way[0], point[1] + distance * way[1]


def _mm(point: Point) -> Point:
    return 1e3 * point[0], 1e3 * point[1]

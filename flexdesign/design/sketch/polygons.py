"""Polygons as arrays of corners, shape (n, 2) [m]: what they hold, where they meet."""

from __future__ import annotations

import math

import numpy as np

from flexdesign.core.arrays import Array, Flags

#: Lengths below this are none [m]; the CAD kernel takes points nearer than 1e-7 mm as one.
TOLERANCE = 1e-9


def area_moments(corners: Array) -> tuple[float, Array, float]:
    """Return area [m^2], centroid [m] and polar second moment about the centroid [m^4], whichever way it winds.

    >>> area, centre, polar = area_moments(np.array([(0, 0), (2, 0), (2, 1), (0, 1)], float))
    >>> float(area), centre.tolist(), round(float(polar), 6)  # b h (b^2 + h^2) / 12
    (2.0, [1.0, 0.5], 0.833333)
    """
    origin = corners.mean(axis=0)
    a, b = corners - origin, np.roll(corners, -1, axis=0) - origin
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = cross.sum() / 2
    centre = ((a + b) * cross[:, None]).sum(axis=0) / (6 * area)
    polar = ((a * a + a * b + b * b).sum(axis=1) * cross).sum() / 12
    return abs(float(area)), origin + centre, abs(float(polar)) - abs(float(area)) * float(centre @ centre)


def extent(corners: Array) -> float:
    """Return the largest distance between two corners [m]."""
    return float(np.linalg.norm(corners[:, None] - corners[None], axis=2).max())


def winding(corners: Array) -> int:
    """Return 1 if the corners run around to the left, -1 if to the right."""
    a, b = corners, np.roll(corners, -1, axis=0)
    return 1 if float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()) > 0 else -1


def sides(corners: Array) -> Array:
    """Return the ends of the sides, shape (n, 2, 2) [m]."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def on_boundary(corners: Array, points: Array) -> Flags:
    """Tell of points, shape (..., 2) [m], whether they lie on a side."""
    start, way = corners, np.roll(corners, -1, axis=0) - corners
    away = points[..., None, :] - start
    share = np.clip((away * way).sum(axis=-1) / (way * way).sum(axis=-1), 0.0, 1.0)
    return np.asarray((np.linalg.norm(away - share[..., None] * way, axis=-1) < 10 * TOLERANCE).any(axis=-1))


def contains(corners: Array, points: Array) -> Flags:
    """Tell of points, shape (..., 2) [m], whether they lie within the boundary, not on it.

    A ray to the right crosses the boundary an odd number of times (even-odd rule).
    """
    (ax, ay), (bx, by) = corners.T, np.roll(corners, -1, axis=0).T
    x, y = points[..., :1], points[..., 1:]
    spans = (ay > y) != (by > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        right = x < ax + (y - ay) / (by - ay) * (bx - ax)
    return np.asarray(((spans & right).sum(axis=-1) % 2 == 1) & ~on_boundary(corners, points))


def crosses_itself(corners: Array) -> bool:
    """Tell whether two sides cross between their ends."""
    ends = sides(corners)
    return _crossing(ends, ends)


def overlap(one: Array, two: Array) -> bool:
    """Tell whether two polygons share more than their boundaries."""
    if not _boxes_meet(one, two):
        return False
    first, second = sides(one), sides(two)
    if _crossing(first, second):
        return True
    return bool(contains(two, _witnesses(one)).any() or contains(one, _witnesses(two)).any())


def touch(one: Array, two: Array) -> bool:
    """Tell whether two polygons share a piece of their boundaries that has a length."""
    if not _boxes_meet(one, two):
        return False
    for a, b in sides(one):
        way = (b - a) / np.linalg.norm(b - a)
        normal = np.array([-way[1], way[0]])
        for c, d in sides(two):
            if abs((c - a) @ normal) < 10 * TOLERANCE and abs((d - a) @ normal) < 10 * TOLERANCE:
                low, high = sorted((float((c - a) @ way), float((d - a) @ way)))
                if min(high, float(np.linalg.norm(b - a))) - max(low, 0.0) > 10 * TOLERANCE:
                    return True
    return False


def _boxes_meet(one: Array, two: Array) -> bool:
    """Tell whether the boxes about two polygons meet, which sorts out most pairs at once."""
    return bool(
        (one.max(axis=0) + TOLERANCE > two.min(axis=0)).all() and (two.max(axis=0) + TOLERANCE > one.min(axis=0)).all()
    )


def have_same_corners(one: Array, two: Array) -> bool:
    """Tell whether two polygons have the same corners."""
    if len(one) != len(two):
        return False
    gaps = np.linalg.norm(one[:, None] - two[None], axis=2)
    return bool((gaps.min(axis=1) < 10 * TOLERANCE).all())


def distance(segments: Array, start: Array, way: Array) -> float:
    """Return how far it is from a point along a unit vector to the nearest of some segments, shape (k, 2, 2) [m]."""
    along = segments[:, 1] - segments[:, 0]
    from_start = segments[:, 0] - start
    det = way[0] * along[:, 1] - way[1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (from_start[:, 0] * along[:, 1] - from_start[:, 1] * along[:, 0]) / det
        share = (from_start[:, 0] * way[1] - from_start[:, 1] * way[0]) / det
    hit = (np.abs(det) > 1e-15) & (reach > TOLERANCE / 10) & (share > -1e-9) & (share < 1 + 1e-9)
    return float(reach[hit].min()) if hit.any() else math.inf


def _witnesses(corners: Array) -> Array:
    """Return points that decide whether one polygon lies in another: corners, middles of sides, and one within it."""
    ends = sides(corners)
    middles = ends.mean(axis=1)
    way = ends[:, 1] - ends[:, 0]
    normals = np.column_stack([-way[:, 1], way[:, 0]]) / np.linalg.norm(way, axis=1)[:, None]
    near = 100 * TOLERANCE * normals
    points = np.concatenate([corners, middles, middles + near, middles - near])
    return np.asarray(points[on_boundary(corners, points) | contains(corners, points)])


def _crossing(first: Array, second: Array) -> bool:
    a, b, c, d = first[:, None, 0], first[:, None, 1], second[None, :, 0], second[None, :, 1]

    def side(p: Array, q: Array, r: Array) -> Array:
        """Return how far r lies to the left of the line from p to q [m]."""
        u, v = q - p, r - p
        return np.asarray((u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]) / np.linalg.norm(u, axis=-1))

    apart = np.ones(np.broadcast_shapes(a.shape, c.shape)[:2], dtype=bool)
    for one, two in ((side(a, b, c), side(a, b, d)), (side(c, d, a), side(c, d, b))):
        apart &= (one * two < 0) & (np.abs(one) > 10 * TOLERANCE) & (np.abs(two) > 10 * TOLERANCE)
    return bool(apart.any())

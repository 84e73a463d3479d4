"""Triangulations against the areas they must have, the sizes they were asked for, and the rules of a mesh."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from flexdesign.fem.meshing.planar import PlanarError, Triangulation, triangulate
from flexdesign.fem.meshing.section import Curve
from studies.verification.solids import Array

SIDE = 10e-3


def polygon(corners: list[tuple[float, float]]) -> list[Curve]:
    """Straight curves between corners [mm], each on a face of its own."""
    points = np.array(corners) * 1e-3
    return [
        Curve(np.stack([a, b]), face)
        for face, (a, b) in enumerate(zip(points, np.roll(points, -1, axis=0), strict=True))
    ]


def circle(radius: float, pieces: int = 1024) -> Curve:
    angle = np.linspace(0.0, 2 * np.pi, pieces + 1) % (2 * np.pi)
    return Curve(radius * np.column_stack([np.cos(angle), np.sin(angle)]), 99)


def even(length: float) -> Callable[[Array], Array]:
    return lambda points: np.full(len(points), length)


def edges(found: Triangulation) -> Array:
    """Every edge once, shape (k, 2)."""
    return np.unique(np.sort(found.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)


SQUARE = polygon([(-5, -5), (5, -5), (5, 5), (-5, 5)])
#: Two blocks joined by a leaf of a twentieth of their height: sharp roots, pieces of the outline that face each other.
DUMBBELL = polygon(
    [(-9, -5), (-2, -5), (-2, -0.25), (2, -0.25), (2, -5), (9, -5),
     (9, 5), (2, 5), (2, 0.25), (-2, 0.25), (-2, 5), (-9, 5)]
)  # fmt: skip
ROOTS = np.array([(x, y) for x in (-2e-3, 2e-3) for y in (-0.25e-3, 0.25e-3)])


def towards_roots(points: Array) -> Array:
    away = np.linalg.norm(points[:, None] - ROOTS, axis=2).min(axis=1)
    return np.minimum(0.02e-3 + 0.5 * away, 2e-3)


@pytest.mark.parametrize("length", [3e-3, 1e-3, 0.4e-3])
def test_even_square(length: float) -> None:
    found = triangulate(SQUARE, even(length), 1e-6)
    assert found.area == pytest.approx(SIDE**2, rel=1e-12)
    ends = found.points[edges(found)]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert 0.65 * length < lengths.mean() < 1.15 * length
    assert lengths.max() < 2 * length
    assert found.quality().min() > 0.3


def test_edges_shrink_towards_the_roots() -> None:
    found = triangulate(DUMBBELL, towards_roots, 1e-6)
    assert found.area == pytest.approx(2 * 70e-6 + 2e-6, rel=1e-12)
    ends = found.points[edges(found)]
    ratio = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / towards_roots(ends.mean(axis=1))
    assert 0.65 < np.median(ratio) < 1.15
    assert ratio.max() < 2.2
    for root in ROOTS:
        at_root = np.abs(ends - root).max(axis=2).min(axis=1) < 1e-12
        assert np.linalg.norm(ends[at_root, 1] - ends[at_root, 0], axis=1).mean() < 2 * 0.02e-3
    assert found.quality().min() > 0.2


def test_every_piece_of_the_outline_is_the_side_of_one_triangle() -> None:
    found = triangulate(DUMBBELL, towards_roots, 1e-6)
    sides = np.sort(found.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, count = np.unique(sides, axis=0, return_counts=True)
    assert count.max() == 2
    assert {tuple(s) for s in unique[count == 1].tolist()} == {tuple(s) for s in np.sort(found.sides).tolist()}
    assert len(found.points) - len(unique) + len(found.triangles) == 1  # Euler, no hole
    assert len(np.unique(found.triangles)) == len(found.points)


def test_pieces_know_their_face() -> None:
    found = triangulate(SQUARE, even(1e-3), 1e-6)
    for face, (axis, value) in enumerate([(1, -5e-3), (0, 5e-3), (1, 5e-3), (0, -5e-3)]):
        ends = found.points[found.sides[found.owners == face]]
        assert len(ends) >= 10
        assert np.abs(ends[:, :, axis] - value).max() < 1e-15


@pytest.mark.parametrize("chord", [20e-6, 2e-6])
def test_pieces_stay_within_the_chord_error_of_a_curve_and_enclose_its_area(chord: float) -> None:
    """Pieces of a circle reach from 2/3 of the chord error outside of it to 1/3 inside; next to its end 3/2 of that."""
    radius = 2e-3
    found = triangulate([*SQUARE, circle(radius)], even(2e-3), chord)
    ends = found.points[found.sides[found.owners == 99]]
    outside = np.linalg.norm(ends, axis=2) - radius
    assert np.median(outside) == pytest.approx(2 / 3 * chord, rel=0.1)
    assert -1e-5 * radius < outside.min() and outside.max() < 1.1 * chord
    assert np.linalg.norm(ends.mean(axis=1), axis=1).min() > radius - chord
    assert SIDE**2 - found.area == pytest.approx(math.pi * radius**2, rel=2 * (chord / radius) ** 2 + 1e-5)
    assert len(found.points) - len(edges(found)) + len(found.triangles) == 0  # Euler, one hole


def test_the_area_of_a_curve_is_kept_to_second_order_in_the_chord_error() -> None:
    """On a half circle from the bottom side to the top; chords with their ends on it would leave 2/3 of the chord."""
    radius, errors = 2e-3, []
    angle = np.linspace(-np.pi / 2, np.pi / 2, 4097)
    arc = Curve(radius * np.column_stack([np.cos(angle), np.sin(angle)]), 1)
    for chord in (80e-6, 20e-6):
        found = triangulate([arc, Curve(np.array([[0.0, radius], [0.0, -radius]]), 0)], even(2e-3), chord)
        errors.append(abs(found.area / (math.pi * radius**2 / 2) - 1))
    assert errors[0] < 2 * (80e-6 / radius) ** 2
    assert errors[1] < errors[0] / 10


def test_same_question_same_answer() -> None:
    first, second = (triangulate(DUMBBELL, towards_roots, 1e-6) for _ in range(2))
    assert np.array_equal(first.points, second.points)
    assert np.array_equal(first.triangles, second.triangles)


def test_open_outline_is_refused() -> None:
    with pytest.raises(PlanarError, match="not closed"):
        triangulate(SQUARE[:3], even(1e-3), 1e-6)

"""Triangles moved to a neighbour's section: where they must lie, and what must be refused."""

from __future__ import annotations

import numpy as np
import pytest

from flexdesign.fem.meshing.extruded import stack_prisms
from flexdesign.fem.meshing.mesh import MeshError
from flexdesign.fem.meshing.morphing import LEAST_QUALITY, Pattern, have_same_topology, morph
from flexdesign.fem.meshing.planar import triangulate
from flexdesign.fem.meshing.section import Curve, Section
from studies.verification.solids import Array

CORNERS = np.array([(0, 0), (20, 0), (20, 8), (12, 8), (12, 3), (8, 3), (8, 8), (0, 8)]) * 1e-3


def section(corners: Array, depth: float = 4e-3, faces: list[int] | None = None) -> Section:
    ends = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    curves = [Curve(np.stack(pair), face) for face, pair in zip(faces or range(len(corners)), ends, strict=True)]
    return Section(2, 0.0, depth, (98, 99), tuple(curves))


def size(points: Array) -> Array:
    """Edges grow with the distance from the two re-entrant corners."""
    roots = np.array([(12e-3, 3e-3), (8e-3, 3e-3)])
    return 2e-4 + 0.4 * np.linalg.norm(points[:, None] - roots, axis=2).min(axis=1)


@pytest.fixture(scope="module")
def pattern() -> Pattern:
    given = section(CORNERS)
    return Pattern(given, size, triangulate(given.outline, size, 1e-5))


def test_the_same_section_leaves_everything_where_it_is(pattern: Pattern) -> None:
    found = pattern.morph(section(CORNERS), size)
    assert np.abs(found.points - pattern.plan.points).max() < 1e-12


def test_a_shifted_section_takes_its_triangles_along(pattern: Pattern) -> None:
    """Constants are harmonic whatever the triangles' stiffness: every vertex must follow, the inner ones too."""
    shift = np.array([1e-3, -2e-3])
    found = pattern.morph(section(CORNERS + shift), lambda points: size(points - shift))
    assert np.abs(found.points - (pattern.plan.points + shift)).max() < 1e-12


def test_small_triangles_keep_their_shape_best(pattern: Pattern) -> None:
    """Where the outline of a stout part moves, it is the large triangles that give: small ones turn and shift."""
    corners = CORNERS.copy()
    corners[[4, 5], 1] += 0.6e-3
    found = pattern.morph(section(corners), lambda points: size(points - [0.0, 0.6e-3]))

    def sides(points: Array) -> Array:
        there = points[pattern.plan.triangles]
        return np.linalg.norm(there - np.roll(there, 1, axis=1), axis=2)

    strain = np.abs(sides(found.points) / sides(pattern.plan.points) - 1).max(axis=1)
    area = sides(pattern.plan.points).prod(axis=1)
    small, large = (strain[area < np.quantile(area, 0.2)], strain[area > np.quantile(area, 0.8)])
    assert small.mean() < large.mean() / 2


def test_vertices_follow_the_grading_that_is_wanted(pattern: Pattern) -> None:
    """With edges wanted even, those on a side become even, as many as there were."""
    found = pattern.morph(section(CORNERS), lambda points: np.full(len(points), 1e-3))
    for face in range(len(CORNERS)):
        sides = found.sides[found.owners == face]
        lengths = np.linalg.norm(found.points[sides[:, 0]] - found.points[sides[:, 1]], axis=1)
        assert np.ptp(lengths) < 0.02 * lengths.mean(), face  # PLACES sample the count along a curve


def test_area_and_volume_are_those_of_the_neighbour(pattern: Pattern) -> None:
    corners = CORNERS.copy()
    corners[[4, 5], 1] = 2.2e-3  # the neck thinner, as a hinge would be
    thinner = section(corners, 5e-3)
    plan = pattern.morph(thinner, size)
    assert plan.area == pytest.approx((20 * 8 - 4 * (8 - 2.2)) * 1e-6, rel=1e-12)
    mesh = stack_prisms(pattern.plan, pattern.section, np.array([0.0, 1e-3, 4e-3]))
    found = morph(mesh, plan, thinner, np.array([0.0, 2e-3, 5e-3]))
    assert found.volume == pytest.approx(plan.area * 5e-3, rel=1e-12)
    assert found.tets is mesh.tets and found.quality().min() > LEAST_QUALITY * mesh.quality().min()


def test_other_corners_are_refused(pattern: Pattern) -> None:
    fewer = section(CORNERS[[0, 1, 2, 7]])
    turned = section(np.roll(CORNERS, 1, axis=0), faces=[*range(1, 8), 0])
    assert not have_same_topology(pattern.section, fewer) and not have_same_topology(pattern.section, turned)
    with pytest.raises(MeshError, match="other corners"):
        pattern.morph(fewer, size)


def test_an_outline_that_turns_over_is_refused(pattern: Pattern) -> None:
    with pytest.raises(MeshError, match="worst triangle"):
        pattern.morph(section(CORNERS * [-1.0, 1.0]), lambda points: size(points * [-1.0, 1.0]))


def test_layers_in_the_wrong_order_are_refused(pattern: Pattern) -> None:
    mesh = stack_prisms(pattern.plan, pattern.section, np.array([0.0, 1e-3, 4e-3]))
    with pytest.raises(MeshError, match="turn over"):
        morph(mesh, pattern.plan, pattern.section, np.array([0.0, 5e-3, 4e-3]))

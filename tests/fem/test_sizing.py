"""The sizing field against its formula, and what is measured on meshes against meshes of known edges."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import ConvexHull

from flexdesign.design import design
from flexdesign.fem.meshing import domain, sizing
from flexdesign.fem.meshing.mesh import signed_volumes
from flexdesign.fem.meshing.sizing import Sizing
from studies.verification.solids import lattice

ROOTS = np.array([[[0.0, 0.0, -2e-3], [0.0, 0.0, 3e-3]], [[5e-3, 1e-3, 0.0], [6e-3, 4e-3, 2e-3]]])
FIELD = Sizing(ROOTS, np.array([0.2e-3, 0.5e-3]), growth=0.4, largest=1.6e-3)


def amplifier(**changes: float) -> Any:
    """Return the shipped amplifier with some dimensions changed."""
    read = design.read(design.find("bridge_amplifier"))
    return read.part_class(**{**read.dimensions, **changes})


def test_distance_is_that_to_the_nearest_of_many_points_on_the_edges() -> None:
    """Against 20 000 points on each edge, 0.25 um apart at most: distances are larger by less than that."""
    places = np.random.default_rng(4).uniform(-5e-3, 9e-3, (200, 3))
    along = np.linspace(0, 1, 20_000)[:, None]
    lines = [start + along * (end - start) for start, end in ROOTS]
    nearest = np.min([np.linalg.norm(places[:, None] - line, axis=2).min(axis=1) for line in lines], axis=0)
    found = sizing.distance(places, ROOTS)
    assert np.all(found <= nearest + 1e-15)
    np.testing.assert_allclose(found, nearest, atol=0.25e-6)


def test_size_at_the_roots_between_and_far_away() -> None:
    places = np.array(
        [[0, 0, 1e-3], [5.5e-3, 2.5e-3, 1e-3], [-1e-3, 0, 0], [0, -2e-3, 3e-3], [-9e-3, 0, 0], [0, 0, -3e-3]]
    )
    expected = [0.2e-3, 0.5e-3, 0.6e-3, 1.0e-3, 1.6e-3, 0.6e-3]
    assert FIELD(places) == pytest.approx(expected, rel=1e-12)
    assert FIELD.finest == 0.2e-3


def test_size_grows_no_faster_than_asked() -> None:
    rng = np.random.default_rng(8)
    a, b = rng.uniform(-5e-3, 9e-3, (2, 500, 3))
    assert np.all(np.abs(FIELD(a) - FIELD(b)) <= 0.4 * np.linalg.norm(a - b, axis=1) + 1e-15)


def test_background_covers_the_box_and_carries_the_field() -> None:
    """Its tetrahedra fill a hull around the box; within them interpolation follows the field.

    Points thin out in octaves, so that in between the field is off by less than half an octave and a little: a factor
    of 1.5 here. On the roots themselves points stand an edge length apart, and there is nothing to interpolate across.
    """
    low, high = np.array([-3e-3, -3e-3, -3e-3]), np.array([8e-3, 6e-3, 4e-3])
    points, tets, sizes = FIELD.background(low, high)
    assert np.all(points.min(axis=0) < low) and np.all(points.max(axis=0) > high)
    volume = np.abs(signed_volumes(points, tets.astype(np.int64))).sum()
    assert volume == pytest.approx(ConvexHull(points).volume, rel=1e-9)
    assert volume > np.prod(high - low)
    np.testing.assert_array_equal(sizes, FIELD(points))
    places = np.random.default_rng(1).uniform(low, high, (2000, 3))
    ratio = LinearNDInterpolator(points, sizes)(places) / FIELD(places)
    assert np.all((ratio > 1 / 1.5) & (ratio < 1.5))  # false for NaN, outside of the hull
    assert np.median(ratio) == pytest.approx(1.0, abs=0.02)
    at_roots = LinearNDInterpolator(points, sizes)(ROOTS.mean(axis=1)) / [0.2e-3, 0.5e-3]
    assert at_roots == pytest.approx(1.0, abs=0.1)


def test_background_is_dense_where_elements_are_small() -> None:
    """As many points within a shell around a root as its cells ask for: more than one per h^3 there."""
    points, _, _ = FIELD.background(np.full(3, -3e-3), np.full(3, 8e-3))
    near = sizing.distance(points, ROOTS[:1]) < 0.2e-3
    assert near.sum() > 5e-3 / 0.2e-3


def test_roots_of_the_amplifier_s_hinges() -> None:
    """Of eight hinges the quarter has four, with four root edges each, cut to half the width."""
    part = amplifier()
    body = domain.of_part(part, chord=1e-5)
    edges, owners = sizing.root_edges(part.linkage().of_kind("hinge"), body)
    assert sorted({owner.name for owner in owners}) == [
        "hinge_inner_lr", "hinge_inner_ur", "hinge_outer_lr", "hinge_outer_ur",
    ]  # fmt: skip
    assert edges.shape == (16, 2, 3)
    corners = np.vstack([face.points for face in body.faces])
    for edge in edges:
        assert edge[0, 2] == pytest.approx(0.0, abs=1e-9) and edge[1, 2] == pytest.approx(6e-3, rel=1e-9)
        assert np.ptp(edge[:, :2], axis=0) == pytest.approx([0.0, 0.0], abs=1e-15)
        for end in edge:  # each ends at a vertex of the solid
            assert np.linalg.norm(corners - end, axis=1).min() < 1e-9


def test_roots_of_rods_are_those_the_solid_has() -> None:
    """A rod stands out from its block with an edge on the inside and one on the outside."""
    part = amplifier()
    body = domain.of_part(part, chord=1e-5)
    edges, owners = sizing.root_edges(part.linkage().of_kind("rod"), body)
    corners = np.vstack([face.points for face in body.faces])
    assert {owner.kind for owner in owners} == {"rod"}
    assert {owner.name for owner in owners} == {"rod_ur", "rod_lr"}
    for edge in edges:
        assert np.linalg.norm(corners - edge[1], axis=1).min() < 1e-9


def test_edge_length_at_roots_is_the_mean_of_those_near() -> None:
    """A lattice of cubes of 1 mm: edges of 1, sqrt 2 and sqrt 3; counted around one of its lines by hand.

    The edges whose middle is within 0.1 mm of the line of three cubes are those three alone; the next are farther.
    """
    axis = np.linspace(0.0, 3e-3, 4)
    points, tets = lattice(axis, axis, axis)
    line = np.array([[[1e-3, 1e-3, 0.0], [1e-3, 1e-3, 3e-3]]])
    assert sizing.edge_length_at_roots(points, tets, line, 0.1e-3) == pytest.approx(1e-3, rel=1e-12)
    ends = {(min(a, b), max(a, b)) for tet in tets.tolist() for a in tet for b in tet if a != b}
    everywhere = [np.linalg.norm(points[a] - points[b]) for a, b in ends]
    assert sizing.edge_length_at_roots(points, tets, line, 1.0) == pytest.approx(np.mean(everywhere), rel=1e-12)


def test_edges_along_a_slender_leaf_are_a_sixteenth_of_it_and_grow_no_faster_beside_it() -> None:
    part = design.read(design.find("parallelogram")).part()
    body = domain.of_part(part, chord=1e-5)
    (leaf,) = [member for member in part.linkage().members if member.name == "leaf"]
    for coarseness in (1.0, 1.5):
        spans = sizing.spans_in([leaf], body, 0.6, coarseness)
        field = Sizing(*_roots_of(leaf, body), growth=0.6 * coarseness, largest=8e-3, spans=spans)
        middle, across = np.array(leaf.centre), np.array([leaf.thickness / 2 + 2e-3, 0.0, 0.0])
        longest = coarseness * leaf.length / 16
        assert field(np.array([middle, middle + across])) == pytest.approx([longest, longest + 1.2e-3 * coarseness])
    bridge = amplifier().linkage().of_kind("hinge")  # their edges are short anyway
    assert sizing.spans_in(bridge, domain.of_part(amplifier(), chord=1e-5), 0.6, 1.0) == ()


def _roots_of(leaf: Any, body: Any) -> tuple[Any, Any]:
    edges, owners = sizing.root_edges([leaf], body)
    return edges, np.array([0.05 * owner.thickness for owner in owners])

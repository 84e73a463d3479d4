"""The estimated number of tetrahedra beside an integral on a lattice, and beside what the mesher makes."""

from __future__ import annotations

import time

import numpy as np
import pytest

from flexdesign.fem.meshing import domain, element_count, mesh
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.sizing import Sizing
from tests.fem.solids import Bracket

ROOT = np.array([[[4e-3, 9e-3, 0.0], [4e-3, 9e-3, 3e-3]]])


@pytest.fixture(scope="module")
def quarter() -> Domain:
    """A quarter of the bracket: a T of a foot of 4 x 9 mm and half a bar of 9 x 4 mm, 3 mm deep."""
    return domain.of_part(Bracket(), chord=1e-5)


def on_a_lattice(field: Sizing, step: float) -> float:
    """The integral over the T by the midpoint rule."""
    axes = [np.arange(step / 2, end, step) for end in (9e-3, 13e-3, 3e-3)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = (places[:, 0] < 4e-3) | (places[:, 1] > 9e-3)
    return float(element_count.PER_CUBE * step**3 * (field(places[inside]) ** -3.0).sum())


def test_edges_of_one_length_make_the_volume_over_their_cube(quarter: Domain) -> None:
    assert quarter.volume == pytest.approx(216e-9, rel=1e-9)
    found = element_count.estimate(quarter, Sizing(ROOT, np.array([1e-3]), growth=1e-9, largest=1e-3))
    assert found == pytest.approx(element_count.PER_CUBE * 216, rel=1e-6)


@pytest.mark.parametrize("at_root", [0.4e-3, 0.1e-3, 0.05e-3])
def test_the_estimate_is_the_integral_of_the_field(quarter: Domain, at_root: float) -> None:
    """A midpoint rule with steps of at most half the shortest edge; random points are 10 % off at most."""
    field = Sizing(ROOT, np.array([at_root]), growth=0.5, largest=2e-3)
    assert element_count.estimate(quarter, field) == pytest.approx(on_a_lattice(field, at_root / 2), rel=0.1)


@pytest.mark.parametrize("at_root", [0.4e-3, 0.15e-3])
def test_the_mesher_makes_about_as_many_as_are_estimated(
    quarter: Domain, monkeypatch: pytest.MonkeyPatch, at_root: float
) -> None:
    """Within a factor of two: the count goes with the cube of an edge that the mesher follows loosely."""
    monkeypatch.setattr(mesh, "snap", lambda made, *_: made)  # of which nothing is asked but its number
    field = Sizing(ROOT, np.array([at_root]), growth=0.5, largest=2e-3)
    made = len(mesh.tetrahedralize(quarter, field, 1e-4).tets)
    assert 0.5 < made / element_count.estimate(quarter, field) < 2


def test_a_mesh_without_bound_is_estimated_at_once(quarter: Domain) -> None:
    """Cubes stop at their largest number, by which there are far more elements than anybody solves."""
    began = time.perf_counter()
    found = element_count.estimate(quarter, Sizing(ROOT, np.array([1e-8]), growth=1e-3, largest=1e-6))
    assert found > 1e7
    assert time.perf_counter() - began < 60


def test_edges_are_as_much_longer_as_fewer_elements_are_asked_for(quarter: Domain) -> None:
    def field(factor: float) -> Sizing:
        return Sizing(ROOT, np.array([factor * 1e-3]), growth=1e-9, largest=factor * 1e-3)

    count = element_count.PER_CUBE * 216
    assert element_count.lengthened(quarter, field, 1.001 * count / 8) == pytest.approx(2, rel=1e-3)
    assert element_count.lengthened(quarter, field, 2 * count) == 1

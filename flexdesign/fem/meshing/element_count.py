"""How many tetrahedra a mesher is going to make, before it makes them: an integral over the target edge length.

A tetrahedron of edge length h takes a volume in proportion to h^3, so that a domain holds

    N = c * integral of h(x)^-3 dV

of them. Cubes that cover the domain are halved until each is no longer than a few of the shortest edges that are wanted
in it; random points in each tell h and whether it lies in the domain. That takes a second, however fine the mesh.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from flexdesign.fem.meshing.domain import Domain

FloatArray = NDArray[np.float64]
#: Tetrahedra per h^3 [1]. A regular one takes h^3 / (6 sqrt 2); fTetWild makes 1.4 to 1.7 times as many on the bridge
#: amplifier (9 000 to 96 000 of them), and 3.3 times on the notched lever (27 000 and 84 000), a half of which this is.
PER_CUBE = 1.6 * 6 * 2**0.5
#: Length of a cube in edges, at most, and its number of random points: three edges change the estimate by 4 %.
EDGES, POINTS = 6.0, 4
#: Most cubes; a mesh for which they do not suffice is larger than what is counted by then.
CUBES = 200_000


class Field(Protocol):
    """A target edge length as a function of place, which grows with the distance from where it is smallest."""

    @property
    def growth(self) -> float:
        """The increase of the edge length per distance, at most."""

    @property
    def finest(self) -> float:
        """The smallest edge length asked for [m]."""

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the target edge length [m] at points of shape (n, 3)."""


def lengthened(domain: Domain, sizing: Callable[[float], Field], most: float) -> float:
    """Return by what factor edges must be longer for no more than `most` tetrahedra; 1 if there are fewer.

    `sizing` returns the edge lengths for a factor. The number falls with its cube or, where a sheet leaves no room for
    longer edges to grow, by less.
    """
    factor = 1.0
    while (count := estimate(domain, sizing(factor))) > most:
        factor *= max(float(count / most) ** (1 / 3), 1.05)
    return factor


def estimate(domain: Domain, sizing: Field) -> float:
    """Return about how many tetrahedra fill a domain; if they are very many, fewer than there are."""
    points, triangles, _ = domain.surface()
    low, high = points.min(axis=0), points.max(axis=0)
    centres, edges = _cubes(low, high, sizing)
    rng = np.random.default_rng(0)
    places = centres[:, None] + edges[:, None, None] * (rng.random((len(centres), POINTS, 3)) - 0.5)
    flat = places.reshape(-1, 3)
    inside = _contains(flat, points, triangles)
    volume = np.repeat(edges**3 / POINTS, POINTS)[inside]
    if not len(volume):
        return 0.0
    # Of the volume that random points find, the CAD kernel knows the true size.
    return float(PER_CUBE * (volume / sizing(flat[inside]) ** 3).sum() * domain.volume / volume.sum())


def _cubes(low: FloatArray, high: FloatArray, sizing: Field) -> tuple[FloatArray, FloatArray]:
    """Return centres (n, 3) and edges (n,) [m] of cubes that cover a box and are short where edges are."""
    edge = float((high - low).min())
    axes = [low[i] + edge * (np.arange(int(np.ceil((high - low)[i] / edge - 1e-9))) + 0.5) for i in range(3)]
    waiting = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    corners = np.array(list(itertools.product((-0.25, 0.25), repeat=3)))
    centres, edges = [], []
    count = 0
    while len(waiting):
        wanted = sizing(waiting) - sizing.growth * edge * 3**0.5 / 2  # the least within the cube
        split = edge > EDGES * np.maximum(wanted, sizing.finest)
        centres.append(waiting[~split])
        edges.append(np.full(int((~split).sum()), edge))
        count += len(centres[-1])
        waiting = (waiting[split][:, None] + edge * corners).reshape(-1, 3)
        edge /= 2
        if count + len(waiting) > CUBES:
            centres.append(waiting)
            edges.append(np.full(len(waiting), edge))
            break
    return np.vstack(centres), np.concatenate(edges)


def _contains(points: FloatArray, surface: FloatArray, triangles: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Tell which points lie within a closed surface."""
    import pyvista as pv

    cloud, body = pv.PolyData(points), pv.PolyData.from_regular_faces(surface, triangles)
    found = cloud.select_interior_points(body, method="cell_locator", check_surface=False)
    return np.asarray(found["selected_points"], dtype=bool)

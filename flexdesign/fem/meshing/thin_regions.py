"""Where a solid is thin, found on the solid itself: by rays from its faces inwards to the faces across.

The local thickness at a place on a face is the length of the ray from there along the inward normal, where it leaves
through a face that looks the opposite way. Regions of a body that are much thinner than the rest are its hinges: there
it bends, and there the mesh must be fine and true.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flexdesign.core.model import Member
from flexdesign.fem.meshing import reentrant_edges
from flexdesign.fem.meshing.held_edges import HeldEdges
from flexdesign.fem.meshing.reentrant_edges import ReentrantEdges
from flexdesign.fem.meshing.surface import Rays, Surface, surface_of, triangle_areas

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

#: A ray counts where the face it leaves by looks the opposite way within this cosine.
OPPOSITE = 0.94
#: Number of places on faces: along the solid's diagonal, and on all faces at most.
ALONG, MOST = 60, 40_000
#: The thickness of the body is that of so much of its surface, or less.
MOST_OF_IT = 0.75
#: Hinges are thinner than this part of the thickness of the body, and than that of their own neck
#: times the second number; places of one hinge are no farther apart than the third, in thicknesses.
HINGE, OF_NECK, APART = 0.25, 1.5, 2.0
#: Fewer places are no hinge.
FEWEST = 4
#: Chord error of the triangles by which thickness is measured, in the smallest thickness: with 1e-2 necks seemed 1 %
#: thicker than they are, and true meshes were refused.
TRUE = 5e-4
#: Chords fall by no more than this factor until the thickness is measured anew, then within 5 % of it.
STEP = 100.0


@dataclass(frozen=True)
class ThinRegions:
    """Local thickness of a solid at places on its surface.

    Parameters
    ----------
    points, inward
        Places [m] and inward unit normals there, shape (n, 3).
    thickness
        Shape (n,) [m].
    curved
        Radius of the cylinder that a place lies on, or that lies across, the smaller one [m]; infinite between planes,
        and at bores that leave most of the solid around them.
    roots
        The re-entrant edges.
    hinges
        What is thin against the rest: members with thickness, length and width, for the report and the gate.
    chosen
        For each hinge, which places are on it, by index.
    slivers
        Thickness of places that were left out, shape (s,) [m]: thinner than every hinge, and too few to be one.
    held
        The edges of faces that are held or move as one body.
    """

    points: FloatArray
    inward: FloatArray
    thickness: FloatArray
    curved: FloatArray
    roots: ReentrantEdges
    hinges: tuple[Member, ...] = ()
    chosen: tuple[IntArray, ...] = field(default=(), repr=False)
    slivers: FloatArray = field(default_factory=lambda: np.zeros(0), repr=False)
    held: HeldEdges = field(default_factory=HeldEdges, repr=False)

    def middles_of_hinges(self) -> tuple[FloatArray, FloatArray]:
        """Return places half-way across the hinges, shape (k, 3) [m], and the thickness there, shape (k,) [m].

        Of a solid without hinges those of its thinnest places.
        """
        least = np.flatnonzero(self.thickness < OF_NECK * self.thinnest)
        on = np.concatenate(self.chosen) if self.chosen else least
        return self.points[on] + self.inward[on] * self.thickness[on, None] / 2, self.thickness[on]

    @property
    def inward_at_hinges(self) -> FloatArray:
        """Inward unit normals at the places on hinges, shape (k, 3)."""
        return self.inward[np.concatenate([[], *self.chosen]).astype(np.int64)]

    @property
    def roots_of_hinges(self) -> ReentrantEdges:
        """The re-entrant edges next to a hinge."""
        return self.roots.next_to(*self.middles_of_hinges())

    @property
    def is_sharp(self) -> bool:
        """Whether one of these is sharp, so that the stress there grows without bound."""
        return self.roots_of_hinges.is_sharp

    @property
    def thinnest(self) -> float:
        """The smallest thickness [m]."""
        return float(self.thickness.min())


def find(solid: Any) -> ThinRegions:
    """Find what is thin on a CadQuery solid [mm].

    Faces are cast from twice: first evenly, to see how thin the solid is, then more densely where it is.
    """
    coarse = surface_of(solid, 1e-3 * solid.BoundingBox().DiagonalLength * 1e-3)
    spacing = coarse.size / ALONG
    seen = _evenly(coarse, spacing)
    if not len(seen[2]):
        raise ValueError("no ray leaves the solid by a face across")
    fine = _true_surface(solid, coarse, seen)
    tree = cKDTree(seen[0])
    away, nearest = tree.query(fine.corners.mean(axis=1))
    wanted = np.clip(0.4 * (seen[2][nearest] + away), 1e-4 * fine.size, spacing)
    points, owners = _places(fine, wanted)
    rays = Rays(fine.points, fine.triangles)
    places, inward, thickness, curved, _ = _measure(fine, rays, points, owners)
    body = float(np.quantile(seen[2], MOST_OF_IT))
    walls = _walls_of_bores(fine, rays, places, inward, thickness, np.isfinite(curved))
    curved = np.where(walls, np.inf, curved)
    hinges, chosen = _hinges_but_for(walls, places, inward, thickness, body)
    is_sliver = ~walls & (thickness < min((hinge.thickness for hinge in hinges), default=0.0))
    slivers = thickness[is_sliver]
    if len(slivers):
        places, inward, thickness, curved = (each[~is_sliver] for each in (places, inward, thickness, curved))
        walls = walls[~is_sliver]
        hinges, chosen = _hinges_but_for(walls, places, inward, thickness, body)
    thickest = max((hinge.thickness for hinge in hinges), default=float(thickness.min()))
    roots = reentrant_edges.find(fine, places, thickness, thickest)
    hinges = tuple(_lengthwise(hinge, inward[on], rays) for hinge, on in zip(hinges, chosen, strict=True))
    return ThinRegions(places, inward, thickness, curved, roots, hinges, chosen, slivers)


def _evenly(surface: Surface, spacing: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, BoolArray]:
    """Return what `_measure` does, from places that lie evenly on a surface."""
    points, owners = _places(surface, np.full(len(surface.triangles), spacing))
    return _measure(surface, Rays(surface.points, surface.triangles), points, owners)


def _true_surface(
    solid: Any, surface: Surface, seen: tuple[FloatArray, FloatArray, FloatArray, FloatArray, BoolArray]
) -> Surface:
    """Return triangles whose chords err by a share of the smallest thickness at curved faces; planes have no chords.

    A coarse triangle on a small ball may seem to be nearer to its neighbour than anything is thin: the chord falls in
    steps, and the thickness is measured anew.
    """
    chord = 1e-3 * surface.size
    while True:
        thinnest = float(seen[2][seen[4]].min(initial=np.inf))
        wanted = max(TRUE * thinnest, 1e-6 * surface.size)
        if wanted < chord:
            chord = max(wanted, chord / STEP)
            surface = surface_of(solid, chord)
        if wanted >= chord:
            return surface
        seen = _evenly(surface, surface.size / ALONG)


def _places(surface: Surface, wanted: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return places inside the triangles, about as far apart as wanted (m,), and the triangle of each."""
    corners = surface.corners
    area = triangle_areas(corners)
    share = area / wanted**2
    count = np.maximum(np.ceil(share), 1.0)
    if count.sum() > MOST:  # as where all edges are rounded: not each of the many small triangles has a place
        share *= min(1.0, MOST / share.sum())
        share += (MOST - share.sum()) / len(share)
        count = np.diff(np.floor(np.cumsum(share) + 1e-6), prepend=0.0)
    count = count.astype(np.int64)
    owners = np.repeat(np.arange(len(corners)), count)
    # A low-discrepancy sequence (Roberts' R2), folded into the triangle. It runs on from triangle to triangle: begun
    # anew, a strip of many long triangles would have places at a few stations alone.
    order = np.arange(len(owners))
    u, v = (np.modf(order * step)[0] for step in (0.7548776662466927, 0.5698402909980532))
    u, v = (np.where(count[owners] == 1, 1 / 3, each) for each in (u, v))
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    a, b, c = np.moveaxis(corners[owners], 1, 0)
    return a + u[:, None] * (b - a) + v[:, None] * (c - a), owners


def _measure(
    surface: Surface, rays: Rays, points: FloatArray, owners: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, BoolArray]:
    """Return places, inward normals, thickness, radius, and whether a face is curved, of rays that leave across."""
    outward = surface.outward
    inward = -outward[owners]
    step = 1e-7 * surface.size
    far, hit = rays.first(points + step * inward, inward)
    across = (hit >= 0) & (np.einsum("ij,ij->i", inward, outward[hit]) > OPPOSITE)
    near, over = surface.owners[owners], surface.owners[hit]
    across &= ~_wedges(surface)[near, over]
    smaller = np.minimum(surface.radii[near], surface.radii[over])
    bent = np.isnan(surface.normals[:, 0])
    bent = bent[near] | bent[over]
    return points[across], inward[across], far[across] + step, smaller[across], bent[across]


def _wedges(surface: Surface) -> BoolArray:
    """Tell which pairs of plane faces meet at an edge, and so are no two sides of one thickness."""
    count = len(surface.normals)
    meet = np.zeros((count, count), dtype=bool)
    faces = reentrant_edges.pairs_at_edges(surface)[1]
    faces = np.unique(faces[faces[:, 0] != faces[:, 1]], axis=0)
    meet[faces[:, 0], faces[:, 1]] = meet[faces[:, 1], faces[:, 0]] = True
    plane = ~np.isnan(surface.normals[:, 0])
    return meet & np.outer(plane, plane)


def _walls_of_bores(
    surface: Surface, rays: Rays, points: FloatArray, inward: FloatArray, thickness: FloatArray, next_to: BoolArray
) -> BoolArray:
    """Tell which places at cylinders are the wall of a bore that is no wider than its walls on both sides together.

    In the middle of a beam such a bore leaves 7/8 of the stiffness in bending, and one that is not leaves a wall
    beyond it that carries the load past the thinner one. A bore is a hollow cylinder that closes: one with a slit has a
    hinge next to it, and a wide one has two, as in a load cell.
    """
    walls = np.zeros(len(points), dtype=bool)
    few = np.flatnonzero(next_to)
    step = 1e-7 * surface.size
    for sign in (1, -1):  # the bore is where the ray through the wall ends, or behind where it begins
        left = few[~walls[few]]
        way = sign * inward[left]
        start = points[left] + (step + (thickness[left, None] if sign > 0 else 0.0)) * way
        wide, hit = rays.first(start, way)
        bored = np.flatnonzero((hit >= 0) & surface.closed[surface.owners[hit]])
        bored = bored[wide[bored] < 2.1 * surface.radii[surface.owners[hit[bored]]]]
        beyond, _ = rays.first(start[bored] + (wide[bored, None] + step) * way[bored], way[bored])
        walls[left[bored]] = np.isfinite(beyond) & (wide[bored] <= thickness[left[bored]] + beyond)
    return walls


# --- hinges -----------------------------------------------------------------------------------------------------


def _hinges_but_for(
    others: BoolArray, points: FloatArray, inward: FloatArray, thickness: FloatArray, body: float
) -> tuple[tuple[Member, ...], tuple[IntArray, ...]]:
    """Return what `gather_hinges` does, without some of the places."""
    kept = np.flatnonzero(~others)
    hinges, chosen = gather_hinges(points[kept], inward[kept], thickness[kept], body)
    return hinges, tuple(kept[on] for on in chosen)


def gather_hinges(
    points: FloatArray, inward: FloatArray, thickness: FloatArray, body: float
) -> tuple[tuple[Member, ...], tuple[IntArray, ...]]:
    """Gather the thinnest places to hinges: the thinnest first, with all that is about as thin and hangs together.

    Parameters
    ----------
    points, inward, thickness
        As of `ThinRegions`.
    body
        Thickness of the body [m].

    Returns
    -------
    tuple
        The hinges, and for each which places are on it, by index. Fewer places than `FEWEST` that hang together are
        passed over: a step of a micrometre between two faces has hundreds of them.
    """
    left = thickness < HINGE * body
    middles = points + inward * thickness[:, None] / 2
    tree = cKDTree(middles)
    members: list[Member] = []
    chosen: list[IntArray] = []
    for thinnest in np.argsort(thickness, kind="stable").tolist():
        if not left[thinnest]:
            continue
        neck = float(thickness[thinnest])
        group = _connected_places(tree, thinnest, left & (thickness < OF_NECK * neck), APART * neck)
        left[group] = False
        if len(group) < FEWEST:
            left[_within(tree, group, 2 * APART * neck)] = False
            continue
        around = np.flatnonzero(left)
        if len(around):  # what runs out into it is no other hinge
            away, _ = cKDTree(middles[group]).query(middles[around])
            left[around[away < 2 * APART * neck]] = False
        members.append(_member(f"thin_{len(members) + 1}", middles[group], inward[group], neck))
        chosen.append(group)
    return tuple(members), tuple(chosen)


def _connected_places(tree: Any, start: int, allowed: BoolArray, reach: float) -> IntArray:
    """Return the indices of allowed places that hang together with one of them, no step longer than a reach [m]."""
    left = allowed.copy()
    left[start] = False
    steps = [np.array([start])]
    while len(steps[-1]):
        near = _within(tree, steps[-1], reach)
        steps.append(near[left[near]])
        left[steps[-1]] = False
    return np.sort(np.concatenate(steps))


def _within(tree: Any, places: IntArray, reach: float) -> IntArray:
    """Return the indices of what is no farther from any of some places than a reach [m]."""
    return np.unique(np.concatenate(tree.query_ball_point(tree.data[places], reach)).astype(np.int64))


def _member(name: str, middles: FloatArray, inward: FloatArray, neck: float) -> Member:
    """Return a hinge as a member: along the shorter way of its middle surface, as wide as the longer one."""
    centre = middles.mean(axis=0)
    across = main_direction(inward)
    flat = (middles - centre) - np.outer((middles - centre) @ across, across)
    ways = np.linalg.svd(flat, full_matrices=False)[2][:2]
    low, high = (np.stack([f(flat @ way, axis=0) for way in ways]) for f in (np.min, np.max))
    centre = centre + sum(way * (a + b) / 2 for way, a, b in zip(ways, low, high, strict=True))
    spans = high - low
    short = int(np.argmin(spans))
    half = ways[short] * max(float(spans[short]), neck) / 2
    return Member(
        name, "hinge", ("", ""), tuple(centre - half), tuple(centre + half), neck, max(float(spans[1 - short]), neck)
    )


def _lengthwise(hinge: Member, inward: FloatArray, rays: Rays) -> Member:
    """Return a hinge along its longer way if the solid ends at its sides there and goes on beyond its ends."""
    centre, along, half = np.array(hinge.centre), np.array(hinge.axis), (hinge.length / 2, hinge.width / 2)
    aside = np.cross(along, main_direction(inward))
    reach, _ = rays.first(np.tile(centre, (4, 1)), np.array([along, -along, aside, -aside]))
    goes_on = reach > np.repeat(half, 2) + hinge.thickness
    if goes_on[:2].any() or not goes_on[2:].all():
        return hinge
    start, end = (tuple((centre + sign * half[1] * aside).tolist()) for sign in (-1, 1))
    return replace(hinge, start=start, end=end, width=hinge.length)


def main_direction(ways: FloatArray) -> FloatArray:
    """Return the unit vector that unit vectors (n, 3) are most parallel to, whichever way they point."""
    return np.asarray(np.linalg.eigh(ways.T @ ways)[1][:, -1])

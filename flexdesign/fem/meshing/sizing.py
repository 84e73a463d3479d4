"""Where elements must be small: at the sharp roots of a leaf, and at the neck of a curved hinge.

The target edge length grows linearly with the distance from the root edges,

    h(x) = min(h_max, min over roots of h_root + g * distance(x, root)),

with h_root in proportion to the thickness of the member that the root belongs to. A curved hinge has no sharp roots;
its stress and its deformation sit in the neck, and the field follows its profile (`Neck`). The field is handed to the
mesher on a background mesh whose points crowd around roots and necks in the same measure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from flexdesign.core.model import Member
from flexdesign.fem.meshing import profile
from flexdesign.fem.meshing.domain import Domain

FloatArray = NDArray[np.float64]

#: Points within this share of the thickness from the profile lie on it: CAD curves are sampled.
ON_PROFILE = 1e-2
#: Longest edge along a straight hinge or rod on the finest mesh, in its lengths, and what it need not fall below, in
#: its thicknesses. Quadratic elements have constant curvature, so that edges h leave (h / L)^2 of the energy of a leaf
#: that bends into an S: 0.4 %. Where edges grew to a third of the length, K_in of a parallelogram and of two inclined
#: leaves was 4 and 15 % off on the finest mesh; with 1/8 it is 1.6 and 2.1 %, with 1/16 and with 1/32 0.6 and 0.7 %.
LONGEST_ALONG, LEAST_ALONG = 1 / 16, 2.0


@dataclass(frozen=True)
class Neck:
    """The target edge length at a curved hinge, from its local thickness t(s) and the radius R(s) of its profile.

    On the profile it is min(a t(s), sqrt(8 R d)), d the chord error that is allowed; inside it grows with the distance
    from the profile, up to b t(s).

    Parameters
    ----------
    hinge
        The curved hinge.
    surface, inside
        a and b [1].
    chord
        d [m]; where chords keep the area of the profile that at the neck, and elsewhere as much as makes the error of
        t(s), measured across the hinge, no larger a share of it.
    keeps_area
        Whether they do.
    """

    hinge: Member
    surface: float
    inside: float
    chord: float
    keeps_area: bool = False

    @property
    def key(self) -> tuple[object, ...]:
        """What the field depends on, for the cache."""
        h = self.hinge
        shape = (h.start, h.end, h.thickness, h.width, h.root_radius, h.curvature_radius, h.notch)
        return (*shape, self.surface, self.inside, self.chord, self.keeps_area)

    @property
    def finest(self) -> float:
        """The edge length on the profile at the neck [m]."""
        return float(min(self.surface * self.hinge.thickness, self._longest(np.zeros(1))[0]))

    def _longest(self, s: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(8 * profile.radius(self.hinge, s) * self.chord * self._coarser(s)))

    def _coarser(self, s: FloatArray) -> FloatArray:
        """Return how many times the neck's chord error is allowed at s: t(s) cos(slope) / t(0), at least once."""
        if not self.keeps_area:
            return np.ones(np.shape(s))
        step = 1e-4 * self.hinge.length
        half = self.hinge.length / 2
        low, high = np.clip(s - step, -half, half), np.clip(s + step, -half, half)
        slope = (self.hinge.thicknesses(high) - self.hinge.thicknesses(low)) / (high - low) / 2
        return np.asarray(np.maximum(1.0, self.hinge.thicknesses(s) / self.hinge.thickness / np.hypot(1.0, slope)))

    def on_profile(self, points: FloatArray) -> NDArray[np.bool_]:
        """Tell which points of shape (n, 3) lie on the hinge's profile."""
        away = points - np.array(self.hinge.centre)
        axis, normal = profile.frame(self.hinge)
        s, n = np.abs(away @ axis), np.abs(away @ normal)
        half = self.hinge.length / 2
        thickness = self.hinge.thicknesses(np.minimum(s, half))
        return np.asarray((s <= 1.001 * half) & (np.abs(n - thickness / 2) <= ON_PROFILE * thickness))

    def __call__(self, points: FloatArray, growth: float) -> FloatArray:
        """Return the target edge length [m] at points of shape (n, 3); beyond the hinge's ends it grows on."""
        away = points - np.array(self.hinge.centre)
        axis, normal = profile.frame(self.hinge)
        s, n = away @ axis, np.abs(away @ normal)
        half = self.hinge.length / 2
        along = np.clip(s, -half, half)
        thickness = self.hinge.thicknesses(along)
        beyond = np.abs(s - along)
        off = np.abs(n - thickness / 2)  # from the profile
        outside = np.hypot(beyond, np.maximum(n - thickness / 2, 0.0))
        at_profile = np.minimum(self.surface * thickness, self._longest(along)) + growth * np.hypot(beyond, off)
        return np.asarray(np.minimum(at_profile, self.inside * thickness + growth * outside))

    def cloud(self, growth: float) -> FloatArray:
        """Return points on the profile and the axis of the hinge, about two edge lengths apart, shape (n, 3) [m]."""
        axis, normal = profile.frame(self.hinge)
        s = np.linspace(-self.hinge.length / 2, self.hinge.length / 2, 401)
        centre, half = np.array(self.hinge.centre), self.hinge.thicknesses(s) / 2
        lines = []
        for side in (-1.0, 0.0, 1.0):
            line = centre + s[:, None] * axis + (side * half)[:, None] * normal
            places = divide_line(s, 2 * self(line, growth))
            on_line = np.column_stack([np.interp(places, s, line[:, i]) for i in range(3)])
            for place, spacing in zip(on_line, 2 * self(on_line, growth), strict=True):
                depth = np.array([0.0, 0.0, self.hinge.width / 2])
                lines.append(_along(np.array([place - depth, place + depth]), spacing))
        return np.vstack(lines)


@dataclass(frozen=True)
class Span:
    """The longest edge [m] within a slender straight member, between its two ends."""

    member: Member
    longest: float

    @property
    def key(self) -> tuple[object, ...]:
        """What the field depends on, for the cache."""
        return (self.member.start, self.member.end, self.member.thickness, self.longest)

    def __call__(self, points: FloatArray, growth: float) -> FloatArray:
        """Return the target edge length [m] at points of shape (n, 3); outside the member it grows on."""
        away = points - np.array(self.member.centre)
        axis, normal = profile.frame(self.member)
        beyond = np.maximum(np.abs(away @ axis) - self.member.length / 2, 0.0)
        beside = np.maximum(np.abs(away @ normal) - self.member.thickness / 2, 0.0)
        return np.asarray(self.longest + growth * np.hypot(beyond, beside))

    def cloud(self) -> FloatArray:
        """Return points on the member's axis an edge apart, at half its width and at both its sides [m]."""
        line = _along(np.array([self.member.start, self.member.end]), self.longest)
        depth = np.array([0.0, 0.0, self.member.width / 2])
        return np.vstack([line - depth, line, line + depth])


@dataclass(frozen=True)
class Sizing:
    """The target edge length as a function of place.

    Parameters
    ----------
    roots
        Root edges, shape (n, 2, 3) [m].
    at_roots
        h_root of each, shape (n,) [m].
    growth, largest
        g [1] and h_max [m] of the module's formula.
    necks
        Of the curved hinges.
    spans
        Of the slender straight members.
    """

    roots: FloatArray
    at_roots: FloatArray
    growth: float
    largest: float
    necks: tuple[Neck, ...] = ()
    spans: tuple[Span, ...] = ()

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the target edge length [m] at points of shape (n, 3)."""
        size = np.full(len(points), self.largest)
        for root, at_root in zip(self.roots, self.at_roots, strict=True):
            np.minimum(size, at_root + self.growth * distance(points, root[None]), out=size)
        for neck in self.necks:
            np.minimum(size, neck(points, self.growth), out=size)
        for span in self.spans:
            np.minimum(size, span(points, self.growth), out=size)
        return size

    def on_profile(self, points: FloatArray) -> NDArray[np.bool_]:
        """Tell which points of shape (n, 3) lie on the profile of a curved hinge."""
        return np.any([np.zeros(len(points), dtype=bool), *(neck.on_profile(points) for neck in self.necks)], axis=0)

    @property
    def finest(self) -> float:
        """The smallest edge length asked for [m]."""
        return float(min([*self.at_roots, *(neck.finest for neck in self.necks)]))

    @property
    def key(self) -> tuple[object, ...]:
        """What the field depends on, for the cache."""
        pieces = [neck.key for neck in self.necks] + [span.key for span in self.spans]
        return (self.roots, self.at_roots, self.growth, self.largest, *pieces)

    def background(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, NDArray[np.int32], FloatArray]:
        """Return points (n, 3), tetrahedra (m, 4) and edge lengths (n,) of a mesh that covers the box low..high."""
        margin = 0.1 * (high - low).max()
        axes = [
            np.linspace(a - margin, b + margin, max(int((b - a) / self.largest), 4))
            for a, b in zip(low, high, strict=True)
        ]
        cloud = [_along(root, h) for root, h in zip(self.roots, self.at_roots, strict=True)]
        cloud += [neck.cloud(self.growth) for neck in self.necks] + [span.cloud() for span in self.spans]
        cloud.append(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3))
        for root, at_root in zip(self.roots, self.at_roots, strict=True):
            radius = at_root
            while radius < self.largest / self.growth:
                cloud.append(_shell(root, radius))
                radius *= 2.0
        points = _thin_out(np.vstack(cloud), self)
        rng = np.random.default_rng(0)
        points = points + 1e-3 * self.finest * rng.standard_normal(points.shape)  # cospherical points stall Delaunay
        tets = Delaunay(points).simplices.astype(np.int32)
        return points, tets, self(points)


def distance(points: FloatArray, roots: FloatArray) -> FloatArray:
    """Return the distance [m] of points of shape (n, 3) from the nearest root edge."""
    nearest = np.full(len(points), np.inf)
    for start, end in roots:
        axis = end - start
        s = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
        np.minimum(nearest, np.linalg.norm(points - start - s[:, None] * axis, axis=1), out=nearest)
    return nearest


def divide_line(places: FloatArray, wanted: FloatArray, pieces: int | None = None) -> FloatArray:
    """Cut a line into the fewest pieces, all shorter than wanted where they lie, and all by the same factor.

    Parameters
    ----------
    places
        Ascending coordinates at which the wanted length is known, shape (n,) [m].
    wanted
        That length, shape (n,) [m].
    pieces
        A number of pieces instead, longer or shorter than wanted by the same factor.

    Returns
    -------
    ndarray
        Where the pieces meet, both ends included [m].
    """
    count = count_pieces(places, wanted)
    pieces = pieces or max(1, int(np.ceil(count[-1] - 1e-6)))
    cuts = np.interp(np.linspace(0.0, count[-1], pieces + 1), count, places)
    cuts[[0, -1]] = places[[0, -1]]
    return np.asarray(cuts)


def count_pieces(places: FloatArray, wanted: FloatArray) -> FloatArray:
    """Return how many pieces as long as wanted fit before each place of a line: the integral of one over the length."""
    density = 1 / wanted
    return np.concatenate([[0.0], np.cumsum(np.diff(places) * (density[1:] + density[:-1]) / 2)])


def root_edges(members: Sequence[Member], domain: Domain) -> tuple[FloatArray, list[Member]]:
    """Return the edges at which members meet their neighbours, clipped to the domain, and whose edges they are.

    A leaf has roots at both ends, rounded or not; an arm or rod only where the solid has an edge; a curved hinge none.

    Parameters
    ----------
    members
        Members of the whole part.
    domain
        What is meshed.

    Returns
    -------
    edges, owners
        Shape (n, 2, 3) [m], and the member of each.
    """
    corners = np.vstack([face.points for face in domain.faces])
    low, high = corners.min(axis=0), corners.max(axis=0)
    edges, owners = [], []
    for member in members:
        if profile.is_curved(member):
            continue
        for edge in _roots(member):
            clipped = np.clip(edge, low, high)
            if np.abs(edge - clipped)[:, :2].max() > 1e-9 or clipped[1, 2] - clipped[0, 2] < 1e-9:
                continue
            if member.kind == "hinge" or np.linalg.norm(corners - clipped[1], axis=1).min() < 1e-9:
                edges.append(clipped)
                owners.append(member)
    return np.array(edges).reshape(-1, 2, 3), owners


def _roots(member: Member) -> list[FloatArray]:
    axis = np.array(member.axis)
    across = np.cross([0.0, 0.0, 1.0], axis) * member.thickness / 2
    depth = np.array([0.0, 0.0, member.width / 2])
    ends = [np.array(member.start), np.array(member.end)]
    if member.root_radius > 0:  # where the fillet runs out into the leaf is as delicate as the root itself
        ends += [ends[0] + member.root_radius * axis, ends[1] - member.root_radius * axis]
    return [np.array([end + side * across - depth, end + side * across + depth]) for end in ends for side in (1, -1)]


def _along(root: FloatArray, spacing: float) -> FloatArray:
    count = max(int(np.linalg.norm(root[1] - root[0]) / spacing), 1) + 1
    return root[0] + np.linspace(0.0, 1.0, count)[:, None] * (root[1] - root[0])


def _shell(root: FloatArray, radius: float, around: int = 8) -> FloatArray:
    axis = (root[1] - root[0]) / np.linalg.norm(root[1] - root[0])
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    second = np.cross(axis, first)
    angles = 2 * np.pi * np.arange(around) / around
    ring = radius * (np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second)
    line = _along(root, radius)
    return (line[:, None, :] + ring[None, :, :]).reshape(-1, 3)


def _thin_out(points: FloatArray, sizing: Sizing) -> FloatArray:
    """Keep one point in each cell of a lattice half as wide as the edge length wanted there, in powers of two."""
    level = np.round(np.log2(sizing(points) / sizing.finest))
    cell = np.floor(points / (0.5 * sizing.finest * 2.0**level)[:, None])
    _, first = np.unique(np.column_stack([level, cell]), axis=0, return_index=True)
    return points[np.sort(first)]


def spans_in(members: Sequence[Member], domain: Domain, growth: float, coarseness: float) -> tuple[Span, ...]:
    """Return the straight hinges and rods in a domain along which edges would grow too long midway between the roots.

    Both `growth`, that of the finest mesh, and the longest edge are larger by `coarseness` on a coarser one.
    """
    straight = [m for m in members if m.kind in ("hinge", "rod") and not profile.is_curved(m) and domain.keeps(m)]
    spans = [Span(m, max(LONGEST_ALONG * m.length, LEAST_ALONG * m.thickness)) for m in straight]
    return tuple(
        Span(span.member, coarseness * span.longest) for span in spans if growth * span.member.length / 2 > span.longest
    )


def necks_in(members: Sequence[Member], domain: Domain) -> list[Member]:
    """Return the curved hinges that lie in a domain."""
    return [m for m in members if m.kind == "hinge" and profile.is_curved(m) and domain.keeps(m)]


def neck_edges(members: Sequence[Member], domain: Domain) -> FloatArray:
    """Return the edges along the width where curved hinges are thinnest, two of each, shape (n, 2, 3) [m]."""
    edges = []
    for hinge in necks_in(members, domain):
        _, normal = profile.frame(hinge)
        depth, centre = np.array([0.0, 0.0, hinge.width / 2]), np.array(hinge.centre)
        for side in (-hinge.thickness / 2, hinge.thickness / 2):
            place = centre + side * normal
            edges.append([place - depth, place + depth])
    return np.array(edges).reshape(-1, 2, 3)


def edge_length_at_roots(points: FloatArray, tets: NDArray[np.int64], roots: FloatArray, reach: float) -> float:
    """Return the mean length [m] of the mesh edges within `reach` [m] of the roots.

    The mesher follows a sizing field loosely; how fine a mesh really is where it counts has to be measured on it.
    """
    pairs = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
    edges = np.unique(np.sort(tets[:, pairs].reshape(-1, 2), axis=1), axis=0)
    near = distance(points[edges].mean(axis=1), roots) <= reach
    ends = points[edges[near]]
    return float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean())

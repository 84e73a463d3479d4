"""Meshes of a solid that nobody described: elements as small as the solid is thin, where it is thin.

The target edge length grows from every place x_i on the surface, with the thickness t_i there, and from the re-entrant
edges next to thin regions,

    h(x) = min(h_max, min over i of a_i t_i + g |x - x_i|).

Between planes a leaf bends as a plate, and its elements may be nearly as long as it is thick; at its re-entrant edges,
and where one side is curved, so that the thickness has a minimum, they are finer.

Coarser meshes are made by a factor c on all lengths; edges at curved necks change by its cube root, so that the
coarsest has elements enough across them. What quadratic elements leave open there falls with the edge length to the
power 4, hence with c^(4/3): measured by c, it lies within the bracket of orders (`convergence`) as all else does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, cKDTree

from flexdesign.core.model import Member
from flexdesign.design.mirror import mirrored
from flexdesign.fem import convergence
from flexdesign.fem.convergence import MeshNoise
from flexdesign.fem.meshing import conforming, methods, resolution_gate
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh, signed_volumes, tetrahedralize
from flexdesign.fem.meshing.resolution_gate import HingeCheck
from flexdesign.fem.meshing.surface import Rays
from flexdesign.fem.meshing.thin_regions import OPPOSITE, ThinRegions

FloatArray = NDArray[np.float64]

#: Edges in local thicknesses on the finest mesh, for `at_root` = 0.3: at re-entrant edges, at curved necks, between
#: planes; and the largest chord error at curved necks in thicknesses of the neck: the gate lets the coarsest of three
#: pass. Netgen's edges at necks are 1.5 times as long as asked; with 0.27 there are two elements across.
AT_ROOT = 0.3
SHARES = {"root": 0.22, "neck": 0.22, "plate": 0.55, "stout": 0.1}
CHORD = 1e-3
#: Smallest fillets that meshes resolve, in thicknesses, and edges across them, in radii. Elements along the edge are as
#: short as across it, hence up to twice as many as at a sharp edge. Of smaller fillets one edge may reach from end to
#: end: a chamfer in place of a fillet of 0.1 thicknesses stiffens a leaf 40 thicknesses long by less than 0.2 %.
#: On coarse meshes edges across fillets are no longer, as chords thicken the leaf.
LEAST_FILLET, ACROSS_FILLET = 0.15, 2 / 3
#: Edges at curved necks change with the coarseness to this power.
NECK_POWER = 1 / 3
#: Growth of the edge length per distance, and the largest edge in diagonals of the solid.
GROWTH, LARGEST = 0.45, 0.08
#: Largest relative deviation of a hinge's thickness: place by place, and of the whole hinge in bending.
PLACE_LIMIT, BENDING_LIMIT = 1e-2, resolution_gate.CURVED_LIMIT
#: Places at which a hinge is measured on a mesh, and elements across it at least.
MEASURED, LEAST_ACROSS = 400, 2.0
#: So often the mesher improves its mesh; later passes split and join the same elements in turn.
PASSES = 25


@dataclass(frozen=True)
class ThicknessField:
    """The target edge length, as the mesher asks for it.

    Parameters
    ----------
    places, sizes
        Where it is known, shape (n, 3) [m], and the edge length there, shape (n,) [m].
    growth, largest
        g [1] and h_max [m] of the module's formula.
    """

    places: FloatArray
    sizes: FloatArray
    growth: float
    largest: float

    @cached_property
    def _octaves(self) -> list[tuple[cKDTree, FloatArray]]:
        """Places sorted by edge length in thirds of octaves: within one the nearest place decides."""
        level = np.round(3 * np.log2(self.sizes / self.sizes.min()))
        return [(cKDTree(self.places[level == one]), self.sizes[level == one]) for one in np.unique(level)]

    def __call__(self, points: FloatArray) -> FloatArray:
        """Return the target edge length [m] at points of shape (n, 3)."""
        size = np.full(len(points), self.largest)
        for tree, sizes in self._octaves:
            reach = max((self.largest - sizes.min()) / self.growth, 0.0) + 1e-12
            away, nearest = tree.query(points, distance_upper_bound=reach)
            near = np.isfinite(away)
            size[near] = np.minimum(size[near], sizes[nearest[near]] + self.growth * away[near])
        return size

    @property
    def finest(self) -> float:
        """The smallest edge length asked for [m]."""
        return float(self.sizes.min())

    @property
    def key(self) -> tuple[object, ...]:
        """What the field depends on, for the cache."""
        return (self.places, self.sizes, self.growth, self.largest)

    def background(self, low: FloatArray, high: FloatArray) -> tuple[FloatArray, NDArray[np.int32], FloatArray]:
        """Return points (n, 3), tetrahedra (m, 4) and edge lengths (n,) of a mesh that covers the box low..high."""
        margin = 0.1 * (high - low).max()
        axes = [
            np.linspace(a - margin, b + margin, max(int((b - a) / self.largest), 4))
            for a, b in zip(low, high, strict=True)
        ]
        lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        cloud, rng = [lattice, self.places], np.random.default_rng(0)
        radius = self.finest
        around = self.places
        while radius < self.largest / self.growth:  # shells about the places, ever wider and sparser
            around = _sparse(around, radius)
            ways = rng.standard_normal((len(around), 6, 3))
            ways /= np.linalg.norm(ways, axis=2, keepdims=True)
            cloud.append((around[:, None, :] + radius * ways).reshape(-1, 3))
            radius *= 2.0
        points = np.vstack(cloud)
        points = points[np.all((points >= low - margin) & (points <= high + margin), axis=1)]
        points = self._thin_out(points)
        points = points + 1e-3 * self.finest * rng.standard_normal(points.shape)  # cospherical points stall Delaunay
        corners = np.array(np.meshgrid(*zip(low - margin, high + margin, strict=True))).reshape(3, -1).T
        points = np.vstack([points, corners])
        tets = Delaunay(points).simplices.astype(np.int32)
        return points, tets, self(points)

    def _thin_out(self, points: FloatArray) -> FloatArray:
        """Keep one point in each cell of a lattice about as wide as the edge length there, in powers of two."""
        level = np.round(np.log2(self(points) / self.finest))
        cell = np.floor(points / (self.finest * 2.0**level)[:, None])
        _, first = np.unique(np.column_stack([level, cell]), axis=0, return_index=True)
        return np.asarray(points[np.sort(first)])


def _sparse(points: FloatArray, spacing: float) -> FloatArray:
    _, first = np.unique(np.floor(points / spacing), axis=0, return_index=True)
    return np.asarray(points[np.sort(first)])


@dataclass(frozen=True)
class LocalThickness:
    """Isotropic tetrahedra graded by the solid's own thickness.

    Parameters
    ----------
    domain
        What is meshed; it knows where it is thin.
    at_root, growth, largest
        As for other methods; `at_root` scales all edges, in thicknesses.
    envelope
        How far the unstructured mesher may move the surface, in thicknesses of the thinnest place.
    conforming
        Whether Netgen meshes the solid's own faces, or the unstructured mesher.
    """

    domain: Domain
    at_root: float
    growth: float
    largest: float | None
    envelope: float
    conforming: bool = True

    name: ClassVar[str] = "wild"
    head_start: ClassVar[int] = 0

    @property
    def scatter(self) -> MeshNoise:
        """Of results over meshes made alike; few elements across a curved neck do not shrink evenly."""
        share = methods.SCATTER.share if self._curved.any() else 0.0
        return replace(convergence.MESH_NOISE, share=share)

    @property
    def mesher(self) -> str:
        """The program that makes the mesh."""
        return "Netgen" if self.conforming else "pytetwild"

    @property
    def tries(self) -> int:
        """How often a mesh that cannot be used is made again: Netgen would make the same."""
        return 1 if self.conforming else 2

    @property
    def instead(self) -> LocalThickness:
        """What to mesh with where Netgen makes no mesh."""
        return replace(self, conforming=False)

    @property
    def thin(self) -> ThinRegions:
        """Where the domain is thin."""
        if self.domain.thin is None:
            raise MeshError("nobody looked where the solid is thin")
        return self.domain.thin

    def question(self, coarseness: float) -> tuple[object, ...]:
        """Return what the mesh depends on besides the domain, for the cache."""
        return (self.name, self.conforming, *self.sizing(coarseness).key, self._envelope)

    def mesh(self, coarseness: float) -> TaggedMesh:
        """Return the mesh, 1 being the finest; raise MeshError, `NoMesh` for Netgen, if there is none to be had."""
        sizing = self.sizing(coarseness)
        if self.conforming:
            return conforming.tetrahedralize(self.domain, sizing, coarseness)
        return tetrahedralize(self.domain, sizing, self._envelope, PASSES)

    def require_room(self, coarseness: float) -> None:
        """Let every mesh pass: how many tetrahedra the thin regions need is known only when they are meshed."""

    def finest_edge(self, coarseness: float) -> float:
        """Return the shortest edge length asked for [m]."""
        return self.sizing(coarseness).finest

    def size(self, mesh: TaggedMesh, coarseness: float) -> float:
        """Return the edge length by which results are extrapolated [m].

        Without hinges the representative cell size, the cube root of the volume over the number of elements (Celik et
        al. 2008, J. Fluids Eng. 130, 078001): fillets, whose edges change less than others, and where most edges are,
        do not hide how much the mesh changes. Else the mean edge length near the thinnest places, as the mesher follows
        what is asked loosely; of curved necks that of the finest mesh times the coarseness.
        """
        if not self.thin.hinges:
            return float(np.cbrt(mesh.volume / len(mesh.tets)))
        if self._curved.any():
            return self.finest_edge(1.0) * coarseness
        middles = self._thinnest_middles()
        pairs = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])
        edges = np.unique(np.sort(mesh.tets[:, pairs].reshape(-1, 2), axis=1), axis=0)
        ends = mesh.points[edges]
        away, _ = cKDTree(middles).query(ends.mean(axis=1), distance_upper_bound=self.thin.thinnest)
        near = ends[np.isfinite(away)]
        return float(np.linalg.norm(near[:, 0] - near[:, 1], axis=1).mean())

    def sizing(self, coarseness: float) -> ThicknessField:
        """Return the target edge length."""
        thin, factor = self.thin, self.at_root / AT_ROOT * coarseness
        largest = (self.largest or LARGEST * self._diagonal) * coarseness
        chord = np.sqrt(8 * thin.curved * CHORD / self._neck_thickness)
        at_necks = np.minimum(SHARES["neck"] * self.at_root / AT_ROOT, chord) * coarseness**NECK_POWER
        shares = np.where(self._curved, at_necks, SHARES["plate"] * factor)
        sizes = shares * thin.thickness
        inner = thin.points + thin.inward * thin.thickness[:, None] / 2
        places = np.vstack([thin.points, inner, thin.roots.places, thin.held.places])
        at_edges = thin.roots.sizes(SHARES["root"] * factor, LEAST_FILLET, ACROSS_FILLET * self.at_root / AT_ROOT)
        at_edges = np.minimum(at_edges, self._at_stout_edges(thin.roots.thickness) * factor)
        wanted = np.concatenate([sizes, sizes, at_edges, self._at_stout_edges(thin.held.thickness) * factor])
        fine = wanted < largest
        if not fine.any():
            fine[np.argmin(wanted)] = True
        thinned = thin_out(places[fine], np.minimum(wanted[fine], largest))
        return ThicknessField(
            places[fine][thinned], np.minimum(wanted[fine], largest)[thinned], self.growth * coarseness, largest
        )

    def _at_stout_edges(self, thickness: FloatArray) -> FloatArray:
        """Return the edge length at singular edges next to a thickness (n,) [m]: no shorter than at a hinge's."""
        least = min((hinge.thickness for hinge in self.thin.hinges), default=0.0)
        return np.maximum(SHARES["stout"] * thickness, SHARES["root"] * least)

    def check(self, mesh: TaggedMesh) -> list[HingeCheck]:
        """Measure every hinge that was found, on the mesh, by the rays that found it.

        Raises
        ------
        MeshError
            If one is missing, or not resolved; `require` judges how far they are off.
        """
        thin, rays = self.thin, self._rays(mesh)
        kept = [each for each in zip(thin.hinges, thin.chosen, strict=True) if self._keeps(each[0])]
        checks = [self._measure(mesh, rays, *each) for each in kept]
        for found in checks:
            name, thickness = found.hinge.name, found.hinge.thickness * 1e3
            if np.isnan(found.deviation):
                raise MeshError(f"{name} is missing in the mesh; reduce mesh.envelope")
            if found.across < LEAST_ACROSS:
                raise MeshError(
                    f"{name} of {thickness:.3g} mm has {found.across_text} elements across its curved neck, "
                    f"{LEAST_ACROSS:g} at least are needed; reduce mesh.at_root"
                )
        return checks

    def _keeps(self, hinge: Member) -> bool:
        """Tell whether a hinge lies in the domain, at least in part: centres are found on places that lie at random."""
        return all(hinge.centre[plane.index] > -hinge.thickness / 2 for plane in self.domain.planes)

    def _rays(self, mesh: TaggedMesh) -> Rays:
        """Return rays through the surface of the whole: what symmetry planes cut is mirrored in them."""
        cut = [face for faces in self.domain.plane_faces for face in faces]
        points, facets = mesh.points, mesh.facets[~np.isin(mesh.faces, cut)]
        for plane in self.domain.planes:
            facets = np.concatenate([facets, facets + len(points)])
            points = np.concatenate([points, mirrored(points, plane.index)])
        return Rays(points, facets)

    def _measure(self, mesh: TaggedMesh, rays: Rays, hinge: Member, chosen: NDArray[np.int64]) -> HingeCheck:
        thin = self.thin
        some = chosen[:: max(len(chosen) // MEASURED, 1)]
        thickness, inward = thin.thickness[some], thin.inward[some]
        middle = thin.points[some] + inward * thickness[:, None] / 2
        seen, facing = rays.thickness(middle, inward)
        seen = np.where(seen < 2 * thickness, seen, np.nan)
        across = np.isnan(seen) | (facing > OPPOSITE)  # next to a rim rays leave through its chords
        if across.mean() > 0.5:
            thickness, seen = thickness[across], seen[across]
        if np.isnan(seen).mean() < 0.02:  # a ray through an edge of the mesh
            thickness, seen = thickness[~np.isnan(seen)], seen[~np.isnan(seen)]
        off = np.abs(seen / thickness - 1)
        neck = bool(np.isfinite(thin.curved[some]).mean() > 0.5)
        return HingeCheck(
            hinge=hinge,
            deviation=float(np.quantile(off, 0.98)) if not np.isnan(off).any() else float("nan"),
            bending=float((np.mean(seen**-3.0) / np.mean(thickness**-3.0)) ** (-1 / 3) - 1),
            limit=PLACE_LIMIT,
            across=self._across(mesh, hinge, middle, inward) if neck else float("inf"),
        )

    def _across(self, mesh: TaggedMesh, hinge: Member, middles: FloatArray, inward: FloatArray) -> float:
        """Return how many elements lie across a hinge where it is thinnest."""
        corners = mesh.points[mesh.tets]
        away, nearest = cKDTree(middles).query(corners.mean(axis=1), distance_upper_bound=0.75 * hinge.thickness)
        near = np.isfinite(away)
        if not near.any():
            return 0.0
        along = np.einsum("eki,ei->ek", corners[near], inward[nearest[near]])
        volume = np.abs(signed_volumes(mesh.points, mesh.tets[near]))
        return float(hinge.thickness * volume.sum() / (volume @ np.ptp(along, axis=1)))

    def _thinnest_middles(self) -> FloatArray:
        thin = self.thin
        least = thin.thickness < 1.3 * thin.thinnest
        return np.asarray(thin.points[least] + thin.inward[least] * thin.thickness[least, None] / 2)

    @property
    def _curved(self) -> NDArray[np.bool_]:
        """Which places lie at a neck: next to or across a cylinder that is no fillet, shape (n,).

        Without hinges there are no necks: at bores of a bracket nothing bends more than elsewhere.
        """
        at_cylinders = np.isfinite(self.thin.curved) & (self.thin.curved > self.thin.thickness / 2)
        return at_cylinders & bool(self.thin.hinges)

    @property
    def has_necks(self) -> bool:
        """Whether there are curved necks, across which the coarsest mesh has just elements enough."""
        return bool(self._curved.any())

    @property
    def _neck_thickness(self) -> FloatArray:
        """Thickness of the hinge that is nearest to each place, or of the place itself if that is less, (n,) [m]."""
        thin = self.thin
        if not thin.hinges:
            return thin.thickness
        sizes = np.concatenate([np.full(len(on), h.thickness) for h, on in zip(thin.hinges, thin.chosen, strict=True)])
        _, nearest = cKDTree(thin.points[np.concatenate(thin.chosen)]).query(thin.points)
        return np.asarray(np.minimum(sizes[nearest], thin.thickness))

    @property
    def _diagonal(self) -> float:
        return float(np.linalg.norm(np.ptp(np.vstack([face.points for face in self.domain.faces]), axis=0)))

    @property
    def _envelope(self) -> float:
        return self.envelope * self.thin.thinnest


def require(checks: Sequence[HingeCheck]) -> None:
    """Refuse a mesh whose hinges are off their thickness by more than what they hold of the strain energy allows.

    Thin regions of an ordinary part may hold next to none, and are no hinges then: deviations times shares add up to
    no more than what is allowed of a hinge that a part names. Of a region that holds a tenth or more that is no less
    strict than `PLACE_LIMIT`.

    Raises
    ------
    MeshError
        About the hinge that matters most.
    """
    off = [check for check in checks if not check.passed]
    if sum(check.weighed for check in off) > resolution_gate.FLAT_LIMIT:
        found = max(off, key=lambda check: check.weighed)
        most = max(found.deviation, abs(found.bending))
        held = f", and holds up to {100 * found.share:.2g} % of the strain energy" if found.share < 1 else ""
        raise MeshError(
            f"{found.hinge.name} is off its {found.hinge.thickness * 1e3:.3g} mm by {100 * most:.2g} % (limit "
            f"{100 * found.limit:g} % at a place, {100 * BENDING_LIMIT:g} % in bending){held}; reduce mesh.at_root or "
            "mesh.envelope"
        )


def thin_out(places: FloatArray, sizes: FloatArray) -> NDArray[np.int64]:
    """Return the indices of places such that cells as wide as a third of the edge length have one each: the finest."""
    order = np.argsort(sizes)
    level = np.round(np.log2(sizes[order] / sizes[order[0]]))
    cell = np.floor(places[order] / (sizes[order[0]] * 2.0**level / 3)[:, None])
    _, first = np.unique(np.column_stack([level, cell]), axis=0, return_index=True)
    return np.asarray(np.sort(order[first]))

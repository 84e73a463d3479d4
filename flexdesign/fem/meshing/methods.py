"""The ways to mesh a domain, each with its grading and its law of refinement.

``wild``, isotropic tetrahedra by fTetWild, does for every solid. ``extruded``, layers of prisms cut into tetrahedra,
needs an extrusion and is many times faster at the same accuracy, as elements shrink across the roots alone.

Coarser meshes are made by a factor c on all lengths and on the growth; edges at the roots of extruded meshes change by
its square, which costs little. What the roots leave open falls with the edge length there to the power 1.09
(`convergence`), hence with c^2.18 instead of c^1.09; the smooth rest falls with c^4 at most, hence with the edge
length at the roots squared: measured by that length, both methods have the same bracket of orders.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Member
from flexdesign.fem import convergence
from flexdesign.fem.convergence import MeshNoise
from flexdesign.fem.meshing import element_count, profile, sizing
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.extruded import Layers, planar_size, stack_prisms, triangulate_section
from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh, tetrahedralize
from flexdesign.fem.meshing.planar import Size, Triangulation
from flexdesign.fem.meshing.section import Section
from flexdesign.fem.meshing.sizing import Neck, Sizing, distance, edge_length_at_roots, neck_edges, necks_in, root_edges

FloatArray = NDArray[np.float64]

#: Default edge length at the roots, in hinge thicknesses, and growth.
UNSTRUCTURED_GRADING = (0.3, 0.45)
EXTRUDED_GRADING = (0.05, 0.6)
#: How much longer edges may be at rounded roots than the singularity of sharp ones would allow, for extruded meshes.
ROUNDED = 6.0
#: Edges of unstructured meshes at fillets, in radii, at most: with 0.8 and 0.6 hinges were off in bending by 0.6 and
#: 0.5 %.
LONGEST_ARC = 0.4
#: Layers that a free end's side of an extruded domain has at least on the finest mesh, before they are made whole: as
#: meshes get coarser 2.6 and 1.9, hence 4, 3 and 2. With fewer, meshes in turn would have equally many layers, whose
#: error, 0.2 % of K_in with two, no extrapolation sees.
LEAST_LAYERS = 3.5
#: The same of parts with curved necks, which no sharp root's error hides that of the layers of. The finest mesh has a
#: whole number of them, whose share the coarser ones round to the nearest: 5, 4, 3 and 2, and no two alike from there
#: on, so that the error of the layers falls as that of the triangles.
LEAST_LAYERS_OF_NECKS = 5.0
#: Largest edge on the finest mesh, in thicknesses of the thinnest arm or rod. Next to necks, arms are as high as
#: notches are deep, and have a larger part of what meshes leave open.
BESIDE_LEAVES, BESIDE_NECKS = 0.4, 0.18
#: Thickest layer of parts with necks, in their largest edges: with 2, wide parts had twice the unknowns, which changed
#: K_in by 0.06 % where the mesh left 1 % open.
STOUT_LAYERS = 4
#: Edges at curved necks: on the profile and inside, in local thicknesses, and the chord error at the neck, in neck
#: thicknesses, of the finest mesh. As meshes get coarser, extruded ones shrink those on the profile as at sharp roots.
#: Chords of extruded meshes enclose the area of the profile, so that they err little: of three meshes the coarsest is
#: within the gate's 0.5 % line by line, and has three elements across the neck or more.
EXTRUDED_NECK = (0.15, 0.12, 8e-4)
UNSTRUCTURED_NECK = (0.18, 0.18, 3.5e-4)
#: Edges at sharp roots of parts with curved necks, as a share of those of parts without: a few triangles more, 2 to 6 %
#: of the unknowns, halve what the coarse meshes of some bridges leave open (2.0 % of K_in to 1.1 %).
ROOTS_WITH_NECKS = 0.25
#: Chord error at curved necks, in neck thicknesses, at most: profiles keep their area, so that two sides are off by two
#: thirds of it each, together by 0.4 %, and the gate allows 0.5 %.
LARGEST_NECK_CHORD = 3e-3
#: Most tetrahedra of an unstructured mesh, as estimated. Half a million have 2.3 million unknowns (4.5 each), whose
#: factor takes 22 GiB, all that a machine of 24 GiB has: 2.6 GiB were measured for 430 000 unknowns of the bridge
#: amplifier, and memory grows with their number to the power 1.28.
MOST = 500_000
#: Most of a STEP part for which no edge length is asked: by the same law 9 GiB, which an ordinary machine has. Large
#: parts that are thin all over, such as bent sheets, would have more.
MOST_BY_DEFAULT = MOST / 2
#: Scatter of results of extruded meshes: of K_in over gradings that differ by up to 3 %, found as 1e-4 on fine and 1e-3
#: on coarse meshes of few layers; all layers repeat the same triangles about a root. The share is measured
#: (`studies.error_bars`); that of curved necks is larger, as three, four and five elements across a neck do not shrink
#: as evenly as the many about a root.
SCATTER, SCATTER_OF_NECKS = MeshNoise(2e-4, 0.25), MeshNoise(2e-4, 0.6)
#: Chord error of extruded meshes at curved faces, in hinge thicknesses: on the finest mesh, and at most.
CHORD, LARGEST_CHORD = 1e-3, 1e-2


class Method(Protocol):
    """A way to mesh."""

    name: ClassVar[str]

    @property
    def scatter(self) -> MeshNoise:
        """Of results over meshes made alike."""

    @property
    def head_start(self) -> int:
        """With how many coarser meshes than it asks for a study begins that asks for an accuracy."""

    @property
    def mesher(self) -> str:
        """What makes the mesh, in words."""

    @property
    def tries(self) -> int:
        """How often a mesh that cannot be used is made again: more than once where no two are alike."""

    def question(self, coarseness: float) -> tuple[object, ...]:
        """Return what the mesh depends on besides the domain, for the cache."""

    def mesh(self, coarseness: float) -> TaggedMesh:
        """Return the mesh, 1 being the finest; raise MeshError if there is none to be had."""

    def require_room(self, coarseness: float) -> None:
        """Raise MeshError if the mesh would be too large for any use; known at once, before it is made."""

    def finest_edge(self, coarseness: float) -> float:
        """Return the shortest edge length asked for [m]."""

    def size(self, mesh: TaggedMesh, coarseness: float) -> float:
        """Return the edge length at the hinge roots [m] by which results are extrapolated."""


@dataclass(frozen=True)
class Grading:
    """Input of both methods.

    Parameters
    ----------
    domain
        What is meshed.
    members
        Members of the whole part.
    at_root
        Edge length at the hinge roots on the finest mesh, in hinge thicknesses.
    growth
        Increase of the edge length per distance from there.
    largest
        Largest edge length [m]; None for the default.
    """

    domain: Domain
    members: Sequence[Member]
    at_root: float
    growth: float
    largest: float | None

    @property
    def hinges(self) -> list[Member]:
        """The hinges."""
        return [member for member in self.members if member.kind == "hinge"]

    @property
    def has_necks(self) -> bool:
        """Whether there are curved hinges."""
        return any(map(profile.is_curved, self.hinges))

    @property
    def thinnest(self) -> float:
        """Thickness of the thinnest hinge [m]."""
        return min(hinge.thickness for hinge in self.hinges)

    @property
    def coarsest(self) -> float:
        """Largest edge length on the finest mesh [m]: arms and rods bend and stretch too, and want elements' due."""
        slender = [m.thickness for m in self.members if m.kind in ("arm", "rod", "guide")]
        share = BESIDE_NECKS if self.has_necks else BESIDE_LEAVES
        return self.largest or share * min(slender or [hinge.length for hinge in self.hinges])

    def sizing(
        self,
        at_roots: float,
        elsewhere: float,
        neck: tuple[float, float, float],
        rounded: float = 1.0,
        arc: float = math.inf,
        *,
        keeps_area: bool = False,
    ) -> Sizing:
        """Return the sizing field, coarsened by factors at the roots, elsewhere, and at rounded roots besides.

        At rounded roots no edge is asked to be longer than `arc` radii. `neck` has the edges and the chord error of
        curved necks on the finest mesh; `keeps_area` tells whether chords keep the area of a profile (`Neck`).
        """
        edges, owners = root_edges([m for m in self.members if m.kind in ("hinge", "rod")], self.domain)
        lengths = [_resolved_length(owner) * (rounded if owner.root_radius > 0 else 1.0) for owner in owners]
        longest = [arc * owner.root_radius if owner.root_radius > 0 else math.inf for owner in owners]
        surface, inside, chord = neck
        necks = tuple(
            Neck(
                hinge,
                surface * at_roots,
                inside * elsewhere,
                min(chord * elsewhere**2, LARGEST_NECK_CHORD) * hinge.thickness,
                keeps_area,
            )
            for hinge in necks_in(self.members, self.domain)
        )
        return Sizing(
            roots=edges,
            at_roots=np.minimum(self.at_root * at_roots * np.array(lengths), longest),
            growth=self.growth * elsewhere,
            largest=self.coarsest * elsewhere,
            necks=necks,
            spans=sizing.spans_in(self.members, self.domain, self.growth, elsewhere),
        )


@dataclass(frozen=True)
class Unstructured:
    """Isotropic tetrahedra of any solid; `envelope` hinge thicknesses is how far the mesher may move the surface."""

    grading: Grading
    envelope: float

    name: ClassVar[str] = "wild"
    #: Along a root there are many elements, of which no two are alike: what they leave open is their mean.
    scatter: ClassVar[MeshNoise] = convergence.MESH_NOISE
    head_start: ClassVar[int] = 0
    mesher: ClassVar[str] = "pytetwild"
    #: Of coarse meshes of a whole amplifier one in sixteen was refused.
    tries: ClassVar[int] = 3

    def question(self, coarseness: float) -> tuple[object, ...]:
        """Return what the mesh depends on besides the domain, for the cache."""
        return (self.name, *self._sizing(coarseness).key, self._envelope)

    def mesh(self, coarseness: float) -> TaggedMesh:
        """Return the mesh, 1 being the finest; raise MeshError if there is none to be had."""
        return tetrahedralize(self.grading.domain, self._sizing(coarseness), self._envelope)

    def estimate(self, coarseness: float) -> float:
        """Return about how many tetrahedra the mesher is going to make."""
        return element_count.estimate(self.grading.domain, self._sizing(coarseness))

    def require_room(self, coarseness: float) -> None:
        """Raise MeshError if the mesher is going to make more than `MOST` tetrahedra."""
        count = self.estimate(coarseness)
        if count > MOST:
            extruded = 'mesh.method = "extruded", ' if self.grading.domain.section is not None else ""
            raise MeshError(
                f"the unstructured mesh would have about {count / 1e6:.2g} million tetrahedra, and "
                f"{MOST / 1e6:g} million are as many as 24 GiB of memory hold; ask for less: {extruded}a larger "
                "mesh.at_root or mesh.growth, or fewer mesh.levels"
            )

    def finest_edge(self, coarseness: float) -> float:
        """Return the shortest edge length asked for [m]."""
        return self._sizing(coarseness).finest

    def size(self, mesh: TaggedMesh, coarseness: float) -> float:
        """Return the mean edge length near the roots [m]: the mesher follows what is asked loosely."""
        hinges, domain = self.grading.hinges, self.grading.domain
        roots = np.concatenate([root_edges(hinges, domain)[0], neck_edges(hinges, domain)])
        return edge_length_at_roots(mesh.points, mesh.tets, roots, self.grading.thinnest / 2)

    def _sizing(self, coarseness: float) -> Sizing:
        return self.grading.sizing(coarseness, coarseness, self._neck, arc=LONGEST_ARC)

    @property
    def _neck(self) -> tuple[float, float, float]:
        return _scale_neck(UNSTRUCTURED_NECK, self.grading.at_root / UNSTRUCTURED_GRADING[0])

    @property
    def _envelope(self) -> float:
        return self.envelope * self.grading.thinnest


@dataclass(frozen=True)
class Extruded:
    """Layers of prisms cut into tetrahedra, of an extrusion."""

    grading: Grading

    name: ClassVar[str] = "extruded"
    mesher: ClassVar[str] = "extruded in layers"
    tries: ClassVar[int] = 1

    @property
    def scatter(self) -> MeshNoise:
        """Of results over meshes made alike."""
        return SCATTER_OF_NECKS if self.grading.has_necks else SCATTER

    @property
    def head_start(self) -> int:
        """One where necks are curved: without sharp roots in the hinges, coarser meshes give 1 %."""
        return int(self.grading.has_necks)

    def question(self, coarseness: float) -> tuple[object, ...]:
        """Return what the mesh depends on besides the domain, for the cache."""
        field, layers = self._sizing(coarseness), self._layers(coarseness)
        thick = (layers.at_ends, layers.growth, layers.largest)
        return (self.name, *field.key, *thick, self._chord(coarseness))

    def mesh(self, coarseness: float) -> TaggedMesh:
        """Return the mesh, 1 being the finest; raise MeshError if there is none to be had."""
        return stack_prisms(self.plan(coarseness), self.section, self.heights(coarseness))

    def require_room(self, coarseness: float) -> None:
        """Let every mesh pass: it is made in seconds, and the solver knows before it solves what memory that takes."""

    @property
    def section(self) -> Section:
        """The section; raise MeshError if the part is no extrusion."""
        section = self.grading.domain.section
        if section is None:
            raise MeshError("the part does not declare itself prismatic; take the method wild")
        return section

    def plan(self, coarseness: float) -> Triangulation:
        """Return the triangles that are drawn out, 1 being the finest; raise MeshError if there are none to be had."""
        return triangulate_section(self.section, self._sizing(coarseness), self._chord(coarseness))

    def planar_size(self, coarseness: float) -> Size:
        """Return the edge length wanted in the section."""
        return planar_size(self.section, self._sizing(coarseness))

    def heights(self, coarseness: float, count: int | None = None) -> FloatArray:
        """Return where layers meet [m]; a `count` sets their number, with the same grading."""
        section, layers = self.section, self._layers(coarseness)
        extent = section.low, section.high, self._free_ends(section)
        if count is None and self.grading.has_necks:
            finest = round(self._layers(1.0).count(*extent))
            count = max(1, round(finest / coarseness))
        return layers.heights(*extent, count)

    def finest_edge(self, coarseness: float) -> float:
        """Return the shortest edge length asked for [m]."""
        return self._sizing(coarseness).finest

    def size(self, mesh: TaggedMesh, coarseness: float) -> float:
        """Return the edge length asked for at the roots [m], as the triangulation keeps to it.

        Chords limit edges at curved necks, too, which then change by less: what counts is the rule for all others.
        """
        return self.finest_edge(1.0) * coarseness**2

    def _sizing(self, coarseness: float) -> Sizing:
        neck = _scale_neck(EXTRUDED_NECK, self.grading.at_root / EXTRUDED_GRADING[0])
        grading = self.grading
        if grading.has_necks:
            grading = replace(grading, at_root=grading.at_root * ROOTS_WITH_NECKS)
        field = grading.sizing(coarseness**2, coarseness, neck, ROUNDED, keeps_area=True)
        section = self.grading.domain.section
        if section is None:
            return field
        corners = section.reentrant_corners()
        ends = [section.lifted(corners, height) for height in (section.low, section.high)]
        known = distance(ends[0], field.roots) < 1e-9
        others = np.stack(ends, axis=1)[~known]  # stout, as those of arms and rods
        return replace(
            field,
            roots=np.concatenate([field.roots, others]),
            at_roots=np.append(
                field.at_roots, np.full(len(others), grading.at_root * coarseness**2 * grading.coarsest)
            ),
        )

    def _layers(self, coarseness: float) -> Layers:
        grading, section = self.grading, self.grading.domain.section
        finest = Layers(
            at_ends=grading.thinnest,
            growth=grading.growth,
            largest=(STOUT_LAYERS if grading.has_necks else 2) * grading.coarsest,  # nothing is slender along the width
        )
        if section is not None:
            depth = (section.high - section.low) / max(sum(self._free_ends(section)), 1)
            least = LEAST_LAYERS_OF_NECKS if grading.has_necks else LEAST_LAYERS
            coarseness *= min(1.0, _count(finest, depth) / least)
        return Layers(coarseness * finest.at_ends, coarseness * finest.growth, coarseness * finest.largest)

    def _free_ends(self, section: Section) -> tuple[bool, bool]:
        mirrors = {face for faces in self.grading.domain.plane_faces for face in faces}
        low, high = (end not in mirrors for end in section.ends)
        return low, high

    def _chord(self, coarseness: float) -> float:
        return min(CHORD * coarseness**2, LARGEST_CHORD) * self.grading.thinnest


def _count(layers: Layers, depth: float) -> float:
    """Return how many layers there are to a depth [m] from a free end, were they not made whole."""
    graded = min(depth, max(layers.largest - layers.at_ends, 0.0) / layers.growth)
    return float(np.log1p(layers.growth * graded / layers.at_ends) / layers.growth + (depth - graded) / layers.largest)


def _scale_neck(neck: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    """Return edges at curved necks for another `mesh.at_root`: a chord goes with the square of its length."""
    surface, inside, chord = neck
    return surface * factor, inside * min(factor, 1.0), chord * factor**2


def _resolved_length(member: Member) -> float:
    """Return the length that `at_root` counts in: a hinge's thickness, or less where fillets must be resolved.

    Arms and rods, stout and few, are resolved twice as finely for little cost, so that the hinges' error is left.
    """
    if member.kind != "hinge":
        return member.thickness / 2
    return min(0.6 * member.thickness, 1.5 * member.root_radius) if member.root_radius > 0 else member.thickness

"""Layers of prisms of a solid that nobody described and that is an extrusion: graded by its own thickness.

The section is meshed as sections of parts with declared hinges are, with the same edge lengths and the same law of
refinement (`methods`): finest at re-entrant corners and on the profiles of curved necks. Where these are is found on
the solid (`thin_regions`), and so is whether the mesh keeps to it (`LocalThickness.check`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from flexdesign.fem.convergence import MeshNoise
from flexdesign.fem.meshing import cutting, methods
from flexdesign.fem.meshing.extruded import Layers, stack_prisms
from flexdesign.fem.meshing.local_thickness import LARGEST, LocalThickness, ThicknessField, thin_out
from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh
from flexdesign.fem.meshing.planar import PlanarError, triangulate
from flexdesign.fem.meshing.section import Section

FloatArray = NDArray[np.float64]

#: Where the edge length inside is stated, in thicknesses from the surface; it is measured from either side.
INSIDE = (0.25, 0.5)
#: Chord error allowed on curves, in edge lengths wanted there: with less, needles lie next to long triangles.
SAGITTA = 0.01
#: Smallest fillets that meshes resolve, in thicknesses: triangles shrink towards an edge at little cost, and smaller
#: ones are broken edges or leftovers of the drawing. Edges across them, in radii, are as long as of parts that name
#: their hinges (`methods`).
LEAST_FILLET, ACROSS_FILLET = 0.02, 0.45
#: Layers and edges at what crosses the layers, in its extents along and across them, of the finest mesh: three across a
#: bore. No smaller than the thinnest hinge, which is the thickness of layers at free ends: a broken edge changes no
#: stiffness. Edges change with the root of the coarseness, so that the coarsest mesh has two.
ACROSS_BORE = 1 / 3
#: Edges and layers at edges of faces that are held or rigid, in thicknesses there, of the finest mesh.
HELD = 0.1
#: Arms are what is no hinge: the thickness that a tenth of it does not have.
THIN_ARM = 0.1


@dataclass(frozen=True)
class LocalExtrusion(LocalThickness):
    """Layers of prisms cut into tetrahedra, of a solid that was found to be an extrusion."""

    name: ClassVar[str] = "extruded"

    @property
    def scatter(self) -> MeshNoise:
        """Of results over meshes made alike."""
        return methods.SCATTER_OF_NECKS if self._curved.any() else methods.SCATTER

    @property
    def mesher(self) -> str:
        """What makes the mesh, in words."""
        return "extruded in layers"

    @property
    def tries(self) -> int:
        """Once: the same question has the same answer."""
        return 1

    @property
    def section(self) -> Section:
        """The section."""
        if self.domain.extrusion is None:
            raise MeshError("the solid is no extrusion; take the method wild")
        return self.domain.extrusion

    def question(self, coarseness: float) -> tuple[object, ...]:
        """Return what the mesh depends on besides the domain, for the cache."""
        return (self.name, *self.sizing(coarseness).key, self._chord(coarseness), self.heights(coarseness))

    def mesh(self, coarseness: float) -> TaggedMesh:
        """Return the mesh, 1 being the finest; raise MeshError if there is none to be had."""
        section, sizing = self.section, self.sizing(coarseness)
        middle = (section.low + section.high) / 2

        def size(points: FloatArray) -> FloatArray:
            return sizing(section.lifted(points, middle))

        held = self.thin.held.flattened(section.axis, middle)

        def chord(points: FloatArray) -> FloatArray:
            """On held edges chords do not limit edges more than on the finest mesh, or these would not follow c^2."""
            wanted = size(points)
            eased = np.where(held(section.lifted(points, middle), wanted), coarseness**2, 1.0)
            return np.maximum(self._chord(coarseness), SAGITTA * eased * wanted)

        try:
            plan = triangulate(section.outline, size, chord)
        except PlanarError as error:
            raise MeshError(f"{error}; change mesh.at_root, or take the method wild") from error
        mesh = stack_prisms(plan, section, self.heights(coarseness))
        if self.domain.crossings is not None:
            mesh = cutting.cut(mesh, self.domain, self.domain.crossings, coarseness)
        return replace(mesh, faces=np.array(self.domain.joined)[mesh.faces])

    def follow_crossings(self, coarseness: float) -> bool:
        """Tell whether layers of a coarseness are fine enough to have cut out what crosses them."""
        try:
            self.mesh(coarseness)
        except MeshError:
            return False
        return True

    def size(self, mesh: TaggedMesh, coarseness: float) -> float:
        """Return the edge length by which results are extrapolated [m]: that at re-entrant corners and profiles."""
        return self.finest_edge(1.0) * coarseness**2

    def sizing(self, coarseness: float) -> ThicknessField:
        """Return the target edge length in the section: its places lie in the middle between the ends."""
        section, thin = self.section, self.thin
        factor = self.at_root / methods.EXTRUDED_GRADING[0]
        surface, inside, chord = methods.EXTRUDED_NECK
        on_profile = np.minimum(
            surface * coarseness**2, np.sqrt(8 * thin.curved * chord / self._neck_thickness) * coarseness
        )
        straight = (methods.BESIDE_NECKS if self._curved.any() else methods.BESIDE_LEAVES) * coarseness
        sides = np.abs(thin.inward[:, section.axis]) < 0.5
        ways = thin.inward * thin.thickness[:, None]
        shares = np.where(
            self._curved, [on_profile, *[np.full(len(ways), inside * coarseness)] * len(INSIDE)], straight
        )
        inner = [(thin.points + depth * ways)[sides] for depth in (0.0, *INSIDE)]
        places = np.vstack([*inner, thin.roots.places, thin.held.places])
        sharp = methods.EXTRUDED_GRADING[0] * coarseness**2
        at_roots = thin.roots.sizes(sharp, LEAST_FILLET, ACROSS_FILLET * coarseness**2)
        at_held = HELD * coarseness**2 * thin.held.thickness
        wanted = factor * np.concatenate([*(shares * thin.thickness)[:, sides], at_roots, at_held])
        crossed, thick = self._at_crossings(coarseness)
        places, wanted = np.vstack([places, crossed]), np.concatenate([wanted, thick])
        places[:, section.axis] = (section.low + section.high) / 2
        largest = (self.largest or LARGEST * self._diagonal) * coarseness
        some = thin_out(places, np.minimum(wanted, largest))
        return ThicknessField(places[some], np.minimum(wanted, largest)[some], self.growth * coarseness, largest)

    def heights(self, coarseness: float) -> FloatArray:
        """Return where layers meet [m]: as many as of parts with necks, whose thickness falls with the coarseness."""
        section, finest = self.section, self._layers(1.0)
        mirrors = {face for faces in self.domain.plane_faces for face in faces}
        low, high = (end not in mirrors for end in section.ends)
        extent = section.low, section.high, (low, high)
        least = methods.LEAST_LAYERS_OF_NECKS * max(low + high, 1)
        if not len(self._held_heights):
            return finest.heights(*extent, max(1, round(max(finest.count(*extent), least) / coarseness)))
        layers = self._layers(coarseness)
        return layers.heights(*extent, max(1, round(max(layers.count(*extent), least / coarseness))))

    def _at_crossings(self, coarseness: float) -> tuple[FloatArray, FloatArray]:
        """Return places on what crosses the layers, and the edge length wanted there, shapes (k, 3) and (k,) [m]."""
        if self.domain.crossings is None:
            return np.zeros((0, 3)), np.zeros(0)
        places, widths = self.domain.crossings.places(ACROSS_BORE)
        return places, np.sqrt(coarseness) * np.maximum(ACROSS_BORE * widths, self.thin.thinnest)

    def _layers(self, coarseness: float) -> Layers:
        thin, on_hinges = self.thin, np.concatenate([[], *self.thin.chosen]).astype(np.int64)
        others = np.delete(thin.thickness, on_hinges)
        arm = float(np.quantile(others if len(others) else thin.thickness, THIN_ARM))
        largest = methods.STOUT_LAYERS * methods.BESIDE_NECKS * arm
        growth = methods.EXTRUDED_GRADING[1]
        return Layers(
            coarseness * thin.thinnest, coarseness * growth, coarseness * max(largest, thin.thinnest),
            self._limits(coarseness),
        )  # fmt: skip

    def _limits(self, coarseness: float) -> FloatArray:
        """Return where held edges and bores across the layers limit their thickness, and to what.

        At bores to no less than at free ends; at held edges it goes with the square of the coarseness as edges do.
        """
        limits = self._held_heights * [1.0, 1.0, coarseness**2]
        if self.domain.crossings is None:
            return limits
        heights = self.domain.crossings.heights
        thick = np.maximum(ACROSS_BORE * np.ptp(heights, axis=1), self.thin.thinnest)
        return np.vstack([limits, np.column_stack([heights, coarseness * thick])])

    @property
    def _held_heights(self) -> FloatArray:
        return self.thin.held.heights(self.section.axis, HELD)

    def _chord(self, coarseness: float) -> float:
        return min(methods.CHORD * coarseness**2, methods.LARGEST_CHORD) * self.thin.thinnest

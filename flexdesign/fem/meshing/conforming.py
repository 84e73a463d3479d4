"""Tetrahedra of a CAD solid by Netgen, whose vertices lie on the solid's own faces.

The unstructured mesher takes a triangulated surface and rebuilds it within an envelope; of a solid with many round
faces around thin necks that takes it minutes, and may lose a piece. Netgen reads the boundary representation, meshes
edges, faces and volume in turn, and needs no such envelope. It may refuse a solid that the unstructured mesher takes.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flexdesign.core import subprocess_call
from flexdesign.fem.meshing.domain import MM, Domain
from flexdesign.fem.meshing.mesh import MeshError, TaggedMesh, boundary, signed_volumes
from flexdesign.fem.meshing.surface import triangle_areas

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Edges per radius on faces that bend where no place asks for finer ones, and their chord error, in diagonals of the
#: solid, both on the finest mesh: volume and mass are then off by about a thousandth. On coarser meshes edges grow as
#: all others do, and the chord error with their square.
PER_RADIUS, CHORD = 1.5, 3e-4
#: On curved faces next to a hinge the chord error on the finest mesh in its thickness, or such a face would reach into
#: it: Netgen's edges are up to 1.5 times as long as asked, and the two finer of three meshes pass the gate.
CHORD_AT_HINGES = 1.5e-3
#: Curved faces of smaller radius, in diagonals of the solid, are fillets, which places ask for where they matter: with
#: as many edges per radius, a rounding of 0.02 mm had more elements than all the rest. Of a solid that has any, Netgen
#: itself is asked for next to no edges per radius, and places on the other faces ask for them instead.
SMALL, NEXT_TO_NONE = 5e-3, 0.05
#: Growth of the edge length per distance, at most, tried in turn: with more, Netgen failed on crossed round notches.
GROWTHS = (0.3, 0.2)
#: Vertices of a plane face lie in its plane within this length and the tolerance of its edges [m].
ON_PLANE = 1e-8


class NoMesh(MeshError):
    """Netgen made no mesh, or none whose faces are those of the solid."""


class PlacedSizes(Protocol):
    """A target edge length that is known at places and grows from them."""

    @property
    def places(self) -> FloatArray:
        """Shape (n, 3) [m]."""

    @property
    def sizes(self) -> FloatArray:
        """The edge length there, shape (n,) [m]."""

    @property
    def growth(self) -> float:
        """Increase of the edge length per distance."""

    @property
    def largest(self) -> float:
        """The largest edge length [m]."""


def tetrahedralize(domain: Domain, sizing: PlacedSizes, coarseness: float = 1.0) -> TaggedMesh:
    """Fill the domain with tetrahedra whose boundary vertices lie on the CAD faces.

    Parameters
    ----------
    domain
        What to fill; it holds the solid's boundary representation.
    sizing
        The target edge length.
    coarseness
        Edge length over that of the finest mesh.

    Raises
    ------
    NoMesh
        If Netgen makes no mesh, or one whose faces are not those of the domain.
    """
    points, tets, facets, faces, count = _mesh_with_growth(domain, sizing, coarseness)
    if not len(tets) or count != len(domain.faces):
        raise NoMesh(f"Netgen's mesh has {len(tets)} tetrahedra and {count} faces for {len(domain.faces)}")
    points *= MM
    negative = signed_volumes(points, tets) < 0
    tets[negative] = tets[negative][:, [0, 1, 3, 2]]
    used, tets = np.unique(tets, return_inverse=True)
    tets = tets.reshape(-1, 4)
    facets = np.searchsorted(used, facets)
    points, outer = points[used], boundary(tets)
    order = {
        tuple(corners): face for corners, face in zip(np.sort(facets, axis=1).tolist(), faces.tolist(), strict=True)
    }
    try:
        found = np.array([order[tuple(corners)] for corners in np.sort(outer, axis=1).tolist()])
    except KeyError:
        raise NoMesh("the boundary of Netgen's mesh is not that of its surface") from None
    _require_planes(points, outer, found, domain)
    points = _keep_volume(points, outer, found, domain)
    return TaggedMesh(points, tets, outer, np.array(domain.joined)[found], mesher="Netgen")


def _mesh_with_growth(
    domain: Domain, sizing: PlacedSizes, coarseness: float
) -> tuple[FloatArray, IntArray, IntArray, IntArray, int]:
    """Return what `_fill` does, with the first growth that Netgen can mesh with."""
    cause: Exception | None = None
    places, sizes, per_radius = _with_curved_faces(domain, sizing, coarseness)
    for growth in GROWTHS:
        asked = (places / MM, sizes / MM, min(sizing.growth, growth), sizing.largest / MM, per_radius)
        try:
            return subprocess_call.call(_fill, domain.brep, *asked)
        except (subprocess_call.ProcessDied, RuntimeError) as error:
            cause = error
    raise NoMesh("Netgen made no mesh of the solid") from cause


def _with_curved_faces(domain: Domain, sizing: PlacedSizes, coarseness: float) -> tuple[FloatArray, FloatArray, float]:
    """Return the places and edge lengths [m] of a field, and those of curved faces, whose chords err by a share.

    Third are the edges per radius that Netgen is to put on faces that bend.
    """
    corners = np.vstack([face.points for face in domain.faces])
    diagonal = float(np.linalg.norm(np.ptp(corners, axis=0)))
    bends = np.vstack(
        [
            np.column_stack([face.points, np.full(len(face.points), face.radius)]) if face.radius else face.bends
            for face in domain.faces
        ]
    )
    large = bends[:, 3] >= SMALL * diagonal
    per_radius = PER_RADIUS / coarseness
    bends = bends[large]
    chords = np.minimum(CHORD * diagonal, CHORD_AT_HINGES * _adjacent_hinge(domain, bends[:, :3])) * coarseness**2
    lengths = np.sqrt(8 * bends[:, 3] * chords)
    if not large.all():
        lengths, per_radius = np.minimum(lengths, bends[:, 3] / per_radius), NEXT_TO_NONE
    return np.vstack([sizing.places, bends[:, :3]]), np.concatenate([sizing.sizes, lengths]), per_radius


def _adjacent_hinge(domain: Domain, places: FloatArray) -> FloatArray:
    """Return the thickness of the hinge that each place (n, 3) is no farther from than that, or else infinity."""
    found, thin = np.full(len(places), np.inf), domain.thin
    if thin is None:
        return found
    for hinge, on in zip(thin.hinges, thin.chosen, strict=True):
        across = thin.points[on] + thin.inward[on] * thin.thickness[on, None]
        away, _ = cKDTree(np.vstack([thin.points[on], across])).query(places)
        found = np.where(away <= hinge.thickness, np.minimum(found, hinge.thickness), found)
    return found


def _fill(
    brep: bytes, places: FloatArray, sizes: FloatArray, growth: float, largest: float, per_radius: float
) -> tuple[FloatArray, IntArray, IntArray, IntArray, int]:
    """Call Netgen, with lengths in mm: points, tetrahedra, facets, the face of each facet, and how many faces.

    It runs in a process of its own, and what Netgen prints there is dropped: thousands of lines where a mesh fails.
    """
    silent = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(silent, stream)
    from netgen.meshing import MeshingParameters
    from netgen.occ import OCCGeometry

    Path("solid.brep").write_bytes(brep)
    geometry = OCCGeometry("solid.brep")
    wanted = MeshingParameters(
        maxh=largest,
        grading=growth,
        curvaturesafety=per_radius,
        segmentsperedge=1.0,
        closeedgefac=None,
        minedgelen=min(1e-3, float(sizes.min()) / 50),
    )
    for (x, y, z), size in zip(places.tolist(), sizes.tolist(), strict=True):
        wanted.RestrictH(x, y, z, size)
    try:
        mesh = geometry.GenerateMesh(wanted)
    except Exception as error:  # of a class that only Netgen knows
        raise RuntimeError(str(error)) from None
    points = np.array([point.p for point in mesh.Points()])
    tets = np.array([[v.nr for v in each.vertices] for each in mesh.Elements3D()], dtype=np.int64) - 1
    surface = mesh.Elements2D()
    facets = np.array([[v.nr for v in each.vertices] for each in surface], dtype=np.int64) - 1
    faces = np.array([each.index for each in surface], dtype=np.int64) - 1
    return points, tets.reshape(-1, 4), facets, faces, len(geometry.shape.faces)


def _require_planes(points: FloatArray, facets: IntArray, faces: IntArray, domain: Domain) -> None:
    """Raise NoMesh if facets of a plane face do not lie in it: faces are numbered in another order."""
    for index, face in enumerate(domain.faces):
        if face.normal is None:
            continue
        corners = points[facets[faces == index]].reshape(-1, 3)
        if len(corners) == 0 or np.abs(corners @ face.normal - face.offset).max() > ON_PLANE + face.tolerance:
            raise NoMesh(f"face {index + 1} of Netgen's mesh is not that of the solid")


def _keep_volume(points: FloatArray, facets: IntArray, faces: IntArray, domain: Domain) -> FloatArray:
    """Return the points, those on cylinders moved off the axis so that facets lie on the surface on average.

    A facet with corners on a cylinder of radius R lies nearer to the axis than the arc, on average by the sum of the
    squared edges around it over 24 R: without the move a neck between two cylinders would be too thick, by a share
    that falls more slowly with the edge length than the error of quadratic elements. A vertex on a plane face, too,
    stays in its plane.
    """
    moved = points.copy()
    for index, face in enumerate(domain.faces):
        if face.axis is None:
            continue
        origin, axis = face.axis
        mine = facets[faces == index]
        radial = points - origin
        radial -= np.outer(radial @ axis, axis)
        corners = radial[mine]
        edges = corners - np.roll(corners, 1, axis=1)
        short = (edges**2).sum(axis=(1, 2)) / (24 * face.radius)
        area = triangle_areas(points[mine])
        weight, total = np.zeros(len(points)), np.zeros(len(points))
        np.add.at(weight, mine, area[:, None])
        np.add.at(total, mine, (area * short)[:, None])
        there = np.unique(mine)
        moved[there] += (total[there] / weight[there] / face.radius)[:, None] * radial[there]
    for index, face in enumerate(domain.faces):
        if face.normal is not None:
            there = np.unique(facets[faces == index])
            moved[there] -= np.outer(moved[there] @ face.normal - face.offset, face.normal)
    return moved

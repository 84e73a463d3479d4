"""The fundamental domain of a part: its solid cut by every symmetry plane.

Lengths leave this module in metres; the CAD kernel's millimetres stay inside.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.core.model import Member
from flexdesign.design import mirror
from flexdesign.design.materials import Material
from flexdesign.design.part import Piece, Port, SymmetryPlane, extrusion_axis
from flexdesign.fem.meshing import crossing, developed, held_edges, section, thin_regions
from flexdesign.fem.meshing.crossing import Crossings
from flexdesign.fem.meshing.section import Section
from flexdesign.fem.meshing.surface import bends_of, radius_of
from flexdesign.fem.meshing.thin_regions import ThinRegions

MM = 1e-3
#: Tessellations of curved faces keep to this share of the thinnest hinge.
CHORD = 1e-2
#: Longest edges of tessellated cylinders whose radius is at least that hinge's thickness, in chords of that error. The
#: kernel's triangles reach across the width; the unstructured mesher took ten times as long for such needles, and
#: strayed from every third notch by more than its envelope. Fillets are smaller, and their triangles too many.
LONGEST = 1.5
#: Of a part that names no hinges: chords in those of others, and how far points on its faces are apart at most, in
#: diagonals of the solid.
COARSER, APART = 2.0, 0.1
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


#: Axes and planes are parallel, and surfaces touch [m], within what CAD programs write.
PARALLEL, TOUCHING = 1e-7, 2e-8


def _touch(one: FloatArray, radius: float, other: FloatArray, other_radius: float) -> bool:
    """Tell whether two cylinders touch along a line."""
    if np.linalg.norm(np.cross(one[1], other[1])) > PARALLEL:
        return False
    away = other[0] - one[0]
    apart = float(np.linalg.norm(away - (away @ one[1]) * one[1]))
    return apart > TOUCHING and min(abs(apart - abs(radius + s * other_radius)) for s in (1, -1)) < TOUCHING


@dataclass(frozen=True)
class Face:
    """One CAD face of the domain.

    Parameters
    ----------
    points, triangles
        Its tessellation, shapes (n, 3) [m] and (m, 3).
    normal, offset
        Of a plane, the outward unit normal and ``normal . x`` [m]; None for curved faces.
    tolerance
        Largest distance of the edges and corners of a plane from it [m], as the CAD file states it.
    axis, radius
        Of a cylinder, a point and direction of its axis, shape (2, 3) [m], and its radius [m]; of a cone only its
        radius half-way along it; else None and 0.
    bends
        Of other curved faces, places on it and the smallest radius of curvature there, shape (k, 4) [m].
    """

    points: FloatArray
    triangles: IntArray
    normal: FloatArray | None
    offset: float = 0.0
    axis: FloatArray | None = None
    radius: float = 0.0
    bends: FloatArray = field(default_factory=lambda: np.zeros((0, 4)), repr=False)
    tolerance: float = 0.0


@dataclass(frozen=True)
class Domain:
    """The part of a solid that is meshed; mirrored in its planes it gives the whole.

    Parameters
    ----------
    faces
        Its CAD faces.
    planes
        The symmetry planes that bound it.
    ports
        The ports that lie in it, by name, with the indices of their faces.
    plane_faces
        For each symmetry plane the indices of the faces that lie in it.
    volume
        Exact volume of the CAD solid [m^3].
    fingerprint
        Hash of the solid's boundary representation.
    section
        What is extruded, where the part declares itself prismatic.
    thin, extrusion, crossings
        Where the solid is thin, what is extruded if it is an extrusion, but for what crosses its layers: found on it
        where the part names no hinges.
    brep
        The solid's boundary representation [mm], of a part that names no hinges.
    joined
        For each face the one that its facets count for: the first of those that are one port together.
    """

    faces: tuple[Face, ...]
    planes: tuple[SymmetryPlane, ...]
    ports: dict[str, int]
    plane_faces: tuple[tuple[int, ...], ...]
    volume: float
    fingerprint: str
    section: Section | None = None
    thin: ThinRegions | None = None
    extrusion: Section | None = None
    crossings: Crossings | None = None
    brep: bytes = field(default=b"", repr=False)
    joined: tuple[int, ...] = ()

    @property
    def chord(self) -> float:
        """How far the tessellation strays from curved faces beyond what the mesher's envelope covers [m]."""
        return 0.0 if self.thin is None else COARSER * CHORD * self.thin.thinnest

    @property
    def copies(self) -> int:
        """How many mirror images make the whole part."""
        return int(2 ** len(self.planes))

    def keeps(self, member: Member) -> bool:
        """Tell whether a member lies in the domain, by its centre, rather than in a mirror image."""
        return all(member.centre[plane.index] > -1e-12 for plane in self.planes)

    def tangent_faces(self) -> list[tuple[int, int]]:
        """Return pairs of a cylinder and a plane, or another cylinder, that it runs out into, by index."""
        cylinders = [(i, face.axis, face.radius) for i, face in enumerate(self.faces) if face.axis is not None]
        planes = [(i, face.normal, face.offset) for i, face in enumerate(self.faces) if face.normal is not None]
        flat = [
            (c, p)
            for c, axis, radius in cylinders
            for p, normal, offset in planes
            if abs(axis[1] @ normal) < PARALLEL and abs(abs(axis[0] @ normal - offset) - radius) < TOUCHING
        ]
        return flat + [
            (one[0], other[0]) for one, other in itertools.combinations(cylinders, 2) if _touch(*one[1:], *other[1:])
        ]

    def surface(self) -> tuple[FloatArray, IntArray, IntArray]:
        """Return the welded closed surface: points (n, 3) [m], triangles (m, 3), face index of each triangle (m,)."""
        points, triangles, owners, base = [], [], [], 0
        for index, face in enumerate(self.faces):
            points.append(face.points)
            triangles.append(face.triangles + base)
            owners.append(np.full(len(face.triangles), index))
            base += len(face.points)
        stacked = np.vstack(points)
        _, first, inverse = np.unique(np.round(stacked / 1e-9), axis=0, return_index=True, return_inverse=True)
        welded = inverse.reshape(-1)[np.vstack(triangles)]
        proper = (welded[:, 0] != welded[:, 1]) & (welded[:, 1] != welded[:, 2]) & (welded[:, 2] != welded[:, 0])
        return stacked[first], welded[proper], np.concatenate(owners)[proper]


def of_part(part: Piece, *, material: Material | None = None, symmetric: bool = True, chord: float) -> Domain:
    """Cut the part's solid down to its fundamental domain and find the ports on it.

    Parameters
    ----------
    part
        The part.
    material
        What it is made of: of the planes in which the part is its own mirror image, a crystal leaves those in which it
        is one, too. None for an isotropic material, which leaves them all.
    symmetric
        False to keep the whole solid.
    chord
        Largest distance between a curved face and its tessellation [m]; no finer than the mesher's envelope asks for,
        as needle-shaped triangles cost it minutes, and mesh vertices are put on the true face afterwards.

    Raises
    ------
    InputError
        If the part's solid is invalid, a port is not found on it, or it is not the extrusion the part says it is.
    """
    whole = _one_solid(part.solid(), "the solid")
    planes = common_planes(part, material) if symmetric else ()
    solid = _cut_down(whole, planes)
    for plane in planes:
        if not mirror.is_balanced(whole, plane.index):
            raise InputError("part", "symmetry", plane.axis, "the solid is not its own mirror image in this plane")
    thinnest, thin = _thinnest(part), None
    if math.isinf(thinnest):
        thin = thin_regions.find(whole)
        size = solid.BoundingBox().DiagonalLength * MM
        found = [_even_face(face, COARSER * CHORD * thin.thinnest, size) for face in solid.Faces()]
    else:
        found = [_face(face, chord, thinnest) for face in solid.Faces()]
    swapped = {name for plane in planes for name in plane.swaps}
    ports = [mirror.cut_port(port, whole, solid) for port in part.ports() if port.name not in swapped]
    groups = [port.faces for port in ports]
    faces, first = _join(found, groups), list(range(len(found)))
    for group in groups:
        for index in group:
            first[index] = group[0]
    for port in ports:
        for plane in planes:
            if port.name not in plane.swaps.values() and abs(port.point[plane.index]) > 1e-9:
                remedy = f"its point must lie in the symmetry plane {plane.axis} = 0, or the plane must swap the port"
                raise InputError("part", f"ports.{port.name}", port.point, remedy)
    at_ports = [index for port in ports for index in port.faces]
    layered = crossing.layers_of(whole, solid, lambda shape: _cut_down(shape, planes), thin, at_ports)
    of_ports = {port.name: face_of(port, faces) for port in ports}
    plane_faces = tuple(faces_in(plane, faces) for plane in planes)
    if thin is not None:
        held = [i for p in ports if p.rigid or p.role == "ground" for i in p.faces or (of_ports[p.name],)]
        mirrors = {index for cut in plane_faces for index in cut}
        thin = replace(thin, held=held_edges.find(solid, held, mirrors, thin.points, thin.thickness))
    return Domain(
        faces=faces,
        planes=planes,
        ports=of_ports,
        plane_faces=plane_faces,
        volume=solid.Volume() * MM**3,
        fingerprint=hashlib.sha256(brep := _brep(solid)).hexdigest(),
        section=section.of_solid(solid, axis) if (axis := extrusion_axis(part)) else None,
        thin=thin,
        extrusion=layered[0],
        crossings=layered[1],
        brep=b"" if thin is None else brep,
        joined=tuple(first),
    )


def _join(faces: Sequence[Face], groups: Sequence[tuple[int, ...]]) -> tuple[Face, ...]:
    """Return the faces, with each group of plane faces put together at the place of its first; the others are empty."""
    joined = list(faces)
    for group in groups:
        pieces = [faces[index] for index in group]
        if len(pieces) < 2:
            continue
        starts = np.cumsum([0, *(len(piece.points) for piece in pieces)])
        joined[group[0]] = replace(
            pieces[0],
            points=np.vstack([piece.points for piece in pieces]),
            triangles=np.vstack([piece.triangles + start for piece, start in zip(pieces, starts, strict=False)]),
        )
        for index in group[1:]:
            joined[index] = replace(faces[index], points=faces[index].points[:0], triangles=faces[index].triangles[:0])
    return tuple(joined)


def chord(part: Piece) -> float:
    """Return how far the tessellation of curved faces may stray from them [m]."""
    return CHORD * _thinnest(part)


def _thinnest(part: Piece) -> float:
    return min((hinge.thickness for hinge in part.linkage().of_kind("hinge")), default=np.inf)


def common_planes(part: Piece, material: Material | None) -> tuple[SymmetryPlane, ...]:
    """Return the planes in which both a part and what it is made of are their own mirror images."""
    return tuple(plane for plane in part.symmetry() if material is None or material.mirrors_in(plane.index))


def _one_solid(shape: Any, what: str) -> Any:
    solids = shape.Solids()
    if len(solids) != 1:
        raise InputError("part", "solid", None, f"{what} must be one closed body, found {len(solids)}")
    if not solids[0].isValid():
        raise InputError("part", "solid", None, f"{what} is not valid: its boundary is open or crosses itself")
    return solids[0]


def _cut_down(whole: Any, planes: Sequence[SymmetryPlane]) -> Any:
    """Return what symmetry planes leave of a solid."""
    solid = whole
    for plane in planes:
        solid = _one_solid(solid.intersect(_half_space(whole, plane)), f"the half {plane.axis} >= 0")
    return solid


def _half_space(solid: Any, plane: SymmetryPlane) -> Any:
    import cadquery as cq

    box = solid.BoundingBox()
    low, high = np.array([box.xmin, box.ymin, box.zmin]) - 1.0, np.array([box.xmax, box.ymax, box.zmax]) + 1.0
    low[plane.index] = 0.0
    size = high - low
    return cq.Solid.makeBox(*size, pnt=cq.Vector(*low))


def _face(face: Any, chord: float, thinnest: float) -> Face:
    vertices, triangles = face.tessellate(chord / MM, 0.35)
    points = np.array([(v.x, v.y, v.z) for v in vertices]) * MM
    corners = np.array(triangles, dtype=np.int64).reshape(-1, 3)
    from OCP.BRep import BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    kind = face.geomType()
    if kind == "PLANE":
        normal = face.normalAt()
        direction = np.array([normal.x, normal.y, normal.z])
        place = BRepAdaptor_Surface(face.wrapped).Plane().Location()
        offset = float(direction @ (place.X(), place.Y(), place.Z())) * MM
        tolerance = max(BRep_Tool.Tolerance_s(piece.wrapped) for piece in (*face.Edges(), *face.Vertices())) * MM
        return Face(points, corners, direction, offset, tolerance=tolerance)
    if kind == "CYLINDER":
        # A cut of two circles leaves a trimmed surface, which has no cylinder of its own; the adaptor sees through it.
        cylinder = BRepAdaptor_Surface(face.wrapped).Cylinder()
        location, direction = cylinder.Axis().Location(), cylinder.Axis().Direction()
        axis = np.array(
            [[location.X() * MM, location.Y() * MM, location.Z() * MM], [direction.X(), direction.Y(), direction.Z()]]
        )
        radius = cylinder.Radius() * MM
        if radius >= thinnest:
            points, corners = developed.split(points, corners, LONGEST * float(np.sqrt(8 * radius * CHORD * thinnest)))
            points = _on_cylinder(points, axis, radius)
        return Face(points, corners, None, axis=axis, radius=radius)
    radius = radius_of(BRepAdaptor_Surface(face.wrapped)) * MM
    return Face(points, corners, None, radius=radius, bends=np.zeros((0, 4)) if radius else bends_of(face) * MM)


def _even_face(face: Any, chord: float, size: float) -> Face:
    """Return a face with even triangles, for a part that names no hinges; of a surface that bends twice the kernel's.

    Chords [m] are alike on all faces, as neighbours share edges; points are no farther apart than a share of the
    `size` [m].
    """
    tessellated = _face(face, chord, math.inf)
    longest = APART * size
    if tessellated.radius:
        longest = min(longest, float(np.sqrt(8 * tessellated.radius * chord)))
    made = developed.triangles_of(face, chord / MM, longest / MM)
    if made is None and tessellated.radius:
        points, triangles = developed.split(tessellated.points, tessellated.triangles, longest)
        return replace(tessellated, points=points, triangles=triangles)
    return tessellated if made is None else replace(tessellated, points=made[0] * MM, triangles=made[1])


def _on_cylinder(points: FloatArray, axis: FloatArray, radius: float) -> FloatArray:
    origin, direction = axis
    along = np.outer((points - origin) @ direction, direction)
    radial = points - origin - along
    return np.asarray(origin + along + radial * (radius / np.linalg.norm(radial, axis=1))[:, None])


def face_of(port: Port, faces: Sequence[Face]) -> int:
    """Find the plane face with the port's normal whose plane and extent contain the port's point, if none is named."""
    if port.faces:
        return port.faces[0]
    for index, face in enumerate(faces):
        if face.normal is None or face.normal @ np.array(port.normal) < 1 - 1e-9:
            continue
        low, high = face.points.min(axis=0) - 1e-9, face.points.max(axis=0) + 1e-9
        if abs(face.normal @ np.array(port.point) - face.offset) > 1e-9:
            continue
        if np.all(port.point >= low) and np.all(port.point <= high):
            return index
    raise InputError("part", f"ports.{port.name}", port.point, "no plane face with this normal at this point")


def faces_in(plane: SymmetryPlane, faces: Sequence[Face]) -> tuple[int, ...]:
    """Return the indices of the faces that lie in a symmetry plane; raise InputError if there are none."""
    inside = [i for i, f in enumerate(faces) if np.all(np.abs(f.points[:, plane.index]) < 1e-9)]
    if not inside:
        raise InputError("part", "symmetry", plane.axis, "the plane does not cut the solid")
    return tuple(inside)


def _brep(solid: Any) -> bytes:
    """Return the solid's boundary representation [mm]."""
    stream = io.BytesIO()
    solid.exportBrep(stream)
    return stream.getvalue()

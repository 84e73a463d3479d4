"""The surface of a solid as triangles that know their faces, and rays that are cast at triangles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Surface:
    """Triangles of a closed surface, and the face each lies on.

    Parameters
    ----------
    points, triangles
        Shapes (n, 3) [m] and (m, 3), seen from outside counter-clockwise.
    owners
        Index of the face of each triangle, shape (m,).
    normals
        Outward unit normal of each face where it is plane, NaN elsewhere, shape (faces, 3).
    radii
        Of each face that is a cylinder, of a cone half-way along it, of the smaller circle of a torus, as of a notch
        that was turned [m]; infinite elsewhere, shape (faces,).
    closed
        Which faces belong to cylinders or cones that are whole circles, shape (faces,).
    """

    points: FloatArray
    triangles: IntArray
    owners: IntArray
    normals: FloatArray
    radii: FloatArray
    closed: NDArray[np.bool_]

    @property
    def corners(self) -> FloatArray:
        """Shape (m, 3, 3) [m]."""
        return self.points[self.triangles]

    @property
    def outward(self) -> FloatArray:
        """Unit normal of each triangle, shape (m, 3)."""
        a, b, c = np.moveaxis(self.corners, 1, 0)
        normal = np.cross(b - a, c - a)
        return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None])

    @property
    def size(self) -> float:
        """Diagonal of the bounding box [m]."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


def triangle_areas(corners: FloatArray) -> FloatArray:
    """Return the areas of triangles with corners of shape (m, 3, 3) [m], shape (m,) [m^2]."""
    return np.asarray(
        np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    )


class Rays:
    """Casts rays at triangles."""

    def __init__(self, points: FloatArray, triangles: IntArray) -> None:
        import pyvista as pv
        from vtkmodules.vtkCommonDataModel import vtkStaticCellLocator

        self._mesh = pv.PolyData.from_regular_faces(points, triangles)
        self._locator: Any = vtkStaticCellLocator()  # its declared types know no references
        self._locator.SetDataSet(self._mesh)
        self._locator.BuildLocator()
        self._size = float(np.linalg.norm(np.ptp(points, axis=0)))

    def first(self, start: FloatArray, way: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return how far each ray goes until it meets a triangle [m], infinite for none, and which one, -1 for none."""
        from vtkmodules.vtkCommonCore import mutable

        reach: Any = mutable(0.0)
        cell, which = mutable(0), mutable(0)
        place, local = [0.0] * 3, [0.0] * 3
        far, hit = np.full(len(start), np.inf), np.full(len(start), -1, dtype=np.int64)
        ends = start + self._size * way
        for i, (a, b) in enumerate(zip(start.tolist(), ends.tolist(), strict=True)):
            if self._locator.IntersectWithLine(a, b, 1e-12 * self._size, reach, place, local, which, cell):
                far[i], hit[i] = float(reach) * self._size, int(cell)
        return far, hit

    def thickness(self, start: FloatArray, way: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return how thick the body is along lines through places within it [m], and how the lines meet its surface.

        That is the least cosine between line and normal, of both sides.
        """
        (forth, ahead), (back, behind) = self.first(start, way), self.first(start, -way)
        normals = np.asarray(self._mesh.face_normals, dtype=float)
        facing = [np.abs(np.einsum("ij,ij->i", way, normals[hit])) for hit in (ahead, behind)]
        return forth + back, np.minimum(*facing)


def surface_of(solid: Any, chord: float) -> Surface:
    """Return the triangles of a CadQuery solid [mm], no farther than a chord [m] from its curved faces."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepMesh import BRepMesh_IncrementalMesh
    from OCP.BRepTools import BRepTools

    mm, points, triangles, owners, normals, radii, base = 1e-3, [], [], [], [], [], 0
    arcs: dict[int, tuple[float, ...]] = {}
    # All faces at once: of faces meshed one by one neighbours need not share points, and no edge would be found
    # re-entrant. With an absolute chord, which `Shape.mesh` would take in proportion to the edges.
    BRepTools.Clean_s(solid.wrapped)
    BRepMesh_IncrementalMesh(solid.wrapped, chord / mm, False, 0.2)
    for index, face in enumerate(solid.Faces()):
        vertices, corners = face.tessellate(math.inf)  # those that are there
        points.append(np.array([v.toTuple() for v in vertices]).reshape(-1, 3) * mm)
        triangles.append(np.array(corners, dtype=np.int64).reshape(-1, 3) + base)
        owners.append(np.full(len(corners), index))
        base += len(vertices)
        kind = face.geomType()
        normals.append(face.normalAt().toTuple() if kind == "PLANE" else (np.nan,) * 3)
        bent = BRepAdaptor_Surface(face.wrapped)
        radii.append(np.inf)
        if kind in ("CYLINDER", "CONE"):
            radii[-1], arcs[index] = radius_of(bent) * mm, _arc(bent)
        elif kind == "TORUS":
            radii[-1] = bent.Torus().MinorRadius() * mm
    stacked = np.vstack(points)
    _, first, inverse = np.unique(np.round(stacked / 1e-9), axis=0, return_index=True, return_inverse=True)
    welded = inverse.reshape(-1)[np.vstack(triangles)]
    proper = (welded[:, 0] != welded[:, 1]) & (welded[:, 1] != welded[:, 2]) & (welded[:, 2] != welded[:, 0])
    return Surface(
        stacked[first], welded[proper], np.concatenate(owners)[proper], np.array(normals), np.array(radii, dtype=float),
        _closed(arcs, len(radii)),
    )  # fmt: skip


def radius_of(bent: Any) -> float:
    """Return the radius of a cylinder, of a cone half-way along it, such as a drafted bore [mm]; 0 of other faces."""
    kind = bent.GetType().name
    if kind == "GeomAbs_Cylinder":
        return float(bent.Cylinder().Radius())
    if kind != "GeomAbs_Cone":
        return 0.0
    middle, cone = (bent.FirstVParameter() + bent.LastVParameter()) / 2, bent.Cone()
    return float(abs(cone.RefRadius() + middle * np.sin(cone.SemiAngle())))


def bends_of(face: Any) -> FloatArray:
    """Return the nodes of the triangles of a CadQuery face, and the smallest radius of curvature there, (k, 4) [mm].

    Left out are nodes where the face is flat, or where its curvature is not defined.
    """
    from OCP.BRep import BRep_Tool
    from OCP.BRepAdaptor import BRepAdaptor_Surface
    from OCP.BRepLProp import BRepLProp_SLProps
    from OCP.TopLoc import TopLoc_Location

    known = BRep_Tool.Triangulation_s(face.wrapped, TopLoc_Location())
    if known is None or not known.HasUVNodes():
        return np.zeros((0, 4))
    local, found = BRepLProp_SLProps(BRepAdaptor_Surface(face.wrapped), 2, 1e-9), []
    for i in range(known.NbNodes()):
        node = known.UVNode(i + 1)
        local.SetParameters(node.X(), node.Y())
        bend = max(abs(local.MaxCurvature()), abs(local.MinCurvature())) if local.IsCurvatureDefined() else 0.0
        if bend > 0:
            place = local.Value()
            found.append((place.X(), place.Y(), place.Z(), 1 / bend))
    return np.array(found).reshape(-1, 4)


def _arc(bent: Any) -> tuple[float, ...]:
    """Return what the pieces of one cylinder or cone have in common, and the angle of this one.

    Of a cylinder the radius, the place of the axis that is nearest to the origin, and the direction of the axis; of a
    cone the slope, the apex, and the direction.
    """
    is_cylinder = bent.GetType().name == "GeomAbs_Cylinder"
    shape = bent.Cylinder() if is_cylinder else bent.Cone()
    place, way = shape.Axis().Location() if is_cylinder else shape.Apex(), shape.Axis().Direction()
    at, along = (np.array([each.X(), each.Y(), each.Z()]) for each in (place, way))
    along *= np.sign(along[np.argmax(np.abs(along))])
    at -= (at @ along) * along if is_cylinder else 0.0
    size = shape.Radius() if is_cylinder else abs(shape.SemiAngle())
    return size, *at, *along, bent.LastUParameter() - bent.FirstUParameter()


def _closed(arcs: dict[int, tuple[float, ...]], count: int) -> NDArray[np.bool_]:
    """Tell which of `count` faces belong to cylinders or cones whose pieces make up a whole circle or more."""
    closed = np.zeros(count, dtype=bool)
    if arcs:
        table = np.array(list(arcs.values()))
        _, same = np.unique(np.round(table[:, :-1], 6), axis=0, return_inverse=True)
        turn = np.bincount(same.reshape(-1), table[:, -1])
        closed[list(arcs)] = (turn > 2 * np.pi - 1e-6)[same.reshape(-1)]
    return closed

"""What crosses the layers of a solid that is nearly an extrusion: bores from the side, counterbores, pockets, slots.

A plate that is cut by wire erosion is an extrusion until somebody drills it from the side or mills a slot into it. Its
leaves are as good as before, and layers are still the way to mesh them. So the smallest extrusion that holds the solid
is meshed in layers, and what the solid lacks of that is cut out of them (`cutting`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.fem.meshing import section
from flexdesign.fem.meshing.section import Section
from flexdesign.fem.meshing.thin_regions import ThinRegions

MM = 1e-3
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
#: Directions are parallel within this; faces lie on one another, and volumes are alike, within shares of the solid's.
PARALLEL, ALIKE = 1e-7, 1e-6
#: Slits narrower than this many of the thinnest hinge, which edges of the coarsest mesh would reach across.
NARROW = 2.0
#: Angle between neighbouring triangles of what is cut out [rad]: of a circle 63, whose area is off by 0.2 %.
ANGLE = 0.1


@dataclass(frozen=True)
class Crossings:
    """What a solid lacks of the smallest extrusion that holds it.

    Parameters
    ----------
    faces
        Indices of the solid's faces that bound it.
    points, triangles
        Closed surface of what is missing, shapes (n, 3) [m] and (m, 3).
    pieces
        Which bore each triangle belongs to, shape (m,).
    widths
        How wide it is there across the extrusion, shape (m,) [m]: the diameter of a cylinder, and of what has none the
        least extent; infinite at the ends of a cylinder.
    heights
        From where to where each bore of the whole reaches along the extrusion, shape (k, 2) [m].
    """

    faces: tuple[int, ...]
    points: FloatArray
    triangles: IntArray
    pieces: IntArray
    widths: FloatArray
    heights: FloatArray

    def places(self, share: float) -> tuple[FloatArray, FloatArray]:
        """Return places on its surface (k, 3), no farther apart than a share of its width, and that width (k,)."""
        found, widths = [np.zeros((0, 3))], [np.zeros(0)]
        for corners, width in zip(self.points[self.triangles], self.widths, strict=True):
            if not np.isfinite(width):
                continue
            sides = corners - np.roll(corners, 1, axis=0)
            count = int(np.ceil(np.linalg.norm(sides, axis=1).max() / (share * width)))
            i, j = (each.ravel() for each in np.meshgrid(np.arange(count + 1), np.arange(count + 1)))
            found.append((np.column_stack([i, j, count - i - j])[i + j <= count] / count) @ corners)
            widths.append(np.full(len(found[-1]), width))
        return np.vstack(found), np.concatenate(widths)


def layers_of(
    whole: Any, solid: Any, cut_down: Callable[[Any], Any], thin: ThinRegions | None, ports: Iterable[int]
) -> tuple[Section | None, Crossings | None]:
    """Return the section of a solid that nobody described, and what crosses its layers; None where there is none.

    What reaches a hinge or holds a port is not taken off: there the solid has to be meshed as it is.

    Parameters
    ----------
    whole, solid
        CadQuery solids [mm]: the whole, and the part of it that is meshed.
    cut_down
        Cuts the second out of the first.
    thin
        Where the solid is thin; None of a part that names its hinges, which says itself what is extruded.
    ports
        Indices of the faces of `solid` that are ports.
    """
    if thin is None:
        return None, None
    extrusion = section.find(solid, thin.inward_at_hinges)
    if extrusion is not None:
        return extrusion, None
    whole = whole.clean()  # bores drawn in two pieces are one
    for index in section.candidates(thin.inward_at_hinges):
        across = _faces_across(whole, index)
        full = None if not across or _are_near(across, thin) else _drawn_out(whole, index)
        if full is None:
            continue
        try:
            filled = cut_down(full)
            found = section.of_solid(filled, section.AXES[index])
        except InputError:
            continue
        missing = filled.cut(solid)
        if not missing.Solids() or _is_narrow(missing, filled, index, NARROW * thin.thinnest / MM):
            continue
        # what is to be cut out must be all that the two differ by
        if abs(filled.Volume() - missing.Volume() - solid.Volume()) > ALIKE * solid.Volume():
            continue
        crossings = _crossings(solid, filled, missing, full.cut(whole), index)
        if not set(ports) & set(crossings.faces):
            return replace(found, ends=_ends(solid, found)), crossings
    return None, None


def _faces_across(solid: Any, index: int) -> list[Any]:
    """Return the faces of a solid that are neither ends of an extrusion along an axis nor sides from end to end."""
    faces = solid.Faces()
    low, high = _extent(solid, index)
    near = ALIKE * (high - low)
    return [
        face for face in faces if not (_is_end(face, index, low, high, near) or _is_side(face, index, low, high, near))
    ]


def _extent(shape: Any, index: int) -> tuple[float, float]:
    """Return from where to where the vertices of a shape reach along an axis: of boxes the kernel's are rough."""
    places = [vertex.toTuple()[index] for vertex in shape.Vertices()]
    return min(places), max(places)


def _is_end(face: Any, index: int, low: float, high: float, near: float) -> bool:
    if face.geomType() != "PLANE" or abs(face.normalAt().toTuple()[index]) < 1 - 1e-9:
        return False
    height = face.Center().toTuple()[index]
    return bool(min(abs(height - low), abs(height - high)) < near)


def _is_side(face: Any, index: int, low: float, high: float, near: float) -> bool:
    """Tell whether a face is parallel to an axis and reaches from end to end."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    bottom, top = _extent(face, index)
    if abs(bottom - low) > near or abs(top - high) > near:
        return False
    if face.geomType() == "PLANE":
        return bool(abs(face.normalAt().toTuple()[index]) < PARALLEL)
    if face.geomType() == "CYLINDER":
        way = BRepAdaptor_Surface(face.wrapped).Cylinder().Axis().Direction()
        return bool(abs((way.X(), way.Y(), way.Z())[index]) > 1 - PARALLEL)
    return bool(face.geomType() in ("EXTRUSION", "BSPLINE"))  # what is no extrusion is refused afterwards


def _drawn_out(solid: Any, index: int) -> Any | None:
    """Return the smallest extrusion along an axis that holds a solid; None if that is none in one piece.

    It is the union of the sections between neighbouring heights of vertices, each drawn out from end to end.
    """
    import cadquery as cq
    from OCP.Standard import Standard_Failure

    heights = np.unique(np.round([vertex.toTuple()[index] for vertex in solid.Vertices()], 9))
    way, size = np.eye(3)[index], solid.BoundingBox().DiagonalLength
    made: Any = None
    try:
        for height in _longest_first(heights):
            plane = cq.Face.makePlane(4 * size, 4 * size, tuple(height * way), tuple(way))
            for face in plane.intersect(solid).Faces():
                start = face.moved(cq.Location(cq.Vector(*((heights[0] - height) * way))))
                piece = cq.Solid.extrudeLinear(start, cq.Vector(*((heights[-1] - heights[0]) * way)))
                made = piece if made is None else made.fuse(piece)
            if made is not None and solid.cut(made).Volume() < ALIKE * solid.Volume():
                break
    except (Standard_Failure, ValueError):
        return None
    found = [] if made is None else made.clean().Solids()
    return found[0] if len(found) == 1 and found[0].isValid() else None


def _longest_first(heights: FloatArray) -> FloatArray:
    """Return the middles between neighbouring heights, those of the longest stretches first."""
    return (0.5 * (heights[1:] + heights[:-1]))[np.argsort(-np.diff(heights), kind="stable")]


def _crossings(solid: Any, filled: Any, missing: Any, missing_in_whole: Any, index: int) -> Crossings:
    """Return what is missing in a solid: its surface, and which faces of the solid it has left."""
    import cadquery as cq
    from OCP.BRepTools import BRepTools

    skin = _skin(filled)
    size = filled.BoundingBox().DiagonalLength
    left = [
        number
        for number, face in enumerate(solid.Faces())
        if skin.distance(cq.Vertex.makeVertex(*_place_in(face))) > ALIKE * size
    ]
    points, triangles, pieces, widths, base = [], [], [], [], 0
    for number, piece in enumerate(missing.Solids()):
        BRepTools.Clean_s(piece.wrapped)  # faces of the solid may have finer triangles, which fit no others
        piece.mesh(1e-3 * size, ANGLE)
        for face, width in _widths(piece, index):
            corners, facets = _triangles(face, size)
            points.append(corners)
            triangles.append(facets + base)
            pieces.append(np.full(len(facets), number))
            widths.append(np.full(len(facets), width * MM))
            base += len(corners)
    stacked = np.vstack(points)
    _, first, inverse = np.unique(np.round(stacked / 1e-9), axis=0, return_index=True, return_inverse=True)
    along = [_triangles(piece, size)[0][:, index] for piece in missing_in_whole.Solids()]
    return Crossings(
        tuple(left),
        stacked[first],
        inverse.reshape(-1)[np.vstack(triangles)],
        np.concatenate(pieces),
        np.concatenate(widths),
        np.array([(places.min(), places.max()) for places in along]),
    )


def _skin(solid: Any) -> Any:
    import cadquery as cq

    return cq.Compound.makeCompound(solid.Faces())


def _triangles(shape: Any, size: float) -> tuple[FloatArray, IntArray]:
    """Return points (n, 3) [m] and triangles (m, 3) of a shape [mm]."""
    points, triangles = shape.tessellate(1e-3 * size, ANGLE)
    return np.array([point.toTuple() for point in points]) * MM, np.array(triangles, dtype=np.int64)


def _widths(piece: Any, index: int) -> list[tuple[Any, float]]:
    """Return the faces of a piece, and how wide it is there across an axis [mm], as `Crossings` has it."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    round_ = [face.geomType() == "CYLINDER" for face in piece.Faces()]
    extents = [high - low for low, high in (_extent(piece, other) for other in range(3) if other != index)]
    least = math.inf if any(round_) else min(extents)
    return [
        (face, 2 * BRepAdaptor_Surface(face.wrapped).Cylinder().Radius() if bent else least)
        for face, bent in zip(piece.Faces(), round_, strict=True)
    ]


def _is_narrow(missing: Any, filled: Any, index: int, least: float) -> bool:
    """Tell whether plane walls of what is missing face each other across less than a length [mm], or across layers.

    Elements could bridge such a slit, or the undercut of a T slot, and leave it stiff.
    """
    skin = _skin(filled)
    for piece in missing.Solids():
        for face in piece.Faces():
            if face.geomType() == "PLANE":
                across = _to_the_wall_across(piece, face, skin)
                is_undercut = abs(face.normalAt().toTuple()[index]) > PARALLEL and math.isfinite(across)
                if is_undercut or across < least:
                    return True
    return False


def _to_the_wall_across(piece: Any, face: Any, skin: Any) -> float:
    """Return how far it is from a plane face through a piece to its other side [mm]; infinite if one of both is open.

    Open is what lies on the skin of the extrusion.
    """
    import cadquery as cq

    place, near = cq.Vector(*_place_in(face)), ALIKE * skin.BoundingBox().DiagonalLength
    way = -face.normalAt()
    line = cq.Edge.makeLine(place, place + way * (2 * piece.BoundingBox().DiagonalLength))
    start = cq.Vertex.makeVertex(*place.toTuple())
    lengths = [edge.Length() for edge in line.intersect(piece).Edges() if edge.distance(start) < near]
    if not lengths:
        return math.inf
    end = cq.Vertex.makeVertex(*(place + way * lengths[0]).toTuple())
    return math.inf if min(skin.distance(start), skin.distance(end)) < near else float(lengths[0])


def _place_in(face: Any) -> tuple[float, float, float]:
    """Return a point of a face that lies on none of its edges [mm]."""
    from OCP.BOPTools import BOPTools_AlgoTools3D
    from OCP.gp import gp_Pnt, gp_Pnt2d
    from OCP.IntTools import IntTools_Context

    place = gp_Pnt()
    BOPTools_AlgoTools3D.PointInFace_s(face.wrapped, place, gp_Pnt2d(), IntTools_Context())
    return place.X(), place.Y(), place.Z()


def _are_near(faces: Sequence[Any], thin: ThinRegions) -> bool:
    """Tell whether one of some faces [mm] reaches a hinge, or is no farther from it than it is thick."""
    import pyvista as pv

    middles, thickness = thin.middles_of_hinges()
    for face in faces:
        points, triangles = _triangles(face, float(np.linalg.norm(np.ptp(thin.points, axis=0))) / MM)
        _, nearest = pv.PolyData.from_regular_faces(points, triangles).find_closest_cell(
            middles, return_closest_point=True
        )
        if (np.linalg.norm(nearest - middles, axis=1) < 1.5 * thickness).any():
            return True
    return False


def _ends(solid: Any, found: Section) -> tuple[int, int]:
    """Return which faces of a solid are the ends of a section, the first of each where there are several."""
    faces = list(enumerate(solid.Faces()))
    return tuple(  # type: ignore[return-value]
        next(
            index
            for index, face in faces
            if _is_end(face, found.axis, height / MM, height / MM, 1e-6)
            and face.normalAt().toTuple()[found.axis] * way > 0
        )
        for height, way in ((found.low, -1), (found.high, 1))
    )

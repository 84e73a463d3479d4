"""The faces of a solid as a designer sees them, and how a port finds its own: by name, colour, plane, or a point.

A point and a normal, or a plane such as ``z = max``, find the same face after small edits of the solid, when its number
has changed; so does the name that a STEP file carries.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model.linkage import Vector

MM = 1e-3
#: A face is looked for by a point within this share of the solid's size, and by a normal within this cosine.
REACH, DIRECTION = 0.1, float(np.cos(np.radians(10.0)))
#: Faces lie in one plane if they differ by less than this share of the solid's size.
FLUSH = 1e-5
#: A radius is meant within this share.
SAME_RADIUS = 1e-3
#: What a port may be.
PORT_KINDS = ("plane", "cylinder")


@dataclass(frozen=True)
class SolidFace:
    """One face of a solid.

    Parameters
    ----------
    index
        Its place in ``solid.Faces()``; people count from 1.
    kind
        ``plane``, ``cylinder``, ``cone`` ...
    area
        [m^2].
    centroid, normal
        Of its area [m], and the outward unit normal there.
    radius, axis
        Of a cylinder [m], and the direction of its axis; 0 and None of others.
    name, colour
        What its file says; empty if nothing.
    shape
        Of the CAD kernel [mm].
    """

    index: int
    kind: str
    area: float
    centroid: Vector
    normal: Vector
    radius: float = 0.0
    axis: Vector | None = None
    name: str = ""
    colour: str = ""
    shape: Any = field(default=None, repr=False, compare=False)

    @property
    def label(self) -> str:
        """What people call it: its name, or its number."""
        return self.name or f"face {self.index + 1}"

    @property
    def place(self) -> str:
        """Where it is, in words."""
        return f"at {f'({in_mm(self.centroid)}) mm'} with the normal {_numbers(self.normal)}"


@dataclass(frozen=True)
class Query:
    """How a port names its faces: exactly one of name, colour and plane, or a point with a normal or an axis.

    Point and normal state where the face was, in case its name is lost. A point on the axis of a cylinder, or on it,
    means a cylinder with the `axis`, of a `radius` [m] if one is given, or else the nearest and narrowest.
    """

    names: tuple[str, ...] = ()
    colour: str = ""
    plane: str = ""
    point: Vector | None = None
    normal: Vector | None = None
    axis: Vector | None = None
    radius: float | None = None


def of_solid(solid: Any, names: Mapping[int, str], colours: Mapping[int, str]) -> tuple[SolidFace, ...]:
    """Return the faces of a CadQuery solid [mm]."""
    return tuple(_face(i, face, names.get(i, ""), colours.get(i, "")) for i, face in enumerate(solid.Faces()))


def _face(index: int, face: Any, name: str, colour: str) -> SolidFace:
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    kind, centre = face.geomType(), face.Center()
    normal = face.normalAt()  # of a curved face in its middle
    radius, axis = 0.0, None
    if kind == "CYLINDER":
        cylinder = BRepAdaptor_Surface(face.wrapped).Cylinder()
        way = cylinder.Axis().Direction()
        radius, axis = cylinder.Radius() * MM, (way.X(), way.Y(), way.Z())
    x, y, z = centre.toTuple()
    return SolidFace(
        index=index,
        kind=kind.lower(),
        area=face.Area() * MM**2,
        centroid=(x * MM, y * MM, z * MM),
        normal=normal.toTuple(),
        radius=radius,
        axis=axis,
        name=name,
        colour=colour,
        shape=face,
    )


def find(query: Query, faces: Sequence[SolidFace], where: tuple[Any, str], size: float) -> tuple[SolidFace, ...]:
    """Return the faces that a query means: of one plane, or of one cylinder.

    Parameters
    ----------
    query
        What is looked for.
    faces
        Of the solid.
    where
        File and field, for messages.
    size
        Diagonal of the solid's bounding box [m].

    Raises
    ------
    InputError
        If there is none, or it is neither plane nor a cylinder; it names the nearest face.
    """
    if query.names:
        found = [face for name in query.names for face in _find_by_name(name, query, faces, where)]
        text: object = ", ".join(query.names)
    elif query.colour:
        found, text = _find_by_colour(query.colour, faces, where), query.colour
    elif query.plane:
        found, text = _in_plane(query.plane, faces, where, size), query.plane
    else:
        found, text = _find_by_position(query, faces, where, size), None
    for face in found:
        if face.kind not in PORT_KINDS:
            remedy = f"{face.label} is a {face.kind}; a port is a plane or a cylinder{_nearest_plane(face, faces)}"
            raise InputError(*where, text, remedy)
    if any(face.kind == "cylinder" for face in found):
        if not all(is_of_one_cylinder(face, found[0], size) for face in found):
            listed = ", ".join(face.label for face in found)
            raise InputError(*where, text, f"its faces are not of one cylinder ({listed}); make a port of each")
        return tuple(found)
    normals, centroids = (np.array([getattr(face, key) for face in found]) for key in ("normal", "centroid"))
    heights = (centroids - centroids[0]) @ normals[0]
    if (normals @ normals[0]).min() < 1 - 1e-6 or np.abs(heights).max() > FLUSH * size:
        listed = ", ".join(face.label for face in found)
        raise InputError(*where, text, f"its faces lie in different planes ({listed}); make a port of each")
    return tuple(found)


def _find_by_name(name: str, query: Query, faces: Sequence[SolidFace], where: tuple[Any, str]) -> list[SolidFace]:
    found = [face for face in faces if face.name == name]
    if found:
        return found
    known = [face.name for face in faces if face.name]
    if query.point is not None:
        nearest = min(faces, key=lambda face: _away(face, query))
        candidates = (
            f"; nearest to where it was is {nearest.label}, {nearest.place}: {', '.join(how_to_name(nearest, faces))}"
        )
    elif close := difflib.get_close_matches(name, known, n=1, cutoff=0.5):
        nearest = next(face for face in faces if face.name == close[0])
        candidates = f"; the nearest name is {nearest.name}, {nearest.place}"
    elif known:
        candidates = suggest(name, known)
    else:
        largest = max((face for face in faces if face.kind == "plane"), key=lambda f: f.area, default=faces[0])
        candidates = f"; the file names no face; `flexdesign ports` lists them, the largest is {largest.place}"
    raise InputError(*where, name, f"no face has this name{candidates}")


def _find_by_colour(colour: str, faces: Sequence[SolidFace], where: tuple[Any, str]) -> list[SolidFace]:
    found = [face for face in faces if face.colour == colour.lower()]
    if not found:
        known = sorted({face.colour for face in faces if face.colour})
        candidates = f"; the file has {', '.join(known[:6])}" if known else "; the file gives faces no colours"
        raise InputError(*where, colour, f"no face has this colour{candidates}")
    return found


def _in_plane(text: str, faces: Sequence[SolidFace], where: tuple[Any, str], size: float) -> list[SolidFace]:
    """Return the plane faces in ``z = max``, ``x = min`` or ``y = 12 mm``, the outermost ones looking outwards."""
    axis, place = _plane(text, where)
    across = [f for f in faces if f.kind == "plane" and abs(f.normal[axis]) > 1 - 1e-6]
    if not across:
        raise InputError(*where, text, f"no plane face is normal to {'xyz'[axis]}; name the face, or give a point")
    if isinstance(place, str):
        sign = 1.0 if place == "max" else -1.0
        outer = [f for f in across if sign * f.normal[axis] > 0] or across
        wanted = sign * max(sign * f.centroid[axis] for f in outer)
        return [f for f in outer if abs(f.centroid[axis] - wanted) < FLUSH * size]
    found = [f for f in across if abs(f.centroid[axis] - place) < FLUSH * size]
    if not found:
        nearest = min(across, key=lambda f: abs(f.centroid[axis] - place))
        remedy = f"no plane face lies there; the nearest is {nearest.label}, {nearest.place}"
        raise InputError(*where, text, remedy)
    return found


def _plane(text: str, where: tuple[Any, str]) -> tuple[int, str | float]:
    matched = re.fullmatch(r"\s*([xyz])\s*=\s*(\S.*?)\s*", text)
    if matched and matched[2] in ("min", "max"):
        return "xyz".index(matched[1]), matched[2]
    try:
        if matched is None:
            raise ValueError
        return "xyz".index(matched[1]), units.from_text(matched[2], "m")
    except ValueError:
        remedy = 'expected a plane such as "z = max", "x = min" or "y = 12 mm"'
        raise InputError(*where, text, remedy) from None


def _find_by_position(query: Query, faces: Sequence[SolidFace], where: tuple[Any, str], size: float) -> list[SolidFace]:
    """Return the nearest face with the normal; of a plane cut in pieces all that meet at the point."""
    if query.point is not None and query.axis is not None:
        return _cylinder(query, faces, where, size)
    if query.point is None or query.normal is None:
        raise InputError(*where, None, 'names no face; give face, colour, plane = "z = max", or point and normal')
    fitting = [face for face in faces if np.dot(face.normal, query.normal) > DIRECTION]
    nearest = min(fitting or faces, key=lambda face: _away(face, query))
    if not fitting or _away(nearest, query) > REACH * size:
        remedy = f"no face with this normal is near this point; the nearest is {nearest.label}, {nearest.place}"
        raise InputError(*where, f"({in_mm(query.point)}) mm", remedy)
    if nearest.kind != "plane":
        return [nearest]
    level = [face for face in fitting if face.kind == "plane" and np.dot(face.normal, nearest.normal) > 1 - 1e-6]
    return [face for face in level if _away(face, query) < _away(nearest, query) + FLUSH * size]


def _cylinder(query: Query, faces: Sequence[SolidFace], where: tuple[Any, str], size: float) -> list[SolidFace]:
    """Return the nearest cylinder with the axis, and the pieces that it is cut into."""
    round_ones = [face for face in faces if face.kind == "cylinder"]
    fitting = [f for f in round_ones if f.axis is not None and abs(np.dot(f.axis, query.axis or ())) > DIRECTION]
    if query.radius is not None:
        fitting = [face for face in fitting if abs(face.radius - query.radius) < SAME_RADIUS * query.radius]

    def away(face: SolidFace) -> float:
        surface = _away(face, query)
        return min(surface, abs(surface - face.radius))  # of a point on the surface, or on the axis

    nearest = min(fitting or round_ones or faces, key=lambda face: (round(away(face) / (FLUSH * size)), face.radius))
    if not fitting or away(nearest) > REACH * size:
        radius = f" and the radius {nearest.radius / MM:.4g} mm" if nearest.radius else ""
        remedy = f"no cylinder like this is near this point; the nearest is {nearest.label}, {nearest.place}{radius}"
        raise InputError(*where, f"({in_mm(query.point or ())}) mm", remedy)
    found = [nearest]
    others = [face for face in fitting if face is not nearest and is_of_one_cylinder(face, nearest, size)]
    for _ in others:  # pieces may touch other pieces alone
        touching = [
            f for f in others if f not in found and any(f.shape.distance(g.shape) < FLUSH * size / MM for g in found)
        ]
        found += touching
    return found


def is_of_one_cylinder(one: SolidFace, other: SolidFace, size: float) -> bool:
    """Tell whether two faces lie on one cylinder, within a share of the solid's size [m]."""
    if one.axis is None or other.axis is None or abs(one.radius - other.radius) > FLUSH * size:
        return False
    between = np.cross(on_axis(one) - on_axis(other), other.axis)
    return bool(abs(np.dot(one.axis, other.axis)) > 1 - 1e-6 and np.linalg.norm(between) < FLUSH * size)


def on_axis(cylinder: SolidFace) -> NDArray[np.float64]:
    """Return the place on a cylinder's axis next to the middle of the face [m]."""
    from OCP.BRepAdaptor import BRepAdaptor_Surface

    place = BRepAdaptor_Surface(cylinder.shape.wrapped).Cylinder().Axis().Location()
    origin = np.array([place.X(), place.Y(), place.Z()]) * MM
    return np.asarray(
        origin + np.dot(np.array(cylinder.centroid) - origin, cylinder.axis or ()) * np.array(cylinder.axis)
    )


def _away(face: SolidFace, query: Query) -> float:
    """Return the distance of a query's point from a face [m]; of faces that hold it, the one about it is nearest."""
    import cadquery as cq

    point = np.array(query.point)
    vertex = cq.Vertex.makeVertex(*(point / MM))
    from_middle = float(np.linalg.norm(np.array(face.centroid) - point))
    return float(face.shape.distance(vertex)) * MM + 1e-6 * from_middle


def _nearest_plane(face: SolidFace, faces: Sequence[SolidFace]) -> str:
    planes = [each for each in faces if each.kind == "plane"]
    if not planes:
        return ""
    nearest = min(planes, key=lambda each: float(np.linalg.norm(np.subtract(each.centroid, face.centroid))))
    return f"; the nearest plane face is {nearest.label}, {nearest.place}"


def how_to_name(face: SolidFace, faces: Sequence[SolidFace]) -> list[str]:
    """Return the keys of a port's table that mean a face: its name, if no other has it, or a point on it.

    The middle of a ring is no point on it.
    """
    if face.name and sum(face.name == other.name for other in faces) == 1:
        return [f'face = "{face.name}"']
    place = on_axis(face) if face.axis else _point_on(face)
    point = ", ".join(f'"{round(1e3 * x, 6) + 0.0:.6g} mm"' for x in place)
    if face.axis:
        return [f"point = [{point}]", f"axis = [{_numbers(face.axis)}]", f'radius = "{1e3 * face.radius:.6g} mm"']
    return [f"point = [{point}]", f"normal = [{_numbers(face.normal)}]"]


def _point_on(face: SolidFace) -> Vector:
    """Return the middle of a face if it lies on it, or else a point inside its outline [m]."""
    import cadquery as cq
    from OCP.BOPTools import BOPTools_AlgoTools3D
    from OCP.gp import gp_Pnt, gp_Pnt2d
    from OCP.IntTools import IntTools_Context

    middle = cq.Vertex.makeVertex(*(np.array(face.centroid) / MM))
    if face.shape.distance(middle) < FLUSH * face.area**0.5 / MM:
        return face.centroid
    inside = gp_Pnt()
    if BOPTools_AlgoTools3D.PointInFace_s(face.shape.wrapped, inside, gp_Pnt2d(), IntTools_Context()):
        return face.centroid
    return inside.X() * MM, inside.Y() * MM, inside.Z() * MM


def in_mm(point: Sequence[float]) -> str:
    """Return the coordinates of a point [m] in millimetres, without the dust of rounding.

    >>> in_mm((0.021, -2.2e-20, 0.0255))
    '21, 0, 25.5'
    """
    return ", ".join(f"{round(1e3 * x, 6) + 0.0:.4g}" for x in point)


def _numbers(vector: Sequence[float]) -> str:
    return ", ".join(f"{round(x, 6) + 0.0:g}" for x in vector)

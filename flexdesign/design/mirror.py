"""In which coordinate planes a solid is its own mirror image, and so are its ports: found on the solid.

A solid and its mirror image are alike if their faces are, one by one: kind, area and centroid, and length and middle of
every edge; and if centre of mass and products of inertia are those of a body that mirrors onto itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from flexdesign.design.faces import MM, SolidFace
from flexdesign.design.part import Axis, Port, SymmetryPlane

FloatArray = NDArray[np.float64]

AXES: tuple[Axis, ...] = ("x", "y", "z")
#: Faces and edges are alike within this share of the solid's size, areas within that of its square.
ALIKE = 1e-6
#: A centre of mass lies in a plane within this share of the solid's size; moments of inertia agree within it.
BALANCED = 1e-7


def planes_of(solid: Any, faces: Sequence[SolidFace], ports: Sequence[Port]) -> tuple[SymmetryPlane, ...]:
    """Return the coordinate planes in which a CadQuery solid [mm] and its ports are their own mirror images.

    Rigid ports leave none, as a face that moves as one body is not cut.
    """
    if any(port.rigid and port.role != "ground" for port in ports):
        return ()
    size = solid.BoundingBox().DiagonalLength
    found = []
    for index, axis in enumerate(AXES):
        if not is_balanced(solid, index) or not _edges_mirror(solid, index, ALIKE * size):
            continue
        images = _images_of_faces(faces, index, ALIKE * size * MM)
        swaps = None if images is None else _swaps(ports, images, index, ALIKE * size * MM)
        if swaps is not None:
            found.append(SymmetryPlane(axis, swaps))
    return tuple(found)


def is_balanced(solid: Any, index: int) -> bool:
    """Tell whether centre of mass and products of inertia are those of a body that is its own mirror image."""
    import cadquery as cq

    size = solid.BoundingBox().DiagonalLength
    centre = np.array(cq.Shape.centerOfMass(solid).toTuple())
    inertia = np.array(cq.Shape.matrixOfInertia(solid))
    products = np.delete(inertia[index], index)
    return bool(abs(centre[index]) < BALANCED * size and np.abs(products).max() < BALANCED * np.abs(inertia).max())


def cut_port(port: Port, whole: Any, solid: Any) -> Port:
    """Return a port that is known by the places of its faces with the places of their remains on a cut solid."""
    if not port.faces or solid is whole:
        return port
    import cadquery as cq

    before = [whole.Faces()[index] for index in port.faces]
    near = 1e-7 * whole.BoundingBox().DiagonalLength
    left = []
    for index, face in enumerate(solid.Faces()):
        if face.geomType() != before[0].geomType():
            continue
        points, triangles = face.tessellate(1.0)
        if face.geomType() == "PLANE":
            if face.normalAt().dot(before[0].normalAt()) < 1 - 1e-9:
                continue
            points = [sum((points[corner] for corner in triangles[0]), cq.Vector()) / 3]
        inside = [cq.Vertex.makeVertex(*point.toTuple()) for point in points]
        if all(any(old.distance(place) < near for old in before) for place in inside):
            left.append(index)
    return replace(port, faces=tuple(left))


def mirrored(places: FloatArray, index: int) -> FloatArray:
    """Return the mirror images of places, shape (n, 3 or more), in the coordinate plane normal to an axis."""
    return places * np.where(np.arange(places.shape[1]) == index, -1.0, 1.0)


def _edges_mirror(solid: Any, index: int, near: float) -> bool:
    """Tell whether every edge has an image of its length, both within `near` [mm]."""
    edges = np.array([(*edge.Center().toTuple(), edge.Length()) for edge in solid.Edges()])
    away, _ = cKDTree(edges).query(mirrored(edges, index))
    return bool(away.max() < near)


def _images_of_faces(faces: Sequence[SolidFace], index: int, near: float) -> Mapping[int, int] | None:
    """Return the mirror image of each face, by index, places being alike within `near` [m]; None if one has none."""
    places = np.array([(*face.centroid, np.sqrt(face.area)) for face in faces])
    away, image = cKDTree(places).query(mirrored(places, index))
    kinds = np.array([face.kind for face in faces])
    if away.max() > near or np.any(kinds[image] != kinds):
        return None
    return dict(enumerate(image.tolist()))


def _swaps(ports: Sequence[Port], images: Mapping[int, int], index: int, near: float) -> dict[str, str] | None:
    """Return which ports the mirror exchanges, those on the positive side being kept; None if a port has no image."""
    swaps: dict[str, str] = {}
    for port in ports:
        reflected = {images[face] for face in port.faces}
        if reflected == set(port.faces):
            if abs(port.point[index]) > near or abs(port.normal[index]) > ALIKE:
                return None
            continue
        goal = mirrored(np.array([port.point]), index)[0]
        twin = next((other for other in ports if set(other.faces) == reflected and other.role == port.role), None)
        if twin is None or port.role == "ground" or np.abs(np.array(twin.point) - goal).max() > near:
            return None
        if np.abs(mirrored(np.array([port.normal]), index)[0] - twin.normal).max() > ALIKE:
            return None
        if port.point[index] < 0:
            swaps[port.name] = twin.name
    return swaps

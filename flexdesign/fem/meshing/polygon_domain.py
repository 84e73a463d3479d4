"""The fundamental domain of an extrusion with straight sides, from the corners of its section: no CAD kernel is asked.

A part that states its outline (`part.Outline`) is cut by its symmetry planes in the plane of the section and along the
extrusion. The domain is the same as that of the solid (`domain.of_part`) and comes some hundred times sooner, but its
ends are not tessellated: it can be extruded, and no other mesher could fill it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.core.result_cache import content_key
from flexdesign.design.materials import Material
from flexdesign.design.part import Axis, Outline, Piece, SymmetryPlane, extrusion_axis, straight_outline
from flexdesign.fem.meshing import domain
from flexdesign.fem.meshing.domain import Domain, Face
from flexdesign.fem.meshing.section import Curve, Section, encloses

FloatArray = NDArray[np.float64]

#: Corners nearer to one another, or to a plane, are taken as one, or as in it [m].
TOLERANCE = 1e-9


def of_part(part: Piece, *, material: Material | None = None) -> Domain | None:
    """Return the fundamental domain of a part that states its outline, or None of one that does not.

    Parameters
    ----------
    part
        The part.
    material
        What it is made of, as `domain.of_part` takes it.

    Raises
    ------
    InputError
        If the outline crosses itself or is not symmetric as the part says, or a port is not found on it.
    """
    axis, outline = extrusion_axis(part), straight_outline(part)
    if axis is None or outline is None:
        return None
    planes = domain.common_planes(part, material)
    sides, (low, high) = _sides(outline), (outline.low, outline.high)
    if _crossing(sides):
        raise InputError("part", "outline", None, "the outline crosses itself: the part cannot be built")
    for plane in planes:
        _require_mirrored(sides, low, high, plane, axis)
        along = _along(plane, axis)
        if along == 2:
            low = 0.0
        else:
            sides = _cut(sides, along)
    return _extrude(part, planes, sides, (low, high), axis)


def _extrude(
    part: Piece, planes: tuple[SymmetryPlane, ...], sides: FloatArray, ends: tuple[float, float], axis: Axis
) -> Domain:
    """Return the domain: a face to each side, in their order, then the low and the high end."""
    index, count = "xyz".index(axis), len(sides)
    outline = tuple(Curve(side, number) for number, side in enumerate(sides))
    section = Section(index, *ends, (count, count + 1), outline)
    normals = _outward(sides)
    quad = np.array([[0, 1, 2], [0, 2, 3]])
    faces = []
    for side, normal in zip(sides, normals, strict=True):
        points = np.concatenate([section.lifted(side, ends[0]), section.lifted(side[::-1], ends[1])])
        faces.append(_face(points, quad, section.lifted(normal[None], 0.0)[0]))
    for end, sign in zip(ends, (-1.0, 1.0), strict=True):
        points = section.lifted(sides[:, 0], end)
        faces.append(_face(points, np.empty((0, 3), dtype=np.int64), sign * np.eye(3)[index]))
    swapped = {name for plane in planes for name in plane.swaps}
    lengths = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1)
    area = float((sides.mean(axis=1) * normals).sum(axis=1) @ lengths / 2)  # int div x dA = 2 A = int x . n ds
    return Domain(
        faces=tuple(faces),
        planes=planes,
        ports={port.name: domain.face_of(port, faces) for port in part.ports() if port.name not in swapped},
        plane_faces=tuple(domain.faces_in(plane, faces) for plane in planes),
        volume=area * (ends[1] - ends[0]),
        fingerprint=content_key(sides, ends, axis),
        section=section,
    )


def _face(points: FloatArray, triangles: NDArray[np.int64], normal: FloatArray) -> Face:
    return Face(points, triangles, normal, float(normal @ points[0]))


def _sides(outline: Outline) -> FloatArray:
    """Return the ends of all sides, shape (k, 2, 2) [m]."""
    loops = [np.array(loop) for loop in outline.loops]
    return np.concatenate([np.stack([loop, np.roll(loop, -1, axis=0)], axis=1) for loop in loops])


def _along(plane: SymmetryPlane, axis: Axis) -> int:
    """Return the section's coordinate that a plane is normal to, 0 or 1, or 2 if it is the extrusion's."""
    return (plane.index - "xyz".index(axis) - 1) % 3


def _outward(sides: FloatArray) -> FloatArray:
    """Return the unit normals of sides that point out of what they enclose, shape (k, 2)."""
    ways = sides[:, 1] - sides[:, 0]
    normals = np.column_stack([ways[:, 1], -ways[:, 0]]) / np.linalg.norm(ways, axis=1, keepdims=True)
    inwards = encloses(sides, sides.mean(axis=1) + TOLERANCE * normals)
    return np.where(inwards[:, None], -normals, normals)


def _cut(sides: FloatArray, along: int) -> FloatArray:
    """Keep what lies at positive coordinates, and close it along the line where the coordinate is zero."""
    reach = np.where(np.abs(sides[:, :, along]) < TOLERANCE, 0.0, sides[:, :, along])  # (k, 2 ends)
    selected = sides[(reach >= 0).all(axis=1) & (reach > 0).any(axis=1)]
    across = sides[reach.prod(axis=1) < 0]
    inner = np.where(across[:, :1, along] > 0, 0, 1)[:, :, None]
    inside = np.take_along_axis(across, np.broadcast_to(inner, (len(across), 1, 2)), axis=1)[:, 0]
    share = -across[:, 0, along] / (across[:, 1, along] - across[:, 0, along])
    crossings = across[:, 0] + share[:, None] * (across[:, 1] - across[:, 0])
    crossings[:, along] = 0.0
    cut = np.stack([inside, crossings], axis=1)
    touching = selected[np.abs(selected[:, :, along]) < TOLERANCE]
    places = np.sort(np.concatenate([crossings, touching])[:, 1 - along])
    if not len(places) or len(places) % 2 or (np.diff(places) < TOLERANCE).any():
        raise InputError("part", "symmetry", "xyz"[along], "the plane cuts the outline in no even number of places")
    line = np.zeros((len(places) // 2, 2, 2))
    line[:, :, 1 - along] = places.reshape(-1, 2)
    return np.concatenate([selected, cut, line])


def _require_mirrored(sides: FloatArray, low: float, high: float, plane: SymmetryPlane, axis: Axis) -> None:
    """Refuse an outline that is not its own mirror image."""
    along = _along(plane, axis)
    if along == 2:
        mirrored = abs(low + high) < TOLERANCE
    else:
        corners = sides[:, 0]
        images = corners * np.where(np.arange(2) == along, -1.0, 1.0)
        # Earlier planes may have cut the outline; the corners are what must have images among themselves.
        gaps = np.linalg.norm(images[:, None] - sides.reshape(-1, 2)[None], axis=2).min(axis=1)
        mirrored = bool((gaps < TOLERANCE).all())
    if not mirrored:
        raise InputError("part", "symmetry", plane.axis, "the outline is not its own mirror image in this plane")


def _crossing(sides: Sequence[FloatArray] | FloatArray) -> bool:
    """Tell whether two sides cross between their ends."""
    a, b = np.asarray(sides)[:, 0], np.asarray(sides)[:, 1]

    def turn(p: FloatArray, q: FloatArray, r: FloatArray) -> FloatArray:
        u, v = q - p, r - p
        return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])

    one, two = turn(a[:, None], b[:, None], a[None]), turn(a[:, None], b[:, None], b[None])
    apart = (
        (one * two < 0) & (np.abs(one) > TOLERANCE**2) & (np.abs(two) > TOLERANCE**2)
    )  # ends on either side of the other
    return bool((apart & apart.T).any())

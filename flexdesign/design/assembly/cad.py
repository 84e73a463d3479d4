"""A stage as one CAD solid: its parts and boxes at their places, fused where they touch."""

from __future__ import annotations

from typing import Any

from flexdesign.design.assembly.stage import Assembly, Box, Placement

MM = 1e3


def solid(assembly: Assembly) -> Any:
    """Return a whole stage, frame included, as one CAD shape [mm].

    Parts and bodies touch in their bonded faces; fused, these faces are gone.
    """
    shapes = [_box(box) for body in assembly.bodies for box in body.boxes]
    for piece, elements in assembly.kinds():
        shape = piece.solid()
        shapes += [shape.moved(_location(element.placement)) for element in elements]
    return shapes[0].fuse(*shapes[1:]).clean()


def _box(box: Box) -> Any:
    import cadquery as cq

    corner = [MM * (centre - size / 2) for centre, size in zip(box.centre, box.size, strict=True)]
    return cq.Solid.makeBox(*(MM * size for size in box.size), pnt=cq.Vector(*corner))


def _location(placement: Placement) -> Any:
    import cadquery as cq

    origin = cq.Vector(*(MM * coordinate for coordinate in placement.origin))
    x, z = (cq.Vector(*placement.matrix[:, axis]) for axis in (0, 2))
    return cq.Location(cq.Plane(origin, x, z))

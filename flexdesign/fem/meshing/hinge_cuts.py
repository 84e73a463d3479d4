"""The bodies that the hinges of a solid join: what falls apart where each hinge is cut in its middle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexdesign.design.faces import MM, SolidFace
from flexdesign.fem.meshing.thin_regions import ThinRegions

#: A cut takes a fifth of a hinge's length, and reaches beyond it by half its thickness and a tenth of its width.
ALONG, ACROSS, WIDE = 0.2, 2.0, 1.2
#: A face is on a body that is no farther from it than this share of the solid's size.
NEAR = 1e-6


def bodies_of(solid: Any, faces: Sequence[SolidFace], thin: ThinRegions) -> tuple[int | None, ...]:
    """Return the body that each face of a CadQuery solid is on, by number; None if it is on several, or on a hinge."""
    import cadquery as cq

    cuts = []
    for hinge, on in zip(thin.hinges, thin.chosen, strict=True):
        along = np.subtract(hinge.end, hinge.start) / hinge.length
        across = thin.inward[on[0]] - (thin.inward[on[0]] @ along) * along
        plane = cq.Plane(tuple(np.array(hinge.centre) / MM), tuple(along), tuple(across))
        size = np.array([ALONG * hinge.length, WIDE * hinge.width, ACROSS * hinge.thickness]) / MM
        cuts.append(cq.Workplane(plane).box(*size.tolist()).val())
    bodies = solid.cut(*cuts).Solids() if cuts else [solid]
    near = NEAR * solid.BoundingBox().DiagonalLength
    found = [[i for i, body in enumerate(bodies) if face.shape.distance(body) < near] for face in faces]
    return tuple(on[0] if len(on) == 1 else None for on in found)

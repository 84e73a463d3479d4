"""A planar mechanism as a design file draws it: bodies, flexures between them, ground, inputs and output.

`reading` understands the tables, `drawing` holds what they say in numbers and refuses what is no mechanism, `section`
makes the plane section and the solid of it, `linkage` the members, their roots and the symmetry.
"""

from flexdesign.design.sketch.drawing import Body, Drawing, Flexure
from flexdesign.design.sketch.reading import KEYS, Plan, read
from flexdesign.design.sketch.section import Section

#: The part that a design names to draw it itself.
PART = "sketch"

__all__ = ["KEYS", "PART", "Body", "Drawing", "Flexure", "Plan", "Section", "read"]

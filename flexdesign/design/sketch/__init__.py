"""A planar mechanism as a design file draws it: bodies, flexures between them, ground, inputs and output.

`reading` understands the `tables`, `plan` turns them into numbers, `drawing` holds these and refuses what is no
mechanism, `section` makes the plane section, its symmetry and the solid, `linkage` the members and their roots.
"""

from flexdesign.design.sketch.drawing import Body, Drawing, Flexure
from flexdesign.design.sketch.plan import Plan
from flexdesign.design.sketch.reading import KEYS, read
from flexdesign.design.sketch.section import Section

#: The part that a design names to draw it itself.
PART = "sketch"

__all__ = ["KEYS", "PART", "Body", "Drawing", "Flexure", "Plan", "Section", "read"]

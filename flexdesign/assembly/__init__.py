"""Stages: parts between rigid bodies, and how to write one down."""

from flexdesign.assembly import cad
from flexdesign.assembly.branches import Bar, Branch, Leaf, centred, spanning, strung, turn, turned_box
from flexdesign.assembly.stage import Assembly, Axis, Body, Box, Element, Placement, Stage

__all__ = [
    "Assembly", "Axis", "Bar", "Body", "Box", "Branch", "Element", "Leaf", "Placement", "Stage", "cad",
    "centred", "spanning", "strung", "turn", "turned_box",
]  # fmt: skip

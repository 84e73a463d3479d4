"""Stages: parts between rigid bodies, and how to write one down."""

from flexdesign.design.assembly import cad
from flexdesign.design.assembly.branches import Bar, Branch, Leaf, centred, spanning, strung, turn, turned_box
from flexdesign.design.assembly.stage import Assembly, Axis, Body, Box, Element, Placement, Stage

__all__ = [
    "Assembly", "Axis", "Bar", "Body", "Box", "Branch", "Element", "Leaf", "Placement", "Stage", "cad",
    "centred", "spanning", "strung", "turn", "turned_box",
]  # fmt: skip

"""A leaf hinge between two stubs: the piece that guides and struts of a stage are made of.

Frame: x along the leaf, y across it, z along its width; it bends about z. The stubs are halves of what the hinge
joins, long enough that the stress about the leaf's roots has died down where they are bonded::

       +------+          +------+      ^ y
       |      |__________|      |      |
       | stub  ___leaf___  stub |      +--> x
       |      |    t     |      |
       +------+          +------+
         l_s       l        l_s
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from flexdesign.core.model import Linkage, Member, Parameter, Root
from flexdesign.core.model.linkage import MemberKind
from flexdesign.design.part import Axis, Port, SymmetryPlane


def _length(name: str, meaning: str, smallest: float, largest: float) -> Parameter:
    return Parameter(name, "m", "mm", meaning, plausible=(smallest, largest))


@dataclass(frozen=True)
class LeafHinge:
    """A leaf with a stub at each end, by its dimensions [m], named as in `dimensions`."""

    length: float
    thickness: float
    width: float
    stub_height: float
    stub_length: float

    dimensions: ClassVar[tuple[Parameter, ...]] = (
        _length("length", "length of the leaf along x", 1e-4, 5e-2),
        _length("thickness", "thickness of the leaf along y", 2e-5, 1e-2),
        _length("width", "width of leaf and stubs along z", 5e-4, 0.2),
        _length("stub_height", "height of a stub along y", 2e-4, 0.1),
        _length("stub_length", "length of a stub along x", 2e-4, 0.1),
    )

    @property
    def reach(self) -> float:
        """From the leaf's centre to the end of a stub [m]."""
        return self.length / 2 + self.stub_length

    def solid(self) -> Any:
        """Return leaf and stubs as one closed solid [mm]."""
        import cadquery as cq

        l, t, h, end = (1e3 * value / 2 for value in (self.length, self.thickness, self.stub_height, 2 * self.reach))
        upper = [(-end, h), (-l, h), (-l, t), (l, t), (l, h), (end, h)]
        around = upper + [(x, -y) for x, y in reversed(upper)]
        return cq.Workplane("XY").polyline(around).close().extrude(1e3 * self.width / 2, both=True).solids().val()

    def ports(self) -> tuple[Port, Port]:
        """Return the stubs' end faces, ``start`` at negative x and ``end``."""
        return (
            Port("start", "joint", (-self.reach, 0.0, 0.0), (-1.0, 0.0, 0.0)),
            Port("end", "joint", (self.reach, 0.0, 0.0), (1.0, 0.0, 0.0)),
        )

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return all three coordinate planes; in x = 0 the two ends swap."""
        return SymmetryPlane("x", {"start": "end"}), SymmetryPlane("y", {}), SymmetryPlane("z", {})

    def prismatic(self) -> Axis:
        """Return z: the hinge is cut from a plate."""
        return "z"

    def linkage(self) -> Linkage:
        """Return the leaf between its two stubs."""
        root = Root("end", self.stub_height)
        places = {"start": -self.reach, "root_start": -self.length / 2, "root_end": self.length / 2, "end": self.reach}
        nodes = {name: (x, 0.0, 0.0) for name, x in places.items()}

        def member(name: str, kind: MemberKind, first: str, second: str, thickness: float) -> Member:
            return Member(name, kind, (first, second), nodes[first], nodes[second], thickness, self.width)

        leaf = member("leaf", "hinge", "root_start", "root_end", self.thickness)
        members = (
            member("stub_start", "stub", "start", "root_start", self.stub_height),
            replace(leaf, roots=(root, root)),
            member("stub_end", "stub", "root_end", "end", self.stub_height),
        )
        return Linkage(nodes, members, {"start": "start", "end": "end"})

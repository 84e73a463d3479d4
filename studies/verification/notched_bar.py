"""A bar with a right-circular notch in its middle, held at one end: the neck is the origin, x along it, z its width."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from flexdesign.core.model import Linkage, Member, Parameter
from flexdesign.design.part import Axis, Port, SymmetryPlane


@dataclass(frozen=True)
class NotchedBar:
    """A notched bar by its dimensions [m], named as in `dimensions`."""

    neck: float
    radius: float
    width: float
    block: float

    dimensions: ClassVar[tuple[Parameter, ...]] = (
        Parameter("neck", "m", "mm", "thickness of the neck", plausible=(5e-5, 5e-3)),
        Parameter("radius", "m", "mm", "radius of the notch", plausible=(2e-4, 2e-2)),
        Parameter("width", "m", "mm", "width along z", plausible=(1e-3, 5e-2)),
        Parameter("block", "m", "mm", "length of the bar on either side of the notch", plausible=(1e-3, 5e-2)),
    )

    @property
    def half(self) -> float:
        """Half the height of the bar [m]."""
        return self.neck / 2 + self.radius

    @property
    def end(self) -> float:
        """From the neck to an end [m]."""
        return self.radius + self.block

    def solid(self) -> Any:
        """Return the bar as one closed solid [mm]."""
        import cadquery as cq

        bar = cq.Workplane("XY").box(2e3 * self.end, 2e3 * self.half, 1e3 * self.width)
        for side in (1, -1):
            circle = cq.Workplane("XY").circle(1e3 * self.radius).extrude(1e3 * self.width, both=True)
            bar = bar.cut(circle.translate((0, 1e3 * side * self.half, 0)))
        return bar.solids().val()

    def ports(self) -> tuple[Port, ...]:
        """Return both ends, of which one is held."""
        return (
            Port("output", "output", (self.end, 0.0, 0.0), (1.0, 0.0, 0.0)),
            Port("ground", "ground", (-self.end, 0.0, 0.0), (-1.0, 0.0, 0.0)),
        )

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return the plane z = 0."""
        return (SymmetryPlane("z", {}),)

    def prismatic(self) -> Axis:
        """Return z: the bar is cut from a plate."""
        return "z"

    def linkage(self) -> Linkage:
        """Return the notch."""
        ends = {"near": (-self.radius, 0.0, 0.0), "far": (self.radius, 0.0, 0.0)}
        notch = Member(
            "notch", "hinge", ("near", "far"), ends["near"], ends["far"], self.neck, self.width,
            curvature_radius=self.radius,
        )  # fmt: skip
        return Linkage(ends, (notch,))

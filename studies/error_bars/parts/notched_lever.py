"""A lever on a right-circular notch: two circles cut from a bar, one end held, the other with two bosses.

Frame: the neck is the origin, x along the bar, z along the width. The actuator pushes the input boss upwards, and the
output boss goes up at the other end::

                                    +--------+     ^ y
                                    | output |     |
    +--------+          +-----------+        |     +--> x
    |        .-        -.                    |
    | held     --neck--            lever     |
    |        .-        -.                    |
    +--------+          +---+       +--------+
                            | input |
                            +-------+
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from flexdesign.analytic import notch
from flexdesign.core.errors import InputError
from flexdesign.core.model import Linkage, Member, Parameter, Quantity
from flexdesign.design.materials import Material
from flexdesign.design.part import Axis, Port, SymmetryPlane


def _length(name: str, meaning: str, smallest: float, largest: float) -> Parameter:
    return Parameter(name, "m", "mm", meaning, plausible=(smallest, largest))


@dataclass(frozen=True)
class NotchedLever:
    """A lever on one notch, by its dimensions [m], named as in `dimensions`."""

    neck: float
    radius: float
    width: float
    held_length: float
    input_arm: float
    output_arm: float
    boss_width: float
    boss_height: float

    dimensions: ClassVar[tuple[Parameter, ...]] = (
        _length("neck", "thickness of the neck", 5e-5, 5e-3),
        _length("radius", "radius of the circles", 2e-4, 2e-2),
        _length("width", "width along z", 1e-3, 5e-2),
        _length("held_length", "bar from the notch to the held end", 1e-3, 5e-2),
        _length("input_arm", "from the neck to the middle of the input boss", 2e-3, 1e-1),
        _length("output_arm", "from the neck to the middle of the output boss", 4e-3, 2e-1),
        _length("boss_width", "width of a boss along x", 1e-3, 2e-2),
        _length("boss_height", "height of a boss", 5e-4, 2e-2),
    )

    #: How the notch is declared: by the radius of its circles, or as fillets that meet at the neck.
    by_fillets: ClassVar[bool] = False

    def __post_init__(self) -> None:
        shortest = 1.8 * self.radius + self.boss_width / 2
        if self.input_arm < shortest or self.output_arm < self.input_arm + 1.2 * self.boss_width:
            remedy = f"at least {1e3 * shortest:g} mm, and the output boss beyond the input boss"
            raise InputError("design", "dimensions.input_arm", f"{1e3 * self.input_arm:g} mm", remedy)

    @property
    def half(self) -> float:
        """Half the height of the bar [m]."""
        return self.neck / 2 + self.radius

    @property
    def end(self) -> float:
        """The x of the lever's end [m]."""
        return self.output_arm + self.boss_width / 2

    @property
    def start(self) -> float:
        """The x of the held end [m]."""
        return -self.radius - self.held_length

    def solid(self) -> Any:
        """Return the lever as one closed solid [mm]."""
        import cadquery as cq

        def box(x0: float, x1: float, y0: float, y1: float) -> Any:
            across = 1e3 * self.width
            plate = cq.Workplane("XY").box(1e3 * (x1 - x0), 1e3 * (y1 - y0), across)
            return plate.translate((500 * (x0 + x1), 500 * (y0 + y1), 0))

        b, top = self.boss_width / 2, self.half + self.boss_height
        bar = box(self.start, self.end, -self.half, self.half)
        for side in (1, -1):
            circle = cq.Workplane("XY").circle(1e3 * self.radius).extrude(1e3 * self.width, both=True)
            bar = bar.cut(circle.translate((0, 1e3 * side * self.half, 0)))
        bar = bar.union(box(self.input_arm - b, self.input_arm + b, -top, -self.half))
        bar = bar.union(box(self.output_arm - b, self.end, self.half, top))
        return bar.clean().solids().val()

    def ports(self) -> tuple[Port, ...]:
        """Return the face of the input boss, that of the output boss, and the held end."""
        y = self.half + self.boss_height
        return (
            Port("input", "input", (self.input_arm, -y, 0.0), (0.0, -1.0, 0.0)),
            Port("output", "output", (self.output_arm, y, 0.0), (0.0, 1.0, 0.0)),
            Port("ground", "ground", (self.start, 0.0, 0.0), (-1.0, 0.0, 0.0)),
        )

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return the plane z = 0."""
        return (SymmetryPlane("z", {}),)

    def prismatic(self) -> Axis:
        """Return z: the lever is cut from a plate."""
        return "z"

    def linkage(self) -> Linkage:
        """Return the notch and the lever, up to where the actuator pushes and to the output."""
        r = self.radius
        places = {"held": self.start, "near": -r, "far": r, "input": self.input_arm, "output": self.output_arm}
        nodes = {name: (x, 0.0, 0.0) for name, x in places.items()}
        declared = {"root_radius": r} if self.by_fillets else {"curvature_radius": r}
        bar = {"thickness": 2 * self.half, "width": self.width}
        ends = ("near", "far")
        members = (
            Member("block", "block", ("held", "near"), nodes["held"], nodes["near"], **bar),
            Member("hinge", "hinge", ends, nodes["near"], nodes["far"], self.neck, self.width, **declared),
            Member("lever_1", "arm", ("far", "input"), nodes["far"], nodes["input"], **bar),
            Member("lever_2", "arm", ("input", "output"), nodes["input"], nodes["output"], **bar),
        )
        return Linkage(nodes, members, {"ground": "held", "input": "input", "output": "output"})

    def formulas(
        self, material: Material, actuator_stiffness: float | None, output_load: float | None
    ) -> Mapping[str, Sequence[Quantity]]:
        """Return stiffness and amplification of a rigid lever on a notch (Paros and Weisbord 1965, in full)."""
        rotation, _ = notch.paros_weisbord(material.youngs_modulus, self.width, self.neck, self.radius)
        stiffness = 1 / (rotation * self.input_arm**2)
        return {
            "rigid lever": (
                Quantity("K_in", stiffness, "N/m", "N/mm", "output free", "1 / (C a^2)"),
                Quantity("lambda", self.output_arm / self.input_arm, "1", "", "output free", "b / a"),
            )
        }

    def formula_shares(self, material: Material) -> Mapping[str, Mapping[str, float]]:
        """Return nothing: all of the compliance is the notch's."""
        return {}

    def intermediates(self, material: Material, force: float) -> Mapping[str, Quantity]:
        """Return the moment at the neck and its stress."""
        moment = force * self.input_arm
        stress = 6 * moment / (self.width * self.neck**2)
        return {"M": Quantity("moment", moment, "N m", "N m"), "sigma": Quantity("stress", stress, "Pa", "MPa")}

"""Shell of the amplified actuator APA300ML: four arms at 10 degrees between two ends and two mounting pads.

The outline is that of the published STEP file. The file fills the inside with the envelope of the stacks. Here the
inside is the outline offset by the thickness of the arms, as at the pads, where the file draws both sides. A seat for
the stacks reaches inwards from each end. The screw holes in the pads are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from flexdesign import Linkage, Parameter, SymmetryPlane
from flexdesign.design.part import Axis, Port


@dataclass(frozen=True)
class Apa300mlShell:
    """Four arms between two ends, which the stacks push apart, and two mounting pads.

    Parameters
    ----------
    thickness, width, stack_length, seat_height
        See `dimensions` [m].
    """

    thickness: float
    width: float
    stack_length: float
    seat_height: float

    dimensions = (
        Parameter("thickness", "m", "mm", "thickness of the arms", plausible=(5e-4, 3e-3)),
        Parameter("width", "m", "mm", "width of the shell", plausible=(5e-3, 0.05)),
        Parameter("stack_length", "m", "mm", "distance between the seats", plausible=(0.05, 0.07)),
        Parameter("seat_height", "m", "mm", "height of a seat of the stacks", plausible=(2e-3, 0.011)),
    )

    def solid(self) -> Any:
        """Return the shell, in millimetres."""
        import cadquery as cq

        t, w = 1e3 * self.thickness, 1e3 * self.width
        seat = cq.Workplane("XY").box(20, 1e3 * self.seat_height, w)
        middle = 500 * self.stack_length + 10
        inside = _inside(t, w).cut(seat.translate((middle, 0, 0))).cut(seat.translate((-middle, 0, 0)))
        return _outline(w).cut(inside).val()

    def ports(self) -> tuple[Port, ...]:
        """Return both seats as inputs, the upper pad as output and the lower as ground."""
        x = self.stack_length / 2
        return (
            Port("input_left", "input", (-x, 0.0, 0.0), (1.0, 0.0, 0.0)),
            Port("input_right", "input", (x, 0.0, 0.0), (-1.0, 0.0, 0.0)),
            Port("output", "output", (0.0, 1e-3 * TOP, 0.0), (0.0, 1.0, 0.0)),
            Port("ground", "ground", (0.0, -1e-3 * TOP, 0.0), (0.0, -1.0, 0.0)),
        )

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return the planes between the seats and in the middle of the width."""
        return (SymmetryPlane("x", {"input_left": "input_right"}), SymmetryPlane("z", {}))

    def linkage(self) -> Linkage:
        """Return none: thin regions are found on the solid."""
        return Linkage({}, ())

    def prismatic(self) -> Axis:
        """Return the axis along which the section is extruded."""
        return "z"


# From the STEP file [mm]: a mounting pad, the arcs at an arm's root and at an end with their outer radii; the slope.
TOP, HALF_PAD, CORNER = 15.00105, 4.5, 0.7
ROOT, ROOT_RADIUS = (5.2, 1.762624), 11.0
END, END_RADIUS = (33.540102, 2.0), 5.8568
SLOPE = math.radians(9.976)


def _on(centre: tuple[float, float], radius: float, angle: float) -> tuple[float, float]:  # a point of an arc
    return centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle)


def _curved(plane: Any, offset: float) -> Any:
    """Draw the right upper side, `offset` inside the outline, from an arm's root to the middle of the end."""
    root, end, up = ROOT_RADIUS - offset, END_RADIUS - offset, math.pi / 2 - SLOPE
    plane = plane.threePointArc(_on(ROOT, root, up + SLOPE / 2), _on(ROOT, root, up)).lineTo(*_on(END, end, up))
    return plane.threePointArc(_on(END, end, up / 2), _on(END, end, 0.0)).lineTo(_on(END, end, 0.0)[0], 0.0)


def _mirrored(quarter: Any) -> Any:  # the whole solid from its first quadrant
    half = quarter.union(quarter.mirror("YZ"))
    return half.union(half.mirror("XZ")).clean()


def _outline(w: float) -> Any:
    import cadquery as cq

    shoulder, sunk = ROOT[1] + ROOT_RADIUS, CORNER * (1 - math.sqrt(0.5))
    plane = cq.Workplane("XY").workplane(offset=-w / 2).lineTo(0, TOP).lineTo(HALF_PAD, TOP)
    plane = plane.lineTo(HALF_PAD, shoulder + CORNER)
    plane = plane.threePointArc((HALF_PAD + sunk, shoulder + sunk), (ROOT[0], shoulder))
    return _mirrored(_curved(plane, 0.0).close().extrude(w))


def _inside(t: float, w: float) -> Any:
    import cadquery as cq

    inner = ROOT[1] + ROOT_RADIUS - t
    plane = cq.Workplane("XY").workplane(offset=-w / 2).lineTo(0, inner).lineTo(ROOT[0], inner)
    return _mirrored(_curved(plane, t).close().extrude(w))

"""Rhombic bridge amplifier with eight right-angle leaf hinges and flexible input rods.

Frame: the actuator sits on the x axis between the input blocks and pushes them apart; the output block moves along
y; z is the width. The upper right quarter, seen from the front (the others are its mirror images)::

    +--------+                                    y
    | output |                                    ^
    | block  |==== . _                            |
    +--------+      ` - . _ arm        +----+     +--> x
    :   hinge             ` - . _ =====| r  |
    :     :                    hinge   | o  |  ^
    :     :<-------- l_x -------->:    | d  |  | l_1
    :                                  |l_3 |  v
                                     +-+    +-+  --
    - - - - - - - actuator - - - - - |  input  | - - -
                                     |  block  |

The two hinge centres of an arm are l_x apart along x and l_y along y. In the bridge drawn here the output end lies
farther from the axis than the input end (convex, l_y > 0): pushing the inputs apart draws the output in, and the
amplification is negative. In a concave bridge (l_y < 0) the arms fall towards the output, pushing the inputs apart
pushes the output out, and the amplification is positive.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar

from flexdesign.analytic import lagrange, prb, textbook
from flexdesign.analytic.compliance import ComplianceModel, nominal_effects
from flexdesign.core.errors import InputError
from flexdesign.core.model import Formulas, Linkage, Member, Parameter, Quantity, Root, by_key
from flexdesign.core.model.linkage import Vector
from flexdesign.design.materials import Material
from flexdesign.design.part import Axis, Outline, Port, SymmetryPlane

#: The least that an arm may rise or fall between its hinges, |l_y| [m].
FLATTEST = 5e-5


def _length(name: str, meaning: str, smallest: float, largest: float, symbol: str = "") -> Parameter:
    return Parameter(name, "m", "mm", meaning, plausible=(smallest, largest), symbol=symbol)


@dataclass(frozen=True)
class BridgeAmplifier:
    """A bridge amplifier by its dimensions [m], named as in `dimensions`."""

    arm_span: float
    arm_offset: float
    arm_thickness: float
    hinge_length: float
    hinge_thickness: float
    width: float
    rod_length: float
    rod_thickness: float
    input_block_height: float
    input_block_depth: float
    block_width: float
    output_block_height: float
    ground_block_height: float
    fillet_radius: float

    dimensions: ClassVar[tuple[Parameter, ...]] = (
        _length("arm_span", "distance between an arm's hinge centres along x", 2e-3, 0.2, "l_x"),
        _length("arm_offset", "rise of an arm from outer to inner hinge centre; negative: concave", -5e-2, 5e-2, "l_y"),
        _length("arm_thickness", "thickness of an arm, measured along y", 2e-4, 5e-2),
        _length("hinge_length", "length of a hinge leaf along x", 1e-4, 5e-2),
        _length("hinge_thickness", "thickness of a hinge leaf", 2e-5, 1e-2, "t"),
        _length("width", "width of the whole amplifier along z", 5e-4, 0.2, "w"),
        _length("rod_length", "input rod from the input block to the hinge; 0 for no rod", 0.0, 0.1, "l_1"),
        _length("rod_thickness", "thickness of the input rod along x", 2e-4, 5e-2, "l_3"),
        _length("input_block_height", "height of the block the actuator pushes", 1e-3, 0.2),
        _length("input_block_depth", "depth of the block the actuator pushes, along x", 2e-4, 0.1),
        _length("block_width", "width of output and ground block along x", 5e-4, 0.2),
        _length("output_block_height", "height of the output block", 5e-4, 0.1),
        _length("ground_block_height", "height of the ground block", 5e-4, 0.1),
        _length("fillet_radius", "fillet at the hinge roots; 0 for sharp roots", 0.0, 5e-3),
    )

    def __post_init__(self) -> None:
        for p in self.dimensions:
            self._require(p.name, *p.plausible)
        self._require("hinge_thickness", upper=0.9 * self.arm_thickness, why="a hinge is thinner than its arm")
        self._require("hinge_length", upper=0.9 * self.arm_span, why="the two hinges of an arm must not meet")
        self._require_slope()
        self._require("output_block_height", self.arm_thickness, why="the block covers the arm's end")
        self._require("ground_block_height", self.arm_thickness, why="the block covers the arm's end")
        self._require_room()
        if self.fillet_radius > 0:
            self._require(
                "fillet_radius", 1e-2 * self.hinge_thickness, why="0 for sharp roots; smaller ones cannot be meshed"
            )
            tightest = 0.45 * min(self.hinge_length, self.arm_thickness - self.hinge_thickness)
            self._require("fillet_radius", upper=tightest, why="two fillets must fit on a hinge and on an arm's end")

    def _require_slope(self) -> None:
        """Refuse arms that are too flat or too steep, rising or falling."""
        why = "flat arms amplify nothing; the offset of a concave bridge is negative"
        if self.arm_offset < 0:
            self._require("arm_offset", upper=-FLATTEST, why=why)
        else:
            self._require("arm_offset", FLATTEST, why=why)
        steepest, why = self.arm_span - self.hinge_length, "arms steeper than 45 degrees are no bridge amplifier"
        self._require("arm_offset", upper=steepest, why=why)
        self._require("arm_offset", -steepest, why=why)

    def _require_room(self) -> None:
        """Refuse arms and blocks that run into the actuator, the input blocks or each other.

        The limits of concave bridges keep their output and ground block where those of convex ones keep the outer ends
        of the arms: with rods, off an actuator as high as the face that it pushes; without, off the actuator's axis.
        """
        if self.rod_length > 0:
            clear = 0.55 * self.arm_thickness
            self._require("rod_length", clear, why="0 for no rod; else the arm overlaps the input block")
            why = "arms that fall farther take output and ground block into the actuator: longer rods"
            self._require("arm_offset", clear - self.rod_length, why=why)
            thicker, thickest = 1.05 * self.rod_thickness, self.rod_thickness + 1.8 * self.rod_face
            why = "the block stands out from the rod on both sides and leaves room for the actuator"
            self._require("input_block_depth", thicker, thickest, why)
        else:
            clear = 2.1 * self.arm_thickness
            self._require("input_block_height", clear, why="without rods the block must carry both arms")
            why = "arms that fall farther take output and ground block to the actuator's axis: a higher input block"
            self._require("arm_offset", (clear - self.input_block_height) / 2, why=why)

    def _require(self, name: str, lower: float = -math.inf, upper: float = math.inf, why: str = "") -> None:
        value = getattr(self, name)
        slack = 1e-9 * abs(value)  # a limit is allowed, however it was rounded
        if lower - slack <= value <= upper + slack:  # false for NaN
            return
        allowed = f"{lower * 1e3:g} mm" if math.isfinite(lower) else ""
        allowed += " to " if allowed and math.isfinite(upper) else ""
        allowed += f"{upper * 1e3:g} mm" if math.isfinite(upper) else " or more"
        if not math.isfinite(lower):
            allowed = f"at most {allowed}"
        reason = f" ({why})" if why else ""
        raise InputError("design", f"dimensions.{name}", f"{value * 1e3:g} mm", f"allowed: {allowed}{reason}")

    # --- where things are -------------------------------------------------------------------------------------

    @property
    def outer_hinge(self) -> tuple[float, float]:
        """Centre (x, y) of the upper right hinge at the input rod [m]."""
        x = self.block_width / 2 + self.hinge_length / 2 + self.arm_span
        if self.rod_length > 0:
            return x, self.input_block_height / 2 + self.rod_length
        return x, self.input_block_height / 2 - self.arm_thickness / 2

    @property
    def inner_hinge(self) -> tuple[float, float]:
        """Centre (x, y) of the upper right hinge at the output block [m]."""
        return self.block_width / 2 + self.hinge_length / 2, self.outer_hinge[1] + self.arm_offset

    @property
    def rod_face(self) -> float:
        """The x of the rod's inner face, where the outer hinge ends [m]."""
        return self.outer_hinge[0] + self.hinge_length / 2

    @property
    def input_block(self) -> tuple[float, float]:
        """The x of the input block's inner face, which the actuator pushes, and of its outer face [m]."""
        inner = self.rod_face
        if self.rod_length > 0:
            inner -= (self.input_block_depth - self.rod_thickness) / 2
        return inner, inner + self.input_block_depth

    def outer_corners(self, block_height: float) -> list[tuple[float, float]]:
        """Corners of the outer contour of one quarter, from the end block to the input block [m]."""
        (xi, yi), (xo, yo) = self.inner_hinge, self.outer_hinge
        l, t, a = self.hinge_length / 2, self.hinge_thickness / 2, self.arm_thickness / 2
        outer, corner = self.rod_face + self.rod_thickness, (self.input_block[1], self.input_block_height / 2)
        rod = [(outer, yo + a), (outer, corner[1])] if self.rod_length > 0 else []
        return [
            (xi - l, yi - a + block_height), (xi - l, yi + t), (xi + l, yi + t), (xi + l, yi + a),
            (xo - l, yo + a), (xo - l, yo + t), (xo + l, yo + t), (xo + l, yo + a), *rod, corner,
        ]  # fmt: skip

    def inner_corners(self) -> list[tuple[float, float]]:
        """Corners of the inner contour of one quarter, from the end block to the input block [m]."""
        (xi, yi), (xo, yo) = self.inner_hinge, self.outer_hinge
        l, t, a = self.hinge_length / 2, self.hinge_thickness / 2, self.arm_thickness / 2
        corner = self.input_block_height / 2
        block = [(self.rod_face, corner), (self.input_block[0], corner)] if self.rod_length > 0 else []
        return [
            (xi - l, yi - a), (xi - l, yi - t), (xi + l, yi - t), (xi + l, yi - a),
            (xo - l, yo - a), (xo - l, yo - t), (xo + l, yo - t), *block,
        ]  # fmt: skip

    # --- what the engine asks ---------------------------------------------------------------------------------

    def solid(self) -> Any:
        """Return the amplifier as one closed solid [mm]."""
        import cadquery as cq

        outer, inner = ([(x * 1e3, y * 1e3) for x, y in loop] for loop in self._loops())
        front = cq.Workplane("XY").polyline(outer).close().polyline(inner).close()
        body = front.extrude(self.width * 1e3 / 2, both=True)
        if self.fillet_radius > 0:
            body = body.newObject(self._root_edges(body)).fillet(self.fillet_radius * 1e3)
        return body.solids().val()

    def _loops(self) -> tuple[list[tuple[float, float]], list[tuple[float, float]]]:
        """Return the corners of the outer and the inner contour of the whole amplifier, roots sharp [m]."""

        def ring(upper: list[tuple[float, float]], lower: list[tuple[float, float]]) -> list[tuple[float, float]]:
            right = upper + [(x, -y) for x, y in reversed(lower)]
            return right + [(-x, y) for x, y in reversed(right)]

        outer = ring(self.outer_corners(self.output_block_height), self.outer_corners(self.ground_block_height))
        return outer, ring(self.inner_corners(), self.inner_corners())

    def outline(self) -> Outline | None:
        """Return both contours, extruded over the width; None with fillets, as only straight sides can be stated."""
        if self.fillet_radius > 0:
            return None
        return Outline(self._loops(), -self.width / 2, self.width / 2)

    def _root_edges(self, body: Any) -> list[Any]:
        """Return the edges along z at which a leaf meets its arm, rod or block."""
        leaves = self.linkage().of_kind("hinge")
        half = self.hinge_thickness / 2
        roots = [
            (1e3 * x, 1e3 * (y + side * half))
            for leaf in leaves
            for x, y, _ in (leaf.start, leaf.end)
            for side in (1, -1)
        ]
        edges = []
        for edge in body.edges("|Z").vals():
            centre = edge.Center()
            if any(math.dist(root, (centre.x, centre.y)) < 1e-6 for root in roots):
                edges.append(edge)
        return edges

    def ports(self) -> tuple[Port, ...]:
        """Return the two input faces, the output face and the ground face."""
        y, a, x = self.inner_hinge[1], self.arm_thickness / 2, self.input_block[0]
        return (
            Port("input_left", "input", (-x, 0.0, 0.0), (1.0, 0.0, 0.0)),
            Port("input_right", "input", (x, 0.0, 0.0), (-1.0, 0.0, 0.0)),
            Port("output", "output", (0.0, y - a + self.output_block_height, 0.0), (0.0, 1.0, 0.0)),
            Port("ground", "ground", (0.0, -(y - a + self.ground_block_height), 0.0), (0.0, -1.0, 0.0)),
        )

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return the planes x = 0 (left and right input swap) and z = 0."""
        return SymmetryPlane("x", {"input_left": "input_right"}), SymmetryPlane("z", {})

    def prismatic(self) -> Axis:
        """Return z: the amplifier is cut from a plate."""
        return "z"

    def linkage(self) -> Linkage:
        """Return eight hinges, four arms and, where there are any, four rods, quarter by quarter."""
        nodes: dict[str, Vector] = {
            "output": (0.0, self.inner_hinge[1], 0.0),
            "ground": (0.0, -self.inner_hinge[1], 0.0),
        }
        members: list[Member] = []
        for quarter, sx, sy in (("ur", 1, 1), ("ul", -1, 1), ("lr", 1, -1), ("ll", -1, -1)):
            members += self._quarter(quarter, sx, sy, nodes)
        ports = {"input_left": "input_left", "input_right": "input_right", "output": "output", "ground": "ground"}
        return Linkage(nodes, tuple(members), ports)

    def _quarter(self, quarter: str, sx: int, sy: int, nodes: dict[str, Vector]) -> list[Member]:
        (xi, yi), (xo, yo) = self.inner_hinge, self.outer_hinge
        l, with_rod = self.hinge_length / 2, self.rod_length > 0
        end, inlet = "output" if sy > 0 else "ground", "input_right" if sx > 0 else "input_left"
        # The rod stands on the middle of the input block; without a rod the block itself runs up to the hinge.
        axis, foot = sum(self.input_block) / 2, self.input_block_height / 2 if with_rod else yo

        def at(x: float, y: float) -> Vector:
            return (sx * x, sy * y, 0.0)

        inner, outer, tip = f"arm_inner_{quarter}", f"arm_outer_{quarter}", f"rod_tip_{quarter}"
        heel = f"block_end_{quarter}"
        nodes |= {inner: at(xi + l, yi), outer: at(xo - l, yo), heel: at(axis, foot)}
        nodes[inlet] = at(self.input_block[0], 0.0)
        slope = math.atan2(self.arm_offset, self.arm_span - self.hinge_length)
        leaf = {"thickness": self.hinge_thickness, "width": self.width, "root_radius": self.fillet_radius}
        near, far = self._roots(sx * sy)
        members = [
            Member(f"hinge_inner_{quarter}", "hinge", (end, inner), at(xi - l, yi), at(xi + l, yi), **leaf, roots=near),
            Member(
                f"arm_{quarter}", "arm", (inner, outer), at(xi + l, yi), at(xo - l, yo),
                self.arm_thickness * math.cos(slope), self.width,
            ),
        ]  # fmt: skip
        if with_rod:
            nodes[tip] = at(axis, yo)
            rod_roots = (None, Root("end", self.input_block_depth))
            members.append(
                Member(
                    f"rod_{quarter}", "rod", (tip, heel), nodes[tip], nodes[heel],
                    self.rod_thickness, self.width, roots=rod_roots, lever=sx * sy * (xo - axis),
                )
            )  # fmt: skip
        members += [
            Member(
                f"hinge_outer_{quarter}", "hinge", (outer, tip if with_rod else heel),
                at(xo - l, yo), at(xo + l, yo), **leaf, roots=far,
            ),
            Member(
                f"block_{quarter}", "block", (heel, inlet), nodes[heel], at(axis, 0.0),
                self.input_block_depth, self.width,
            ),
        ]  # fmt: skip
        return members

    def _roots(self, left: int) -> tuple[tuple[Root, Root], tuple[Root, Root]]:
        """Return what the inner and the outer hinge run into; `left` is 1 where outwards is to the left of them.

        The inner hinge sits half an arm's thickness above the lower edge of its block, the outer one as far below the
        end of the rod, or of the input block.
        """
        arm, half = Root("end", self.arm_thickness), self.arm_thickness / 2
        inwards, outwards = (-1, 1) if left > 0 else (1, -1)
        across = self.rod_thickness if self.rod_length > 0 else self.input_block_depth
        block = Root("block", self.block_width / 2, half, inwards)
        flank = Root("flank", across, half, outwards, height=self.outer_hinge[1])
        return (block, arm), (arm, flank)

    def formulas(
        self, material: Material, actuator_stiffness: float | None, output_load: float | None
    ) -> Mapping[str, Sequence[Quantity]]:
        """Return the paper's pseudo-rigid-body model, the textbook bridge and the compliance model.

        lambda counts along the output's normal.
        """

        def pseudo_rigid() -> Sequence[Quantity]:
            model = self._pseudo_rigid(material)
            found = prb.quantities(model, actuator_stiffness=actuator_stiffness)
            loaded = {} if output_load is None else prb.quantities(model, output_load)
            return _outwards(found | loaded | by_key(self.free_vibration(material).quantities()))

        def by_textbook() -> Sequence[Quantity]:
            return _outwards(textbook.quantities(self._textbook(material), actuator_stiffness))

        def compliant() -> Sequence[Quantity]:
            model = ComplianceModel.of_part(self, material, actuator_stiffness)
            return tuple(model.having(nominal_effects(self)).quantities().values())

        return Formulas({"PRB": pseudo_rigid, "textbook": by_textbook, "compliance": compliant})

    def free_vibration(self, material: Material) -> lagrange.Coordinate:
        """Return M_b and K_b of eqs. (18) and (19), m_1 an input block with its two rods, m_3 the output block."""
        per_area, model = material.density * self.width, self._pseudo_rigid(material)
        arm, high = self.arm_span - self.hinge_length, self.arm_thickness
        block = self.input_block_depth * self.input_block_height + 2 * self.rod_thickness * self.rod_length
        return lagrange.amplifier(
            input_block=per_area * block, output_block=per_area * self.block_width * self.output_block_height,
            arm_inertia=per_area * arm * high * (arm**2 + high**2) / 12, hinge_stiffness=model.hinge_stiffness,
            arm_span=self.arm_span, amplification=abs(model.amplification()),
        )  # fmt: skip

    def formula_shares(self, material: Material) -> Mapping[str, Mapping[str, float]]:
        """Return what the pseudo-rigid-body model's compliances consist of [m/N]."""
        model = self._pseudo_rigid(material)
        return {
            "K_in_output_free": {
                "hinge bending": model.arm_input_displacement(1.0),
                "rod bending": model.rod_tip_deflection(1.0),
            },
            "K_out_input_free": {"hinge bending": 1 / model.output_stiffness},
            "K_out_input_held": {"rod bending": 1 / model.output_stiffness_with_input()},
        }

    def intermediates(self, material: Material, force: float) -> Mapping[str, Quantity]:
        """Return every quantity of the pseudo-rigid-body model under an actuator force [N], output free.

        Signed as in the paper: what moves inwards is positive.
        """
        return prb.intermediates(self._pseudo_rigid(material), force)

    def _pseudo_rigid(self, material: Material) -> prb.PseudoRigidBridge:
        return prb.PseudoRigidBridge(
            youngs_modulus=material.youngs_modulus,
            width=self.width,
            hinge_thickness=self.hinge_thickness,
            hinge_length=self.hinge_length,
            arm_span=self.arm_span,
            arm_offset=self.arm_offset,
            rod_length=self.rod_length,
            rod_thickness=self.rod_thickness,
        )

    def _textbook(self, material: Material) -> textbook.TextbookBridge:
        return textbook.TextbookBridge.of_leaves(**asdict(self._pseudo_rigid(material)))


def _outwards(found: Mapping[str, Quantity]) -> Sequence[Quantity]:
    """Return quantities with the output's motion counted outwards, as ports do; the paper counts it inwards."""
    return tuple(replace(q, value=-q.value) if q.name == "lambda" else q for q in found.values())

r"""XYZ stage after Lin et al. (2019): four amplifiers with parallel guides in X/Y, four series pairs with guides in Z.

The table stands on four struts and is held sideways by eight limbs, and every way to it runs over an amplifier. Four
equal branches lie around it, a quarter turn apart. Seen along y, the branch at positive x::

              table       limbs, two abreast       block   X amplifier
            +-------+            L_1               +----+               |//
            | + + + |--o--o================o--o----|    |------< >------|//  frame
            +---+---+                              +----+               |//
              rib   \__           z               guided along x
                  o             ^
                  o             |
                  |  strut      +--> x
                  |   L_2    [   bridge   ]  guided along z
                  o          |            |
                  o       convex       concave
               [  carrier  ]  Z amplifiers |
                guided along z           frame

*X and Y.* The amplifier at the far end of a branch moves its block along the branch. Two limbs, each with a hinge about
z at either end, L_1 apart, carry the motion to the table and let it go sideways: a parallel guide. Next to each of
these hinges is one about the other axis, for the table's way along z. Opposite amplifiers work in push and pull.

*Z.* The concave amplifier stands on the frame and lifts the bridge by half the travel when its actuator extends; the
convex one hangs from the bridge and draws the carrier up by the other half. A strut with hinges about both axes, L_2
apart, joins carrier and table, and tilts as the table moves sideways.

*Guides* are pairs of arms with a hinge at either end, from block, bridge and carrier to the frame.

Lin, Yu, Wu, Shen (2019), Decoupling and control of micromotion stage based on hysteresis of piezoelectric actuation,
Microsystem Technologies, show no dimensions. The topology is what their text and equations (18) to (25) say: amplifiers
and hinges in number, half the travel for each Z amplifier, arms of length L_1 and L_2 that tilt. The rest is ours.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, ClassVar

from flexdesign.analytic.branched_stage import BranchedAxis, Hinges, Masses, as_the_paper_counts
from flexdesign.analytic.prb import PseudoRigidBridge
from flexdesign.core.errors import InputError
from flexdesign.core.model import Parameter, Quantity
from flexdesign.core.model.linkage import Vector
from flexdesign.design import part
from flexdesign.design.assembly import Assembly, Axis, Body, Box, cad
from flexdesign.design.assembly.branches import Bar, Branch, Leaf, centred, spanning, strung
from flexdesign.design.materials import Material

X, Y, Z, DOWN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)
#: Branches, counted from positive x against the clock, by the side of the table they lie on.
SIDES = ("x_plus", "y_plus", "x_minus", "y_minus")
#: Between parts of different branches, and around what moves [m].
CLEARANCE = 3e-3


def _length(name: str, meaning: str, smallest: float, largest: float, symbol: str = "") -> Parameter:
    return Parameter(name, "m", "mm", meaning, plausible=(smallest, largest), symbol=symbol)


@cache
def _class(name: str, methods: tuple[str, ...]) -> Any:
    """Return the class of a part, loaded once: a model of the stage is made for hundreds of dimensions."""
    return part.load(name, methods=methods)


#: What all amplifiers share, by the names of the bridge amplifier's dimensions.
SHARED = (
    "arm_span", "arm_thickness", "hinge_length", "hinge_thickness", "width", "rod_thickness", "input_block_height",
    "input_block_depth", "block_width", "output_block_height", "ground_block_height", "fillet_radius",
)  # fmt: skip


@dataclass(frozen=True)
class XYZStage:
    """The stage by its dimensions [m], named as in `dimensions`."""

    arm_span: float
    arm_thickness: float
    hinge_length: float
    hinge_thickness: float
    width: float
    rod_thickness: float
    input_block_height: float
    input_block_depth: float
    block_width: float
    output_block_height: float
    ground_block_height: float
    fillet_radius: float
    xy_arm_offset: float
    xy_rod_length: float
    z_arm_offset: float
    z_rod_length: float
    limb_length: float
    limb_thickness: float
    limb_height: float
    limb_spacing: float
    limb_hinge_thickness: float
    cross_hinge_thickness: float
    strut_radius: float
    strut_length: float
    strut_thickness: float
    strut_hinge_thickness: float
    guide_length: float
    guide_width: float
    guide_hinge_thickness: float
    table_size: float
    table_height: float
    body_thickness: float
    lateral_branches: float = 4.0

    dimensions: ClassVar[tuple[Parameter, ...]] = (
        _length("arm_span", "distance between an amplifier arm's hinge centres along its input", 2e-3, 0.2, "l_x"),
        _length("arm_thickness", "thickness of an amplifier's arm", 2e-4, 5e-2),
        _length("hinge_length", "length of all hinge leaves", 1e-4, 5e-2),
        _length("hinge_thickness", "thickness of an amplifier's hinge leaves", 2e-5, 1e-2, "t"),
        _length("width", "width of the amplifiers", 5e-4, 0.2, "w"),
        _length("rod_thickness", "thickness of an amplifier's input rods", 2e-4, 5e-2, "l_3"),
        _length("input_block_height", "height of the blocks the actuators push", 1e-3, 0.2),
        _length("input_block_depth", "depth of the blocks the actuators push", 2e-4, 0.1),
        _length("block_width", "width of an amplifier's output and ground block", 5e-4, 0.2),
        _length("output_block_height", "height of an amplifier's output block", 5e-4, 0.1),
        _length("ground_block_height", "height of an amplifier's ground block", 5e-4, 0.1),
        _length("fillet_radius", "fillet at the amplifiers' hinge roots; 0 for sharp roots", 0.0, 5e-3),
        _length("xy_arm_offset", "distance between hinge centres along the output, X/Y amplifiers", 5e-5, 5e-2, "l_y"),
        _length("xy_rod_length", "length of the input rods, X/Y amplifiers", 0.0, 0.1, "l_1"),
        _length("z_arm_offset", "distance between hinge centres along the output, Z amplifiers", 5e-5, 5e-2, "l_y"),
        _length("z_rod_length", "length of the input rods, Z amplifiers", 0.0, 0.1, "l_1"),
        _length("limb_length", "distance between the hinges of a limb that bend about z", 5e-3, 0.5, "L_1"),
        _length("limb_thickness", "thickness of a limb in the plane", 5e-4, 5e-2),
        _length("limb_height", "height of a limb along z", 5e-4, 5e-2),
        _length("limb_spacing", "distance between the two limbs of a branch", 2e-3, 0.5),
        _length("limb_hinge_thickness", "thickness of the limbs' leaves that bend about z", 2e-5, 1e-2),
        _length("cross_hinge_thickness", "thickness of the limbs' leaves that bend in z", 2e-5, 1e-2),
        _length("strut_radius", "distance of the struts from the table's axis", 2e-3, 0.5),
        _length("strut_length", "distance between the hinges of a strut that bend along its branch", 5e-3, 0.5, "L_2"),
        _length("strut_thickness", "side of a strut's square section", 5e-4, 5e-2),
        _length("strut_hinge_thickness", "thickness of the struts' leaves", 2e-5, 1e-2),
        _length("guide_length", "distance between the hinges of a guide's arm", 5e-3, 0.5),
        _length("guide_width", "side of the square section of a guide's arm", 5e-4, 5e-2),
        _length("guide_hinge_thickness", "thickness of the guides' hinge leaves", 2e-5, 1e-2),
        _length("table_size", "side of the table", 5e-3, 0.5),
        _length("table_height", "height of the table", 1e-3, 0.1),
        _length("body_thickness", "thickness of lateral blocks, bridges, carriers, ribs and frame", 1e-3, 0.1),
        Parameter("lateral_branches", "1", "", "4, or 2 for X and Y amplifiers on one side alone", plausible=(2, 4)),
    )

    def __post_init__(self) -> None:
        if self.lateral_branches not in (2, 4):
            raise InputError("design", "dimensions.lateral_branches", self.lateral_branches, "must be 2 or 4")

    # --- parts ------------------------------------------------------------------------------------------------

    @cached_property
    def xy_amplifier(self) -> Any:
        """The amplifier of X and Y."""
        return self._amplifier(self.xy_arm_offset, self.xy_rod_length)

    @cached_property
    def convex(self) -> Any:
        """The amplifier of Z that hangs."""
        return self._amplifier(self.z_arm_offset, self.z_rod_length)

    @cached_property
    def concave(self) -> Any:
        """The amplifier of Z that stands."""
        return self._amplifier(-self.z_arm_offset, self.z_rod_length)

    def _amplifier(self, offset: float, rod: float) -> Any:
        shared = {name: getattr(self, name) for name in SHARED}
        return _class("bridge_amplifier", part.METHODS)(arm_offset=offset, rod_length=rod, **shared)

    def _leaf(self, thickness: float, width: float, height: float) -> Any:
        """Return a hinge, its stubs half as long as their section is high or, if that is more, the leaf is long."""
        stub = max(min(width, height), self.hinge_length) / 2
        return _class("leaf_hinge", part.PIECE_METHODS)(
            length=self.hinge_length, thickness=thickness, width=width, stub_height=height, stub_length=stub
        )

    # --- where things are: the branch at positive x ------------------------------------------------------------

    @property
    def _rib(self) -> Vector:
        """Size of a rib, which carries the table on the strut: twice as high as other bodies are thick."""
        return self.strut_radius + self.strut_thickness / 2, self.strut_thickness, 2 * self.body_thickness

    @property
    def _convex_x(self) -> float:
        return self.strut_radius + self.strut_thickness / 2 + CLEARANCE + self.width / 2

    @property
    def _concave_x(self) -> float:
        return self._convex_x + self.width + CLEARANCE

    def _limb(self) -> list[Leaf | Bar]:
        cross = Leaf(self._leaf(self.cross_hinge_thickness, self.limb_thickness, self.limb_height), Y)
        hinge = Leaf(self._leaf(self.limb_hinge_thickness, self.limb_height, self.limb_thickness), Z)
        section = (0.0, self.limb_thickness, self.limb_height)
        link, bar = Bar(self.hinge_length, section), Bar(self.limb_length - 2 * hinge.piece.reach, section)
        return [cross, link, hinge, bar, hinge, link, cross]

    def _strut(self) -> list[Leaf | Bar]:
        leaf = self._leaf(self.strut_hinge_thickness, self.strut_thickness, self.strut_thickness)
        along, across = Leaf(leaf, Y), Leaf(leaf, X)
        section = (self.strut_thickness, self.strut_thickness, 0.0)
        link, bar = Bar(self.hinge_length, section), Bar(self.strut_length - 2 * leaf.reach, section)
        return [across, link, along, bar, along, link, across]

    def _guide(self, axis: Vector) -> list[Leaf | Bar]:
        leaf = Leaf(self._leaf(self.guide_hinge_thickness, self.guide_width, self.guide_width), axis)
        section = (self.guide_width, 0.0, self.guide_width)
        return [leaf, Bar(self.guide_length - 2 * leaf.piece.reach, section), leaf]

    # --- the branch at positive x ------------------------------------------------------------------------------

    def _sideways(self) -> Branch:
        """Return limbs, block, its guides and the X amplifier."""
        limb, branch = self._limb(), Branch()
        near = self.table_size / 2 + sum(piece.length for piece in limb)
        far, w = near + 3 * self.guide_width, self.guide_width
        breadth, height = self.limb_spacing + self.limb_thickness, centred(self.limb_height)
        face = far + self.limb_thickness
        plate = spanning((near, far), centred(breadth), height)
        pad = spanning((far, face), centred(self.block_width), centred(self.width))
        branch.bodies.append(Body("block", (plate, pad)))
        for name, y in (("right", -self.limb_spacing / 2), ("left", self.limb_spacing / 2)):
            branch += strung(f"limb_{name}", (self.table_size / 2, y, 0.0), X, limb, "table", "block")
        for name, x in (("near", near + w / 2), ("far", far - w / 2)):
            branch += self._guided(f"guide_{name}", "block", (x, breadth / 2, 0.0), Z)
        output, ground = _reach(self.xy_amplifier)
        branch.put("amplifier", self.xy_amplifier, (face + output, 0.0, 0.0), Y, (-1.0, 0.0, 0.0), "block")
        wall = face + output + ground
        back = (wall, wall + self.body_thickness)
        branch.frame.append(spanning(back, centred(2 * self.block_width), (self._floor, self.width / 2)))
        return branch

    def _upward(self) -> Branch:
        """Return strut, carrier, both Z amplifiers, bridge and guides."""
        branch, strut, t = Branch(), self._strut(), self.body_thickness
        branch += strung("strut", (self.strut_radius, 0.0, self._rib_bottom), DOWN, strut, "table", "carrier")
        x2, x1, half, depth = self._convex_x, self._concave_x, self.width / 2, centred(self.block_width)
        top = self._carrier_top
        carrier = spanning((self.strut_radius - self.strut_thickness / 2, x2 + half), depth, (top - t, top))
        output, ground = _reach(self.convex)
        branch.put("convex", self.convex, (x2, 0.0, top + output), Y, DOWN, "carrier", "bridge")
        under = top + output + ground
        bridge = spanning((x2 - half, x1 + half), depth, (under, under + t))
        output, ground = _reach(self.concave)
        branch.put("concave", self.concave, (x1, 0.0, under - output), Y, Z, "bridge")
        branch.frame.append(spanning(centred(self.width, x1), depth, (self._floor, under - output - ground)))
        branch.bodies += [Body("carrier", (carrier,)), Body("bridge", (bridge,))]
        for body, x, z in (("bridge", x1, under + t / 2), ("carrier", x2, top - t / 2)):
            place = (x + half - self.guide_width / 2, self.block_width / 2, z)
            branch += self._guided(f"{body}_guide", body, place, X)
        return branch

    def _guided(self, name: str, body: str, place: Vector, axis: Vector) -> Branch:
        """Return arms from a body to the frame at either side, along y, that bend about an axis, and their posts."""
        guide, w, branch = self._guide(axis), self.guide_width, Branch()
        x, y, z = place
        end = y + sum(piece.length for piece in guide)
        for hand, side in (("right", -1.0), ("left", 1.0)):
            branch += strung(f"{name}_{hand}", (x, side * y, z), (0.0, side, 0.0), guide, body, "frame")
            near, far = sorted((side * end, side * (end + w)))
            branch.frame.append(spanning(centred(w, x), (near, far), (self._floor, z + w / 2)))
        return branch

    @property
    def _rib_bottom(self) -> float:
        return -self.table_height / 2 - self._rib[2]

    @property
    def _carrier_top(self) -> float:
        return self._rib_bottom - sum(piece.length for piece in self._strut())

    @property
    def _floor(self) -> float:
        """The z of the base plate's top."""
        return self._carrier_top - self.body_thickness - CLEARANCE

    # --- what the engine asks ----------------------------------------------------------------------------------

    def assembly(self) -> Assembly:
        """Return table, frame and the four branches."""
        sideways, upward = self._sideways(), self._upward()
        sides = SIDES[: int(self.lateral_branches)]
        branches = [upward.turned(quarter, side) for quarter, side in enumerate(SIDES)]
        branches += [sideways.turned(quarter, side) for quarter, side in enumerate(sides)]
        frame = [box for branch in branches for box in branch.frame]
        reach = max(abs(box.centre[0]) + box.size[0] / 2 for box in frame)
        base = spanning((-reach, reach), (-reach, reach), (self._floor - self.body_thickness, self._floor))
        bodies = [Body("table", self._table()), Body("frame", (base, *frame), fixed=True)]
        bodies += [body for branch in branches for body in branch.bodies]
        elements = [element for branch in branches for element in branch.elements]
        lateral = {f"{side}_amplifier": -1.0 if side.endswith("minus") else 1.0 for side in sides}
        axes = {
            "x": Axis(X, {name: sign for name, sign in lateral.items() if name.startswith("x")}),
            "y": Axis(Y, {name: sign for name, sign in lateral.items() if name.startswith("y")}),
            "z": Axis(Z, {f"{side}_{kind}": 1.0 for side in SIDES for kind in ("concave", "convex")}),
        }
        return Assembly(tuple(bodies), tuple(elements), "table", (0.0, 0.0, self.table_height / 2), axes)

    def solid(self) -> Any:
        """Return the whole stage as one CAD shape [mm]."""
        return cad.solid(self.assembly())

    def formulas(
        self, material: Material, actuator_stiffness: float | None, output_load: float | None
    ) -> Mapping[str, Sequence[Quantity]]:
        """Return the stage as the paper's equation (21) counts its springs, and as they are counted here."""
        axes = self._axes(material)
        counted = [quantity for axis in axes for quantity in axis.quantities()]
        paper = as_the_paper_counts(axes, self.limb_length, self._masses(material))
        return {"paper (21)": paper, "springs counted": counted}

    def springs(self, material: Material) -> Mapping[str, Sequence[tuple[str, int, Quantity, str]]]:
        """Return what the table's motion bends, by axis."""
        tables = {name: axis.coordinate.table() for axis in self._axes(material) for name in axis.names}
        return {name: [row for row in rows if row[2].si == "N/m"] for name, rows in tables.items()}

    def arms(self) -> Mapping[tuple[str, str], float]:
        """Return L_1 for X and Y, L_2 for Z, and for what Z does to X and Y the distance of the limbs' cross hinges."""
        across = self.limb_length + 2 * _apart(self._limb())
        return {
            ("y", "x"): self.limb_length, ("x", "y"): self.limb_length, ("z", "x"): self.strut_length,
            ("z", "y"): self.strut_length, ("x", "z"): across, ("y", "z"): across,
        }  # fmt: skip

    def _masses(self, material: Material) -> Masses:
        """Return what moves; a guide of Z is half a bridge and, for its arm, which turns, a third of that."""
        bodies = [*self._sideways().bodies, *self._upward().bodies, Body("table", self._table())]
        mass = {body.name: material.density * body.volume for body in bodies}
        return Masses(
            table=mass["table"],
            guide=mass["bridge"] / 2 + mass["bridge_guide_left_1"] / 3,
            amplifier_xy=self.xy_amplifier.free_vibration(material).mass,
            amplifier_z=self.convex.free_vibration(material).mass,
            block=mass["block"],
            carrier=mass["carrier"],
            limb=mass["limb_left_3"],
            strut=mass["strut_3"],
        )

    def _axes(self, material: Material) -> tuple[BranchedAxis, BranchedAxis]:
        xy, z = (
            PseudoRigidBridge(
                youngs_modulus=material.youngs_modulus, width=self.width, hinge_thickness=self.hinge_thickness,
                hinge_length=self.hinge_length, arm_span=self.arm_span, arm_offset=offset, rod_length=rod,
                rod_thickness=self.rod_thickness,
            )
            for offset, rod in ((self.xy_arm_offset, self.xy_rod_length), (self.z_arm_offset, self.z_rod_length))
        )  # fmt: skip
        sides, leaf = int(self.lateral_branches) // 2, self.hinge_length
        guide = (self.guide_hinge_thickness, self.guide_width, leaf, self.guide_length)
        strut = (self.strut_hinge_thickness, self.strut_thickness, leaf)
        limb, cross = self.limb_hinge_thickness, self.cross_hinge_thickness
        sideways = (
            Hinges("limb hinges", 4 * sides, limb, self.limb_height, leaf, self.limb_length),
            Hinges("guide hinges of the blocks", 8 * sides, *guide),
            Hinges("strut hinges along", 4, *strut, self.strut_length),
            Hinges("strut hinges across", 4, *strut, self.strut_length + 2 * _apart(self._strut())),
        )
        across = self.limb_length + 2 * _apart(self._limb())
        upwards = (
            Hinges("cross hinges of the limbs", 8 * sides, cross, self.limb_thickness, leaf, across),
            Hinges("guide hinges of the bridges", 16, *guide, share=0.5),
            Hinges("guide hinges of the carriers", 16, *guide),
        )
        masses = self._masses(material)
        return (
            BranchedAxis(("x", "y"), xy, sides, 1.0, sideways, masses.sideways(sides)),
            BranchedAxis(("z",), z, 8, 0.5, upwards, masses.upwards(sides)),
        )

    def _table(self) -> tuple[Box, ...]:
        """Return the plate and, under it, a cross of ribs from strut to strut."""
        size, (length, thick, high) = centred(self.table_size), self._rib
        z, half = (self._rib_bottom, self._rib_bottom + high), thick / 2
        arms = [(half, length), (-length, -half)]
        return (
            spanning(size, size, centred(self.table_height)),
            spanning((-length, length), (-half, half), z),
            *(spanning((-half, half), arm, z) for arm in arms),
        )


def _apart(pieces: list[Leaf | Bar]) -> float:
    """Return how far the first two hinges of a string are apart [m]."""
    first, link, second = pieces[:3]
    return first.length / 2 + link.length + second.length / 2


def _reach(amplifier: Any) -> tuple[float, float]:
    """Return how far output and ground face lie from an amplifier's centre [m]."""
    faces = {port.role: abs(port.point[1]) for port in amplifier.ports() if port.role != "input"}
    return faces["output"], faces["ground"]

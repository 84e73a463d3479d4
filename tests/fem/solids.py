"""Small bodies for the tests: structured meshes that need no mesher, and parts that need no file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import cadquery as cq
import numpy as np
import scipy.sparse as sp

from flexdesign.core.model import Linkage, Parameter, Quantity
from flexdesign.design.materials import Material
from flexdesign.design.part import Axis, Port, SymmetryPlane
from flexdesign.fem.solving import port_compliance, statics
from flexdesign.fem.solving.elasticity import Elasticity
from flexdesign.fem.solving.port_compliance import PortSpace
from flexdesign.fem.solving.statics import Checks
from studies.verification.solids import METAL, Array, Solid, at, lattice

#: The design of a part that is held and used at its ends in x.
PORTS = """format = 1
part = "part.step"
material = "Al 7075-T6"

[ports.ground]
plane = "x = min"

[ports.output]
plane = "x = max"
interface = "{interface}"
"""


@dataclass
class Solved:
    """All symmetry classes of a solid, solved for all port loads."""

    solid: Solid
    body: Elasticity
    stiffness: sp.csr_matrix
    space: PortSpace
    matrix: Array
    checks: list[Checks] = field(default_factory=list)
    systems: list[statics.ClassSystem] = field(default_factory=list)
    displacements: list[Array] = field(default_factory=list)


def solve(solid: Solid) -> Solved:
    """Solve every class; the factors stay, for modes."""
    body = solid.body
    stiffness = body.stiffness()
    space = port_compliance.port_space(body, solid.domain, solid.ports)
    found = Solved(solid, body, stiffness, space, np.zeros((space.size, space.size)))
    for cls in port_compliance.classes(solid.domain):
        system = statics.class_system(body, solid.domain, cls, stiffness, [solid.domain.ports["ground"]])
        share, checks, displacements, _ = statics.class_compliance(body, system, stiffness, space)
        found.matrix += share
        found.checks.append(checks)
        found.systems.append(system)
        found.displacements.append(displacements)
    return found


def notched(size: tuple[float, float, float], neck: float, *, at: float = 0.0) -> cq.Workplane:
    """Return a block of edges `size` [mm] with two round notches of radius 3 mm about a `neck` [mm] in y, `at` in x."""
    block = cq.Workplane().box(*size)
    for side in (1, -1):
        block = block.cut(cq.Workplane(origin=(at, side * (3 + neck / 2), 0)).circle(3).extrude(10, both=True))
    return block


def full(upper: sp.csr_matrix) -> sp.csr_matrix:
    """Return the symmetric matrix that `upper` is the upper triangle of."""
    return (upper + sp.triu(upper, k=1).T).tocsr()


def relative(found: Array, expected: Array) -> float:
    """Return the largest difference of two compliances, entry by entry, against the geometric mean of its diagonals."""
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    return float(np.abs((found - expected) / scale).max())


# --- bodies -----------------------------------------------------------------------------------------------------


RING_X, RING_Y, RING_Z = 20e-3, 15e-3, 4e-3
RING_PLANES = (SymmetryPlane("x", {"input_left": "input_right"}), SymmetryPlane("z", {}))
RING_PORTS = (
    Port("input_left", "input", (-14e-3, 0.0, 0.0), (1.0, 0.0, 0.0)),
    Port("input_right", "input", (14e-3, 0.0, 0.0), (-1.0, 0.0, 0.0)),
    Port("output", "output", (0.0, RING_Y, 0.0), (0.0, 1.0, 0.0)),
    Port("ground", "ground", (0.0, -RING_Y, 0.0), (0.0, -1.0, 0.0)),
)
RING_PATCHES = {
    "input_right": at("x", 14e-3, ("y", -5e-3, 5e-3)),
    "input_left": at("x", -14e-3, ("y", -5e-3, 5e-3)),
    "output": at("y", RING_Y, ("x", -5e-3, 5e-3)),
    "ground": at("y", -RING_Y, ("x", -10e-3, 10e-3)),
}


def ring(material: Material = METAL) -> Solid:
    """Return a quarter of a ring like an amplifier's: thicker below than above, mirror images in x = 0 and z = 0."""
    x = np.array([0.0, 5e-3, 10e-3, 14e-3, 17e-3, RING_X])
    y = np.array([-RING_Y, -11e-3, -8e-3, -5e-3, 0.0, 5e-3, 12e-3, RING_Y])
    z = np.linspace(0.0, RING_Z, 3)

    def inside(c: Array) -> Array:
        return (c[:, 0] > 14e-3) | (c[:, 1] < -8e-3) | (c[:, 1] > 12e-3)

    kept = {name: RING_PATCHES[name] for name in ("input_right", "output", "ground")}
    return Solid.of(lattice(x, y, z, inside, wobble=3e-4), kept, RING_PORTS, RING_PLANES, material)


# --- parts ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Bracket:
    """An upright T on a foot: mirror images in x = 0 and z = 0, an input on each side, plane faces only."""

    depth: float = 6e-3
    dimensions: ClassVar[tuple[Parameter, ...]] = ()

    def solid(self) -> Any:
        """Return the T [mm]."""
        import cadquery as cq

        outline = [(-4, 0), (4, 0), (4, 9), (9, 9), (9, 13), (-9, 13), (-9, 9), (-4, 9)]
        return cq.Workplane("XY").polyline(outline).close().extrude(self.depth * 500, both=True).solids().val()

    def ports(self) -> tuple[Port, ...]:
        """Return the ends of the bar, its top and the foot."""
        return (
            Port("input_left", "input", (-9e-3, 11e-3, 0.0), (-1.0, 0.0, 0.0)),
            Port("input_right", "input", (9e-3, 11e-3, 0.0), (1.0, 0.0, 0.0)),
            Port("output", "output", (0.0, 13e-3, 0.0), (0.0, 1.0, 0.0)),
            Port("ground", "ground", (0.0, 0.0, 0.0), (0.0, -1.0, 0.0)),
        )

    def linkage(self) -> Linkage:
        """Return no members."""
        return Linkage({}, ())

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return both planes."""
        return RING_PLANES

    def prismatic(self) -> Axis | None:
        """Return z."""
        return "z"

    def formulas(self, material: Material, actuator_stiffness: float | None) -> Mapping[str, Sequence[Quantity]]:
        """Return none."""
        return {}

    def formula_shares(self, material: Material) -> Mapping[str, Mapping[str, float]]:
        """Return none."""
        return {}

    def intermediates(self, material: Material, force: float) -> Mapping[str, Quantity]:
        """Return none."""
        return {}


def misplaced(part: Any, name: str, **changes: Any) -> Any:
    """Return the part with one port changed."""

    class Misplaced(type(part)):  # type: ignore[misc]
        def ports(self) -> tuple[Port, ...]:
            return tuple(replace(port, **changes) if port.name == name else port for port in part.ports())

    return Misplaced()

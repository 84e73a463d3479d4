"""The notched lever by hexahedra: its plan, patch by patch, and its solution.

The plan has the patches of `bridge.Roots` on both sides of the neck, and columns of the bar from there. Half the width
is solved.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from studies.error_bars.bridge import Fineness, Roots
from studies.error_bars.hexahedra import Array, Body, Plan, sheared_patch


class Lever(Protocol):
    """What the reference reads of the part `NotchedLever`; lengths in metres."""

    neck: float
    radius: float
    width: float
    input_arm: float
    output_arm: float
    boss_width: float
    boss_height: float
    half: float
    start: float
    end: float


@dataclass(frozen=True)
class LeverReference:
    """Port compliances of the lever, as `bridge.Reference` has them of an amplifier [m/N]."""

    C11: float
    C12: float
    C22: float
    n_dof: int

    @property
    def quantities(self) -> dict[str, float]:
        """Stiffnesses [N/m] and amplification, by key."""
        return {
            "K_in_output_free": 1 / self.C11,
            "lambda_output_free": self.C12 / self.C11,
            "K_out_input_free": 1 / self.C22,
            "K_out_input_held": 1 / (self.C22 - self.C12**2 / self.C11),
        }


def plan(part: Lever, fineness: Fineness) -> Plan:
    """Return the plan of a lever."""
    roots = Roots(part.neck, part.radius, 2 * part.half, fineness)
    cut, near, bulk = roots.cut, roots.at_root, roots.bulk
    foot = 2 * fineness.root * part.boss_width
    patches = [*roots.fillets(-part.radius, 0.0, -1, 0.0), *roots.fillets(part.radius, 0.0, 1, 0.0)]
    lines, b = roots.core(), part.boss_width / 2
    behind = part.radius + roots.depth
    first, last = part.input_arm - b, part.input_arm + b
    bar = [
        cut(behind, first, near, foot), cut(first, last, foot, foot), cut(last, part.output_arm - b, foot, foot),
        cut(part.output_arm - b, part.end, foot, bulk),
    ]  # fmt: skip
    patches.append(sheared_patch(cut(part.start, -behind, bulk, near), lines))
    patches += [sheared_patch(columns, lines) for columns in bar]
    top = part.half + part.boss_height
    rise = cut(part.half, top, foot, bulk)
    patches += [sheared_patch(bar[1], -rise[::-1]), sheared_patch(bar[3], rise)]
    return Plan.of(patches)


def solve(part: Lever, youngs_modulus: float, poissons_ratio: float, fineness: Fineness) -> LeverReference:
    """Solve a lever on one mesh.

    Raises
    ------
    ValueError
        If the mesh does not fill the part's contour.
    """
    flat = plan(part, fineness)
    r, bosses = part.radius, 2 * part.boss_width * part.boss_height
    area = 2 * part.half * (part.end - part.start) + bosses - np.pi * r**2
    if abs(flat.area() / area - 1) > 2e-3 * r**2 / area:
        raise ValueError(f"the part covers {area:.9g} m^2 and the mesh {flat.area():.9g} m^2")
    layers = Roots(part.neck, part.radius, 2 * part.half, fineness).layers(part.width)
    near, top = 1e-9 * float(np.ptp(flat.nodes)), part.half + part.boss_height

    def is_fixed(nodes: Array, z: Array) -> Array:
        held = np.zeros((len(nodes), 3, z.size), dtype=bool)
        held[:, 2, 0] = True
        held[nodes[:, 0] < part.start + near] = True
        return held

    body = Body(flat, layers, youngs_modulus, poissons_ratio, is_fixed)
    pushed = body.average(lambda x, y: y < -top + near, 1)
    output = body.average(lambda x, y: y > top - near, 1)
    moved = body.solve(np.column_stack([pushed / 2, output / 2]))
    body.release()
    c = np.array([pushed @ moved, output @ moved])
    return LeverReference(float(c[0, 0]), float(c[1, 0]), float(c[1, 1]), body.free.size)

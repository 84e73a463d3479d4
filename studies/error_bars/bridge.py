"""The bridge amplifier by hexahedra: its plan, patch by patch, and its solution.

The part is symmetric in x = 0 and z = 0: a quarter is solved, and forces on the whole part are shared out. Around a
rounded root the plan has these patches: the leaf's end between the fillets' lower halves (A), their upper halves and
the body behind them (B), and the core between (C); a sharp root has none of them::

      leaf      | A  /: B   | body
    ------------+---' +-----+-----
                |     :  C  |
    ------------+---. +-----+-----
                |    \\: B   |
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from studies.error_bars.hexahedra import (
    Array,
    Body,
    Plan,
    graded_lines,
    join_lines,
    ruled_patch,
    sheared_patch,
    with_middles,
)

HALF_A_FILLET = np.pi / 4


class Bridge(Protocol):
    """What the reference reads of the part `BridgeAmplifier`; lengths in metres."""

    arm_span: float
    arm_offset: float
    arm_thickness: float
    hinge_length: float
    hinge_thickness: float
    width: float
    rod_length: float
    rod_thickness: float
    input_block_height: float
    output_block_height: float
    ground_block_height: float
    fillet_radius: float
    outer_hinge: tuple[float, float]
    inner_hinge: tuple[float, float]
    rod_face: float
    input_block: tuple[float, float]

    def outer_corners(self, block_height: float) -> list[tuple[float, float]]: ...

    def inner_corners(self) -> list[tuple[float, float]]: ...


@dataclass(frozen=True)
class Fineness:
    """How fine a mesh is.

    Parameters
    ----------
    growth
        Increase of the spacing of lines per distance from the roots.
    root
        Spacing at sharp roots, in hinge thicknesses.
    """

    growth: float
    root: float

    @classmethod
    def of(cls, refinement: float) -> Fineness:
        """Return that of a level, from 1: a root's error goes with its spacing^1.09, all else with about growth^4."""
        growth = 3 / (refinement + 1.5)
        return cls(growth, (growth / 1.2) ** 3.7 / 15)


@dataclass(frozen=True)
class Reference:
    """Port compliances of a whole amplifier, both input blocks pushed and the ground face clamped.

    Parameters
    ----------
    C11
        Extension between the input faces per actuator force [m/N].
    C12
        Output displacement along y per actuator force [m/N]; equally, extension per output force.
    C22
        Output displacement per output force, inputs free [m/N].
    frequencies
        Lowest natural frequencies of the modes symmetric in x = 0 and z = 0, inputs free [Hz]; empty without
        a density.
    reciprocity
        Relative difference of C12 and C21, which measures the error of the equation solver.
    n_dof, seconds
        Unknowns of the mesh and the time taken.
    hinge_stress
        Largest nominal stress of a hinge per actuator force [Pa/N].
    """

    C11: float
    C12: float
    C22: float
    frequencies: tuple[float, ...]
    reciprocity: float
    n_dof: int
    seconds: float
    hinge_stress: float = np.nan

    @property
    def K_in_output_free(self) -> float:
        """Actuator force per extension, output free [N/m]."""
        return 1 / self.C11

    @property
    def lambda_output_free(self) -> float:
        """Output displacement per extension, signed along +y."""
        return self.C12 / self.C11

    @property
    def K_out_input_free(self) -> float:
        """Output force per displacement, inputs free [N/m]."""
        return 1 / self.C22

    @property
    def K_out_input_held(self) -> float:
        """Output force per displacement, the extension held at zero [N/m]."""
        return 1 / (self.C22 - self.C12**2 / self.C11)


class Roots:
    """The lines and patches about the roots of one amplifier's leaves, as seen from a leaf's axis."""

    def __init__(self, thickness: float, radius: float, bulk: float, fineness: Fineness) -> None:
        self.growth, finer = fineness.growth, fineness.growth / 1.2
        self.t, self.r = thickness / 2, radius
        self.sharp = fineness.root * thickness
        pieces = max(2, int(np.ceil(2 / finer - 1e-9)))
        self.at_root = HALF_A_FILLET * self.r / pieces if self.r else self.sharp
        self.bulk = bulk * finer
        self.halves = np.linspace(0.0, 1.0, pieces + 1)
        self.neck = self._neck(finer)
        self.depth = 0.75 * self.r
        spacing = 0.25 * finer if self.is_long else 0.5
        self.columns = self._columns(spacing, finer)
        # a rod's inner corner has the fillet's lines: of a long fillet they would be coarser than its outer corner's
        self.rod_columns = self._columns(min(spacing, self.foot / self.depth), finer) if self.is_long else self.columns
        self.leaf = self._across(finer)

    def _columns(self, spacing: float, finer: float) -> Array:
        """Return the lines behind a fillet, as fractions of the depth of its patches."""
        return graded_lines(0.0, 1.0, spacing, 0.5, self.growth, 1 / finer / 2) if self.r else np.zeros(1)

    @property
    def foot(self) -> float:
        """Spacing at the corners of rods [m]."""
        return 4 * self.sharp

    @property
    def is_long(self) -> bool:
        """Whether the fillets are longer than the leaf is thick, so that they make a curved neck."""
        return self.r > 2 * self.t

    def _neck(self, finer: float) -> Array:
        """Return the lines on the half of a fillet next to the leaf, as fractions of its angle.

        They crowd as the thickness of a long fillet asks for, which is t (1 + s^2 / r t) in all at s from its start.
        """
        if not self.is_long:
            return self.halves
        arc = HALF_A_FILLET * self.r
        at_neck = min(0.3 * finer * self.t, arc * self.halves[1])
        return graded_lines(0.0, 1.0, at_neck / arc, 1.0, 0.3 * self.growth, 0.5 * self.halves[1])

    def _across(self, finer: float) -> Array:
        """Return the lines across a leaf: as fine as its fillets, and of a long fillet four at least."""
        lines = self.cut(-self.t, self.t, self.at_root, self.at_root)
        if not self.is_long:
            return lines
        return np.linspace(-self.t, self.t, 1 + max(len(lines) - 1, int(np.ceil(4.5 / finer))))

    def layers(self, width: float) -> Array:
        """Return the planes that layer half the width."""
        growth = (0.8 if self.is_long else 1.25) * self.growth
        return graded_lines(0.0, width / 2, width, self.t * self.growth / 1.2, growth, width / 3)

    def cut(self, start: float, end: float, at_start: float, at_end: float, largest: float | None = None) -> Array:
        """Return lines graded as stated."""
        return graded_lines(start, end, at_start, at_end, self.growth, largest or self.bulk)

    @property
    def reach(self) -> float:
        """How far from the leaf's axis the fillets reach [m]."""
        return self.t + self.r

    def core(self) -> Array:
        """Return the lines of a body in front of the leaf and its fillets."""
        if not self.r:
            return self.leaf
        middle = self.t + self.r * (1 - np.cos(HALF_A_FILLET))
        side = middle + (self.reach - middle) * self.halves
        return join_lines(-side[::-1], self.leaf * middle / self.t, side)

    def beyond(self, end: float, at_end: float | None = None) -> Array:
        """Return the lines of a body from where the fillet ends to its own end."""
        return self.cut(self.reach, end, self.at_root, at_end or self.bulk)

    def fillets(self, x: float, y: float, towards: int, slope: float, columns: Array | None = None) -> list[Array]:
        """Return the patches A, B and C of a root at (x, y), the body lying `towards` 1 or -1 along x.

        The `columns` lie behind the fillet, as fractions of the depth of its patches.
        """
        if not self.r:
            return []
        columns = self.columns if columns is None else columns
        inner, outer = (HALF_A_FILLET * (with_middles(part) + k) for part, k in ((self.neck, 0), (self.halves, 1)))
        leaf = with_middles(self.leaf) / self.t
        behind = x + towards * self.depth
        rise = slope * towards * self.depth

        def arc(angle: Array) -> tuple[Array, Array]:
            return x - towards * self.r * (1 - np.sin(angle)), self.t + self.r * (1 - np.cos(angle))

        def points(px: Array | float, py: Array) -> Array:
            return np.stack(np.broadcast_arrays(px, py), axis=-1)

        along, height = arc(inner)
        a = np.stack(np.broadcast_arrays(along[:, None], y + height[:, None] * leaf), axis=-1)
        middle = height[-1]
        front = points(along[-1], y + middle * leaf)
        c = ruled_patch(front, points(behind, y + rise + middle * leaf), columns)
        along, height = arc(outer)
        level = middle + (self.reach - middle) * with_middles(self.halves)
        b = [
            ruled_patch(points(along, y + side * height), points(behind, y + rise + side * level), columns)
            for side in (1, -1)
        ]
        return [a, *b, c]

    def body(
        self, x: float, y: float, towards: int, slope: float, below: Array, above: Array, columns: Array | None = None
    ) -> list[Array]:
        """Return all patches of a body up to `depth` behind a leaf's root; none if the root is sharp."""
        if not self.r:
            return []
        columns = self.columns if columns is None else columns
        behind = x + towards * self.depth * columns
        outside = [sheared_patch(behind, y + rows, slope) for rows in (below, above)]
        return self.fillets(x, y, towards, slope, columns) + outside


def mesh(part: Bridge, fineness: Fineness) -> tuple[Plan, Array]:
    """Return the plan of the right half of an amplifier and the planes that layer its half width z >= 0.

    Raises
    ------
    ValueError
        If the mesh does not fill the part's contour, which then has changed its shape.
    """
    (xi, yi), (xo, yo) = part.inner_hinge, part.outer_hinge
    half, a, height = part.hinge_length / 2, part.arm_thickness / 2, part.input_block_height / 2
    roots = Roots(part.hinge_thickness, part.fillet_radius, part.arm_thickness, fineness)
    d, near, bulk, cut = roots.depth, roots.at_root, roots.bulk, roots.cut
    foot = roots.foot
    straight = half - roots.r  # nothing of a right-circular notch
    at_leaf, largest = near, half * fineness.growth / 1.2
    if roots.is_long:
        at_leaf, largest = min(near, 0.8 * roots.t * fineness.growth), min(largest, 3 * roots.t * fineness.growth / 1.2)
    x_leaf = cut(-straight, straight, at_leaf, at_leaf, largest) if straight > 1e-9 else None
    start, end = xi + half, xo - half
    slope = -part.arm_offset / (end - start)
    x_arm = cut(start + d, end - d, near, near)
    outside = roots.beyond(a)
    y_arm = join_lines(-outside[::-1], roots.core(), outside)
    x_block = cut(0.0, xi - half - d, bulk, near)
    block_in, block_out = part.input_block
    rods = part.rod_length > 0
    face = part.rod_face
    x_rod = cut(face + d, face + part.rod_thickness, near, foot) if rods else cut(face + d, block_out, near, bulk)

    patches: list[Array] = []
    for side, block_height in ((1, part.output_block_height), (-1, part.ground_block_height)):
        above, below = roots.beyond(block_height - a), -outside[::-1]
        quarter = [sheared_patch(x_block, yi + join_lines(below, roots.core(), above))]
        quarter += roots.body(xi - half, yi, -1, 0.0, below, above)
        if x_leaf is not None:
            quarter += [sheared_patch(xi + x_leaf, yi + roots.leaf), sheared_patch(xo + x_leaf, yo + roots.leaf)]
        quarter += roots.body(start, yi, 1, slope, below, outside)
        quarter += [sheared_patch(x_arm, yi + slope * d + y_arm, slope)]
        quarter += roots.body(end, yo, -1, slope, below, outside)
        if rods:
            below = -roots.beyond(yo - height, foot)[::-1]
            quarter += roots.body(face, yo, 1, 0.0, below, outside, roots.rod_columns)
            quarter += [sheared_patch(x_rod, yo + join_lines(below, roots.core(), outside))]
        patches += [patch * (1.0, side) for patch in quarter]
    if rods:
        columns = join_lines(face + d * roots.rod_columns, x_rod) if roots.r else x_rod
        at_face = min(near, foot) if roots.is_long else near
        x = join_lines(cut(block_in, face, bulk, at_face), columns, cut(columns[-1], block_out, foot, bulk))
        patches.append(sheared_patch(x, cut(-height, height, foot, foot)))
    else:
        patches += _block_without_rods(roots, face, yo, x_rod, outside)
    plan = Plan.of(patches)
    _check_area(part, plan)
    return plan, roots.layers(part.width)


def _block_without_rods(roots: Roots, face: float, y: float, x: Array, outside: Array) -> list[Array]:
    """Return the patches of an input block that carries both arms itself, from its face at x = `face`."""
    inside = y - roots.reach
    middle = roots.cut(-inside, inside, roots.at_root, roots.at_root)
    upper = y + join_lines(roots.core(), outside)
    patches = [sheared_patch(x, join_lines(-upper[::-1], middle, upper))]
    if roots.r:
        columns = face + roots.depth * roots.columns
        patches.append(sheared_patch(columns, middle))
        for side in (1, -1):
            pieces = [*roots.fillets(face, y, 1, 0.0), sheared_patch(columns, y + outside)]
            patches += [patch * (1.0, side) for patch in pieces]
    return patches


def _check_area(part: Bridge, plan: Plan) -> None:
    """Raise if the mesh does not fill the contour of the part, which then has changed its shape."""
    upper, lower = (part.outer_corners(block) for block in (part.output_block_height, part.ground_block_height))
    area = 16 * (1 - np.pi / 4) * part.fillet_radius**2
    for sign, above, below in ((1, upper, lower), (-1, part.inner_corners(), part.inner_corners())):
        corners = above + [(x, -y) for x, y in reversed(below)]
        x, y = np.array([(0.0, corners[0][1]), *corners, (0.0, corners[-1][1])]).T
        area += sign * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
    found = plan.area()
    if abs(found / area - 1) > 1e-9 + 2e-3 * part.fillet_radius**2 / area:
        raise ValueError(f"the part covers {area:.9g} m^2 and the mesh {found:.9g} m^2: has its contour changed?")


def solve(
    part: Bridge,
    youngs_modulus: float,
    poissons_ratio: float,
    *,
    fineness: Fineness,
    density: float | None = None,
    modes: int = 3,
) -> Reference:
    """Solve an amplifier on one mesh.

    Parameters
    ----------
    part
        The amplifier.
    youngs_modulus, poissons_ratio
        E [Pa] and nu.
    fineness
        Of the mesh.
    density
        With a density [kg/m^3] the lowest natural frequencies are found too.
    modes
        How many of them.

    Raises
    ------
    ValueError
        If the part is not of the shape meshed here.
    """
    began = time.perf_counter()
    plan, layers = mesh(part, fineness)
    near = 1e-9 * float(np.ptp(plan.nodes))
    bottom, top = plan.nodes[:, 1].min(), plan.nodes[:, 1].max()

    def is_fixed(nodes: Array, z: Array) -> Array:
        held = np.zeros((len(nodes), 3, z.size), dtype=bool)
        held[nodes[:, 0] < near, 0] = True
        held[:, 2, 0] = True
        held[nodes[:, 1] < bottom + near] = True
        return held

    body = Body(plan, layers, youngs_modulus, poissons_ratio, is_fixed)
    x_face, y_face = part.input_block[0], part.input_block_height / 2
    if part.rod_length == 0:  # the face ends at the hinges
        y_face = part.outer_hinge[1] - part.hinge_thickness / 2 - part.fillet_radius
    pushed = body.average(lambda x, y: (abs(x - x_face) < near) & (abs(y) < y_face + near), 0)
    output = body.average(lambda x, y: y > top - near, 1)
    # unit forces on the whole part: the quarter has half an input face and a quarter of the output face
    moved = body.solve(np.column_stack([pushed / 2, output / 4]))
    C11, C21 = 2 * pushed @ moved
    C12, C22 = output @ moved
    stress = _hinge_stress(part, body, moved[:, 0])
    frequencies = body.frequencies(density, modes) if density is not None else ()
    body.release()
    return Reference(
        C11=float(C11),
        C12=float(C12),
        C22=float(C22),
        frequencies=frequencies,
        reciprocity=float(abs(C21 / C12 - 1)),
        n_dof=body.free.size,
        seconds=time.perf_counter() - began,
        hinge_stress=stress,
    )


def _hinge_stress(part: Bridge, body: Body, moved: Array) -> float:
    """Return the largest nominal stress of the hinges, N / b t + 6 M / b t^2 where it is largest [Pa].

    The section forces are those where the straight part of a leaf ends, of both halves of the width.
    """
    half, r, b = part.hinge_length / 2, part.fillet_radius, part.width
    straight = half - r
    s = np.append(np.linspace(0.0, half, 2001), straight)
    into = np.maximum(s - straight, 0.0)
    t = part.hinge_thickness + 2 * (r - np.sqrt(np.maximum(r**2 - into**2, 0.0)))
    largest = 0.0
    for x, y in (part.inner_hinge, part.outer_hinge):
        for side in (1, -1):
            place = x + straight
            forces = body.section_forces(moved, place, (x, side * y), part.hinge_thickness / 2)
            normal, shear, moment = 2 * abs(forces)
            largest = max(largest, float((normal / (b * t) + 6 * (moment + shear * s) / (b * t**2)).max()))
    return largest

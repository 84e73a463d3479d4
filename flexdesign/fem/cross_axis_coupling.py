"""How driving one axis of a stage moves the others: what is of first order, with its causes, and what is of second.

First order, in proportion to the travel, is what a linear model shows. A perfectly symmetric stage has none; a cause is
assumed for each, and what follows per travel is worked out:

- unequal actuators of an axis that is driven by several,
- an actuator whose line of action lies off the axis of its amplifier,
- a load that acts off the table's point,
- a sensor whose axis is tilted, or that looks at another point than the table's (Abbe's arm) while the table tilts.

Second order, with the square of the travel, are the arms that tilt, delta^2 / 2L: equation (25) of Lin et al. (2019).
Only large displacements show it (`superelements.corotated`), the same whichever way the axis goes: of two equal and
opposite drives half the sum is of even order, half the difference of odd.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Quantity
from flexdesign.fem.superelements.assembled_stage import AssembledStage
from flexdesign.fem.superelements.corotated import CorotatedStage, State

FloatArray = NDArray[np.float64]

#: What is assumed of each cause: relative difference of actuators, offsets and arms [m], tilt of a sensor [rad].
MISMATCH, ACTUATOR_OFFSET, LOAD_OFFSET, SENSOR_TILT, ABBE_ARM = 0.01, 1e-4, 1e-3, 1e-3, 1e-2
#: How often a force is corrected until it causes the input asked for; second order leaves a thousandth at the first.
CORRECTIONS = 3
#: Motion aside of even order per travel that is rounding: Newton's method leaves 1e-12, what is looked for is 1e-4.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Cause:
    """A cause of coupling in proportion to the travel.

    Parameters
    ----------
    name, assumed
        What it is, and how much of it, in words.
    coupling
        By driven axis and by the other axis its motion per travel [1].
    """

    name: str
    assumed: str
    coupling: Mapping[str, Mapping[str, float]]

    @property
    def largest(self) -> float:
        """The largest coupling between any two axes [1]."""
        return max((abs(value) for others in self.coupling.values() for value in others.values()), default=0.0)


@dataclass(frozen=True)
class CrossMotion:
    """An axis driven both ways through large displacements, so far that its inputs move by an amount.

    Parameters
    ----------
    axis, extension
        Which, and how far each actuator parts its inputs, in the mean [m].
    force
        Of each actuator [N].
    travel
        Of the table along the axis, half the way from one end to the other [m].
    odd, even
        By other axis its motion [m] of odd and of even order at the positive end.
    turned
        Rotations of the table about x, y, z at the positive end, shape (3,) [rad].
    state
        Of the stage there.
    """

    axis: str
    extension: float
    force: float
    travel: float
    odd: Mapping[str, float]
    even: Mapping[str, float]
    turned: FloatArray
    state: State

    def quadratic(self, other: str) -> float:
        """Return the motion of another axis per travel squared, of even order [1/m]."""
        return self.even[other] / self.travel**2

    def quantities(self) -> list[Quantity]:
        """Return what is reported: travel and couplings of even order per travel at this input; 0 for rounding."""
        travel, *ratios = requested_quantities(self.axis, self.extension, self.even)
        aside = [abs(even) / self.travel for even in self.even.values()]
        return [
            replace(travel, value=self.travel),
            *(replace(q, value=value if value > ROUNDING else 0.0) for q, value in zip(ratios, aside, strict=True)),
        ]


def requested_quantities(axis: str, extension: float, others: Iterable[str]) -> list[Quantity]:
    """Return the quantities of an axis driven so far [m] that draws others aside, the values not yet known."""
    at = f"{axis}, input of {1e6 * extension:g} um"
    ratios = (Quantity(f"coupling_{other}", math.nan, "1", "%", at) for other in others)
    return [Quantity("travel", math.nan, "m", "um", at), *ratios]


def causes(stage: AssembledStage, point: FloatArray | None = None) -> list[Cause]:
    """Return what each cause makes of a stage's symmetry, and first what the stage does without any.

    Parameters
    ----------
    stage
        The assembled stage.
    point
        Where the sensors look at the table [m]; None for the table's own point.
    """
    axes = stage.assembly.axes
    place = np.array(stage.assembly.point) if point is None else point
    drives = {axis: stage.drive(axis) for axis in axes}
    unequal = {a: drives[a] + MISMATCH * _first(stage, a) for a in axes if len(axes[a].drives) > 1}
    offset = {a: drives[a] + _off_axis_motion(stage, a) for a in axes}
    pushed = {a: np.array(axes[a].direction) @ _at(stage, a, LOAD_OFFSET)[:3] for a in axes}
    tilted = {a: {b: SENSOR_TILT for b in axes if b != a} for a in axes}
    offset_point = place + ABBE_ARM / np.sqrt(3.0)
    abbe = {a: _cross_motion(stage, a, drives[a], offset_point) for a in axes}
    return [
        Cause("none", "the stage as drawn", {a: _cross_motion(stage, a, drives[a], place) for a in axes}),
        Cause(
            "unequal actuators",
            f"one of an axis is {100 * MISMATCH:g} % stronger",
            {a: _cross_motion(stage, a, load, place) for a, load in unequal.items()},
        ),
        Cause(
            "actuator off its axis",
            f"one of an axis, by {1e3 * ACTUATOR_OFFSET:g} mm across its amplifier",
            {a: _cross_motion(stage, a, load, place) for a, load in offset.items()},
        ),
        Cause(
            "eccentric load",
            f"the table pushed along the axis, {1e3 * LOAD_OFFSET:g} mm off its point",
            {a: _cross_motion(stage, a, load, place) for a, load in pushed.items()},
        ),
        Cause("tilted sensor", f"of the other axis, by {1e3 * SENSOR_TILT:g} mrad", tilted),
        Cause("Abbe arm", f"sensors look {1e3 * ABBE_ARM:g} mm off the table's point, as far in x as in y and z", abbe),
    ]


def cross_motion(stage: CorotatedStage, linear: AssembledStage, axis: str, extension: float) -> CrossMotion:
    """Drive an axis both ways until its actuators have parted their inputs by so much in the mean.

    Parameters
    ----------
    stage, linear
        The stage for large displacements, and the linear one for the force to begin with.
    axis
        Which axis.
    extension
        How far [m].

    Raises
    ------
    NoEquilibrium
        If the stage does not go there.
    """
    drives = linear.assembly.axes[axis].drives
    drive = linear.drive(axis)
    force = extension * len(drives) / float(drive @ np.linalg.solve(linear.stiffness, drive))
    for _ in range(CORRECTIONS):
        ends = [stage.equilibrium(stage.drive(axis, way * force)) for way in (1.0, -1.0)]
        parted = [np.mean([w * stage.extension(end, name) for name, w in drives.items()]) for end in ends]
        force *= extension / float(parted[0] - parted[1]) * 2
    ends = [stage.equilibrium(stage.drive(axis, way * force)) for way in (1.0, -1.0)]
    (forth, turned), (back, _) = (stage.table(end) for end in ends)
    odd, even = (forth - back) / 2, (forth + back) / 2
    along = np.array(linear.assembly.axes[axis].direction)
    others = {name: np.array(other.direction) for name, other in linear.assembly.axes.items() if name != axis}
    return CrossMotion(
        axis=axis,
        extension=extension,
        force=force,
        travel=float(along @ odd),
        odd={name: float(direction @ odd) for name, direction in others.items()},
        even={name: float(direction @ even) for name, direction in others.items()},
        turned=turned,
        state=ends[0],
    )


def _cross_motion(stage: AssembledStage, axis: str, load: FloatArray, point: FloatArray) -> dict[str, float]:
    """Return the other axes' motions at a point per travel of the table's point under a load."""
    answer = np.linalg.solve(stage.stiffness, load)
    axes = stage.assembly.axes
    travel = float(np.array(axes[axis].direction) @ (stage.table @ answer)[:3])
    displacement = (stage.motion(stage.assembly.table, point) @ answer)[:3]
    return {b: float(np.array(axes[b].direction) @ displacement) / travel for b in axes if b != axis}


def _first(stage: AssembledStage, axis: str) -> FloatArray:
    name, sign = next(iter(stage.assembly.axes[axis].drives.items()))
    return sign * stage.extension(name)


def _off_axis_motion(stage: AssembledStage, axis: str) -> FloatArray:
    """Return what the first actuator of an axis adds when it pushes off its axis, along the part's z and y by turns.

    Across the width for an odd cause in the plane, and across the plane; of both the sum is taken.
    """
    name, sign = next(iter(stage.assembly.axes[axis].drives.items()))
    offset = ACTUATOR_OFFSET * np.array([0.0, 1.0, 1.0]) / np.sqrt(2.0)
    return sign * (stage.extension(name, offset) - stage.extension(name))


def _at(stage: AssembledStage, axis: str, offset: float) -> FloatArray:
    """Return the motion of a point of the table off its own, equally far along both directions across, (6, size)."""
    across = np.ones(3) - np.abs(np.array(stage.assembly.axes[axis].direction))
    point = np.array(stage.assembly.point) + offset * across / np.linalg.norm(across)
    return stage.motion(stage.assembly.table, point)


def coupling_by_arms(travel: float, lengths: Mapping[tuple[str, str], float], axis: str) -> dict[str, float]:
    """Return what tilting arms draw the other axes aside, delta^2 / 2L: Lin et al. (2019), eq. (25) [m].

    Parameters
    ----------
    travel
        Of the axis [m].
    lengths
        Of the arms [m], by (other axis, driven axis).
    axis
        Which is driven.
    """
    return {to: travel**2 / (2 * length) for (to, origin), length in lengths.items() if origin == axis}


def ratios(motions: Sequence[CrossMotion]) -> dict[tuple[str, str], float]:
    """Return quadratic couplings by (to, from) [1/m], but for those that rounding makes."""
    found = {(to, m.axis): m.quadratic(to) for m in motions for to in m.even}
    largest = max((abs(value) for value in found.values()), default=0.0)
    return {pair: value for pair, value in found.items() if abs(value) > 1e-6 * largest}

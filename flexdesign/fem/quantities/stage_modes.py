"""What the modes of a stage are: how much each answers the actuators with, and what of it is the table moving.

In mode i of frequency omega_i, scaled to unit modal mass, phi_i is a part (t phi_i)(d phi_i) / omega_i^2 of the static
response t K^-1 d along an axis to its actuators' forces d; those of all modes add up. Of the mode's kinetic energy,
half omega_i^2, the table's motion about its centre has the part phi_i^T M_t phi_i.

Where symmetry makes frequencies equal, any mixture of the modes is one, and an eigensolver returns some: they are
turned so that the first moves the table along the first axis it can, and the others along the remaining one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.fem.superelements.assembled_stage import AssembledStage, StageMode

FloatArray = NDArray[np.float64]
#: The table's motions, in order.
NAMES: Sequence[str] = ("x", "y", "z", "rx", "ry", "rz")
#: Modes whose frequencies differ by less, relative, are one by symmetry: rounding leaves 1e-9.
SAME_FREQUENCY = 1e-6
#: At most this number of modes coincide; with this number more, none is separated from its group.
MOST_COINCIDENT = 8


@dataclass(frozen=True)
class ModeShares:
    """A mode of the stage.

    Parameters
    ----------
    mode
        Frequency and shape.
    participation
        By axis, its part of the static response to the axis' actuators [1].
    table
        By motion of the table, x, y, z, rx, ry and rz, its part of the kinetic energy [1]; what is missing to one is
        in other bodies and in the parts.
    """

    mode: StageMode
    participation: Mapping[str, float]
    table: Mapping[str, float]


def mode_shares(stage: AssembledStage, actuator: float, count: int) -> list[ModeShares]:
    """Return the lowest modes with an actuator of a stiffness [N/m], 0 for none, between all inputs."""
    stiffness, axes = stage.with_input_springs(actuator), stage.assembly.axes
    drives = {axis: stage.drive(axis) for axis in axes}
    along = {axis: np.array(axes[axis].direction) @ stage.table[:3] for axis in axes}
    static = {axis: float(along[axis] @ np.linalg.solve(stiffness, drives[axis])) for axis in axes}
    table = stage.assembly.body(stage.assembly.table)
    inertia, motion = table.inertia(stage.density), stage.motion(table.name, table.centre)
    found = []
    modes = stage.modes(min(count + MOST_COINCIDENT, stage.size), actuator)
    for mode in _sorted_out(modes, np.stack(list(along.values())))[:count]:
        shape, square = mode.amplitudes, (2 * np.pi * mode.frequency) ** 2
        participation = {a: float((along[a] @ shape) * (drives[a] @ shape)) / square / static[a] for a in axes}
        motion_of_table = motion @ shape
        energies = motion_of_table * (inertia @ motion_of_table)
        found.append(ModeShares(mode, participation, dict(zip(NAMES, energies.tolist(), strict=True))))
    return found


def _sorted_out(modes: Sequence[StageMode], along: FloatArray) -> list[StageMode]:
    """Turn modes of equal frequency so that each moves the table along one axis; `along` has the axes as rows."""
    groups: list[list[StageMode]] = []
    for mode in modes:
        if groups and mode.frequency - groups[-1][0].frequency <= SAME_FREQUENCY * mode.frequency:
            groups[-1].append(mode)
        else:
            groups.append([mode])
    return [mode for group in groups for mode in _rotate(group, along)]


def _rotate(group: Sequence[StageMode], along: FloatArray) -> list[StageMode]:
    shapes = np.stack([mode.amplitudes for mode in group], axis=1)
    travel = (along @ shapes).T
    sizes = np.linalg.norm(travel, axis=0)
    independent = travel[:, sizes > 1e-3 * sizes.max()]
    turn = np.linalg.qr(np.hstack([independent, np.eye(len(group))]))[0]
    return [StageMode(mode.frequency, shape) for mode, shape in zip(group, (shapes @ turn).T, strict=True)]

"""What a designer asks of a stage, axis by axis, from its condensed parts.

An axis is driven by n actuators at once, some of which push while their opposites draw. With E the extensions of all
actuated elements as rows over the unknowns, w the axis' signs, t the table's motion along it and C = K^-1,

    K_in = n / (w E C E^T w),   lambda = n (t C E^T w) / (w E C E^T w),   K_out = 1 / (t C t),

per actuator, the inputs of all others free. Springs k between all inputs, actuators installed, make of the compliance

    C_k = C - C E^T (E C E^T + 1/k)^-1 E C,

in whatever elements they sit: what stands still has its actuators, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from flexdesign.core.model import Quantity
from flexdesign.design.study import Study
from flexdesign.fem.quantities.stage_modes import ModeShares, mode_shares
from flexdesign.fem.superelements.assembled_stage import AssembledStage

FloatArray = NDArray[np.float64]
#: Number of modes reported, and the number among which those are sought that respond to the drives.
REPORTED_MODES, SOUGHT = 6, 40


@dataclass(frozen=True)
class StageStatics:
    """A stage's answers to unit loads of its actuators and on its table.

    Parameters
    ----------
    stage
        The assembled stage.
    """

    stage: AssembledStage

    @cached_property
    def _rows(self) -> FloatArray:
        """Extensions of all actuated elements, then the six motions of the table, shape (e + 6, size)."""
        extensions = [self.stage.extension(name) for name in self.stage.assembly.driven]
        return np.vstack([*extensions, self.stage.table])

    @cached_property
    def free(self) -> FloatArray:
        """Compliance between all actuators, then the table's motions, inputs free, shape (e + 6, e + 6)."""
        factor = scipy.linalg.cho_factor(self.stage.stiffness)
        found = self._rows @ scipy.linalg.cho_solve(factor, self._rows.T)
        return np.asarray((found + found.T) / 2)

    def with_input_springs(self, actuator: float) -> FloatArray:
        """Return that compliance with a spring [N/m] between the inputs of every element, infinite to hold them."""
        count = len(self.stage.assembly.driven)
        across = self.free[:, :count]
        gap = across[:count] + np.eye(count) / actuator
        return np.asarray(self.free - across @ np.linalg.solve(gap, across.T))

    def signs(self, axis: str) -> FloatArray:
        """Return how actuators and table take part in driving an axis: w, zero for the table, shape (e + 6,)."""
        drives = self.stage.assembly.axes[axis].drives
        return np.array([*(drives.get(name, 0.0) for name in self.stage.assembly.driven), *np.zeros(6)])

    def along(self, axis: str) -> FloatArray:
        """Return the table's motion along an axis, over the compliance's rows, shape (e + 6,)."""
        direction = self.stage.assembly.axes[axis].direction
        return np.concatenate([np.zeros(len(self.stage.assembly.driven)), direction, np.zeros(3)])

    def drive(self, axis: str, free_stroke: float, actuator: float) -> FloatArray:
        """Return extensions and table's motions when an axis' actuators are energised, shape (e + 6,).

        Each by its free stroke [m], its way by the axis' sign; all have the stiffness [N/m].
        """
        return self.with_input_springs(actuator) @ (actuator * free_stroke * self.signs(axis))


def requested_quantities(axes: Iterable[str], *, installed: bool) -> list[Quantity]:
    """Return every quantity of a stage whose limit for vanishing element size is sought, the values not yet known.

    Parameters
    ----------
    axes
        Their names.
    installed
        Whether there are actuators.
    """
    found = []
    for axis in axes:
        found += [
            Quantity("K_in", math.nan, "N/m", "N/mm", f"{axis}, table free"),
            Quantity("lambda", math.nan, "1", "", f"{axis}, table free"),
            Quantity("K_out", math.nan, "N/m", "N/mm", f"{axis}, inputs free"),
            Quantity("K_out", math.nan, "N/m", "N/mm", f"{axis}, inputs held"),
        ]
        if installed:
            found += [
                Quantity("K_out", math.nan, "N/m", "N/mm", f"{axis}, actuators installed"),
                Quantity("stroke", math.nan, "m", "um", f"{axis}, table free"),
            ]
    for boundary in ("inputs free", "actuators installed") if installed else ("inputs free",):
        found += [
            Quantity(f"frequency_{rank}", math.nan, "Hz", "Hz", boundary) for rank in range(1, REPORTED_MODES + 1)
        ]
    for axis in axes:
        for boundary in ("inputs free", "actuators installed") if installed else ("inputs free",):
            found.append(Quantity("output_mass", math.nan, "kg", "g", f"{axis}, {boundary}"))
            found.append(Quantity("output_frequency", math.nan, "Hz", "Hz", f"{axis}, {boundary}"))
    for axis in axes if installed else ():
        found.append(Quantity("drive_frequency", math.nan, "Hz", "Hz", f"{axis}, actuators installed"))
        found.append(Quantity("drive_share", math.nan, "1", "%", f"{axis}, actuators installed"))
    return found


def of_stage(study: Study, stage: AssembledStage) -> list[Quantity]:
    """Return the `requested_quantities` of a stage."""
    statics, actuator = StageStatics(stage), study.design.actuator
    values: dict[str, float] = {}
    for axis in stage.assembly.axes:
        w, t, free = statics.signs(axis), statics.along(axis), statics.free
        n, held = np.abs(w).sum(), statics.with_input_springs(math.inf)
        push, travel = float(w @ free @ w), float(t @ free @ w)
        values |= {
            f"K_in_{axis}_table_free": n / push,
            f"lambda_{axis}_table_free": n * travel / push,
            f"K_out_{axis}_inputs_free": 1 / float(t @ free @ t),
            f"K_out_{axis}_inputs_held": 1 / float(t @ held @ t),
        }
        if actuator is not None:
            k = actuator.installed_stiffness
            values |= {
                f"K_out_{axis}_actuators_installed": 1 / float(t @ statics.with_input_springs(k) @ t),
                f"stroke_{axis}_table_free": float(t @ statics.drive(axis, actuator.free_stroke, k)),
            }
    values |= _frequencies(stage, actuator.installed_stiffness if actuator else 0.0)
    return [
        replace(q, value=values[q.key])
        for q in requested_quantities(stage.assembly.axes, installed=actuator is not None)
    ]


def _frequencies(stage: AssembledStage, actuator: float) -> dict[str, float]:
    """Return the first modes without and with actuators [N/m], and for each axis the one that answers its drive."""
    found = _outputs(stage, mode_shares(stage, 0.0, SOUGHT), "inputs_free")
    for stiffness, boundary in ((0.0, "inputs_free"), (actuator, "actuators_installed")):
        if stiffness or boundary == "inputs_free":
            for rank, mode in enumerate(stage.modes(REPORTED_MODES, stiffness), 1):
                found[f"frequency_{rank}_{boundary}"] = mode.frequency
    if actuator:
        modes = mode_shares(stage, actuator, SOUGHT)
        found |= _outputs(stage, modes, "actuators_installed")
        for axis in stage.assembly.axes:
            main = max(modes, key=lambda mode: mode.participation[axis])
            found[f"drive_frequency_{axis}_actuators_installed"] = main.mode.frequency
            found[f"drive_share_{axis}_actuators_installed"] = main.participation[axis]
    return found


def _outputs(stage: AssembledStage, modes: Sequence[ModeShares], boundary: str) -> dict[str, float]:
    """Return for each axis frequency and modal mass of the mode that carries most of the table's compliance.

    With phi scaled to unit modal mass and t the table's motion along the axis, the mode's mass at the table is
    1 / (t phi)^2, and it carries (t phi)^2 / omega^2 of the compliance.
    """
    found = {}
    for axis, drive in stage.assembly.axes.items():
        along = np.array(drive.direction) @ stage.table[:3]
        main = max((m.mode for m in modes), key=lambda mode: abs(along @ mode.amplitudes) / mode.frequency)
        found[f"output_mass_{axis}_{boundary}"] = float(along @ main.amplitudes) ** -2
        found[f"output_frequency_{axis}_{boundary}"] = main.frequency
    return found

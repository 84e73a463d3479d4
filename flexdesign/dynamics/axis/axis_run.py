"""A recorded run as seen by one axis: its command and its response; and ways by which a record comes to its start.

Where the voltage at the stack was recorded it drives the model, whatever the amplifier made of the command: what acts
ahead of the stack, the amplifier's lag, slew rate and limits and the delay of the command, is in it already.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np

from flexdesign import effects
from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Block, Effect, Socket
from flexdesign.dynamics.stage_model import AxisModel, Driver
from flexdesign.measurements.noise_level import NoiseFloor, noise_floor
from flexdesign.measurements.recordings import AXES, Run, refuse_wrong_units, suspicions

#: A recorded voltage may be by this factor more or less than the model's amplifier makes of the command.
AMPLIFIED = 1.5
#: The effect that acts on commands without being a block of the chain.
DELAY = "transport_delay"


@dataclass(frozen=True, eq=False)
class AxisRun(Run):
    """What a run holds of one axis, an `Observation` of n values; other columns are there for what disturbs it.

    Parameters
    ----------
    response
        Column of the response.
    driven_by
        Column of the voltage that drives it; by default its command.
    amplifier
        Voltage at the stack per command, where that column holds the voltage at the stack [V/V].
    doubts
        Those of the remarks that say that a unit may be wrong.
    """

    response: str = ""
    driven_by: str = ""
    amplifier: float = 1.0
    doubts: tuple[str, ...] = ()

    def command(self) -> Array:
        """Return the command of this axis [V], n values, see `command_of`."""
        return command_of(self, self.response, self.amplifier)

    def measured(self) -> Array:
        """Return the response of this axis, n values."""
        return self.columns[self.response]


def noise_of_axis(runs: Sequence[Run], name: str, axis: AxisModel) -> NoiseFloor:
    """Return the noise of the response of an axis, whose main mode rings down before a stretch is quiet."""
    return noise_floor(runs, name, settling_time=axis.settling_time, sensor_noise=axis.sensor.noise)


def measured_stroke(runs: Iterable[Run], name: str) -> float:
    """Return the largest peak-to-peak value of the response of an axis in one run [response]; zero without readings."""
    readings = [run.columns[name][np.isfinite(run.columns[name])] for run in runs]
    return max((float(np.ptp(values)) for values in readings if len(values)), default=0.0)


def of_axis(run: Run, name: str, axis: AxisModel) -> AxisRun:
    """Return a run as seen by one axis: what drives it, and its response.

    That is the voltage at the stack, where it was recorded without gaps and is about what the model's amplifier makes
    of the command; else the command. A measured voltage is not held between samples, whatever the command is.

    Raises
    ------
    InputError
        If the axis is none that runs know, or the run lacks its command or response, has it in another unit, or in one
        that is wrong by a power of a thousand.
    """
    if name not in AXES:
        raise InputError("model", f"axis.{name}", None, f"runs hold the axes {', '.join(AXES)}; name it one of these")
    if name not in run.responses:
        there = f"there is {', '.join(run.responses)}"
        remedy = (
            f"rename the column if it is that of axis {name}, choose another axis with --axis, or leave the run out"
        )
        raise InputError(run.name, name, None, f"the run has no response of axis {name}; {there}: {remedy}")
    if run.si[name] != axis.response:
        remedy = f"the model's axis {name} responds in {axis.response} (the unit of its gain); correct one of the two"
        raise InputError(run.name, name, f"in {run.si[name]}", remedy)
    column, amplifier = command_column(run, name), 1.0 if is_at_stack(run) else axis.driver.gain
    if not {"gain", "driver.gain"} & set(axis.assumed):  # what nobody measured or computed contradicts nothing
        refuse_wrong_units(run, axis.gain * amplifier, name)
    doubts = suspicions(run, axis.gain * amplifier, name)
    seen = AxisRun(**{each.name: getattr(run, each.name) for each in fields(run)}, response=name, driven_by=column)
    seen = replace(
        seen, amplifier=axis.driver.gain, doubts=doubts, remarks=(*run.remarks, *doubts, *_weight(run, axis))
    )
    voltage = next((each for each in _voltages(run, name, column) if each in run.columns), None)
    if voltage is None:
        return seen
    if why := _unusable(run.columns[column], run.columns[voltage], amplifier):
        remarks = f"{voltage} {why}: {column} drives the model"
        return replace(seen, remarks=(*seen.remarks, remarks)) if np.ptp(run.columns[column]) else seen
    smooth = run.between_samples == "smooth"
    return replace(
        seen,
        driven_by=voltage,
        command_is="stack",
        between_samples="smooth" if smooth else "linear",
        between_is_stated=smooth and run.between_is_stated,
        remarks=(*seen.remarks, f"{voltage}, the voltage at the stack, drives the model; {column} does not"),
    )


def _weight(run: Run, axis: AxisModel) -> list[str]:
    """Return a remark on a mass that the model cannot carry."""
    if not run.payload or axis.mass is not None:
        return []
    added = units.to_text(run.payload, "g", 3)
    return [f"carries {added}, which means nothing to a model without mass and stiffness: predicted without it"]


def _voltages(run: Run, name: str, column: str) -> tuple[str, ...]:
    """Return the columns that may hold the voltage at the stack of an axis."""
    return (f"v{column[1:]}", f"v{name}", *(["v"] if len(run.commands) == 1 else []))


def _unusable(command: Array, voltage: Array, amplifier: float) -> str:
    """Return why a recorded voltage cannot be what drives the stack; empty if it can."""
    if not np.isfinite(voltage).all():
        return "has gaps"
    centred = command - command.mean()
    if not np.ptp(command):
        return "may have any scale, as the command stands still"
    slope = float(centred @ voltage) / float(centred @ centred)
    if 1 / AMPLIFIED < slope / amplifier < AMPLIFIED:
        return ""
    return f"is {slope:.3g} times the command, and {amplifier:g} times by the model's driver.gain; correct one of them"


def doubts(runs: Sequence[Run]) -> list[str]:
    """Return what is doubtful about the units of runs as axes see them, a sentence each."""
    named = [(run.record, run) for run in runs]  # the halves of one record say the same
    remarks = [f"Take care: {name}: {doubt}" for name, run in named if isinstance(run, AxisRun) for doubt in run.doubts]
    return list(dict.fromkeys(remarks))


def is_at_stack(run: Run) -> bool:
    """Tell whether the command of a run is the voltage at the stack."""
    return run.command_is != "dac"


def command_of(run: Run, name: str, amplifier: float) -> Array:
    """Return the command of an axis [V], n values; of a voltage at the stack what an ideal amplifier makes it of.

    Parameters
    ----------
    run, name
        The run, and the name of the axis.
    amplifier
        Voltage at the stack per command [V/V].
    """
    column = (run.driven_by if isinstance(run, AxisRun) else "") or command_column(run, name)
    values = run.columns[column]
    return values / amplifier if is_at_stack(run) and amplifier != 1 else values


def acts_before_stack(effect: Effect) -> bool:
    """Tell whether an effect acts on the command or in the amplifier alone.

    >>> [acts_before_stack(effects.find(name)) for name in ("driver_slew", "transport_delay", "creep")]
    [True, True, False]
    """
    margin = [isinstance(face, Block) and face.socket in (Socket.COMMAND, Socket.DRIVER) for face in effect.faces]
    return effect.name == DELAY or (bool(margin) and all(margin))


def without_amplifier(axis: AxisModel) -> AxisModel:
    """Return an axis with an amplifier that does nothing but amplify, and without other effects ahead of the stack."""
    behind = {name: v for name, v in axis.effects.items() if not acts_before_stack(effects.find(name))}
    return replace(axis, driver=Driver(gain=axis.driver.gain), effects=behind)


def command_column(run: Run, name: str) -> str:
    """Return the name of the column that commands an axis: u, or ux and so on.

    Raises
    ------
    InputError
        If there is none.
    """
    for column in ("u", f"u{name}"):
        if column in run.columns:
            return column
    there = f"there is {', '.join(run.commands)}"
    raise InputError(run.name, f"u{name}", None, f"the run has no command of axis {name}; {there}: leave the run out")


@cache
def smooth_way(samples: int) -> Array:
    """Return a way from zero to one, n values: the integral of Harris's window of four terms.

    A mode that is given six of its periods to follow is left at rest within 1e-4 of the way: F. J. Harris, On the use
    of windows for harmonic analysis with the discrete Fourier transform, Proc. IEEE 66 (1978).
    """
    phase = 2 * math.pi * (np.arange(samples) + 0.5) / samples
    window = 0.35875 - 0.48829 * np.cos(phase) + 0.14128 * np.cos(2 * phase) - 0.01168 * np.cos(3 * phase)
    way = np.cumsum(window)
    return np.asarray(way / way[-1])


def span(values: Array) -> float:
    """Return how far values reach, those that are no numbers left out."""
    present = values[np.isfinite(values)]
    return float(np.ptp(present)) if present.size else 0.0

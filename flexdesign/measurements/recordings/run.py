"""A run: one recorded experiment, sampled uniformly, with what is known about how it was recorded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from flexdesign.core.arrays import Array

Role = Literal["identify", "validate", "test"]
Between = Literal["linear", "hold", "smooth"]
CommandIs = Literal["dac", "stack", "monitor"]

#: Axes in their order, and the column of each one's command.
AXES = ("x", "y", "z")
COMMANDS = ("u", "ux", "uy", "uz")


@dataclass(frozen=True)
class Sensor:
    """What is known of the sensor behind one column; None where it is not.

    Parameters
    ----------
    noise
        Standard deviation of a reading at rest, in the SI unit of the column.
    range
        Lowest and highest reading, in the SI unit of the column.
    point
        Where it looks [m], in the axes of the stage.
    direction
        Unit vector along which it measures, in the axes of the stage.
    """

    noise: float | None = None
    range: tuple[float, float] | None = None
    point: tuple[float, float, float] | None = None
    direction: tuple[float, float, float] | None = None


@dataclass(frozen=True, eq=False)
class Run:
    """One recorded experiment, sampled uniformly; an `Observation`.

    Parameters
    ----------
    name
        The stem of its file, with the folder before it where two stems would be the same.
    time
        n moments, uniform and increasing [s].
    columns
        Everything else that was recorded, n values each, in SI, by name: ``u``, ``x``, ``r``, ... Commands are finite;
        elsewhere NaN marks what was not read, or cannot be used.
    si
        SI unit of each column.
    between_samples
        What the command does between its samples: goes straight to the next (``linear``), waits (``hold``), or goes as
        a signal without content near the Nyquist frequency must (``smooth``).
    role
        What it is for: ``identify`` is fitted; ``validate`` is not fitted, but used to choose between models; ``test``
        is used for neither, so that its error is an unbiased estimate of the error on new runs.
    kind
        What the experiment is, in words: ``multisine``, ``quiet``; empty if not stated.
    command_is
        What the command column holds: the number sent to the amplifier (``dac``), the voltage at the stack
        (``stack``), or what the amplifier's monitor shows of it (``monitor``). The last two were taken behind the
        amplifier, so that its limits and its bandwidth are in them already.
    limits
        Lowest and highest command the bench allows [V]; None if not stated.
    closed_loop
        Whether a controller made the command from the reading: then the command carries the sensor's noise.
    payload
        Mass added at the output [kg].
    temperature
        Of the stage [K]; None if not stated.
    axis
        The axis that a command named ``u`` drives; None if not stated.
    sensors
        What is known of the sensors, by column.
    role_is_stated, between_is_stated
        Whether somebody chose the role, `split` leaves such runs alone; or said what happens between samples.
    noise_gain
        White noise of these readings over that of the readings as they were recorded, where these were decimated.
    steps
        Smallest difference between two readings as they were recorded, where these were decimated, by column; zero
        where they do not show it.
    remarks
        What was wrong with the recording, where, and what was done about it.
    """

    name: str
    time: Array
    columns: Mapping[str, Array]
    si: Mapping[str, str]
    between_samples: Between = "linear"
    role: Role = "identify"
    kind: str = ""
    command_is: CommandIs = "dac"
    limits: tuple[float, float] | None = None
    closed_loop: bool = False
    payload: float = 0.0
    temperature: float | None = None
    axis: str | None = None
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    role_is_stated: bool = False
    between_is_stated: bool = False
    noise_gain: float = 1.0
    steps: Mapping[str, float] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @property
    def record(self) -> str:
        """The name, without the number of a run that is a block of a longer record."""
        return self.name.partition(":")[0]

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of the command columns."""
        return tuple(name for name in COMMANDS if name in self.columns)

    @property
    def responses(self) -> tuple[str, ...]:
        """Names of the response columns, in the order of the axes."""
        return tuple(name for name in AXES if name in self.columns)

    def command(self) -> Array:
        """Return the command [V]: n values, or commands x n where there are several."""
        return self._together(self.commands)

    def measured(self) -> Array:
        """Return the response [m, rad, or V for an electronic analogue]: n values, or axes x n where there are several.

        NaN where it was not read, or cannot be used.
        """
        return self._together(self.responses)

    def _together(self, names: tuple[str, ...]) -> Array:
        return self.columns[names[0]] if len(names) == 1 else np.stack([self.columns[name] for name in names])


def commanded_by(name: str, there: Mapping[str, Array]) -> str | None:
    """Return the column that commands an axis, of those that are there: ``ux`` for ``x``, or ``u``; None if none does.

    >>> commanded_by("x", {"ux": np.zeros(1), "uy": np.zeros(1)})
    'ux'
    """
    return next((column for column in (f"u{name}", "u") if column in there), None)

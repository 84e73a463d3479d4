"""A plan: the commands that a bench shall run, within its limits, to reveal effects or to distinguish two."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flexdesign.core import units
from flexdesign.core.errors import InputError
from flexdesign.diagnosis.experiment_design import command_files, limits
from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.experiment_design.discrimination import (
    ASSUMED_NOISE,
    Resolved,
    required_experiments,
    resolve_effects,
)
from flexdesign.diagnosis.experiment_design.experiments import other_excitations, suite_of
from flexdesign.diagnosis.experiment_design.limits import Limits, StatedLimits
from flexdesign.dynamics.stage_model import AxisModel, StageModel


@dataclass(frozen=True)
class Request:
    """What a plan is asked for. Numbers are texts with units; None where the model is to say.

    Parameters
    ----------
    resolve
        Two effects to be distinguished; None for the whole plan.
    axis
        Which axis; None for the first.
    volts
        Lowest and highest command, narrower than the model's: ``("0 V", "100 V")``.
    slew
        Fastest change of the command, ``"2000 V/s"``; ``"none"`` if nothing limits it.
    current, bandwidth, rate
        Largest current of the driver; no tone above this frequency; sampling rate.
    sensor_noise
        Standard deviation of a reading at rest.
    seed
        Of random phases and levels.
    """

    resolve: tuple[str, str] | None = None
    axis: str | None = None
    volts: tuple[str, str] | None = None
    slew: str | None = None
    current: str | None = None
    bandwidth: str | None = None
    rate: str | None = None
    sensor_noise: str | None = None
    seed: int = 1


@dataclass(frozen=True)
class Plan:
    """Commands for a bench.

    Parameters
    ----------
    title
        What is measured.
    axis, model
        The axis and its numbers.
    commands
        What to send, in order.
    limits
        What the commands keep to.
    resolved
        The two effects that are distinguished; None for the whole plan.
    noise
        Of the sensor, rms [response]; None if unknown.
    """

    title: str
    axis: str
    model: AxisModel
    commands: Sequence[Command]
    limits: Limits
    resolved: Resolved | None
    noise: float | None

    @property
    def files(self) -> Mapping[str, Command]:
        """The commands by the names of their files."""
        return command_files.names(self.commands)

    def write(self, folder: Path) -> list[Path]:
        """Write the command files and measurements.toml; return their paths."""
        return command_files.write(folder, self.commands, self.axis, self.model, self.limits, self.title, self.noise)


def plan_experiments(model: StageModel, request: Request, progress: Callable[[str], None] = lambda _: None) -> Plan:
    """Plan experiments on one axis of a stage.

    Raises
    ------
    InputError
        If a number of the request cannot be used, or nothing says how fast the voltage may change.
    """
    chosen = limits.axis(model, request.axis)
    axis = model.axes[chosen]
    asked = StatedLimits(
        None if request.volts is None else (_number("--volts", request.volts[0], "V"),
                                            _number("--volts", request.volts[1], "V")),
        math.inf if request.slew == "none" else _stated_value("--slew", request.slew, "V/s"),
        _stated_value("--current", request.current, "A"),
        _stated_value("--bandwidth", request.bandwidth, "Hz"),
        _stated_value("--rate", request.rate, "Hz"),
    )  # fmt: skip
    noise = _stated_value("--sensor-noise", request.sensor_noise, axis.response) or axis.sensor.noise or None
    limits_ = limits.of_axis(model, chosen, asked)
    if request.slew is None:
        limits.require_slew_limit(model, chosen, limits_)
    progress("shaping the commands")
    dynamics = limits.dynamics(model, chosen, limits_)
    commands, resolved = suite_of(dynamics, limits_, request.seed), None
    if request.resolve:
        progress(f"simulating {request.resolve[0]} and {request.resolve[1]}")
        menu = [*commands, *other_excitations(dynamics, limits_)]
        resolved = resolve_effects(dynamics, request.resolve, menu, noise or ASSUMED_NOISE * dynamics.stroke)
        commands = required_experiments(commands, resolved)
    title = f"{model.title or model.name}: axis {chosen} on the bench"
    return Plan(title, chosen, axis, commands, limits_, resolved, noise)


def _stated_value(option: str, text: str | None, si: str) -> float | None:
    return _number(option, text, si) if text else None


def _number(option: str, text: str, si: str) -> float:
    """Return a number in SI; more than zero, unless it is a voltage."""
    try:
        value = units.from_text(text, si, small=True)
        if si != "V" and not value > 0:
            raise ValueError("must be more than zero")
    except ValueError as error:
        raise InputError("command line", option, text, str(error)) from None
    return value

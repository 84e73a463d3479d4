"""A plan: the commands that a bench shall run, within its limits, to reveal effects or to distinguish two."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from flexdesign.core import unit_tables, units
from flexdesign.core.errors import InputError
from flexdesign.core.toml_files import FORMAT, quote
from flexdesign.core.toml_writing import with_comment
from flexdesign.core.whole_files import written_whole
from flexdesign.diagnosis.experiment_design import limits
from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.experiment_design.discrimination import Resolved, resolve_effects
from flexdesign.diagnosis.experiment_design.experiments import ADDED_MASS, suite_of
from flexdesign.diagnosis.experiment_design.limits import Limits
from flexdesign.diagnosis.preparation.dataset import OF_STROKE
from flexdesign.dynamics.axis.axis_choice import choose_axis
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.measurements.recordings import AXES, DESCRIPTION


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
    seed
        Of random phases and levels.
    """

    title: str
    axis: str
    model: AxisModel
    commands: Sequence[Command]
    limits: Limits
    resolved: Resolved | None
    noise: float | None
    seed: int = 1

    @property
    def files(self) -> Mapping[str, Command]:
        """The commands by the names of their files, numbered in the order in which to run them."""
        return {f"{number:02d}_{command.name}.csv": command for number, command in enumerate(self.commands, start=1)}

    def write(self, folder: Path) -> list[Path]:
        """Write the command files and measurements.toml into a folder, which is made if needed; return their paths.

        Every file has the columns ``t [s]`` and ``u [V]``; a recorded response is added as a third, and the folder
        is ready for `flexdesign.measurements.recordings.read_runs`.

        Raises
        ------
        InputError
            If the folder cannot be written.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with written_whole(folder) as scratch:
                for name, command in self.files.items():
                    columns = {"t [s]": command.time, "u [V]": command.samples}
                    unit_tables.write(scratch / name, columns, _comment(command, self.axis, self.limits))
                (scratch / DESCRIPTION).write_text(self.description(), encoding="utf-8")
        except OSError as error:
            raise InputError(folder, "", None, f"cannot be written: {error.strerror}; choose another folder") from error
        return [folder / DESCRIPTION, *(folder / name for name in self.files)]

    def description(self) -> str:
        """Return measurements.toml: roles, kinds and conditions filled in, the bench left to the user."""
        lines = [
            "# Record the response to each command and add it to its file as a third column; "
            "then correct what differs.",
            f"format = {FORMAT}",
            f"title = {quote(self.title)}",
            f'axis = "{self.axis}"',
            with_comment('command_is = "dac"', "what u is: dac (what was sent), stack or monitor"),
            f'limits = ["{self.limits.low:g} V", "{self.limits.high:g} V"]',
            with_comment('between_samples = "hold"', "what the command does between its samples"),
            "closed_loop = false",
            "",
            f"[sensors.{self.axis}]",
            *_sensor(self.axis, self.model, self.noise),
        ]
        for file, command in self.files.items():
            lines += ["", "[[run]]", f'file = "{file}"', f'kind = "{command.kind}"', f'role = "{command.role}"']
            lines += _conditions(command, self.model)
        return "\n".join(lines) + "\n"


def plan_experiments(
    model: StageModel,
    progress: Callable[[str], None] = lambda _: None,
    *,
    resolve: tuple[str, str] | None = None,
    axis: str | None = None,
    volts: tuple[str, str] | None = None,
    slew: str | None = None,
    current: str | None = None,
    bandwidth: str | None = None,
    rate: str | None = None,
    sensor_noise: str | None = None,
    seed: int = 1,
) -> Plan:
    """Plan experiments on one axis of a stage. Limits are texts with units; None where the model is to say.

    Parameters
    ----------
    model, progress
        The stage, and what receives a text about the progress.
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

    Raises
    ------
    InputError
        If a number cannot be used, or nothing says how fast the voltage may change.
    """
    chosen = choose_axis(model, [], axis or next(iter(model.axes)))
    axis_model = model.axes[chosen]
    kept = limits.of_axis(
        model,
        chosen,
        volts=volts and (_number("--volts", volts[0], "V"), _number("--volts", volts[1], "V")),
        slew=math.inf if slew == "none" else _stated_value("--slew", slew, "V/s"),
        current=_stated_value("--current", current, "A"),
        bandwidth=_stated_value("--bandwidth", bandwidth, "Hz"),
        rate=_stated_value("--rate", rate, "Hz"),
    )
    noise = _stated_value("--sensor-noise", sensor_noise, axis_model.response) or axis_model.sensor.noise or None
    if slew is None and math.isinf(kept.slew):
        raise limits.slew_is_missing(model, chosen, kept)
    progress("shaping the commands")
    dynamics = kept.dynamics(model, chosen)
    experiments, resolved = suite_of(dynamics, kept, seed), None
    commands = [command for command in experiments if command.is_file]
    if resolve:
        progress(f"simulating {resolve[0]} and {resolve[1]}")
        resolved = resolve_effects(dynamics, resolve, experiments, noise or OF_STROKE * dynamics.stroke)
        commands = [command for command in commands if command.name in resolved.required]
    title = f"{model.title or model.name}: axis {chosen} on the bench"
    return Plan(title, chosen, axis_model, commands, kept, resolved, noise, seed)


def _stated_value(option: str, text: str | None, si: str) -> float | None:
    return None if text is None else _number(option, text, si)


def _number(option: str, text: str, si: str) -> float:
    """Return a number in SI; more than zero, unless it is a voltage."""
    try:
        value = units.from_text(text, si, small=True)
        if si != "V" and not value > 0:
            raise ValueError("must be more than zero")
    except ValueError as error:
        raise InputError("command line", option, text, str(error)) from None
    return value


def _comment(command: Command, axis: str, limits: Limits) -> str:
    before = f"Before: {command.note}.\n" if command.note else ""
    return (
        f"{command.name}, axis {axis}: {command.purpose}.\nHeld between samples at {limits.rate:g} Hz.\n{before}"
        f"Record the response as a third column, such as {axis} [um]."
    )


def _sensor(axis: str, model: AxisModel, noise: float | None) -> list[str]:
    small, large = {"m": ("nm", "um"), "rad": ("nrad", "urad"), "V": ("mV", "V")}[model.response]
    along = [int(axis == name) for name in AXES]
    remarks = f'noise = "{units.to_text(noise, small, 3, model.response)}"' if noise else f'# noise = "... {small}"'
    span = f'# range = ["... {large}", "... {large}"]'
    if model.sensor.range is not None:
        low, high = (units.to_text(end, large, 6, model.response) for end in model.sensor.range)
        span = f'range = ["{low}", "{high}"]'
    return [
        with_comment(remarks, "standard deviation of a reading at rest"),
        span,
        with_comment('# point = ["x mm", "y mm", "z mm"]', "where on the table it looks"),
        f"direction = {along}",
    ]


def _conditions(command: Command, model: AxisModel) -> list[str]:
    if not command.mass_ratio:
        return ['conditions = { payload = "0 g" }']
    if model.mass is None:
        return ["# weigh the mass, and write it here:", '# conditions = { payload = "... g" }']
    mass = units.to_text(ADDED_MASS * model.mass, "g", 2, "kg")
    return [with_comment(f'conditions = {{ payload = "{mass}" }}', "suggested; write what you weighed")]

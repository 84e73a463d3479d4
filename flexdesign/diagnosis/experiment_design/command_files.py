"""Command files for the bench: one CSV for each experiment, and the measurements.toml that says what they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from flexdesign.core import unit_tables, units
from flexdesign.core.errors import InputError
from flexdesign.core.toml_files import FORMAT, quote
from flexdesign.core.toml_writing import with_comment
from flexdesign.core.whole_files import written_whole
from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.experiment_design.experiments import ADDED_MASS
from flexdesign.diagnosis.experiment_design.limits import Limits
from flexdesign.dynamics.stage_model import AxisModel
from flexdesign.measurements.recordings import AXES, DESCRIPTION

#: Where the comments of a description begin.
_COLUMN = 44


def names(commands: Sequence[Command]) -> dict[str, Command]:
    """Return the commands by the names of their files, numbered in the order in which to run them."""
    return {f"{number:02d}_{command.name}.csv": command for number, command in enumerate(commands, start=1)}


def write(folder: Path, commands: Sequence[Command], axis: str, model: AxisModel, limits: Limits, title: str,
          noise: float | None = None) -> list[Path]:  # fmt: skip
    """Write command files and their description.

    Every file has the columns ``t [s]`` and ``u [V]``; a recorded response is added as a third, and the folder
    is ready for `flexdesign.measurements.recordings.read_runs`.

    Parameters
    ----------
    folder
        Where to; it is made if it is not there.
    commands
        What to send, in order; those that need more than a command are none.
    axis, model
        The axis and its numbers.
    limits
        What the commands keep to.
    title
        What is measured.
    noise
        Of the sensor, rms [response]; None if unknown.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    named = names(commands)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with written_whole(folder) as scratch:
            for name, command in named.items():
                columns = {"t [s]": command.time, "u [V]": command.samples}
                unit_tables.write(scratch / name, columns, _comment(command, axis, limits))
            (scratch / DESCRIPTION).write_text(description(named, axis, model, limits, title, noise), encoding="utf-8")
    except OSError as error:
        raise InputError(folder, "", None, f"cannot be written: {error.strerror}; choose another folder") from error
    return [folder / DESCRIPTION, *(folder / name for name in named)]


def _comment(command: Command, axis: str, limits: Limits) -> str:
    held = f"Held between samples at {limits.rate:g} Hz."
    lines = [f"{command.name}, axis {axis}: {command.purpose}.", held]
    if command.note:
        lines.append(f"Before: {command.note}.")
    lines.append(f"Record the response as a third column, such as {axis} [um].")
    return "\n".join(lines)


def description(
    named: Mapping[str, Command], axis: str, model: AxisModel, limits: Limits, title: str, noise: float | None
) -> str:
    """Return measurements.toml for command files: roles, kinds and conditions filled in, the bench left to the user."""
    lines = [
        "# Record the response to each command and add it to its file as a third column; then correct what differs.",
        f"format = {FORMAT}",
        f"title = {quote(title)}",
        f'axis = "{axis}"',
        with_comment('command_is = "dac"', "what u is: dac (what was sent), stack or monitor", _COLUMN),
        f'limits = ["{limits.low:g} V", "{limits.high:g} V"]',
        with_comment('between_samples = "hold"', "what the command does between its samples", _COLUMN),
        "closed_loop = false",
        "",
        f"[sensors.{axis}]",
        *_sensor(axis, model, noise),
    ]
    for file, command in named.items():
        lines += ["", "[[run]]", f'file = "{file}"', f'kind = "{command.kind}"', f'role = "{command.role}"']
        lines += _conditions(command, model)
    return "\n".join(lines) + "\n"


def _sensor(axis: str, model: AxisModel, noise: float | None) -> list[str]:
    small, large = {"m": ("nm", "um"), "rad": ("nrad", "urad"), "V": ("mV", "V")}[model.response]
    along = [int(axis == name) for name in AXES]
    remarks = f'noise = "{units.to_text(noise, small, 3, model.response)}"' if noise else f'# noise = "... {small}"'
    span = f'# range = ["... {large}", "... {large}"]'
    if model.sensor.range is not None:
        low, high = (units.to_text(end, large, 6, model.response) for end in model.sensor.range)
        span = f'range = ["{low}", "{high}"]'
    return [
        with_comment(remarks, "standard deviation of a reading at rest", _COLUMN),
        span,
        with_comment('# point = ["... mm", "... mm", "... mm"]', "where on the table it looks", _COLUMN),
        f"direction = {along}",
    ]


def _conditions(command: Command, model: AxisModel) -> list[str]:
    if not command.mass_ratio:
        return ['conditions = { payload = "0 g" }']
    if model.mass is None:
        return ["# weigh the mass, and write it here:", '# conditions = { payload = "... g" }']
    mass = units.to_text(ADDED_MASS * model.mass, "g", 2, "kg")
    return [with_comment(f'conditions = {{ payload = "{mass}" }}', "suggested; write what you weighed", _COLUMN)]

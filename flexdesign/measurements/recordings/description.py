"""``measurements.toml``: the description of the recordings next to it.

::

    title = "Bench 3, first assembly"
    axis = "x"                            # which axis a command named u drives
    command_is = "monitor"                # or "dac" (what was sent), "stack" (the voltage at the stack itself)
    scale = 20                            # the monitor shows a twentieth of the voltage
    bias = "0 V"                          # added after scaling
    limits = ["0 V", "150 V"]             # what the bench allows, after scaling
    between_samples = "hold"              # or "linear", or "smooth": a measured command without its highest frequencies
    noise = "3 nm"                        # standard deviation, of every axis whose sensor is not described
    decimate = 20                         # every 20th sample is used, behind a low-pass; noise is that of all samples
    [sensors.x]
    noise = "2 nm"
    range = ["0 um", "100 um"]
    point = ["0 mm", "12 mm", "3 mm"]
    direction = [1, 0, 0]
    [[run]]
    file = "multisine.csv"
    kind = "multisine"
    role = "identify"                     # fitted; or "validate" (chooses the model), "test" (neither, only its error)
    closed_loop = false
    conditions = { payload = "50 g", temperature = "23 degC" }
    [[run]]
    file = "response.csv"                 # a frequency response
    input = "dac"                         # what the command was, as command_is says of runs
    output = "x"                          # the axis that was read
    amplitude = "2 V"                     # of a sine stepped from line to line; left out for a multisine
    bias = "40 V"                         # about which the command moved
    averages = 16                         # of each line
    band = ["1 Hz", "1.3 kHz"]            # lines outside are left out
    period = "0.1 ms"                     # between samples of a command that is held; left out for a continuous one

Everything may be left out. What a ``[[run]]`` says of ``closed_loop``, ``between_samples`` and ``decimate`` goes before
what the top of the file says of all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np
from pydantic import BeforeValidator

from flexdesign.core import toml_files, units
from flexdesign.core.errors import InputError
from flexdesign.core.toml_files import in_si
from flexdesign.core.unit_tables import KELVIN
from flexdesign.measurements.recordings.run import AXES, Between, CommandIs, Role

#: No scale of a monitor is smaller.
SMALLEST = 1e-9
#: The file that describes the runs of a folder.
NAME = "measurements.toml"
#: What a sensor may read in.
READINGS = ("m", "V", "rad", "A", "N", "K")


@dataclass(frozen=True)
class Reading:
    """A number that a sensor could show: its value in SI, and the SI unit."""

    value: float
    si: str


def _one_of(*words: str) -> BeforeValidator:
    def read(given: Any) -> Any:
        if given not in words:
            raise ValueError(f"expected {' or '.join(words)}")
        return given

    return BeforeValidator(read)


def _reading(given: Any, *, small: bool = False) -> Reading:
    refusals = []
    for si in READINGS:
        try:
            return Reading(units.from_text(given, si, small=small), si)
        except ValueError as error:
            refusals.append(error)
    raise refusals[0]


def _noise(given: Any) -> Reading:
    found = _reading(given, small=True)
    if not found.value > 0:
        raise ValueError("must be more than zero")
    return found


def _span(of: Callable[[Any], Any], example: str) -> BeforeValidator:
    def read(given: Any) -> Any:
        if not isinstance(given, list) or len(given) != 2:
            raise ValueError(f"expected the lowest and the highest: {example}")
        low, high = of(given[0]), of(given[1])
        if isinstance(low, Reading) and low.si != high.si:
            raise ValueError("mixes units of different kinds; give both in the unit of the reading")
        if not getattr(low, "value", low) < getattr(high, "value", high):
            raise ValueError("the first must be the lower one")
        return low, high

    return BeforeValidator(read)


def _point(given: Any) -> tuple[float, ...]:
    return _three(given, "m", 'point = ["0 mm", "12 mm", "3 mm"]')


def _direction(given: Any) -> tuple[float, ...]:
    along = _three(given, "1", "direction = [1, 0, 0]")
    length = float(np.linalg.norm(along))
    if not length:
        raise ValueError("has no length; write for example [1, 0, 0]")
    return tuple(each / length for each in along)


def _three(given: Any, si: str, example: str) -> tuple[float, ...]:
    if not isinstance(given, list) or len(given) != 3:
        raise ValueError(f"expected three along x, y and z: {example}")
    return tuple(units.from_text(each, si) for each in given)


def _kelvin(given: Any) -> float:
    if isinstance(given, str):
        for unit, zero in KELVIN.items():
            if given.strip().endswith(unit):
                return units.from_text(f"{given.strip().removesuffix(unit)} K", "K") + zero
    raise ValueError('is no temperature; write for example "23 degC"')


def _volts(given: Any) -> float:
    return units.from_text(given, "V")


def _hertz(given: Any) -> float:
    return units.from_text(given, "Hz")


class SensorTable(toml_files.Table):
    """``[sensors.x]``: what is known of the sensor behind the column x."""

    noise: Annotated[Any, BeforeValidator(_noise)] = None
    range: Annotated[Any, _span(_reading, 'range = ["0 um", "100 um"]')] = None
    point: Annotated[Any, BeforeValidator(_point)] = None
    direction: Annotated[Any, BeforeValidator(_direction)] = None


class SensorTables(toml_files.Table):
    """``[sensors]``, by the column that a sensor gives."""

    x: SensorTable | None = None
    y: SensorTable | None = None
    z: SensorTable | None = None
    v: SensorTable | None = None
    i: SensorTable | None = None
    f: SensorTable | None = None
    T: SensorTable | None = None


class Conditions(toml_files.Table):
    """What differed from the stage as it is modelled."""

    payload: in_si("kg", 0.0, 1e3) = 0.0  # type: ignore[valid-type]
    temperature: Annotated[float | None, BeforeValidator(_kelvin)] = None


#: What can be said of a recording in time alone, and of a frequency response alone.
OF_RUNS = ("closed_loop", "between_samples", "decimate")
OF_RESPONSES = ("input", "output", "amplitude", "bias", "averages", "band", "period")


class RunSettings(toml_files.Table):
    """What can be said of one run."""

    kind: str = ""
    role: Annotated[Role | None, _one_of(*get_args(Role))] = None
    conditions: Conditions = Conditions()
    closed_loop: bool | None = None
    between_samples: Annotated[Between | None, _one_of(*get_args(Between))] = None
    decimate: toml_files.whole(1, 1_000_000) | None = None  # type: ignore[valid-type]
    # Of frequency responses alone:
    input: Annotated[CommandIs | None, _one_of(*get_args(CommandIs))] = None
    output: Annotated[str | None, _one_of(*AXES)] = None
    amplitude: in_si("V", 0.0, 1e9) | None = None  # type: ignore[valid-type]
    bias: in_si("V", -1e9, 1e9) | None = None  # type: ignore[valid-type]
    averages: toml_files.whole(1, 10**9) | None = None  # type: ignore[valid-type]
    band: Annotated[Any, _span(_hertz, 'band = ["1 Hz", "1.3 kHz"]')] = None
    period: in_si("s", 0.0, 1e3) | None = None  # type: ignore[valid-type]


class RunTable(RunSettings):
    """``[[run]]``."""

    file: str


class Setup(toml_files.Table):
    """What is said of all runs; `run` stands here so that a misspelt ``[[runs]]`` is understood."""

    format: int = toml_files.FORMAT
    title: str = ""
    axis: Annotated[str | None, _one_of(*AXES)] = None
    command_is: Annotated[CommandIs, _one_of(*get_args(CommandIs))] = "dac"
    scale: in_si("1", -1e9, 1e9) = 1.0  # type: ignore[valid-type]
    bias: Annotated[float, BeforeValidator(_volts)] = 0.0
    limits: Annotated[Any, _span(_volts, 'limits = ["0 V", "150 V"]')] = None
    closed_loop: bool | None = None
    between_samples: Annotated[Between | None, _one_of(*get_args(Between))] = None
    decimate: toml_files.whole(1, 1_000_000) = 1  # type: ignore[valid-type]
    noise: Annotated[Any, BeforeValidator(_noise)] = None
    sensors: SensorTables = SensorTables()
    run: Any = None


@dataclass(frozen=True)
class Measurements:
    """What ``measurements.toml`` says.

    Parameters
    ----------
    path
        The file.
    setup
        What holds for all runs.
    runs
        What it says of each, by the name of the file.
    """

    path: Path
    setup: Setup
    runs: Mapping[str, RunSettings]

    @property
    def title(self) -> str:
        """What was measured."""
        return self.setup.title


def read_measurements(path: Path) -> Measurements:
    """Read ``measurements.toml``.

    Raises
    ------
    InputError
        If a key is unknown, a value cannot be used, or two tables name one file.
    """
    content = toml_files.read_toml(path)
    tables: Any = content.pop("run", [])
    setup = toml_files.check(Setup, content, path) if content else Setup()
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError(path, "run", None, "expected a list of tables: [[run]]")
    if abs(setup.scale) < SMALLEST:
        remedy = "makes every command zero; write the volts of the command per volt written"
        raise InputError(path, "scale", f"{setup.scale:g}", remedy)
    stated_runs: dict[str, RunSettings] = {}
    for number, table in enumerate(tables, start=1):
        place = f"run {number}"
        run = toml_files.check(RunTable, table, path, place)
        if run.file in stated_runs:
            raise InputError(path, f"{place}.file", run.file, "is described twice; keep one of the two tables")
        stated_runs[run.file] = run
    return Measurements(path, setup, stated_runs)


def require_applicable(measurements: Measurements, settings: RunSettings, *, of_run: bool) -> None:
    """Raise InputError if a ``[[run]]`` says of a run what only a frequency response has, or the other way around."""
    for key in OF_RESPONSES if of_run else OF_RUNS:
        if key in settings.model_fields_set:
            kinds = ("a frequency response", "a recording in time") if of_run else ("runs", "a frequency response")
            file = settings.file if isinstance(settings, RunTable) else ""
            value = toml_files.as_written(getattr(settings, key))
            remedy = f"holds for {kinds[0]}, and {file} is {kinds[1]}; leave it out"
            raise InputError(measurements.path, f"run.{key}", value, remedy)

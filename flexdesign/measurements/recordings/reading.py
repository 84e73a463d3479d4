"""Files of recorded runs: read with all that can be wrong with them, and written."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from flexdesign.core import parquet, toml_files, unit_tables
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.unit_tables import Sheet
from flexdesign.measurements.recordings import (
    decimation,
    description,
    frequency_response,
    gap_filling,
    reading_steps,
    sensor_faults,
    time_base,
)
from flexdesign.measurements.recordings.description import (
    Measurements,
    RunSettings,
    SensorTable,
    Setup,
    read_measurements,
    require_applicable,
)
from flexdesign.measurements.recordings.frequency_response import FrequencyResponse
from flexdesign.measurements.recordings.run import AXES, COMMANDS, Run, Sensor

#: Which SI units a column may have. An electronic analogue of a stage answers in volts.
ALLOWED = {
    "t": ("s",),
    **dict.fromkeys([*COMMANDS, "v", "vx", "vy", "vz"], ("V",)),
    **dict.fromkeys([*AXES, "r", "rx", "ry", "rz"], ("m", "V", "rad")),
    **dict.fromkeys(["i", "ix", "iy", "iz"], ("A",)),
    **dict.fromkeys(["f", "fx", "fy", "fz"], ("N",)),
    "T": ("K",),
}
#: With fewer rows nothing can be said about dynamics.
FEWEST = 10
#: What to do with a table whose header is not written for flexdesign.
BRING_IN = "; bring a file of another program in with flexdesign import"
#: How files of runs end.
ENDINGS = (".csv", parquet.SUFFIX)


def read_run(path: str | Path) -> Run:
    """Read one file, CSV or Parquet, and its description in ``measurements.toml`` next to it.

    Header cells are ``name [unit]``: time ``t``, command ``u`` (or ``ux``, ``uy``, ``uz``), responses ``x``, ``y``,
    ``z``; if recorded, reference ``r``, voltage at the stack ``v``, current ``i``, force ``f``, temperature ``T``.
    Other columns are carried along. Commands become scale * command + bias, as ``measurements.toml`` has them, so that
    they are volts of what `Run.command_is` names; a column ``v`` is kept as it is. A recorded reference means a closed
    loop unless ``closed_loop`` says otherwise.

    What can be used is used, and `Run.remarks` says what was done: copies of rows are left out, rows out of order
    sorted, irregular times resampled to their median period; readings that are missing, beyond the range of the sensor,
    saturated or stuck are NaN; short gaps of the command are bridged.

    Raises
    ------
    InputError
        If the file is no such table, a unit is wrong, a cell is no number, time runs backwards, there are fewer than
        ten usable rows, command or response is missing, no reading can be used, or the command has a long gap.
    """
    path = Path(path)
    measurements = _measurements_next_to(path)
    try:
        sheet = unit_tables.read(path, ALLOWED, gaps=True)
    except InputError as error:
        if "header cell" not in error.field or "import" in error.remedy:
            raise
        raise InputError(error.file, error.field, error.value, error.remedy + BRING_IN) from error
    _needs(sheet, COMMANDS, "command", "u [V]")
    _needs(sheet, AXES, "response", "x [um]")
    if "u" in sheet.values and any(name in sheet.values for name in COMMANDS[1:]):
        raise InputError(path, "header", None, "has u and also ux, uy or uz; name every command by its axis")
    return _run(sheet, measurements, measurements.runs.get(path.name, RunSettings()))


def _run(sheet: Sheet, measurements: Measurements, settings: RunSettings) -> Run:
    setup = measurements.setup
    require_applicable(measurements, settings, of_run=True)
    sensors = _sensors(sheet, measurements)
    stated = settings.between_samples or setup.between_samples
    between = stated or "linear"
    _enough(sheet.path, len(sheet.lines))
    sheet, out_of_order = time_base.in_order(sheet)
    _enough(sheet.path, len(sheet.lines))
    sheet, unbelievable = sensor_faults.mask_faults(sheet, sensors)
    grid, uneven = time_base.grid_of(sheet)
    time, recorded, left_out = time_base.trim(grid.time, time_base.on_grid(sheet, grid, between))
    _enough(sheet.path, len(time))
    recorded, bridges = gap_filling.fill_gaps(sheet, time, recorded, between)
    fewer, noise_gain, steps = tuple[str, ...](), 1.0, dict[str, float]()
    if (factor := settings.decimate or setup.decimate) > 1:
        steps = {name: reading_steps.smallest_step(recorded[name]) for name in recorded if name in AXES}
        count = len(time)
        time, recorded, remark = decimation.decimate(time, recorded, factor, between)
        _enough_left(measurements.path, factor, count, len(time))
        fewer, noise_gain, between, stated = (remark,), decimation.noise_gain(factor), "smooth", "smooth"
    closed = settings.closed_loop if settings.closed_loop is not None else setup.closed_loop
    commands = {name: setup.scale * values + setup.bias for name, values in recorded.items() if name in COMMANDS}
    recorded |= commands
    for values in recorded.values():
        values.setflags(write=False)
    return Run(
        name=sheet.path.stem,
        time=time,
        columns=recorded,
        si={name: sheet.si[name] for name in recorded},
        between_samples=between,
        role=settings.role or "identify",
        kind=settings.kind,
        command_is=setup.command_is,
        limits=setup.limits,
        closed_loop=any(name in recorded for name in ("r", "rx", "ry", "rz")) if closed is None else closed,
        payload=settings.conditions.payload,
        temperature=settings.conditions.temperature,
        axis=setup.axis,
        sensors=sensors,
        role_is_stated=settings.role is not None,
        between_is_stated=stated is not None,
        noise_gain=noise_gain,
        steps=steps,
        remarks=(*out_of_order, *unbelievable, *uneven, *left_out, *bridges, *_beyond(commands, setup.limits), *fewer),
    )


def read_frequency_response(path: str | Path) -> FrequencyResponse:
    """Read a frequency response, and its description in ``measurements.toml`` next to it.

    See `flexdesign.measurements.recordings.frequency_response` for what may stand in the file.

    Raises
    ------
    InputError
        If it cannot be used.
    """
    path = Path(path)
    measurements = _measurements_next_to(path)
    return frequency_response.read(path, measurements, measurements.runs.get(path.name, RunSettings()))


def read_recordings(paths: Iterable[str | Path]) -> tuple[Run | FrequencyResponse, ...]:
    """Read runs and frequency responses: files, and all CSV and Parquet files of folders in alphabetical order.

    A file whose first column is ``f [Hz]`` is a frequency response; one that is named twice is read once. A
    ``measurements.toml`` stands for its folder.

    Raises
    ------
    InputError
        If a path does not exist, a folder has no such file or lacks one that its ``measurements.toml`` names, or a file
        cannot be read.
    """
    found: dict[Path, Run | FrequencyResponse] = {}
    for path in map(Path, paths):
        folder = path.parent if path.name == description.NAME else path
        for file in _recordings(folder) if toml_files.is_folder(folder) else [path]:
            if file.resolve() not in found:
                is_response = frequency_response.is_frequency_response(file)
                found[file.resolve()] = read_frequency_response(file) if is_response else read_run(file)
    times = Counter(each.name for each in found.values())
    return tuple(
        each if times[each.name] == 1 else replace(each, name=f"{file.parent.name}/{each.name}")
        for file, each in found.items()
    )


def read_runs(paths: Iterable[str | Path]) -> tuple[Run, ...]:
    """Read runs in time alone, as `read_recordings` does.

    Raises
    ------
    InputError
        If a path does not exist, a folder has no such file or lacks one that its ``measurements.toml`` names, a run
        cannot be read, or a file holds a frequency response.
    """
    return runs_alone(read_recordings(paths))


def runs_alone(found: Iterable[Run | FrequencyResponse]) -> tuple[Run, ...]:
    """Return recordings of which each must be a run in time.

    Raises
    ------
    InputError
        If one is a frequency response.
    """
    runs = []
    for each in found:
        if isinstance(each, FrequencyResponse):
            remedy = (
                "is a frequency response, which compare, diagnose and add take; here runs in time are needed. "
                "flexdesign diagnose fits gain, damping and natural frequency to it and writes the model"
            )
            raise InputError(each.name, "header", "f [Hz]", remedy)
        runs.append(each)
    return tuple(runs)


def write_run(
    path: str | Path, time: Array, recorded: Mapping[str, Array], comment: str = "", *, gaps: bool = False
) -> None:
    """Write a run as `read_run` reads it, whole or not at all; as Parquet where the name ends in ``.parquet``.

    Parameters
    ----------
    path
        Where to; a file that is there is replaced.
    time
        n moments [s].
    recorded
        By header cell, such as ``x [um]``: n values in SI, written in the unit of the cell.
    comment
        Lines that go above the header.
    gaps
        Whether values may be NaN: where nothing was read.

    Raises
    ------
    ValueError
        If a header cell has no unit, lengths differ, or a value is not finite.
    InputError
        If the file cannot be written.
    """
    unit_tables.write(Path(path), {"t [s]": time, **recorded}, comment, gaps=gaps)


def _measurements_next_to(path: Path) -> Measurements:
    """Return ``measurements.toml`` next to a file."""
    file = path.parent / description.NAME
    return read_measurements(file) if file.is_file() else Measurements(file, Setup(), {})


def _needs(sheet: Sheet, names: tuple[str, ...], what: str, example: str) -> None:
    if not any(name in sheet.values for name in names):
        remedy = f"there is no {what} ({', '.join(names)}); found {', '.join(sheet.values)}: add a column {example}"
        remedy += BRING_IN
        raise InputError(sheet.path, "header", None, remedy)


def _enough(path: Path, rows: int) -> None:
    if rows < FEWEST:
        raise InputError(path, "", None, f"has {rows} rows that can be used; at least {FEWEST} are needed")


def _enough_left(path: Path, factor: int, before: int, after: int) -> None:
    if after < FEWEST:
        remedy = (
            f"leaves {after} of {before} samples, and at least {FEWEST} are needed; at each end "
            f"{decimation.REACH * factor} are left out: choose a smaller number"
        )
        raise InputError(path, "decimate", f"{factor}", remedy)


def _sensors(sheet: Sheet, measurements: Measurements) -> dict[str, Sensor]:
    """Return what is known of the sensor of each column, checked against the column's unit."""
    found = {}
    for name in type(measurements.setup.sensors).model_fields:
        table: SensorTable | None = getattr(measurements.setup.sensors, name)
        field = f"sensors.{name}"
        if table is None and name in AXES and measurements.setup.noise is not None:
            table, field = SensorTable.model_construct(noise=measurements.setup.noise), "noise"
        if table is None or name not in sheet.values:
            continue
        readings = [each for each in (table.noise, *(table.range or ())) if each is not None]
        for reading in readings:
            if reading.si != sheet.si[name]:
                other = f"{name} of {sheet.path.name} in {sheet.unit[name]}"
                remedy = f"is in {reading.si}, but {other}; correct one of the two"
                raise InputError(measurements.path, field, None, remedy)
        noise = table.noise.value if table.noise else None
        span = (table.range[0].value, table.range[1].value) if table.range else None
        found[name] = Sensor(noise, span, table.point, table.direction)
    return found


def _beyond(commands: Mapping[str, Array], limits: tuple[float, float] | None) -> list[str]:
    """Return remarks about commands beyond what the bench allows."""
    if limits is None:
        return []
    near = 1e-6 * (limits[1] - limits[0])
    return [
        f"{name} goes from {values.min():.6g} V to {values.max():.6g} V, beyond the limits {limits[0]:g} V to "
        f"{limits[1]:g} V that are stated"
        for name, values in commands.items()
        if values.min() < limits[0] - near or values.max() > limits[1] + near
    ]


def _recordings(folder: Path) -> list[Path]:
    found = sorted(file for file in folder.iterdir() if file.suffix.lower() in ENDINGS and file.is_file())
    description_file = folder / description.NAME
    if description_file.is_file():
        names = [file.name for file in found]
        for name in read_measurements(description_file).runs:
            if name not in names:
                raise InputError(description_file, "run.file", name, f"is not in the folder{suggest(name, names)}")
    if not found:
        remedy = "has no CSV file; name a folder of recorded runs, or the files themselves"
        raise InputError(folder, "", None, remedy)
    return found

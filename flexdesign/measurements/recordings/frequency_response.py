"""Frequency responses: how large and how late a stage answers small sines, line by line.

A file of one has the frequency as its first column, in one of two shapes ::

    f [Hz], magnitude [um/V], phase [deg], coherence
    f [Hz], re [um/V], im [um/V], coherence

The coherence may be left out. Columns ``amplitude [V]``, ``bias [V]`` and ``averages`` hold one number each, the same
in all rows; ``measurements.toml`` may say them instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import unit_tables, units
from flexdesign.core.arrays import Array, Complex
from flexdesign.core.errors import InputError
from flexdesign.core.unit_tables import Sheet
from flexdesign.measurements.recordings.description import Measurements, RunSettings, require_applicable
from flexdesign.measurements.recordings.run import AXES, CommandIs, Role

#: How the first column is called, and how a file says its response: magnitude and phase, or both parts.
FREQUENCY, POLAR, PARTS = "f", ("magnitude", "phase"), ("re", "im")
#: Which SI units a response may have, by the unit of the motion: an electronic analogue answers volts with volts.
PER_VOLT = {"m/V": "m", "rad/V": "rad", "1": "V"}
#: Columns that are pure numbers, and columns with one number for all rows.
PLAIN, CONSTANT = ("coherence", "averages"), ("amplitude", "bias", "averages")
ALLOWED = {
    FREQUENCY: ("Hz",),
    "phase": ("rad",),
    **dict.fromkeys(("magnitude", "re", "im"), tuple(PER_VOLT)),
    **dict.fromkeys(("amplitude", "bias"), ("V",)),
    **dict.fromkeys(PLAIN, ("1",)),
}
#: With fewer lines nothing can be said about dynamics.
FEWEST_LINES = 8
#: A coherence may be above one by this much, which is rounding.
ROUNDED = 1e-6
#: Of one response every KEPT_LINE-th line is kept for validation, where nobody chose roles.
KEPT_LINE = 4


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """The measured answer of one axis to small sines; an `Observation` of 2n values.

    Parameters
    ----------
    name
        The stem of its file, with the folder before it where two stems would be the same.
    frequencies
        n lines, increasing [Hz].
    response
        n complex numbers, reading over command [SI unit of the motion per V]; NaN at lines that are not looked at.
    si
        SI unit of the motion.
    coherence
        n numbers between 0 and 1; None if it was not recorded.
    averages
        How many measurements each line is the mean of; None if not stated.
    amplitude
        Of the command, for a sine stepped from line to line [V]; None if not stated.
    bias
        Of the command [V].
    axis
        The axis that was read; None if not stated.
    command_is
        What the command was, as in `Run`.
    period
        Between samples, where the command was held between them [s]; None for a continuous signal.
    role, kind, payload, role_is_stated, remarks
        As in `Run`.
    """

    name: str
    frequencies: Array
    response: Complex
    si: str = "m"
    coherence: Array | None = None
    averages: int | None = None
    amplitude: float | None = None
    bias: float = 0.0
    axis: str | None = None
    command_is: CommandIs = "dac"
    period: float | None = None
    role: Role = "identify"
    kind: str = ""
    payload: float = 0.0
    role_is_stated: bool = False
    remarks: tuple[str, ...] = ()

    @property
    def responses(self) -> tuple[str, ...]:
        """Names of the axes that it may be of."""
        return AXES if self.axis is None else (self.axis,)

    @property
    def present(self) -> NDArray[np.bool_]:
        """Which lines are looked at."""
        return np.isfinite(self.response)

    def measured(self) -> Array:
        """Return the real parts, then the imaginary parts [SI unit of the motion per V]; NaN where not looked at.

        >>> FrequencyResponse("sine", np.array([1.0, 2.0]), np.array([1e-6, 1e-6j])).measured()
        array([1.e-06, 0.e+00, 0.e+00, 1.e-06])
        """
        return parts(self.response)


def parts(response: Complex) -> Array:
    """Return n complex numbers as 2n real ones, the real parts first."""
    found = np.concatenate([response.real, response.imag])
    return np.where(np.isfinite(np.tile(found[: len(response)] + found[len(response) :], 2)), found, np.nan)


def whole(values: Array) -> Complex:
    """Return 2n real numbers as n complex ones: what `parts` undoes."""
    half = len(values) // 2
    return np.asarray(values[:half] + 1j * values[half:])


def is_frequency_response(path: Path) -> bool:
    """Tell whether a CSV file has the frequency as its first column."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            header = next((line for line in file if line.strip() and not line.lstrip().startswith("#")), "")
    except (OSError, UnicodeDecodeError):
        return False
    return header.partition(",")[0].strip().strip('"').partition("[")[0].strip() == FREQUENCY


def read(path: Path, measurements: Measurements, settings: RunSettings) -> FrequencyResponse:
    """Read one frequency response.

    Parameters
    ----------
    path
        The file.
    measurements, settings
        What ``measurements.toml`` says of all runs, and of this one.

    Raises
    ------
    InputError
        If the file is no such table, a unit is wrong, frequencies decrease or are not above zero, a coherence is not
        between 0 and 1, both shapes are mixed, or fewer than eight lines can be used.
    """
    require_applicable(measurements, settings, of_run=False)
    sheet = unit_tables.read(path, ALLOWED, gaps=True, plain=PLAIN)
    response = _response(sheet)
    sheet, response, outside = _in_band(sheet, response, settings.band)
    sheet, response, remarks = _usable(sheet, response)
    sheet, response, doubles = _once(sheet, response)
    frequencies = _frequencies(sheet)
    setup = measurements.setup
    amplitude, bias = _number(sheet, settings, "amplitude"), _number(sheet, settings, "bias")
    averages = _number(sheet, settings, "averages")
    if averages is not None and not (averages >= 1 and averages == int(averages)):
        raise InputError(path, "averages", averages, "is a whole number of measurements, one or more")
    coherence = _coherence(sheet)
    if coherence is not None and averages == 1:
        raise InputError(path, "averages", 1, "one measurement has no coherence; say how many were averaged")
    column = next(name for name in (*POLAR, *PARTS) if name in sheet.values)
    return FrequencyResponse(
        name=path.stem,
        frequencies=frequencies,
        response=response / setup.scale,
        si=PER_VOLT[sheet.si[column]],
        coherence=coherence,
        averages=None if averages is None else int(averages),
        amplitude=None if not amplitude else abs(setup.scale * amplitude),
        bias=setup.scale * (bias or 0.0) + setup.bias,
        axis=settings.output or setup.axis,
        command_is=settings.input or setup.command_is,
        period=settings.period or None,
        role=settings.role or "identify",
        kind=settings.kind,
        payload=settings.conditions.payload,
        role_is_stated=settings.role is not None,
        remarks=(*outside, *remarks, *doubles),
    )


def _in_band(
    sheet: Sheet, response: Complex, band: tuple[float, float] | None
) -> tuple[Sheet, Complex, tuple[str, ...]]:
    """Return the lines within a band [Hz], and a remark on those that are left out."""
    if band is None:
        return sheet, response, ()
    inside = (sheet.values[FREQUENCY] >= band[0]) & (sheet.values[FREQUENCY] <= band[1])
    limits = f"{units.hertz(band[0])} to {units.hertz(band[1])}"
    remark = f"lines outside of {limits} are left out: {np.count_nonzero(~inside)} of {len(inside)}"
    return sheet.rows(inside), response[inside], (remark,)


def _response(sheet: Sheet) -> Complex:
    """Return the response as it is written, in SI."""
    polar, cartesian = ([name for name in pair if name in sheet.values] for pair in (POLAR, PARTS))
    wanted = "magnitude [um/V] and phase [deg], or re [um/V] and im [um/V]"
    if polar and cartesian:
        raise InputError(sheet.path, "header", ", ".join([*polar, *cartesian]), f"mixes two shapes; keep {wanted}")
    if len(polar or cartesian) != 2:
        raise InputError(sheet.path, "header", None, f"there is no response; found {', '.join(sheet.values)}: {wanted}")
    if cartesian:
        re, im = (sheet.values[name] for name in PARTS)
        if sheet.si["re"] != sheet.si["im"]:
            raise InputError(sheet.path, "header", f"im [{sheet.unit['im']}]", f"is no unit like that of re, {wanted}")
        return np.asarray(re + 1j * im)
    magnitude, phase = (sheet.values[name] for name in POLAR)
    if (magnitude < 0).any():
        row = int(np.flatnonzero(magnitude < 0)[0])
        value = units.to_text(float(magnitude[row]), sheet.unit["magnitude"], si=sheet.si["magnitude"])
        raise sheet.cell_error(row, "magnitude", value, "is negative; write it positive, and turn the phase by 180 deg")
    return np.asarray(magnitude * np.exp(1j * phase))


def _usable(sheet: Sheet, response: Complex) -> tuple[Sheet, Complex, list[str]]:
    """Return the lines with numbers in all cells, and what was left out."""
    there = np.isfinite(response) & np.isfinite(sheet.values[FREQUENCY])
    if "coherence" in sheet.values:
        there &= np.isfinite(sheet.values["coherence"])
    lines = [] if there.all() else [f"{sheet.where(~there)}: no number in a cell; left out"]
    if there.sum() < FEWEST_LINES:
        remedy = f"has {there.sum()} lines that can be used; at least {FEWEST_LINES} are needed"
        raise InputError(sheet.path, "", None, remedy)
    return sheet.rows(there), response[there], lines


def _once(sheet: Sheet, response: Complex) -> tuple[Sheet, Complex, tuple[str, ...]]:
    """Return each line once, and what was left out: bands of a sweep may share the line where they meet."""
    again = np.diff(sheet.values[FREQUENCY], prepend=-np.inf) == 0
    remarks = (f"{sheet.where(again)}: at the frequency of the line before; left out",) if again.any() else ()
    return sheet.rows(~again), response[~again], remarks


def _frequencies(sheet: Sheet) -> Array:
    found = sheet.values[FREQUENCY]
    if found[0] <= 0:
        remedy = "a frequency is above zero; leave the line out"
        raise sheet.cell_error(0, FREQUENCY, f"{found[0]:g} Hz", remedy)
    back = np.flatnonzero(np.diff(found) < 0)
    if back.size:
        row = int(back[0]) + 1
        remedy = f"is below the line before ({found[row - 1]:.9g} Hz); sort the lines"
        raise sheet.cell_error(row, FREQUENCY, f"{found[row]:.9g} Hz", remedy)
    return found


def _coherence(sheet: Sheet) -> Array | None:
    found = sheet.values.get("coherence")
    if found is None:
        return None
    wrong = np.flatnonzero((found < 0) | (found > 1 + ROUNDED))
    if wrong.size:
        row = int(wrong[0])
        remedy = "a coherence is between 0 and 1; write percent as coherence [%]"
        raise sheet.cell_error(row, "coherence", f"{found[row]:g}", remedy)
    return np.minimum(found, 1.0)


def _number(sheet: Sheet, settings: RunSettings, name: str) -> float | None:
    """Return what the file or ``measurements.toml`` says of all lines; the file goes first."""
    stated: float | None = getattr(settings, name)
    column = sheet.values.get(name)
    if column is None or not np.isfinite(column).any():
        return stated
    values = column[np.isfinite(column)]
    if np.ptp(values) > 1e-9 * np.abs(values).max():
        row = int(np.flatnonzero(np.isfinite(column) & (column != values[0]))[0])
        remedy = "differs from line to line; one file holds one working point: split it"
        raise sheet.cell_error(row, name, f"{column[row]:g}", remedy)
    return float(values[0])


# --- roles ------------------------------------------------------------------------------------------------------------


def split_lines(responses: Sequence[FrequencyResponse]) -> tuple[FrequencyResponse, ...]:
    """Return frequency responses with roles; where somebody chose them, as they are.

    Where one was measured more than once under the same conditions and in the same band, the last is kept for
    validation. Where none was, every fourth line of each is: both halves are the whole response with NaN where the
    other half counts, and are called ``NAME:identify`` and ``NAME:validate``.
    """
    if any(each.role_is_stated or each.role != "identify" for each in responses):
        return tuple(responses)
    repeated = [[each for each in responses if _is_repeat(first, each)] for first in responses]
    last_of = {alike[-1].name for alike in repeated if len(alike) > 1}
    if last_of:
        return tuple(replace(each, role="validate") if each.name in last_of else each for each in responses)
    return tuple(half for each in responses for half in _halves(each))


def _is_repeat(one: FrequencyResponse, other: FrequencyResponse) -> bool:
    """Tell whether two responses show the same: of each band the other holds most, on a logarithmic axis."""
    conditions = [(r.axis, r.amplitude, r.bias, r.payload, r.command_is, r.kind.strip().lower()) for r in (one, other)]
    (low, high), (low_other, high_other) = (np.log(r.frequencies[[0, -1]]) for r in (one, other))
    shared = min(high, high_other) - max(low, low_other)
    return conditions[0] == conditions[1] and bool(2 * shared >= max(high - low, high_other - low_other))


def _halves(response: FrequencyResponse) -> tuple[FrequencyResponse, FrequencyResponse]:
    validation_lines = np.arange(len(response.frequencies)) % KEPT_LINE == KEPT_LINE // 2

    def half(role: Role, lines: NDArray[np.bool_]) -> FrequencyResponse:
        purpose = {"identify": "identification", "validate": "validation"}[role]
        remarks = f"every fourth line judges: {np.count_nonzero(lines)} of {len(lines)} lines are for {purpose}"
        left = np.where(lines, response.response, np.nan)
        return replace(
            response, name=f"{response.name}:{role}", response=left, role=role, remarks=(*response.remarks, remarks)
        )

    return half("identify", ~validation_lines), half("validate", validation_lines)

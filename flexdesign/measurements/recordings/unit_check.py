"""What a recording says against the model it is meant for: units that are wrong by a thousand."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from flexdesign.core import units
from flexdesign.core.errors import InputError
from flexdesign.measurements.recordings.run import AXES, Run, commanded_by

#: How far from a power of a thousand, in powers of ten: a resonance or a creeping stage does not take half of one.
TOLERANCE = 0.5
#: A response that correlates with its command at least so well follows it: no resonance above which it falls behind, no
#: sensor that reads its noise, has made it so much smaller.
FOLLOWS = 0.7


@dataclass(frozen=True)
class _Off:
    """A response that is a power of a thousand away from gain times command: both spans in the unit of the response."""

    command: str
    thousands: int
    seen: str
    due: str
    follows: bool


def suspicions(run: Run, gain: float, axis: str | None = None) -> tuple[str, ...]:
    """Return what is suspicious about the units of a run, in sentences.

    Parameters
    ----------
    run
        What was recorded.
    gain
        Response of the model per volt of the command, driver included [response/V].
    axis
        Whose; may be left out where the run has one response.

    >>> t = np.arange(20.0)
    >>> run = Run("sine", t, {"u": np.sin(t), "x": 2e-3 * np.sin(t)}, {"u": "V", "x": "m"})
    >>> suspicions(run, 2e-6)
    ('x spans 3.98 mm where gain times command spans 0.00398 mm, a thousandth: is its unit right, or that of u?',)
    """
    remark = []
    for name in [axis] if axis else [name for name in AXES if name in run.responses]:
        off = _off(run, gain, name)
        if off is not None:
            share = {-2: "a million times that", -1: "a thousand times that", 1: "a thousandth", 2: "a millionth"}
            much = share.get(off.thousands, f"1e{-3 * off.thousands} of that")
            question = f"is its unit right, or that of {off.command}?"
            remark.append(f"{name} spans {off.seen} where gain times command spans {off.due}, {much}: {question}")
    return tuple(remark)


def refuse_wrong_units(run: Run, gain: float, axis: str) -> None:
    """Refuse a run whose response follows the command but is a power of a thousand too large or too small.

    A response that does not follow is left to `suspicions`: far above a resonance it may be right.

    Parameters
    ----------
    run, gain, axis
        As for `suspicions`.

    Raises
    ------
    InputError
        If it is.
    """
    off = _off(run, gain, axis)
    if off is None or not off.follows:
        return
    shares = {-2: "a millionth of", -1: "a thousandth of", 1: "a thousand times", 2: "a million times"}
    much = shares.get(off.thousands, f"1e{3 * off.thousands} times")
    remedy = (
        f"is {much} the {off.due} that the model's gain makes of {off.command}; correct the unit of {axis} or of "
        f"{off.command} in the header, or the gain in the model"
    )
    raise InputError(run.name, f"column {axis}", f"{off.seen} peak to peak", remedy)


def _off(run: Run, gain: float, name: str) -> _Off | None:
    """Return by how much a response is off if that is about a power of a thousand; None else, or if nothing moved."""
    column = commanded_by(name, run.columns)
    if name not in run.columns or column is None:
        return None
    response, command = run.columns[name], run.columns[column]
    there = np.isfinite(response)
    span = float(np.ptp(response[there])) if there.any() else 0.0
    expected = abs(gain) * float(np.ptp(command))
    if not span > 0 or not expected > 0:
        return None
    powers = math.log10(span / expected)
    thousands = round(powers / 3)
    if not thousands or abs(powers - 3 * thousands) >= TOLERANCE:
        return None
    si = run.si[name]
    unit = units.DISPLAY.get(si, si)
    seen, due = (units.to_text(value, unit, 3, si) for value in (span, expected))
    is_driven = bool(np.ptp(command[there]) > 0)
    alike = float(np.corrcoef(response[there], command[there])[0, 1]) if is_driven else 0.0
    return _Off(column, thousands, seen, due, math.copysign(alike, gain * alike) >= FOLLOWS)

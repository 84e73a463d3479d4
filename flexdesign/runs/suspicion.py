"""What a recording says against the model it is meant for: units that are wrong by a thousand."""

from __future__ import annotations

import math

import numpy as np

from flexdesign import units
from flexdesign.runs.run import AXES, Run, commanded_by

#: How far from a power of a thousand, in powers of ten: a resonance or a creeping stage does not take half of one.
NEAR = 0.5


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
    names = [axis] if axis else [name for name in AXES if name in run.responses]
    said = []
    for name in names:
        column = commanded_by(name, run.columns)
        if name not in run.columns or column is None:
            continue
        span = float(np.nanmax(run.columns[name]) - np.nanmin(run.columns[name]))
        expected = abs(gain) * float(np.ptp(run.columns[column]))
        if not span > 0 or not expected > 0:
            continue
        powers = math.log10(span / expected)
        thousands = round(powers / 3)
        if thousands and abs(powers - 3 * thousands) < NEAR:
            si = run.si[name]
            unit = units.DISPLAY.get(si, si)
            seen, due = (units.to_text(value, unit, 3, si) for value in (span, expected))
            share = {-2: "a million times that", -1: "a thousand times that", 1: "a thousandth", 2: "a millionth"}
            much = share.get(thousands, f"1e{-3 * thousands} of that")
            question = f"is its unit right, or that of {column}?"
            said.append(f"{name} spans {seen} where gain times command spans {due}, {much}: {question}")
    return tuple(said)

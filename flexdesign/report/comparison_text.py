"""How a comparison puts into words where a model fails, and how it writes errors and limits."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from flexdesign.core import units
from flexdesign.core.errors import join_names
from flexdesign.diagnosis.comparison import Breakdown, Comparison, Part
from flexdesign.dynamics.stage_model import ResponseUnits
from flexdesign.estimation.criterion import INCLUDES_NULL, NOT_DETERMINED

#: A breakdown with less contrast than this says that all parts are alike.
UNIFORM = 0.1
#: The unit of errors below a tenth of another.
FINER = {"um": "nm", "mV": "uV", "urad": "nrad"}

#: The units of axes, from small to large.
AXIS_UNITS = {"m": ("nm", "um", "mm", "m"), "rad": ("nrad", "urad", "mrad", "rad"), "V": ("uV", "mV", "V", "kV")}


def axis_unit(response: str, *values: ArrayLike) -> str:
    """Return the unit of an axis for values in SI units: that of the stage model, or one in which they are 1 to 1000.

    >>> axis_unit("rad", [0.0, 5.3e-3]), axis_unit("m", [math.nan, -2e-9]), axis_unit("rad/V", [2e-4]), axis_unit("m")
    ('mrad', 'nm', 'urad/V', 'um')
    >>> axis_unit(ResponseUnits("m", "mm"), [2e-9])
    'mm'
    """
    sizes = [np.abs(each).max(initial=0.0, where=np.isfinite(each)) for each in map(np.asarray, values)]
    size = max(sizes, default=0.0)
    if size == 0.0 or (isinstance(response, ResponseUnits) and response.unit):
        return units_of(response)[0]
    base, per, volt = response.partition("/")
    below = [unit for unit in AXIS_UNITS[base] if units.factor(unit, base) <= size]
    return (below[-1] if below else AXIS_UNITS[base][0]) + per + volt


def units_of(response: str) -> tuple[str, str]:
    """Return in which unit a response is shown, and in which its errors are.

    >>> units_of("V"), units_of(ResponseUnits("rad", "mrad"))
    (('V', 'mV'), ('mrad', 'mrad'))
    """
    written = response if isinstance(response, ResponseUnits) else ResponseUnits(response)
    return written.large, written.small


def sentences(comparison: Comparison) -> list[str]:
    """Return where the model fails, in up to three sentences: in which runs, at which frequencies, in which region."""
    if not comparison.unexplained:
        return []
    text = []
    by_run = comparison.by("run")
    if by_run and len(by_run.parts) > 1:
        if by_run.contrast < UNIFORM:
            text.append("The model fails in all runs alike.")
        else:
            worst = sorted(by_run.concentrated, key=lambda p: -p.share)
            names = join_names([p.label for p in worst[:3]] + (["others"] if len(worst) > 3 else []))
            text.append(
                f"The model fails mostly in {names}: {percent(sum(p.share for p in worst))} of the unexplained error."
            )
    by_frequency = comparison.by("frequency")
    if by_frequency and (band := by_frequency.dominant()):
        mode = comparison.model.axes[comparison.axis].natural_frequency
        near = f", where the main mode is ({units.hertz(mode)})" if band[0].lower <= mode < band[-1].upper else ""
        share = percent(sum(p.share for p in band))
        text.append(f"The model fails mostly {place(by_frequency, band)}{near}: {share}.")
    regions = [b for b in comparison.where if b.by not in ("run", "frequency")]
    strongest = max(regions, key=lambda b: b.contrast * b.covers)
    if strongest.contrast * strongest.covers < UNIFORM:
        text.append("No position, velocity or voltage is worse than the others.")
    else:
        parts = strongest.concentrated
        share, weight = (sum(getattr(p, key) for p in parts) for key in ("share", "weight"))
        error = "the error" if strongest.covers > 0.99 else "the error after steps"
        shares = f"{percent(share)} of {error}, in {percent(weight)} of the time"
        text.append(f"The model fails mostly {place(strongest, parts)}: {shares}.")
    return text


def label(breakdown: Breakdown, part: Part) -> str:
    """Return what a part of a breakdown is called."""
    if part.label:
        return part.label
    if breakdown.si == "Hz" and part.lower == 0:
        return f"below {limit(part.upper, breakdown.si)}"
    if breakdown.si == "s" and part.lower == 0:
        return f"first {limit(part.upper, breakdown.si)}"
    return value_range(part.lower, part.upper, breakdown.si)


def place(breakdown: Breakdown, parts: Sequence[Part]) -> str:
    """Return where some parts are, neighbours taken together: ``at positions below -20 um or above 40 um``."""
    if breakdown.by == "velocity":
        motions = [p.label for p in parts if p.label != "at rest"]
        text = [f"moves {_motion(motions)}".strip()] if motions else []
        text += ["is at rest"] if len(motions) < len(parts) else []
        return f"while the stage {' or '.join(text)}"
    groups: list[list[Part]] = []
    for part in parts:
        if groups and groups[-1][-1].upper == part.lower:
            groups[-1].append(part)
        else:
            groups.append([part])
    low, high = breakdown.parts[0].lower, breakdown.parts[-1].upper
    text = []
    for group in groups:
        a, b = group[0].lower, group[-1].upper
        if a == low and b < high:
            text.append(f"below {limit(b, breakdown.si)}")
        elif b == high and a > low:
            text.append(f"above {limit(a, breakdown.si)}")
        else:
            text.append(value_range(a, b, breakdown.si))
    where = " or ".join(text)
    if breakdown.si == "s":
        after = where.replace("below", "in the first").replace("above", "later than")
        return f"{after} after a step"
    lead = {"frequency": "", "position": "at positions ", "voltage": "at voltages "}[breakdown.by]
    if breakdown.by == "frequency" and not text[0].startswith(("below", "above")):
        lead = "at "
    return f"{lead}{where}"


def _motion(motions: Sequence[str]) -> str:
    """Return kinds of motion in words, without what all of one speed or of one direction share.

    >>> _motion(["up fast", "down fast"]), _motion(["up fast", "down slowly"])
    ('fast', 'up fast or down slowly')
    >>> _motion(["up fast", "up slowly", "down fast", "down slowly"])
    ''
    """
    directions, speeds = (sorted({motion.split()[k] for motion in motions}) for k in (0, 1))
    if len(motions) < len(directions) * len(speeds) or len(motions) == 1:
        return " or ".join(motions)
    return " ".join(words[0] for words in (directions, speeds) if len(words) == 1)


def limit(value: float, si: str, size: float | None = None) -> str:
    """Write a limit in a unit that suits it, or that suits another size.

    >>> limit(0.01, "s"), limit(724.08, "Hz"), limit(2e-6, "m", size=1e-4), limit(1.173, "rad")
    ('10 ms', '720 Hz', '2 µm', '1.17 rad')
    """
    size = abs(value) if size is None else size
    if si == "s":
        unit = "s" if size >= 1 else "ms" if size >= 1e-3 else "us"
    else:
        default_unit = "mV" if si == "V" and 0 < size < 1 else {"m": "um", "rad": "urad"}.get(si, si)
        if default_unit in ("um", "urad"):
            default_unit = units.suitable(default_unit, size, si)
        unit = (si.unit if isinstance(si, ResponseUnits) else "") or default_unit
    number = f"{value / units.factor(unit, si):.{2 if si == 'Hz' else 3}g}"
    return f"{float(number):g} {sign(unit)}"


def value_range(low: float, high: float, si: str) -> str:
    """Write a range, its unit once.

    >>> value_range(-20e-6, 5e-6, "m")
    '-20 to 5 µm'
    """
    size = max(abs(low), abs(high))
    return f"{limit(low, si, size).partition(' ')[0]} to {limit(high, si, size)}"


def error(response: str, value: float, digits: int = 3) -> str:
    """Write an error in the unit that suits it.

    >>> error("m", 1.754e-6), error("m", 46.4e-9, 2), error(ResponseUnits("m", "mm"), 46.4e-6, 2)
    ('1.75 µm', '46 nm', '0.046 mm')
    """
    return _suitable_text(response, value, units_of(response)[1], digits)


def span(response: str, value: float, digits: int = 4) -> str:
    """Write a stroke or a span in the unit that suits it.

    >>> span("rad", 1.173495), span("rad", 0.02), span("m", 262.64e-6), span("V", 9.5)
    ('1.173 rad', '20.00 mrad', '262.6 µm', '9.500 V')
    """
    return _suitable_text(response, value, units_of(response)[0], digits)


def _suitable_text(response: str, value: float, usual: str, digits: int) -> str:
    """Write a size in its usual unit, or in one that has no long number; in the unit of the stage model if it has one.

    >>> _suitable_text("rad", 0.0, "urad", 3), _suitable_text("rad", -0.25, "urad", 3)
    ('0 µrad', '-250 mrad')
    >>> _suitable_text("rad/V", 2.0, "urad/V", 3)
    '2.00 rad/V'
    """
    base, per, volt = usual.partition("/")
    unit = usual
    if not (isinstance(response, ResponseUnits) and response.unit):
        is_small = 0 < abs(value) / units.factor(usual, response) < 0.1
        unit = FINER.get(base, base) + per + volt if is_small else units.suitable(usual, value, response)
    return units.to_text(value, unit, digits, si=response).replace(unit, sign(unit))


def percent(share: float) -> str:
    """Write a share with two digits; a dash where there is none."""
    return f"{units.significant(100 * share, 2)} %" if math.isfinite(share) else "–"


def not_added(subject: str, reason: str) -> str:
    """Return the sentence that says why an effect is not added, from the reason that the search gives.

    >>> not_added("Creep", "no more than chance gives")
    'Creep is not needed: it explains no more than chance gives.'
    >>> not_added("It", "second_mode.share at the end of what is plausible")
    'It is not determined: the fit puts second_mode.share at the end of what is plausible.'
    >>> not_added("It", "creep.share is not determined: its null is less than 1.96 standard errors away")
    'It is not determined: the null of creep.share is less than 1.96 standard errors away.'
    >>> not_added("It", "creep.share is not determined: its 95 % interval includes its null")
    'It is not determined: the 95 % interval of creep.share includes its null.'
    """
    numbers, is_open, _ = reason.partition(f" {NOT_DETERMINED}")
    if is_open:
        return f"{subject} is not determined: the null of {numbers} is less than 1.96 standard errors away."
    numbers, is_open, _ = reason.partition(f" {INCLUDES_NULL}")
    if is_open:
        return f"{subject} is not determined: the 95 % interval of {numbers} includes its null."
    if reason.endswith("at the end of what is plausible"):
        return f"{subject} is not determined: the fit puts {reason}."
    return f"{subject} is not needed: it {'explains ' if reason.startswith('no more') else ''}{reason}."


def sign(unit: str) -> str:
    """Write a unit with the Greek letter for micro."""
    return unit.replace("u", "µ", 1) if unit.startswith("u") else unit

"""What a fit may move of one axis: each number with its unit, and its plausible range on this stroke."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

from flexdesign import effects
from flexdesign.core.model import Effect, Parameter, Resonance
from flexdesign.dynamics.stage_model import AxisModel
from flexdesign.dynamics.stage_model import fields as units_of

Scale = Literal["linear", "log", "inverse"]
#: What is fitted if nothing is asked for: the linear axis, and hysteresis where the model has it.
LINEAR_PARAMETERS = ("gain", "damping_ratio", "natural_frequency")
HYSTERESIS_PARAMETERS = ("bouc_wen.a", "bouc_wen.b", "bouc_wen.c", "bouc_wen.rest")
#: How late commands act, as the stage model's file calls it; a number of the stage, not of the axis.
DELAY = "controller.delay"
#: How late readings are; a number of the axis.
SENSOR_DELAY = "sensor.delay"
#: How late a record began, as a number of its own.
TRIGGER = "trigger"
#: No controller is later than this [s].
LONGEST_DELAY = 0.05
#: The stroke [m] and voltage [V] for which the catalogue states plausible values.
CATALOGUE_STROKE, CATALOGUE_VOLTS = 1e-4, 100.0
#: The natural frequency [Hz] for which the catalogue lists the frequencies of modes, amplifiers and sensors to try.
CATALOGUE_FREQUENCY = 100.0
#: A mode that was known to be beyond what the samples show may be this much higher still.
BEYOND = 1.2


def of(first: AxisModel, axis: AxisModel, max_command: float) -> list[Parameter]:
    """Return every number that the prediction of a run depends on.

    Parameters
    ----------
    first
        The numbers about which ranges are plausible.
    axis
        The present ones: their effects count.
    max_command
        Largest command that is expected [V].
    """
    made = [*_mechanics(first), *_electronics(first)]
    for name, values in axis.effects.items():
        made += of_effect(first, max_command, effects.find(name), name, values)
    return made


def of_effect(
    first: AxisModel, max_command: float, effect: Effect, name: str, values: Mapping[str, float]
) -> list[Parameter]:
    """Return the parameters of an effect in the units of this response, ranges and starts scaled to its stroke."""
    stroke = stroke_of(first, max_command)
    power, _ = units_of.POWER_LAWS.get(name, ("", ()))
    exponent = first.effects.get(name, values).get(power, 1.0)
    fields = units_of.effect(name, first.response, exponent)
    own = _hysteresis(stroke, max_command, exponent).get(name, {})
    made = []
    for p in effect.parameters:
        scale = of_catalogue(p, stroke, max_command)
        allowed = 1.0 if p.scale == "inverse" else scale  # limits of the amplifier do not shrink with the command
        low, high, start = own.get(p.name, (p.plausible[0] * allowed, p.plausible[1] * allowed, p.start))
        if start is not None and p.name not in own:
            start *= scale
        number, screen = fields[p.name], tuple(value * scale for value in p.screen)
        parameter_scale: Scale = (
            "linear" if low == 0 and p.scale == "log" else p.scale
        )  # a logarithm never comes to zero
        ranged = replace(
            p, name=f"{name}.{p.name}", plausible=(low, high), start=start, screen=screen, scale=parameter_scale
        )
        made.append(replace(ranged, si=number.si, unit=number.unit))
    return made


def observable_range(parameter: Parameter, first: AxisModel, highest: float) -> dict[str, Any]:
    """Return the range and the trial values of a parameter without frequencies that the samples cannot show.

    An undamped mode at the sampling rate would remember every step of a held command, and pass for hysteresis. The
    lowest frequencies of modes and lags go down with the natural frequency, as their trial values do.

    Parameters
    ----------
    parameter
        One of those of `of`.
    first
        The numbers about which ranges are plausible.
    highest
        Highest frequency that the samples show [Hz].
    """
    if parameter.name == "natural_frequency":
        low, high = parameter.plausible
        return {"plausible": (low, min(high, max(highest, BEYOND * first.natural_frequency)))}
    owner, _, number = parameter.name.rpartition(".")
    low, high = parameter.plausible
    if number == "bandwidth":
        return {"plausible": (low * min(1.0, frequency_scale(first, highest)), high)}
    if number != "frequency" or owner.startswith("modes"):
        return {}
    is_mode = any(isinstance(face, Resonance) for face in effects.find(owner).faces)
    scale = frequency_scale(first, highest) if is_mode else 1.0  # the floor and the mains do not follow the stage
    tried = tuple(value * scale for value in parameter.screen if value * scale < highest)
    return {"plausible": (low * min(1.0, scale), high if math.isinf(highest) else highest), "screen": tried}


def is_beyond_sampling(first: AxisModel, highest: float) -> bool:
    """Tell whether the range of the natural frequency would reach the sampling rate.

    A held command repeats its spectrum about the sampling rate. A mode there remembers every step, as hysteresis does,
    and readings at the samples show nothing else of it.

    Parameters
    ----------
    first
        The numbers about which ranges are plausible.
    highest
        Half of the sampling rate [Hz].
    """
    return BEYOND * first.natural_frequency >= 2 * highest


def frequency_scale(first: AxisModel, highest: float) -> float:
    """Return by how much higher frequencies are tried on an axis than the catalogue lists them.

    They go with the natural frequency; where the samples do not show that, with half of the highest they show.
    """
    return min(first.natural_frequency, 0.5 * highest) / CATALOGUE_FREQUENCY


def of_catalogue(parameter: Parameter, stroke: float, max_command: float) -> float:
    """Return by how much the catalogue's values of a parameter, for its stroke and voltage, are larger on this axis."""
    return float(
        (stroke / CATALOGUE_STROKE) ** power_in("m", parameter.si)
        * (max_command / CATALOGUE_VOLTS) ** power_in("V", parameter.si)
    )


def stroke_of(first: AxisModel, max_command: float) -> float:
    """Return what the gain makes of the largest command [response]."""
    return abs(first.gain * first.driver.gain) * max_command


def _mechanics(first: AxisModel) -> list[Parameter]:
    si, unit = f"{first.response}/V", f"{first.unit or units_of.RESPONSES[first.response][1]}/V"
    low, high = sorted((0.1 * first.gain, 10 * first.gain))
    made = [
        _frequency("natural_frequency", "natural frequency of the main mode", first.natural_frequency),
        _damping("damping_ratio", "damping ratio of the main mode", first.damping_ratio),
        Parameter("gain", si, unit, "response per voltage, before hysteresis", plausible=(low, high)),
    ]
    for i, mode in enumerate(first.modes, start=1):
        made += [
            _frequency(f"modes.{i}.frequency", "natural frequency of a further mode", mode.frequency),
            _damping(f"modes.{i}.damping_ratio", "damping ratio of a further mode", mode.damping_ratio),
            Parameter(f"modes.{i}.share", "1", "%", "part of the static response", 0.0, plausible=(-1.0, 1.0)),
        ]
    return made


def _electronics(first: AxisModel) -> list[Parameter]:
    low, high = sorted((0.1 * first.driver.gain, 10 * first.driver.gain))
    made = [Parameter("driver.gain", "1", "", "voltage at the stack per command", plausible=(low, high))]
    electronics = (("driver.bandwidth", "driver_bandwidth"), ("driver.slew", "driver_slew"))
    for name, effect in (*electronics, ("sensor.bandwidth", "sensor_bandwidth")):
        made.append(replace(effects.find(effect).parameters[0], name=name))
    late = Parameter(DELAY, "s", "ms", "how late commands act", 0.0, plausible=(0.0, LONGEST_DELAY), twin=TRIGGER)
    return [*made, late, replace(late, name=SENSOR_DELAY, meaning="how late readings are")]


def _hysteresis(stroke: float, max_command: float, exponent: float) -> dict[str, dict[str, tuple[float, float, float]]]:
    """Return low, high and start of what sets the size and the bend of a loop, scaled to gain, voltage and stroke.

    A Bouc-Wen loop takes up to the whole gain, and bends into saturation within a thousandth to a thousand times
    the voltage range; the start is a tenth of the gain, bent at the voltage itself. It rests within the stroke.
    """
    gain = stroke / max_command
    rate, stiff = stroke ** (1 - exponent) / max_command, stroke**-exponent
    return {
        "bouc_wen": {
            "a": (1e-4 * gain, 2.0 * gain, 0.1 * gain),
            "b": (1e-3 * rate, 1e3 * rate, rate),
            "c": (-10.0 * rate, 10.0 * rate, 0.0),
            "rest": (-stroke, stroke, 0.0),
        },
        "hysteretic_spring": {"gamma": (0.0, 10.0 * stiff, stiff), "delta": (-10.0 * stiff, 10.0 * stiff, 0.0)},
    }


def _frequency(name: str, meaning: str, value: float) -> Parameter:
    return Parameter(name, "Hz", "Hz", meaning, plausible=(value / 3, 3 * value), scale="log")


def _damping(name: str, meaning: str, value: float) -> Parameter:
    return Parameter(name, "1", "", meaning, plausible=(1e-4, max(2.0, 3 * value)), scale="log")


def power_in(base: str, si: str) -> int:
    """Return the power of a base unit in a unit of the catalogue.

    >>> [power_in("m", si) for si in ("m/V", "1/m^2", "1/V", "Hz", "m/V^2")], power_in("V", "m/V^2")
    ([1, -2, 0, 0, 1], -2)
    """
    above, _, below = si.partition("/")
    total = 0
    for sign, part in ((1, above), (-1, below)):
        for found in re.finditer(rf"\b{base}\b(?:\^(\d+))?", part):
            total += sign * int(found[1] or 1)
    return total


def with_values(axis: AxisModel, values: Mapping[str, float]) -> AxisModel:
    """Return an axis with some of its numbers replaced, by their dotted names, SI.

    A new natural frequency keeps the stiffness and changes the mass; of a further mode all numbers are its own.

    Raises
    ------
    KeyError
        If the axis has no such number.
    """
    if not values:
        return axis
    own: dict[str, Any] = {}
    tables: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        table, _, key = name.rpartition(".")
        if table not in axis.effects and name not in axis.numbers:
            raise KeyError(name)
        if table:
            tables.setdefault(table, {})[key] = value
        else:
            own[name] = value
    if axis.stiffness is not None and "natural_frequency" in own:
        own["mass"] = axis.stiffness / (2 * math.pi * own["natural_frequency"]) ** 2
    modes = tuple(replace(mode, **tables.pop(f"modes.{i}", {})) for i, mode in enumerate(axis.modes, start=1))
    driver, sensor = (replace(getattr(axis, key), **tables.pop(key, {})) for key in ("driver", "sensor"))
    changed_effects = {name: {**given, **tables.get(name, {})} for name, given in axis.effects.items()}
    return replace(axis, **own, modes=modes, driver=driver, sensor=sensor, effects=changed_effects)


def with_payload(first: AxisModel, axis: AxisModel, payload: float) -> AxisModel:
    """Return an axis with a known mass added [kg]; without a mass of its own nobody knows what that does.

    Parameters
    ----------
    first
        The axis as it was designed, whose mass the known one adds to.
    axis, payload
        Its present numbers, and the mass.
    """
    if payload == 0 or first.mass is None:
        return axis
    extra = axis.effects.get("payload_mass", {}).get("ratio", 0.0)
    slower = 1 / math.sqrt(1 + payload / (first.mass * (1 + extra)))
    return with_values(
        axis,
        {
            "natural_frequency": slower * axis.natural_frequency,
            "damping_ratio": slower * axis.damping_ratio,
        },
    )

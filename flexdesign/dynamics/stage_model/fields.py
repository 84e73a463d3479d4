"""What the fields of a stage model's file hold: the units they are written in and the numbers they accept."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from flexdesign import effects
from flexdesign.core import toml_files, units
from flexdesign.core.model import ACTUATORS
from flexdesign.core.toml_files import Bounds

#: What an axis may respond in, and the units in which small and large responses are written.
RESPONSES = {"m": ("nm", "um"), "rad": ("nrad", "urad"), "V": ("mV", "V")}
#: More digits than these say nothing of a stage; see `StageModel.to_toml`.
DIGITS = 7
#: Free strokes are smaller than that [m], [rad] or [V].
LONGEST_STROKE = 1e3
#: Hysteresis laws with |z|^n, z in the unit of the response: their exponent, and the rates whose unit depends on it.
POWER_LAWS = {"bouc_wen": ("n", ("b", "c")), "hysteretic_spring": ("nu", ("gamma", "delta"))}

#: Effects of the catalogue for which a number of its own stands: one of the axis, or of the stage's controller.
AXIS_FIELDS = {
    "transport_delay": "controller.delay",
    "driver_bandwidth": "driver.bandwidth",
    "driver_slew": "driver.slew",
    "sensor_bandwidth": "sensor.bandwidth",
    "sensor_delay": "sensor.delay",
    "quantisation": "sensor.resolution",
}


@dataclass(frozen=True)
class Number(Bounds):
    """A number with its bounds in SI and the unit in which files write it; infinite only where that means "none"."""

    unit: str = ""
    nonzero: bool = False
    infinite: bool = False

    def read(self, given: object) -> float:
        """Return what a file says in SI."""
        if self.infinite and (endless := re.fullmatch(r"\s*\+?inf\b\s*(.*?)\s*", str(given))):
            units.factor(endless[1] or self.si, self.si)
            return math.inf
        value = super().read(given)
        if self.nonzero and value == 0:
            raise ValueError("must not be zero")
        return value

    def write(self, value: float) -> str:
        """Return a number as TOML."""
        if math.isinf(value):
            return f'"inf {self.unit}"' if self.unit else "inf"
        number = value / units.factor(self.unit or "1", self.si)
        for digits in range(1, DIGITS + 1):
            text = f"{units.significant(number, digits)} {self.unit}".rstrip()
            if math.isclose(units.from_text(text, self.si), value, rel_tol=1e-12):
                break
        return f'"{text}"' if self.unit else text

    def example(self) -> str:
        """Return how it is written, for example."""
        return f'"1.5 {self.unit}"' if self.unit else "1.5"

    def __str__(self) -> str:
        if not math.isinf(self.upper):
            return super().__str__()
        if math.isinf(self.lower):
            return "allowed: any finite number"
        return f"allowed: {'more than' if self.exclusive else 'at least'} {self.lower:g} {self.unit}".rstrip()


@dataclass(frozen=True)
class Share(Number):
    """A share of a number; more than the whole is written in percent, as a bare number is a percent sign forgotten."""

    def read(self, given: object) -> float:
        """Return what a file says."""
        value = super().read(given)
        if value > 1 and "%" not in str(given):
            percent = f"{100 * value:g} %"
            raise ValueError(f'is {percent} without a unit; write "{value:g} %", or "{percent}" if that is meant')
        return value


@dataclass(frozen=True)
class Span(Number):
    """Two numbers, the lower one first."""

    def read(self, given: object) -> tuple[float, float]:  # type: ignore[override]
        """Return what a file says in SI."""
        if not isinstance(given, (list, tuple)) or len(given) != 2:
            raise ValueError(f'expected two numbers, the lower first, such as ["0 {self.unit}", "150 {self.unit}"]')
        low, high = (super(Span, self).read(each) for each in given)
        if low >= high:
            raise ValueError("the first number must be the lower one")
        return low, high

    def write(self, value: tuple[float, float]) -> str:  # type: ignore[override]
        """Return both numbers as TOML."""
        return f"[{', '.join(super(Span, self).write(each) for each in value)}]"


@dataclass(frozen=True)
class Count(Number):
    """A whole number."""

    def read(self, given: object) -> int:
        """Return what a file says."""
        if isinstance(given, bool) or not isinstance(given, int) or not self.lower <= given <= self.upper:
            raise ValueError(f"{self}, a whole number")
        return given


class Text:
    """Words."""

    def read(self, given: object) -> str:
        """Return what a file says."""
        if not isinstance(given, str):
            raise ValueError("expected text in quotes")
        return given

    def write(self, value: str) -> str:
        """Return text as TOML."""
        return toml_files.quote(value)

    def example(self) -> str:
        """Return how it is written, for example."""
        return '"..."'


@dataclass(frozen=True)
class OneOf(Text):
    """One of some words."""

    words: tuple[str, ...]

    def read(self, given: object) -> str:
        """Return what a file says."""
        if given not in self.words:
            raise ValueError(f"expected {' or '.join(map(toml_files.quote, self.words))}")
        return str(given)

    def example(self) -> str:
        """Return how it is written, for example."""
        return toml_files.quote(self.words[0])


Field = Number | Text
Fields = Mapping[str, Field]


def _frequency(upper: float = 1e9, *, infinite: bool = False) -> Number:
    return Number("Hz", 0.0, upper, exclusive=True, unit="Hz", infinite=infinite)


_DAMPING = Number("1", 0.0, 100.0)
_VOLTS = Span("V", -1e5, 1e5, unit="V")
_STIFFNESS = Number("N/m", 0.0, 1e15, exclusive=True, unit="N/um")

MODE: Fields = {
    "frequency": _frequency(1e7),
    "damping_ratio": _DAMPING,
    "share": Number("1", -100.0, 100.0, unit="%"),
}
DRIVER: Fields = {
    "gain": Number("1", -1e6, 1e6, nonzero=True),
    "bandwidth": _frequency(infinite=True),
    "slew": Number("V/s", 0.0, 1e12, exclusive=True, unit="V/s", infinite=True),
    "limits": _VOLTS,
}
_DELAY = Number("s", 0.0, 10.0, unit="ms")
CONTROLLER: Fields = {"rate": _frequency(1e7), "delay": _DELAY}
RELATIVE = Share("1", 0.0, 1e4, unit="%")


def axis(response: str, unit: str = "") -> Fields:
    """Return the single numbers of an axis that responds in the SI unit `response`, and is written in `unit`."""
    return {
        "natural_frequency": _frequency(1e7),
        "mass": Number("kg", 0.0, 1e6, exclusive=True, unit="g"),
        "stiffness": Number("N/m", 0.0, 1e15, exclusive=True, unit="N/mm"),
        "damping_ratio": _DAMPING,
        "gain": Number(f"{response}/V", -1e6, 1e6, unit=f"{unit or RESPONSES[response][1]}/V", nonzero=True),
        "input_stiffness": _STIFFNESS,
        "amplification": Number("1", -1e6, 1e6, nonzero=True),
    }


def actuator(stroke: str = "m") -> Fields:
    """Return the fields of an actuator whose free stroke is in the SI unit `stroke`."""
    return {
        "kind": OneOf(ACTUATORS),
        "free_stroke": Number(stroke, 0.0, LONGEST_STROKE, exclusive=True, unit=RESPONSES[stroke][1]),
        "voltage_range": _VOLTS,
        "stiffness": _STIFFNESS,
        "contact_stiffness": _STIFFNESS,
        "capacitance": Number("F", 0.0, 1.0, exclusive=True, unit="uF"),
        "preload": Number("N", 0.0, 1e6, unit="N"),
        "count": Count("1", 1, 100),
    }


def stroke_of(given: object, response: str) -> str:
    """Return the SI unit of a free stroke, as a file has it, on an axis that responds in the SI unit `response`.

    A stack pushes along a length whatever the axis does; the stroke of a direct drive may be given by its response.

    >>> stroke_of("40 um", "rad"), stroke_of("2 mrad", "rad"), stroke_of("2 mrad", "m")
    ('m', 'rad', 'm')
    """
    try:
        units.from_text(given, "m")
    except ValueError:
        return response
    return "m"


def sensor(response: str) -> Fields:
    """Return the fields of a sensor that reads in the SI unit `response`."""
    small, large = RESPONSES[response]
    return {
        "bandwidth": _frequency(infinite=True),
        "delay": _DELAY,
        "noise": Number(response, 0.0, 1e3, unit=small),
        "resolution": Number(response, 0.0, 1e3, unit=small),
        "range": Span(response, -1e6, 1e6, unit=large),
        "linearity": Number(response, 0.0, 1e3, unit=large),
        "source": Text(),
    }


def coupling(to: str, origin: str, power: int) -> Number:
    """Return the coefficient of the `power` of a response in the unit `origin` that shows in one in the unit `to`."""
    if to == origin:
        si, unit = ("1", "%") if power == 1 else (f"1/{to}", {"m": "1/mm", "rad": "1/mrad"}.get(to, f"1/{to}"))
    else:
        si = unit = f"{to}/{origin}" + ("" if power == 1 else f"^{power}")
    return Number(si, -1e9, 1e9, unit=unit)


def effect(name: str, response: str, exponent: float = 1.0) -> dict[str, Number]:
    """Return the parameters of an effect on an axis that responds in the SI unit `response`.

    The catalogue is written for displacements: its m means the unit of the response. A parameter whose plausible
    values are all positive refuses negative ones; beyond that, an implausible value is for others to doubt.

    Parameters
    ----------
    name
        Name or path of the effect.
    response
        SI unit of the response of the axis.
    exponent
        Of a hysteresis law dh = a dv - b |dv| h |h|^(n-1) - c dv |h|^n: the unit of b and c is 1/(V um^(n-1)).

    Raises
    ------
    ValueError
        If the catalogue has no such effect; the message suggests one.
    """
    power, rates = POWER_LAWS.get(name, ("", ()))
    found = {}
    for p in effects.find(name).parameters:
        si, unit = p.si, p.unit
        if response != "m" and (si := re.sub(r"\bm\b", response, si)) != p.si:
            unit = units.DISPLAY.get(si, si)
        if p.name in rates and (power_left := f"{exponent - 1:.10g}") != "0":
            raised = "" if power_left == "1" else f"^{power_left}"
            si, unit = f"{si}/{response}{raised}", f"{unit}/{RESPONSES[response][1]}{raised}"
        lower = 1.0 if p.name == power else 0.0 if p.plausible[0] >= 0 else -math.inf
        found[p.name] = Number(si, lower, math.inf, unit=unit, infinite=p.null == math.inf)
    return found


def optional(name: str) -> dict[str, float]:
    """Return the parameters of an effect that a file may leave out, with the value that then holds."""
    return {p.name: p.start for p in effects.find(name).parameters if p.start is not None}


def response_of(gain: object) -> str:
    """Return the SI unit of the response that a gain, as a file has it, speaks of.

    Raises
    ------
    ValueError
        If it is no length, angle or voltage per voltage.

    >>> response_of("1.98 um/V"), response_of("3 urad/V"), response_of("1 V/V")
    ('m', 'rad', 'V')
    """
    refusals = []
    for response in RESPONSES:
        try:
            units.from_text(gain, f"{response}/V")
        except ValueError as error:
            refusals.append(error)
            continue
        if response != "V" or "V" in str(gain):  # "um/um" has no dimension either, but is no gain per volt
            return response
    raise refusals[0]

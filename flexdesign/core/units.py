"""Units at the border: text with a unit comes in, SI numbers travel inside, text with a unit goes out.

>>> from_text("0.5 mm", "m")
0.0005
>>> to_text(1906.2e3, "N/mm")
'1906 N/mm'
"""

from __future__ import annotations

import math
import re
import unicodedata
from functools import cache
from typing import Any

from flexdesign.core.errors import shorten

#: No unit has more letters, and no product of all powers in one is higher.
LONGEST, HIGHEST = 100, 1000
#: No number with its unit has more letters.
LONGEST_NUMBER = 500
#: The micro of a unit, where it is no part of a word or a name.
_MICRO = re.compile(r"(?<![\w.-])u(?=(?:m|rad|N|V|F)(?![A-Za-z_]))|(?<=\d )u(?=s(?![A-Za-z_]))")
#: Examples of noise and of other small sizes, by SI unit.
SMALL = {"m": "3 nm", "rad": "50 nrad"}
#: How each kind of number is shown to people: SI unit -> display unit.
DISPLAY = {
    "m": "mm",
    "N/m": "N/mm",
    "Pa": "MPa",
    "kg/m^3": "kg/m^3",
    "N": "N",
    "kg": "g",
    "Hz": "Hz",
    "N*m/rad": "N*mm/rad",
    "s": "ms",
    "F": "uF",
    "m/V": "um/V",
    "rad/V": "urad/V",
    "1/m": "1/mm",
    "1": "",
}
#: The units of sizes from ten thousand, and from a million of another on.
COARSER = {"um": ("mm", "m"), "mV": ("V", "V"), "urad": ("mrad", "rad"), "V": ("kV", "kV")}
#: What each SI unit measures, in words.
MEASURES = {
    "m": "length",
    "N/m": "stiffness",
    "Pa": "stress or modulus",
    "kg/m^3": "density",
    "N": "force",
    "kg": "mass",
    "Hz": "frequency",
    "V": "voltage",
    "N*m/rad": "rotational stiffness",
    "rad": "angle",
    "s": "time",
    "F": "capacitance",
    "V/s": "slew rate",
    "m/V": "gain: length, angle or voltage per voltage",
    "rad/V": "angle per voltage",
    "1/V": "one per voltage",
    "1/m": "one per length",
}


def _import_pint() -> Any:
    """Import pint, without Dask: pint imports it where it is installed, which takes as long as pint itself."""
    import sys

    hidden = "dask" not in sys.modules
    if hidden:
        sys.modules["dask"] = None  # type: ignore[assignment]  # what Python takes for "not installed"
    try:
        import pint
    finally:
        if hidden:
            del sys.modules["dask"]
    return pint


@cache
def _registry() -> Any:
    import logging

    pint = _import_pint()  # a third of a second: only where text with units is read or written
    logging.getLogger("pint").setLevel(logging.ERROR)  # what it thinks of "amps" is nothing for the terminal
    try:  # parsing its definitions takes as long again: once parsed they are kept in the user's cache
        return pint.UnitRegistry(autoconvert_offset_to_baseunit=False, cache_folder=":auto:")
    except Exception:  # a folder that cannot be written, or a file that another process is writing
        return pint.UnitRegistry(autoconvert_offset_to_baseunit=False)


def _is_short(unit: str) -> bool:
    """Tell whether a unit is short and all its powers together are small, so that working it out takes no time."""
    import re

    plain = re.sub("[⁰¹²³⁴-⁹]+", lambda digits: f"**{unicodedata.normalize('NFKC', digits[0])}", unit)
    number = r"[+-]?(\d++\.?\d*+)"  # another power right behind it would make a tower
    powers = re.findall(rf"(?:\*\*|\^)\s*(?:{number}|\(\s*{number}\s*(?:/\s*\d+\s*)?\))(?!\s*(?:\*\*|\^))", plain)
    known = len(powers) == plain.count("**") + plain.count("^")
    return len(unit) <= LONGEST and known and math.prod(max(float(a or b), 1.0) for a, b in powers) <= HIGHEST


def _parse(unit: str) -> Any:
    pint = _import_pint()

    if not _is_short(unit):
        raise ValueError(f"cannot read the unit {shorten(unit, 40)!r}: it is too long, or has a power without end")
    try:
        if "#" in unit:  # the parser takes it for the start of a comment
            raise ValueError("no unit has a '#'")
        return _registry().parse_units(unit)
    except pint.UndefinedUnitError as error:
        raise ValueError(f"unknown unit {shorten(unit, 40)!r}") from error
    except Exception as error:  # pint passes on whatever its tokenizer meets
        raise ValueError(f"cannot read the unit {shorten(unit, 40)!r}") from error


@cache
def factor(unit: str, si: str) -> float:
    """Return the factor that turns a number in `unit` into one in the SI unit `si`.

    Raises
    ------
    ValueError
        If `unit` is unknown, measures something else than `si`, or counts from an offset as degC does.
    """
    pint = _import_pint()

    parsed = _parse(unit)
    try:
        zero, one = (float(_registry().Quantity(number, parsed).to(si).magnitude) for number in (0.0, 1.0))
    except pint.DimensionalityError as error:
        what = "the number has no unit" if si == "1" else f"it is not a unit of {MEASURES.get(si, si)}"
        raise ValueError(f"{unit!r} is wrong here: {what}") from error
    if zero != 0:
        raise ValueError(f"{unit!r} does not count from zero; use {si!r}")
    if si == "Hz" and "radian" in _registry().get_root_units(parsed)[1]._units:
        return one / (2 * math.pi)  # to pint a radian is one, and a turn in a second is 6.28 Hz
    return one


def from_text(text: object, si: str, *, small: bool = False) -> float:
    """Read ``"0.5 mm"`` as a number in the SI unit `si`.

    A bare number is accepted only where the quantity has no unit (`si` is ``"1"``). Of what is `small`, as noise is,
    the example in a refusal is no size of a part.

    Raises
    ------
    ValueError
        If the text is no number with a unit, the unit is wrong, or the number is not finite.
    """
    hint = f'; write for example "{SMALL.get(si, example(si)) if small else example(si)}"' if si != "1" else ""
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise ValueError(f"is not a number{' with a unit' if si != '1' else ''}{hint}")
    try:
        number, unit = _split(str(text))
        if math.isfinite(number) and not unit and si != "1":
            raise ValueError("the unit is missing")
        value = number * factor(unit or "1", si) if math.isfinite(number) else number
        if not math.isfinite(value):
            raise ValueError("is not a finite number")
    except ValueError as error:
        raise ValueError(f"{error}{hint}") from error
    return value


def quantity(values: Any, unit: str) -> Any:
    """Return numbers with their unit, for arithmetic that checks units: a quantity of pint.

    Raises
    ------
    ValueError
        If the unit is unknown, or counts from an offset as degC does.

    >>> (3 * quantity(2.0, "V") / quantity(0.5, "V/mm")).to("mm").magnitude
    12.0
    """
    parsed = _parse(unit or "1")
    if _registry().Quantity(0.0, parsed).to_base_units().magnitude != 0:
        raise ValueError(f"{unit!r} does not count from zero; use {_si_of(unit)!r}")
    return _registry().Quantity(values, parsed)


def quantity_from_text(text: object) -> Any:
    """Read ``"0.5 mm"`` as a quantity of pint in whatever unit it has; a bare number is a pure number.

    Raises
    ------
    ValueError
        If the text is no finite number, or the unit is unknown.
    """
    if isinstance(text, bool) or not isinstance(text, (str, int, float)):
        raise ValueError('is not a number with a unit; write for example "1.5 V/mm"')
    number, unit = _split(str(text))
    if not math.isfinite(number):
        raise ValueError("is not a finite number")
    return quantity(number, unit)


def to_text(value: float, unit: str, digits: int = 4, si: str | None = None) -> str:
    """Write the SI number `value` in `unit`, with `digits` significant digits."""
    number = value / factor(unit or "1", si or _si_of(unit))
    return f"{significant(number, digits)} {unit}".rstrip()


def suitable(unit: str, value: float, si: str) -> str:
    """Return a unit, or a coarser one where an SI number has five digits and more before the point.

    >>> suitable("urad/V", 0.0122, "rad/V"), suitable("um", 2e-4, "m"), suitable("um", -3.0, "m")
    ('mrad/V', 'um', 'm')
    """
    base, per, rest = unit.partition("/")
    if base not in COARSER or not 1e4 <= (number := abs(value) / factor(unit, si)) < math.inf:
        return unit
    return COARSER[base][number >= 1e6] + per + rest


def significant(number: float, digits: int = 4) -> str:
    """Write a number with `digits` significant digits, without an exponent where that stays readable."""
    if number == 0 or not math.isfinite(number):
        return f"{number:g}"
    exponent = math.floor(math.log10(abs(float(f"{number:.{digits - 1}e}"))))
    if -4 <= exponent < 7:
        return f"{number:.{max(digits - 1 - exponent, 0)}f}"
    return f"{number:.{digits - 1}e}"


def hertz(frequency: float, digits: int = 4) -> str:
    """Write a frequency without an exponent, and without zeros that say nothing.

    >>> hertz(13000.0), hertz(0.6), hertz(17857142.9, 6)
    ('13000 Hz', '0.6 Hz', '17857100 Hz')
    """
    return f"{float(f'{frequency:.{digits}g}'):.12g} Hz"


def typeset(text: str) -> str:
    """Write the units in a text with the Greek letter for micro, as pages and drawings have them.

    >>> typeset("1.98 um/V, N/um, um² and 3 urad; 5 us; us, humus and input_of_20_um")
    '1.98 µm/V, N/µm, µm² and 3 µrad; 5 µs; us, humus and input_of_20_um'
    """
    return _MICRO.sub("µ", text)


def example(si: str) -> str:
    """Return an example of how a quantity in `si` is written."""
    number = {"kg/m^3": "2700", "Pa": "500"}.get(si, "1.5")
    return f"{number} {DISPLAY.get(si, si)}".rstrip()


@cache
def _si_of(unit: str) -> str:
    base = _registry().Quantity(1.0, _registry().parse_units(unit or "1")).to_base_units()
    return f"{base.units:~C}" or "1"


def _split(text: str) -> tuple[float, str]:
    if len(text) > LONGEST_NUMBER:
        raise ValueError(f"is no number of at most {LONGEST_NUMBER} letters, with its unit")
    match = re.match(
        r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?(?:nan|inf)(?:inity)?)\s*(.*?)\s*$", text, re.I
    )
    if not text.strip():
        raise ValueError("is empty")
    if not match:
        raise ValueError("does not begin with a number")
    if match[2].startswith(","):
        raise ValueError("decimals are written with a point")
    return float(match[1]), match[2]

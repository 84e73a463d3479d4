"""Header cells as programs write them: a name with its unit behind it, in any spelling."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache

from flexdesign.core import unit_tables
from flexdesign.measurements.importing import roles

#: What a column of a recording may measure.
KINDS = (*unit_tables.ANY, "m/V", "rad/V")
#: What a ratio in decibels is called here; it belongs to no SI unit.
DECIBEL = "dB"
#: Units that the register of units does not know, by how they are written in small letters without accents.
WRITTEN = {
    "v": "V", "volts": "V", "sek": "s", "sekunde": "s", "sekunden": "s", "seconde": "s", "secondes": "s",
    "segundos": "s", "secondi": "s", "millisekunde": "ms", "millisekunden": "ms", "milliseconde": "ms",
    "millisecondes": "ms", "millis": "ms", "micros": "us", "µsec": "us", "usec": "us", "mikrosekunden": "us",
    "mikrometer": "um", "micrometre": "um", "micrometres": "um", "mikron": "um", "nanometre": "nm", "nanometres": "nm",
    "millimetre": "mm", "millimetres": "mm", "metre": "m", "metres": "m", "mètre": "m", "grad celsius": "degC",
    "c": "degC", "deg c": "degC", "° c": "degC", "ºc": "degC", "db": DECIBEL, "µ": "um", "°": "deg", "amps": "A",
}  # fmt: skip
#: Where text in UTF-8 was read as Windows' western European.
_GARBLED = {"Âµ": "µ", "Î¼": "µ", "Â°": "°"}
#: What the register of units takes for units, and people do not.
_NO_UNITS = frozenset(("in", "ch", "dac", "amp", "point", "day", "count", "a", "u"))
#: Names that are units, and say by that what they measure.
_WHOLE = re.compile(
    r"m?sec(ond)?s?|usec|m(illi|icro)seconds?|[mu\u00b5]s|volts?|[mk]v|[nmu\u00b5]m|microns?|k?hz|(deg|°)c", re.I
)
_BRACKETS = re.compile(r"\s*[\[({<]\s*([^\[\](){}<>]*?)\s*[\])}>]")
_NUMBERED = re.compile(r"(.*\S)\s*[\[(]\d+[\])]")
_SEPARATED = re.compile(r"\s+in\s+|\s*[_,/:;.\s-]\s*")


@cache
def unit_of(cell: str) -> str:
    """Return the unit that a text names, also as instruments write it: ``Volt``, ``sekunden``; empty if none.

    >>> unit_of("Volt"), unit_of("Âµm"), unit_of("Sekunden"), unit_of("bench")
    ('volt', 'µm', 's', '')
    """
    for wrong, right in _GARBLED.items():
        cell = cell.replace(wrong, right)
    low = cell.lower()
    small = low if low in _NO_UNITS or not _NO_UNITS & set(low.split("/")) else ""  # A of rad/A is no year
    for written in (WRITTEN.get(low, ""), cell, small):
        if written == DECIBEL or (written and si_of(written)):
            return written
    return ""


def si_of(unit: str) -> str:
    """Return the SI unit that a unit belongs to; empty if there is none, ``dB`` of decibels.

    >>> si_of("mV"), si_of("um/V"), si_of("dB")
    ('V', 'm/V', 'dB')
    """
    if unit == DECIBEL or not unit:
        return unit
    try:
        return unit_tables.si_of(unit, KINDS)
    except ValueError:
        return ""


def split_unit(cell: str) -> tuple[str, str]:
    """Return name and unit of a header cell; the unit is empty where none is stated.

    A unit in brackets is one, wherever it stands. One behind a separator is one if it is that of what the name says:
    ``pos_m`` is in metres, ``Channel A`` has no unit.

    >>> [split_unit(cell) for cell in ("x [um]", "Weg in µm", "time_ms", "Kanal A (mV)", "Channel A", "Gain (m/N)")]
    [('x', 'um'), ('Weg', 'µm'), ('time', 'ms'), ('Kanal A', 'mV'), ('Channel A', ''), ('Gain', 'm/N')]
    """
    cell = cell.strip()
    if len(cell) > unit_tables.LONGEST:
        return cell, ""
    brackets = list(_BRACKETS.finditer(cell))
    for match in reversed(brackets):
        if unit := unit_of(match[1]):
            return f"{cell[: match.start()]} {cell[match.end() :]}".strip() or match[1], unit
    if brackets and brackets[-1].end() == len(cell) and brackets[-1].start():
        inside = brackets[-1][1]
        is_name = roles.axis_of(inside) or roles.classes(inside)
        if inside and (not is_name or _is_ratio(inside)):  # a unit that nobody knows
            return cell[: brackets[-1].start()].strip(), inside
        return cell, ""
    for match in _SEPARATED.finditer(cell):
        name, written = cell[: match.start()].strip(), cell[match.end() :].strip()
        unit = unit_of(written)
        if name and unit and written.lower() not in _NO_UNITS and _suits(name, unit, written):
            return name, unit
    if camel := re.search(r"(?<=[a-z])[A-Z][a-z]*$", cell):  # timeMs
        name, written = cell[: camel.start()], camel[0].lower()
        if (unit := unit_of(written)) and _suits(name, unit, written):
            return name, unit
    is_unit = _WHOLE.fullmatch(cell) or (len(cell) > 1 and cell.lower() in WRITTEN)
    return cell, unit_of(cell) if is_unit else ""


def numbered(cells: Sequence[str]) -> frozenset[str]:
    """Return the header cells whose brackets hold a number that counts channels, which is no unit.

    >>> sorted(numbered(["pos (1)", "pos (2)", "coherence (1)"]))
    ['pos (1)', 'pos (2)']
    """
    found = [(cell, match[1]) for cell in cells if (match := _NUMBERED.fullmatch(cell))]
    return frozenset(cell for cell, name in found if [other for _, other in found].count(name) > 1)


def _is_ratio(text: str) -> bool:
    """Tell whether a text is one unit over another: ``m/N`` is, ``x/y`` is none."""
    over = text.split("/")
    return len(over) == 2 and all(unit_of(part) for part in over)


def _suits(name: str, unit: str, written: str) -> bool:
    """Tell whether what stands behind a name is its unit: of what the name says, or a unit that is nothing else."""
    si, plain = si_of(unit), roles.role_of(name, "")
    if plain.column and roles.role_of(name, si).strength > 0:
        return True
    return not plain.column and len(written) > 1 and si not in ("", "1")

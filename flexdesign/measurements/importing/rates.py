"""The sampling rate that a file states, in a scalar or in words above a table."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence

from flexdesign.measurements.importing.contents import Contents, short_name

#: Names of scalars that are a sampling rate in Hz, or the time between samples in s.
RATES = ("fs", "fsamp", "rate", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency", "abtastrate")
PERIODS = (
    "ts", "dt", "tsample", "tinterval", "sampletime", "samplingtime", "sampleinterval", "samplinginterval",
    "abtastzeit",
)  # fmt: skip
#: The same in lines above a table: the words, the number, its unit.
_PHRASES = re.compile(
    r"(sampl\w*[ _]*(?:rate|freq\w*)|abtastrate|\bfs\b)\W*([0-9.,eE+-]+)\W*([kM]?Hz|[kM]?S/s)?|"
    r"(sampl\w*[ _]*(?:interval|time|period)|abtastzeit|\bdt\b|\bts\b)\W*([0-9.,eE+-]+)\W*([num\u00b5]?s(?:ec)?)?\b",
    re.I,
)


def stated_rate(contents: Contents) -> str:
    """Return the sampling rate that a scalar or a line above a table states; ``?`` if none does."""
    for name, variable in contents.variables.items():
        plain = re.sub(r"[\W_]", "", short_name(name).lower())
        if variable.size == 1 and not variable.is_complex and plain in (*RATES, *PERIODS):
            number = float(variable.values().item())
            if math.isfinite(number) and number > 0:
                return f"{number if plain in RATES else 1 / number:.12g} Hz"
    return next(_stated_rates(contents.notes), "?")


def _stated_rates(notes: Sequence[str]) -> Iterator[str]:
    for note in notes:
        for match in _PHRASES.finditer(note[:200]):
            text = (match[2] or match[5] or "").rstrip(".,").replace(",", ".")
            try:
                number = float(text)
            except ValueError:
                continue
            if not (math.isfinite(number) and number > 0):
                continue
            unit = match[3] or match[6] or ""
            if match[2]:
                yield f"{number * {'k': 1e3, 'M': 1e6}.get(unit[:1], 1.0):.12g} Hz"
            else:
                yield f"{1 / (number * {'m': 1e-3, 'u': 1e-6, 'µ': 1e-6, 'n': 1e-9}.get(unit[:1], 1.0)):.12g} Hz"

"""Ways to damage a file."""

from __future__ import annotations

import re
from collections.abc import Callable
from random import Random

#: More letters than any key or name has.
LONG = 5000
NUMBERS = (
    "0", "-1", "1", "3", "7.5", "-0.0", "1e-320", "1e-30", "1e9", "1e30", "1e308", "1e400", "-1e400", "nan", "inf",
    "-inf", "9223372036854775807", "99999999999999999999", "9" * LONG, "0." + "1" * LONG, "0x" + "f" * LONG, "1_0",
)  # fmt: skip
#: Values of TOML of every kind.
VALUES = (
    *NUMBERS, "true", "false", '""', '"?"', '" "', "[]", "[[]]", "{}", "[1, 2]", '["a"]', '["a", 1]', "[{}]",
    "{ a = 1 }", "{ a = { b = [] } }", "1979-05-27T07:32:00Z", "07:32:00", "1979-05-27", '"1e400 mm"', '"nan V"',
    '"-5 um"', '"0 V"', '"1e300 um"', '"1e-300 um"', '"1 mm**99999"', '"1 m**9**9**9"', '"1e-3"', '"1 furlong"',
    '"12 degC"', '"5 %"', '"3 [bold"', '"[mm]"', '"$x_$"', '"a/b"', '"../x"', '"."', '"/"', '"~"', '"nul\\u0000"',
    '"\\u001b[31m"', '"a\\nb"', '"\\u202e"', '"ä±µ"', f'"{"x" * LONG}"', f'"1 {"m" * LONG}"', f"[{'[' * 300}",
    "[" * 50 + "]" * 50, "[" + "1, " * 3000 + "1]", '["0 V", "1e9 V"]', '["1 V", "0 V"]', '["x", "x"]', "-5", "1.5",
    "12345678901", '"9**9**9**9"', '"u ** 9e9 + x"', '"1 9**99 m"', '"1 m²²²²²²²²"',
    f'"1{" " * 50000}"', f'"{"9" * 50000} \\n"', f'"x{" " * 50000}x"', f'"{"(" * 400}1"', f'"1 {"(" * 90}m"',
)  # fmt: skip
#: Cells of tables in text.
CELLS = (
    *NUMBERS, "", " ", "-", "n/a", "abc", '"', '""', "1,5", "#", "12:30", "1 2", "1e12", "-1e12", "3e18", "x" * LONG,
    "t [s]", "u [V]", "x [um]", "x []", "[um]", "x [m**9**9**9]", "x [degC]", "x [" + "m" * LONG + "]", "\u202e",
    "\x1b[31m", "free", "held", "K_in", "5 %", "1e400 %", "nan",
    "x" + " " * 50000 + "x", "9" * 200000, "[" * 50000, "x [" + " " * 50000, "9e99999999", "1" + "\t" * 50000,
)  # fmt: skip
KEYS = (
    "a", "format", "x" * LONG, '"a.b"', '"[bold"', '""', '"a/b"', "axis", "run", "file", "name", ".".join("a" * 2000),
    '"\\u001b"',
)  # fmt: skip
BYTES = (
    b"\xff",
    b"\xfe\xff",
    b"\x80",
    b"\x00",
    b"\xe4",
    b"\r",
    b"\n",
    b"\t",
    b";",
    b",",
    b'"',
    b"[",
    b"]",
    b"#",
    b"\x1a",
)
_TOKEN = re.compile(rb'"[^"\n]*"|\[[^\[\]\n]*\]|\{[^{}\n]*\}|[-+]?\d[\w.+-]*|true|false')
_KEY = re.compile(rb'^[ \t]*([\w.-]+|"[^"\n]*")(?=[ \t]*=)|^\[+([^\]\n]*)\]', re.M)


def damage(data: bytes, kind: str, chance: Random) -> bytes:
    """Return a file with one to three damages; `kind` is ``toml``, ``table`` or ``binary``."""
    for _ in range(chance.choice((1, 1, 1, 2, 3))):
        data = chance.choice(WAYS[kind])(data, chance)
    return data


def _flip(data: bytes, chance: Random) -> bytes:
    found = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 8)) if found else 0):
        found[chance.randrange(len(found))] ^= 1 << chance.randrange(8)
    return bytes(found)


def _truncate(data: bytes, chance: Random) -> bytes:
    return data[: chance.randrange(len(data) + 1)]


def _insert(data: bytes, chance: Random) -> bytes:
    place = chance.randrange(len(data) + 1)
    return data[:place] + chance.choice(BYTES) + data[place:]


def _overwritten(data: bytes, chance: Random) -> bytes:
    """Write extreme whole numbers, zeros or noise over some bytes, as sizes and offsets stand in binary files."""
    what = chance.choice((b"\xff" * 4, b"\x00" * 4, b"\xff" * 8, b"\x7f" * 4, b"\x00" * 64, chance.randbytes(16)))
    place = chance.randrange(len(data) + 1)
    return data[:place] + what + data[place + len(what) :]


def _cut(data: bytes, chance: Random) -> bytes:
    """Leave out or double a block."""
    place, size = chance.randrange(len(data) + 1), chance.choice((1, 4, 64, 512))
    block = data[place : place + size]
    return data[:place] + (block * 2 if chance.random() < 0.5 else b"") + data[place + size :]


def _lines(data: bytes, chance: Random) -> bytes:
    """Leave out, double, move or exchange lines."""
    lines = data.split(b"\n")
    first, second = chance.randrange(len(lines)), chance.randrange(len(lines))
    way = chance.randrange(4)
    if way == 0:
        del lines[first : first + chance.choice((1, 1, 3, 40))]
    elif way == 1:
        lines[first:first] = [lines[first]] * chance.choice((1, 1, 20))
    elif way == 2:
        lines[first], lines[second] = lines[second], lines[first]
    else:
        lines.insert(second, lines.pop(first))
    return b"\n".join(lines)


def _exchanger(token: re.Pattern[bytes], values: tuple[str, ...], group: int = 0) -> Callable[[bytes, Random], bytes]:
    """Return what puts another text in the place of something that a pattern finds."""

    def change(data: bytes, chance: Random) -> bytes:
        found = list(token.finditer(data))
        if not found:
            return data
        match = chance.choice(found)
        begin, end = match.span(match.lastindex or 0) if group else match.span()
        new = chance.choice(values).encode() if chance.random() < 0.9 else chance.choice(found)[0]
        return data[:begin] + new + data[end:]

    return change


def _cell(data: bytes, chance: Random) -> bytes:
    """Put another cell in the place of one, in one row or in a column from there on."""
    lines = data.split(b"\n")
    number = chance.choice((0, 1, 2, chance.randrange(len(lines)), chance.randrange(len(lines)))) % len(lines)
    cells = re.split(rb"[,;\t]", lines[number])
    column, new = chance.randrange(len(cells)), chance.choice(CELLS).encode()
    for line in range(number, min(number + chance.choice((1, 1, 1, 3, 30, len(lines))), len(lines))):
        separator = b";" if b";" in lines[line] else b","
        cells = lines[line].split(separator)
        if column < len(cells):
            cells[column] = new
            lines[line] = separator.join(cells)
    return b"\n".join(lines)


def _repeat(data: bytes, chance: Random) -> bytes:
    """Make one line very long."""
    lines = data.split(b"\n")
    line = chance.randrange(len(lines))
    lines[line] = lines[line] * chance.choice((2, 50, 2000))
    return b"\n".join(lines)


_ANYWHERE = (_flip, _truncate, _insert)
WAYS: dict[str, tuple[Callable[[bytes, Random], bytes], ...]] = {
    "toml": (*_ANYWHERE, _lines, _lines, *[_exchanger(_TOKEN, VALUES)] * 6, *[_exchanger(_KEY, KEYS, 1)] * 2),
    "table": (*_ANYWHERE, _lines, _lines, _cell, _cell, _cell, _cell, _repeat),
    "binary": (*_ANYWHERE, _flip, _overwritten, _overwritten, _cut),
}

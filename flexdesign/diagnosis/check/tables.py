"""Static tables without their design: what was measured of how many parts, and whether it goes together.

A linear part with one input and one output has three compliances, so that four measurements of it must agree: with
K_out of the input free and held, 1/K_out,free - 1/K_out,held = lambda^2 / K_in,free (reciprocity of both compliances).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from flexdesign.analytic.static_model.uncertainty import UNSAID
from flexdesign.diagnosis.check.suspicion import Suspicion
from flexdesign.measurements import static_table
from flexdesign.measurements.noise_level.noise_floor import STANDARD_ERRORS
from flexdesign.measurements.static_table import AXIS, HEAD


@dataclass(frozen=True)
class Measured:
    """One row of a table, SI.

    Parameters
    ----------
    quantity, boundary
        What was measured, the other port free, held, or with the actuator installed.
    value, sigma
        The value and its standard deviation; None where nobody says.
    part
        Everything else in the row, which distinguishes one part from another.
    line
        Of the file.
    """

    quantity: str
    boundary: str
    value: float
    sigma: float | None
    part: tuple[tuple[str, str], ...]
    line: int

    @property
    def doubt(self) -> float:
        """Standard deviation, relative."""
        return UNSAID if self.sigma is None else self.sigma / abs(self.value)


@dataclass(frozen=True)
class TableFacts:
    """What a table holds.

    Parameters
    ----------
    name
        The stem of its file.
    rows
        Its measurements.
    suspicions
        What does not go together.
    """

    name: str
    rows: tuple[Measured, ...]
    suspicions: tuple[Suspicion, ...]

    @property
    def parts(self) -> int:
        """How many different parts were measured."""
        return len({row.part for row in self.rows})

    @property
    def kinds(self) -> tuple[str, ...]:
        """What was measured, each with its boundary."""
        return tuple(dict.fromkeys(f"{row.quantity}, {row.boundary}" for row in self.rows))


def is_table(path: Path) -> bool:
    """Tell whether a CSV file is a static table: its header begins with ``quantity``."""
    try:
        with path.open(encoding="utf-8-sig") as file:
            header = next((line for line in file if line.strip() and not line.lstrip().startswith("#")), "")
    except (OSError, UnicodeDecodeError):
        return False
    return "quantity" in (cell.strip() for cell in header[:1000].split(","))


def facts(path: Path) -> TableFacts:
    """Return what a static table holds and what is suspicious about it.

    Raises
    ------
    InputError
        If it lacks a column, or a value or unit cannot be used.
    """
    _, names, body = static_table.lines_of(path)
    static_table.require(path, names, HEAD)
    rows, found = [], []
    for line, cells in static_table.rows_of(path, names, body):
        quantity, value, sigma = static_table.measurement(path, line, cells)
        rest = tuple((name, cell) for name, cell in cells.items() if name not in HEAD and name != AXIS and cell)
        boundary = ", ".join(text for text in (cells.get(AXIS, ""), cells["boundary"]) if text)
        rows.append(Measured(quantity, boundary, value, sigma, rest, line))
    if all(row.sigma is None for row in rows):
        remedy = f"write sigma, such as 0.5 %; without it {100 * UNSAID:g} % is assumed here"
        found.append(Suspicion(path.stem, "no row states its standard deviation", remedy))
    for part in dict.fromkeys(row.part for row in rows):
        found += _of_part(path.stem, [row for row in rows if row.part == part])
    return TableFacts(path.stem, tuple(rows), tuple(found))


def _of_part(name: str, rows: Sequence[Measured]) -> list[Suspicion]:
    found, first = [], dict[tuple[str, str], Measured]()
    for row in rows:
        same = first.setdefault((row.quantity, row.boundary), row)
        if same is not row:
            off = abs(row.value / same.value - 1)
            if off > STANDARD_ERRORS * math.hypot(row.doubt, same.doubt):
                what = f"lines {same.line} and {row.line}: {row.quantity}, {row.boundary}, differs by {100 * off:.3g} %"
                found.append(Suspicion(name, what, "check both, or give the column that distinguishes the parts"))
    needed = [("K_in", "free"), ("lambda", "free"), ("K_out", "free"), ("K_out", "held")]
    of = {(quantity, boundary.split()[-1]): row for (quantity, boundary), row in first.items()}
    if all(key in of for key in needed):
        k_in, ratio, free, held = (of[key] for key in needed)
        driven, released = ratio.value**2 / k_in.value, 1 / free.value - 1 / held.value
        doubt = math.hypot(
            driven * math.hypot(2 * ratio.doubt, k_in.doubt), free.doubt / free.value, held.doubt / held.value
        )
        if abs(driven - released) > STANDARD_ERRORS * doubt:
            what = (
                f"lines {', '.join(str(row.line) for row in (k_in, ratio, free, held))} do not go together: "
                f"1/K_out,free - 1/K_out,held is {released / driven:.3f} times lambda^2 / K_in"
            )
            found.append(Suspicion(name, what, "one of the four is wrong, or its boundary was not what the table says"))
    return found

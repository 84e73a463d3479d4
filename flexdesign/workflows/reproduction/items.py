"""One printed number, or one statement, compared with ours, and how the verdict on the two is found."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from flexdesign.core import units
from flexdesign.core.model import Quantity
from flexdesign.core.printed_numbers import Printed

Verdict = Literal["agrees", "by construction", "contradictory", "not printed", "differs"]
#: What each verdict means.
VERDICTS: Mapping[Verdict, str] = {
    "agrees": "our number is a result and agrees within the uncertainty of both",
    "by construction": "our number was set, fitted or sized to the printed number, or follows from one that was",
    "contradictory": "two printed numbers, or a printed number and mechanics, contradict each other; the row says why",
    "not printed": "the paper prints no number to compare ours with",
    "differs": "our number is a result and differs by more than the uncertainty of both; no contradiction explains it",
}


@dataclass(frozen=True)
class Item:
    """One row of a reproduction.

    Parameters
    ----------
    system
        To which of the paper's systems it belongs, such as ``"P8"``.
    what
        The number or the statement.
    place
        Where it is printed.
    theirs, ours
        As text, with units; ``"–"`` where there is none.
    verdict
        One of `VERDICTS`.
    why
        What makes the verdict; never empty for a contradiction.
    uses
        Places and names of the printed numbers that enter.
    """

    system: str
    what: str
    place: str
    theirs: str
    ours: str
    verdict: Verdict
    why: str = ""
    uses: tuple[tuple[str, str], ...] = ()


def compare(
    system: str,
    what: str,
    theirs: Printed,
    ours: Quantity | None,
    *,
    built: str = "",
    known: float = 0.0,
    why: str = "",
    also: Sequence[Printed] = (),
) -> Item:
    """Return a printed number and ours, with the verdict.

    Parameters
    ----------
    system, what
        See `Item`.
    theirs, ours
        The printed number, and ours with its standard error, which is written in the unit of the printed one; None
        where there is none of ours.
    built
        How ours was made to be the printed one; empty for a result.
    known
        How well the printed number is known beyond its digits: the error of what measured it [SI].
    why
        The contradiction that a difference shows, if it is one; it is used only where the two differ.
    also
        Further printed numbers that enter.
    """
    uses = tuple((each.place, each.name) for each in (theirs, *also))
    text = theirs.text
    if known and ours:
        text += f" ± {units.to_text(known, in_unit_of(ours, theirs).unit, 2, si=ours.si)}"
    if ours is None:
        return Item(system, what, theirs.place, text, "–", "not printed", why, uses)
    allowed = theirs.half_digit(ours.si) + known + (ours.half_width or 0.0)
    gap = ours.value - theirs.value(ours.si)
    relative = f"{round(100 * gap / theirs.value(ours.si), 2) + 0.0:+.2f} %"
    # Sizing and fitting meet a printed number to a percent or better, not to the last digit.
    if built and abs(gap) <= max(allowed, 0.016 * theirs.value(ours.si)):
        verdict: Verdict = "by construction"
        why = built
    elif math.isfinite(gap) and abs(gap) <= allowed:
        verdict, why = "agrees", f"off by {relative}"
    elif why:
        verdict, why = "contradictory", f"off by {relative}: {why}"
    else:
        verdict, why = "differs", f"off by {relative}"
    return Item(system, what, theirs.place, text, in_unit_of(ours, theirs).formatted(), verdict, why, uses)


def in_unit_of(ours: Quantity, theirs: Printed) -> Quantity:
    """Return a quantity that is written in the unit of a printed number."""
    return replace(ours, unit=theirs.unit or ours.unit)


def contradiction(
    system: str, what: str, numbers: Sequence[tuple[Printed, str]], one: float, other: float, unit: str, why: str
) -> Item:
    """Return two numbers that follow from printed ones and should be one number: agreeing, or not both true.

    Parameters
    ----------
    system, what
        See `Item`.
    numbers
        The printed numbers that enter, each with its SI unit.
    one, other
        What follows from them along two ways [unit].
    unit
        In which both are written.
    why
        What the contradiction is, where they differ.
    """
    relative = sum(number.half_digit(si) / abs(number.value(si)) for number, si in numbers)
    agrees = abs(one / other - 1) <= relative
    uses = tuple((number.place, number.name) for number, _ in numbers)
    places = "; ".join(dict.fromkeys(number.place for number, _ in numbers))
    first, second = (f"{units.significant(value, 5)} {unit}".rstrip() for value in (one, other))
    verdict: Verdict = "agrees" if agrees else "contradictory"
    return Item(system, what, places, first, second, verdict, "to the digits printed" if agrees else why, uses)


def row_without_number(
    system: str, what: str, place: str, ours: str, why: str = "", uses: Sequence[Printed] = ()
) -> Item:
    """Return a row without a printed number that ours could be compared with."""
    return Item(system, what, place, "–", ours, "not printed", why, tuple((n.place, n.name) for n in uses))

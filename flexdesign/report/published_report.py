"""The page of published mechanisms: theirs and ours, with the uncertainty and the effects that close each gap."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from flexdesign.core import units
from flexdesign.core.serialise import header
from flexdesign.effects import statics
from flexdesign.report import charts
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.workflows.published import Compared, Mechanism, PublishedMechanisms
from flexdesign.workflows.published.compare_published import VERDICTS

HEAD = ("quantity", "place", "published", "ours", "difference", "uncertainty", "verdict", "what closes the gap")
#: Verdicts of one number and of several.
SINGULAR = {"explained": "is explained"}
PLURAL = {"agrees": "agree", "explained": "are explained", "differs": "differ"}
#: Numbers on the axis of the picture [%]; it is linear between the first two.
TICKS = (0, 1, 3, 10, 30, 100, 300, 1000)


def document(published: PublishedMechanisms) -> Document:
    """Return the report."""
    texts = ", ".join(
        f"{count} {SINGULAR.get(verdict, verdict) if count == 1 else PLURAL[verdict]}"
        for verdict, count in published.counted().items()
        if count
    )
    summary = [
        f"{len(published.rows)} published number{'s' * (len(published.rows) != 1)} of {len(published.mechanisms)} "
        f"mechanism{'s' * (len(published.mechanisms) != 1)}, compared with finite elements: {texts}.",
        _unexplained(published),
    ]
    sections = [Section("Overview", [_how()], [overview(published)], [_picture(published)])]
    sections += [_section(each) for each in published.mechanisms]
    return Document("Published mechanisms", summary, sections)


def overview(published: PublishedMechanisms) -> Table:
    """Return how many numbers of each mechanism have which verdict, and the largest difference before and after."""
    rows = []
    for each in published.mechanisms:
        counts = [str(sum(row.verdict == verdict for row in each.rows)) for verdict in VERDICTS]
        before, after = (max(values, key=abs) for values in zip(*map(_gaps, each.rows), strict=True))
        rows.append([each.folder.study.design.title, str(len(each.rows)), *counts, _percent(before), _percent(after)])
    head = ["mechanism", "numbers", *VERDICTS, "largest difference", "with the named effects"]
    return Table(head, rows)


def rows(published: PublishedMechanisms) -> list[dict[str, Any]]:
    """Return one record for each number, SI."""
    return [
        {
            "mechanism": each.folder.name,
            "quantity": row.number.key,
            "place": row.number.printed.place,
            "kind": row.number.kind,
            "published": row.theirs,
            "ours": row.ours.value,
            "unit": row.ours.si,
            "half_width": row.ours.half_width,
            "difference": row.gap,
            "uncertainty": row.allowed,
            "verdict": row.verdict,
            "effects": list(row.closing.effects) if row.closing else [],
            "remaining": row.closing.remaining if row.closing else None,
            "neglected": dict(row.neglected),
            "note": row.number.note,
        }
        for each in published.mechanisms
        for row in each.rows
    ]


def result(published: PublishedMechanisms) -> dict[str, Any]:
    """Return result.json's content."""
    head = {**header("published"), "title": "Published mechanisms"}
    return {**head, "verdicts": published.counted(), "rows": rows(published), "seconds": published.seconds}


def _how() -> str:
    meanings = "; ".join(f"“{verdict}” means that {meaning}" for verdict, meaning in VERDICTS.items())
    return (
        "The difference is the published number relative to ours. The uncertainty is that of the published number "
        "(two standard deviations, or half a unit of its last digit) plus the estimated error of our finite elements. "
        "To close a gap, the fewest effects are left out of the compliance model that bring our number to the "
        f"published one. Verdicts: {meanings}."
    )


def _unexplained(published: PublishedMechanisms) -> str:
    named = [
        f"{each.folder.study.design.title}, {row.number.printed.place}: {row.number.quantity}, {row.number.boundary} "
        f"{_percent(row.gap)}{f' ({row.number.note})' if row.number.note else ''}"
        for each in published.mechanisms
        for row in each.rows
        if row.verdict == "differs"
    ]
    return f"Differences that no effect explains: {'; '.join(named) or 'none'}."


def _section(each: Mechanism) -> Section:
    table = Table(HEAD, [_row(row) for row in each.rows])
    return Section(each.folder.study.design.title, [each.folder.source], [table])


def _row(row: Compared) -> list[str]:
    ours = replace(row.ours, unit=row.number.printed.unit or row.ours.unit)
    theirs = row.number.printed.text
    if row.number.sigma:
        width = units.to_text(row.number.half_width(ours.si), ours.unit, 2, si=ours.si)
        theirs = f"{theirs} ± {width}"
    what = f"{row.number.quantity}, {row.number.boundary}"
    place = f"{row.number.printed.place} ({row.number.kind})"
    text = [_percent(row.gap), f"± {units.significant(100 * row.allowed, 2)} %"]
    return [what, place, theirs, ours.formatted(), *text, row.verdict, _closing(row)]


def _closing(row: Compared) -> str:
    if row.closing is not None:
        names = ", ".join(map(_display_name, row.closing.effects))
        known = units.significant(100 * row.closing.uncertainty, 2)
        return f"without {names}: {_percent(row.closing.remaining)}, known to ± {known} %"
    alone = [f"{_display_name(name)} {_percent(change)}" for name, change in row.neglected.items() if name]
    texts = [row.number.note[:1].upper() + row.number.note[1:]] if row.number.note else []
    if alone:
        change = _percent(row.neglected[""])
        texts.append(f"The effects that it neglects change the compliance model by {change}: {', '.join(alone)}")
    return ". ".join(texts) or "–"


def _display_name(name: str) -> str:
    return statics.find(name).name.replace("_", " ")


def _percent(share: float) -> str:
    return f"{100 * share:+.2f} %"


def _gaps(row: Compared) -> tuple[float, float]:
    return row.gap, row.closing.remaining if row.closing else row.gap


def _picture(published: PublishedMechanisms) -> Figure:
    labels = [
        f"{each.folder.name}: {row.number.quantity}, {row.number.boundary}\n{row.number.printed.place}"
        for each in published.mechanisms
        for row in each.rows
    ]
    figure, axes = charts.drawing(7.2, 0.42 * len(labels) + 1.4)
    places = range(len(labels))
    before, after = zip(*map(_gaps, published.rows), strict=True)
    for place, one, other in zip(places, before, after, strict=True):
        axes.plot([100 * one, 100 * other], [place, place], color=charts.NEUTRAL, linewidth=1)
    for values, colour, label in (
        (before, charts.COLOURS[1], "as published"),
        (after, charts.COLOURS[0], "with the named effects"),
    ):
        axes.plot([100 * value for value in values], list(places), "o", color=colour, label=label)
    axes.axvline(0.0, color=charts.NEUTRAL, linewidth=1)
    axes.set_yticks(list(places), labels)
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=TICKS[1])
    low, high = (100 * extreme((*before, *after)) for extreme in (min, max))
    ticks = sorted({sign * tick for tick in TICKS for sign in (-1, 1)})
    axes.set_xticks([tick for tick in ticks if min(low, -TICKS[1]) <= tick <= max(high, TICKS[1])])
    axes.xaxis.set_major_formatter(lambda x, _: f"{x:+g}" if x else "0")
    axes.minorticks_off()
    axes.margins(x=0.1)
    axes.set_xlabel("difference from our finite elements [%]")
    axes.grid(color=charts.NEUTRAL, alpha=0.25)
    charts.below(figure, axes, 2)
    return Figure("gaps.svg", charts.svg(figure), "Published numbers and ours, before and after the named effects")

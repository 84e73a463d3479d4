"""The report of the ablation: a row for each part, and every answer that changes without one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flexdesign.report import render
from flexdesign.report.document import Document, Section, Table
from studies.ablation.ablation import Ablation
from studies.ablation.parts import Part
from studies.hidden_effect_trial.report import seed_note
from studies.hidden_effect_trial.scoring import error_ratio, is_right
from studies.hidden_effect_trial.trial import Outcome, outcome_text

HEADS = (
    "part",
    "what it does",
    "acts in",
    "switched off in",
    "right with it",
    "right without",
    "intervals hold with it",
    "without",
    "error, without / with",
)


def write(found: Ablation, parts: Sequence[Part], out: Path, seed: int) -> list[str]:
    """Write the report into a folder; return its table, a line for each part."""
    rows = [row(part, found) for part in parts]
    changes = [change for part in parts for change in changed_answers(part.key, found)]
    summary = [
        seed_note(seed),
        f"{len(found.as_is)} cases with all parts; then without one part, in the first cases where it acted.",
    ]
    texts = [
        "A part acts in a case if it returns something else than what takes its place. Right verdicts and intervals "
        "that hold the truth are counts; errors of the test runs are a ratio of sums."
    ]
    sections = [
        Section("Parts", texts, [Table(HEADS, rows)]),
        Section("Answers that change", tables=[Table(["part", "case", "with it", "without it"], changes)]),
    ]
    result: dict[str, Any] = {"seed": seed, "parts": [dict(zip(HEADS, each, strict=True)) for each in rows]}
    render.write(out, Document("Ablation of the diagnosis", summary, sections), result, {})
    return ["  ".join([each[0], *each[2:]]) for each in rows]


def row(part: Part, found: Ablation) -> list[str]:
    """Return the row of a part."""
    outcomes = found.without[part.key]
    pairs = [(found.as_is[number], outcome) for number, outcome in outcomes.items()]
    acts = sum(part.key in keys for keys in found.acted.values())
    cells = [part.key, part.does, f"{acts} of {len(found.acted)}", str(len(pairs))]
    for place in (0, 1):
        cells.append(str(sum(_is_right(pair[place]) for pair in pairs)))
    for place in (0, 1):
        inside = [hit for pair in pairs if (each := pair[place].found) for hit, _ in each.inside.values()]
        cells.append(f"{sum(inside)} of {len(inside)}")
    both = [(a, b) for a, b in pairs if a.found is not None and b.found is not None]
    errors = [[error_ratio(e.answer, e.found) for e in pair if e.found] for pair in both]
    return [*cells, _ratio(errors)]


def changed_answers(key: str, found: Ablation) -> list[list[str]]:
    """Return a row for every case that has another verdict, or other names, without a part."""
    rows = []
    for number, without in found.without[key].items():
        before, after = outcome_text(found.as_is[number]), outcome_text(without)
        if _said(before) != _said(after) or _is_right(found.as_is[number]) != _is_right(without):
            marks = ["right" if _is_right(each) else "wrong" for each in (found.as_is[number], without)]
            rows.append([key, str(number), f"{marks[0]}: {before}", f"{marks[1]}: {_said(after)}"])
    return rows


def _said(text: str) -> str:
    """Return the verdict and the names of an outcome, without what remains."""
    return text.partition(" -> ")[2].partition(", ")[0]


def _is_right(outcome: Outcome) -> bool:
    return outcome.found is not None and is_right(outcome.answer, outcome.found)


def _ratio(table: Sequence[Sequence[float]]) -> str:
    with_it = sum(each[0] for each in table)
    return f"{sum(each[1] for each in table) / with_it:.3g}" if with_it else "–"

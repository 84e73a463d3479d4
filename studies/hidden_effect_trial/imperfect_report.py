"""The report of the trial on imperfect benches: how often the main effect is named, and how often one is invented."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from flexdesign.report import render
from flexdesign.report.document import Document, Section, Table
from studies.hidden_effect_trial import scoring
from studies.hidden_effect_trial.folder import Answer
from studies.hidden_effect_trial.report import interval, percent, seed_note, table_name
from studies.hidden_effect_trial.scoring import Diagnosed
from studies.hidden_effect_trial.trial import Outcome, outcome_text

JudgedCases = Sequence[tuple[Answer, Diagnosed]]
#: Columns of a rate.
RATE = ("cases", "rate", "95 % interval (Wilson)")


def write(outcomes: Sequence[Outcome], out: Path, seed: int) -> list[str]:
    """Write the report into a folder; return what it comes to, in lines."""
    judged = [(outcome.answer, outcome.found) for outcome in outcomes if outcome.found is not None]
    rates = _rates(judged)
    sections = [
        Section("Rates", tables=[rates]),
        Section("By structural error", tables=[_by("structural error", judged, lambda answer: answer.fault)]),
        Section("By effect", tables=[_by("hidden", judged, lambda answer: next(iter(answer.effects), "nothing"))]),
        Section("Inventions", tables=[_outcome_table(outcomes, _invents)]),
        Section("Main effects that were not named", tables=[_outcome_table(outcomes, _misses)]),
    ]
    document = Document("Imperfect-bench trial", [seed_note(seed), *_summary(outcomes, judged)], sections)
    render.write(out, document, _result(outcomes, rates, seed), {})
    return [f"{row[0]}: {row[1]} ({row[3]})" for row in rates.rows]


def _summary(outcomes: Sequence[Outcome], judged: JudgedCases) -> list[str]:
    said = [
        f"{len(outcomes)} cases on benches with a structural error of 0.01 to 0.3 % of stroke, rms, that no effect of "
        "the catalogue describes. The hidden effect is at least four times as large. It counts as named whether or not "
        "a remainder is stated as well."
    ]
    if errors := [outcome for outcome in outcomes if outcome.found is None]:
        said.append(f"{len(errors)} cases ended in an error, the first: {errors[0].number}: {errors[0].error}")
    if judged:
        seconds = sorted(found.seconds for _, found in judged)
        said.append(f"A diagnosis took {scoring.median(seconds):.1f} s in the median, {seconds[-1]:.1f} s at most.")
    return said


def _rates(judged: JudgedCases) -> Table:
    single = [(answer, found) for answer, found in judged if answer.effects]
    none = [(answer, found) for answer, found in judged if not answer.effects]
    asked = [
        ("main effect named", single, scoring.names_main, "at least 90 %"),
        ("an effect invented", judged, _has_false_effect, "at most 3 %"),
        ("nothing missing: an effect invented", none, _has_false_effect, ""),
        ("one effect: another invented", single, _has_false_effect, ""),
        ("a remainder stated", judged, lambda _, found: found.remainder > 0.0, ""),
    ]
    rows = [[words, *_rate(chosen, counts), bound] for words, chosen, counts, bound in asked if chosen]
    return Table(["", *RATE, "asked for"], rows)


def _rate(judged: JudgedCases, counts: Callable[[Answer, Diagnosed], bool]) -> list[str]:
    hits = sum(counts(answer, found) for answer, found in judged)
    if not judged:
        return ["–", "–", "–"]
    return [f"{hits} of {len(judged)}", percent(hits / len(judged)), interval(hits, len(judged))]


def _has_false_effect(answer: Answer, found: Diagnosed) -> bool:
    return bool(scoring.false_effects(answer, found))


def _by(what: str, judged: JudgedCases, key: Callable[[Answer], str]) -> Table:
    rows = []
    for name in _unique(key(answer) for answer, _ in judged):
        chosen = [(answer, found) for answer, found in judged if key(answer) == name]
        single = [(answer, found) for answer, found in chosen if answer.effects]
        rows.append([table_name(name), *_rate(single, scoring.names_main), *_rate(chosen, _has_false_effect)])
    named, invented = ([f"{which}: {column}" for column in RATE] for which in ("main effect named", "invented"))
    return Table([what, *named, *invented], rows)


def _unique(names: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(names))


def _invents(answer: Answer, found: Diagnosed) -> str:
    return ", ".join(scoring.false_effects(answer, found))


def _misses(answer: Answer, found: Diagnosed) -> str:
    return "" if scoring.names_main(answer, found) else " and ".join(answer.effects)


def _outcome_table(outcomes: Sequence[Outcome], which: Callable[[Answer, Diagnosed], str]) -> Table:
    rows = [
        [str(outcome.number), words, outcome_text(outcome)]
        for outcome in outcomes
        if outcome.found is not None and (words := which(outcome.answer, outcome.found))
    ]
    return Table(["case", "effect", "hidden, at its effect-to-noise ratio -> said"], rows)


def _result(outcomes: Sequence[Outcome], rates: Table, seed: int) -> dict[str, Any]:
    each = [
        {
            "number": o.number,
            "error": o.answer.fault,
            "named": o.found is not None and scoring.names_main(o.answer, o.found),
            "invented": list(scoring.false_effects(o.answer, o.found)) if o.found is not None else [],
            "said": outcome_text(o),
            "source": o.source,
        }
        for o in outcomes
    ]
    table = [dict(zip(rates.columns[1:], row[1:], strict=True)) | {"what": row[0]} for row in rates.rows]
    return {"seed": seed, "rates": table, "cases": each}

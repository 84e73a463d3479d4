"""The report: a row for each constant, and every verdict that a constant changes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from flexdesign.report import render
from flexdesign.report.document import Document, Section, Table
from studies.hidden_effect_trial.report import seed_note
from studies.sensitivity.constants import Constant
from studies.sensitivity.settings import FACTORS, VariationOutcome

HEADS = (
    "constant",
    "value",
    "what it decides",
    "right at half",
    "as it is",
    "at twice",
    "false names at half",
    "as it is",
    "at twice",
)
#: What is said where a value stays as it is.
NONE = "–"


def write(outcomes: Sequence[VariationOutcome], constants: Sequence[Constant], out: Path, seed: int) -> list[str]:
    """Write the report into a folder; return its table, a line for each constant."""
    rows = [row(constant, outcomes) for constant in constants]
    cases = len(_of(outcomes, "", 1.0))
    changes = changed_verdicts(outcomes)
    summary = [
        seed_note(seed),
        f"{cases} cases, each diagnosed with one constant at half or at twice its value, and with all as they are. "
        f"{len(changes)} of {sum(bool(each.key) for each in outcomes)} diagnoses with a changed constant have another "
        "verdict: right instead of wrong, or wrong instead of right, or other false names.",
        "With so few cases one more or less is chance; a constant matters where it changes several.",
    ]
    texts = ["Right verdicts and false names are counts. A value that stays as it is has no cell."]
    sections = [
        Section("Constants", texts, [Table(HEADS, rows)]),
        Section("Verdicts that change", tables=[Table(["constant", "value", "case", "as it is", "then"], changes)]),
    ]
    result: dict[str, Any] = {
        "seed": seed,
        "constants": [dict(zip(("constant", "value", "decides"), each[:3], strict=True)) for each in rows],
        "diagnoses": [asdict(each) for each in outcomes],
    }
    render.write(out, Document("Sensitivity to decision constants", summary, sections), result, {})
    return ["  ".join([each[0], *each[3:]]) for each in rows]


def row(constant: Constant, outcomes: Sequence[VariationOutcome]) -> list[str]:
    """Return the row of a constant."""
    half, twice = FACTORS
    groups = [_of(outcomes, constant.key, half), _of(outcomes, "", 1.0), _of(outcomes, constant.key, twice)]
    right = [f"{sum(each.right for each in group)} of {len(group)}" if group else NONE for group in groups]
    names = [str(sum(each.false_names for each in group)) if group else NONE for group in groups]
    values = [constant.value(factor) for factor in (half, 1.0, twice)]
    return [constant.key, " / ".join(f"{value:.3g}" for value in values), constant.decides, *right, *names]


def changed_verdicts(outcomes: Sequence[VariationOutcome]) -> list[list[str]]:
    """Return a row for every diagnosis that is right or wrong otherwise than as it is, or names other false effects."""
    as_is = {each.number: each for each in _of(outcomes, "", 1.0)}
    return [
        [each.key, f"{each.value:.3g}", str(each.number), _verdict_text(as_is[each.number]), _verdict_text(each)]
        for each in outcomes
        if each.key and each.number in as_is and _verdict(each) != _verdict(as_is[each.number])
    ]


def _of(outcomes: Sequence[VariationOutcome], key: str, factor: float) -> list[VariationOutcome]:
    return [each for each in outcomes if (each.key, each.factor) == (key, factor)]


def _verdict(outcome: VariationOutcome) -> tuple[bool, int]:
    return outcome.right, outcome.false_names


def _verdict_text(outcome: VariationOutcome) -> str:
    return f"{'right' if outcome.right else 'wrong'}: {outcome.said}"

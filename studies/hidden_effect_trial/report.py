"""The report of a trial: rates, confusion matrix, errors against the noise floor, intervals, time."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from flexdesign.report import charts, render
from flexdesign.report.document import Document, Figure, Section, Table
from studies.hidden_effect_trial import scoring
from studies.hidden_effect_trial.cases import SEED
from studies.hidden_effect_trial.effects import CATALOGUE
from studies.hidden_effect_trial.folder import Answer
from studies.hidden_effect_trial.scoring import Diagnosed, is_right, wilson
from studies.hidden_effect_trial.trial import Outcome, outcome_text, source

JudgedCases = Sequence[tuple[Answer, Diagnosed]]
#: What is asked of the diagnosis: kind, words, what counts, and the bound of the rate.
REQUIRED: tuple[tuple[tuple[str, ...], str, Callable[[Answer, Diagnosed], bool], str], ...] = (
    (("single",), "one effect: right verdict", is_right, "at least 97 %"),
    (("pair",), "two effects: right verdict", is_right, "at least 92 %"),
    (("none",), "nothing missing: an effect named", scoring.is_false_alarm, "at most 0.5 %"),
    (("none",), "nothing missing: said so", is_right, ""),
    (("faint",), "too faint to be seen: an effect named", scoring.is_false_alarm, ""),
    (("outside",), "outside the catalogue: unknown, or a right name with a remainder", is_right, "at least 95 %"),
    (
        scoring.NAMED,
        "error within 1.15 of the floor",
        lambda a, d: scoring.error_ratio(a, d) <= 1.15,
        "at least 95 %",
    ),
)
#: Columns of the confusion matrix that are no effects.
VERDICTS = (scoring.NOTHING, scoring.UNKNOWN, "right", "wrong")
#: What is right in rows that are no effects.
RIGHT = {"none": scoring.NOTHING, "faint": scoring.NOTHING, "outside": scoring.UNKNOWN, "pair": "right"}


def write(outcomes: Sequence[Outcome], out: Path, seed: int = SEED) -> list[str]:
    """Write the report into a folder; return what it comes to, in lines."""
    judged = [(outcome.answer, outcome.found) for outcome in outcomes if outcome.found is not None]
    rates = _rates(judged)
    figures = [_picture(judged)] if judged else []
    sections = [
        Section("Rates", tables=[rates]),
        Section("Confusion matrix", _matrix_text(), [_matrix(judged)], figures),
        Section("Errors and intervals", tables=[_errors(judged), _intervals(judged)]),
        Section("Wrong verdicts", tables=[_wrong(outcomes)]),
    ]
    render.write(
        out,
        Document("Hidden-effect trial", [*_summary(outcomes, judged), seed_note(seed)], sections),
        _result(outcomes, rates, seed),
        {},
    )
    return [f"{row[0]}: {row[1]} ({row[3]})" for row in rates.rows]


def seed_note(seed: int) -> str:
    """Return what the rates of a seed are worth."""
    if seed == SEED:
        return (
            f"Seed {seed} is the training seed: constants of the package were chosen on these cases, so that the rates "
            "are too good. For fresh rates take any other seed."
        )
    return f"Seed {seed}. Constants of the package were chosen on seed {SEED}; these are rates on other cases."


def _summary(outcomes: Sequence[Outcome], judged: JudgedCases) -> list[str]:
    kinds = Counter(outcome.answer.kind for outcome in outcomes)
    right = sum(is_right(answer, found) for answer, found in judged)
    seconds = sorted(found.seconds for _, found in judged)
    said = [
        f"{right} of {len(outcomes)} verdicts are right "
        f"({', '.join(f'{n} {kind}' for kind, n in kinds.items())}); a simulator made the cases that shares no code "
        "with the package."
    ]
    if seconds:
        said.append(
            f"A diagnosis took {scoring.median(seconds):.1f} s in the median, {seconds[-1]:.1f} s at most; "
            f"all of them {sum(seconds) / 3600.0:.2f} h, on one core each."
        )
    if errors := [outcome for outcome in outcomes if outcome.found is None]:
        said.append(f"{len(errors)} cases ended in an error, the first: {errors[0].number}: {errors[0].error}")
    if old := sum(outcome.source != source() for outcome in outcomes):
        said.append(f"{old} cases were diagnosed by another version of the package than the present one.")
    return said


def _rates(judged: JudgedCases) -> Table:
    rows = []
    for kinds, words, counts, asked in REQUIRED:
        chosen = [(answer, found) for answer, found in judged if answer.kind in kinds]
        hits = sum(counts(answer, found) for answer, found in chosen)
        if chosen:
            rows.append(
                [words, f"{hits} of {len(chosen)}", percent(hits / len(chosen)), interval(hits, len(chosen)), asked]
            )
    held = [hit for _, found in judged for hit, _ in found.inside.values()]
    if held:
        share = percent(sum(held) / len(held))
        rows.append(
            [
                "95 % intervals that hold the truth",
                f"{sum(held)} of {len(held)}",
                share,
                interval(sum(held), len(held)),
                "93 to 97 %",
            ]
        )
    return Table(["", "cases", "rate", "95 % interval (Wilson)", "asked for"], rows)


def interval(hits: int, trials: int) -> str:
    """Return the 95 % interval of a rate in words."""
    low, high = wilson(hits, trials)
    return f"{percent(low)} to {percent(high)}"


def percent(rate: float) -> str:
    """Return a rate in percent."""
    return f"{100.0 * rate:.1f} %"


# --- the matrix -----------------------------------------------------------------------------------------------------


def _matrix_text() -> list[str]:
    return [
        "Rows are what was hidden; the picture's columns are what was said. An effect that was named in a group which "
        "the recordings truly cannot separate counts as the hidden one. Pairs count as right or wrong."
    ]


def _order(judged: JudgedCases) -> tuple[list[str], list[str], dict[str, dict[str, int]]]:
    counts = scoring.matrix(judged)
    known = [effect.name for effect in CATALOGUE]
    rows = [name for name in ("none", "faint", *known, "pair", "outside") if name in counts]
    used = {column for row in counts.values() for column in row}
    others = sorted(used - {*known, *VERDICTS})
    columns = [name for name in (scoring.NOTHING, *known, *others, "right", "wrong", scoring.UNKNOWN) if name in used]
    return rows, columns, counts


def _matrix(judged: JudgedCases) -> Table:
    """Return the rows of the matrix in words: its columns are as many as the catalogue has effects."""
    rows, columns, counts = _order(judged)
    texts = []
    for row in rows:
        right = RIGHT.get(row, row)
        others = [f"{table_name(c)} {counts[row][c]}" for c in columns if c != right and counts[row].get(c)]
        total = sum(counts[row].values())
        texts.append([table_name(row), str(total), str(counts[row].get(right, 0)), ", ".join(others) or "–"])
    return Table(["hidden", "said in all", "right", "said otherwise"], texts)


def table_name(name: str) -> str:
    """Return a name as it is written in a table."""
    return name.replace("_", " ")


def _picture(judged: JudgedCases) -> Figure:
    """Draw the matrix: each row's shares as squares that are the fuller the larger they are."""
    from matplotlib.figure import Figure as Canvas

    rows, columns, counts = _order(judged)
    canvas = Canvas(figsize=(3.6 + 0.3 * len(columns), 3.4 + 0.3 * len(rows)), layout="constrained")
    axes = canvas.add_subplot()
    charts.plain(axes)
    for i, row in enumerate(rows):
        total = sum(counts[row].values())
        for j, column in enumerate(columns):
            if count := counts[row].get(column, 0):
                fits = column == RIGHT.get(row, row)
                side = 0.92 * math.sqrt(count / total)
                axes.add_patch(_square(j, i, side, charts.COLOURS[0] if fits else charts.COLOURS[1]))
                # A number that its square is too small for is written next to it.
                place, colour = (j, "white") if side > 0.5 else (j + side / 2.0 + 0.22, charts.COLOURS[1])
                axes.text(place, i, str(count), ha="center", va="center", fontsize=12, color=colour)
    axes.set(xlim=(-0.6, len(columns) - 0.2), ylim=(len(rows) - 0.4, -0.6), aspect="equal")
    axes.set_xlabel("said", fontsize=14)
    axes.set_ylabel("hidden", fontsize=14)
    axes.set_xticks(range(len(columns)), [table_name(c) for c in columns], rotation=90, fontsize=13)
    axes.set_yticks(range(len(rows)), [table_name(r) for r in rows], fontsize=13)
    return Figure("confusion.svg", charts.svg(canvas), "What was hidden, and what was said; areas are shares of a row.")


def _square(x: float, y: float, side: float, colour: str) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((x - side / 2.0, y - side / 2.0), side, side, facecolor=colour, linewidth=0)


# --- numbers --------------------------------------------------------------------------------------------------------


def _errors(judged: JudgedCases) -> Table:
    rows = []
    for row in dict.fromkeys(scoring.row_of(answer) for answer, _ in judged):
        chosen = [(answer, found) for answer, found in judged if scoring.row_of(answer) == row]
        over = sorted(scoring.error_ratio(answer, found) for answer, found in chosen if math.isfinite(found.error))
        floors = scoring.median(found.floor / answer.floor for answer, found in chosen)
        right = sum(is_right(answer, found) for answer, found in chosen)
        worst = f"{over[-1]:.3g}" if over else "–"
        seconds = f"{scoring.median(found.seconds for _, found in chosen):.1f}"
        rows.append(
            [
                table_name(row),
                f"{right} of {len(chosen)}",
                f"{scoring.median(over):.3g}",
                worst,
                f"{floors:.3g}",
                seconds,
            ]
        )
    head = ["hidden", "right", "error / floor, median", "largest", "estimated / true floor", "seconds, median"]
    on = "the run for testing" if any(found.is_tested for _, found in judged) else "the validation runs"
    return Table(head, rows, f"Error on {on} with what was named, over the error that no model can go below.")


def _intervals(judged: JudgedCases) -> Table:
    numbers = sorted({name for _, found in judged for name in found.inside})
    rows = []
    for name in numbers:
        each = [found.inside[name] for _, found in judged if name in found.inside]
        held = f"{sum(hit for hit, _ in each)} of {len(each)}"
        rows.append([table_name(name), held, f"±{100.0 * scoring.median(width for _, width in each):.2g} %"])
    return Table(
        ["number", "interval holds the truth", "half width, median"], rows, "95 % intervals of what was named."
    )


def _wrong(outcomes: Sequence[Outcome]) -> Table:
    wrong = [o for o in outcomes if o.found is None or not is_right(o.answer, o.found)]
    rows = [[str(o.number), o.answer.kind, outcome_text(o)] for o in wrong]
    return Table(["case", "kind", "hidden, at its effect-to-noise ratio -> said"], rows)


def _result(outcomes: Sequence[Outcome], rates: Table, seed: int) -> dict[str, Any]:
    each = [
        {
            "number": o.number,
            "kind": o.answer.kind,
            "right": o.found is not None and is_right(o.answer, o.found),
            "said": outcome_text(o),
            "source": o.source,
        }
        for o in outcomes
    ]
    return {
        "seed": seed,
        "rates": [dict(zip(rates.columns[1:], row[1:], strict=True)) | {"what": row[0]} for row in rates.rows],
        "cases": each,
    }

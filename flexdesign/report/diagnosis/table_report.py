"""Reports of static tables: a comparison, a diagnosis, and an effect that was added."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from flexdesign.analytic.static_model import StaticModel
from flexdesign.analytic.static_model.uncertainty import LEVEL
from flexdesign.core import units, versions
from flexdesign.core.serialise import header
from flexdesign.diagnosis.comparison.static_table import TableComparison, compare
from flexdesign.diagnosis.static_tables.diagnose import TableDiagnosis
from flexdesign.diagnosis.static_tables.fit import Trial, constant
from flexdesign.effects import statics
from flexdesign.report.diagnosis import table_text as words
from flexdesign.report.document import Document, Figure, Section, Table

LIBRARIES = ("numpy", "scipy")


def rows(comparison: TableComparison) -> Table:
    """Return the rows of a table and the predictions of the model."""
    noise, found = comparison.uncertainty, []
    for i, row in enumerate(comparison.table.rows):
        share = [100 * part[i] / abs(row.value) for part in (noise.data, noise.inputs, noise.model, noise.validation)]
        found.append(
            [
                words.measurement(row),
                words.number(row, row.value),
                words.number(row, comparison.predicted[i]),
                words.percent(comparison.errors[i]),
                *(f"{value:.2g} %" for value in share),
                "differs" if comparison.significance[i] > 1 else "agrees",
            ]
        )
    caption = (
        f"U is {noise.coverage:.3g} times the root of the sum of squares of u: chance alone takes a row beyond it in "
        f"one of {2 / LEVEL:g} tables"
    )
    head = ["measurement", "measured", "model", "error", "u measured", "u inputs", "u model", "U", "which"]
    return Table(head, found, caption)


def rows_in_brief(comparison: TableComparison) -> Table:
    """Return what fits a terminal: measurement, error, and what would be none."""
    whole = rows(comparison)
    found = [[row[0], row[1], row[3], row[-2], row[-1]] for row in whole.rows]
    return Table(["measurement", "measured", "error", "U", ""], found, "U: what a difference must exceed to count")


def comparison_document(comparison: TableComparison) -> Document:
    """Write the report of a comparison."""
    wrong = int((comparison.significance > 1).sum())
    count = len(comparison.table.rows)
    squares = comparison.uncertainty.squares(comparison.predicted - comparison.table.measured())
    if wrong:
        sentences = [f"{wrong} of {count} measurements differ from the model by more than the validation uncertainty."]
    elif comparison.agrees:
        sentences = [f"All {count} measurements agree with the model within the validation uncertainty."]
    else:
        sentences = [
            "No single measurement differs from the model by more than the validation uncertainty, but together they "
            f"do: their sum of squares is {squares:.3g}, where about {count} is expected."
        ]
    sentences += [f"Take care: {'; '.join(comparison.remarks)}."] if comparison.remarks else []
    picture = Figure("differences.svg", words.differences(comparison), "Each row, and what would be no difference")
    return Document(
        f"{comparison.model.design.title}: compared with {comparison.table.name}",
        sentences,
        [
            Section("Measured and predicted", _uncertainty(comparison), [rows(comparison)], [picture]),
            _physics(comparison.model),
        ],
    )


def diagnosis_document(diagnosis: TableDiagnosis) -> Document:
    """Write the report of a diagnosis."""
    title = f"{diagnosis.before.model.design.title}: diagnosis"
    return Document(title, words.summary(diagnosis), partial(_diagnosis_sections, diagnosis))


def _diagnosis_sections(diagnosis: TableDiagnosis) -> list[Section]:
    before = compare(diagnosis.before.model, diagnosis.before.table)
    after = compare(diagnosis.found.model, diagnosis.before.table)
    pictures = [Figure("differences.svg", words.differences(before), "The design's model")]
    tables = [rows(before)]
    if diagnosis.found.names:
        pictures.append(
            Figure(
                "differences_after.svg",
                words.differences(after),
                f"With {' and '.join(map(words.effect_name, diagnosis.found.names))}",
            )
        )
        tables.append(rows(after))
    sections = [
        Section("The error ladder", [], [error_ladder(diagnosis)]),
        Section("Measured and predicted", _uncertainty(before), tables, pictures),
        Section("What was tried", _candidates_text(), [candidates(diagnosis)]),
    ]
    if diagnosis.proposals:
        head = Table(["measurement", "what each answer expects"], words.proposals(diagnosis))
        sections.insert(2, Section("What would distinguish these effects", [], [head]))
    return [*sections, _physics(diagnosis.before.model)]


def error_ladder(diagnosis: TableDiagnosis) -> Table:
    """Return the error ladder."""
    rungs = [
        [step_of_ladder.label.replace("_", " "), f"{100 * step_of_ladder.error:.3g} %"]
        for step_of_ladder in diagnosis.error_ladder
    ]
    return Table(["model", "relative error, rms"], rungs)


def candidates(diagnosis: TableDiagnosis) -> Table:
    """Return everything that was fitted."""
    shown = []
    for trial in diagnosis.tried[:20]:
        values = "; ".join(words.quantity(value) for value in trial.values) or "there, or not"
        outcome = "" if trial.is_adequate else "leaves more than chance"
        if trial is diagnosis.found:
            outcome = "the answer" if diagnosis.verdict == "effects-found" else "nearest"
        elif trial in diagnosis.alike:
            outcome = "does as well"
        elif trial.cost > diagnosis.before.cost - 4:
            outcome = "explains nothing"
        shown.append([words.names(trial, " + "), values, f"{trial.cost:.3g}", outcome])
    caption = f"Without any: {diagnosis.before.cost:.3g}; {len(diagnosis.before.table.rows)} measurements"
    return Table(["effect", "fitted", "sum of squares", "outcome"], shown, caption)


def _candidates_text() -> list[str]:
    return [
        "Each static effect that the model has not is fitted alone; where none suffices, in pairs. Sums of squares are "
        "in units of what measurement, tolerances and model leave open: about one for each measurement."
    ]


def _uncertainty(comparison: TableComparison) -> list[str]:
    tolerances = comparison.model.design.tolerances
    return [
        f"Inputs: dimensions within {1e6 * tolerances.dimensions:.3g} um and the modulus within "
        f"{100 * tolerances.modulus:.3g} %, alike in all rows; both are ends of what is likely, not standard "
        "deviations. The model's own part comes from amplifiers solved with hexahedra (python -m studies.error_bars). "
        "Where a part does not state what its hinges or rods run into (Member.roots), it is as large as what typical "
        "roots give way."
    ]


def _physics(model: StaticModel) -> Section:
    there = [[words.effect_name(name), statics.find(name).where] for name in model.effects]
    return Section("What the model has", [], [Table(["effect", "where"], there)] if there else [], folded=True)


def comparison_result(comparison: TableComparison) -> dict[str, Any]:
    """Return a comparison as result.json has it."""
    return {
        **header("table comparison"),
        "agrees": comparison.agrees,
        **_comparison(comparison),
        **_provenance(comparison.model),
    }


def diagnosis_result(diagnosis: TableDiagnosis) -> dict[str, Any]:
    """Return a diagnosis as result.json has it."""
    is_known = diagnosis.verdict == "effects-found"
    return {
        **header("table diagnosis"),
        "verdict": diagnosis.verdict,
        "effects": _effects(diagnosis.found) if is_known else {},
        "confusable": [_own_names(group) for group in diagnosis.groups] if is_known else [],
        "near": _own_names(diagnosis.found.names) if diagnosis.verdict == "unknown" else [],
        "ladder": [
            {"model": step_of_ladder.label, "error": step_of_ladder.error} for step_of_ladder in diagnosis.error_ladder
        ],
        "sum_of_squares": {
            "before": diagnosis.before.cost,
            "after": diagnosis.found.cost,
            "measurements": len(diagnosis.before.table.rows),
        },
        "remarks": list(diagnosis.remarks),
        **_comparison(compare(diagnosis.found.model, diagnosis.before.table)),
        **_provenance(diagnosis.before.model),
    }


def _own_names(names: Sequence[str]) -> list[str]:
    """Return what effects call themselves, those in files too."""
    return [statics.find(name).name for name in names]


def _effects(trial: Trial) -> dict[str, Any]:
    effects: dict[str, dict[str, Any]] = {statics.find(name).name: {} for name in trial.names}
    for value in trial.values:
        name, _, parameter = value.parameter.name.rpartition(".")
        scale = units.factor(value.parameter.unit or "1", value.parameter.si)
        effects[statics.find(name).name][parameter] = {
            "value": value.value / scale,
            "interval_95": [end / scale for end in value.interval],
            "unit": value.parameter.unit,
        }
    for name, choice in trial.cases.items():
        if own := constant(name):
            effects[statics.find(name).name][own.name] = {"value": choice[0], "alike": list(choice), "unit": own.unit}
    return effects


def _comparison(comparison: TableComparison) -> dict[str, Any]:
    measured = comparison.table.measured()
    return {
        "rows": [
            {
                "quantity": row.key,
                "dimensions_mm": {n: 1e3 * value for n, value in row.dimensions.items() if n not in row.numbers},
                "numbers": {name: value for name, value in row.dimensions.items() if name in row.numbers},
                "measured_si": float(measured[i]),
                "predicted_si": float(comparison.predicted[i]),
                "validation_uncertainty_si": float(comparison.uncertainty.validation[i]),
            }
            for i, row in enumerate(comparison.table.rows)
        ]
    }


def _provenance(model: StaticModel) -> dict[str, Any]:
    design = model.design
    return {
        "made_by": {
            "design": design.name,
            "dimensions": {name: f"{value * 1e3:g} mm" for name, value in design.dimensions.items()},
            "material": design.material.as_text(),
            "effects": {statics.find(name).name: dict(values) for name, values in model.effects.items()},
            "versions": versions.installed(LIBRARIES),
        }
    }

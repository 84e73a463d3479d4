"""The report of a model that was confronted with runs by hand: its ladder, its numbers, where it fails."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from flexdesign import effects
from flexdesign.core.errors import join_names
from flexdesign.diagnosis.confrontation import Confronted
from flexdesign.diagnosis.result import Value
from flexdesign.report import comparison_text as words
from flexdesign.report.diagnosis import comparison_report, diagnosis_result
from flexdesign.report.diagnosis import diagnosis_figures as figures
from flexdesign.report.diagnosis import diagnosis_report as reports
from flexdesign.report.diagnosis import diagnosis_text as said
from flexdesign.report.document import Document, Section, Table


def ladder_table(found: Confronted) -> Table:
    """Return the error ladder."""
    return reports.error_ladder(found.error_ladder, found.noise, found.noise_floor, said.response(found))


def summary(found: Confronted) -> list[str]:
    """Return by how much the model misses the runs that judge, and where it fails."""
    names = join_names([said.effect_name(name) for name in found.effects]) if found.effects else ""
    which = f"With {names} the" if names else "The"
    error, noise_floor = (words.error(said.response(found), value) for value in (found.error, found.noise_floor))
    times = f"{found.ratio:.3g} times the noise floor ({noise_floor})" if found.noise.known else "the noise is unknown"
    text = [f"{which} model misses {said.validated_on(said.observations(found))} by {error} rms; {times}."]
    if found.reason:
        text.append(words.not_added(figures.capital(said.effect_name(found.effects[-1])), found.reason))
    return text


def where(found: Confronted) -> list[str]:
    """Return where the model fails, in sentences; of noise alone nothing fails."""
    if not found.comparison.runs:
        return []
    if found.comparison.is_noise:
        return ["The residual is noise: nothing in these runs contradicts the model."]
    return words.sentences(found.comparison)


def document(found: Confronted, values: Sequence[Value]) -> Document:
    """Write the report of a confrontation.

    Parameters
    ----------
    found
        The model, compared with the runs.
    values
        Its numbers with their intervals.
    """
    title = f"{found.before.title or found.before.name}: axis {found.axis} confronted with {len(found.runs)} runs"
    return Document(title, [*summary(found), *where(found)], partial(_sections, found, values))


def _sections(found: Confronted, values: Sequence[Value]) -> list[Section]:
    physics = [f"{figures.capital(said.effect_name(name))}: {effects.find(name).physics}" for name in found.effects]
    ladder = figures.ladder_figure(found, found.error_ladder, found.noise_floor)
    return [
        Section("The error ladder", physics, [ladder_table(found)], [ladder]),
        Section("Its numbers", [], [reports.values_table(values)]),
        *comparison_report.document(found.comparison).sections,
    ]


def result(found: Confronted, values: Sequence[Value]) -> dict[str, Any]:
    """Return result.json's content: every number with its unit, and what made it."""
    si = said.response(found)
    return {
        **comparison_report.result(found.comparison),
        "kind": "confrontation",
        "effects": list(found.effects),
        "needed": not found.reason,
        "reason": found.reason or None,
        "ladder": diagnosis_result.ladder_json(found.error_ladder, si),
        "noise_floor": diagnosis_result.noise_json(found.noise, found.noise_floor, si),
        "numbers": [diagnosis_result.value_json(value) for value in values],
        "made_by": diagnosis_result.provenance(found),
    }

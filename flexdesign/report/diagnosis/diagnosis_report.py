"""The report of a diagnosis: the verdict and the error ladder, where the model fails, what it lacks, what was tried."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.core import units, versions
from flexdesign.core.errors import join_names
from flexdesign.diagnosis import Diagnosis, ErrorStep, IdentifiedEffect, Value
from flexdesign.diagnosis.experiment_design.discrimination import Proposal, Resolved
from flexdesign.diagnosis.result import ModelResiduals, compare_model
from flexdesign.dynamics.stage_model import AxisModel
from flexdesign.measurements.noise_level import NoiseFloor
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.report import comparison_text as words
from flexdesign.report.diagnosis import diagnosis_text as prose
from flexdesign.report.diagnosis import plan_pages, response_pages
from flexdesign.report.diagnosis.diagnosis_figures import capital, ladder_figure, more_pictures, pictures, time_domain
from flexdesign.report.document import Document, Section, Table

Flags = NDArray[np.bool_]
#: Number of discriminating experiments listed for two effects.
PROPOSED = 8
#: How the names of smooth functions over frequency begin.
OVER_FREQUENCY = ("magnitude near", "phase near")


def ladder_table(diagnosis: Diagnosis) -> Table:
    """Return the error ladder of a diagnosis."""
    line = response_pages.line_size(diagnosis)
    return error_ladder(
        diagnosis.error_ladder,
        diagnosis.noise,
        diagnosis.noise_floor,
        prose.response(diagnosis),
        line,
        diagnosis.stroke,
    )


def error_ladder(
    rungs: Sequence[ErrorStep],
    noise: NoiseFloor,
    noise_floor: float,
    si: str,
    line: float = math.nan,
    stroke: float = 0.0,
) -> Table:
    """Return the error ladder, the noise floor as its last line where the noise is known.

    Parameters
    ----------
    rungs, noise, noise_floor, si
        Its steps, the noise, its rms, and the unit of both [SI].
    line
        Size of a line of frequency responses; errors are stated as shares of it, where it is finite.
    stroke
        The stroke, likewise, where it is not zero and there are no lines.
    """
    steps = [(prose.label(step_of_ladder), step_of_ladder.error) for step_of_ladder in rungs]
    steps += [(f"noise floor: {noise.source}", noise_floor)] if noise.known else []
    heads = ["model", "rms error"]
    rows = [[name, words.error(si, error, 2 if error is noise_floor else 3)] for name, error in steps]
    whole, of = (line, "of the line") if math.isfinite(line) else (stroke, "of the stroke")
    if whole:
        heads.append(of)
        rows = [[*row, words.percent(error / whole)] for row, (_, error) in zip(rows, steps, strict=True)]
    if noise.known:
        heads.append("over the noise")
        rows = [[*row, units.significant(error / noise_floor, 3)] for row, (_, error) in zip(rows, steps, strict=True)]
    caption = "Over the lines that judge, each weighted by its noise" if math.isfinite(line) else ""
    return Table(heads, rows, caption)


def candidates(diagnosis: Diagnosis) -> Table:
    """Return every effect that was tried, with what it leaves and why it was taken or not."""
    si, line = prose.response(diagnosis), response_pages.line_size(diagnosis)
    rows = [
        [
            " + ".join(prose.effect_name(name) for name in tried.names),
            " + ".join(prose.effect_name(name) for name in tried.present) or "–",
            words.percent(tried.error / line) if math.isfinite(line) else words.error(si, tried.error),
            units.significant(tried.evidence, 3) if tried.evidence > 0 else "none",
            tried.outcome.replace("_", " "),
        ]
        for tried in diagnosis.candidates
    ]
    caption = "Error of the validation runs; evidence in multiples of what chance gives the best of the catalogue"
    error = "error, of the line" if math.isfinite(line) else "rms error"
    return Table(["effect", "with", error, "evidence", "outcome"], rows, caption)


def document(diagnosis: Diagnosis, proposals: Sequence[Proposal]) -> Document:
    """Write the report of a diagnosis.

    Parameters
    ----------
    diagnosis
        The diagnosis.
    proposals
        For its groups the experiments that would distinguish them.
    """
    title = f"{diagnosis.before.title or diagnosis.before.name}: diagnosis of axis {diagnosis.axis}"
    return Document(title, prose.summary(diagnosis, proposals), partial(_sections, diagnosis, proposals))


def _sections(diagnosis: Diagnosis, proposals: Sequence[Proposal]) -> list[Section]:
    axis, mode = diagnosis.before.axes[diagnosis.axis], diagnosis.model.axes[diagnosis.axis].natural_frequency
    before, after = compare_model(diagnosis, "calibrated"), compare_model(diagnosis, "found")
    changed = any(step_of_ladder.label.startswith("+ ") for step_of_ladder in diagnosis.error_ladder)
    stands = [("recalibrated", before), (_model_name(diagnosis), after)] if changed else [("recalibrated", before)]
    names = [named.name for named in diagnosis.effects] or list(diagnosis.possible_effects)
    kinds, bars = pictures(names), ladder_figure(diagnosis, diagnosis.error_ladder, diagnosis.noise_floor)
    return [
        Section("The error ladder", _ladder_text(diagnosis), [ladder_table(diagnosis)], [bars]),
        *time_domain(stands, _runs_text(diagnosis), kinds),
        *response_pages.section([(n, s.responses) for n, s in stands], axis.response_units, mode),
        *(_effect(diagnosis, named) for named in diagnosis.effects),
        Section("What was tried", _candidates_text(diagnosis), [candidates(diagnosis)] if diagnosis.candidates else []),
        *_apart(diagnosis, proposals),
        *_remainder(diagnosis),
        Section("Parameters of the model", _numbers_text(diagnosis), [numbers_table(axis, diagnosis.calibration)]),
        Section("Noise", noise_text(diagnosis.noise, diagnosis.noise_floor, prose.response(diagnosis))),
        *more_pictures(stands, kinds),
        Section("How it was done", _how(diagnosis)),
    ]


# --- pieces that other reports use --------------------------------------------------------------------------------


def noise_text(noise: NoiseFloor, noise_floor: float, si: str) -> list[str]:
    """Return where the noise floor comes from, and how well it is known."""
    value = words.error(si, noise_floor, 2)
    if not noise.known:
        first = f"Nothing in these runs shows the noise: {value} was guessed from the quietest band. "
        first += "Record some seconds in which nothing moves."
        if si.endswith("/V"):
            first = f"No coherence says what the noise of these lines is: {value} was guessed from their neighbours."
    else:
        error = words.percent(noise.relative_error)
        known = f", known to {error} (one standard error)" if math.isfinite(noise.relative_error) else ""
        first = f"{value} rms, from {noise.source}{known}."
    remarks = [f"{remark[:1].upper()}{remark[1:]}." for remark in noise.remarks]
    if noise.lines:
        lines = [f"{units.hertz(line.frequency)} ({words.error(si, line.amplitude, 2)})" for line in noise.lines]
        remarks.insert(0, f"Where it should be quiet, the response swings at {join_names(lines)}; this is no noise.")
    return [first, *remarks]


def values_table(values: Sequence[Value]) -> Table:
    """Return fitted parameters with their meaning and their intervals."""
    rows = []
    for value in values:
        estimate = prose.estimate_of(value)
        name = value.parameter.name.rpartition(".")[2]
        rows.append([name, value.parameter.meaning, estimate.value_text, estimate.interval_text])
    return Table(["parameter", "meaning", "value", "95 % interval"], rows)


def by_run_table(by_run: Mapping[str, Value]) -> list[Table]:
    """Return the values of a parameter that differs from run to run; no table where none does."""
    estimates = {run: prose.estimate_of(value) for run, value in by_run.items()}
    rows = [[run, each.value_text, each.interval_text] for run, each in estimates.items()]
    names = dict.fromkeys(value.parameter.name.rpartition(".")[2] for value in by_run.values())
    return [Table(["run", name, "95 % interval"], rows, f"The {name} differs from run to run") for name in names]


# --- sections -----------------------------------------------------------------------------------------------------


def _model_name(diagnosis: Diagnosis) -> str:
    names = [prose.effect_name(named.name) for named in diagnosis.effects] or [
        prose.effect_name(name) for name in diagnosis.possible_effects
    ]
    return f"with {join_names(names)}"


def _ladder_text(diagnosis: Diagnosis) -> list[str]:
    runs = prose.validated_on(prose.observations(diagnosis))
    return [
        f"Each bar is the error of {runs}. As designed: only the initial conditions of each run are fitted. "
        "Recalibrated: the parameters of the model are fitted, with their priors. Then effects are added, one or two "
        "at a time, while they are significant."
        + ("" if diagnosis.runs else " Every line of a frequency response counts by its noise.")
    ]


def _runs_text(diagnosis: Diagnosis) -> list[str]:
    every = [f"{run.name.partition(':')[0]}: {remark}." for run in diagnosis.runs for remark in run.remarks]
    remarks = list(dict.fromkeys(every))  # the halves of one record say the same
    validation_runs = [run for run in diagnosis.runs if run.role == "validate"]
    if not validation_runs:
        return ["There are no validation runs: the errors are those of the fitted runs.", *remarks]
    return ["Validation runs; only the initial conditions of each were fitted.", *remarks]


def _effect(diagnosis: Diagnosis, named: IdentifiedEffect) -> Section:
    effect = effects.find(named.name)
    text = [
        effect.physics,
        f"Where: {effect.where}.",
        f"What to do about it: {prose.remedy(diagnosis, named.name)}.",
        f"What reveals it: {effect.reveal}.",
        f"Reference: {effect.reference}.",
    ]
    if named.values:
        # The model states those that these runs do not determine as well.
        stated = diagnosis.model.axes[diagnosis.axis].effects.get(named.name, {})
        doubts = effect.cautions({**stated, **{v.parameter.name.rpartition(".")[2]: v.value for v in named.values}})
        text += [f"Take care: {doubt}." for doubt in doubts]
    title = f"The effect: {prose.effect_name(named.name)}"
    return Section(title, text, [values_table(named.values), *by_run_table(named.by_run)] if named.values else [])


def _candidates_text(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.candidates:
        return ["No effect of the catalogue has a significant score, so that none was fitted."]
    return [
        "Every effect of the catalogue was screened at each step: its score is what it can explain in addition to the "
        "parameters of the model. These scored highest, and were fitted together with all other parameters."
    ]


def _apart(diagnosis: Diagnosis, proposals: Sequence[Proposal]) -> list[Section]:
    if not diagnosis.confusable:
        return []
    text = [prose.apart(group, proposals) for group in diagnosis.confusable]
    pairs = [resolved for proposal in proposals for resolved in proposal.resolved]
    text += [
        f"Commands for the bench: flexdesign plan MODEL --resolve {' '.join(effect.name for effect in pair.effects)}"
        for pair in pairs
    ]
    tables = [_separations(pair) for pair in pairs]
    return [Section("Effects that these runs do not distinguish", text, tables)]


def _separations(pair: Resolved) -> Table:
    """Return the experiments that distinguish two effects best."""
    whole = plan_pages.separations(pair)
    caption = f"What distinguishes {prose.either([prose.effect_name(effect.name) for effect in pair.effects])}"
    return Table(whole.columns, whole.rows[:PROPOSED], caption)


def _remainder(diagnosis: Diagnosis) -> list[Section]:
    if not diagnosis.remainder and not diagnosis.sparse_model.terms:
        return []
    si = prose.response(diagnosis)
    text = [f"{capital(diagnosis.remainder)}."] if diagnosis.remainder else ["Only noise remains."]
    rows = [
        [name, words.percent(diagnosis.sparse_model.shares[name]), _coefficient(name, coefficient, si)]
        for name, coefficient in diagnosis.sparse_model.terms.items()
    ]
    caption = "Smooth functions that explain most of the residual, with no physics in them"
    table = Table(["function", "of what they explain", "amount"], rows, caption)
    return [Section("What remains", text, [table] if rows else [])]


def _every(residuals: ModelResiduals) -> list[Run | FrequencyResponse]:
    return [*residuals.runs, *residuals.responses]


def _coefficient(name: str, coefficient: float, si: str) -> str:
    """Write the amount of a smooth function; one over frequency multiplies the response."""
    return words.percent(coefficient) if name.startswith(OVER_FREQUENCY) else words.error(si, coefficient)


def numbers_table(axis: AxisModel, calibration: Sequence[Value]) -> Table:
    """Return the parameters of the model, before and after."""
    before = axis.numbers
    rows = []
    for value in calibration:
        p, estimate = value.parameter, prose.estimate_of(value)
        old = before.get(p.name)
        was = "–" if old is None else units.to_text(old, units.suitable(p.unit, old, p.si), si=p.si)
        change = f"{100 * (value.value / old - 1):+.2g} %" if old else "–"
        rows.append([p.name, was, estimate.value_text, estimate.interval_text, change])
    return Table(["parameter", "design", "fitted", "95 % interval", "change"], rows)


def _numbers_text(diagnosis: Diagnosis) -> list[str]:
    text = ["Fitted together with all effects that were found."]
    text += [f"Beyond the prior: {conflict}." for conflict in diagnosis.conflicts]
    return text


def _how(diagnosis: Diagnosis) -> list[str]:
    seen = [each.name for each in _every(diagnosis) if each.role == "identify"]
    validation_runs = [each.name for each in _every(diagnosis) if each.role == "validate"]
    text = f"Fitted: {join_names(seen)}."
    text += f" Validation: {join_names(validation_runs)}." if validation_runs else " There are no validation runs."
    made = ", ".join(f"{name} {number}" for name, number in versions.installed().items())
    return [
        text,
        "Residuals are whitened with the noise. The initial conditions of each run (offset, amplitudes of the modes, "
        "slow states, reversal voltages, trigger delay) are fitted, and are never named as effects.",
        f"{diagnosis.evaluations} simulations in {diagnosis.seconds:.0f} s; {made}.",
    ]

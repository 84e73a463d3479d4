"""The report of a comparison: by how much a model misses recorded runs, where, and what the residual looks like."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from flexdesign.core import units, versions
from flexdesign.core.errors import join_names
from flexdesign.core.serialise import header, with_unit
from flexdesign.diagnosis.comparison import Breakdown, Comparison, RunComparison
from flexdesign.diagnosis.comparison.compare import reversal_doubt
from flexdesign.dynamics.axis.axis_run import doubts
from flexdesign.measurements.recordings.command_segments import jumps
from flexdesign.report import comparison_text as words
from flexdesign.report.comparison_text import axis_unit
from flexdesign.report.diagnosis import residual_charts as charts
from flexdesign.report.diagnosis import response_pages
from flexdesign.report.diagnosis.identification_report import SLOW
from flexdesign.report.diagnosis.residual_charts import Bars, Trace
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.traces import Curve, Traces

#: What to know of a breakdown.
REMARKS = {"time since the last step": "While the command stands still since"}


def errors(comparison: Comparison) -> Table:
    """Return what the model leaves of every run; without runs of every frequency response."""
    if not comparison.runs:
        return response_pages.table([("predicted", comparison.responses)])
    rows = [
        [
            run.name,
            run.role,
            words.error(comparison.response, run.rms),
            words.error(comparison.response, run.largest),
            words.percent(run.of_stroke),
            f"{run.r2:.4f}" if math.isfinite(run.r2) else "–",
            words.error(comparison.response, run.noise_floor, 2),
            units.significant(run.ratio, 3),
        ]
        for run in comparison.runs
    ]
    heads = ["run", "role", "rms error", "largest", "of stroke", "R²", "noise floor", "rms / floor"]
    stroke = words.span(comparison.response, comparison.runs[0].stroke, 3)
    if not comparison.noise.known:  # a guess would be taken for a fact
        heads, rows = heads[:6], [row[:6] for row in rows]
    offset_note = "the offset of each run is removed"
    if all(run.offset_rms is not None for run in comparison.runs):
        heads.append("offset alone")
        alone = [words.error(comparison.response, run.offset_rms or 0.0) for run in comparison.runs]
        rows = [[*row, rms] for row, rms in zip(rows, alone, strict=True)]
        offset_note = "the initial conditions of each run are fitted, in the last column only its offset"
    return Table(heads, rows, f"Measured minus predicted; {offset_note}. Stroke: {stroke}")


def summary(comparison: Comparison) -> list[str]:
    """Return the answer in a few sentences: by how much, and where."""
    mode = comparison.model.axes[comparison.axis].natural_frequency
    lines = [" ".join(response_pages.sentences(comparison.responses, mode))] if comparison.responses else []
    if not comparison.runs:
        return lines
    rms, noise_floor = (
        words.error(comparison.response, comparison.rms),
        words.error(comparison.response, comparison.floor, 2),
    )
    share = words.percent(comparison.rms / comparison.runs[0].stroke if comparison.runs[0].stroke else math.nan)
    validation = ""
    count = f"{len(comparison.runs)} runs" if len(comparison.runs) > 1 else comparison.runs[0].name
    validation_runs = [r for r in comparison.runs if r.role == "test"] or [
        r for r in comparison.runs if r.role == "validate"
    ]
    if 0 < len(validation_runs) < len(comparison.runs):  # the error that the ladder of a diagnosis states
        squares = np.concatenate([run.residual[np.isfinite(run.residual)] ** 2 for run in validation_runs])
        kind = "test" if validation_runs[0].role == "test" else "validation"
        validation = f" (the {kind} runs by {words.error(comparison.response, float(np.sqrt(np.mean(squares))))})"
    sentences = [
        *doubts(comparison.observed),
        f"The model misses {count} by {rms} rms, {share} of the stroke{validation}. {_noise(comparison)}",
    ]
    if comparison.is_noise:
        noise = f"the noise ({noise_floor})" if comparison.noise.known else "no more than what may be noise"
        sentences.append(f"That is {noise}: nothing in these runs says that the model fails.")
        return [*sentences, *lines]
    if doubt := reversal_doubt(comparison.observed, (), {run.name: run.residual for run in comparison.runs}):
        sentences.append(f"{doubt[0].upper()}{doubt[1:]}?")
    sentences.append(" ".join(words.sentences(comparison)))
    return [*sentences, *lines]


def result(comparison: Comparison) -> dict[str, Any]:
    """Return result.json's content: every number with its unit, and what made it."""
    si = comparison.response

    def number(value: float) -> dict[str, Any]:
        return with_unit(value, si)

    return {
        **header("comparison"),
        "axis": comparison.axis,
        "rms_error": number(comparison.rms),
        "noise_floor": {
            **number(comparison.floor),
            "known": comparison.noise.known,
            "source": comparison.noise.source,
            "relative_error": comparison.noise.relative_error,
            "lines": [
                {"frequency": with_unit(line.frequency, "Hz"), "amplitude": number(line.amplitude)}
                for line in comparison.noise.lines
            ],
            "remarks": list(comparison.noise.remarks),
        },
        "unexplained": number(comparison.unexplained),
        "runs": [
            {
                "name": run.name,
                "role": run.role,
                "rms_error": number(run.rms),
                "largest_error": number(run.largest),
                "error_of_stroke": run.of_stroke,
                "r2": run.r2,
                "noise_floor": number(run.noise_floor),
                "error_over_floor": run.ratio,
                "remarks": list(run.remarks),
            }
            for run in comparison.runs
        ],
        "where": [breakdown_json(b, si) for b in comparison.where],
        "sentences": words.sentences(comparison) if comparison.runs and not comparison.is_noise else [],
        **({"frequency_responses": response_pages.result(comparison.responses, si)} if comparison.responses else {}),
        "made_by": {"model": comparison.model.name, "versions": versions.installed()},
    }


def document(comparison: Comparison) -> Document:
    """Write the report of a comparison."""
    title = f"{comparison.model.title or comparison.model.name}: axis {comparison.axis} against {_count(comparison)}"
    return Document(title, summary(comparison), partial(_sections, comparison))


def _sections(comparison: Comparison) -> list[Section]:
    mode = comparison.model.axes[comparison.axis].natural_frequency
    lines = response_pages.section([("predicted", comparison.responses)], comparison.response, mode)
    if not comparison.runs:
        return lines
    remarks = [f"{run.name}: {remark}." for run in comparison.runs for remark in run.remarks]
    traces = [trace_of(comparison, run) for run in comparison.runs]
    return [
        Section("Errors", [*_noise_remarks(comparison), *remarks], [errors(comparison)]),
        *lines,
        Section("Where it fails", _where_text(comparison), [], [_shares(comparison)]),
        Section("Residuals", _residual_text(), [], _pictures(comparison, traces)),
        Section("Runs", [], [], [f for run in comparison.runs for f in _figures(comparison, run)]),
        Section("Shares in numbers", [], [_table(comparison, b) for b in comparison.where], folded=True),
    ]


# --- figures ----------------------------------------------------------------------------------------------------------


def _shares(comparison: Comparison) -> Figure:
    bars = [
        Bars(
            b.by,
            [words.label(b, p) for p in b.parts],
            [p.share for p in b.parts],
            [p.weight if b.by != "frequency" else math.nan for p in b.parts],
        )
        for b in comparison.where
        if b.by != "run" or len(b.parts) > 1
    ]
    return Figure(
        "shares.svg",
        charts.shares(bars),
        "Shares of the unexplained error, and of the time (each run counts the same): where a bar is longer than its "
        "tick, the model is worse than elsewhere",
    )


def _pictures(comparison: Comparison, traces: Sequence[Trace]) -> list[Figure]:
    large, small = units_of_axes(comparison)
    factor = units.factor(large, comparison.response) / units.factor(small, comparison.response)
    frequencies = charts.octaves(traces)
    scale = units.factor(large, comparison.response)
    noise = []
    for run in comparison.observed:
        density = comparison.noise.density(run, frequencies) / scale**2
        noise.append(np.where(frequencies <= 0.5 / run.period, density, np.nan))
    mode = comparison.model.axes[comparison.axis].natural_frequency
    made = [
        Figure(
            "spectrum.svg",
            charts.spectrum(traces, noise, frequencies, words.sign(large), mode),
            "Spectra, means over the runs: where the residual is above the noise floor, something is missing",
        ),
        Figure(
            "coherence.svg",
            charts.coherence(traces),
            "Coherence of command and residual: near one, the missing effect is linear",
        ),
    ]
    steps = charts.since_step(traces, words.sign(small), factor)
    if steps is not None:
        caption = "Residual after steps, over the logarithm of time: creep is a straight line, a lag dies away"
        made.insert(1, Figure("steps.svg", steps, caption))
    position = charts.over_position(traces, words.sign(large), words.sign(small), factor)
    if position is not None:
        caption = (
            "Residual over position, mean and middle 80 %: two branches mean memory or lag, one curve a nonlinearity"
        )
        made.insert(1, Figure("position.svg", position, caption))
    return made


def _figures(comparison: Comparison, run: RunComparison) -> list[Figure]:
    large, small = axis_unit(comparison.response, run.measured), axis_unit(comparison.response, run.residual)
    scale, fine = units.factor(large, comparison.response), units.factor(small, comparison.response)
    compared = np.isfinite(run.measured)
    t, measured, predicted = run.time[compared], run.measured[compared] / scale, run.predicted[compared] / scale
    signal = [Curve("measured", t, measured), Curve("predicted", t, predicted, dashed=True)]
    left = [Curve("measured minus predicted", t, run.residual[compared] / fine)]
    labels = [f"{comparison.axis} [{words.sign(large)}]", f"residual [{words.sign(small)}]"]
    file = f"{run.name}.svg"
    ratio = units.significant(run.ratio, 3)
    caption = f"{run.name} ({run.role}): {words.error(comparison.response, run.rms)} rms, {ratio} times the noise floor"
    made = [Figure.of_traces(f"run_{file}", Traces([signal, left], "time [s]", labels), caption)]
    if shows_a_loop(run, comparison.model.axes[comparison.axis].natural_frequency):
        command = run.command[compared]
        loop = [Curve("measured", command, measured), Curve("predicted", command, predicted, dashed=True)]
        drawing = Traces([loop], "command [V]", labels[:1], height=3.4)
        made.append(Figure.of_traces(f"loop_{file}", drawing, f"{run.name}: response over command"))
    return made


def shows_a_loop(run: RunComparison, frequency: float) -> bool:
    """Tell whether a run's command goes to and fro, slowly against a mode [Hz] but for a few jumps."""
    command, span = run.command, float(np.ptp(run.command))
    period = max(1, round(1 / (frequency * (run.time[1] - run.time[0]))))
    if not span or len(command) <= period:
        return False
    change = np.abs(command[period:] - command[:-period])
    travelled = float(np.abs(np.diff(command))[~jumps(command)].sum())
    return float(np.quantile(change, 0.95)) < SLOW * span and travelled > 1.5 * span


def units_of_axes(comparison: Comparison) -> tuple[str, str]:
    """Return the units in which the response and the residuals of all runs are drawn."""
    response, runs = comparison.response, comparison.runs
    return axis_unit(response, *(run.measured for run in runs)), axis_unit(response, *(run.residual for run in runs))


def trace_of(comparison: Comparison, run: RunComparison) -> Trace:
    """Return what drawings need of a run, in the unit of `units_of_axes`."""
    scale = units.factor(units_of_axes(comparison)[0], comparison.response)
    period = float(run.time[-1] - run.time[0]) / (len(run.time) - 1)
    return Trace(run.name, period, run.command, run.measured / scale, run.predicted / scale, run.noise_floor / scale)


# --- words ------------------------------------------------------------------------------------------------------------


def _noise(comparison: Comparison) -> str:
    noise_floor = words.error(comparison.response, comparison.floor, 2)
    ratio = units.significant(comparison.rms / comparison.floor, 3)
    if not comparison.noise.known:
        return (
            "The noise is unknown: nothing repeats in these runs, or stands still for longer than the model rings. In "
            f"its quietest band the response has {noise_floor}; the error is {ratio} times that."
        )
    return f"The noise floor is {noise_floor} ({comparison.noise.source}): the error is {ratio} times that."


def _noise_remarks(comparison: Comparison) -> list[str]:
    sentences = [f"Noise: {remark}." for remark in comparison.noise.remarks]
    if comparison.noise.known and comparison.noise.relative_error > 0:
        sentences.insert(
            0, f"The noise floor is known to {words.percent(comparison.noise.relative_error)} (one standard error)."
        )
    if comparison.noise.lines:
        lines = join_names(
            [
                f"{units.hertz(line.frequency)} ({words.error(comparison.response, line.amplitude, 2)})"
                for line in comparison.noise.lines
            ]
        )
        sentences.append(f"Where it should be quiet, the response swings at {lines}; this is not counted as noise.")
    return sentences


def _where_text(comparison: Comparison) -> list[str]:
    if not comparison.unexplained:
        return ["Nothing is above the noise floor."]
    left = words.error(comparison.response, comparison.unexplained)
    return [f"The part of the error above the noise floor is {left} rms; every run counts by its mean square."]


def _residual_text() -> list[str]:
    return ["All runs together. The grey band, or the dashed line, is the noise floor."]


def _count(comparison: Comparison) -> str:
    runs = (
        f"{len(comparison.runs)} runs"
        if len(comparison.runs) > 1
        else "".join(f"run {run.name}" for run in comparison.runs)
    )
    count = len(comparison.responses)
    more = (
        f"{count} frequency responses"
        if count > 1
        else "".join(f"frequency response {r.name}" for r in comparison.responses)
    )
    return " and ".join(part for part in (runs, more) if part)


def _table(comparison: Comparison, breakdown: Breakdown) -> Table:
    rows = [
        [
            words.label(breakdown, part),
            words.percent(part.share),
            "–" if breakdown.by == "frequency" else words.percent(part.weight),
            words.error(comparison.response, part.rms),
        ]
        for part in breakdown.parts
    ]
    return Table([breakdown.by, "of the error", "of the time", "rms in it"], rows, REMARKS.get(breakdown.by, ""))


def breakdown_json(breakdown: Breakdown, response: str) -> dict[str, Any]:
    """Return a breakdown as result.json has it."""
    parts = [
        {
            "label": part.label,
            "lower": part.lower,
            "upper": part.upper,
            "share": part.share,
            "weight": part.weight,
            "rms_error": with_unit(part.rms, response),
        }
        for part in breakdown.parts
    ]
    return {"by": breakdown.by, "unit": breakdown.si or None, "covers": breakdown.covers, "parts": parts}

"""The report of a comparison: by how much a model misses recorded runs, where, and what the residual looks like."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from flexdesign.core import units, versions
from flexdesign.core.serialise import header, with_unit
from flexdesign.diagnosis.comparison import Breakdown, Comparison, RunComparison, reversal
from flexdesign.dynamics.axis.axis_run import doubts
from flexdesign.report import comparison_text as words
from flexdesign.report.comparison_text import units_of
from flexdesign.report.diagnosis import residual_charts as charts
from flexdesign.report.diagnosis import response_pages
from flexdesign.report.diagnosis.identification_report import SLOW
from flexdesign.report.diagnosis.residual_charts import Bars, Trace
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.traces import Curve, Traces

#: An error below this many times the noise floor is noise; the floor itself is known to some percent.
NOISE = 1.15
#: What to know of a breakdown.
REMARKS = {"time since the last step": "While the command stands still since"}
#: A command that changes by this share of its span between two samples jumps.
JUMP = 0.05


def errors(found: Comparison) -> Table:
    """Return what the model leaves of every run; without runs of every frequency response."""
    if not found.runs:
        return response_pages.table([("predicted", found.responses)])
    rows = [
        [
            run.name,
            run.role,
            words.error(found.response, run.rms),
            words.error(found.response, run.largest),
            words.percent(run.of_stroke),
            f"{run.r2:.4f}" if math.isfinite(run.r2) else "–",
            words.error(found.response, run.noise_floor, 2),
            units.significant(run.ratio, 3),
        ]
        for run in found.runs
    ]
    heads = ["run", "role", "rms error", "largest", "of stroke", "R²", "noise floor", "rms / floor"]
    stroke = words.span(found.response, found.runs[0].stroke, 3)
    if not found.noise.known:  # a guess would be taken for a fact
        heads, rows = heads[:6], [row[:6] for row in rows]
    offset_note = "the offset of each run taken out"
    if all(run.offset_rms is not None for run in found.runs):
        heads.append("offset alone")
        alone = [words.error(found.response, run.offset_rms or 0.0) for run in found.runs]
        rows = [[*row, rms] for row, rms in zip(rows, alone, strict=True)]
        offset_note = "the initial conditions of each run fitted; in the last column its offset alone"
    return Table(heads, rows, f"Measured less predicted, {offset_note}; stroke {stroke}")


def summary(found: Comparison) -> list[str]:
    """Return the answer in a few sentences: by how much, and where."""
    mode = found.model.axes[found.axis].natural_frequency
    lines = [" ".join(response_pages.sentences(found.responses, mode))] if found.responses else []
    if not found.runs:
        return lines
    rms, noise_floor = words.error(found.response, found.rms), words.error(found.response, found.floor, 2)
    share = words.percent(found.rms / found.runs[0].stroke if found.runs[0].stroke else math.nan)
    count = f"{len(found.runs)} runs" if len(found.runs) > 1 else found.runs[0].name
    validation_runs = [r for r in found.runs if r.role == "test"] or [r for r in found.runs if r.role == "validate"]
    if 0 < len(validation_runs) < len(found.runs):  # the error that the ladder of a diagnosis states
        squares = np.concatenate([run.residual[np.isfinite(run.residual)] ** 2 for run in validation_runs])
        kind = "test" if validation_runs[0].role == "test" else "validation"
        share += f" (the {kind} runs by {words.error(found.response, float(np.sqrt(np.mean(squares))))})"
    sentences = [
        *doubts(found.observed),
        f"The model misses {count} by {rms} rms, {share} of the stroke. {_noise(found)}",
    ]
    if found.rms < NOISE * found.floor:
        noise = f"the noise ({noise_floor})" if found.noise.known else "no more than what may be noise"
        sentences.append(f"That is {noise}: nothing in these runs says that the model fails.")
        return [*sentences, *lines]
    if doubt := reversal.question(found.correlation):
        sentences.append(f"{doubt[0].upper()}{doubt[1:]}?")
    sentences.append(" ".join(words.sentences(found)))
    return [*sentences, *lines]


def result(found: Comparison) -> dict[str, Any]:
    """Return result.json's content: every number with its unit, and what made it."""
    si = found.response

    def number(value: float) -> dict[str, Any]:
        return with_unit(value, si)

    return {
        **header("comparison"),
        "axis": found.axis,
        "rms_error": number(found.rms),
        "noise_floor": {
            **number(found.floor),
            "known": found.noise.known,
            "source": found.noise.source,
            "relative_error": found.noise.relative_error,
            "lines": [
                {"frequency": with_unit(line.frequency, "Hz"), "amplitude": number(line.amplitude)}
                for line in found.noise.lines
            ],
            "remarks": list(found.noise.remarks),
        },
        "unexplained": number(found.unexplained),
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
            for run in found.runs
        ],
        "where": [breakdown_json(b, si) for b in found.where],
        "sentences": words.sentences(found) if found.runs and found.rms >= NOISE * found.floor else [],
        **({"frequency_responses": response_pages.result(found.responses, si)} if found.responses else {}),
        "made_by": {"model": found.model.name, "versions": versions.installed()},
    }


def document(found: Comparison) -> Document:
    """Write the report of a comparison."""
    title = f"{found.model.title or found.model.name}: axis {found.axis} against {_count(found)}"
    return Document(title, summary(found), partial(_sections, found))


def _sections(found: Comparison) -> list[Section]:
    mode = found.model.axes[found.axis].natural_frequency
    lines = response_pages.section([("predicted", found.responses)], found.response, mode)
    if not found.runs:
        return lines
    remarks = [f"{run.name}: {remark}." for run in found.runs for remark in run.remarks]
    traces = [_trace(found, run) for run in found.runs]
    return [
        Section("Errors", [*_noise_remarks(found), *remarks], [errors(found)]),
        *lines,
        Section("Where it fails", _where_text(found), [], [_shares(found)]),
        Section("Residuals", _left_text(), [], _pictures(found, traces)),
        Section("Runs", [], [], [f for run in found.runs for f in _figures(found, run)]),
        Section("Shares in numbers", [], [_table(found, b) for b in found.where], folded=True),
    ]


# --- figures ----------------------------------------------------------------------------------------------------------


def _shares(found: Comparison) -> Figure:
    bars = [
        Bars(
            b.by,
            [words.label(b, p) for p in b.parts],
            [p.share for p in b.parts],
            [p.weight if b.by != "frequency" else math.nan for p in b.parts],
        )
        for b in found.where
        if b.by != "run" or len(b.parts) > 1
    ]
    return Figure(
        "shares.svg",
        charts.shares(bars),
        "Shares of the unexplained error, and of the time (each run counts the same): where a bar is longer than its "
        "tick, the model is worse than elsewhere",
    )


def _pictures(found: Comparison, traces: Sequence[Trace]) -> list[Figure]:
    large, small = units_of(found.response)
    factor = units.factor(large, found.response) / units.factor(small, found.response)
    frequencies = charts.octaves(traces)
    scale = units.factor(large, found.response)
    noise = []
    for run in found.observed:
        density = found.noise.density(run, frequencies) / scale**2
        noise.append(np.where(frequencies <= 0.5 / run.period, density, np.nan))
    mode = found.model.axes[found.axis].natural_frequency
    made = [
        Figure(
            "spectrum.svg",
            charts.spectrum(traces, noise, frequencies, words.sign(large), mode),
            "Spectra, means over the runs: where the residual is above the noise floor, something is missing",
        ),
        Figure(
            "position.svg",
            charts.over_position(traces, words.sign(large), words.sign(small), factor),
            "Residual over position, mean and middle 80 %: two branches mean memory or lag, one curve a nonlinearity",
        ),
        Figure(
            "coherence.svg",
            charts.coherence(traces),
            "Coherence of command and residual: near one, what is missing is linear",
        ),
    ]
    steps = charts.since_step(traces, words.sign(small), factor)
    if steps is not None:
        caption = "Residual after steps, over the logarithm of time: creep is a straight line, a lag dies away"
        made.insert(2, Figure("steps.svg", steps, caption))
    return made


def _figures(found: Comparison, run: RunComparison) -> list[Figure]:
    large, small = units_of(found.response)
    scale, fine = units.factor(large, found.response), units.factor(small, found.response)
    compared = np.isfinite(run.measured)
    t, measured, predicted = run.time[compared], run.measured[compared] / scale, run.predicted[compared] / scale
    signal = [Curve("measured", t, measured), Curve("predicted", t, predicted, dashed=True)]
    left = [Curve("measured less predicted", t, run.residual[compared] / fine)]
    labels = [f"{found.axis} [{words.sign(large)}]", f"residual [{words.sign(small)}]"]
    file = f"{run.name}.svg"
    ratio = units.significant(run.ratio, 3)
    caption = f"{run.name} ({run.role}): {words.error(found.response, run.rms)} rms, {ratio} times the noise floor"
    made = [Figure.of_traces(f"run_{file}", Traces([signal, left], "time [s]", labels), caption)]
    if shows_a_loop(run, found.model.axes[found.axis].natural_frequency):
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
    jumps = np.abs(np.diff(command)) > JUMP * span
    travelled = float(np.abs(np.diff(command))[~jumps].sum())
    return float(np.quantile(change, 0.95)) < SLOW * span and travelled > 1.5 * span


def _trace(found: Comparison, run: RunComparison) -> Trace:
    scale = units.factor(units_of(found.response)[0], found.response)
    period = float(run.time[-1] - run.time[0]) / (len(run.time) - 1)
    return Trace(run.name, period, run.command, run.measured / scale, run.predicted / scale, run.noise_floor / scale)


# --- words ------------------------------------------------------------------------------------------------------------


def _noise(found: Comparison) -> str:
    noise_floor = words.error(found.response, found.floor, 2)
    ratio = units.significant(found.rms / found.floor, 3)
    if not found.noise.known:
        return (
            f"The noise is unknown: nothing stands still or repeats in these runs. In its quietest band the response "
            f"has {noise_floor}; the error is {ratio} times that."
        )
    return f"The noise floor is {noise_floor} ({found.noise.source}): the error is {ratio} times that."


def _noise_remarks(found: Comparison) -> list[str]:
    sentences = [f"Noise: {remark}." for remark in found.noise.remarks]
    if found.noise.known and found.noise.relative_error > 0:
        sentences.insert(
            0, f"The noise floor is known to {words.percent(found.noise.relative_error)} (one standard error)."
        )
    if found.noise.lines:
        lines = words.listed(
            [
                f"{line.frequency:.4g} Hz ({words.error(found.response, line.amplitude, 2)})"
                for line in found.noise.lines
            ]
        )
        sentences.append(f"Where it should be quiet, the response swings at {lines}; this is not counted as noise.")
    return sentences


def _where_text(found: Comparison) -> list[str]:
    if not found.unexplained:
        return ["Nothing is above the noise floor."]
    left = words.error(found.response, found.unexplained)
    return [f"Unexplained is what is above the noise floor, {left} rms; every run counts by its mean square."]


def _left_text() -> list[str]:
    return ["All runs together. The grey band, or the dashed line, is the noise floor."]


def _count(found: Comparison) -> str:
    runs = f"{len(found.runs)} runs" if len(found.runs) > 1 else "".join(f"run {run.name}" for run in found.runs)
    count = len(found.responses)
    more = (
        f"{count} frequency responses"
        if count > 1
        else "".join(f"frequency response {r.name}" for r in found.responses)
    )
    return " and ".join(part for part in (runs, more) if part)


def _table(found: Comparison, breakdown: Breakdown) -> Table:
    rows = [
        [
            words.label(breakdown, part),
            words.percent(part.share),
            "–" if breakdown.by == "frequency" else words.percent(part.weight),
            words.error(found.response, part.rms),
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

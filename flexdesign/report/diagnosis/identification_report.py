"""The report of an identification: the estimates and what they rest on, then every run, measured and predicted."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from flexdesign.core import units, versions
from flexdesign.core.errors import join_names
from flexdesign.core.serialise import header, with_unit
from flexdesign.diagnosis.comparison import RunComparison
from flexdesign.diagnosis.identify import Identification
from flexdesign.estimation import Estimate
from flexdesign.report import comparison_text as words
from flexdesign.report.comparison_text import axis_unit
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.traces import Curve, Traces

#: A command that moves less than this share of its span in a period of the mode is slow: then a loop is drawn.
SLOW = 0.1


def estimates(identification: Identification) -> Table:
    """Return the estimates with their intervals; of what is held its value and why."""
    rows = []
    for estimate in identification.estimates:
        value, remark = estimate.value_text, estimate.reason
        if estimate.name in identification.held:
            value, how = f"({_value(estimate, identification.held[estimate.name])})", "keeps its old value"
            if estimate.name in identification.contradicted:
                how = "held at the best fit, as its old value contradicts the runs"
            remark = f"not determined, {how}: {estimate.reason}"
        interval = "not stated" if identification.is_incomplete and estimate.determined else estimate.interval_text
        rows.append([estimate.name, value, interval, _prior(identification, estimate), remark])
    return Table(["parameter", "value", "95 % interval", "prior", "remark"], rows)


def matches(identification: Identification) -> Table:
    """Return the residual of every run, before and after."""
    rows = [
        [
            run.name,
            run.role,
            words.span(identification.response, run.stroke),
            words.error(identification.response, identification.before_errors[run.name]),
            words.error(identification.response, run.rms),
            f"{100 * run.of_stroke:.3g} %" if math.isfinite(run.of_stroke) else "–",
        ]
        for run in identification.runs
    ]
    columns = ["run", "role", "span", "rms error before", "rms error", "of span"]
    return Table(columns, rows, "Measured minus predicted; the offset of each run is removed")


def result(identification: Identification) -> dict[str, Any]:
    """Return result.json's content: every number with its unit, and what made it."""
    return {
        **header("identification"),
        "axis": identification.axis,
        "estimates": [_json(identification, estimate) for estimate in identification.estimates],
        "correlation": {
            "names": _fit_section(identification),
            "values": identification.fit.correlation.tolist() if identification.fit else [],
        },
        "starts": {
            "asked": identification.starts.asked,
            "polished": identification.starts.refined,
            "agreed": identification.starts.converged,
            "is_unconfirmed": identification.starts.is_unconfirmed,
        },
        "runs": [
            {
                "name": run.name,
                "role": run.role,
                "rms_error": with_unit(run.rms, identification.response),
                "rms_error_before": with_unit(identification.before_errors[run.name], identification.response),
                "span": with_unit(run.stroke, identification.response),
                "error_of_span": run.of_stroke,
                "remarks": list(run.remarks),
            }
            for run in identification.runs
        ],
        "noise": {
            "rms": {name: with_unit(rms, identification.response) for name, rms in identification.noise.rms.items()},
            "source": identification.noise.source,
            "known": identification.noise.known,
        },
        "misfit": identification.misfit,
        "is_incomplete": identification.is_incomplete,
        "simulations": identification.evaluations,
        "made_by": {"model": identification.before.name, "versions": versions.installed()},
    }


def document(identification: Identification) -> Document:
    """Write the report of an identification."""
    name = identification.before.title or identification.before.name
    return Document(
        f"{name}: identification of axis {identification.axis}",
        summary(identification),
        partial(_sections, identification),
        picture=f"{max(identification.runs, key=lambda run: run.rms).name}.svg",
    )


def _sections(identification: Identification) -> list[Section]:
    return [
        Section("Estimates", _estimates_text(identification), [estimates(identification)]),
        Section(
            "Runs",
            _remarks(identification),
            [matches(identification)],
            [f for run in identification.runs for f in _figures(identification, run)],
        ),
        Section(
            "What the fit rests on",
            _rests_on(identification),
            [_correlation(identification)] if _fit_section(identification) else [],
        ),
    ]


def summary(identification: Identification) -> list[str]:
    """Return the answer in a few sentences."""
    seen = [run for run in identification.runs if run.role == "identify"]
    validation_runs = [run for run in identification.runs if run.role != "identify"]
    text = (
        f"{join_names([e.name for e in identification.estimates])} fitted to {join_names([run.name for run in seen])}: "
    )
    text += f"the residual is {_range(identification, seen)}"
    text += f"; of validation and test runs, {_range(identification, validation_runs)}." if validation_runs else "."
    sentences = [*identification.doubts, text, _compare_with_noise(identification)]
    if "bouc_wen" not in identification.before.axes[identification.axis].effects:
        sentences.append("The model has no hysteresis, and none was fitted.")
    if identification.held:
        names, verb = join_names(list(identification.held)), "is" if len(identification.held) == 1 else "are"
        sentences.append(
            f"{names} {verb} not determined by these runs but held; the intervals hold for the values held."
        )
    if identification.starts.is_unconfirmed:
        sentences.append(f"Take care: {identification.starts}.")
    return sentences


def _compare_with_noise(identification: Identification) -> str:
    """Compare the residual with the noise, and say what follows."""
    rms = [identification.noise.rms[run.name] for run in identification.runs if run.role == "identify"]
    level = words.error(identification.response, float(np.sqrt(np.mean(np.square(rms)))))
    if not identification.noise.known:
        return (
            "The noise of these runs is unknown, so that the residual does not show whether the model lacks physics: "
            "state it in measurements.toml, or record a stretch in which no command moves."
        )
    noise = f"the noise of {level} ({identification.noise.source})"
    comparison = f"The residual of the fitted runs is {identification.misfit:.3g} times {noise}"
    if not identification.is_incomplete:
        return f"{comparison}: nothing in it says that the model lacks something."
    return (
        f"{comparison}: the model lacks physics. Values are the best fit; no interval is stated, as it would "
        "count noise alone. flexdesign diagnose, with the same model and runs, finds what is missing."
    )


def _estimates_text(identification: Identification) -> list[str]:
    text = "A value in brackets is held, not measured. " if identification.held else ""
    text += (
        "Intervals are those of the least-squares fit, widened where the residual is coloured, and taken from the "
        "profile of the likelihood where that is not a parabola. They count noise, not physics that the model lacks: "
        "where the residual exceeds the noise none is stated."
    )
    return [text]


def _rests_on(identification: Identification) -> list[str]:
    sentences = [f"{identification.starts}; {identification.evaluations} simulations."]
    if identification.fit:
        factor = max(identification.fit.inflation)
        if factor > 1.5:
            sentences.append(
                f"Neighbouring samples of the residual are alike: up to {factor:.0f} count as one in the intervals. A "
                "residual that is not white means noise with a colour of its own, or physics that the model lacks."
            )
        else:
            sentences.append("The residual is white.")
    if not identification.known:
        sentences.append("No uncertainty was stated for the free parameters: the fit has no prior.")
    return sentences


def _correlation(identification: Identification) -> Table:
    names = _fit_section(identification)
    assert identification.fit is not None
    rows = [[n, *(f"{c:+.2f}" for c in row)] for n, row in zip(names, identification.fit.correlation, strict=True)]
    return Table(["correlation", *names], rows)


def _remarks(identification: Identification) -> list[str]:
    return [f"{run.name}: {remark}." for run in identification.runs for remark in run.remarks]


# --- figures ----------------------------------------------------------------------------------------------------------


def _figures(identification: Identification, run: RunComparison) -> list[Figure]:
    response, residual = identification.response, run.measured - run.predicted
    large, small = axis_unit(response, run.measured), axis_unit(response, residual)
    scale, fine = units.factor(large, response), units.factor(small, response)
    compared = np.isfinite(run.measured)
    t, measured = run.time[compared], run.measured[compared] / scale
    left = residual[compared] / fine
    signal = [Curve("measured", t, measured), Curve("predicted", t, run.predicted[compared] / scale, dashed=True)]
    over_time = Traces(
        [signal, [Curve("measured minus predicted", t, left)]],
        "time [s]",
        [f"{identification.axis} [{words.sign(large)}]", f"residual [{words.sign(small)}]"],
    )
    file = f"{run.name}.svg"
    caption = f"{run.name} ({run.role}): measured, predicted, and the residual"
    made = [Figure.of_traces(file, over_time, caption)]
    if is_slow(run, identification.model.axes[identification.axis].natural_frequency):
        command = run.command[compared]
        loop = [
            Curve("measured", command, measured),
            Curve("predicted", command, run.predicted[compared] / scale, dashed=True),
        ]
        drawing = Traces([loop], "command [V]", [f"{identification.axis} [{words.sign(large)}]"], height=3.4)
        made.append(Figure.of_traces(f"loop_{file}", drawing, f"{run.name}: response over command"))
    return made


def is_slow(run: RunComparison, frequency: float) -> bool:
    """Tell whether a run's command is slow against a mode [Hz], and turns: then its loop shows hysteresis."""
    period = max(1, round(1 / (frequency * (run.time[1] - run.time[0]))))
    span = float(np.ptp(run.command))
    if not span or len(run.command) <= period:
        return False
    fastest = float(np.abs(run.command[period:] - run.command[:-period]).max())
    travelled = float(np.abs(np.diff(run.command)).sum())
    return fastest < SLOW * span and travelled > 1.5 * span


# --- words ------------------------------------------------------------------------------------------------------------


def _fit_section(identification: Identification) -> list[str]:
    return [estimate.name for estimate in identification.fit.estimates] if identification.fit else []


def _value(estimate: Estimate, number: float) -> str:
    parameter = estimate.parameter
    return units.to_text(number, units.suitable(parameter.unit, number, parameter.si), si=parameter.si)


def _prior(identification: Identification, estimate: Estimate) -> str:
    if estimate.name not in identification.known:
        return "–"
    value, sigma = identification.known[estimate.name]
    percent = 100 * sigma / abs(value)
    return f"{_value(estimate, value)} ± {percent:{'.0f' if percent >= 10 else '.2g'}} %"


def _json(identification: Identification, estimate: Estimate) -> dict[str, Any]:
    parameter, held, known = (
        estimate.parameter,
        identification.held.get(estimate.name),
        identification.known.get(estimate.name),
    )
    return {
        "name": estimate.name,
        "unit": parameter.si,
        "determined": estimate.determined,
        "value": estimate.value,
        "sigma": estimate.sigma,
        "interval": list(estimate.interval) if estimate.interval else None,
        "reason": estimate.reason,
        "held": None if held is None else {"value": held, "is_old": estimate.name not in identification.contradicted},
        "known": {"value": known[0], "sigma": known[1]} if known else None,
    }


def _range(identification: Identification, runs: list[RunComparison]) -> str:
    errors = sorted(run.rms for run in runs)
    low, high = (words.error(identification.response, error) for error in (errors[0], errors[-1]))
    shares = sorted(100 * run.of_stroke for run in runs if math.isfinite(run.of_stroke))
    if not shares:
        return f"{low} rms"
    if len(runs) == 1:
        return f"{low} rms, {shares[0]:.2g} % of the span"
    return f"{low} to {high} rms, {shares[0]:.2g} to {shares[-1]:.2g} % of the span"

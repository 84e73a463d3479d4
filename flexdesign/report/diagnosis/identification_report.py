"""The report of an identification: the estimates and what they rest on, then every run, measured and predicted."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from flexdesign.core import units, versions
from flexdesign.core.serialise import header, with_unit
from flexdesign.diagnosis.comparison import RunComparison
from flexdesign.diagnosis.identify import Identification
from flexdesign.estimation import Estimate
from flexdesign.report import comparison_text as words
from flexdesign.report.comparison_text import units_of
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.traces import Curve, Traces

#: A command that moves less than this share of its span in a period of the mode is slow: then a loop is drawn.
SLOW = 0.1


def estimates(found: Identification) -> Table:
    """Return the estimates with their intervals; of what is held its value and why."""
    rows = []
    for estimate in found.estimates:
        value, remark = estimate.value_text, estimate.reason
        if estimate.name in found.held:
            held = found.held[estimate.name]
            value = f"({_value(estimate, held.value)})"
            validation_runs = (
                "keeps its old value" if held.is_old else "held at the best fit, as its old value contradicts the runs"
            )
            remark = f"not determined, {validation_runs}: {estimate.reason}"
        interval = "not stated" if found.is_incomplete and estimate.determined else estimate.interval_text
        rows.append([estimate.name, value, interval, _known(found, estimate), remark])
    return Table(["number", "value", "95 % interval", "known before", "remark"], rows)


def matches(found: Identification) -> Table:
    """Return the residual of every run, before and after."""
    rows = [
        [
            run.name,
            run.role,
            words.span(found.response, run.stroke),
            words.error(found.response, found.before_errors[run.name]),
            words.error(found.response, run.rms),
            f"{100 * run.of_stroke:.3g} %" if math.isfinite(run.of_stroke) else "–",
        ]
        for run in found.runs
    ]
    columns = ["run", "role", "span", "rms error before", "rms error", "of span"]
    return Table(columns, rows, "Measured less predicted, the offset of each run taken out")


def result(found: Identification) -> dict[str, Any]:
    """Return result.json's content: every number with its unit, and what made it."""
    return {
        **header("identification"),
        "axis": found.axis,
        "estimates": [_json(found, estimate) for estimate in found.estimates],
        "correlation": {"names": _fitted(found), "values": found.fit.correlation.tolist() if found.fit else []},
        "starts": {
            "asked": found.starts.asked,
            "polished": found.starts.refined,
            "agreed": found.starts.converged,
            "is_unconfirmed": found.starts.is_unconfirmed,
        },
        "runs": [
            {
                "name": run.name,
                "role": run.role,
                "rms_error": with_unit(run.rms, found.response),
                "rms_error_before": with_unit(found.before_errors[run.name], found.response),
                "span": with_unit(run.stroke, found.response),
                "error_of_span": run.of_stroke,
                "remarks": list(run.remarks),
            }
            for run in found.runs
        ],
        "noise": {
            "rms": {name: with_unit(rms, found.response) for name, rms in found.noise.rms.items()},
            "source": found.noise.source,
            "known": found.noise.known,
        },
        "misfit": found.misfit,
        "is_incomplete": found.is_incomplete,
        "simulations": found.evaluations,
        "made_by": {"model": found.before.name, "versions": versions.installed()},
    }


def document(found: Identification) -> Document:
    """Write the report of an identification."""
    name = found.before.title or found.before.name
    return Document(f"{name}: identification of axis {found.axis}", summary(found), partial(_sections, found))


def _sections(found: Identification) -> list[Section]:
    return [
        Section("Estimates", _estimates_text(found), [estimates(found)]),
        Section("Runs", _remarks(found), [matches(found)], [f for run in found.runs for f in _figures(found, run)]),
        Section("What the fit rests on", _rests_on(found), [_correlation(found)] if _fitted(found) else []),
    ]


def summary(found: Identification) -> list[str]:
    """Return the answer in a few sentences."""
    seen = [run for run in found.runs if run.role == "identify"]
    validation_runs = [run for run in found.runs if run.role != "identify"]
    text = f"{_listed([e.name for e in found.estimates])} fitted to {_listed([run.name for run in seen])}: "
    text += f"the residual is {_range(found, seen)}"
    text += f"; of validation and test runs, {_range(found, validation_runs)}." if validation_runs else "."
    sentences = [*found.doubts, text, _compare_with_noise(found)]
    if "bouc_wen" not in found.before.axes[found.axis].effects:
        sentences.append("The model has no hysteresis, and none was fitted.")
    if found.held:
        names, verb = _listed(list(found.held)), "is" if len(found.held) == 1 else "are"
        sentences.append(
            f"{names} {verb} not determined by these runs but held; the intervals hold for the values held."
        )
    if found.starts.is_unconfirmed:
        sentences.append(f"Take care: {found.starts}.")
    return sentences


def _compare_with_noise(found: Identification) -> str:
    """Compare the residual with the noise, and say what follows."""
    rms = [found.noise.rms[run.name] for run in found.runs if run.role == "identify"]
    level = words.error(found.response, float(np.sqrt(np.mean(np.square(rms)))))
    if not found.noise.known:
        return (
            "The noise of these runs is unknown, so that the residual does not show whether the model lacks physics: "
            "state it in measurements.toml, or record a stretch in which no command moves."
        )
    comparison = (
        f"The residual of the fitted runs is {found.misfit:.3g} times the noise of {level} ({found.noise.source})"
    )
    if not found.is_incomplete:
        return f"{comparison}: nothing in it says that the model lacks something."
    return (
        f"{comparison}: the model lacks physics. Values are the best fit; no interval is stated, as it would "
        "count noise alone. `flexdesign diagnose`, with the same model and runs, finds what is missing."
    )


def _estimates_text(found: Identification) -> list[str]:
    text = "A value in brackets is held, not measured. " if found.held else ""
    text += (
        "Intervals are those of the least-squares fit, widened where the residual is coloured, and taken from the "
        "profile of the likelihood where that is not a parabola. They count noise, not physics that the model lacks: "
        "where the residual exceeds the noise none is stated."
    )
    return [text]


def _rests_on(found: Identification) -> list[str]:
    sentences = [f"{found.starts}; {found.evaluations} simulations in {found.seconds:.1f} s."]
    if found.fit:
        factor = max(match.inflation for match in found.fit.matches)
        if factor > 1.5:
            sentences.append(
                f"Neighbouring samples of the residual are alike: up to {factor:.0f} count as one in the intervals. A "
                "residual that is not white means noise with a colour of its own, or physics that the model lacks."
            )
        else:
            sentences.append("The residual is white.")
    if not found.known:
        sentences.append("No uncertainty was stated for what is free, so that nothing known before took part.")
    return sentences


def _correlation(found: Identification) -> Table:
    names = _fitted(found)
    assert found.fit is not None
    rows = [[n, *(f"{c:+.2f}" for c in row)] for n, row in zip(names, found.fit.correlation, strict=True)]
    return Table(["correlation", *names], rows)


def _remarks(found: Identification) -> list[str]:
    return [f"{run.name}: {remark}." for run in found.runs for remark in run.remarks]


# --- figures ----------------------------------------------------------------------------------------------------------


def _figures(found: Identification, run: RunComparison) -> list[Figure]:
    large, small = units_of(found.response)
    scale, fine = units.factor(large, found.response), units.factor(small, found.response)
    compared = np.isfinite(run.measured)
    t, measured = run.time[compared], run.measured[compared] / scale
    left = (run.measured - run.predicted)[compared] / fine
    signal = [Curve("measured", t, measured), Curve("predicted", t, run.predicted[compared] / scale, dashed=True)]
    over_time = Traces(
        [signal, [Curve("residual, measured less predicted", t, left)]],
        "time [s]",
        [f"{found.axis} [{words.sign(large)}]", f"residual [{words.sign(small)}]"],
    )
    file = f"{run.name}.svg"
    caption = f"{run.name} ({run.role}): measured, predicted, and the residual"
    made = [Figure.of_traces(file, over_time, caption)]
    if is_slow(run, found.model.axes[found.axis].natural_frequency):
        command = run.command[compared]
        loop = [
            Curve("measured", command, measured),
            Curve("predicted", command, run.predicted[compared] / scale, dashed=True),
        ]
        drawing = Traces([loop], "command [V]", [f"{found.axis} [{words.sign(large)}]"], height=3.4)
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


def _fitted(found: Identification) -> list[str]:
    return [estimate.name for estimate in found.fit.estimates] if found.fit else []


def _value(estimate: Estimate, number: float) -> str:
    return units.to_text(number, estimate.parameter.unit, si=estimate.parameter.si)


def _known(found: Identification, estimate: Estimate) -> str:
    if estimate.name not in found.known:
        return "–"
    value, sigma = found.known[estimate.name]
    percent = 100 * sigma / abs(value)
    return f"{_value(estimate, value)} ± {percent:{'.0f' if percent >= 10 else '.2g'}} %"


def _json(found: Identification, estimate: Estimate) -> dict[str, Any]:
    parameter, held, known = estimate.parameter, found.held.get(estimate.name), found.known.get(estimate.name)
    return {
        "name": estimate.name,
        "unit": parameter.si,
        "determined": estimate.determined,
        "value": estimate.value,
        "sigma": estimate.sigma,
        "interval": list(estimate.interval) if estimate.interval else None,
        "reason": estimate.reason,
        "held": {"value": held.value, "is_old": held.is_old} if held else None,
        "known": {"value": known[0], "sigma": known[1]} if known else None,
    }


def _range(found: Identification, runs: list[RunComparison]) -> str:
    errors = sorted(run.rms for run in runs)
    low, high = (words.error(found.response, error) for error in (errors[0], errors[-1]))
    shares = sorted(100 * run.of_stroke for run in runs if math.isfinite(run.of_stroke))
    if not shares:
        return f"{low} rms"
    if len(runs) == 1:
        return f"{low} rms, {shares[0]:.2g} % of the span"
    return f"{low} to {high} rms, {shares[0]:.2g} to {shares[-1]:.2g} % of the span"


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"

"""The report of a diagnosis: the verdict and the error ladder, where the model fails, what it lacks, what was tried."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects, units, versions
from flexdesign.bench import Resolved
from flexdesign.bench.signature import named as speaks_of
from flexdesign.comparison import Comparison, RunComparison
from flexdesign.diagnosis import Diagnosis, Named, Rung, Tried, Value
from flexdesign.diagnosis.standing import Judged, Which, compared
from flexdesign.diagnosis.telling import Telling
from flexdesign.files import FORMAT
from flexdesign.model import Block, Socket
from flexdesign.noise_floor import NoiseFloor
from flexdesign.report import comparison_report, plan_pages
from flexdesign.report import comparison_words as words
from flexdesign.report import diagnosis_charts as drawings
from flexdesign.report import diagnosis_words as said
from flexdesign.report import residual_charts as charts
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.identification_report import SHOWN
from flexdesign.report.residual_charts import Bars, Trace
from flexdesign.stage_model import AxisModel

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
#: Pictures of what is left, by the experiments that an effect says reveal it; the first is for those that say nothing.
PICTURES = {
    "position": ("triangle", "staircase", "push"),
    "steps": ("hold", "steps", "temperature"),
    "spectrum": ("multisine", "quiet"),
}
#: What each shows.
SHOWS = {
    "position": "Residual over position, mean and middle 80 %: two branches mean memory or lag, one a nonlinearity",
    "steps": "Residual after steps, over the logarithm of time: creep is a straight line, a lag dies away",
    "spectrum": "Spectra, means over the runs: where the residual is above the noise floor, something is missing",
    "shares": "Shares of the unexplained error, and of the time: where a bar is longer than its tick, the model is "
    "worse than elsewhere",
}
#: Of a run that is drawn over its command the last so many spans: two loops.
TURNS = 4
#: Runs that are drawn one by one, and experiments that are listed as telling two effects apart.
DRAWN, PROPOSED = 4, 8


def ladder_of(found: Diagnosis) -> Table:
    """Return the error ladder of a diagnosis."""
    return ladder(found.ladder, found.noise, found.noise_floor, said.response(found))


def ladder(rungs: Sequence[Rung], noise: NoiseFloor, floor: float, si: str) -> Table:
    """Return the error ladder, the noise floor as its last line."""
    rows = [[said.label(rung), words.error(si, rung.error), units.significant(rung.error / floor, 3)] for rung in rungs]
    rows.append([f"noise floor: {noise.source if noise.known else 'a guess'}", words.error(si, floor, 2), "1"])
    return Table(["model", "rms error", "over the noise"], rows)


def candidates(found: Diagnosis) -> Table:
    """Return every effect that was tried, with what it leaves and why it was taken or not."""
    si = said.response(found)
    rows = [
        [
            " + ".join(said.called(name) for name in tried.names),
            " + ".join(said.called(name) for name in tried.beside) or "–",
            words.error(si, tried.error),
            units.significant(tried.evidence, 3) if tried.evidence > 0 else "none",
            tried.outcome.replace("_", " "),
        ]
        for tried in found.candidates
    ]
    caption = "Error of the runs kept apart; evidence in multiples of what chance gives the best of the catalogue"
    return Table(["effect", "beside", "rms error", "evidence", "outcome"], rows, caption)


def document(found: Diagnosis, tellings: Sequence[Telling]) -> Document:
    """Write the report of a diagnosis.

    Parameters
    ----------
    found
        The diagnosis.
    tellings
        For its groups the experiments that would tell them apart.
    """
    name, axis = found.before.title or found.before.name, found.before.axes[found.axis]
    before, after = compared(found, "calibrated"), compared(found, "found")
    changed = found.verdict != "nothing-missing" and len(found.ladder) > 2
    stands = [("recalibrated", before), (_stand_name(found), after)] if changed else [("recalibrated", before)]
    names = [named.name for named in found.effects] or list(found.near)
    kinds, bars = pictures(names), ladder_figure(found, found.ladder, found.noise_floor)
    sections = [
        Section("The error ladder", _ladder_text(found), [ladder_of(found)], [bars]),
        Section("Where it fails", where_text(stands), [], where_figures(stands, kinds[:2])),
        Section("Measured and predicted", _runs_text(found), [], run_figures(stands)),
        *(_effect(named) for named in found.effects),
        Section("What was tried", _tried_text(found), [candidates(found)] if found.candidates else []),
        *_apart(found, tellings),
        *_left(found),
        Section("The model's own numbers", _numbers_text(found), [numbers_table(axis, found.calibration)]),
        Section("Noise", noise_text(found.noise, found.noise_floor, said.response(found))),
        Section("More pictures of what is left", [], [], where_figures(stands, kinds[2:], shares=False), folded=True),
        Section("How it was done", _how(found)),
    ]
    return Document(f"{name}: diagnosis of axis {found.axis}", said.summary(found, tellings), sections)


def result(found: Diagnosis, tellings: Sequence[Telling]) -> dict[str, Any]:
    """Return result.json's content: the verdict and everything behind it, every number with its unit."""
    si = said.response(found)
    return {
        "format": FORMAT,
        "kind": "diagnosis",
        "axis": found.axis,
        "verdict": found.verdict,
        "effects": [_named(named) for named in found.effects],
        "candidates": [_tried(tried, si) for tried in found.candidates],
        "confusable": [list(group) for group in found.confusable],
        "tell_apart": [_telling(telling) for telling in tellings],
        "near": list(found.near),
        "ladder": ladder_json(found.ladder, si),
        "noise_floor": noise_json(found.noise, found.noise_floor, si),
        "validation_error": _number(found.validation_error, si),
        "remainder": found.remainder,
        "rival": {
            "gain": found.rival.gain,
            "held_gain": found.rival.held_gain,
            "moved": _number(found.rival.moved, si),
            "terms": [
                {"name": name, "amount": _number(amount, si), "share": found.rival.shares[name]}
                for name, amount in found.rival.terms.items()
            ],
        },
        "where": where_json(found, si),
        "calibration": [value_json(value) for value in found.calibration],
        "conflicts": list(found.conflicts),
        "confidence": found.confidence,
        "made_by": made_by(found),
        "simulations": found.evaluations,
    }


# --- pieces that other reports use --------------------------------------------------------------------------------


def pictures(names: Sequence[str]) -> list[str]:
    """Return which pictures of what is left show some effects, the telling one first.

    An effect says which experiment reveals it; a step is drawn over the logarithm of time, a triangle over position, a
    multisine as a spectrum.

    >>> pictures(["creep"])[0], pictures(["coulomb_friction"])[0], pictures(["mains_hum"])[0]
    ('steps', 'position', 'spectrum')
    """
    found = [effects.find(name) for name in names]
    reveal = [effect.reveal.partition(":")[0] for effect in found]
    first = [kind for text in reveal for kind, tests in PICTURES.items() if any(speaks_of(text, t) for t in tests)]
    blocks = [face.socket for effect in found for face in effect.faces if isinstance(face, Block)]
    bends = [socket for socket in blocks if socket in (Socket.HYSTERESIS, Socket.ACTUATOR, Socket.FORCE)]
    return list(dict.fromkeys([*first, *(["position"] if bends else []), *PICTURES]))


def ladder_figure(found: Judged, rungs: Sequence[Rung], floor: float) -> Figure:
    """Draw the error ladder."""
    si = found.before.axes[found.axis].response
    small = SHOWN[si][1]
    factor = units.factor(small, si)
    steps = [drawings.Step(said.label(r), r.error / factor, words.error(si, r.error)) for r in rungs]
    drawn = drawings.ladder(steps, floor / factor, words.error(si, floor, 2), words.sign(small))
    return Figure("ladder.svg", drawn, f"Error of {said.judged_on(found.runs)}, step by step")


def run_figures(stands: Sequence[tuple[str, Comparison]]) -> list[Figure]:
    """Draw runs that no fit has seen, or the others if there are none, beside what each model predicts."""
    first = stands[0][1]
    kept = [run.name for run in first.runs if run.role == "validate"] or [run.name for run in first.runs]
    large, small = SHOWN[first.response]
    scale, factor = units.factor(large, first.response), _finer(first.response)
    labels = (f"{first.axis} [{words.sign(large)}]", f"left [{words.sign(small)}]")
    made = []
    for name in kept[:DRAWN]:
        runs = [next(run for run in stand.runs if run.name == name) for _, stand in stands]
        run = runs[0]
        there = np.logical_and.reduce([np.isfinite(each.measured) for each in runs])
        measured = run.measured[there] / scale
        predicted = [(s, each.predicted[there] / scale) for (s, _), each in zip(stands, runs, strict=True)]
        file = name.replace("/", "_").replace(":", "_")
        drawn = drawings.beside(run.time[there], measured, predicted, labels, factor)
        made.append(Figure(f"run_{file}.svg", drawn, _run_caption(stands, runs)))
    return made


def where_json(found: Judged, si: str) -> dict[str, Any]:
    """Return the shares of the unexplained error of the calibrated and of the final model."""
    both: tuple[Which, Which] = ("calibrated", "found")
    return {
        ("calibrated" if which == "calibrated" else "final"): [
            comparison_report.breakdown_json(b, si) for b in compared(found, which).where
        ]
        for which in both
    }


def ladder_json(rungs: Sequence[Rung], si: str) -> list[dict[str, Any]]:
    """Return the ladder: label and error of every step."""
    return [{"label": rung.label, "error": _number(rung.error, si)} for rung in rungs]


def noise_json(noise: NoiseFloor, floor: float, si: str) -> dict[str, Any]:
    """Return the noise floor, and where it comes from."""
    error = noise.relative_error
    return {
        **_number(floor, si),
        "known": noise.known,
        "source": noise.source,
        "relative_error": error if math.isfinite(error) else None,
        "runs": {name: _number(rms, si) for name, rms in noise.rms.items()},
        "lines": [
            {"frequency": _number(line.frequency, "Hz"), "amplitude": _number(line.amplitude, si)}
            for line in noise.lines
        ],
        "remarks": list(noise.remarks),
    }


def value_json(value: Value) -> dict[str, Any]:
    """Return a fitted number with its unit and its 95 % interval."""
    low, high = (end if math.isfinite(end) else None for end in value.interval)
    name = value.parameter.name.rpartition(".")[2]
    return {
        "name": name,
        "number": value.parameter.name,
        "value": value.value if math.isfinite(value.value) else None,
        "unit": value.parameter.si,
        "interval": [low, high],
        "text": said.quantity(value, short=True),
    }


def made_by(found: Judged) -> dict[str, Any]:
    """Return what made a result: the model, the runs with their roles, versions."""
    return {
        "model": found.before.name,
        "runs": [{"name": run.name, "role": run.role, "samples": len(run.time)} for run in found.runs],
        "versions": versions.installed(),
    }


def noise_text(noise: NoiseFloor, floor: float, si: str) -> list[str]:
    """Return where the noise floor comes from, and how well it is known."""
    value = words.error(si, floor, 2)
    if not noise.known:
        first = f"Nothing in these runs shows the noise: {value} was guessed from the quietest band. "
        first += "Record some seconds in which nothing moves."
    else:
        error = words.percent(noise.relative_error)
        known = f", known to {error} (one standard error)" if math.isfinite(noise.relative_error) else ""
        first = f"{value} rms, from {noise.source}{known}."
    remarks = [f"{remark[:1].upper()}{remark[1:]}." for remark in noise.remarks]
    if noise.lines:
        lines = [f"{line.frequency:.4g} Hz ({words.error(si, line.amplitude, 2)})" for line in noise.lines]
        remarks.insert(0, f"Where it should be quiet, the response swings at {words.listed(lines)}; this is no noise.")
    return [first, *remarks]


def values_table(values: Sequence[Value]) -> Table:
    """Return fitted numbers with their intervals and what they mean."""
    rows = []
    for value in values:
        estimate = said.estimated(value)
        name = value.parameter.name.rpartition(".")[2]
        rows.append([name, value.parameter.meaning, estimate.value_text, estimate.interval_text])
    return Table(["number", "what it is", "value", "95 % interval"], rows)


# --- sections -----------------------------------------------------------------------------------------------------


def _stand_name(found: Diagnosis) -> str:
    names = [said.called(named.name) for named in found.effects] or [said.called(name) for name in found.near]
    return f"with {words.listed(names)}"


def _ladder_text(found: Diagnosis) -> list[str]:
    runs = said.judged_on(found.runs)
    return [
        f"Each bar is the error of {runs}. As designed: nothing is fitted but how each record began. Recalibrated: the "
        "model's own numbers are fitted, each within what was known of it. Then effects are added while they earn "
        "their place."
    ]


def where_text(stands: Sequence[tuple[str, Comparison]]) -> list[str]:
    """Return where each model fails, in a few sentences."""
    text = []
    for name, stand in stands:
        if stand.rms < comparison_report.NOISE * stand.floor:
            text.append(f"{_capital(name)}: nothing above the noise.")
        else:
            text.append(f"{_capital(name)}: {' '.join(words.sentences(stand))}")
    return text


def where_figures(
    stands: Sequence[tuple[str, Comparison]], kinds: Sequence[str], *, shares: bool = True
) -> list[Figure]:
    """Draw what models leave in some kinds of pictures, and where the error of the first one lies."""
    made = []
    for kind in kinds:
        for k, (name, stand) in enumerate(stands):
            figure = _picture(kind, stand, name, "after" if k else "before")
            made += [figure] if figure else []
        made += _loops(stands) if kind == "position" else []
    if shares:
        name, stand = stands[0]
        made.append(Figure("shares.svg", charts.shares(_bars(stand)), f"{_capital(name)}. {SHOWS['shares']}"))
    return made


def _picture(kind: str, stand: Comparison, name: str, suffix: str) -> Figure | None:
    """Draw one kind of picture of what a model leaves; None where the runs have nothing for it."""
    large, small = (words.sign(unit) for unit in SHOWN[stand.response])
    traces, factor = [_trace(stand, run) for run in stand.runs], _finer(stand.response)
    drawn: bytes | None
    if kind == "steps":
        drawn = charts.since_step(traces, small, factor)
    elif kind == "position":
        drawn = charts.over_position(traces, large, small, factor)
    else:
        scale = units.factor(SHOWN[stand.response][0], stand.response)
        frequencies = charts.octaves(traces)
        noise = [
            np.where(frequencies <= 0.5 / run.period, stand.noise.density(run, frequencies) / scale**2, np.nan)
            for run in stand.observed
        ]
        mode = stand.model.axes[stand.axis].natural_frequency
        drawn = charts.spectrum(traces, noise, frequencies, large, mode)
    return Figure(f"{kind}_{suffix}.svg", drawn, f"{_capital(name)}. {SHOWS[kind]}") if drawn else None


def _loops(stands: Sequence[tuple[str, Comparison]]) -> list[Figure]:
    """Draw what models leave of the first slow run over its command; none if no run is slow."""
    first = stands[0][1]
    frequency = first.model.axes[first.axis].natural_frequency
    slow = next((run.name for run in first.runs if comparison_report.shows_a_loop(run, frequency)), None)
    if slow is None:
        return []
    runs = [next(run for run in stand.runs if run.name == slow) for _, stand in stands]
    there = np.logical_and.reduce([np.isfinite(run.measured) for run in runs]) & _last_turns(runs[0].command)
    small = SHOWN[first.response][1]
    scale = units.factor(small, first.response)
    left = [(name, run.residual[there] / scale) for (name, _), run in zip(stands, runs, strict=True)]
    drawn = drawings.loop(runs[0].command[there], left, f"left [{words.sign(small)}]")
    return [Figure("loop.svg", drawn, f"{slow}, its end: what is left over the command; a loop means memory")]


def _last_turns(command: Array) -> Flags:
    """Return which samples are the end of a command, over which it moves by a few times its span."""
    left = np.cumsum(np.abs(np.diff(command, append=command[-1]))[::-1])[::-1]
    return np.asarray(left <= TURNS * np.ptp(command))


def _bars(stand: Comparison) -> list[Bars]:
    return [
        Bars(
            b.by,
            [words.label(b, p) for p in b.parts],
            [p.share for p in b.parts],
            [p.weight if b.by != "frequency" else math.nan for p in b.parts],
        )
        for b in stand.where
        if b.by != "run" or len(b.parts) > 1
    ]


def _trace(stand: Comparison, run: RunComparison) -> Trace:
    scale = units.factor(SHOWN[stand.response][0], stand.response)
    period = float(run.time[-1] - run.time[0]) / (len(run.time) - 1)
    return Trace(run.name, period, run.command, run.measured / scale, run.predicted / scale, run.floor / scale)


def _runs_text(found: Diagnosis) -> list[str]:
    kept = [run for run in found.runs if run.role == "validate"]
    if not kept:
        return ["No run was kept apart, so that these runs judge what they were fitted to."]
    return ["Runs that no fit has seen; of each only how it began was fitted."]


def _run_caption(stands: Sequence[tuple[str, Comparison]], runs: Sequence[RunComparison]) -> str:
    response = stands[0][1].response
    errors = [f"{name} {words.error(response, run.rms)}" for (name, _), run in zip(stands, runs, strict=True)]
    floor = words.error(response, runs[0].floor, 2)
    return f"{runs[0].name}: what is left, rms: {', '.join(errors)}; noise {floor}"


def _effect(named: Named) -> Section:
    effect = effects.find(named.name)
    text = [
        effect.physics,
        f"Where: {effect.where}.",
        f"What to do about it: {effect.remedy}.",
        f"What reveals it: {effect.reveal}.",
        f"Reference: {effect.reference}.",
    ]
    if named.values:
        doubts = effect.cautions({v.parameter.name.rpartition(".")[2]: v.value for v in named.values})
        text += [f"Take care: {doubt}." for doubt in doubts]
    title = f"What it is: {said.called(named.name)}"
    return Section(title, text, [values_table(named.values)] if named.values else [])


def _tried_text(found: Diagnosis) -> list[str]:
    if not found.candidates:
        return ["No effect of the catalogue promised more than chance gives, so that none was fitted."]
    return [
        "Every effect of the catalogue was screened at each step by what it can explain beside the model's own "
        "numbers; these promised most and were fitted together with all else."
    ]


def _apart(found: Diagnosis, tellings: Sequence[Telling]) -> list[Section]:
    if not found.confusable:
        return []
    text = [said.apart(group, tellings) for group in found.confusable]
    pairs = [resolved for telling in tellings for resolved in telling.resolved]
    text += [
        f"Commands for the bench: flexdesign plan MODEL --resolve {' '.join(effect.name for effect in pair.effects)}"
        for pair in pairs
    ]
    tables = [_separations(pair) for pair in pairs]
    return [Section("What these runs cannot tell apart", text, tables)]


def _separations(pair: Resolved) -> Table:
    """Return the experiments that tell two effects apart best."""
    whole = plan_pages.separations(pair)
    caption = f"What tells {said.either([said.called(effect.name) for effect in pair.effects])}"
    return Table(whole.columns, whole.rows[:PROPOSED], caption)


def _left(found: Diagnosis) -> list[Section]:
    if not found.remainder and not found.rival.terms:
        return []
    si = said.response(found)
    text = [f"{_capital(found.remainder)}."] if found.remainder else ["Nothing stays above the noise."]
    rows = [
        [name, words.percent(found.rival.shares[name]), words.error(si, amount)]
        for name, amount in found.rival.terms.items()
    ]
    caption = "Smooth functions that explain most of what is left, with no physics in them"
    table = Table(["function", "of what they explain", "amount"], rows, caption)
    return [Section("What stays", text, [table] if rows else [])]


def numbers_table(axis: AxisModel, calibration: Sequence[Value]) -> Table:
    """Return the model's own numbers, before and after."""
    before = axis.numbers
    rows = []
    for value in calibration:
        p, estimate = value.parameter, said.estimated(value)
        old = before.get(p.name)
        was = "–" if old is None else units.to_text(old, p.unit, si=p.si)
        change = f"{100 * (value.value / old - 1):+.2g} %" if old else "–"
        rows.append([p.name, was, estimate.value_text, estimate.interval_text, change])
    return Table(["number", "before", "fitted", "95 % interval", "change"], rows)


def _numbers_text(found: Diagnosis) -> list[str]:
    text = ["The model's own numbers as they are with all that was found."]
    text += [f"Beyond what was known: {conflict}." for conflict in found.conflicts]
    return text


def _how(found: Diagnosis) -> list[str]:
    seen = [run.name for run in found.runs if run.role == "identify"]
    kept = [run.name for run in found.runs if run.role == "validate"]
    text = f"Fitted: {words.listed(seen)}."
    text += f" Kept apart: {words.listed(kept)}." if kept else " None was kept apart."
    made = ", ".join(f"{name} {number}" for name, number in versions.installed().items())
    return [
        text,
        "Residuals are whitened with the noise before anything is judged. Where each record began (offset, a mode that "
        "rings, slow states, where the voltage had turned, a late trigger) is free and never named.",
        f"{found.evaluations} simulations in {found.seconds:.0f} s; {made}.",
    ]


# --- result.json --------------------------------------------------------------------------------------------------


def _number(value: float, si: str) -> dict[str, Any]:
    return {"value": value if math.isfinite(value) else None, "unit": si}


def _named(named: Named) -> dict[str, Any]:
    effect = effects.find(named.name)
    return {
        "name": effect.name,
        "parameters": [value_json(value) for value in named.values],
        "share": named.share,
        "remedy": effect.remedy,
    }


def _tried(tried: Tried, si: str) -> dict[str, Any]:
    return {
        "effects": list(tried.names),
        "beside": list(tried.beside),
        "error": _number(tried.error, si),
        "evidence": tried.evidence if math.isfinite(tried.evidence) else None,
        "outcome": tried.outcome,
    }


def _telling(telling: Telling) -> dict[str, Any]:
    return {
        "group": list(telling.group),
        "pairs": [
            {
                "effects": [effect.name for effect in resolved.effects],
                "experiments": [
                    {"name": each.command.name, "by_hand": each.command.note or None, "over_noise": each.over_noise}
                    for each in resolved.proposed
                ],
            }
            for resolved in telling.resolved
        ],
        "reason": telling.reason or None,
    }


def _finer(si: str) -> float:
    """Return how many of the units for small things one for large things is."""
    large, small = SHOWN[si]
    return units.factor(large, si) / units.factor(small, si)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]

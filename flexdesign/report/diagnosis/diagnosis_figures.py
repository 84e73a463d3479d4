"""The pictures of a diagnosis: the error ladder, where a model fails before and after, and its predictions of runs."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.model import Block, Socket
from flexdesign.diagnosis import ErrorStep
from flexdesign.diagnosis.comparison import Comparison, RunComparison
from flexdesign.diagnosis.experiment_design.effect_strength import names_kind as speaks_of
from flexdesign.diagnosis.result import ModelResiduals
from flexdesign.report import comparison_text as words
from flexdesign.report.comparison_text import axis_unit
from flexdesign.report.diagnosis import comparison_report, response_pages
from flexdesign.report.diagnosis import diagnosis_charts as drawings
from flexdesign.report.diagnosis import diagnosis_text as prose
from flexdesign.report.diagnosis import residual_charts as charts
from flexdesign.report.diagnosis.residual_charts import Bars
from flexdesign.report.document import Figure, Section

Flags = NDArray[np.bool_]
#: Pictures of the residual, by the experiments that an effect says reveal it; the first is for those that say nothing.
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
#: Number of spans drawn at the end of a run over its command: two loops.
TURNS = 4
#: Runs that are drawn one by one.
DRAWN = 4


def pictures(names: Sequence[str]) -> list[str]:
    """Return which pictures of the residual show some effects, the clearest first.

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


def ladder_figure(residuals: ModelResiduals, rungs: Sequence[ErrorStep], noise_floor: float) -> Figure:
    """Draw the error ladder; the noise floor where the noise is known."""
    noise_floor = noise_floor if residuals.noise.known else 0.0
    caption = f"Error of {prose.validated_on(prose.observations(residuals))}, step by step"
    if math.isfinite(line := response_pages.line_size(residuals)):
        steps = [drawings.Step(prose.label(r), 100 * r.error / line, words.percent(r.error / line)) for r in rungs]
        chart = drawings.error_ladder(
            steps, 100 * noise_floor / line, words.percent(noise_floor / line), "% of the line"
        )
        return Figure("ladder.svg", chart, caption)
    si = prose.response(residuals)
    small = axis_unit(si, [rung.error for rung in rungs])
    factor = units.factor(small, si)
    steps = [drawings.Step(prose.label(r), r.error / factor, words.error(si, r.error)) for r in rungs]
    chart = drawings.error_ladder(steps, noise_floor / factor, words.error(si, noise_floor, 2), words.sign(small))
    return Figure("ladder.svg", chart, caption)


def where_text(stands: Sequence[tuple[str, Comparison]]) -> list[str]:
    """Return where each model fails, in a few sentences."""
    text = list[str]()
    for name, fit in stands if stands[0][1].runs else []:
        if fit.is_noise:
            text.append(f"{capital(name)}: nothing above the noise.")
        else:
            text.append(f"{capital(name)}: {' '.join(words.sentences(fit))}")
    return text


def where_figures(
    stands: Sequence[tuple[str, Comparison]], kinds: Sequence[str], *, shares: bool = True
) -> list[Figure]:
    """Draw what models leave in some kinds of pictures, and where the error of the first one lies."""
    made = list[Figure]()
    if not stands[0][1].runs:
        return made
    for kind in kinds:
        for k, (name, fit) in enumerate(stands):
            figure = _picture(kind, fit, name, "after" if k else "before")
            made += [figure] if figure else []
        made += _loops(stands) if kind == "position" else []
    if shares:
        name, fit = stands[0]
        made.append(Figure("shares.svg", charts.shares(_bars(fit)), f"{capital(name)}. {SHOWS['shares']}"))
    return made


def run_figures(stands: Sequence[tuple[str, Comparison]]) -> list[Figure]:
    """Draw validation runs, or the others if there are none, with the prediction of each model."""
    first = stands[0][1]
    validation_runs = [run.name for run in first.runs if run.role == "validate"] or [run.name for run in first.runs]
    made = []
    for name in validation_runs[:DRAWN]:
        runs = [next(run for run in fit.runs if run.name == name) for _, fit in stands]
        run = runs[0]
        there = np.logical_and.reduce([np.isfinite(each.measured) for each in runs])
        large, small = axis_unit(first.response, run.measured), axis_unit(first.response, *(r.residual for r in runs))
        scale, fine = units.factor(large, first.response), units.factor(small, first.response)
        labels = (f"{first.axis} [{words.sign(large)}]", f"residual [{words.sign(small)}]")
        measured = run.measured[there] / scale
        predicted = [(s, each.predicted[there] / scale) for (s, _), each in zip(stands, runs, strict=True)]
        chart = drawings.run_traces(run.time[there], measured, predicted, labels, scale / fine)
        made.append(Figure.of_traces(f"run_{name}.svg", chart, _run_caption(stands, runs)))
    return made


def time_domain(stands: Sequence[tuple[str, Comparison]], text: Sequence[str], kinds: Sequence[str]) -> list[Section]:
    """Return where models fail in runs in time, and their predictions; nothing without runs."""
    if not stands[0][1].runs:
        return []
    return [
        Section("Where it fails", where_text(stands), [], where_figures(stands, kinds[:2])),
        Section("Measured and predicted", list(text), [], run_figures(stands)),
    ]


def more_pictures(stands: Sequence[tuple[str, Comparison]], kinds: Sequence[str]) -> list[Section]:
    """Return the pictures that were not shown first; none without runs."""
    if not stands[0][1].runs:
        return []
    figures = where_figures(stands, kinds[2:], shares=False)
    return [Section("More pictures of the residual", [], [], figures, folded=True)]


def _run_caption(stands: Sequence[tuple[str, Comparison]], runs: Sequence[RunComparison]) -> str:
    response = stands[0][1].response
    errors = [f"{name} {words.error(response, run.rms)}" for (name, _), run in zip(stands, runs, strict=True)]
    noise_floor = words.error(response, runs[0].noise_floor, 2)
    return f"{runs[0].name}: residual, rms: {', '.join(errors)}; noise {noise_floor}"


def _picture(kind: str, fit: Comparison, name: str, suffix: str) -> Figure | None:
    """Draw one kind of picture of what a model leaves; None where the runs have nothing for it."""
    units_here = comparison_report.units_of_axes(fit)
    scale, fine = (units.factor(unit, fit.response) for unit in units_here)
    large, small = (words.sign(unit) for unit in units_here)
    traces, factor = [comparison_report.trace_of(fit, run) for run in fit.runs], scale / fine
    chart: bytes | None
    if kind == "steps":
        chart = charts.since_step(traces, small, factor)
    elif kind == "position":
        chart = charts.over_position(traces, large, small, factor)
    else:
        frequencies = charts.octaves(traces)
        noise = [
            np.where(frequencies <= 0.5 / run.period, fit.noise.density(run, frequencies) / scale**2, np.nan)
            for run in fit.observed
        ]
        mode = fit.model.axes[fit.axis].natural_frequency
        chart = charts.spectrum(traces, noise, frequencies, large, mode)
    return Figure(f"{kind}_{suffix}.svg", chart, f"{capital(name)}. {SHOWS[kind]}") if chart else None


def _loops(stands: Sequence[tuple[str, Comparison]]) -> list[Figure]:
    """Draw what models leave of the first slow run over its command; none if no run is slow."""
    first = stands[0][1]
    frequency = first.model.axes[first.axis].natural_frequency
    slow = next((run.name for run in first.runs if comparison_report.shows_a_loop(run, frequency)), None)
    if slow is None:
        return []
    runs = [next(run for run in fit.runs if run.name == slow) for _, fit in stands]
    there = np.logical_and.reduce([np.isfinite(run.measured) for run in runs]) & _last_turns(runs[0].command)
    small = axis_unit(first.response, *(run.residual[there] for run in runs))
    scale = units.factor(small, first.response)
    left = [(name, run.residual[there] / scale) for (name, _), run in zip(stands, runs, strict=True)]
    chart = drawings.loop(runs[0].command[there], left, f"residual [{words.sign(small)}]")
    caption = f"{slow}, its end: the residual over the command; a loop means memory"
    return [Figure.of_traces("loop.svg", chart, caption)]


def _last_turns(command: Array) -> Flags:
    """Return which samples are the end of a command, over which it moves by a few times its span."""
    left = np.cumsum(np.abs(np.diff(command, append=command[-1]))[::-1])[::-1]
    return np.asarray(left <= TURNS * np.ptp(command))


def _bars(fit: Comparison) -> list[Bars]:
    return [
        Bars(
            b.by,
            [words.label(b, p) for p in b.parts],
            [p.share for p in b.parts],
            [p.weight if b.by != "frequency" else math.nan for p in b.parts],
        )
        for b in fit.where
        if b.by != "run" or len(b.parts) > 1
    ]


def capital(text: str) -> str:
    """Return words with a capital in front."""
    return text[:1].upper() + text[1:]

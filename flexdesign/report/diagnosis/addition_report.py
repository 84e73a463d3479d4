"""The report of an effect that was added to a stage model: what it explains, its numbers, what it does to the loop."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np

from flexdesign import effects
from flexdesign.core import units
from flexdesign.core.serialise import header
from flexdesign.diagnosis.add_effect import AddedEffect, InTheLoop
from flexdesign.diagnosis.comparison import Comparison
from flexdesign.diagnosis.result import compare_model
from flexdesign.dynamics.axis.axis_run import doubts
from flexdesign.dynamics.experiments import AS_MODELLED
from flexdesign.dynamics.experiments.simulation import Case, Simulation
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.dynamics.trajectories import Step
from flexdesign.report import comparison_text as words
from flexdesign.report import published_rows
from flexdesign.report.comparison_text import axis_unit
from flexdesign.report.diagnosis import diagnosis_figures as figures
from flexdesign.report.diagnosis import diagnosis_report as reports
from flexdesign.report.diagnosis import diagnosis_result as results
from flexdesign.report.diagnosis import diagnosis_text as prose
from flexdesign.report.diagnosis import response_pages
from flexdesign.report.document import Document, Figure, Section, Table
from flexdesign.report.simulation import simulation_report
from flexdesign.report.traces import Curve, Traces

#: Less than this is rounding, not a length [m].
ROUNDING = 1e-12


def ladder_table(addition: AddedEffect) -> Table:
    """Return the error ladder."""
    size = response_pages.line_size(addition)
    return reports.error_ladder(
        addition.error_ladder, addition.noise, addition.noise_floor, prose.response(addition), size
    )


def summary(addition: AddedEffect) -> list[str]:
    """Return the answer in a few sentences."""
    name = prose.effect_name(addition.name)
    text = [
        f"{name[:1].upper()}{name[1:]}: {'; '.join(prose.quantity(value, short=True) for value in addition.values)}."
    ]
    if addition.reason:
        text.append(f"{words.not_added('It', addition.reason)} The model that is written has it all the same.")
    else:
        text.append(f"It explains {words.percent(addition.share)} of what recalibration leaves unexplained.")
    text.append(f"What to do about it: {prose.remedy(addition, addition.name)}.")
    return [*doubts(addition.runs), *text]


def document(addition: AddedEffect, loop: InTheLoop) -> Document:
    """Write the report of an addition.

    Parameters
    ----------
    addition
        The stage with the effect.
    loop
        What it does to a closed loop.
    """
    model = addition.before.title or addition.before.name
    title = f"{model}: {prose.effect_name(addition.name)} added to axis {addition.axis}"
    return Document(title, summary(addition), partial(_sections, addition, loop))


def _sections(addition: AddedEffect, loop: InTheLoop) -> list[Section]:
    name = prose.effect_name(addition.name)
    stands = [
        ("recalibrated", compare_model(addition, "calibrated")),
        (f"with {name}", compare_model(addition, "found")),
    ]
    kinds, axis = figures.pictures([addition.name]), addition.before.axes[addition.axis]
    return [
        Section(
            "The error ladder",
            [],
            [ladder_table(addition)],
            [figures.ladder_figure(addition, addition.error_ladder, addition.noise_floor)],
        ),
        Section(
            "Its numbers",
            _caveats(addition),
            [reports.values_table(addition.values), *reports.by_run_table(addition.by_run)],
        ),
        loop_section(addition.before, addition.axis, loop),
        *_in_time(stands, kinds),
        *response_pages.section([(n, s.responses) for n, s in stands], axis.response_units, axis.natural_frequency),
        Section("Parameters of the model", [], [reports.numbers_table(axis, addition.calibration)]),
        Section("Noise", reports.noise_text(addition.noise, addition.noise_floor, prose.response(addition))),
    ]


def _in_time(stands: list[tuple[str, Comparison]], kinds: list[str]) -> list[Section]:
    if not stands[0][1].runs:
        return []
    chart = figures.where_figures(stands, kinds[:2])
    return [
        Section("Where the model fails without it", figures.where_text(stands), [], chart),
        Section("Measured and predicted", [], [], figures.run_figures(stands)),
    ]


def result(addition: AddedEffect, loop: InTheLoop) -> dict[str, Any]:
    """Return result.json's content: every number with its unit, and what made it."""
    si = prose.response(addition)
    return {
        **header("addition"),
        "axis": addition.axis,
        "effect": {
            "name": effects.find(addition.name).name,
            "parameters": [results.value_json(value) for value in addition.values],
            "by_run": results.by_run_json(addition.by_run),
            "share": addition.share,
            "needed": not addition.reason,
            "reason": addition.reason or None,
        },
        "ladder": results.ladder_json(addition.error_ladder, si),
        "noise_floor": results.noise_json(addition.noise, addition.noise_floor, si),
        "where": results.where_json(addition, si),
        **response_pages.before_and_after(addition),
        "calibration": [results.value_json(value) for value in addition.calibration],
        "loop": loop_json(loop),
        "made_by": results.provenance(addition),
    }


def loop_table(simulation: Simulation, axis: str) -> Table:
    """Return what the effect does to a closed loop: every measure without and with it."""
    rows = []
    for without, with_it in _pairs(simulation):
        for name in simulation_report.BRIEF:
            texts = [_text(case, axis, name) for case in (without, with_it)]
            if all(texts):
                asked = without.experiment.name.partition(" ")[0]
                rows.append([f"{asked}, {without.controller}", published_rows.WORDS[name], *texts])
    caption = "The same controllers, tuned on the stage without the effect"
    return Table(["experiment", "measure", "without", "with"], rows, caption)


def _pairs(simulation: Simulation) -> list[tuple[Case, Case]]:
    """Return the cases without the effect, each with its twin."""
    twins = {(c.experiment.name, c.controller): c for c in simulation.cases if c.variant != AS_MODELLED}
    return [
        (case, twins[case.experiment.name, case.controller])
        for case in simulation.cases
        if case.variant == AS_MODELLED and (case.experiment.name, case.controller) in twins
    ]


def _text(case: Case, axis: str, name: str) -> str:
    """Return a measure of a case; empty if it has none."""
    quantity = case.measure(axis, name)
    if quantity is None:
        return "unstable" if case.response.diverged is not None else ""
    if not math.isfinite(quantity.value):
        return "never"
    return "0" if abs(quantity.value) < (ROUNDING if quantity.si == "m" else 1e-9) else quantity.formatted(3)


def loop_section(model: StageModel, axis: str, loop: InTheLoop) -> Section:
    """Return what effects do to a closed loop on an axis of a stage."""
    title = "In the loop"
    if loop.simulation is None:
        return Section(title, [f"Not simulated: {loop.reason}."])
    simulation = loop.simulation
    cautions = [f"{c.controller}, {c.variant}: {text}" for c in simulation.cases for text in c.cautions]
    skipped = [f"Not run: {s.controller} on {s.variant}: {s.reason}." for s in simulation.skipped]
    figures = [_side_by_side(model, axis, pair) for pair in _proposal(simulation, axis)]
    text = ["A step of a tenth of the stroke, and a sine of 1 Hz over most of it."]
    return Section(title, [*text, *dict.fromkeys([*skipped, *cautions])], [loop_table(simulation, axis)], figures)


def _proposal(simulation: Simulation, axis: str) -> list[tuple[Case, Case]]:
    """Return of each experiment the controller under which the effect moves the stage most."""
    chosen: dict[str, tuple[float, tuple[Case, Case]]] = {}
    for pair in _pairs(simulation):
        motions = [case.response.motion[case.row(axis)] for case in pair]
        count = min(map(len, motions))
        shift = float(np.max(np.abs(motions[1][:count] - motions[0][:count])))
        name = pair[0].experiment.name
        if name not in chosen or shift > chosen[name][0]:
            chosen[name] = shift, pair
    return [pair for _, pair in chosen.values()]


def _side_by_side(model: StageModel, axis: str, pair: tuple[Case, Case]) -> Figure:
    """Draw the motion without and with the effect, and how far each is from what was asked for."""
    si = model.axes[axis].response_units
    large = axis_unit(si, *(case.response.motion[case.row(axis)] for case in pair))
    scale, unit, first = units.factor(large, si), words.sign(large), pair[0]
    names = ("without", pair[1].variant)
    motions, errors = [], []
    for name, case in zip(names, pair, strict=True):
        row, time = case.row(axis), case.response.time
        motion, asked = case.response.motion[row], case.reference[row][: len(time)]
        motions.append(Curve(name, time, motion / scale))
        errors.append(Curve(name, time, (motion - asked) / scale))
    time = first.response.time
    motions.append(Curve("reference", time, first.reference[first.row(axis)][: len(time)] / scale, dashed=True))
    labels = [f"{axis} [{unit}]", f"motion − reference [{unit}]"]
    asked_for = first.experiment.name.partition(" ")[0]
    chart = Traces([motions, errors], "time [s]", labels, limits=_closely(first))
    caption = f"{asked_for.capitalize()} under {first.controller}, on the stage without the effect and with it"
    return Figure.of_traces(f"loop_{asked_for}.svg", chart, caption)


def _closely(case: Case) -> tuple[float, float] | None:
    """Return what part of a step is worth looking at; the whole of anything else."""
    shape = case.experiment.trajectory
    return (max(0.0, shape.wait - 0.01), shape.wait + min(shape.hold, 0.15)) if isinstance(shape, Step) else None


def loop_json(loop: InTheLoop) -> dict[str, Any] | None:
    """Return what effects do to a closed loop, as result.json has it."""
    if loop.simulation is None:
        return {"simulated": False, "reason": loop.reason}
    return {"simulated": True, "cases": simulation_report.result(loop.simulation)["cases"]}


def _caveats(addition: AddedEffect) -> list[str]:
    effect = effects.find(addition.name)
    doubts = effect.cautions({v.parameter.name.rpartition(".")[2]: v.value for v in addition.values})
    return [effect.physics, *(f"Take care: {doubt}." for doubt in doubts)]

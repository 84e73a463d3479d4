"""The report of a simulation: published numbers and ours, then every controller in every experiment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from flexdesign.core import units, versions
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.core.serialise import header, with_unit
from flexdesign.core.whole_files import written_whole
from flexdesign.dynamics.experiments import KNOWN, Experiment
from flexdesign.dynamics.experiments.reading import stem
from flexdesign.dynamics.experiments.simulation import Case, Simulation, group_by_axis, validity
from flexdesign.dynamics.stage_model import to_toml
from flexdesign.report import published_rows, render
from flexdesign.report.document import Document, Section, Table
from flexdesign.report.published_rows import ALONE, WORDS, who
from flexdesign.report.simulation import simulation_figures

#: Those that a terminal shows.
BRIEF = ("loop_width_relative", "overshoot", "settling_time", "steady_error", "max_error", "max_contour_error")

#: More experiments than this are folded.
UNFOLDED = 4


def result(simulation: Simulation) -> dict[str, Any]:
    """Return result.json's content: every measure with its unit, and what made it."""
    return {
        **header("simulation"),
        "cases": [
            {
                "experiment": case.experiment.name,
                "variant": case.variant,
                "controller": case.controller,
                "measures": {axis: list(found) for axis, found in case.measures.items()},
                "gains": {
                    axis: {
                        "kp": with_unit(pid.kp * 1e-6, "V/um"),
                        "ti": with_unit(pid.ti, "s"),
                        "td": with_unit(pid.td, "s"),
                        "weights": [pid.proportional_weight, pid.derivative_weight],
                    }
                    for axis, pid in case.pid.items()
                },
                "margins": {
                    axis: {
                        "stable": m.stable,
                        "gain_margin": m.gain_margin,
                        "phase_margin": with_unit(m.phase_margin, "deg"),
                        "delay_margin": with_unit(m.delay_margin, "s"),
                        "largest_sensitivity": m.ms,
                    }
                    for axis, m in case.margins.items()
                },
                "cautions": list(case.cautions),
                "integration": {"error": case.response.error, "steps_per_sample": case.response.substeps},
                "diverged": with_unit(case.response.diverged, "s") if case.response.diverged else None,
            }
            for case in simulation.cases
        ],
        "published": [
            {
                "experiment": case.experiment.name,
                "variant": case.variant,
                "controller": case.controller,
                "axis": c.axis,
                "measure": c.published.measure,
                "published": c.published.value,
                "uncertainty": c.published.uncertainty or None,
                "place": c.published.place,
                "note": c.published.note,
                "ours": c.ours,
            }
            for experiment in simulation.plan.experiments
            for case, c in simulation.compare_published(experiment)
        ],
        "made_by": {
            "model": simulation.model.name,
            "source": simulation.model.source,
            "stage_model": to_toml(simulation.model),
            "study": simulation.plan.name,
            "variants": {name: list(v.set) for name, v in simulation.plan.variants.items()},
            "versions": versions.installed(),
        },
    }


def document(simulation: Simulation) -> Document:
    """Write the report of a simulation."""
    title = f"{simulation.model.title or simulation.model.name}: {simulation.plan.title}"
    return Document(title, _summary(simulation), partial(_sections, simulation))


def _sections(simulation: Simulation) -> list[Section]:
    plan = simulation.plan
    tried = [_experiment(simulation, experiment) for experiment in plan.experiments]
    sections = [published_rows.section(simulation), *tried, _stage(simulation)]
    return [section for section in sections if section.tables or section.figures or section.paragraphs]


def _summary(simulation: Simulation) -> list[str]:
    cases = simulation.cases
    unstable = [case for case in cases if case.response.diverged is not None]
    answer = published_rows.agreement(simulation) or _best_tracking(simulation) or _first_found(simulation)
    count = len(simulation.plan.experiments)
    text = f"{count} experiment{'s' * (count != 1)}, {len(cases)} run{'s' * (len(cases) != 1)}"
    worst = max((case.response.error for case in cases if case.response.diverged is None), default=math.nan)
    text += f"; the largest estimated integration error is {worst:.0e} of a run's span."
    paragraphs = [answer, text, simulation.plan.note, *group_by_axis(validity(simulation.model))]
    if simulation.skipped:
        names = ", ".join(f"{s.experiment.name} ({s.controller}, {s.variant})" for s in simulation.skipped)
        paragraphs.append(f"Not run, as no controller was found: {names}.")
    if unstable:
        names = ", ".join(f"{case.experiment.name} ({case.controller}, {case.variant})" for case in unstable)
        paragraphs.append(f"Unstable: {names}.")
    return [paragraph for paragraph in paragraphs if paragraph]


def _best_tracking(simulation: Simulation) -> str:
    """Say which controller follows a reference best, and how the open loop does; nothing if nothing is followed."""
    for experiment in simulation.plan.experiments:
        axis = experiment.axes[0]
        errors = {who(case): q for case in simulation.of(experiment) if (q := case.measure(axis, "max_error"))}
        if len(errors) > 1:
            best = min(errors, key=lambda name: errors[name].value)
            rest = ", ".join(f"{_text(q)} with {name}" for name, q in errors.items() if name == "open loop" != best)
            return (
                f"{experiment.name}: the largest error of {axis} is {_text(errors[best])} with {best}"
                f"{rest and f', {rest}'}."
            )
    return ""


def _first_found(simulation: Simulation) -> str:
    """Say what the first experiment with a measure for the terminal found."""
    briefs = {each.name: _brief(simulation.of(each)) for each in simulation.plan.experiments}
    return next((f"{name}: {text}." for name, text in briefs.items() if text), "")


def digest(simulation: Simulation) -> Table:
    """Return what a terminal has room for: published numbers and ours, or what was measured."""
    table = published_rows.table(simulation)
    if table.rows:
        return Table(table.columns[:6], [row[:6] for row in table.rows])
    rows = []
    for case in simulation.cases:
        for axis in case.experiment.axes:
            found = [q for q in case.measures.get(axis, ()) if q.name in BRIEF]
            nothing = "–" if case.response.diverged is None else "unstable"
            sentences = ", ".join(f"{ALONE.get(q.name) or WORDS[q.name]} {_text(q)}" for q in found) or nothing
            rows.append([case.experiment.name, who(case), axis, sentences])
    return Table(["experiment", "run", "axis", "measured"], rows)


# --- experiments ------------------------------------------------------------------------------------------------


def _experiment(simulation: Simulation, experiment: Experiment) -> Section:
    cases = simulation.of(experiment)
    cautions = [f"Caution ({who(case)}): {text}" for case in cases for text in case.cautions]
    left = [s for s in simulation.skipped if s.experiment.name == experiment.name]
    skipped = [f"Not run: {s.controller} on {s.variant}: {s.reason}." for s in left]
    paragraphs = [text for text in (experiment.note, *dict.fromkeys(cautions), *skipped) if text]
    tables = [_measures_table(cases), _others(cases), _loops(cases)]
    title = f"{experiment.name}: {experiment.title}" if experiment.title else experiment.name
    response = simulation.model.axes[experiment.axes[0]].response_units
    figures = simulation_figures.draw(experiment, cases, response)
    folded = len(simulation.plan.experiments) > UNFOLDED
    return Section(title, paragraphs, [t for t in tables if t.rows], figures, folded=folded, brief=_brief(cases))


def _brief(cases: Sequence[Case]) -> str:
    """Say what a folded experiment found, of its first axis."""
    texts = []
    for case in cases:
        axis = case.experiment.axes[0]
        found = [
            f"{ALONE.get(q.name) or WORDS[q.name]} {_text(q)}" for q in case.measures.get(axis, ()) if q.name in BRIEF
        ]
        if found:
            texts.append(f"{who(case)}: {', '.join(found)}")
    return "; ".join(texts[:3]) + ("; …" if len(texts) > 3 else "")


def _measures_table(cases: Sequence[Case]) -> Table:
    """Return what was measured on the driven axes, a row for each run and axis."""
    if not cases:
        return Table([], [])
    driven = list(cases[0].experiment.axes)
    names = [n for n in WORDS if any(case.measure(axis, n) for case in cases for axis in [*driven, "all axes"])]
    rows = []
    for case in cases:
        for axis in [*driven, "all axes"]:
            if axis in case.measures:
                rows.append([who(case), axis, *(_text(case.measure(axis, name)) for name in names)])
        if not case.measures:
            rows.append([who(case), "", *("unstable" for _ in names)])
    caption = ""
    if "settling_time" in names and len({bool(case.pid) for case in cases}) > 1:
        caption = (
            "Overshoot and settling are relative to the final position without feedback, and to the reference with "
            "feedback"
        )
    return Table(["run", "axis", *(WORDS[name] for name in names)], rows, caption)


def _others(cases: Sequence[Case]) -> Table:
    """Return how much the axes moved that were not driven."""
    rows = []
    firsts = {
        variant: next(c for c in cases if c.variant == variant) for variant in dict.fromkeys(c.variant for c in cases)
    }
    for case in firsts.values():
        for axis, found in case.measures.items():
            if any(q.name == "coupling" for q in found):
                coupled, ratio = case.measure(axis, "coupled_motion"), case.measure(axis, "coupling")
                rows.append([who(case), axis, _text(coupled), _text(ratio)])
    return Table(["run", "axis", "motion", "per driven motion"], rows, "Motion of the axes that are not driven")


def _loops(cases: Sequence[Case]) -> Table:
    """Return gains and margins of the closed loops."""
    rows = []
    for case in cases:
        for axis, pid in case.pid.items():
            m = case.margins[axis]
            rows.append(
                [
                    who(case),
                    axis,
                    f"{units.significant(pid.kp * 1e-6, 4)} V/um",
                    units.to_text(pid.ti, "ms", 4, si="s") if math.isfinite(pid.ti) else "none",
                    units.to_text(pid.td, "ms", 4, si="s"),
                    "P, I, D" if pid.proportional_weight and pid.derivative_weight else "I",
                    units.significant(m.gain_margin, 3) if m.stable else "unstable",
                    f"{units.significant(m.phase_margin, 3)} deg" if m.stable else "",
                    units.significant(m.ms, 3) if m.stable else "",
                ]
            )
    head = ["run", "axis", "Kp", "Ti", "Td", "reference enters", "gain margin", "phase margin", "Ms"]
    caption = "Closed loops: gains, and margins of the sampled loop at the stage's secant gain"
    if any(pid.kp < 0 < pid.kp / pid.ti for case in cases for pid in case.pid.values()):
        caption += (
            ". A negative Kp compensates the in-phase part of the sampled derivative; Kp/Ti and Kp Td are positive"
        )
    return Table(head, rows, caption)


def _text(quantity: Quantity | None) -> str:
    if quantity is None:
        return ""
    if not math.isfinite(quantity.value):
        return "never"
    # What is below a picometre, or a millionth of a percent, is rounding.
    size = abs(quantity.value)
    if size < (1e-12 if quantity.si == "m" else 1e-9):
        return "0"
    return (
        units.to_text(quantity.value, "nm", 3, si="m") if quantity.si == "m" and size < 1e-8 else quantity.formatted(3)
    )


# --- what stands behind the numbers -------------------------------------------------------------------------------


def _stage(simulation: Simulation) -> Section:
    rows = [
        [
            name,
            *(
                f"{axis.numbers[key]:.6g}" if key in axis.numbers else ""
                for key in ("natural_frequency", "damping_ratio")
            ),
        ]
        for name, axis in simulation.model.axes.items()
    ]
    changes = [[name, "; ".join(v.set), v.note] for name, v in simulation.plan.variants.items()]
    made = [[name, text] for name, text in KNOWN.items()]
    made += [[name, f"PID with given gains; {c.source}"] for name, c in simulation.plan.controllers.items()]
    sources = [
        [f"{name}.{field}", text]
        for name, axis in simulation.model.axes.items()
        for field, text in axis.sources.items()
    ]
    tables = [
        Table(["axis", "natural frequency [Hz]", "damping ratio"], rows, "The stage as modelled"),
        Table(["number", "source"], sources),
        Table(["variant", "numbers changed", "note"], changes),
        Table(["controller", "what it is"], made),
        Table(["input", "value"], [[k, v] for k, v in versions.installed().items()]),
    ]
    return Section("The stage, its variants and controllers", (), [t for t in tables if t.rows], folded=True)


def write_runs(simulation: Simulation, folder: Path) -> None:
    """Write every response as a recording, sampled as the controller samples, and the stage that gave it.

    With the recordings goes ``measurements.toml``, which says that their commands were held.

    Raises
    ------
    InputError
        If the folder cannot be written.
    """
    render.prepare(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with written_whole(folder) as scratch:
            _write_runs(simulation, scratch, folder)
    except OSError as error:
        raise InputError(folder, "", None, f"cannot be written: {error.strerror}; choose another folder") from error


def _write_runs(simulation: Simulation, scratch: Path, folder: Path) -> None:
    """Write what goes to a folder into a scratch folder; paths in stage models are relative to the former."""
    from flexdesign.measurements.recordings import write_run

    tables = []
    for case in simulation.cases:
        model, response = simulation.variants[case.variant], case.response
        words = f"{case.experiment.name}, {case.controller}, {case.variant}"
        name = f"{stem(f'{case.experiment.name} {case.controller} {case.variant}')}.csv"
        every = max(1, round(1 / (model.controller.rate * response.time[1])))
        columns = {f"u{axis} [V]": response.command[row, ::every] for row, axis in enumerate(case.axes)}
        columns |= {f"{axis} [um]": response.reading[row, ::every] for row, axis in enumerate(case.axes)}
        if case.pid:
            columns |= {f"r{a} [um]": case.reference[case.row(a), : len(response.time) : every] for a in case.pid}
        write_run(scratch / name, response.time[::every], columns, comment=words)
        tables.append(f'[[run]]\nfile = "{name}"\nbetween_samples = "hold"\n')
    (scratch / "measurements.toml").write_text("\n".join(tables), encoding="utf-8")
    for name, variant in simulation.variants.items():
        (scratch / f"stage_model_{stem(name)}.toml").write_text(to_toml(variant, folder), encoding="utf-8")

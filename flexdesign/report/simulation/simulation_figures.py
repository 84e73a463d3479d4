"""Which drawings an experiment needs: loops, motion over time, errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from flexdesign.core import units
from flexdesign.dynamics.experiments import AS_MODELLED, Experiment
from flexdesign.dynamics.experiments.reading import stem
from flexdesign.dynamics.experiments.simulation import Case
from flexdesign.dynamics.trajectories import Sine, Square, Step, Triangle
from flexdesign.report import comparison_text as words
from flexdesign.report.comparison_text import axis_unit
from flexdesign.report.document import Figure
from flexdesign.report.traces import Curve, Traces


def draw(experiment: Experiment, cases: Sequence[Case], response: str) -> list[Figure]:
    """Draw the loop where there is one, and the motion over time, each variant in a drawing of its own.

    Parameters
    ----------
    experiment, cases
        The experiment and its runs.
    response
        SI unit of the motion, which may know the unit to write it in.
    """
    figures: list[Figure] = []
    for variant in dict.fromkeys(case.variant for case in cases):
        of_variant = [case for case in cases if case.variant == variant]
        motions = [case.response.motion[case.row(axis)] for case in of_variant for axis in experiment.axes]
        unit = axis_unit(response, *motions)
        words = experiment.name if variant == AS_MODELLED else f"{experiment.name} {variant}"
        name = stem(words)
        sentences = "" if variant == AS_MODELLED else f", {variant}"
        if isinstance(experiment.trajectory, (Sine, Triangle)):
            figures.append(_loop(experiment, of_variant, name, sentences, unit))
        if experiment.reference is not None or not isinstance(experiment.trajectory, (Sine, Triangle)):
            figures.append(_over_time(experiment, of_variant, name, sentences, unit))
    return figures


def _loop(experiment: Experiment, cases: Sequence[Case], name: str, sentences: str, unit: str) -> Figure:
    """Draw the motion over a command, or over a reference what is missing to it."""
    axis, scale = experiment.axes[0], units.factor(unit, "m")
    has_command = experiment.command is not None
    curves = []
    for case in cases:
        asked, motion = case.reference[case.row(axis)], case.response.motion[case.row(axis)] / scale
        asked = asked[: len(motion)]
        curve = motion if has_command else motion - asked / scale
        curves.append(Curve(case.controller, asked if has_command else asked / scale, curve))
    written = f"[{words.sign(unit)}]"
    below = "command [V]" if has_command else f"{axis} asked for {written}"
    label = f"{axis} {written}" if has_command else f"motion − reference {written}"
    what = f"Motion of {axis} over its command" if has_command else f"Error of {axis} over its reference"
    return Figure.of_traces(f"{name}_loop.svg", Traces([curves], below, [label], height=3.4), f"{what}{sentences}")


def _over_time(experiment: Experiment, cases: Sequence[Case], name: str, sentences: str, unit: str) -> Figure:
    """Draw motion, and error or the other axes, over time; steps close up."""
    axis, limits = experiment.axes[0], _time_window(experiment)
    first, scale, away = cases[0], units.factor(unit, "m"), f"motion − reference [{words.sign(unit)}]"
    motions = [Curve(c.controller, c.response.time, c.response.motion[c.row(axis)] / scale) for c in cases]
    rows, labels = [motions], [f"{axis} [{words.sign(unit)}]"]
    if experiment.reference is not None:
        reference = first.reference[first.row(axis)][: len(first.response.time)] / scale
        rows[0].append(Curve("reference", first.response.time, reference, dashed=True))
    if len(experiment.axes) > 1:
        motions[:] = [
            Curve(name, first.response.time, first.response.motion[first.row(name)] / scale) for name in experiment.axes
        ]
        every = [(case, name) for case in cases for name in experiment.axes]
        errors = [replace(_error(case, name, scale), label=f"{name}, {case.controller}") for case, name in every]
        chart = Traces([motions, errors], "time [s]", [f"motion [{words.sign(unit)}]", away])
        return Figure.of_traces(f"{name}_time.svg", chart, f"Motion ({first.controller}) and errors{sentences}")
    others = [name for name in first.axes if name not in experiment.axes]
    if len(cases) == 1 and len(experiment.axes) == 1 and others:
        rows.append([Curve(n, first.response.time, first.response.motion[first.row(n)] / scale) for n in others])
        labels.append(f"other axes [{words.sign(unit)}]")
    elif experiment.reference is not None and limits is None:
        rows.append([_error(case, axis, scale) for case in cases])
        labels.append(away)
    chart = Traces(rows, "time [s]", labels, limits=limits)
    return Figure.of_traces(f"{name}_time.svg", chart, f"Motion of {axis}{sentences}")


def _error(case: Case, axis: str, scale: float) -> Curve:
    row, time = case.row(axis), case.response.time
    return Curve(case.controller, time, (case.response.motion[row] - case.reference[row][: len(time)]) / scale)


def _time_window(experiment: Experiment) -> tuple[float, float] | None:
    """Return what part of a step's record is worth looking at."""
    shape = experiment.trajectory
    if isinstance(shape, Step):
        return max(0.0, shape.wait - 0.02), shape.wait + min(shape.hold, 0.3)
    if isinstance(shape, Square):
        at = shape.rest + 0.5 / shape.frequency
        return at - 0.02, at + min(0.5 / shape.frequency, 0.3)
    return None

"""Drawings of a diagnosis: the error ladder, and runs with the model before and after."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import NamedTuple

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.report.charts import COLOURS, NARROW, NEUTRAL, below, drawing, svg
from flexdesign.report.traces import Curve, Traces, with_gaps

#: Errors that span more than this ratio are drawn over a logarithm.
DECADES = 20.0
#: Letters in a line of a step's name.
LETTERS = 24


class Step(NamedTuple):
    """One step of the ladder: its name, its error and how the error is written."""

    name: str
    error: float
    text: str


def error_ladder(steps: Sequence[Step], noise_floor: float, floor_text: str, unit: str) -> bytes:
    """Draw the errors as bars, the first model on top, and the noise floor as a line.

    Parameters
    ----------
    steps
        From the model as designed to the last effect; errors in `unit`.
    noise_floor, floor_text
        The noise floor [unit], zero where it is unknown; and how it is written.
    unit
        Of the errors.
    """
    figure, axes = drawing(NARROW, 0.42 * len(steps) + 1.2)
    errors = np.array([step.error for step in steps])
    least = min(float(errors.min()), noise_floor) if noise_floor else float(errors.min())
    # The colours that the models have in the pictures of runs, too.
    named = {"as designed": NEUTRAL, "recalibrated": COLOURS[0]}
    colours = [named.get(step.name.partition(",")[0], COLOURS[1]) for step in steps]
    places = np.arange(len(steps))
    axes.barh(places, errors, color=colours, height=0.58, alpha=0.9)
    for place, step in zip(places, steps, strict=True):
        axes.annotate(
            step.text, (max(step.error, noise_floor), place), (4, 0), textcoords="offset points",
            va="center", color=NEUTRAL, fontsize=9.5,
        )  # fmt: skip
    if noise_floor:
        axes.axvline(
            noise_floor, label=f"noise floor, {floor_text}", color=COLOURS[2], linewidth=1.8, linestyle=(0, (5, 3))
        )
    axes.set_yticks(places, [fill(step.name, LETTERS) for step in steps])
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.set_xlabel(f"rms error [{unit}]")
    # The last tenth of the axis is for the text of the longest bar.
    if errors.max() > DECADES * least:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xlim(least / 3, 5 * float(errors.max()))
    else:
        axes.set_xlim(0, 1.25 * float(errors.max()))
    axes.grid(axis="x", color=NEUTRAL, alpha=0.25)
    axes.set_axisbelow(True)
    if noise_floor:
        below(figure, axes, 1)
    return svg(figure)


def run_traces(
    time: Array, measured: Array, predicted: Sequence[tuple[str, Array]], labels: tuple[str, str], factor: float
) -> Traces:
    """Draw a run, what models predict of it, and below what each leaves.

    Parameters
    ----------
    time, measured
        n values each; where samples are far apart, no line joins them.
    predicted
        Names of the models with n values each.
    labels
        Of both ordinates.
    factor
        How many units of the lower ordinate one of the upper is.
    """
    time, measured, *drawn = with_gaps(time, measured, *(values for _, values in predicted))
    models = [(name, values) for (name, _), values in zip(predicted, drawn, strict=True)]
    above = [Curve("measured", time, measured, dashed=True), *(Curve(name, time, values) for name, values in models)]
    left = [Curve(name, time, factor * (measured - values)) for name, values in models]
    return Traces([above, left], "time [s]", list(labels), height=2.3)


def loop(command: Array, left: Sequence[tuple[str, Array]], label: str) -> Traces:
    """Draw what models leave of a run over its command [V]: a loop means memory.

    Parameters
    ----------
    command
        n values.
    left
        Names of the models with n values each.
    label
        Of the ordinate.
    """
    return Traces([[Curve(name, command, values) for name, values in left]], "command [V]", [label], height=2.9)

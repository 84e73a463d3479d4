"""Drawings of a diagnosis: the error ladder, and runs beside the model before and after."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexdesign.report.charts import COLOURS, NEUTRAL, below, plain, svg
from flexdesign.report.traces import Curve, Traces

Array = NDArray[np.float64]
WIDTH, HEIGHT = 7.2, 3.4
#: Errors that span more than this ratio are drawn over a logarithm.
DECADES = 20.0
#: Letters in a line of a step's name, where five steps stand side by side.
LETTERS = 66


class Step(NamedTuple):
    """One step of the ladder: its name, its error and how the error is written."""

    name: str
    error: float
    text: str


def error_ladder(steps: Sequence[Step], noise_floor: float, floor_text: str, unit: str) -> bytes:
    """Draw the errors as bars that fall from step to step, and the noise floor as a line.

    Parameters
    ----------
    steps
        From the model as designed to the last effect; errors in `unit`.
    noise_floor, floor_text
        The noise floor [unit], zero where it is unknown; and how it is written.
    unit
        Of the errors.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, HEIGHT), layout="constrained")
    axes = figure.add_subplot()
    plain(axes)
    errors = np.array([step.error for step in steps])
    least = min(float(errors.min()), noise_floor) if noise_floor else float(errors.min())
    # The colours that the models have in the pictures of runs, too.
    named = {"as designed": NEUTRAL, "recalibrated": COLOURS[0]}
    colours = [named.get(step.name.partition(",")[0], COLOURS[1]) for step in steps]
    places = np.arange(len(steps))
    axes.bar(places, errors, color=colours, width=0.58, alpha=0.9)
    for place, step in zip(places, steps, strict=True):
        axes.annotate(
            step.text, (place, max(step.error, noise_floor)), (0, 4), textcoords="offset points",
            ha="center", color=NEUTRAL, fontsize=9.5,
        )  # fmt: skip
    if noise_floor:
        axes.axhline(
            noise_floor, label=f"noise floor, {floor_text}", color=COLOURS[2], linewidth=1.8, linestyle=(0, (5, 3))
        )
    wide = max(LETTERS // max(len(steps), 3), 12)
    axes.set_xticks(places, [fill(step.name, wide) for step in steps])
    axes.set_xlim(-0.55, len(steps) - 0.45)
    axes.tick_params(axis="x", length=0)
    axes.set_ylabel(f"rms error [{unit}]")
    if errors.max() > DECADES * least:
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_ylim(least / 3, 2.2 * float(errors.max()))
    else:
        axes.set_ylim(0, 1.14 * float(errors.max()))
    axes.grid(axis="y", color=NEUTRAL, alpha=0.25)
    axes.set_axisbelow(True)
    if noise_floor:
        below(figure, axes, 1)
    return svg(figure)


def beside(
    time: Array, measured: Array, predicted: Sequence[tuple[str, Array]], labels: tuple[str, str], factor: float
) -> Traces:
    """Draw a run, what models predict of it, and below what each leaves.

    Parameters
    ----------
    time, measured
        n values each; no gaps.
    predicted
        Names of the models with n values each.
    labels
        Of both ordinates.
    factor
        How many units of the lower ordinate one of the upper is.
    """
    above = [Curve("measured", time, measured, dashed=True), *(Curve(name, time, values) for name, values in predicted)]
    left = [Curve(name, time, factor * (measured - values)) for name, values in predicted]
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

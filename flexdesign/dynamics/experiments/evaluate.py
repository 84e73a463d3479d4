"""What is measured on a response, by the shape of what was asked."""

from __future__ import annotations

import math

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Quantity
from flexdesign.dynamics import metrics
from flexdesign.dynamics.experiments import Experiment
from flexdesign.dynamics.simulate import Response
from flexdesign.dynamics.trajectories import Line, Sine, Square, Staircase, Step, Triangle


def measure(
    experiment: Experiment, reference: Array, response: Response, axes: list[str], period: float, closed: bool
) -> tuple[dict[str, tuple[Quantity, ...]], list[str]]:
    """Measure each axis that was driven, and how much the others moved with it; and say what was not measured.

    Parameters
    ----------
    experiment
        What was tried.
    reference
        What was asked for at the response's samples, axes by samples.
    response
        What came of it.
    axes
        Names of the rows.
    period
        Of the response's samples [s].
    closed
        Whether the reading acted on the command: then settling and overshoot are counted around the reference,
        otherwise around where the motion comes to rest.

    Returns
    -------
    Quantities by axis, and sentences.
    """
    found: dict[str, tuple[Quantity, ...]] = {}
    remarks: list[str] = []
    if response.diverged is not None:
        return found, remarks
    for name in experiment.axes:
        row = axes.index(name)
        asked, motion = reference[row], response.motion[row]
        found[name] = (Quantity("amplitude", float(np.ptp(motion)), "m", "um"),)
        try:
            found[name] += _of_shape(experiment, asked, motion, response.time, period, closed)
        except ValueError as error:  # too short or too still for what its shape has measures for
            remarks.append(f"{name}: not measured: {error}.")
    if len(experiment.axes) == 1 and len(axes) > 1:
        driven = response.motion[axes.index(experiment.axes[0])]
        for name in axes:
            if name not in experiment.axes and np.ptp(driven) > 0:
                coupled = metrics.coupling(driven, response.motion[axes.index(name)])
                found[name] = (
                    Quantity("coupled_motion", coupled.other, "m", "um"),
                    *coupled.quantities(),
                )
    if isinstance(experiment.trajectory, Line) and experiment.reference is not None:
        rows = [axes.index(name) for name in experiment.axes]
        strayed = metrics.contour(reference[rows], response.motion[rows], period, within=0.05)
        found["all axes"] = strayed.quantities()
    return found, remarks


def _of_shape(
    experiment: Experiment, asked: Array, motion: Array, time: Array, period: float, closed: bool
) -> tuple[Quantity, ...]:
    """Return the measures that fit the shape of what was asked."""
    shape = experiment.trajectory
    measured: list[Quantity] = []
    if isinstance(shape, (Sine, Triangle)) and shape.cycles >= 1:
        looped = metrics.loop(asked, motion, period, shape.frequency).quantities()
        of_motion = ("loop_span", "loop_width", "loop_width_relative")  # over a reference the rest means nothing
        measured += [q for q in looped if experiment.command is not None or q.name in of_motion]
    if isinstance(shape, Step) or (isinstance(shape, Square) and shape.cycles >= 1):
        at = shape.rest + (shape.wait if isinstance(shape, Step) else 0.5 / shape.frequency)
        until = time[-1] if isinstance(shape, Step) else at + 0.5 / shape.frequency - 0.5 * period
        part = (time >= at - 0.25 / shape.frequency if isinstance(shape, Square) else time >= 0) & (time <= until)
        rest = motion[part][-max(1, int(0.1 * (until - at) / period)) :].mean()
        goal = float(asked[part][-1])
        target = goal if closed else float(rest)
        if not np.ptp(motion[part]) > 0:
            return ()  # cut off by limits, as the cautions say
        stepped = metrics.step_response(time[part], motion[part], target, at=at)
        measured += [q for q in stepped.quantities() if q.name != "steady_error" or closed]
        if not closed and experiment.reference is not None:
            measured.append(Quantity("steady_error", goal - float(rest), "m", "um"))
    elif isinstance(shape, Staircase) and experiment.reference is not None:
        early = math.ceil(0.05 * shape.dwell / period)  # before a feedforward that looks ahead leaves the stair
        before_jumps = np.maximum(np.flatnonzero(np.diff(asked, append=asked[-1] + 1.0)) - early, 0)
        left = (asked - motion)[before_jumps]
        measured.append(Quantity("steady_error", float(left[np.argmax(np.abs(left))]), "m", "um", "end of stairs"))
    elif experiment.reference is not None:
        measured += metrics.tracking(asked, motion, period).quantities()
    return tuple(measured)

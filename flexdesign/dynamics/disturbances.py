"""A stage in an experiment whose sensors read more than the motion of their axis: other axes, hum, drift.

What the motion of another axis adds to a reading follows from a run before. In a closed loop it moves the axis that
reads it, and that the other one in turn, by the square of a small share: a few runs settle it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import OTHER, Disturbance
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.simulate import TOLERANCE, Loop, Response, simulate
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.measurements.recordings import AXES

#: Not more runs than these: each leaves of the change before no more than the share that one axis shows of another.
MOST_RUNS = 8


def run(
    model: StageModel, loops: Mapping[str, Loop], period: float, *, delay: float = 0.0, oversampling: int = 1
) -> Response:
    """Run a stage model from rest at zero volts, with everything that its effects add to readings.

    Parameters
    ----------
    model
        The stage.
    loops, period, delay, oversampling
        As for `flexdesign.dynamics.simulate.simulate`.
    """
    stage = stages.stage(model)
    response = simulate(stage, loops, period, delay=delay, oversampling=oversampling)
    if not any(_reads_others(model, name) for name in model.axes):
        return response
    before, change = dict[str, Array](), math.inf
    for _ in range(MOST_RUNS):
        if response.diverged is not None:
            return response
        time, motion = response.time[::oversampling], response.motion[:, ::oversampling]
        there = dict(zip(model.axes, motion, strict=True))
        added = {axis.name: axis.disturbance(time, stages.with_other(axis.name, there)) for axis in stage.axes}
        disturbances = {name: np.zeros_like(time) if each is None else each for name, each in added.items()}
        change = _change(before, disturbances, float(np.max(np.ptp(motion, axis=1))))
        if change <= TOLERANCE:
            return response
        response = simulate(stage, loops, period, delay=delay, oversampling=oversampling, disturbances=disturbances)
        before = disturbances
    return replace(response, error=max(response.error, change))


def inactive_disturbances(model: StageModel, name: str) -> list[str]:
    """Return what the effects of an axis would add to its reading, did an experiment have what they need."""
    there = {each: np.zeros(0) for each in model.axes}
    remarks = []
    for effect, _ in stages.active_effects(model.axes[name]):
        lacking = stages.missing(name, effect, there)
        if lacking:
            needs = " and ".join("another axis" if column == OTHER else f"a record of {column}" for column in lacking)
            remarks.append(f"{effect.name.replace('_', ' ')} needs {needs}, which is not there: it adds nothing here.")
    return remarks


def _reads_others(model: StageModel, name: str) -> bool:
    """Tell whether effects add the motion of other axes to the reading of one."""
    others = any(each != name and each in AXES for each in model.axes)
    faces = [face for effect, _ in stages.active_effects(model.axes[name]) for face in effect.faces]
    return others and any(isinstance(face, Disturbance) and OTHER in face.columns for face in faces)


def _change(before: Mapping[str, Array], after: Mapping[str, Array], span: float) -> float:
    """Return the largest change of what is added to a reading, in shares of the largest span of motion."""
    change = max(float(np.max(np.abs(after[name] - before.get(name, 0.0)))) for name in after)
    return change / span if span else 0.0

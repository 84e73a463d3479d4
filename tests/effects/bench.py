"""One axis with effects by name, as a stage model has it, and what it reads: what the tests of effects share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.simulate import Loop, Response, Stage, simulate
from flexdesign.dynamics.stage_model import AxisModel, fields

Array = NDArray[np.float64]
PERIOD = 1e-3
SAMPLES = 200
BASE = AxisModel(118.3, 0.0242, 1e-6)
TIME = PERIOD * np.arange(SAMPLES)
#: 0.2 s: rest, a jump, two hundredths of a second of rest, then a sine of 5 Hz over the range, and one of 90 Hz on it.
COMMAND = np.where(TIME < 0.005, 0.0, 50.0 + (TIME > 0.025) * (45 * np.sin(2 * np.pi * 5 * (TIME - 0.025))))
COMMAND += (TIME > 0.1) * 5 * np.sin(2 * np.pi * 90 * (TIME - 0.1))
#: What a run holds beside command and response of the axis x.
RECORDED = {"y": 40e-6 * np.sin(2 * np.pi * 11 * TIME) + 10e-6, "T": 293.0 + 3 * TIME}

#: Values at which an effect acts on this command, where those of a fit's beginning do not.
ACTING = {"driver_slew": {"slew": 1e4}}

Values = Mapping[str, float]


def start(name: str, **others: float) -> dict[str, float]:
    """The values at which a fit of an effect begins, or at which it acts on the command; some replaced."""
    found = {p.name: p.start if p.start is not None else 0.0 for p in effects.find(name).parameters}
    return found | ACTING.get(name, {}) | others


def strengths(name: str) -> dict[str, float]:
    """The strengths of an effect, at null."""
    return {p.name: p.null for p in effects.find(name).parameters if p.null is not None}


def respond(given: Mapping[str, Values], command: Array = COMMAND, base: AxisModel = BASE, **options: Any) -> Response:
    """Run the axis with effects, those that are numbers of the stage model among them."""
    delay = 0.0
    for name, values in given.items():
        owner, _, number = fields.AXIS_FIELDS.get(name, "").rpartition(".")
        (value,) = values.values() if owner else (0.0,)
        if owner == "controller":
            delay = value
        elif owner:
            base = replace(base, **{owner: replace(getattr(base, owner), **{number: value})})
        else:
            base = replace(base, effects={**base.effects, name: values})
    time = PERIOD * np.arange(len(command))
    recorded = {name: column[: len(command)] for name, column in RECORDED.items()}
    delay += base.sensor.delay  # without a loop it makes no difference where a signal is late
    added = stages.disturbance("x", base, recorded, time)
    if added is not None:
        options["disturbances"] = {"x": added}
    options = {"between_samples": "linear", **options}
    return simulate(Stage((stages.chain("x", base),)), {"x": Loop(command)}, PERIOD, delay=delay, **options)


def reading(given: Mapping[str, Values], substeps: int = 16) -> Array:
    """What the sensor reads, at a fixed number of steps."""
    return respond(given, substeps=substeps).reading[0]

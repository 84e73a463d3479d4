"""Creep of the piezo stack: slow states, one per decade of time, that go on after a step."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects import _lag

#: Time constants at t0, 10 t0, ... : together they rise like the logarithm of time over four decades.
DECADES = 4


def time_constants(t0: float) -> list[float]:
    """Return the time constants of its states, from the shortest on [s]."""
    return [t0 * 10.0**decade for decade in range(DECADES)]


def constants(values: Values, step: float) -> tuple[float, ...]:
    """Return for each state its strength, then transition and weights to the middle and to the end of a step."""
    numbers: list[float] = []
    for tau in time_constants(values["t0"]):
        rate = 1.0 / tau
        numbers += [values["per_decade"], *_lag.to(rate, step, 0.5), *_lag.to(rate, step, 1.0)]
    return tuple(numbers)


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Let each state z follow the drive s with tau z' = s - z, and add its share."""
    for i in range(DECADES):
        k, z = 9 * i, state[i]
        out[0] += constants[k] * z
        middle = (
            constants[k + 1] * z + constants[k + 2] * path[0] + constants[k + 3] * path[1] + constants[k + 4] * path[2]
        )
        end = (
            constants[k + 5] * z + constants[k + 6] * path[0] + constants[k + 7] * path[1] + constants[k + 8] * path[2]
        )
        out[1] += constants[k] * middle
        out[2] += constants[k] * end
        state[i] = end


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> NDArray[np.complex128]:
    """Return the sum of the states' lags."""
    w = 2j * math.pi * frequency
    return np.asarray(sum(values["per_decade"] / (1.0 + w * tau) for tau in time_constants(values["t0"])))


def relaxing(values: Values) -> list[tuple[float, float]]:
    """Return the time constants of its states, and by what share of the stroke each may be from rest."""
    return [(tau, values["per_decade"]) for tau in time_constants(values["t0"])]


EFFECT = Effect(
    name="creep",
    physics=(
        "After a step the stack goes on extending in the same direction, about as much in each decade of time: domains "
        "switch late, each at its own pace."
    ),
    where="the piezo stack, between its voltage and its extension",
    reveal="a step held for a hundred seconds or more, drawn over the logarithm of time",
    remedy="feedback from a position sensor, or a creep model in the feedforward",
    remedies={
        PIEZO: "feedback from a position sensor; a charge amplifier; a creep model in the feedforward",
        "motor": "stiffer belts, tendons and polymer parts, a sensor at the load, or a creep model in the feedforward",
    },
    reference="H. Jung and D.-G. Gweon, Creep characteristics of piezoelectric actuators, Rev. Sci. Instrum. 71 (2000)",
    parameters=(
        Parameter("per_decade", "1", "", "growth per decade of time, per drive", 0.0, 0.01, (0.0, 0.2)),
        Parameter(
            "t0",
            "s",
            "s",
            "shortest of the time constants",
            None,
            0.1,
            (1e-3, 1e2),
            "log",
            screen=(0.01, 0.03, 0.1, 0.3, 1.0),
        ),
    ),
    faces=(
        Block(
            Socket.ACTUATOR,
            states=tuple(f"z{i}" for i in range(DECADES)),
            constants=constants,
            move=move,
            transfer=transfer,
            relaxing=relaxing,
        ),
    ),
    confused_with=("bouc_wen", "sensor_drift", "thermal_expansion", "structural_damping"),
    is_linear=True,
)

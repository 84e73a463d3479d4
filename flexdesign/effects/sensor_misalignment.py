"""Misaligned sensor: its line is turned against the axis, and it sees a part of another axis' motion."""

from __future__ import annotations

import math
from collections.abc import Mapping

from flexdesign.core.model import OTHER, Block, Disturbance, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float]:
    """Return the cosine of the angle."""
    return (math.cos(values["angle"]),)


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Shorten the motion by the cosine."""
    for node in range(3):
        out[node] += constants[0] * path[node]


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the cosine."""
    return math.cos(values["angle"])


def reading(values: Values, recorded: Mapping[str, Floats], time: Floats) -> Floats:
    """Return the part of the other axis' motion that lies along the sensor."""
    return math.sin(values["angle"]) * recorded[OTHER]


EFFECT = Effect(
    name="sensor_misalignment",
    physics=(
        "The sensor's line is turned against the axis of motion: it reads the cosine of the angle of this axis' "
        "motion, a little too short, and the sine of another's."
    ),
    where="the position sensor's holder and target",
    reveal="the other axis driven alone, then the sensor turned or its target exchanged: the reading changes with it",
    remedy="align the sensor by driving the other axis; or take the matrix of all sensors out of the readings",
    reference="A. J. Fleming, A review of nanometer resolution position sensors, Sens. Actuators A 190 (2013)",
    parameters=(Parameter("angle", "rad", "mrad", "between sensor and axis", 0.0, 0.01, (-0.3, 0.3)),),
    faces=(
        Block(Socket.SENSOR, mode="replace", constants=constants, move=move, transfer=transfer),
        Disturbance(reading, columns=(OTHER,)),
    ),
    confused_with=("cross_coupling", "abbe_error", "pair_mismatch"),
    is_linear=True,
)

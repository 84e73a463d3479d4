"""Resolution of the position sensor: readings come in whole steps."""

from __future__ import annotations

import math

from flexdesign.core.model import Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float]:
    """Return the step."""
    return (values["step"],)


def tick(value: float, state: Floats, constants: Floats) -> float:
    """Round a reading to the nearest step."""
    return constants[0] * math.floor(value / constants[0] + 0.5)


EFFECT = Effect(
    name="quantisation",
    physics="Sensor and converter resolve steps: smaller motions are rounded away, and the loop hunts between two.",
    where="the position sensor and its converter",
    reveal="a quiet record: readings take few values, with equal distances",
    remedy="a smaller measuring range, more bits, or averaging",
    reference="A. J. Fleming, A review of nanometer resolution position sensors, Sens. Actuators A 190 (2013)",
    parameters=(Parameter("step", "m", "um", "distance between neighbouring readings", 0.0, 1e-9, (0.0, 1e-4), "log"),),
    faces=(Block(Socket.SENSOR, constants=constants, tick=tick),),
    confused_with=(),
)

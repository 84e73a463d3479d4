"""Error of the position sensor's gain: readings are too large or too small by a constant factor."""

from __future__ import annotations

from flexdesign.core.model import Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float]:
    """Return the factor."""
    return (1.0 + values["error"],)


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Multiply the reading."""
    for node in range(3):
        out[node] += constants[0] * path[node]


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the factor."""
    return 1.0 + values["error"]


EFFECT = Effect(
    name="sensor_gain",
    physics=(
        "The sensor was calibrated with another target, distance or amplifier, so that it reads a constant factor more "
        "or less than the motion."
    ),
    where="the position sensor and its electronics",
    reveal="a second sensor, an interferometer or a known step; with one sensor alone it looks like the gain",
    remedy="calibrate against an interferometer, at the working distance and with the real target",
    reference="A. J. Fleming, A review of nanometer resolution position sensors, Sens. Actuators A 190 (2013)",
    parameters=(Parameter("error", "1", "%", "excess of the reading, relative", 0.0, 0.01, (-0.3, 0.3)),),
    faces=(Block(Socket.SENSOR, mode="replace", constants=constants, move=move, transfer=transfer),),
    confused_with=("sensor_misalignment", "stiffness_loss"),
    is_linear=True,
)

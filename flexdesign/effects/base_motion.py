"""Motion of the base: the frame vibrates, and the table swings against it."""

from __future__ import annotations

import math

from flexdesign.core.model import Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float, float, float, float]:
    """Return amplitude, angular frequency, phase and step."""
    return values["amplitude"], 2 * math.pi * values["frequency"], values["phase"], step


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Add a sine in time to the drive."""
    for node in range(3):
        time = state[0] + 0.5 * node * constants[3]
        out[node] += constants[0] * math.sin(constants[1] * time + constants[2])
    state[0] += constants[3]


EFFECT = Effect(
    name="base_motion",
    physics=(
        "Floor, pump or fan shake the frame with a frequency of their own. The table's inertia holds it back, so that "
        "it moves against the frame as if driven: by the frame's acceleration over the square of the natural frequency."
    ),
    where="the frame, through the guides, as a force on the moving mass",
    reveal="a quiet record: a line in the spectrum that an accelerometer on the frame shows too",
    remedy="isolate the frame or the source, raise the natural frequency, or feed the measured acceleration forward",
    reference="C. G. Gordon, Generic criteria for vibration-sensitive equipment, Proc. SPIE 1619 (1991)",
    parameters=(
        Parameter("amplitude", "m", "nm", "the frame's acceleration over w^2", 0.0, 1e-7, (0.0, 1e-5)),
        Parameter(
            "frequency",
            "Hz",
            "Hz",
            "frequency of the motion",
            None,
            20.0,
            (0.1, 1e4),
            "log",
            screen=(5.0, 10.0, 20.0, 30.0, 50.0, 80.0, 120.0, 200.0),
        ),
        Parameter("phase", "rad", "deg", "phase at the start", None, 0.0, (-7.0, 7.0), per_run=True),
    ),
    faces=(Block(Socket.ACTUATOR, states=("t",), constants=constants, move=move),),
    confused_with=("mains_hum", "second_mode"),
    is_linear=True,
)

"""Mains hum: the sensor's signal picks up the mains frequency."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from flexdesign.core.model import Disturbance, Effect, Parameter
from flexdesign.core.model.effect import Floats, Values


def reading(values: Values, recorded: Mapping[str, Floats], time: Floats) -> Floats:
    """Return a sine whose phase is that at the start of the record."""
    return values["amplitude"] * np.sin(2 * math.pi * values["frequency"] * (time - time[0]) + values["phase"])


EFFECT = Effect(
    name="mains_hum",
    physics=(
        "Loops between the grounds of amplifier, sensor and computer pick up the field of mains wiring: a sine of 50 "
        "or 60 Hz on the reading, with a phase that has nothing to do with the command."
    ),
    where="the cables and grounds of the position sensor",
    reveal="a quiet record: a line in the spectrum at the mains frequency, there with the amplifier off as well",
    remedy="one ground, shielded and twisted cables, a battery supply; a notch if the loop allows it",
    reference="H. W. Ott, Electromagnetic Compatibility Engineering (2009)",
    parameters=(
        Parameter("amplitude", "m", "nm", "amplitude of the reading", 0.0, 5e-8, (0.0, 1e-5)),
        Parameter(
            "frequency", "Hz", "Hz", "mains frequency", None, 50.0, (45.0, 65.0), screen=(49.9, 50.0, 50.1, 60.0)
        ),
        Parameter("phase", "rad", "deg", "phase at the start of the record", None, 0.0, (-7.0, 7.0), per_run=True),
    ),
    faces=(Disturbance(reading),),
    confused_with=("base_motion",),
    is_linear=True,
)

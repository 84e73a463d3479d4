"""Drift of the position sensor: the reading moves evenly while nothing else does."""

from __future__ import annotations

from collections.abc import Mapping

from flexdesign.core.model import Disturbance, Effect, Parameter
from flexdesign.core.model.effect import Floats, Values


def reading(values: Values, recorded: Mapping[str, Floats], time: Floats) -> Floats:
    """Return rate times the time since the record began."""
    return values["rate"] * (time - time[0])


EFFECT = Effect(
    name="sensor_drift",
    physics=(
        "The sensor's electronics warm up, or its holder creeps: readings move evenly in time, whatever the stage does."
    ),
    where="the position sensor, its electronics and its holder",
    reveal="a quiet record of some minutes: a straight line",
    remedy="let it warm up, keep the temperature, take a reference reading now and then",
    reference="A. J. Fleming, A review of nanometer resolution position sensors, Sens. Actuators A 190 (2013)",
    parameters=(Parameter("rate", "m/s", "nm/s", "change of the reading per time", 0.0, 1e-8, (-5e-6, 5e-6)),),
    faces=(Disturbance(reading),),
    confused_with=("creep", "thermal_expansion"),
    is_linear=True,
)

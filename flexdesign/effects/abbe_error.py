"""Abbe error: the sensor looks past the point of interest, and another axis turns the table."""

from __future__ import annotations

from collections.abc import Mapping

from flexdesign.core.model import OTHER, Disturbance, Effect, Parameter
from flexdesign.core.model.effect import Floats, Values


def reading(values: Values, recorded: Mapping[str, Floats], time: Floats) -> Floats:
    """Return arm times rotation, taken as proportional to the motion of another axis."""
    return values["linear"] * recorded[OTHER]


EFFECT = Effect(
    name="abbe_error",
    physics=(
        "The table turns a little as another axis moves. A sensor whose line misses the point of interest reads "
        "the offset times that rotation as motion."
    ),
    where="the sensor's place: the arm between its line and the point of interest",
    reveal="the other axis driven alone, the sensor at two distances from the point: the reading grows with the arm",
    remedy="sensors in line with the point of interest, guides that turn less, or two sensors on one axis",
    reference="J. B. Bryan, The Abbe principle revisited: an updated interpretation, Precision Engineering 1 (1979)",
    parameters=(Parameter("linear", "1", "%", "arm times rotation per other motion", 0.0, 0.01, (-0.3, 0.3)),),
    faces=(Disturbance(reading, columns=(OTHER,)),),
    confused_with=("cross_coupling", "sensor_misalignment", "pair_mismatch"),
    is_linear=True,
)

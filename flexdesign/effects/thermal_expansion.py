"""Thermal expansion: the reading follows the temperature."""

from __future__ import annotations

from collections.abc import Mapping

from flexdesign.core.model import Disturbance, Effect, Parameter
from flexdesign.core.model.effect import Floats, Values


def reading(values: Values, recorded: Mapping[str, Floats], time: Floats) -> Floats:
    """Return coefficient times the change of temperature since the record began."""
    temperature = recorded["T"]
    known = temperature[temperature == temperature]  # all but gaps
    return values["coefficient"] * (temperature - (known[0] if len(known) else 0.0))


EFFECT = Effect(
    name="thermal_expansion",
    physics=(
        "Frame, table and sensor holder expand as they warm up, each by its own length and material; what the sensor "
        "sees is the difference, in proportion to the temperature."
    ),
    where="the loop of parts from the sensor through the frame to the table",
    reveal="a long record with the temperature, through a change of a degree or more",
    remedy="one material throughout, a symmetric arrangement, a short loop, a quiet room, or the term in the model",
    reference="J. B. Bryan, International status of thermal error research, CIRP Annals 39 (1990)",
    parameters=(Parameter("coefficient", "m/K", "um/K", "reading per temperature", 0.0, 1e-6, (-1e-4, 1e-4)),),
    faces=(Disturbance(reading, columns=("T",)),),
    confused_with=("sensor_drift", "creep"),
    is_linear=True,
)

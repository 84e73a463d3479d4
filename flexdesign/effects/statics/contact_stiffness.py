"""What holds the inputs gives way."""

from __future__ import annotations

import math

from flexdesign.core.model import Adjust, Effect, Parameter
from flexdesign.core.model.effect import Values


def apply(base: Values, values: Values) -> dict[str, float]:
    """Put a compliance in series with the actuator alone, or with whatever holds the inputs."""
    where = "contact_compliance" if values.get("clamp", 1.0) else "actuator_compliance"
    return {**base, where: base[where] + 1.0 / values["stiffness"]}


EFFECT = Effect(
    name="contact_stiffness",
    physics=(
        "An actuator touches its seats in a few asperities, or through a ball: the contact, glue or clamp is "
        "in series with the stack, or with the clamp that holds the inputs in its place. Under an output force the "
        "inputs give way more than stack or clamp alone would let them. A stack softer than stated looks the same."
    ),
    where="the seats of the actuator, or the clamp of the inputs",
    reveal=("K_out with the actuator installed and with the inputs free, under two preloads: contacts stiffen"),
    remedy="more preload, lapped seats, or a ball of larger radius; state it as actuator.contact_stiffness",
    reference="K. L. Johnson, Contact Mechanics (1985)",
    parameters=(
        Parameter(
            "stiffness",
            "N/m",
            "N/um",
            "stiffness of what is in series with what holds the inputs",
            math.inf,
            1e8,
            (1e4, 1e12),
            "inverse",
        ),
        Parameter(
            "clamp",
            "1",
            "",
            "1: whatever holds the inputs; 0: the actuator alone",
            None,
            1.0,
            (0.0, 1.0),
            screen=(1, 0),
        ),
    ),
    faces=(Adjust(apply, of="part"),),
    confused_with=("base_compliance", "hinge_shear"),
)

"""The base gives way under the output force."""

from __future__ import annotations

from flexdesign.core.model import Adjust, Effect, Parameter
from flexdesign.core.model.effect import Values


def apply(base: Values, values: Values) -> dict[str, float]:
    """Let the ground move along the output."""
    return {**base, "base_compliance": base["base_compliance"] + values["compliance"]}


EFFECT = Effect(
    name="base_compliance",
    physics=(
        "The frame, its screws or the optical table move as the output is pushed: what the sensor sees is "
        "amplifier and base in series. The input does not feel it, as the actuator pushes against itself."
    ),
    where="below the amplifier",
    reveal="a second sensor on the ground block; or K_out compared with K_in, which does not change",
    remedy="a stiffer mount, or a sensor that looks from the ground block to the output",
    reference="S. T. Smith, Flexures: Elements of Elastic Mechanisms (2000)",
    parameters=(Parameter("compliance", "m/N", "um/N", "motion of the base per output force", 0.0, 1e-7, (0.0, 1e-3)),),
    faces=(Adjust(apply, of="part"),),
    confused_with=("contact_stiffness", "input_restraint"),
)

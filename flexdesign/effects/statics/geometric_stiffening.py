"""Stiffnesses under load: the arms have turned, and press or pull on the hinges."""

from __future__ import annotations

from flexdesign.core.model import Adjust, Effect, Parameter
from flexdesign.core.model.effect import Values


def apply(base: Values, values: Values) -> dict[str, float]:
    """Take stiffnesses under the actuator's force."""
    return {**base, "force": base["force"] + values["force"]}


EFFECT = Effect(
    name="geometric_stiffening",
    physics=(
        "As the actuator pushes, the arms of a convex bridge turn towards the actuator's axis: their offset falls, so "
        "that the input gets stiffer and the amplification larger, by 40 and 8 % over the stroke of a flat bridge. The "
        "arms are pressed meanwhile, which makes the output softer. Numbers taken under preload or at voltage are not "
        "those at rest."
    ),
    where="the arms and hinges, in proportion to their displacement",
    reveal="K_in or K_out at no preload and at full voltage",
    remedy="say at which force a number was taken; the stage model carries the change over the stroke",
    reference="S. P. Timoshenko and J. M. Gere, Theory of Elastic Stability (1961)",
    parameters=(Parameter("force", "N", "N", "force of the actuator as it was measured", 0.0, 5.0, (-1e3, 1e4)),),
    faces=(Adjust(apply, of="part"),),
    confused_with=("output_load", "over_cut"),
)

"""Lost stiffness: hinges thinner than drawn, a loose clamp, a softer material."""

from __future__ import annotations

import math

from flexdesign.core.model import PIEZO, Adjust, Effect, Parameter
from flexdesign.core.model.effect import Values


def apply(base: Values, values: Values) -> dict[str, float]:
    """Lower the natural frequency, raise gain and damping ratio: mass, dashpot and force per voltage stay."""
    left = 1.0 - values["ratio"]
    return {
        **base,
        "natural_frequency": base["natural_frequency"] * math.sqrt(left),
        "damping_ratio": base["damping_ratio"] / math.sqrt(left),
        "gain": base["gain"] / left,
    }


EFFECT = Effect(
    name="stiffness_loss",
    physics=(
        "The mechanism is softer than the model: hinges cut too thin, a clamp that gives, a modulus below the book's. "
        "The resonance falls, and the same force moves the table further."
    ),
    where="the hinges and clamps of the mechanism",
    reveal="a static push with a known force, and the resonance: the static stiffness falls as well",
    remedy="tighten joints and clamps, or put the measured stiffness into the model",
    remedies={
        PIEZO: "measure the hinges, tighten the clamps, or put the measured stiffness into the model",
    },
    reference="N. Lobontiu, Compliant Mechanisms: Design of Flexure Hinges (2002)",
    parameters=(Parameter("ratio", "1", "%", "stiffness lost, relative", 0.0, 0.05, (0.0, 0.9)),),
    faces=(Adjust(apply),),
    confused_with=("payload_mass",),
    is_linear=True,
)

"""A payload: more mass on the table than the model knows."""

from __future__ import annotations

import math

from flexdesign.core.model import Adjust, Effect, Parameter
from flexdesign.core.model.effect import Values


def apply(base: Values, values: Values) -> dict[str, float]:
    """Lower natural frequency and damping ratio: stiffness and dashpot stay."""
    heavier = math.sqrt(1.0 + values["ratio"])
    return {
        **base,
        "natural_frequency": base["natural_frequency"] / heavier,
        "damping_ratio": base["damping_ratio"] / heavier,
    }


EFFECT = Effect(
    name="payload_mass",
    physics=(
        "A sample, a mirror or a screw rides on the table. The resonance falls with the square root of the moving "
        "mass, and at the same dashpot the damping ratio falls as much; the static response stays."
    ),
    where="the moving table",
    reveal="a multisine with and without a known added mass, and a static push: the mass does not change the push",
    remedy="the mass in the model, and gains for the heaviest payload; a lighter sample holder",
    reference=(
        "S. Devasia, E. Eleftheriou and S. O. R. Moheimani, A survey of control issues in nanopositioning, IEEE Trans. "
        "Control Syst. Technol. 15 (2007)"
    ),
    parameters=(Parameter("ratio", "1", "%", "added mass over moving mass", 0.0, 0.05, (0.0, 3.0)),),
    faces=(Adjust(apply),),
    confused_with=("stiffness_loss",),
    is_linear=True,
)

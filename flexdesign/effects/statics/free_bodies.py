"""Table, blocks and bridges of a stage turn, and find their own place."""

from __future__ import annotations

from flexdesign.core.model import Adjust, Effect, Parameter
from flexdesign.core.model.effect import Values


def apply(base: Values, values: Values) -> dict[str, float]:
    """Let the bodies of a stage turn, and share the travel as they are held."""
    return {**base, "free_bodies": base["free_bodies"] + values["share"]}


EFFECT = Effect(
    name="free_bodies",
    physics=(
        "Formulas let table, blocks and bridges of a stage move straight, and two amplifiers in series make half the "
        "travel each. Guides and amplifiers hold the bodies with a finite stiffness: a force outside the guides' "
        "plane tilts the table, a limb that bends turns its block, and the softer of two amplifiers makes more of the "
        "travel."
    ),
    where="the bodies between the parts of a stage",
    reveal="K_out as the table is pushed at two heights; an autocollimator on the table",
    remedy="push in the guides' plane; guides farther apart; the compliance model of a stage reckons with it",
    reference="S. T. Smith, Flexures: Elements of Elastic Mechanisms (2000)",
    parameters=(Parameter("share", "1", "", "whether the bodies are free", 0.0, 1.0, (0.0, 1.0)),),
    faces=(Adjust(apply, of="part"),),
    confused_with=("out_of_plane",),
)

"""Wide leaves cannot contract sideways."""

from __future__ import annotations

from flexdesign.core.model import Adjust, Effect, Parameter
from flexdesign.core.model.effect import Values


def apply(base: Values, values: Values) -> dict[str, float]:
    """Reckon with what their width does to leaves."""
    return {**base, "constraint": base["constraint"] + values["share"]}


EFFECT = Effect(
    name="plane_strain",
    physics=(
        "What is bent or stretched would contract sideways; a leaf wide compared with its length cannot, as its "
        "roots hold it. It is stiffer by up to 1 / (1 - nu^2), 12 % for aluminium. How much depends on length "
        "over width, and on the free edges, which contract over a thickness or so."
    ),
    where="wide hinges and their roots",
    reveal="a series of widths: the stiffness per width grows",
    remedy="the compliance model reckons with it",
    reference=(
        "J. M. Gere and S. P. Timoshenko, Mechanics of Materials (1997); S. P. Timoshenko and S. "
        "Woinowsky-Krieger, Theory of Plates and Shells (1959)"
    ),
    parameters=(Parameter("share", "1", "", "how much of the constraint there is", 0.0, 1.0, (0.0, 1.5)),),
    faces=(Adjust(apply, of="part"),),
    confused_with=("modulus", "over_cut"),
)

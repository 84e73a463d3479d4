"""Rounded roots, as every wire leaves them."""

from __future__ import annotations

from dataclasses import replace

from flexdesign.core.model import Effect, Member, Parameter, Reshape
from flexdesign.core.model.effect import Values


def shape(member: Member, values: Values) -> Member:
    """Return the hinge with fillets at its roots."""
    return replace(member, root_radius=values["radius"])


EFFECT = Effect(
    name="fillet",
    physics=(
        "A wire of 0.25 mm leaves no inner corner sharper than its own radius and gap. The hinge is thicker at its "
        "ends than drawn: stiffer by 2.5 to 8 % for 0.1 to 0.3 mm on a hinge of 0.75 mm."
    ),
    where="the roots of the hinges",
    reveal="a series of hinge lengths: short hinges gain more; or a microscope",
    remedy="draw the fillet that will be there (fillet_radius), which also takes the peak off the stress",
    reference=(
        "N. Lobontiu, J. S. N. Paine, E. Garcia and M. Goldfarb, Corner-filleted flexure hinges, J. Mech. Des. 123 "
        "(2001)"
    ),
    parameters=(Parameter("radius", "m", "mm", "radius of the fillets", 0.0, 1e-4, (0.0, 1e-3)),),
    faces=(Reshape(("hinge",), shape),),
    confused_with=("modulus", "over_cut"),
)

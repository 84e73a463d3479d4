"""The sides of notches and long fillets slope."""

from __future__ import annotations

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import taper


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return what the slope of a hinge's sides adds to the beam that it is."""
    return values["share"] * taper.compliance(member, elastic)


EFFECT = Effect(
    name="sloping_sides",
    physics=(
        "Beam theory takes plane sections of a notch to stay plane, and the stress in them to run along its axis. "
        "Along sloping sides the stress must run as they do, and shears the sections: the notch is softer in rotation "
        "by about 0.4 of neck over radius, by 9 % for 0.5 mm over 2 mm."
    ),
    where="notches, and leaves whose fillets are longer than 1.2 thicknesses",
    reveal="notches of several radii and one neck: the smallest radius lacks most of its beam's stiffness",
    remedy="the compliance model reckons with it; in a formula, 1 + 0.4 t/R times the rotation",
    reference=(
        "Y. K. Yong, T.-F. Lu and D. C. Handley, Review of circular flexure hinge design equations and derivation of "
        "empirical formulations, Precis. Eng. 32 (2008), for its size; the expansion stands in "
        "flexdesign.effects.hinge_compliance.taper"
    ),
    parameters=(Parameter("share", "1", "", "how much of it the notches have", 0.0, 1.0, (0.0, 1.5)),),
    faces=(Term("hinge", compliance),),
    confused_with=("modulus", "over_cut"),
)

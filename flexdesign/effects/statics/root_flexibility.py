"""The roots of hinges and rods give way."""

from __future__ import annotations

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import roots


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return what the body at a member's roots gives way."""
    return values["share"] * roots.compliance(member, elastic)


EFFECT = Effect(
    name="root_flexibility",
    physics=(
        "A leaf does not end where it is drawn to: its stress spreads into what it runs into, which gives way as if "
        "the leaf were longer by 0.4 of its thickness at either end. Along the leaf it is more: pull spreads over the "
        "whole body, and grows with the logarithm of its depth."
    ),
    where="where hinges run into arms, rods and blocks, and rods into blocks",
    reveal="a series of hinge lengths: the stiffness falls as if each hinge were longer by the same amount",
    remedy="the compliance model reckons with it; in a formula, hinges longer by 0.83 of their thickness",
    reference=(
        "W. J. O'Donnell, The additional deflection of a cantilever due to the elasticity of the support, J. Appl. "
        "Mech. 27 (1960)"
    ),
    parameters=(Parameter("share", "1", "", "how much of it the roots have", 0.0, 1.0, (0.0, 1.5)),),
    faces=(Term("hinge", compliance), Term("rod", compliance)),
    confused_with=("over_cut", "modulus"),
)

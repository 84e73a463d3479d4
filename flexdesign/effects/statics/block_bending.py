"""The input blocks bend between the arms."""

from __future__ import annotations

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import beam


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return what half a block gives way that the actuator presses evenly on."""
    return values["share"] * beam.evenly_loaded(member, elastic)


EFFECT = Effect(
    name="block_bending",
    physics=(
        "The actuator pushes on the middle of the input block, the arms hold it at its ends: the block bends "
        "and shears in between, and turns the rods' feet."
    ),
    where="the blocks that the actuator pushes",
    reveal="K_in of two amplifiers with blocks of different depth",
    remedy="deeper input blocks; the compliance model reckons with it",
    reference="S. P. Timoshenko and J. N. Goodier, Theory of Elasticity (1970)",
    parameters=(
        Parameter("share", "1", "", "how much of a beam's bending and shear the blocks have", 0.0, 1.0, (0.0, 1.5)),
    ),
    faces=(Term("block", compliance),),
    confused_with=("rod_bending", "contact_stiffness"),
)

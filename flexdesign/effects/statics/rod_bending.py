"""The input rods' tips turn as they bend."""

from __future__ import annotations

import numpy as np

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import beam


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return what turns the tip, l/EI at the centre: the base has the tip's motion, and takes its turning for none.

    The moment that bends it is the one at its own axis: what the base has by the hinge's lever goes.
    """
    turning = beam.rotation(member, elastic)
    half = member.length / 2 * turning
    return values["share"] * np.array([[0.0, 0.0, 0.0], [half * member.lever, 0.0, half], [0.0, 0.0, turning]])


EFFECT = Effect(
    name="rod_bending",
    physics=(
        "The rod is a cantilever: force and moment at its tip move it and turn it. The paper's equations (10) "
        "to (17) have the motion and leave out the turning, which takes the hinge, and through it the output, "
        "along; with it the compliance between the ports is symmetric, as work demands."
    ),
    where="the input rods between input block and hinge",
    reveal=(
        "the input motion per output force compared with the output motion per input force: theory without it has "
        "two different ones"
    ),
    remedy="the compliance model reckons with it",
    reference="Lin et al. (2019), eqs. (10)-(15); S. P. Timoshenko, Strength of Materials (1940)",
    parameters=(
        Parameter("share", "1", "", "how much of the turning of the rods' tips there is", 0.0, 1.0, (0.0, 1.5)),
    ),
    faces=(Term("rod", compliance),),
    confused_with=("hinge_axial",),
)

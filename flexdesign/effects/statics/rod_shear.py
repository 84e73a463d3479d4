"""The input rods shear and stretch."""

from __future__ import annotations

import numpy as np

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import beam


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return stretch and shear, l/EA and l/kGA."""
    return values["share"] * np.diag([beam.stretch(member, elastic), beam.shear(member, elastic), 0.0])


EFFECT = Effect(
    name="rod_shear",
    physics=(
        "Short, thick rods shear as much as they bend: a rod three times as long as thick gives way 9 % more for it."
    ),
    where="the input rods between input block and hinge",
    reveal="K_in of two amplifiers with rods of different length",
    remedy="the compliance model reckons with it",
    reference="S. P. Timoshenko and J. N. Goodier, Theory of Elasticity (1970)",
    parameters=(Parameter("share", "1", "", "how much of l/kGA and l/EA the rods have", 0.0, 1.0, (0.0, 1.5)),),
    faces=(Term("rod", compliance),),
    confused_with=("hinge_axial", "rod_bending"),
)

"""The arms stretch."""

from __future__ import annotations

import numpy as np

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import beam


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return the stretch l/EA."""
    return values["share"] * np.diag([beam.stretch(member, elastic), 0.0, 0.0])


EFFECT = Effect(
    name="arm_axial",
    physics=(
        "The force that squeezes the arms shortens them: like the stretch of the hinges it is lost to the output."
    ),
    where="the arms between the hinges, and the stubs of single hinges",
    reveal="K_in and lambda of two amplifiers with arms of different thickness",
    remedy="thicker arms; the compliance model reckons with it",
    reference=(
        "H.-W. Ma, S.-M. Yao, L.-Q. Wang and Z. Zhong, Analysis of the displacement amplification ratio of "
        "bridge-type flexure hinge, Sens. Actuators A 132 (2006)"
    ),
    parameters=(Parameter("share", "1", "", "how much of l/EA the arms have", 0.0, 1.0, (0.0, 1.5)),),
    faces=(Term("arm", compliance), Term("stub", compliance)),
    confused_with=("hinge_axial",),
)

"""The hinges bend into an S under a force across them, and shear."""

from __future__ import annotations

import numpy as np

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import beam


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return sway and shear, l^3/12EI + l/kGA."""
    return values["share"] * np.diag([0.0, beam.sway(member, elastic) + beam.shear(member, elastic), 0.0])


EFFECT = Effect(
    name="hinge_shear",
    physics=(
        "A force across a leaf bends it into an S and shears it, so that its ends move sideways without "
        "turning. With the input free it is a small part of the output's compliance; with the input held, "
        "when rotation is blocked, a large one."
    ),
    where="the hinges",
    reveal="K_out with the input held compared with K_out with the input free",
    remedy="shorter hinges; the compliance model reckons with it",
    reference=(
        "Y. Koseki, T. Tanikawa, N. Koyachi and T. Arai, Kinematic analysis of a translational 3-d.o.f. "
        "micro-parallel mechanism using the matrix method, Adv. Robotics 16 (2002)"
    ),
    parameters=(Parameter("share", "1", "", "how much of l^3/12EI + l/kGA the hinges have", 0.0, 1.0, (0.0, 1.5)),),
    faces=(Term("hinge", compliance),),
    confused_with=("contact_stiffness", "base_compliance"),
)

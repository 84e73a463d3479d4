"""The arms bend and shear."""

from __future__ import annotations

import numpy as np

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import beam


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return what a beam between the hinges gives way but for its stretch."""
    return values["share"] * np.diag(
        [0.0, beam.sway(member, elastic) + beam.shear(member, elastic), beam.rotation(member, elastic)]
    )


EFFECT = Effect(
    name="arm_bending",
    physics=(
        "The hinges' moments bend the arms. It matters where arms are hardly thicker than hinges, or hinges short."
    ),
    where="the arms between the hinges, and the stubs of single hinges",
    reveal="K_out of two amplifiers with arms of different thickness",
    remedy="thicker arms; the compliance model reckons with it",
    reference="N. Lobontiu, Compliant Mechanisms: Design of Flexure Hinges (2002)",
    parameters=(
        Parameter("share", "1", "", "how much of a beam's bending and shear the arms have", 0.0, 1.0, (0.0, 1.5)),
    ),
    faces=(Term("arm", compliance), Term("stub", compliance)),
    confused_with=("over_cut", "modulus"),
)

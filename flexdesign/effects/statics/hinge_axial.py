"""The hinges stretch."""

from __future__ import annotations

import numpy as np

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import beam


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return the stretch l/EA."""
    return values["share"] * np.diag([beam.stretch(member, elastic), 0.0, 0.0])


EFFECT = Effect(
    name="hinge_axial",
    physics=(
        "The force that squeezes the arms passes through the hinges, and stretches or shortens them. That "
        "takes a fixed bite out of the input, while the useful part of it shrinks with the offset of the "
        "hinges: flat bridges lose most of their amplification by it."
    ),
    where="the hinges",
    reveal="K_in and lambda of two amplifiers that differ in offset; or lambda and K_out: K_out does not change",
    remedy="shorter or thicker hinges, or a larger offset; the compliance model reckons with it",
    reference=(
        "Q. Xu and Y. Li, Analytical modeling, optimization and testing of a compound bridge-type compliant "
        "displacement amplifier, Mech. Mach. Theory 46 (2011)"
    ),
    parameters=(Parameter("share", "1", "", "how much of l/EA the hinges have", 0.0, 1.0, (0.0, 1.5)),),
    faces=(Term("hinge", compliance),),
    confused_with=("arm_axial", "rod_bending"),
)

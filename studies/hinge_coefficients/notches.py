"""Notches in plane stress: planar finite elements, the Timoshenko beam, and the compliance model with sloping sides."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Elastic, Member, Notch
from flexdesign.effects.hinge_compliance import beam, taper
from studies.hinge_coefficients import planar

Array = NDArray[np.float64]
#: Shapes of half length 1, and thickness of the neck.
CASES = (
    ("circular", Notch.circular(1.0, 1.0), 0.05),
    ("circular", Notch.circular(1.0, 1.0), 0.1),
    ("circular", Notch.circular(1.0, 1.0), 0.25),
    ("circular", Notch.circular(1.0, 1.0), 0.5),
    ("elliptic, half as deep", Notch.elliptic(1.0, 0.5), 0.25),
    ("elliptic, twice as deep", Notch.elliptic(1.0, 2.0), 0.25),
    ("parabolic", Notch.parabolic(1.0, 0.5), 0.25),
    ("parabolic, as deep", Notch.parabolic(1.0, 1.0), 0.1),
    ("V of 45 deg", Notch.v(1.0, 0.85, 0.3625), 0.2),
)


def compliances(shape: Notch, neck: float) -> tuple[Array, Array, Array]:
    """Return compliances about the centre for a width and modulus of 1: as solved, of the beam, of the model."""
    elastic = Elastic(1.0, planar.POISSON)
    ends = (-shape.half_length, 0.0, 0.0), (shape.half_length, 0.0, 0.0)
    member = Member("notch", "hinge", ("a", "b"), *ends, neck, 1.0, notch=shape)
    sway = beam.sway(member, elastic) + beam.shear(member, elastic)
    beams = np.diag([beam.stretch(member, elastic), sway, beam.rotation(member, elastic)])
    return planar.notch(shape, neck), beams, beams + taper.compliance(member, elastic)

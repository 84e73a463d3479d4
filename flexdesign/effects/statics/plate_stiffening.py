"""A long leaf is a plate: near its clamped ends, where an S bends most, it cannot contract sideways."""

from __future__ import annotations

import numpy as np

from flexdesign.core.model import Effect, Elastic, Member, Parameter, Term
from flexdesign.core.model.effect import Floats, Values
from flexdesign.effects.hinge_compliance import beam, width


def compliance(member: Member, elastic: Elastic, values: Values) -> Floats:
    """Return what bending and sway of the plate are less than those of the beam with a mean modulus."""
    bent, swayed = (width.plate_modulus(member, elastic, lever) for lever in (0, 2))
    beams = width.bending_modulus(member, elastic)
    turning = beam.rotation(member, elastic) * (beams / bent - 1)
    across = beam.sway(member, elastic) * (beams / swayed - 1)
    return values["share"] * np.diag([0.0, across, turning])


EFFECT = Effect(
    name="plate_stiffening",
    physics=(
        "A leaf that bends would contract across its width, and near a clamped end it cannot. The constraint dies down "
        "over half a width. Where a leaf bends into an S its moment is largest at its ends, so that it is stiffer by "
        "more than the mean over its length: by 3 % where it is five times as long as wide, at nu = 0.3."
    ),
    where="leaves longer than wide",
    reveal="the stiffness of a parallelogram of long leaves compared with 24 EI / L^3",
    remedy="reckon with it, or take leaves that are narrow compared with their length",
    reference="S. P. Timoshenko and S. Woinowsky-Krieger, Theory of Plates and Shells (1959)",
    parameters=(Parameter("share", "1", "", "how much of the constraint there is", 0.0, 1.0, (0.0, 1.5)),),
    faces=(Term("hinge", compliance),),
    confused_with=("plane_strain", "modulus", "over_cut"),
)

"""What sloping sides add to a beam: a notch gives way more than Euler-Bernoulli theory says of its profile.

In a strip of half height h(x) the stress that balances a moment M, a force across V = dM/dx and a force along N is, to
second order in the slope q = dh/dx of its sides, that of the Airy functions

    M (y^3 / 4 h^3 - 3 y / 4 h)    and    N (y^2 / h + h) / 4,

whose sides are free of stress. Their energy per length and width is, besides what the ends of the strip have,

    1 / 2E  [ 3 M^2 / 2 h^3 (1 + 6/5 q^2)  -  6/5 (1 + nu) M V q / h^2  +  6/5 (1 + nu) V^2 / h
              +  N^2 / 2 h (1 + 2/3 q^2) ].

Without q that is a Timoshenko beam. The sides of a right-circular notch stand upright at its ends, where an expansion
in q says nothing; of functions that agree with q to second order, arsinh q is within 0.5 % of planar finite elements in
rotation, for necks of up to half the radius (``python -m studies.hinge_coefficients``). A neck of t over R is softer by
0.4 t/R in rotation, as long as it is thin.
"""

from __future__ import annotations

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Elastic, Member
from flexdesign.effects.hinge_compliance import beam, width


def compliance(member: Member, elastic: Elastic) -> Array:
    """Return what the slope of its sides adds to a notch or a long fillet, 3 by 3; zero for others."""
    if not counts(member):
        return np.zeros((3, 3))
    side = beam.sides(member)
    s, lengths, t, q = side.s, 2 * side.lengths, side.thicknesses, np.arcsinh(side.gradients)
    bending = width.bending_modulus(member, elastic) * member.width
    stretching = width.stretching_modulus(member, elastic) * member.width
    rotation = 12 * lengths @ (6 / 5 * q**2 / t**3) / bending
    sway = 12 * lengths @ (6 / 5 * s**2 * q**2 / t**3) / bending
    # 6/5 (1 + nu) / E is 3/5 G.
    between = -12 / 5 * lengths @ (s * q / t**2) / (elastic.shear_modulus * member.width)
    return np.diag([2 / 3 * lengths @ (q**2 / t) / stretching, sway + between, rotation])


def counts(member: Member) -> bool:
    """Tell whether a member has a notch, or fillets longer than those that the coefficients of roots were found for."""
    return member.profile is not None or member.root_radius > LONGEST * member.thickness


#: Longest fillet of the coefficients of roots, in thicknesses.
LONGEST = 1.2

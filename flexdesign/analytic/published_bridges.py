"""Amplification of bridges as it was published, compared with the statics that each formula approximates.

Of a quarter, between the outer end of an arm at the input and its inner end at the output, l_x along the input and l_y
along the output apart, both ends kept from turning. Published is the amplification; the stiffnesses are what the same
statics gives, derived here (`RhombicBridge`, and `flexdesign.analytic.textbook.TextbookBridge` for hinges that lie
parallel to the input).

=====================  ==================================  =============================  ===========================
function               lambda                              K_theta                        K_l
=====================  ==================================  =============================  ===========================
`parallel`             K_l l_x l_y / (4 K_theta            of a hinge parallel to the     of one hinge
                       + K_l l_y^2)                        input
`rhombic`              K_l l_x l_y / (2 K_theta cos^2 a    of a hinge along the arm       of the whole arm
                       + K_l l_y^2)
`rhombic_leaf`         K_l l_x l_y / (12 K_theta cos^2 a   E I / l of an arm that is one  of that leaf
                       + K_l l_y^2)                        leaf of length l
=====================  ==================================  =============================  ===========================

**Where they are from.** All three were seen in a public transcription of the comparison in Ling (2019), equations (19)
to (21) and (23), not in the papers that he compares. `rhombic` is often traced to Ma, Yao, Wang and Feng (2006); (20)
is the same formula rearranged, and thus a second witness. `rhombic_leaf` is probably the form of Ling, Cao, Zeng, Lin
and Inman (2016), who treat both kinds of amplifier; the transcription gives only its number in a list of references.
That program puts E I and E A over the length of the whole arm into each of them; here K_theta and K_l are what the
statics of each bridge asks for.

**What was verified, and how** (tests): `parallel` agrees with `TextbookBridge`, derived independently, and so with a
frame of beams. `RhombicBridge` agrees with a frame of beams along the arm, to rounding, in all of its compliance. Both
rhombic formulas leave out of its amplification what the arm's stretch takes from the output: they are too large by the
factor 1 / (1 - K_t / K_l), K_t = 2 K_theta / l^2 or 12 K_theta / l^2, that is by t^2 / l^2 for a leaf, exactly.

**Left out**, for want of a text, or because the text did not hold:

- Lobontiu and Garcia (2003) and Xu and Li (2011): no text of their formulas was found. What their models are made of,
  the compliances of two hinges and a rigid arm, `flexdesign.analytic.notch` and the two classes have.
- Ling (2019), equation (22): damaged in the transcription.
- Equation (24) there, for hinges parallel to the input, with the arm's own stretch: 4 K_theta K_l / K_arm more in the
  denominator of `parallel`. By statics it is 2 K_theta K_l / K_arm, for one arm stretches where two hinges do; whether
  formula, transcription or the meaning of its K_arm is at fault is unknown.
- Published numbers of amplifiers with dimensions: none were found that one of these formulas could be held against.

Sources: H.-W. Ma, S.-M. Yao, L.-Q. Wang and Z. Feng, Analysis of the displacement amplification ratio of bridge-type
flexure hinge, Sensors and Actuators A 132 (2006), 730-736. M. Ling, J. Cao, M. Zeng, J. Lin and D. J. Inman, Enhanced
mathematical modeling of the displacement amplification ratio for piezoelectric compliant mechanisms, Smart Materials
and Structures 25 (2016), 075022. M. Ling, A general two-port dynamic stiffness model and static/dynamic comparison for
three bridge-type flexure displacement amplifiers, Mechanical Systems and Signal Processing (2019). N. Lobontiu and
E. Garcia, Analytical model of displacement amplification and stiffness optimization for a class of flexure-based
compliant mechanisms, Computers and Structures 81 (2003), 2797-2810. Q. Xu and Y. Li, Analytical modeling, optimization
and testing of a compound bridge-type compliant displacement amplifier, Mechanism and Machine Theory 46 (2011), 183-200.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.analytic.notch import EndCompliance, leaf
from flexdesign.analytic.two_port import TwoPort


def parallel(rotational_stiffness: float, axial_stiffness: float, arm_span: float, arm_offset: float) -> float:
    """Return lambda of a bridge with hinges parallel to the input and a rigid arm, output free.

    K_l l_x l_y / (4 K_theta + K_l l_y^2), as Ling (2019) lists it. Neglects nothing that two hinges which turn and
    stretch, and a rigid arm, have: it is `TextbookBridge.amplification` without rods.

    Parameters
    ----------
    rotational_stiffness, axial_stiffness
        K_theta and K_l of one hinge [N m/rad, N/m].
    arm_span, arm_offset
        l_x and l_y between the hinges' centres [m]; l_y is negative for a concave bridge.

    Examples
    --------
    >>> round(parallel(3.7, 700e6 / 5, 20e-3, 1e-3), 3)
    18.088
    """
    _check(rotational_stiffness=rotational_stiffness, axial_stiffness=axial_stiffness, arm_span=arm_span)
    lever = axial_stiffness * arm_span * arm_offset
    return lever / (4 * rotational_stiffness + axial_stiffness * arm_offset**2)


def rhombic(rotational_stiffness: float, arm_stiffness: float, arm_span: float, arm_offset: float) -> float:
    """Return lambda of a rhombic bridge whose arms have a hinge at either end, output free.

    K_l l_x l_y / (2 K_theta cos^2 a + K_l l_y^2), tan a = l_y / l_x; often traced to Ma et al. (2006). Neglects how far
    the arm's stretch draws the output back, K_t / K_l of lambda with K_t = 2 K_theta / l^2, and the sway of the hinges.

    Parameters
    ----------
    rotational_stiffness
        K_theta of one hinge [N m/rad].
    arm_stiffness
        K_l of the arm, both hinges included, along its own axis [N/m].
    arm_span, arm_offset
        l_x and l_y between the hinges' centres [m]; l_y is negative for a concave bridge.
    """
    return _rhombic(2 * rotational_stiffness, arm_stiffness, arm_span, arm_offset)


def rhombic_leaf(youngs_modulus: float, width: float, thickness: float, arm_span: float, arm_offset: float) -> float:
    """Return lambda of a rhombic bridge whose arms are leaves from end to end, output free.

    K_l l_x l_y / (12 K_theta cos^2 a + K_l l_y^2) with K_theta = E I / l and K_l = E A / l; probably Ling et al.
    (2016). The leaf is clamped at both ends and bends into an S. Neglects how far its stretch draws the output back,
    t^2 / l^2 of lambda; shear, and what the leaf is clamped in.

    Parameters
    ----------
    youngs_modulus
        E [Pa]; it cancels, as the width does.
    width, thickness
        b and t of the leaf [m].
    arm_span, arm_offset
        l_x and l_y between the leaf's ends [m]; l_y is negative for a concave bridge.
    """
    length = math.hypot(arm_span, arm_offset)
    whole = leaf(youngs_modulus, width, thickness, length)
    return _rhombic(12 * whole.rotational_stiffness, whole.axial_stiffness, arm_span, arm_offset)


def _rhombic(turning: float, arm_stiffness: float, arm_span: float, arm_offset: float) -> float:
    """Return K_l l_x l_y / (turning cos^2 a + K_l l_y^2)."""
    _check(rotational_stiffness=turning, arm_stiffness=arm_stiffness, arm_span=arm_span)
    cosine = arm_span / math.hypot(arm_span, arm_offset)
    return arm_stiffness * arm_span * arm_offset / (turning * cosine**2 + arm_stiffness * arm_offset**2)


@dataclass(frozen=True)
class RhombicBridge(TwoPort):
    """Statics of a quarter whose arm and hinges lie on one line: what the rhombic formulas abridge, derived here.

    The ends of the arm do not turn: along its line it gives way by 1 / K_l, across it by 1 / K_t, and between input and
    output both of these are seen under the arm's angle. Signs as in `TextbookBridge`: the output's force and travel
    count positive inwards, as the actuator moves a convex bridge. Neglects whatever turns or gives way at the arm's
    ends. A frame of beams agrees to rounding (tests).

    Parameters
    ----------
    arm_stiffness
        K_l, force along the arm over stretch [N/m].
    sway_stiffness
        K_t, force across the arm over motion across it, both ends kept parallel [N/m].
    arm_span, arm_offset
        l_x and l_y between the points at which the ends move [m]; l_y is negative for a concave bridge.

    Examples
    --------
    >>> bridge = RhombicBridge.of_leaf(71e9, 10e-3, 1e-3, 15e-3, 2.6e-3)
    >>> round(bridge.amplification, 3), round(15 / 2.6, 3)
    (5.023, 5.769)
    """

    arm_stiffness: float
    sway_stiffness: float
    arm_span: float
    arm_offset: float

    def __post_init__(self) -> None:
        _check(arm_stiffness=self.arm_stiffness, sway_stiffness=self.sway_stiffness, arm_span=self.arm_span)

    @classmethod
    def of_hinges(cls, hinge: EndCompliance, arm_span: float, arm_offset: float) -> RhombicBridge:
        """Return the bridge with two hinges that are alike on a rigid arm.

        Parameters
        ----------
        hinge
            One of them, its sides alike, from `flexdesign.analytic.notch`.
        arm_span, arm_offset
            l_x and l_y between their centres [m].
        """
        length = math.hypot(arm_span, arm_offset)
        across = length**2 * hinge.rotation / 2 + 2 / hinge.sway_stiffness
        return cls(1 / (2 * hinge.axial), 1 / across, arm_span, arm_offset)

    @classmethod
    def of_leaf(
        cls, youngs_modulus: float, width: float, thickness: float, arm_span: float, arm_offset: float
    ) -> RhombicBridge:
        """Return the bridge whose arm is one leaf, clamped at both ends; modulus in Pa, lengths in m."""
        whole = leaf(youngs_modulus, width, thickness, math.hypot(arm_span, arm_offset))
        return cls(whole.axial_stiffness, whole.sway_stiffness, arm_span, arm_offset)

    def port_compliance(self) -> NDArray[np.float64]:
        """Compliance between input (0) and output port (1), 2 by 2 and symmetric [m/N]."""
        length = math.hypot(self.arm_span, self.arm_offset)
        c, s = self.arm_span / length, self.arm_offset / length
        along, across = 1 / self.arm_stiffness, 1 / self.sway_stiffness
        c12 = s * c * (across - along)
        return np.array([[c**2 * along + s**2 * across, c12], [c12, s**2 * along + c**2 * across]])


def _check(**sizes: float) -> None:
    """Raise a ValueError that names the first of `sizes` that is not a positive number."""
    for name, value in sizes.items():
        if not value > 0:
            raise ValueError(f"{name} must be positive (SI units), found {value!r}")

"""The textbook bridge: rigid arms between hinges that rotate, stretch and sway, in closed form.

An independent check on the pseudo-rigid-body model. What that model lacks most, at large ratios of span to
offset, is the stretch of the hinges: it takes a fixed bite out of the input while the useful part of it,
``l_y dalpha``, shrinks with the offset.

Statics of a quarter (no rod). The output is free, so the arm carries ``F_x`` alone, and the moments of its
two hinges balance it: ``2 K_theta dalpha = F_x l_y``. Kinematics: ``dy = l_x dalpha`` and ``dx = l_y dalpha +
2 F_x / K_l``, both hinges lying along x and being squeezed by ``F_x``. Hence::

    lambda = K_l l_x l_y / (4 K_theta + K_l l_y^2)
    K_in   = (l_y^2 / (2 K_theta) + 2 / K_l)^-1

This is the expression that the literature gives for bridges whose hinges are parallel to the input; it is
listed, in this form, among the formulas compared in Ling (2019), A general two-port dynamic stiffness model
and static/dynamic comparison for three bridge-type flexure displacement amplifiers, Mechanical Systems and
Signal Processing. The relative with hinges along the arm (rhombic bridge), often traced to Ma, Yao, Wang and
Feng (2006), Sensors and Actuators A 132, has ``K_l l_x l_y / (2 K_theta cos^2(alpha) + K_l l_y^2)`` with the
stretch of the whole limb as K_l.

**What was verified, and how.** The expressions are derived here, and a planar frame of Euler-Bernoulli beams
agrees with them to rounding (tests). Both forms above were seen in a public transcription of Ling's
comparison, not in the papers: no equation number is vouched for, and neither is the paper each one first
appeared in.

Two things go beyond the bare formula. *Sway*: a leaf under a transverse force bends into an S,
``K_s = 12 E I / l^3``; nothing at the input, l^2 / (3 l_x^2) of the output's compliance with a free input,
but a good part of the remainder with the input held. *Input rods* are cantilevers whose tip moves and rotates
under force and moment. Unlike in the paper's model, the rotation turns the outer hinge, and lifts it by the
lever between rod axis and hinge centre, so the compliance between the ports is symmetric by itself.

Signs are those of `flexdesign.analytic.prb`: ``l_y`` is negative for a concave bridge, and the output's force,
motion and amplification count positive inwards, as the actuator moves a convex one. Without rods a concave bridge is
the convex one with its output reversed, as ``l_y`` stands squared everywhere but in ``lambda``. With rods it is not:
their tips rotate one way in both kinds, with the arms of a convex bridge and against those of a concave one.

Left out: bending and stretch of the arms, shear, root flexibility, plane strain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.analytic.prb import leaf_rotational_stiffness
from flexdesign.analytic.two_port import TwoPort
from flexdesign.core.model import Quantity, by_key

SOURCE = "textbook bridge (hinge rotation, stretch and sway)"


@dataclass(frozen=True)
class RodFlexibility:
    """How the tip of a cantilever rod gives way; all zero for a rigid one.

    Parameters
    ----------
    force
        Deflection per force [m/N].
    cross
        Deflection per moment, and rotation per force [1/N].
    moment
        Rotation per moment [rad/(N m)].
    stretch
        Motion along the rod per force along it [m/N].
    """

    force: float = 0.0
    cross: float = 0.0
    moment: float = 0.0
    stretch: float = 0.0

    @classmethod
    def of_cantilever(cls, youngs_modulus: float, width: float, thickness: float, length: float) -> RodFlexibility:
        """Return l^3/3EI, l^2/2EI, l/EI and l/EA of an Euler-Bernoulli beam; modulus in Pa, lengths in m."""
        bending, axial = youngs_modulus * width * thickness**3 / 12, youngs_modulus * width * thickness
        return cls(length**3 / (3 * bending), length**2 / (2 * bending), length / bending, length / axial)


@dataclass(frozen=True)
class TextbookBridge(TwoPort):
    """Bridge amplifier with rigid arms, elastic hinges parallel to the input and, optionally, input rods.

    Parameters
    ----------
    rotational_stiffness
        K_theta of one hinge [N m/rad].
    axial_stiffness
        K_l of one hinge [N/m]; infinite switches the stretch off.
    arm_span, arm_offset
        l_x and l_y, between an arm's hinge centres [m]; l_y is negative for a concave bridge.
    sway_stiffness
        K_s of one hinge, transverse force over transverse motion with both ends kept parallel [N/m]; infinite
        (the bare formula) switches it off.
    rod
        Flexibility of the input rod's tip; rigid by default.
    rod_lever
        From the outer hinge's centre out to the rod's axis [m].

    Raises
    ------
    ValueError
        If a stiffness or a dimension is not positive (`arm_offset` may be negative, but not 0).

    Examples
    --------
    >>> bridge = TextbookBridge.of_leaves(70e9, 10e-3, 0.4e-3, 2e-3, 20e-3, 1e-3)
    >>> round(bridge.amplification, 3)  # l_x l_y / (l_y^2 + t^2/3) for leaves; the kinematic ratio is 20
    18.987
    """

    rotational_stiffness: float
    axial_stiffness: float
    arm_span: float
    arm_offset: float
    sway_stiffness: float = math.inf
    rod: RodFlexibility = RodFlexibility()
    rod_lever: float = 0.0

    def __post_init__(self) -> None:
        for name in ("rotational_stiffness", "axial_stiffness", "arm_span", "sway_stiffness"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, found {getattr(self, name)!r}")
        if not abs(self.arm_offset) > 0:
            raise ValueError(f"arm_offset must be positive (convex) or negative (concave), found {self.arm_offset!r}")

    @classmethod
    def of_leaves(
        cls,
        youngs_modulus: float,
        width: float,
        hinge_thickness: float,
        hinge_length: float,
        arm_span: float,
        arm_offset: float,
        rod_length: float = 0.0,
        rod_thickness: float = math.inf,
    ) -> TextbookBridge:
        """Return the bridge with rectangular leaves as hinges.

        Euler-Bernoulli: K_theta = E w t^3 / (12 l), K_l = E w t / l, K_s = 12 E I / l^3 = 12 K_theta / l^2.

        Parameters
        ----------
        youngs_modulus
            E [Pa].
        width
            w, of hinges and rods [m].
        hinge_thickness, hinge_length
            t and l [m].
        arm_span, arm_offset
            l_x and l_y [m]; l_y is negative for a concave bridge.
        rod_length, rod_thickness
            Of the input rod [m]; length 0 means no rod.
        """
        k_theta = leaf_rotational_stiffness(youngs_modulus, width, hinge_thickness, hinge_length)
        return cls(
            rotational_stiffness=k_theta,
            axial_stiffness=youngs_modulus * width * hinge_thickness / hinge_length,
            arm_span=arm_span,
            arm_offset=arm_offset,
            sway_stiffness=12 * k_theta / hinge_length**2,
            rod=RodFlexibility.of_cantilever(youngs_modulus, width, rod_thickness, rod_length),
            rod_lever=(hinge_length + rod_thickness) / 2 if rod_length > 0 else 0.0,
        )

    # --- what resists, and what drives

    @property
    def outer_stiffness(self) -> float:
        """K', the outer hinge in series with the rod tip's rotation under moment [N m/rad]."""
        return self.rotational_stiffness / (1 + self.rod.moment * self.rotational_stiffness)

    @property
    def hinge_sum(self) -> float:
        """Stiffness of an arm's two hinges against its rotation, K_theta + K' [N m/rad]."""
        return self.rotational_stiffness + self.outer_stiffness

    @property
    def input_lever(self) -> float:
        """Moment that turns the arm, per actuator force: l_y + K' b [m].

        The force bends the rod, whose tip rotates by b F_x and, through the outer hinge, takes the arm along. That
        draws the output in, whatever the sign of l_y: in a concave bridge it takes from the lever.
        """
        return self.arm_offset + self.outer_stiffness * self.rod.cross

    @property
    def output_lever(self) -> float:
        """Moment that turns the arm, per output force: l_x + K' c e [m], e being `rod_lever`."""
        return self.arm_span + self.outer_stiffness * self.rod.moment * self.rod_lever

    def _rigid_arm_compliance(self) -> tuple[float, float, float]:
        """Compliance 11, 12 and 22 that is left when the arms are kept from rotating [m/N].

        11: stretch of two hinges, and the rod's tip less what its hinge holds back, 2/K_l + a - b^2 K'.
        12: the tip's rotation b/(1 + c K_theta) under the input force lifts the hinge by its lever e.
        22: that lift under the output force's moment about the rod, the rod's stretch, sway of two hinges.
        """
        rod, e = self.rod, self.rod_lever
        loose = self.outer_stiffness / self.rotational_stiffness  # 1 / (1 + c K_theta)
        return (
            2 / self.axial_stiffness + rod.force - rod.cross**2 * self.outer_stiffness,
            rod.cross * e * loose,
            rod.moment * e**2 * loose + rod.stretch + 2 / self.sway_stiffness,
        )

    # --- between the ports

    def port_compliance(self) -> NDArray[np.float64]:
        """Compliance between input and output port, 2 by 2 and symmetric [m/N].

        Row and column 0: the actuator's force and its extension; 1: a force on the output and its travel, both
        positive inwards, as the actuator moves a convex bridge. Of a quarter and of the whole amplifier alike.
        """
        p, q, hinges = self.input_lever, self.output_lever, self.hinge_sum
        r11, r12, r22 = self._rigid_arm_compliance()
        c12 = p * q / hinges + r12
        return np.array([[p**2 / hinges + r11, c12], [c12, q**2 / hinges + r22]])

    def output_stiffness_with_input(self, actuator_stiffness: float = math.inf) -> float:
        """Output stiffness with an actuator, or by default a rigid body, between the inputs [N/m].

        The inverse of ``C22 - C12^2 / (C11 + 1/k)``. Infinite if the input is held and nothing but the
        hinges' rotation gives way.

        Parameters
        ----------
        actuator_stiffness
            k > 0, actuator force over its extension [N/m], contacts included.
        """
        # Expanded by hand: the two terms are nearly equal for a stiff bridge, and cancel but for rounding.
        p, q = self.input_lever, self.output_lever
        r11, r12, r22 = self._rigid_arm_compliance()
        r11 += 1 / actuator_stiffness
        determinant = (q**2 * r11 - 2 * p * q * r12 + p**2 * r22) / self.hinge_sum + r11 * r22 - r12**2
        c11 = p**2 / self.hinge_sum + r11
        return c11 / determinant if determinant > 0 else math.inf


def quantities(bridge: TextbookBridge, actuator_stiffness: float | None = None) -> dict[str, Quantity]:
    """Return the bridge's stiffnesses and amplification (positive inwards), by `Quantity.key`.

    Parameters
    ----------
    bridge
        The amplifier.
    actuator_stiffness
        Stiffness of an actuator in place [N/m], for ``K_out_actuator_installed``; None leaves that one out.

    Returns
    -------
    dict
        K_in and lambda with a free output, and K_out with its input free, held and, if asked for, actuator.
        An infinite stiffness is left out.
    """
    found = [
        Quantity("K_in", bridge.input_stiffness, "N/m", "N/mm", "output free", SOURCE),
        Quantity("lambda", bridge.amplification, "1", "", "output free", SOURCE),
        Quantity("K_out", bridge.output_stiffness, "N/m", "N/mm", "input free", SOURCE),
    ]
    inputs = {"input held": math.inf}
    if actuator_stiffness is not None:
        inputs["actuator installed"] = actuator_stiffness
    for boundary, stiffness in inputs.items():
        value = bridge.output_stiffness_with_input(stiffness)
        if math.isfinite(value):
            found.append(Quantity("K_out", value, "N/m", "N/mm", boundary, SOURCE))
    return by_key(found)

"""Pseudo-rigid-body model of the bridge amplifier: Lin et al. (2019), equations (1) to (17), one by one.

A quarter of the amplifier is one rigid arm between two hinges that only rotate. The hinge centres lie ``l_x``
apart along the input and ``l_y`` apart along the output; the outer hinge sits on an input rod of length
``l_1`` and thickness ``l_3``, a cantilever on the input block, along the output direction. The actuator's
force is ``F = 2 F_x``: an upper and a lower arm carry ``F_x`` each; the extension is ``2 dx_in`` and the
output travel ``2 dy``, so that stiffness and amplification of a quarter are those of the whole amplifier.

**The output load.** Equations (6), (7), (9) and (13) to (17) of the paper hold for an output that works
against a spring as stiff as the amplifier itself: its ``4 K_r`` means ``2 K_r + K_load l_x^2`` with
``K_load = K_out``. Here ``output_load`` is a parameter: 0 is a free output,
`PseudoRigidBridge.output_stiffness` gives the paper's numbers.

**The rod is not reciprocal.** The hinge moment bends the rod and so shortens the input (15), but the rod's
tip rotation, which would turn the hinge and through it the output, is left out. Hence the input motion per
output force differs from the output motion per input force, by the share `PseudoRigidBridge.reciprocity_defect`:
it is larger in a convex bridge and smaller in a concave one.
The energy-consistent counterpart, with the tip rotation, is `flexdesign.analytic.textbook`.

**Signs.** The paper writes a convex bridge: its output hinges lie farther from the actuator's axis than its input
hinges, by ``l_y > 0``, and the output is drawn in as the actuator extends. Rotation, output motion and amplification
count positive that way, inwards. A concave bridge has ``l_y < 0``, and the same equations return all three negative:
its output is pushed out. The hinge moment turns round with the rotation. It adds to what the force does to the rod in
a convex bridge and relieves the rod in a concave one, so that the coefficient of (14) has the sign of ``l_y``;
without a rod K_in and K_out are the same for either sign. Where ``l_1 < 3 |l_y| / 4`` the moment in (15), for want of
its counterpart, would give out more energy than the actuator puts in: such concave bridges are refused.

Source: Lin, Yu, Wu, Shen (2019), Decoupling and control of micromotion stage based on hysteresis of
piezoelectric actuation, Microsystem Technologies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Quantity, by_key, output_boundary

SOURCE = "Lin et al. (2019)"


def leaf_rotational_stiffness(youngs_modulus: float, width: float, thickness: float, length: float) -> float:
    """Rotational stiffness of a leaf hinge, E w t^3 / (12 l) [N m/rad].

    The end rotation of an Euler-Bernoulli beam under equal and opposite end moments is M l / (E I),
    I = w t^3 / 12. The paper uses K_r without printing a formula for it. Plane stress: a leaf much wider than
    thick is up to 1 / (1 - nu^2) stiffer.

    Parameters
    ----------
    youngs_modulus
        E [Pa].
    width, thickness, length
        w, t and l [m].
    """
    return youngs_modulus * width * thickness**3 / (12 * length)


@dataclass(frozen=True)
class PseudoRigidBridge:
    """Bridge amplifier with hinges that only rotate, rigid arms and, if `rod_length` > 0, bending input rods.

    Parameters
    ----------
    youngs_modulus
        E [Pa].
    width
        w, of hinges and rods [m].
    hinge_thickness, hinge_length
        t and l_h of the leaf hinges [m].
    arm_span, arm_offset
        l_x and l_y, between an arm's hinge centres [m]; l_y is negative for a concave bridge.
    rod_length, rod_thickness
        l_1 and l_3 of the input rod [m]; length 0 means no rod.

    Raises
    ------
    ValueError
        If a dimension or the modulus is not positive (`rod_length` may be 0, `arm_offset` negative), or if the rods
        of a concave bridge are shorter than 3 |l_y| / 4.

    Examples
    --------
    >>> bridge = PseudoRigidBridge(70e9, 10e-3, 0.4e-3, 2e-3, 20e-3, 1e-3)
    >>> round(bridge.amplification(), 6)  # without a rod the kinematic ratio l_x / l_y, free ...
    20.0
    >>> round(bridge.amplification(bridge.output_stiffness), 6)  # ... or loaded, as nothing else gives way
    20.0
    >>> concave = PseudoRigidBridge(70e9, 10e-3, 0.4e-3, 2e-3, 20e-3, -1e-3)
    >>> round(concave.amplification(), 6)  # l_y negative: the output is pushed out
    -20.0
    """

    youngs_modulus: float
    width: float
    hinge_thickness: float
    hinge_length: float
    arm_span: float
    arm_offset: float
    rod_length: float = 0.0
    rod_thickness: float = math.inf

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "arm_offset":
                if not abs(value) > 0:
                    raise ValueError(f"arm_offset must be positive (convex) or negative (concave), found {value!r}")
            elif not (value > 0 or (field.name == "rod_length" and value == 0)):
                raise ValueError(f"{field.name} must be positive, found {value!r}")
        if 0 < self.rod_length < -0.75 * self.arm_offset:
            raise ValueError(
                f"rod_length of a concave bridge must be 0 or at least 3 |l_y| / 4, found {self.rod_length!r}"
            )

    # --- stiffness of hinges and amplifier, (4)-(5)

    @property
    def hinge_stiffness(self) -> float:
        """K_r of one hinge [N m/rad]; see `leaf_rotational_stiffness`."""
        return leaf_rotational_stiffness(self.youngs_modulus, self.width, self.hinge_thickness, self.hinge_length)

    @property
    def output_stiffness(self) -> float:
        """K_out = 2 K_r / l_x^2 [N/m], input free: Lin et al. (2019), eq. (5).

        With a free input the rods carry only the hinge moment, and the rotation that it gives them is
        neglected.
        """
        return 2 * self.hinge_stiffness / self.arm_span**2

    def hinge_energy(self, quarter_force: float, output_load: float = 0.0) -> float:
        """Energy of the eight hinges, 8 K_r dalpha^2 / 2 [J]: left side of Lin et al. (2019), eq. (4)."""
        return 8 * self.hinge_stiffness * self.rotation(quarter_force, output_load) ** 2 / 2

    # --- rigid-body statics, (1)-(3), (6)-(9)

    def rotation_resistance(self, output_load: float = 0.0) -> float:
        """Stiffness against an arm's rotation, 2 K_r + K_load l_x^2 [N m/rad]: its hinges and the load.

        The paper's case K_load = K_out makes it 4 K_r.
        """
        return 2 * self.hinge_stiffness + output_load * self.arm_span**2

    def rotation(self, quarter_force: float, output_load: float = 0.0) -> float:
        """Rotation of the arm, dalpha = F_x l_y / (2 K_r + K_load l_x^2) [rad]: Lin et al. (2019), eq. (7).

        From moments on the arm (1), the hinge (2), the arm's kinematics (3) and the load (6), which is
        `output_load` in place of the paper's K_out. Positive where it draws the output in.

        Parameters
        ----------
        quarter_force
            F_x, half the actuator's force [N].
        output_load
            Stiffness of what the output pushes against, between output and ground [N/m].
        """
        return quarter_force * self.arm_offset / self.rotation_resistance(output_load)

    def hinge_moment(self, quarter_force: float, output_load: float = 0.0) -> float:
        """M = K_r dalpha [N m]: Lin et al. (2019), eq. (2)."""
        return self.hinge_stiffness * self.rotation(quarter_force, output_load)

    def output_displacement(self, quarter_force: float, output_load: float = 0.0) -> float:
        """Output displacement of a quarter, inwards, dy = l_x dalpha [m]: Lin et al. (2019), eq. (3)."""
        return self.arm_span * self.rotation(quarter_force, output_load)

    def output_force(self, quarter_force: float, output_load: float = 0.0) -> float:
        """Force of the load on a quarter, F_y = K_load dy [N]: Lin et al. (2019), eq. (6).

        The paper has K_out for K_load. Load stiffness times travel, K_load 2 dy, is shared by left and right.
        """
        force = output_load * self.output_displacement(quarter_force, output_load)
        return force + 0.0  # a free output carries 0, not -0

    def arm_input_displacement(self, quarter_force: float, output_load: float = 0.0) -> float:
        """Input displacement of the rigid arm, dx = l_y dalpha [m]: Lin et al. (2019), eq. (9).

        Positive for either sign of l_y, as the actuator extends.
        What the virtual work (8), F_x dx - F_y dy = 2 M dalpha, gives with (1) and (3).
        """
        return self.arm_offset * self.rotation(quarter_force, output_load)

    # --- bending of the input rod, (10)-(15)

    @property
    def rod_bending_stiffness(self) -> float:
        """E I of the rod, I = w l_3^3 / 12 [N m^2]."""
        return self.youngs_modulus * self.width * self.rod_thickness**3 / 12

    def moment_arm(self, output_load: float = 0.0) -> float:
        """Hinge moment per unit of F_x, l_y K_r / (2 K_r + K_load l_x^2) [m].

        l_y/4 in the paper's case, Lin et al. (2019), eq. (13); l_y/2 when the output is free. Negative in a concave
        bridge, where the moment bends the rod against F_x.
        """
        return self.arm_offset * self.hinge_stiffness / self.rotation_resistance(output_load)

    def rod_root_moment(self, quarter_force: float, output_load: float = 0.0) -> float:
        """M_o = F_x l_1 + M, at the rod's root on the input block [N m]: Lin et al. (2019), eq. (11)."""
        return quarter_force * self.rod_length + self.hinge_moment(quarter_force, output_load)

    def rod_moment(self, y: float, quarter_force: float, output_load: float = 0.0) -> float:
        """M(y) = M_o - F_x y, at `y` [m] from the rod's root [N m]: Lin et al. (2019), eqs. (12) and (13)."""
        return self.rod_root_moment(quarter_force, output_load) - quarter_force * y

    def rod_rotation(self, y: float, quarter_force: float, output_load: float = 0.0) -> float:
        """Rotation theta(y), M/(E I) integrated from the root to `y` [rad]: Lin et al. (2019), eq. (10)."""
        root_moment = self.rod_root_moment(quarter_force, output_load)
        return (root_moment * y - quarter_force * y**2 / 2) / self.rod_bending_stiffness

    def rod_coefficient(self, output_load: float = 0.0) -> float:
        """Coefficient of y^2 that stems from the hinge moment, 6 l_y K_r / (2 K_r + K_load l_x^2) [m].

        1.5 l_y in the paper's case, Lin et al. (2019), eq. (14); 3 l_y when the output is free. Negative in a
        concave bridge.
        """
        return 6 * self.moment_arm(output_load)

    def rod_deflection(self, y: float, quarter_force: float, output_load: float = 0.0) -> float:
        """Deflection of the rod along the input at `y` [m] from its root [m]: Lin et al. (2019), eq. (14).

        x(y) = F_x (6 l_1 y^2 + c y^2 - 2 y^3) / (E w l_3^3), c being `rod_coefficient`.
        """
        shape = (6 * self.rod_length + self.rod_coefficient(output_load)) * y**2 - 2 * y**3
        return quarter_force * shape / (self.youngs_modulus * self.width * self.rod_thickness**3)

    def rod_tip_deflection(self, quarter_force: float, output_load: float = 0.0) -> float:
        """dx_2 = x(l_1), what the rod takes from the input [m]: Lin et al. (2019), eq. (15)."""
        return self.rod_deflection(self.rod_length, quarter_force, output_load)

    # --- input stiffness and amplification, (16)-(17)

    def input_displacement(self, quarter_force: float, output_load: float = 0.0) -> float:
        """dx_in = dx + dx_2, half the actuator's extension [m]: Lin et al. (2019), eq. (16)."""
        arm = self.arm_input_displacement(quarter_force, output_load)
        return arm + self.rod_tip_deflection(quarter_force, output_load)

    def input_stiffness(self, output_load: float = 0.0) -> float:
        """K_in = F_x / dx_in = F / (2 dx_in) [N/m]: Lin et al. (2019), eq. (17)."""
        return 1 / self.input_displacement(1.0, output_load)

    def amplification(self, output_load: float = 0.0) -> float:
        """Amplification lambda = dy / dx_in, positive inwards (convex bridge): Lin et al. (2019), eq. (17)."""
        return self.output_displacement(1.0, output_load) / self.input_displacement(1.0, output_load)

    # --- between the ports: not in the paper, but what its equations imply

    def port_compliance(self) -> NDArray[np.float64]:
        """Compliance between input and output port, 2 by 2 [m/N], made symmetric.

        Row and column 0: the actuator's force and its extension; 1: a force on the output and its travel, both
        positive inwards, as the actuator moves a convex bridge. It keeps the paper's numbers:
        C11 = 1/K_in and C21 = lambda/K_in, output free, and C22 = 1/K_out. The paper's own equations give the
        other off-diagonal, C12, which differs by `reciprocity_defect`; here C12 = C21, as work demands. The price:
        with a loaded output the matrix does not return (17) exactly, because (15) then takes the load's share
        of the hinge moment off the rod, which is the very term without a counterpart.
        """
        c11 = self.input_displacement(1.0)
        c21 = self.output_displacement(1.0)
        return np.array([[c11, c21], [c21, 1 / self.output_stiffness]])

    @property
    def reciprocity_defect(self) -> float:
        """C12/C21 - 1 by the paper's equations: K_r l_1^2 / (2 E I l_y), with E I of the rod.

        C12, input motion per output force, has the rod bent by the hinge moment, l_1^2 M / (2 E I). C21,
        output motion per input force, lacks its mirror image: the rod's tip rotation F_x l_1^2 / (2 E I)
        turns the outer hinge. So the number is also the share by which that rotation would raise the output's
        motion per force, to first order in the ratio of the hinge's stiffness to the rod's, K_r l_1 / (E I). It has
        the sign of l_y: in a concave bridge the rotation takes from the output's motion.
        """
        return self.hinge_stiffness * self.rod_length**2 / (2 * self.rod_bending_stiffness * self.arm_offset)

    def output_stiffness_with_input(self, actuator_stiffness: float = math.inf) -> float:
        """Output stiffness with an actuator, or by default a rigid body, between the inputs [N/m].

        The inverse of ``C22 - C12^2 / (C11 + 1/k)`` from `port_compliance`. As the rigid arm alone has no
        freedom left once its input is held, only the rod (and the actuator, in series with it) gives way:
        infinite for a held input without a rod.

        Parameters
        ----------
        actuator_stiffness
            k > 0, actuator force over its extension [N/m], contacts included.
        """
        c11 = self.input_displacement(1.0)
        # C11 - C12^2 / C22 is the rod's share exactly; as a difference a stiff rod would vanish in rounding.
        series = self.rod_tip_deflection(1.0) + 1 / actuator_stiffness
        if series <= 0:  # below 0 by rounding alone: l_1 is 3 |l_y| / 4 or more
            return math.inf
        return self.output_stiffness * (c11 + 1 / actuator_stiffness) / series


def intermediates(model: PseudoRigidBridge, force: float, output_load: float = 0.0) -> dict[str, Quantity]:
    """Return every quantity on the way from force to amplification, by the paper's symbols.

    Parameters
    ----------
    model
        The amplifier.
    force
        F = 2 F_x, the actuator's force [N].
    output_load
        Stiffness of what the output pushes against [N/m]; the paper's case is ``model.output_stiffness``.

    Returns
    -------
    dict
        Symbol -> quantity, in the order of the equations; each one's source names its equation.
    """
    f, load = force / 2, output_load
    m, at = model, output_boundary(output_load)
    tip = m.rod_length
    rows = (
        ("F_x", f, "N", "N", "half the actuator's force: upper and lower arm"),
        ("K_r", m.hinge_stiffness, "N*m/rad", "N*mm/rad", "E w t^3 / (12 l), Euler-Bernoulli leaf"),
        ("K_out", m.output_stiffness, "N/m", "N/mm", f"{SOURCE}, eq. (5)"),
        ("dalpha", m.rotation(f, load), "rad", "mrad", f"{SOURCE}, eq. (7)"),
        ("M", m.hinge_moment(f, load), "N*m", "N*mm", f"{SOURCE}, eq. (2)"),
        ("dy", m.output_displacement(f, load), "m", "um", f"{SOURCE}, eq. (3)"),
        ("U", m.hinge_energy(f, load), "J", "mJ", f"{SOURCE}, eq. (4), left side"),
        ("F_y", m.output_force(f, load), "N", "N", f"{SOURCE}, eq. (6)"),
        ("dx", m.arm_input_displacement(f, load), "m", "um", f"{SOURCE}, eq. (9)"),
        ("theta", m.rod_rotation(tip, f, load), "rad", "mrad", f"{SOURCE}, eq. (10), at the tip"),
        ("M_o", m.rod_root_moment(f, load), "N*m", "N*mm", f"{SOURCE}, eq. (11)"),
        ("M(l_1)", m.rod_moment(tip, f, load), "N*m", "N*mm", f"{SOURCE}, eqs. (12), (13), at the tip"),
        ("c", m.rod_coefficient(load), "m", "mm", f"{SOURCE}, eq. (14), there 1.5 l_y"),
        ("dx_2", m.rod_tip_deflection(f, load), "m", "um", f"{SOURCE}, eq. (15)"),
        ("dx_in", m.input_displacement(f, load), "m", "um", f"{SOURCE}, eq. (16)"),
        ("extension", 2 * m.input_displacement(f, load), "m", "um", "2 dx_in: left and right half"),
        ("travel", 2 * m.output_displacement(f, load), "m", "um", "2 dy: upper and lower half, positive inwards"),
        ("K_in", m.input_stiffness(load), "N/m", "N/mm", f"{SOURCE}, eq. (17)"),
        ("lambda", m.amplification(load), "1", "", f"{SOURCE}, eq. (17), positive inwards"),
    )
    free = {"K_r": "", "K_out": "input free"}  # properties of the amplifier, whatever it is loaded with
    return {
        name: Quantity(name, value, si, unit, boundary=free.get(name, at), source=source)
        for name, value, si, unit, source in rows
    }


def quantities(
    model: PseudoRigidBridge, output_load: float = 0.0, actuator_stiffness: float | None = None
) -> dict[str, Quantity]:
    """Return the model's stiffnesses and amplification (positive inwards), by `Quantity.key`.

    Parameters
    ----------
    model
        The amplifier.
    output_load
        Stiffness of what the output pushes against while K_in and lambda are taken [N/m]; 0 is a free output.
    actuator_stiffness
        Stiffness of an actuator in place [N/m], for ``K_out_actuator_installed``; None leaves that one out.

    Returns
    -------
    dict
        K_in, lambda, and K_out with its input free, held and, if asked for, actuator. An infinite stiffness
        (input held without a rod) is left out: there is nothing to compare it with.
    """
    at = output_boundary(output_load)
    generalised = "" if output_load == model.output_stiffness else ", output load generalised"
    eq17 = f"{SOURCE}, eq. (17){generalised}"
    ports = f"port compliance from {SOURCE}, eqs. (5), (17)"
    found = [
        Quantity("K_in", model.input_stiffness(output_load), "N/m", "N/mm", at, eq17),
        Quantity("lambda", model.amplification(output_load), "1", "", at, eq17),
        Quantity("K_out", model.output_stiffness, "N/m", "N/mm", "input free", f"{SOURCE}, eq. (5)"),
    ]
    inputs = {"input held": math.inf}
    if actuator_stiffness is not None:
        inputs["actuator installed"] = actuator_stiffness
    for boundary, stiffness in inputs.items():
        value = model.output_stiffness_with_input(stiffness)
        if math.isfinite(value):
            found.append(Quantity("K_out", value, "N/m", "N/mm", boundary, ports))
    return by_key(found)

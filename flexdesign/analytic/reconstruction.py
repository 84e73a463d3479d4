"""Dimensions of amplifiers and guides from what a stage shall do: the equations of Lin et al. (2019), solved backwards.

Targets are stiffness, input stiffness and amplification of two kinds of axes, X/Y and Z, and the coupling ratios of a
motion along X. One step follows from the other::

    lambda    from the gain, (30)                      K_b   from K_z, (21)
    L_1, L_2  from the coupling ratios, (23), (24)     K_r   from what K_x leaves to the guides, (21)
    l_x       from K_b and K_r, (5)                    l_y   from lambda and K_in, (17)
    compliance of the rod, from what K_in leaves to it, (17)

These are determined. How a hinge becomes as stiff as K_r, and a rod as compliant, is a choice: with modulus, width and
the thicknesses of hinge and rod chosen, their lengths follow.

**Circular by construction.** The equations forwards (`Reconstruction.recomputed_targets`) give back the targets. That
says that they were solved, and nothing about a real stage.

**The load.** (17) holds for an output that pushes against a spring; `load_ratio` is its stiffness over the amplifier's
own K_out: 1 in the paper, 0 for a free output.

**One K_b and K_r.** As in the paper, all amplifiers and guide hinges have the same hinge, and all amplifiers the same
arm span; those of X/Y and Z differ in l_y and in the rod. All are convex, as (17) is; `rod_length` of a negative l_y is
the rod of a concave one that is as stiff.

Source: Lin, Yu, Wu, Shen (2019), Decoupling and control of micromotion stage based on hysteresis of piezoelectric
actuation, Microsystem Technologies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace

from flexdesign.analytic import coupling
from flexdesign.analytic.lagrange import PRINTED_XY, PRINTED_Z, Coordinate, DrivenAxis, Elements, Topology, axis
from flexdesign.analytic.prb import PseudoRigidBridge

# --- what is asked for


class Contradiction(ValueError):
    """Targets or choices that no dimensions meet together.

    Parameters
    ----------
    field
        The field of `Targets` or `Choices` that has to give, dotted: ``xy.output_stiffness``.
    remedy
        What is wrong, and what would be possible.
    """

    def __init__(self, field: str, remedy: str) -> None:
        self.field = field
        self.remedy = remedy
        super().__init__(f"{field}: {remedy}")


def _positive(table: object, name: str) -> None:
    for field in fields(table):  # type: ignore[arg-type]
        value = getattr(table, field.name)
        if isinstance(value, float | int) and not (0 < value < math.inf or (field.name == "load_ratio" and value == 0)):
            raise Contradiction(f"{name}{field.name}", f"must be positive, found {value!r}")


@dataclass(frozen=True)
class AxisTargets:
    """What an axis shall do.

    Parameters
    ----------
    output_stiffness
        K of the axis, at the table [N/m].
    input_stiffness
        K_in of its amplifier, under the load [N/m].
    amplification
        lambda of its amplifier under the load, a magnitude; `amplification_from_gain` finds it from a gain.
    load_ratio
        Stiffness that the amplifier's output pushes against, over its own K_out.
    """

    output_stiffness: float
    input_stiffness: float
    amplification: float
    load_ratio: float = 1.0


@dataclass(frozen=True)
class CouplingTargets:
    """How much a motion along X may draw the table along Y and Z.

    Parameters
    ----------
    input_stroke
        Motion of the actuator at which the ratios hold [m]; the table moves lambda times as far.
    y_from_x, z_from_x
        Coupled motion over motion along X.
    """

    input_stroke: float
    y_from_x: float
    z_from_x: float


@dataclass(frozen=True)
class Targets:
    """What a stage shall do, and the topology that shall do it.

    Parameters
    ----------
    xy, z
        The axes.
    coupling
        Of a motion along X.
    topology_xy, topology_z
        How many elements take part; by default as eq. (21) counts.

    Raises
    ------
    Contradiction
        If a number is not positive, or a topology has none of the elements that are to be found from it.
    """

    xy: AxisTargets
    z: AxisTargets
    coupling: CouplingTargets
    topology_xy: Topology = PRINTED_XY
    topology_z: Topology = PRINTED_Z

    def __post_init__(self) -> None:
        for name in ("xy", "z", "coupling"):
            _positive(getattr(self, name), f"{name}.")
        for name in ("topology_xy", "topology_z"):
            if not getattr(self, name).bending_amplifiers:
                raise Contradiction(f"{name}.bending_amplifiers", "K_b is found from amplifiers; 1 at least must bend")
        if not self.topology_xy.guide_hinges:
            raise Contradiction("topology_xy.guide_hinges", "K_r is found from guide hinges; X/Y must have 1 at least")
        if self.topology_z.guide_hinges:
            raise Contradiction("topology_z.guide_hinges", "K_b is found from amplifiers alone; Z must have no hinges")


@dataclass(frozen=True)
class Choices:
    """What the targets leave open.

    Parameters
    ----------
    youngs_modulus
        E [Pa].
    width
        w, of hinges and rods [m].
    hinge_thickness, rod_thickness
        t and l_3 [m].

    Raises
    ------
    Contradiction
        If one is not positive.
    """

    youngs_modulus: float
    width: float
    hinge_thickness: float
    rod_thickness: float

    def __post_init__(self) -> None:
        _positive(self, "")


# --- the steps


def amplification_from_gain(input_stiffness: float, output_stiffness: float, gain: float) -> float:
    """Return lambda = k_in / (4 k G): Lin et al. (2019), eq. (30) at rest, solved for lambda.

    Parameters
    ----------
    input_stiffness, output_stiffness
        k_in of the amplifier and k of the axis [N/m].
    gain
        G, output motion per actuator motion as (30) has it; (31) prints it.
    """
    return input_stiffness / (4 * output_stiffness * gain)


def amplifier_stiffness(output_stiffness: float, topology: Topology) -> float:
    """Return K_b of an axis in which only n amplifiers bend, K / (n share^2) [N/m]: V_z of (21), where K_z = 2 K_b."""
    return output_stiffness / (topology.bending_amplifiers * topology.amplifier_share**2)


def hinge_stiffness(output_stiffness: float, k_b: float, chain_length: float, topology: Topology) -> float:
    """Return K_r = (K_x - n K_b) L_1^2 / m [N m/rad]: V_x of (21), with n = 1 amplifier and m = 4 guide hinges there.

    K_x and K_b in N/m, L_1 in m; an amplifier that makes only a share of the motion counts with the share's square.

    Raises
    ------
    Contradiction
        If the amplifiers alone are as stiff as the axis shall be.
    """
    amplifiers = topology.bending_amplifiers * topology.amplifier_share**2 * k_b
    if not output_stiffness > amplifiers:
        raise Contradiction(
            "xy.output_stiffness",
            f"amplifiers as stiff as Z asks for make {amplifiers / 1e3:.4g} N/mm in X/Y, and nothing is left for the"
            " guide hinges; ask for more in X/Y or less in Z, or let fewer amplifiers bend in X/Y",
        )
    return (output_stiffness - amplifiers) * chain_length**2 / topology.guide_hinges


def arm_span(k_b: float, k_r: float) -> float:
    """Return l_x = sqrt(2 K_r / K_b) [m]: Lin et al. (2019), eq. (5), with K_b [N/m] and K_r [N m/rad]."""
    return math.sqrt(2 * k_r / k_b)


def arm_offset(targets: AxisTargets, k_r: float, l_x: float) -> float:
    """Return l_y = lambda (2 K_r + K_load l_x^2) / (K_in l_x) [m]: Lin et al. (2019), eq. (17).

    (17) is ``lambda = K_in l_x l_y / 4 K_r``; 4 K_r means ``2 K_r (1 + load_ratio)``.

    Parameters
    ----------
    targets
        K_in, lambda and the load.
    k_r, l_x
        K_r [N m/rad] and l_x [m].
    """
    resistance = 2 * k_r * (1 + targets.load_ratio)
    return targets.amplification * resistance / (targets.input_stiffness * l_x)


def rod_compliance(targets: AxisTargets, k_b: float) -> float:
    """Return what K_in leaves to the rod, 1/K_in - l_y^2 / 4 K_r [m/N]: Lin et al. (2019), eq. (17).

    With l_y by `arm_offset` the arm's share of the compliance, ``l_y^2 / (2 K_r (1 + load_ratio))``, is
    ``lambda^2 K_b (1 + load_ratio) / K_in^2``: the energy at the output, where K_b and the load are, over that at the
    input.

    Parameters
    ----------
    targets
        K_in, lambda and the load.
    k_b
        K_b [N/m].

    Raises
    ------
    Contradiction
        If the output would hold more energy than the input gives; the field is relative to the axis.
    """
    share = targets.amplification**2 * k_b * (1 + targets.load_ratio) / targets.input_stiffness
    if not share < 1:
        most = targets.amplification / math.sqrt(share)
        raise Contradiction(
            "amplification",
            f"an amplification of {targets.amplification:.4g} needs an input stiffer than"
            f" {share * targets.input_stiffness / 1e6:.4g} N/um, because the output is an amplifier of"
            f" {k_b / 1e3:.4g} N/mm and its load; at the input stiffness asked for it must be below {most:.4g}",
        )
    return (1 - share) / targets.input_stiffness


def hinge_length(k_r: float, choices: Choices) -> float:
    """Return the length of a leaf with rotational stiffness K_r [N m/rad], E w t^3 / (12 K_r) [m]."""
    return choices.youngs_modulus * choices.width * choices.hinge_thickness**3 / (12 * k_r)


def rod_length(compliance: float, l_y: float, load_ratio: float, choices: Choices) -> float:
    """Return l_1, at which 4 l_1^3 + c l_1^2 = compliance E w l_3^3 [m]: Lin et al. (2019), eq. (15).

    c, 1.5 l_y in the paper, is ``3 l_y / (1 + load_ratio)``. There is one solution, for a convex bridge below that of
    a rod without the hinge's moment (c = 0), for a concave one above; it is found by Brent's method, to rounding.

    Parameters
    ----------
    compliance
        Motion of the rod's tip per force on it [m/N].
    l_y
        Arm offset [m]; negative for a concave bridge.
    load_ratio
        As `AxisTargets` has it.
    choices
        E, w and l_3.
    """
    from scipy.optimize import brentq  # slow to import: not before it is needed

    c = 3 * l_y / (1 + load_ratio)
    volume = compliance * choices.youngs_modulus * choices.width * choices.rod_thickness**3
    unit = math.cbrt(volume / 4)  # the length for c = 0, so that the tolerance is relative
    k = c / (4 * unit)
    return unit * float(brentq(lambda s: s**3 + k * s**2 - 1, 0.0, 1 + max(0.0, -k), xtol=1e-15))


# --- all of them


@dataclass(frozen=True)
class Reconstruction:
    """Dimensions that meet the targets.

    Parameters
    ----------
    targets, choices
        What they were found from.
    travel
        Motion along X at the input stroke, lambda times the stroke [m].
    chain_length_y, chain_length_z
        L_1 and L_2 [m].
    amplifier_stiffness, hinge_stiffness
        K_b [N/m] and K_r [N m/rad].
    rod_compliance_xy, rod_compliance_z
        Of the input rods of either amplifier [m/N].
    xy, z
        The amplifiers, with all dimensions that the pseudo-rigid-body model has.
    """

    targets: Targets
    choices: Choices
    travel: float
    chain_length_y: float
    chain_length_z: float
    amplifier_stiffness: float
    hinge_stiffness: float
    rod_compliance_xy: float
    rod_compliance_z: float
    xy: PseudoRigidBridge
    z: PseudoRigidBridge

    def axis(self, name: str, topology: Topology) -> Coordinate:
        """Return an axis with these amplifiers and guides, of this topology or another; without masses."""
        elements = Elements(self.xy.output_stiffness, self.xy.hinge_stiffness, self.chain_length_y)
        return axis(name, topology, elements)

    def axes_under_load(self) -> tuple[DrivenAxis, DrivenAxis]:
        """Return X/Y and Z as the dimensions make them, each with its amplifier under its load."""
        t = self.targets
        return (
            DrivenAxis(self.axis("X/Y", t.topology_xy), self.xy, t.xy.load_ratio * self.xy.output_stiffness),
            DrivenAxis(self.axis("Z", t.topology_z), self.z, t.z.load_ratio * self.z.output_stiffness),
        )

    def recomputed_targets(self) -> Targets:
        """Return what the equations, forwards, give for these dimensions: the targets, by construction."""
        t, (x, z) = self.targets, self.axes_under_load()
        travel = x.amplification * t.coupling.input_stroke
        y_from_x, z_from_x = (coupling.coupling_ratio(l, travel) for l in (self.chain_length_y, self.chain_length_z))
        return replace(
            t,
            xy=AxisTargets(x.coordinate.stiffness, x.input_stiffness, x.amplification, t.xy.load_ratio),
            z=AxisTargets(z.coordinate.stiffness, z.input_stiffness, z.amplification, t.z.load_ratio),
            coupling=CouplingTargets(t.coupling.input_stroke, y_from_x, z_from_x),
        )


def reconstruct(targets: Targets, choices: Choices) -> Reconstruction:
    """Return the dimensions that meet the targets.

    Raises
    ------
    Contradiction
        A ValueError, if the targets contradict each other, or the choices do not fit them.
    """
    travel = targets.xy.amplification * targets.coupling.input_stroke
    l_1, l_2 = (_chain_length(targets.coupling, name, travel) for name in ("y_from_x", "z_from_x"))
    k_b = amplifier_stiffness(targets.z.output_stiffness, targets.topology_z)
    k_r = hinge_stiffness(targets.xy.output_stiffness, k_b, l_1, targets.topology_xy)
    l_x, l_h = arm_span(k_b, k_r), hinge_length(k_r, choices)
    if not l_h < l_x:
        raise Contradiction(
            "hinge_thickness",
            f"hinges would be {1e3 * l_h:.4g} mm long, on arms with {1e3 * l_x:.4g} mm between their centres; choose a"
            f" hinge thinner than {1e3 * choices.hinge_thickness * math.cbrt(l_x / l_h):.4g} mm, or narrower",
        )
    compliances, bridges = {}, {}
    for name, wanted in (("xy", targets.xy), ("z", targets.z)):
        try:
            compliances[name] = rod_compliance(wanted, k_b)
        except Contradiction as error:
            raise Contradiction(f"{name}.{error.field}", error.remedy) from None
        l_y = arm_offset(wanted, k_r, l_x)
        bridges[name] = PseudoRigidBridge(
            youngs_modulus=choices.youngs_modulus,
            width=choices.width,
            hinge_thickness=choices.hinge_thickness,
            hinge_length=l_h,
            arm_span=l_x,
            arm_offset=l_y,
            rod_length=rod_length(compliances[name], l_y, wanted.load_ratio, choices),
            rod_thickness=choices.rod_thickness,
        )
    return Reconstruction(
        targets, choices, travel, l_1, l_2, k_b, k_r, compliances["xy"], compliances["z"], bridges["xy"], bridges["z"]
    )


def _chain_length(wanted: CouplingTargets, name: str, travel: float) -> float:
    """Return the chain length of a coupling ratio; the refusal names the ratio."""
    try:
        return coupling.chain_length(getattr(wanted, name), travel)
    except ValueError as error:
        raise Contradiction(f"coupling.{name}", str(error)) from None

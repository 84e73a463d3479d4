"""Mass and stiffness of amplifier and stage by Lagrange's equations: Lin et al. (2019), (18) to (22) and (30).

Everything that moves or bends follows one coordinate, so that Lagrange's equations (18) and (20) reduce to sums: an
element of some amount of mass or stiffness that makes the share s of the coordinate's motion contributes amount times
s^2, and one that turns by s / L, on an arm of length L, amount times (s / L)^2. A `Coordinate` is a list of such terms,
each with its name: the output travel of an amplifier, (19), or the motion of the table along an axis, (21).

**What (19) leaves out.** Arms and input blocks also translate. With one end of the amplifier on the ground and q its
output travel, the input blocks ride along at q/2, the centres of the arms at q/4 and 3q/4. Both can be added
(`amplifier`), neither is by default.

**What (21) counts.** In X/Y it counts M_b four times, but K_b once. M_b is by (19) the mass of an amplifier that bends,
and so each M_b belongs to a K_b. `Topology` states such counts, `PRINTED_XY` as the paper prints them; other topologies
take the same elements.

Source: Lin, Yu, Wu, Shen (2019), Decoupling and control of micromotion stage based on hysteresis of piezoelectric
actuation, Microsystem Technologies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from flexdesign.analytic.prb import SOURCE, PseudoRigidBridge
from flexdesign.core.model import Quantity

# --- energies of one coordinate


@dataclass(frozen=True)
class Term:
    """Elements of one kind, as they enter the kinetic or potential energy.

    Parameters
    ----------
    name
        What they are, with the paper's symbol.
    count
        How many there are.
    amount
        Of one: a mass [kg], a stiffness [N/m]; with an arm a moment of inertia [kg m^2], a rotational stiffness
        [N m/rad].
    share
        Motion of the element, or of the end of its arm, over that of the coordinate.
    arm_length
        Length on which the element turns [m]; None for one that does not turn.
    equation
        Where the term stands.

    Raises
    ------
    ValueError
        If count, amount or arm cannot be.

    Examples
    --------
    >>> Term("hinges", 4, 3.0, arm_length=0.05).contribution  # 4 * 3 / 0.05^2 N/m
    4800.0
    """

    name: str
    count: int
    amount: float
    share: float = 1.0
    arm_length: float | None = None
    equation: str = ""

    def __post_init__(self) -> None:
        if not self.count >= 1:
            raise ValueError(f"{self.name}: the count must be 1 or more, found {self.count!r}")
        if not 0 <= self.amount < math.inf:
            raise ValueError(f"{self.name}: the amount must be zero or more, found {self.amount!r}")
        if self.arm_length is not None and not 0 < self.arm_length < math.inf:
            raise ValueError(f"{self.name}: the arm's length must be positive, found {self.arm_length!r}")

    @property
    def lever(self) -> float:
        """Motion of the element per motion of the coordinate [m/m], or its rotation [rad/m]."""
        return self.share if self.arm_length is None else self.share / self.arm_length

    @property
    def contribution(self) -> float:
        """What the elements add to the coordinate's mass [kg] or stiffness [N/m]: count, amount and lever^2."""
        return self.count * self.amount * self.lever**2


@dataclass(frozen=True)
class Coordinate:
    """A generalised coordinate with the energies that follow it: an axis of the stage, or an amplifier's travel.

    Parameters
    ----------
    name
        Which coordinate.
    kinetic, potential
        Terms of the kinetic and of the potential energy.
    """

    name: str
    kinetic: tuple[Term, ...]
    potential: tuple[Term, ...]

    @property
    def mass(self) -> float:
        """Equivalent mass [kg], by Lin et al. (2019), eqs. (18) and (20), M in (22)."""
        return sum(term.contribution for term in self.kinetic)

    @property
    def stiffness(self) -> float:
        """Equivalent stiffness [N/m], by Lin et al. (2019), eqs. (18) and (20), K in (22)."""
        return sum(term.contribution for term in self.potential)

    @property
    def natural_frequency(self) -> float:
        """Undamped natural frequency of (22), sqrt(K / M) / (2 pi) [Hz].

        Raises
        ------
        ValueError
            If nothing has mass.
        """
        if not self.mass > 0:
            raise ValueError(f"{self.name} has no mass, and so no natural frequency")
        return math.sqrt(self.stiffness / self.mass) / (2 * math.pi)

    def quantities(self, boundary: str = "input free") -> tuple[Quantity, Quantity]:
        """Return mass and natural frequency as what finite elements call output mass and output frequency."""
        source = self.kinetic[0].equation
        return (
            Quantity("output_mass", self.mass, "kg", "g", boundary, source),
            Quantity("output_frequency", self.natural_frequency, "Hz", "Hz", boundary, source),
        )

    def table(self) -> tuple[tuple[str, int, Quantity, str], ...]:
        """Return name, count, contribution and equation of every term: the masses, then the stiffnesses."""
        return tuple(
            (t.name, t.count, Quantity(t.name, t.contribution, si, unit, source=t.equation), t.equation)
            for terms, si, unit in ((self.kinetic, "kg", "g"), (self.potential, "N/m", "N/mm"))
            for t in terms
        )


# --- the bridge amplifier, (18) and (19)


def amplifier(
    *,
    input_block: float,
    output_block: float,
    arm_inertia: float,
    hinge_stiffness: float,
    arm_span: float,
    amplification: float,
    arm_mass: float = 0.0,
    riding_input: bool = False,
) -> Coordinate:
    """Return the free vibration of a bridge amplifier, its coordinate the output travel q: eqs. (18) and (19).

    ``Dy = q/2``, hence ``Dalpha = q / (2 l_x)`` and ``Dx_in = q / (2 lambda)``. The mass of the coordinate is M_b,
    ``m_1 / (2 lambda^2) + m_3 + J / l_x^2``, its stiffness K_b, ``2 K_r / l_x^2``, which is K_out of eq. (5).

    Parameters
    ----------
    input_block, output_block
        m_1 of one input block and m_3 [kg].
    arm_inertia
        J of one arm, about its centre [kg m^2].
    hinge_stiffness, arm_span
        K_r [N m/rad] and l_x [m].
    amplification
        lambda, a magnitude.
    arm_mass
        Of one arm [kg], for the translation of the arms' centres, which (19) leaves out; 0 leaves it out, too. Along
        the input an arm's centre is taken to move half as far as the block; a rod that bends makes it less.
    riding_input
        Whether to add the motion of the input blocks along the output, half the travel, which (19) leaves out.

    Raises
    ------
    ValueError
        If a mass is negative, or span or amplification is not positive.

    Examples
    --------
    >>> found = amplifier(
    ...     input_block=4e-3, output_block=5e-3, arm_inertia=6e-7, hinge_stiffness=2.842, arm_span=21.07e-3,
    ...     amplification=4.046,
    ... )
    >>> print(f"{1e3 * found.mass:.3f} g, {1e-3 * found.stiffness:.1f} N/mm")
    6.474 g, 12.8 N/mm
    """
    if not 0 < amplification < math.inf:
        raise ValueError(f"the amplification must be positive, found {amplification!r}")
    eq19, beyond = f"{SOURCE}, eq. (19)", f"not in {SOURCE}, eq. (19)"
    input_share = 1 / (2 * amplification)
    kinetic = [
        Term("input blocks m_1", 2, input_block, input_share, equation=eq19),
        Term("output block m_3", 1, output_block, equation=eq19),
        Term("rotation of the arms J", 4, arm_inertia, 0.5, arm_span, eq19),
    ]
    if riding_input:
        kinetic.append(Term("input blocks m_1, along the output", 2, input_block, 0.5, equation=beyond))
    if arm_mass:
        kinetic += [
            Term("arms at the ground, along the output", 2, arm_mass, 0.25, equation=beyond),
            Term("arms at the output, along the output", 2, arm_mass, 0.75, equation=beyond),
            Term("arms, along the input", 4, arm_mass, input_share / 2, equation=beyond),
        ]
    hinges = Term("hinges K_r", 8, hinge_stiffness, 0.5, arm_span, eq19)
    return Coordinate("bridge amplifier", tuple(kinetic), (hinges,))


# --- the stage, (20) to (22)


@dataclass(frozen=True)
class Topology:
    """How many elements of each kind take part in the motion of the table along an axis.

    Parameters
    ----------
    moving_amplifiers, bending_amplifiers
        How many amplifiers count with their mass M_b, and how many with their stiffness K_b.
    amplifier_share
        Travel of one amplifier over that of the table: 1/2 for two in series.
    guide_hinges
        Hinges K_r of branch chains that turn by the table's motion over L_1.
    guides
        Parallel guides of mass M_p.
    guide_share
        Motion of a guide over that of the table.

    Raises
    ------
    ValueError
        If a count is negative or no whole number, or a share is not positive.
    """

    moving_amplifiers: int
    bending_amplifiers: int
    amplifier_share: float = 1.0
    guide_hinges: int = 0
    guides: int = 0
    guide_share: float = 1.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name.endswith("share"):
                if not 0 < value < math.inf:
                    raise ValueError(f"{field.name} must be positive, found {value!r}")
            elif value != int(value) or value < 0:
                raise ValueError(f"{field.name} must be a whole number, 0 or more, found {value!r}")

    @property
    def consistent(self) -> bool:
        """Whether every amplifier that moves also bends."""
        return self.moving_amplifiers == self.bending_amplifiers


#: X/Y and Z as Lin et al. (2019), eq. (21), counts.
PRINTED_XY = Topology(moving_amplifiers=4, bending_amplifiers=1, guide_hinges=4)
PRINTED_Z = Topology(moving_amplifiers=8, bending_amplifiers=8, amplifier_share=0.5, guides=8, guide_share=0.5)
#: Other topologies of X/Y: two amplifiers on opposite sides with twice the guide hinges; four in parallel.
OPPOSED_XY = Topology(moving_amplifiers=2, bending_amplifiers=2, guide_hinges=8)
PARALLEL_XY = Topology(moving_amplifiers=4, bending_amplifiers=4, guide_hinges=4)


@dataclass(frozen=True)
class Elements:
    """What a stage is made of, one of each.

    Parameters
    ----------
    amplifier_stiffness
        K_b [N/m].
    hinge_stiffness
        K_r of a guide hinge [N m/rad].
    chain_length
        L_1 of the branch chains that guide X/Y [m].
    amplifier_mass
        M_b [kg].
    table_mass, guide_mass
        M_s and M_p [kg]. Without masses there are stiffnesses, but no natural frequency.
    """

    amplifier_stiffness: float
    hinge_stiffness: float
    chain_length: float
    amplifier_mass: float = 0.0
    table_mass: float = 0.0
    guide_mass: float = 0.0


def axis(name: str, topology: Topology, elements: Elements) -> Coordinate:
    """Return an axis of the stage, its coordinate the table's motion: Lin et al. (2019), eqs. (20) to (22).

    Parameters
    ----------
    name
        Of the axis.
    topology
        How many elements of each kind take part; what counts zero makes no term.
    elements
        One of each kind.

    Raises
    ------
    ValueError
        If a mass or a stiffness is negative, or `chain_length` is not positive where hinges turn on it.
    """
    t, e, eq21 = topology, elements, f"{SOURCE}, eq. (21)"
    if topology not in (PRINTED_XY, PRINTED_Z):
        eq21 += ", other counts"
    kinetic = [Term("table M_s", 1, e.table_mass, equation=eq21)]
    potential = []
    if t.moving_amplifiers:
        kinetic.append(Term("amplifiers M_b", t.moving_amplifiers, e.amplifier_mass, t.amplifier_share, None, eq21))
    if t.guides:
        kinetic.append(Term("guides M_p", t.guides, e.guide_mass, t.guide_share, None, eq21))
    if t.bending_amplifiers:
        share = t.amplifier_share
        potential.append(Term("amplifiers K_b", t.bending_amplifiers, e.amplifier_stiffness, share, None, eq21))
    if t.guide_hinges:
        potential.append(Term("guide hinges K_r", t.guide_hinges, e.hinge_stiffness, 1.0, e.chain_length, eq21))
    return Coordinate(name, tuple(kinetic), tuple(potential))


def as_printed(elements: Elements) -> tuple[Coordinate, Coordinate]:
    """Return the axes X/Y and Z exactly as Lin et al. (2019), eq. (21), prints them.

    X/Y: ``M_s + 4 M_b`` and ``K_b + 4 K_r / L_1^2``. Z: ``M_s + 2 M_b + 2 M_p`` and ``2 K_b``, from eight amplifiers
    and eight guides at half the travel. The paper has one M_b for both; where they differ, call `axis` for each.

    Examples
    --------
    >>> elements = Elements(amplifier_stiffness=12.8e3, hinge_stiffness=2.842, chain_length=45.46e-3)
    >>> x, z = as_printed(elements)
    >>> stiffnesses = [x, z, axis("X", OPPOSED_XY, elements), axis("X", PARALLEL_XY, elements)]
    >>> [round(1e-3 * each.stiffness, 1) for each in stiffnesses]  # N/mm
    [18.3, 25.6, 36.6, 56.7]
    """
    return axis("X/Y", PRINTED_XY, elements), axis("Z", PRINTED_Z, elements)


# --- the axis with its drive, (17) and (30)


def static_gain(input_stiffness: float, amplification: float, stiffness: float) -> float:
    """Return output motion per actuator motion at rest, k_in / (4 lambda k): Lin et al. (2019), eq. (30).

    k_in [N/m] and lambda are the amplifier's, k [N/m] is the axis's.
    """
    return input_stiffness / (4 * amplification * stiffness)


@dataclass(frozen=True)
class DrivenAxis:
    """An axis with the amplifier that drives it.

    Parameters
    ----------
    coordinate
        The axis.
    bridge
        Its amplifier.
    output_load
        Stiffness that the amplifier's output pushes against [N/m]; None is the paper's case, one as stiff as the
        amplifier itself.
    """

    coordinate: Coordinate
    bridge: PseudoRigidBridge
    output_load: float | None = None

    @property
    def load(self) -> float:
        """K_load, the output load [N/m]."""
        return self.bridge.output_stiffness if self.output_load is None else self.output_load

    @property
    def input_stiffness(self) -> float:
        """K_in under the load [N/m]: Lin et al. (2019), eq. (17)."""
        return self.bridge.input_stiffness(self.load)

    @property
    def amplification(self) -> float:
        """Amplification lambda under the load, a magnitude: Lin et al. (2019), eq. (17)."""
        return abs(self.bridge.amplification(self.load))

    @property
    def gain(self) -> float:
        """Output motion per actuator motion at rest: Lin et al. (2019), eq. (30); see `static_gain`."""
        return static_gain(self.input_stiffness, self.amplification, self.coordinate.stiffness)

"""A stage of amplifiers and guides, axis by axis: springs by Lagrange's equations, drive by pseudo-rigid bodies.

An axis' stiffness is the sum of what its motion bends: amplifiers, and leaf hinges at the ends of arms
(`flexdesign.analytic.lagrange`). Its amplifiers push against what else holds the table, in equal shares: with springs
of K besides n amplifiers that each make the share s of the travel, K / (n s^2) falls to one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flexdesign.analytic.lagrange import Coordinate, DrivenAxis, Elements, Term, as_printed
from flexdesign.analytic.prb import SOURCE, PseudoRigidBridge, leaf_rotational_stiffness
from flexdesign.core.model import Quantity

#: Name of their term among the springs.
AMPLIFIERS = "amplifiers K_b"


@dataclass(frozen=True)
class Hinges:
    """Equal leaf hinges at the ends of arms.

    Parameters
    ----------
    name, count
        What they are, and how many.
    thickness, width, length
        Of a leaf [m].
    arm
        Distance between the two hinges of an arm [m].
    share
        Motion of the arm's end over that of the table.
    """

    name: str
    count: int
    thickness: float
    width: float
    length: float
    arm: float
    share: float = 1.0

    def term(self, youngs_modulus: float) -> Term:
        """Return their energy for a modulus [Pa]."""
        stiffness = leaf_rotational_stiffness(youngs_modulus, self.width, self.thickness, self.length)
        return Term(self.name, self.count, stiffness, self.share, self.arm)


@dataclass(frozen=True)
class BranchedAxis:
    """One axis, or several that are alike.

    Parameters
    ----------
    names
        Of the axes.
    amplifier
        One of the amplifiers that drive it; its modulus is that of all hinges.
    amplifiers, share
        How many bend, and the travel of one over that of the table.
    hinges
        What else bends.
    masses
        What moves; none where masses do not matter.
    """

    names: tuple[str, ...]
    amplifier: PseudoRigidBridge
    amplifiers: int
    share: float
    hinges: tuple[Hinges, ...]
    masses: tuple[Term, ...] = ()

    @property
    def coordinate(self) -> Coordinate:
        """Its springs and masses."""
        bridge = Term(AMPLIFIERS, self.amplifiers, self.amplifier.output_stiffness, self.share)
        others = (hinges.term(self.amplifier.youngs_modulus) for hinges in self.hinges)
        return Coordinate(" and ".join(self.names), self.masses, (bridge, *others))

    @property
    def load(self) -> float:
        """What each amplifier pushes against [N/m]."""
        amplifiers, *others = self.coordinate.potential
        return sum(term.contribution for term in others) / (amplifiers.count * amplifiers.share**2)

    def quantities(self) -> list[Quantity]:
        """Return stiffness, input stiffness of an actuator and amplification from actuator to table, by axis."""
        return _quantities(self, DrivenAxis(self.coordinate, self.amplifier, self.load))


@dataclass(frozen=True)
class Masses:
    """One of everything that moves [kg].

    Parameters
    ----------
    table, guide
        M_s, and M_p of a parallel guide of Z.
    amplifier_xy, amplifier_z
        M_b; the paper has one for both.
    block, carrier
        What an X/Y amplifier moves, and what a pair of Z amplifiers does.
    limb, strut
        That carry the motion to the table.
    """

    table: float
    guide: float
    amplifier_xy: float
    amplifier_z: float
    block: float
    carrier: float
    limb: float
    strut: float

    def sideways(self, sides: int) -> tuple[Term, ...]:
        """Return the masses along X with amplifiers on `sides` sides; a body that turns about an end counts a third."""
        return (
            Term("table M_s", 1, self.table),
            Term("amplifiers M_b", sides, self.amplifier_xy),
            Term("blocks", sides, self.block),
            Term("limbs along", 2 * sides, self.limb),
            Term("limbs across, a third", 2 * sides, self.limb / 3),
            Term("struts, a third", 4, self.strut / 3),
        )

    def upwards(self, sides: int) -> tuple[Term, ...]:
        """Return what moves along Z, amplifiers and guides by half."""
        return (
            Term("table M_s", 1, self.table),
            Term("amplifiers M_b", 8, self.amplifier_z, 0.5),
            Term("carriers", 4, self.carrier),
            Term("guides M_p", 8, self.guide, 0.5),
            Term("struts", 4, self.strut),
            Term("limbs, a third", 4 * sides, self.limb / 3),
        )


def as_the_paper_counts(axes: Sequence[BranchedAxis], arm: float, masses: Masses) -> list[Quantity]:
    """Return the same by the counts of Lin et al. (2019), eq. (21), each amplifier loaded by its own output stiffness.

    Parameters
    ----------
    axes
        X/Y, then Z.
    arm
        L_1 of the guide hinges, which are those of the amplifiers [m].
    masses
        Of which (21) counts M_s, M_b and M_p.
    """
    bridge = axes[0].amplifier
    k_b, k_r = bridge.output_stiffness, bridge.hinge_stiffness
    printed = [
        as_printed(Elements(k_b, k_r, arm, m_b, masses.table, masses.guide))[index]
        for index, m_b in enumerate((masses.amplifier_xy, masses.amplifier_z))
    ]
    pairs = zip(axes, printed, strict=True)
    return [q for axis, coordinate in pairs for q in _quantities(axis, DrivenAxis(coordinate, axis.amplifier))]


def _quantities(axis: BranchedAxis, driven: DrivenAxis) -> list[Quantity]:
    found, initial = [], driven.coordinate
    for name in axis.names:
        if initial.mass:
            source = f"{SOURCE}, eqs. (20) to (22)"
            found += [
                Quantity("output_mass", initial.mass, "kg", "g", f"{name}, inputs free", source),
                Quantity("output_frequency", initial.natural_frequency, "Hz", "Hz", f"{name}, inputs free", source),
            ]
        found += [
            Quantity("K_out", driven.coordinate.stiffness, "N/m", "N/mm", f"{name}, inputs free"),
            Quantity("K_in", driven.input_stiffness, "N/m", "N/mm", f"{name}, table free"),
            Quantity("lambda", driven.amplification / axis.share, "1", "", f"{name}, table free"),
        ]
    return found

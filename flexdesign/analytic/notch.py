"""Published closed forms of one hinge: leaf, corner-filleted leaf, circular, elliptic, parabolic and V notch.

One end is held, the other carries force and moment in the plane; between them lies a beam of width b whose height t(x)
varies. All forms here are, exactly or for a thin neck, the integrals of Euler-Bernoulli theory::

    rotation per moment           (12 / E b) int dx / t^3
    deflection per moment         (12 / E b) int (l - x) dx / t^3      (= l / 2 of the rotation: both ends are alike)
    deflection per force across   (12 / E b) int (l - x)^2 dx / t^3
    stretch per force along       ( 1 / E b) int dx / t

which `beam_integral` finds by quadrature for any height. Shear adds (6/5) E / G of the last one to the deflection.

**What was verified, and how.** The original papers were not at hand. Each form stands here because it agrees with the
quadrature to rounding (tests), for thin and thick necks: that proves the formula, not the place where it was printed,
and no equation numbers are given. Where no text is named, form and name are as commonly quoted. In detail:

- Paros and Weisbord (1965), rotation and stretch, in full: exact, for notches of any depth. Simplified: the limit of a
  thin neck; rotation 1 + t / 8R too compliant, as the next term of the expansion says. The simplified rotation was also
  seen in public notes and programs; Yong, Lu and Handley (2008), it says there, find it good to about 5 % for
  0.05 <= t / R <= 0.2.
- Wu and Zhou (2002), right-circular, rotation and stretch: exact.
- Elliptic and parabolic notches, of which Smith et al. (1997) and Lobontiu (2002) print forms of their own, and the V
  with a rounded tip: worked out anew, and exact. Along an ellipse of half length a and depth c the height is that of a
  circle of radius c, stretched by a / c along the axis.
- Lobontiu (2002), right-circular, and Lobontiu et al. (2001), corner-filleted: exact. Their deflections per force,
  and the circular one's per moment, were seen in a public transcription. In that of the corner-filleted hinge the last
  arc tangent lacks its square root; restored, as the quadrature demands.

**Left out.** Koseki et al. (2002): no text of its formulas was found, so none stands under that name; `thin_neck` and
`leaf`, with `EndCompliance.with_shear`, cover the same hinges. Paros and Weisbord's own deflection per force across was
not found either. Formulas fitted to finite elements are not this module's business.

**What beams neglect.** Sections that do not stay plane between sloping sides
(`flexdesign.effects.hinge_compliance.taper`), blocks that give way around the notch, and a width too large to
contract. In plane stress finite elements have the notch R 2 mm, t 0.5 mm, b 10 mm, E 71 GPa at 5923 N mm/rad: the
integral is 9.5 % above it, the simplified formula 6.0 %, its two errors being of opposite signs.

Sources: J. M. Paros and L. Weisbord, How to design flexure hinges, Machine Design 37 (1965), 151-156. N. Lobontiu, J.
S. N. Paine, E. Garcia and M. Goldfarb, Corner-filleted flexure hinges, Journal of Mechanical Design 123 (2001),
346-352. S. T. Smith, V. G. Badami, J. S. Dale and Y. Xu, Elliptical flexure hinges, Review of Scientific Instruments 68
(1997), 1474-1483. Y. Wu and Z. Zhou, Design calculations for flexure hinges, Review of Scientific Instruments 73
(2002), 3101-3106. N. Lobontiu, Compliant Mechanisms: Design of Flexure Hinges, CRC Press (2002). Y. K. Yong, T.-F. Lu
and D. C. Handley, Review of circular flexure hinge design equations and derivation of empirical formulations, Precision
Engineering 32 (2008), 63-70.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.integrate import quad

from flexdesign.core.model import Notch

#: Shear stress of a rectangular section, as its work says, over its mean.
SHEAR_FACTOR = 6 / 5


@dataclass(frozen=True)
class EndCompliance:
    """How the free end of a hinge gives way in its plane, the other end held.

    Parameters
    ----------
    rotation
        Rotation per moment [rad/(N m)].
    cross
        Deflection across per moment, and rotation per force across [1/N].
    transverse
        Deflection across per force across [m/N].
    axial
        Stretch per force along [m/N].
    """

    rotation: float
    cross: float
    transverse: float
    axial: float

    @property
    def rotational_stiffness(self) -> float:
        """Moment per rotation, nothing else acting, 1 / rotation [N m/rad]."""
        return 1 / self.rotation

    @property
    def axial_stiffness(self) -> float:
        """Force along per stretch [N/m]."""
        return 1 / self.axial

    @property
    def sway_stiffness(self) -> float:
        """Force across per deflection with both ends kept parallel [N/m]; 12 E I / l^3 for a leaf."""
        return 1 / (self.transverse - self.cross**2 / self.rotation)

    def with_shear(self, poissons_ratio: float) -> EndCompliance:
        """Return the same hinge, shear included: (6/5) E / G of the stretch is added to the deflection.

        E / G = 2 (1 + nu): both are integrals of 1 / t (Lobontiu 2002).
        """
        return replace(self, transverse=self.transverse + SHEAR_FACTOR * 2 * (1 + poissons_ratio) * self.axial)


# --- any height, by quadrature


def beam_integral(
    youngs_modulus: float, width: float, height: Callable[[float], float], length: float, *places: float
) -> EndCompliance:
    """Return the Euler-Bernoulli compliance of a hinge of any height, by quadrature.

    Parameters
    ----------
    youngs_modulus
        E [Pa].
    width
        b [m].
    height
        t(x) [m], x from the held end.
    length
        l [m].
    places
        Where the height has corners, or its minimum [m].

    Examples
    --------
    >>> hinge = beam_integral(71e9, 10e-3, circular_thickness(2e-3, 0.5e-3), 4e-3, 2e-3)
    >>> round(hinge.rotational_stiffness, 4)
    6.4863
    """
    _check(youngs_modulus=youngs_modulus, width=width, length=length)
    edges = sorted({0.0, *places, length})

    def integral(lever: int, power: int) -> float:
        def integrand(x: float) -> float:
            return float((length - x) ** lever / height(x) ** power)

        return sum(quad(integrand, *piece, epsabs=0.0, epsrel=1e-11, limit=200)[0] for piece in pairwise(edges))

    bending, axial = youngs_modulus * width / 12, youngs_modulus * width
    rotation, cross, transverse = (integral(lever, 3) / bending for lever in (0, 1, 2))
    return EndCompliance(rotation, cross, transverse, integral(0, 1) / axial)


def circular_thickness(radius: float, thickness: float) -> Callable[[float], float]:
    """Return t(x) of a right-circular notch, 0 <= x <= 2 R; lengths in m."""
    return filleted_thickness(2 * radius, radius, thickness)


def filleted_thickness(length: float, fillet: float, thickness: float) -> Callable[[float], float]:
    """Return t(x) of a leaf with quarter circles of radius `fillet` at its ends, which count to its length; in m."""

    def thickness_at(x: float) -> float:
        into = max(0.0, fillet - min(x, length - x))
        return thickness + 2 * (fillet - math.sqrt((fillet - into) * (fillet + into)))

    return thickness_at


# --- closed forms


def leaf(youngs_modulus: float, width: float, thickness: float, length: float) -> EndCompliance:
    """Return a leaf of even height: l/EI, l^2/2EI, l^3/3EI and l/EA, with I = b t^3 / 12; Pa and m."""
    _check(youngs_modulus=youngs_modulus, width=width, thickness=thickness, length=length)
    bending, axial = youngs_modulus * width * thickness**3 / 12, youngs_modulus * width * thickness
    return EndCompliance(length / bending, length**2 / (2 * bending), length**3 / (3 * bending), length / axial)


def paros_weisbord(
    youngs_modulus: float, width: float, thickness: float, radius: float, block: float | None = None
) -> tuple[float, float]:
    """Return rotation per moment [rad/(N m)] and stretch per force [m/N] of a circular notch, in full.

    Paros and Weisbord (1965), with beta = t / 2R and gamma = h / 2R. Exact for Euler-Bernoulli beams.

    Parameters
    ----------
    youngs_modulus
        E [Pa].
    width, thickness, radius
        b, t and R [m].
    block
        h, height of what the notch is cut into [m]; by default 2 R + t, a right-circular notch.

    Examples
    --------
    >>> round(1 / paros_weisbord(71e9, 10e-3, 0.5e-3, 2e-3)[0], 4)
    6.4863
    """
    _check(youngs_modulus=youngs_modulus, width=width, thickness=thickness, radius=radius)
    block = 2 * radius + thickness if block is None else block
    if not thickness < block <= (2 * radius + thickness) * (1 + 1e-12):
        raise ValueError(
            f"block must be between thickness {thickness!r} and 2 radius + thickness {2 * radius + thickness!r} m "
            f"(a notch no deeper than its radius), found {block!r}"
        )
    beta, gamma = thickness / (2 * radius), block / (2 * radius)
    both = 2 * beta + beta**2
    deep = gamma - beta  # depth of the notch over its radius
    half_length = math.sqrt(max(0.0, deep * (2 - deep)))  # over the radius; sqrt(1 - (1 + beta - gamma)^2)
    angle = math.atan2(math.sqrt((2 + beta) / beta) * deep, half_length)
    rotation = ((1 + beta) / gamma**2 + (3 + 2 * beta + beta**2) / (gamma * both)) * half_length
    rotation += 6 * (1 + beta) / both**1.5 * angle
    stretch = 2 * (1 + beta) / math.sqrt(both) * angle - 2 * math.atan2(deep, half_length)
    axial = youngs_modulus * width
    return 3 / (2 * axial * radius**2 * both) * rotation, stretch / axial


def thin_neck(youngs_modulus: float, width: float, thickness: float, radius: float) -> EndCompliance:
    """Return a right-circular notch whose neck is thin, t << R; modulus in Pa, lengths in m.

    With t(x) = t + x^2 / R for all x, the integrals over E b are 9 pi R^(1/2) / (2 t^(5/2)), R times that, R^2 times
    that plus 3 pi R^(3/2) / (2 t^(3/2)), and pi (R / t)^(1/2) - (1 + pi / 2). The first and the last one are Paros and
    Weisbord's simplified formulas (1965; they print 2.57). Too compliant by t / 8R in rotation and in what follows from
    it, too stiff by about 0.4 t / R along.

    Examples
    --------
    >>> round(thin_neck(71e9, 10e-3, 0.5e-3, 2e-3).rotational_stiffness, 4)
    6.2778
    """
    _check(youngs_modulus=youngs_modulus, width=width, thickness=thickness, radius=radius)
    axial, slender = youngs_modulus * width, math.sqrt(radius / thickness)
    rotation = 9 * math.pi * slender / (2 * thickness**2 * axial)
    return EndCompliance(
        rotation=rotation,
        cross=radius * rotation,
        transverse=radius**2 * rotation + 3 * math.pi * slender**3 / (2 * axial),
        axial=(math.pi * slender - (1 + math.pi / 2)) / axial,
    )


def lobontiu_circular(youngs_modulus: float, width: float, thickness: float, radius: float) -> EndCompliance:
    """Return a right-circular notch: Lobontiu (2002), exact for Euler-Bernoulli beams; modulus in Pa, lengths in m.

    It is the corner-filleted hinge without a leaf between its fillets, l = 2 R.

    Examples
    --------
    >>> round(lobontiu_circular(71e9, 10e-3, 0.5e-3, 2e-3).rotational_stiffness, 4)
    6.4863
    """
    _check(radius=radius)
    return lobontiu_corner_filleted(youngs_modulus, width, thickness, 2 * radius, radius)


def lobontiu_corner_filleted(
    youngs_modulus: float, width: float, thickness: float, length: float, fillet: float
) -> EndCompliance:
    """Return a leaf with filleted corners: Lobontiu et al. (2001), exact for Euler-Bernoulli beams.

    Parameters
    ----------
    youngs_modulus
        E [Pa].
    width, thickness
        b and t, the leaf's [m].
    length
        l from block to block, fillets included [m].
    fillet
        r <= l / 2 [m]; for a sharp corner see `leaf`.
    """
    _check(youngs_modulus=youngs_modulus, width=width, thickness=thickness, length=length, fillet=fillet)
    if 2 * fillet > length * (1 + 1e-12):
        raise ValueError(f"fillet must be at most half the length {length!r} m, found {fillet!r}")
    # In thicknesses, and times E b, all four are pure numbers.
    r, l = fillet / thickness, length / thickness
    wide = 4 * r + 1
    arc = math.atan(math.sqrt(wide))
    quartic = -80 * r**4 + 24 * r**3 + 8 * (3 + 2 * math.pi) * r**2 + 4 * (1 + 2 * math.pi) * r + math.pi

    around = wide * (6 * r**2 + 4 * r + 1) + 6 * r * (2 * r + 1) ** 2 * math.sqrt(wide) * arc
    rotation = 12 * (l - 2 * r + 2 * r / ((2 * r + 1) * wide**3) * around)
    stretch = l - 2 * r + 2 * (2 * r + 1) / math.sqrt(wide) * arc - math.pi / 2
    transverse = 3 * (
        4 * (l - 2 * r) * (l**2 - l * r + r**2) / 3
        + quartic / (4 * wide**2)
        + (2 * r + 1) ** 3 * (6 * r**2 - 4 * r - 1) * arc / wide**2.5
        + (quartic / 2 + 8 * l * r**2 * (2 * r - 1)) / (2 * wide**2)
        + 4 * l**2 * r * (6 * r**2 + 4 * r + 1) / ((2 * r + 1) * wide**2)
        - (2 * r + 1) * (-24 * (l - r) ** 2 * r**2 - 8 * r**3 + 14 * r**2 + 8 * r + 1) * arc / wide**2.5
    )
    axial = youngs_modulus * width
    rotation /= axial * thickness**2
    return EndCompliance(rotation, length / 2 * rotation, transverse / axial, stretch / axial)


def wu_zhou(youngs_modulus: float, width: float, thickness: float, radius: float) -> tuple[float, float]:
    """Return rotation per moment [rad/(N m)] and stretch per force [m/N] of a right-circular notch.

    Wu and Zhou (2002), with s = R / t. Exact for Euler-Bernoulli beams; modulus in Pa, lengths in m.

    Examples
    --------
    >>> round(1 / wu_zhou(71e9, 10e-3, 0.5e-3, 2e-3)[0], 4)
    6.4863
    """
    _check(youngs_modulus=youngs_modulus, width=width, thickness=thickness, radius=radius)
    s = radius / thickness
    wide = 4 * s + 1
    arc = math.atan(math.sqrt(wide))
    rotation = 2 * s**3 * (6 * s**2 + 4 * s + 1) / ((2 * s + 1) * wide**2)
    rotation += 12 * s**4 * (2 * s + 1) / wide**2.5 * arc
    stretch = 2 * (2 * s + 1) / math.sqrt(wide) * arc - math.pi / 2
    axial = youngs_modulus * width
    return 12 * rotation / (axial * radius**2), stretch / axial


def elliptic(youngs_modulus: float, width: float, thickness: float, half_length: float, depth: float) -> EndCompliance:
    """Return an elliptic notch by its semi-axes along and across: exact for Euler-Bernoulli beams; Pa and m.

    Examples
    --------
    >>> round(elliptic(71e9, 10e-3, 0.5e-3, 2e-3, 2e-3).rotational_stiffness, 4)
    6.4863
    """
    _check(half_length=half_length)
    circle = lobontiu_circular(youngs_modulus, width, thickness, depth)
    longer = half_length / depth
    rotation = longer * circle.rotation
    about_middle = longer**3 * (circle.transverse - depth**2 * circle.rotation)
    return EndCompliance(
        rotation, half_length * rotation, half_length**2 * rotation + about_middle, longer * circle.axial
    )


def parabolic(youngs_modulus: float, width: float, thickness: float, half_length: float, depth: float) -> EndCompliance:
    """Return a parabolic notch by half length and depth of a side: exact for Euler-Bernoulli beams; Pa and m.

    With u = s / a and k = 2 c / t the height is t (1 + k u^2).
    """
    _check(youngs_modulus=youngs_modulus, width=width, thickness=thickness, half_length=half_length, depth=depth)
    k = 2 * depth / thickness
    arc = math.atan(math.sqrt(k)) / math.sqrt(k)
    axial = youngs_modulus * width
    bending = 24 * half_length / (axial * thickness**3)
    rotation = bending * (1 / (4 * (1 + k) ** 2) + 3 / (8 * (1 + k)) + 3 * arc / 8)
    about_middle = bending * half_length**2 * (arc + (k - 1) / (1 + k) ** 2) / (8 * k)
    return EndCompliance(
        rotation,
        half_length * rotation,
        half_length**2 * rotation + about_middle,
        2 * half_length * arc / (axial * thickness),
    )


def v_notch(
    youngs_modulus: float, width: float, thickness: float, half_length: float, depth: float, radius: float
) -> tuple[float, float]:
    """Return rotation per moment [rad/(N m)] and stretch per force [m/N] of a V with a rounded tip.

    The arc is Paros and Weisbord's; on the flanks the height goes with the distance. Exact for Euler-Bernoulli beams.

    Parameters
    ----------
    youngs_modulus
        E [Pa].
    width, thickness
        b and t, the neck's [m].
    half_length, depth, radius
        From the neck to an end along the hinge and across, and of the tip [m].
    """
    _check(youngs_modulus=youngs_modulus, width=width, thickness=thickness, half_length=half_length, depth=depth)
    notch = Notch.v(half_length, depth, radius)
    low, high = thickness + 2 * notch.rise(np.array([notch.arc_half, half_length]))
    rotation, stretch = paros_weisbord(youngs_modulus, width, thickness, radius, float(low))
    rising, axial = 2 * math.tan(notch.flank_angle), youngs_modulus * width
    rotation += 12 * float(low**-2 - high**-2) / (rising * axial)
    return rotation, stretch + 2 * math.log(high / low) / (rising * axial)


def _check(**sizes: float) -> None:
    """Raise a ValueError that names the first of `sizes` that is not a positive number."""
    for name, value in sizes.items():
        if not (value > 0 and math.isfinite(value)):
            raise ValueError(f"{name} must be positive and finite (SI units), found {value!r}")

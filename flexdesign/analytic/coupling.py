"""Coupling of second order between the axes of a stage: Lin et al. (2019), equations (23) to (25).

A branch chain of length L that is carried along sideways by the travel of one axis turns, and so draws its far end in
along another axis. The shortening is even in the travel and grows with its square: no linear model shows it, and the
coupling ratio, shortening over travel, grows with the travel. A ratio is therefore always one *at* a travel.

The paper evaluates the approximation (25); here the exact geometry, (23) with the sine of (24), is compared with it.
The approximation is too small by the share ``travel^2 / (4 L^2)``, to leading order.

Source: Lin, Yu, Wu, Shen (2019), Decoupling and control of micromotion stage based on hysteresis of piezoelectric
actuation, Microsystem Technologies.

>>> length = chain_length(ratio=0.00089, travel=80.92e-6)
>>> round(1e3 * length, 1)  # mm
45.5
"""

from __future__ import annotations

import math


def chain_rotation(length: float, travel: float) -> float:
    """Return beta, the rotation of a branch chain, with sin(beta) = travel / length [rad]: (24), not approximated.

    Parameters
    ----------
    length
        L of the chain [m].
    travel
        Motion of the driven axis, across the chain [m].

    Raises
    ------
    ValueError
        If the length is not positive, or the travel larger than it.
    """
    if not 0 < length < math.inf:
        raise ValueError(f"the length of a chain must be positive, found {length!r} m")
    if not abs(travel) <= length:
        raise ValueError(f"a chain of {length:.4g} m cannot follow a travel of {travel!r} m; it must be longer")
    return math.asin(travel / length)


def shortening(length: float, travel: float) -> float:
    """Return the coupled motion L (1 - cos(beta)) = 2 L sin^2(beta/2) [m]: Lin et al. (2019), eq. (23).

    The second form keeps its digits at small rotations, where the first is a difference of nearly equal numbers.

    Parameters
    ----------
    length, travel
        As `chain_rotation` takes them [m].

    Raises
    ------
    ValueError
        As `chain_rotation` does.
    """
    return 2 * length * math.sin(chain_rotation(length, travel) / 2) ** 2


def shortening_approximate(length: float, travel: float) -> float:
    """Return the coupled motion travel^2 / (2 L) [m], for small rotations: Lin et al. (2019), eq. (25)."""
    return travel**2 / (2 * length)


def coupling_ratio(length: float, travel: float) -> float:
    """Return the coupling ratio, `shortening` over the size of the travel; its limit 0 at rest.

    Lin et al. (2019), end of section 2.3, there in percent.

    Parameters
    ----------
    length, travel
        As `chain_rotation` takes them [m].

    Raises
    ------
    ValueError
        As `chain_rotation` does.
    """
    return shortening(length, travel) / abs(travel) if travel else 0.0


def chain_length(ratio: float, travel: float) -> float:
    """Return the length L at which a travel makes a coupling ratio [m]: the inverse of `coupling_ratio`.

    ``L - sqrt(L^2 - travel^2) = ratio travel`` solved for L: ``L = travel (1 + ratio^2) / (2 ratio)``. Without
    ``ratio^2`` it is (25) solved for L.

    Parameters
    ----------
    ratio
        Coupled motion over travel, more than 0 and at most 1 (the chain turned by a right angle).
    travel
        The travel at which the ratio holds [m]; its sign does not matter.

    Raises
    ------
    ValueError
        If the ratio is none that a chain can have, or the travel is zero.
    """
    if not 0 < ratio <= 1:
        raise ValueError(f"a coupling ratio is more than 0 and at most 1, found {ratio!r}")
    if not 0 < abs(travel) < math.inf:
        raise ValueError(f"a coupling ratio holds at a travel other than zero, found {travel!r} m")
    return abs(travel) * (1 + ratio**2) / (2 * ratio)

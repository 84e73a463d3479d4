"""The shape of a notch: how its sides rise from the neck to its ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from flexdesign.core.arrays import Array

NotchShape = Literal["circular", "elliptic", "parabolic", "v"]


@dataclass(frozen=True)
class Notch:
    """One side of a symmetric notch; the other is its mirror image.

    Parameters
    ----------
    shape
        ``circular``: an arc. ``elliptic``: half an ellipse. ``parabolic``: a parabola with its vertex at the neck.
        ``v``: two straight flanks, and an arc between them that touches both.
    half_length
        Distance from the neck to either end, along the hinge [m].
    depth
        Rise of the side from the neck to the ends [m].
    radius
        Radius of curvature at the neck [m]; the constructors of ellipse and parabola work it out.
    """

    shape: NotchShape
    half_length: float
    depth: float
    radius: float

    @classmethod
    def circular(cls, radius: float, half_length: float) -> Notch:
        """Return an arc; right-circular where the half length is the radius."""
        half_length = min(radius, half_length)
        return cls("circular", half_length, radius - math.sqrt(radius**2 - half_length**2), radius)

    @classmethod
    def elliptic(cls, half_length: float, depth: float) -> Notch:
        """Return half an ellipse, whose semi-axes are half length and depth."""
        return cls("elliptic", half_length, depth, half_length**2 / depth)

    @classmethod
    def parabolic(cls, half_length: float, depth: float) -> Notch:
        """Return a parabola."""
        return cls("parabolic", half_length, depth, half_length**2 / (2 * depth))

    @classmethod
    def v(cls, half_length: float, depth: float, radius: float) -> Notch:
        """Return two flanks that meet in an arc of a radius.

        Raises
        ------
        ValueError
            If the arc is longer than the notch.
        """
        largest = (half_length**2 + depth**2) / (2 * depth)
        if not 0 < radius < largest:
            raise ValueError(f"allowed: more than 0 mm and less than {1e3 * largest:.6g} mm, for an arc between flanks")
        return cls("v", half_length, depth, radius)

    @property
    def flank_angle(self) -> float:
        """Angle between the hinge's axis and the flanks of a V [rad].

        The arc ends where its slope is tan(theta); from there to the end the flank rises:
        r (1 - cos theta) + (a - r sin theta) tan theta = depth.
        """
        a, beyond = self.half_length, self.radius - self.depth
        return math.asin(self.radius / math.hypot(a, beyond)) - math.atan2(beyond, a)

    @property
    def arc_half(self) -> float:
        """Where the arc at the neck of a circular notch or a V ends, from the neck [m]."""
        return self.radius * math.sin(self.flank_angle) if self.shape == "v" else self.half_length

    def rise(self, s: Array) -> Array:
        """Return how far the side has risen at distances `s` from the neck [m]."""
        a, c, r = self.half_length, self.depth, self.radius
        s = np.minimum(np.abs(s), a)
        if self.shape == "parabolic":
            return np.asarray(c * (s / a) ** 2)
        if self.shape == "elliptic":
            return np.asarray(c * (1 - np.sqrt(1 - (s / a) ** 2)))
        on_arc = np.minimum(s, self.arc_half)
        arc = r - np.sqrt((r - on_arc) * (r + on_arc))
        return np.asarray(arc + (s - on_arc) * math.tan(self.flank_angle) if self.shape == "v" else arc)

    def slope(self, s: Array) -> Array:
        """Return how steeply the side rises at distances `s` from the neck; infinite where it stands upright."""
        a, c, r = self.half_length, self.depth, self.radius
        s = np.minimum(np.abs(s), a)
        if self.shape == "parabolic":
            return np.asarray(2 * c * s / a**2)
        with np.errstate(divide="ignore"):
            if self.shape == "elliptic":
                return np.asarray(c / a * (s / a) / np.sqrt(1 - (s / a) ** 2))
            s = np.minimum(s, self.arc_half)
            return np.asarray(s / np.sqrt((r - s) * (r + s)))

    def curvature_radius(self, s: Array) -> Array:
        """Return the radius of curvature of the side at distances `s` from the neck [m]; infinite on a flank."""
        s = np.minimum(np.abs(s), self.half_length)
        if self.shape == "parabolic":
            return np.asarray(self.radius * (1 + self.slope(s) ** 2) ** 1.5)
        if self.shape == "elliptic":
            a, c = self.half_length, self.depth
            inside = 1 - (s / a) ** 2
            return np.asarray(self.radius * (inside + (c * s / a**2) ** 2) ** 1.5)
        return np.where(s <= self.arc_half, self.radius, math.inf)

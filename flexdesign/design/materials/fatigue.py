"""Fatigue: what a specimen withstood, and how far a stress that swings about a mean stays from it.

The amplitude a material stands falls with the mean stress along a straight line through what was tested (Haigh's
diagram): with a slope M that a source states (Schütz 1967), or, without one, to the ultimate strength at no amplitude
(Goodman 1899),

    a(m) = S - M (m - m_S),    M = S / (R_m - m_S),    m_S = S (1 + R) / (1 - R).

A margin n scales amplitude and mean together up to that line: n a = S - M (n m - m_S).
"""

from __future__ import annotations

from flexdesign.core.toml_files import Table, in_si


class Fatigue(Table):
    """A strength under alternating stress.

    `strength` is the stress amplitude that the specimens stood for `cycles` at the stress ratio `stress_ratio`
    (least over largest stress, -1 for fully reversed). `mean_stress_sensitivity` is M where a source states one;
    `exponent` that of S-N curves S ~ N^b (Basquin). `specimen` says what was tested and how.
    """

    strength: in_si("Pa", 1e5, 1e10)  # type: ignore[valid-type]
    cycles: in_si("1", 1e3, 1e12)  # type: ignore[valid-type]
    stress_ratio: in_si("1", -1.0, 0.95)  # type: ignore[valid-type]
    mean_stress_sensitivity: in_si("1", 0.0, 2.0) | None = None  # type: ignore[valid-type]
    exponent: in_si("1", -1.0, 0.0) | None = None  # type: ignore[valid-type]
    specimen: str = ""
    source: str = ""

    @property
    def tested_mean(self) -> float:
        """Mean stress of the test [Pa]."""
        return float(self.strength * (1 + self.stress_ratio) / (1 - self.stress_ratio))

    def slope(self, ultimate_strength: float | None) -> float:
        """Return M, how fast the amplitude falls with the mean stress.

        Raises
        ------
        ValueError
            If neither a sensitivity nor an ultimate strength [Pa] above the mean of the test is known.
        """
        if self.mean_stress_sensitivity is not None:
            return float(self.mean_stress_sensitivity)
        if ultimate_strength is None or ultimate_strength <= self.tested_mean:
            raise ValueError("a mean stress asks for ultimate_strength (Goodman) or mean_stress_sensitivity")
        return float(self.strength / (ultimate_strength - self.tested_mean))

    def margin(self, amplitude: float, mean: float, ultimate_strength: float | None) -> float:
        """Return by what factor amplitude and mean stress [Pa] can grow together until the line is reached.

        A mean in compression is taken as none: it helps, but data rarely say by how much.

        >>> steel = Fatigue(strength="300 MPa", cycles=1e7, stress_ratio=-1.0)
        >>> steel.margin(100e6, 0.0, 900e6)
        3.0
        >>> round(1 / steel.margin(100e6, 300e6, 900e6), 4)  # Goodman: a/S + m/R_m
        0.6667
        """
        slope = self.slope(ultimate_strength)
        return float((self.strength + slope * self.tested_mean) / (amplitude + slope * max(mean, 0.0)))

"""Material data, each set with its source."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Material:
    """A linear elastic, isotropic material.

    Parameters
    ----------
    name
        Its designation.
    youngs_modulus
        E [Pa].
    poissons_ratio
        nu [1].
    density
        rho [kg/m^3].
    yield_strength
        Tensile yield strength, 0.2 % offset [Pa].
    source
        Where the numbers come from.
    """

    name: str
    youngs_modulus: float
    poissons_ratio: float
    density: float
    yield_strength: float
    source: str

    @property
    def shear_modulus(self) -> float:
        """G = E / 2(1 + nu) [Pa]."""
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))

    @property
    def lame(self) -> tuple[float, float]:
        """Lamé constants lambda and mu [Pa]."""
        nu = self.poissons_ratio
        return self.youngs_modulus * nu / ((1 + nu) * (1 - 2 * nu)), self.shear_modulus


_LIBRARY = (
    Material(
        "AZ31B", 45e9, 0.35, 1770.0, 150e6,
        "Lin et al. (2019) for E, nu, rho; yield of annealed sheet, ASM Handbook vol. 2, magnesium alloys",
    ),
    Material("Al 7075-T6", 71.7e9, 0.33, 2810.0, 503e6, "ASM Handbook vol. 2, aluminium 7075-T6, typical values"),
    Material("Ti-6Al-4V", 113.8e9, 0.342, 4430.0, 880e6, "ASM Handbook vol. 2, Ti-6Al-4V annealed, typical values"),
)  # fmt: skip

#: Materials by name.
LIBRARY = {material.name: material for material in _LIBRARY}

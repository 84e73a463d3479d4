"""A material as the engine uses it: elastic constants, density, strengths."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from flexdesign.core import units
from flexdesign.design.materials import crystal as crystals
from flexdesign.design.materials.crystal import Crystal, Vector
from flexdesign.design.materials.fatigue import Fatigue

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Material:
    """A linear elastic material.

    Parameters
    ----------
    name
        Its designation.
    youngs_modulus
        E [Pa]; of a crystal that along the part's x.
    poissons_ratio
        nu [1]; of a crystal that of tension along the part's x and contraction along y.
    density
        rho [kg/m^3].
    yield_strength
        Tensile yield strength, 0.2 % offset [Pa]; None for what breaks first, or where nothing is known.
    source
        Where the numbers come from.
    ultimate_strength
        Tensile strength [Pa], if known.
    fatigue
        What it stands under alternating stress, if a source states it.
    crystal
        Its elastic constants and orientation if it is a single crystal; None for an isotropic body.
    sources
        Sources of single numbers, by their names.
    note
        What the numbers hold for.
    """

    name: str
    youngs_modulus: float
    poissons_ratio: float
    density: float
    yield_strength: float | None
    source: str = ""
    ultimate_strength: float | None = None
    fatigue: Fatigue | None = None
    crystal: Crystal | None = None
    sources: Mapping[str, str] = field(default_factory=dict, hash=False)
    note: str = ""

    @property
    def shear_modulus(self) -> float:
        """G = E / 2(1 + nu) [Pa]; of a crystal that between the part's x and y."""
        if self.crystal is not None:
            return self.beam_moduli((1.0, 0.0, 0.0))[1]
        return self.youngs_modulus / (2 * (1 + self.poissons_ratio))

    @property
    def lame(self) -> tuple[float, float]:
        """Lamé constants lambda and mu [Pa].

        Raises
        ------
        TypeError
            If it is a crystal, which has none.
        """
        if self.crystal is not None:
            raise TypeError(f"{self.name} is a crystal and has no Lamé constants; use its elastic tensor")
        nu = self.poissons_ratio
        return self.youngs_modulus * nu / ((1 + nu) * (1 - 2 * nu)), self.shear_modulus

    @property
    def tensor(self) -> FloatArray:
        """Elastic stiffness C_ijkl in the part's axes, shape (3, 3, 3, 3) [Pa]."""
        return self.crystal.tensor if self.crystal is not None else crystals.isotropic(*self.lame)

    def beam_moduli(self, axis: Vector) -> tuple[float, float]:
        """Return E along a member's axis in the plane z = 0 and G of that axis and its normal in the plane [Pa]."""
        if self.crystal is None:
            return self.youngs_modulus, self.shear_modulus
        along = np.array(axis)
        young, _, shear = crystals.engineering(self.crystal.tensor, along, np.cross([0.0, 0.0, 1.0], along))
        return young, shear

    def mirrors_in(self, axis: int) -> bool:
        """Tell whether it is its own mirror image in the plane normal to the part's axis 0, 1 or 2."""
        if self.crystal is None:
            return True
        signs = np.where(np.arange(3) == axis, -1.0, 1.0)
        mirrored = np.einsum("i,j,k,l,ijkl->ijkl", signs, signs, signs, signs, self.tensor)
        return bool(np.abs(mirrored - self.tensor).max() < 1e-9 * self.tensor.max())

    @property
    def mechanics(self) -> list[object]:
        """What a solution depends on: the elastic constants and the density."""
        elastic = [self.youngs_modulus, self.poissons_ratio] if self.crystal is None else [self.tensor]
        return [*elastic, self.density]

    def fatigue_margin(self, amplitude: float, mean: float) -> float | None:
        """Return how far amplitude and mean stress [Pa] stay from the fatigue strength; None without data."""
        if self.fatigue is None:
            return None
        return self.fatigue.margin(amplitude, mean, self.ultimate_strength)

    def as_text(self) -> dict[str, object]:
        """Return its numbers with units, as result.json holds them, and its sources."""

        def stress(value: float | None) -> str | None:
            return None if value is None else units.to_text(value, "MPa", si="Pa")

        text: dict[str, object] = {
            "name": self.name,
            "youngs_modulus": units.to_text(self.youngs_modulus, "GPa", si="Pa"),
            "poissons_ratio": float(f"{self.poissons_ratio:.4g}"),
            "density": units.to_text(self.density, "kg/m^3"),
            "yield_strength": stress(self.yield_strength),
            "ultimate_strength": stress(self.ultimate_strength),
        }
        if self.crystal is not None:
            for name in ("c11", "c12", "c44"):
                text[name] = units.to_text(getattr(self.crystal, name), "GPa", 5, si="Pa")
            text["axes"] = [[float(f"{cosine:.6g}") for cosine in row] for row in self.crystal.cosines]
        if self.fatigue is not None:
            text["fatigue"] = {
                "strength": stress(self.fatigue.strength),
                "cycles": self.fatigue.cycles,
                "stress_ratio": self.fatigue.stress_ratio,
                "specimen": self.fatigue.specimen,
                "source": self.fatigue.source,
            }
        return {key: value for key, value in text.items() if value is not None} | {
            "source": self.source,
            "sources": dict(self.sources),
        }

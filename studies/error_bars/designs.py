"""Which bridge amplifiers are solved: drawn from a seed, out of the ranges in which they are built.

Half of them have leaves, sharp or rounded, half curved necks: right-circular notches, declared by their radius or as
two fillets, and leaves whose fillets take most of their length.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from flexdesign.core.errors import InputError
from flexdesign.design import study
from flexdesign.design.study import Study

SEED = 20_19
COUNT = 40
#: Metals, as Poisson's ratio has a part in the roots' stress.
METALS = ("Al 7075-T6", "AZ31B", "Ti-6Al-4V", "Steel 1.4310 full hard")
#: Every fourth design has no input rods, and every third has rounded roots.
WITHOUT_RODS, ROUNDED = 4, 3
#: Designs up to this number of hinge thicknesses wide are meshed with isotropic tetrahedra, too. Those are as short
#: along a root as across it: of wider parts there are too many for a study of forty.
WIDEST_UNSTRUCTURED = 20.0
DESIGN = "bridge_amplifier"
#: Of the curved designs, in turn: the part, and whether fillets leave nothing of the leaf.
PARTS = Path(__file__).parent / "parts"
NOTCHED, FILLETED = (str(PARTS / f"{name}_bridge.toml") for name in ("notched", "filleted"))
CURVED = ((NOTCHED, True), (NOTCHED, True), (FILLETED, True), (FILLETED, False))
#: Radii of curved necks, in their thicknesses, and the largest [mm].
RADII, LARGEST_RADIUS = (1.2, 10.0), 5.0


@dataclass(frozen=True)
class SampledDesign:
    """A design by its number.

    Parameters
    ----------
    number
        From 0.
    dimensions
        By name [mm].
    material
        Name of the metal.
    design
        The design whose dimensions are set.
    """

    number: int
    dimensions: Mapping[str, float]
    material: str
    design: str = DESIGN

    @property
    def curved(self) -> bool:
        """Whether the hinges have curved necks."""
        return self.design != DESIGN

    @property
    def rounded(self) -> bool:
        """Whether the hinge roots are rounded."""
        return self.dimensions["fillet_radius"] > 0

    @property
    def kind(self) -> str:
        """What its hinges are, in words."""
        if not self.curved:
            return "rounded roots" if self.rounded else "sharp roots"
        if self.design == NOTCHED:
            return "circular notches"
        whole = math.isclose(2 * self.dimensions["fillet_radius"], self.dimensions["hinge_length"])
        return "circular notches, declared as fillets" if whole else "long fillets"

    @property
    def is_unstructured(self) -> bool:
        """Whether it is meshed with isotropic tetrahedra, too."""
        return not self.curved and self.dimensions["width"] <= WIDEST_UNSTRUCTURED * self.dimensions["hinge_thickness"]

    def study(self, accuracy: float, method: str) -> Study:
        """Return the study that asks for an accuracy (relative) by a method; what it needs not do is left out.

        Raises
        ------
        InputError
            If the part refuses the dimensions.
        """
        settings: dict[str, Any] = {
            "material": self.material, "mesh.method": method, "mesh.accuracy": f"{100 * accuracy:g} %",
            "modes.count": 1, "output.large_steps": 0,
        }  # fmt: skip
        settings |= {f"dimensions.{name}": f"{value:.6g} mm" for name, value in self.dimensions.items()}
        return study.read(self.design, [f"{key}={value}" for key, value in settings.items()])

    def text(self) -> str:
        """Return what distinguishes it from the others."""
        d = self.dimensions
        root = f"R {d['fillet_radius']:.2g}" if self.rounded else "sharp"
        return (
            f"t {d['hinge_thickness']:.2f}, l {d['arm_span']:.1f} x {d['arm_offset']:.1f}, w {d['width']:.1f}, {root}"
        )


@cache
def designs(seed: int = SEED, count: int = COUNT) -> tuple[SampledDesign, ...]:
    """Draw designs until enough of them can be built."""
    rng = np.random.default_rng(seed)
    found: list[SampledDesign] = []
    while len(found) < count:
        number = len(found)
        kinds = {"rods": number % WITHOUT_RODS != WITHOUT_RODS - 1, "rounded": number % ROUNDED == ROUNDED - 1}
        sample = SampledDesign(number, _draw_dimensions(rng, **kinds), str(rng.choice(METALS)))
        try:
            sample.study(0.01, "auto")
        except InputError:
            continue
        found.append(sample)
    return tuple(found)


@cache
def curved_designs(seed: int = SEED, count: int = COUNT) -> tuple[SampledDesign, ...]:
    """Draw designs with curved necks until enough of them can be built; their numbers follow those of `designs`."""
    rng = np.random.default_rng(seed + 1)
    found: list[SampledDesign] = []
    while len(found) < count:
        number = len(found)
        design, whole = CURVED[number % len(CURVED)]
        rods = number % WITHOUT_RODS != number // WITHOUT_RODS % WITHOUT_RODS
        dimensions = _draw_curved_dimensions(rng, rods=rods, whole=whole)
        sample = SampledDesign(COUNT + number, dimensions, str(rng.choice(METALS)), design)
        try:
            sample.study(0.01, "auto")
        except InputError:
            continue
        found.append(sample)
    return tuple(found)


def _draw_curved_dimensions(rng: np.random.Generator, *, rods: bool, whole: bool) -> dict[str, float]:
    """Draw dimensions of a bridge with curved necks [mm]; bodies are large enough for the reference's patches."""
    even, even_logarithm = partial(_uniform, rng), partial(_log_uniform, rng)
    t = even_logarithm(0.2, 1.0)
    radius = float(f"{even_logarithm(RADII[0] * t, min(RADII[1] * t, LARGEST_RADIUS)):.4g}")
    leaf = 2 * radius * (1.0 if whole else even(1.1, 2.0))
    arm = (t + 2 * radius) * even(1.1, 1.5)
    rod = max(1.5, 0.75 * radius + 1.0) + even(0.0, 3.0)
    dimensions = {
        "arm_span": leaf + 1.5 * radius + even(5.0, 30.0),
        "arm_offset": even_logarithm(0.5, 6.0),
        "arm_thickness": arm,
        "hinge_length": leaf,
        "hinge_thickness": t,
        "width": even(5.0, 25.0),
        "rod_length": even(0.8, 2.0) * arm if rods else 0.0,
        "rod_thickness": rod,
        "input_block_height": even(2.2, 3.0) * arm,
        "input_block_depth": rod + even(1.0, 4.0),
        "block_width": 1.5 * radius + even(4.0, 12.0),
        "output_block_height": even(1.2, 2.0) * arm,
        "ground_block_height": even(1.2, 2.0) * arm,
        "fillet_radius": radius,
    }
    return {name: float(f"{value:.4g}") for name, value in dimensions.items()}


def _draw_dimensions(rng: np.random.Generator, *, rods: bool, rounded: bool) -> dict[str, float]:
    """Draw dimensions [mm]; those that scale stiffnesses by orders of magnitude have even logarithms."""
    even, even_logarithm = partial(_uniform, rng), partial(_log_uniform, rng)
    t = even_logarithm(0.2, 1.0)
    span = even(10.0, 40.0)
    arm = even(max(1.5, 2.5 * t), 5.0)
    leaf = even(2.5 * t, min(10 * t, 0.3 * span))
    rod = even(1.5, 5.0)
    radius = even_logarithm(max(0.1 * t, 0.05), 0.8 * t) if rounded else 0.0
    dimensions = {
        "arm_span": span,
        "arm_offset": even_logarithm(0.5, 6.0),
        "arm_thickness": arm,
        "hinge_length": leaf,
        "hinge_thickness": t,
        "width": even(5.0, 25.0),
        "rod_length": even(0.8 * arm, 15.0) if rods else 0.0,
        "rod_thickness": rod,
        "input_block_height": even(2.2 * arm, 16.0),
        "input_block_depth": rod + even(1.0, 4.0),
        "block_width": even(6.0, 16.0),
        "output_block_height": even(1.2 * arm, 10.0),
        "ground_block_height": even(1.2 * arm, 10.0),
        "fillet_radius": radius,
    }
    return {name: float(f"{value:.4g}") for name, value in dimensions.items()}


def _uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(rng.uniform(low, high))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))

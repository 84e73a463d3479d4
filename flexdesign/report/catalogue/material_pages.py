"""Pages of the material library: all materials in a table, or one with the source of every number."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexdesign.core import units
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.serialise import header
from flexdesign.design import materials
from flexdesign.design.materials import Crystal, Material
from flexdesign.report.document import Table
from flexdesign.report.wording import cycles

#: Directions of a crystal whose moduli are shown.
DIRECTIONS = ((1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0))


def find(name: str) -> Material:
    """Return a material by its name in the library or the path of its file.

    Raises
    ------
    InputError
        If there is none, or its file cannot be used.
    """
    known = materials.library()
    if name in known:
        return known[name]
    if name.endswith(".toml"):
        return materials.read(Path(name))
    raise InputError("command line", "materials", name, f"is not in the library{suggest(name, list(known))}")


def catalogue() -> Table:
    """Return the library: what a flexure designer compares materials by.

    sigma_y / E is the strain at yield: how far a hinge of given length and thickness bends.
    """
    rows = []
    for name, m in materials.library().items():
        strain = f"{1e3 * m.yield_strength / m.youngs_modulus:.1f}" if m.yield_strength else "–"
        fatigue = f"{_stress(m.fatigue.strength)} at {cycles(m.fatigue.cycles)}" if m.fatigue else "–"
        rows.append(
            [name, _modulus(m.youngs_modulus), units.to_text(m.density, "kg/m^3"), _stress(m.yield_strength), strain,
             fatigue]
        )  # fmt: skip
    columns = ["material", "E", "density", "yield", "1000 σ_y/E", "fatigue amplitude"]
    return Table(columns, rows, "flexdesign materials NAME shows one with its sources")


def validity(material: Material) -> list[str]:
    """Say what the numbers hold for."""
    sentences = [f"{material.note[:1].upper()}{material.note[1:]}."] if material.note else []
    if material.crystal is not None:
        sentences.append(_orientation(material.crystal))
    return sentences


def numbers(material: Material) -> Table:
    """Return every number of a material with its source."""

    def row(name: str, text: str, key: str) -> list[str]:
        return [name, text, material.sources.get(key, material.source) or "not stated"]

    rows = [row("density", units.to_text(material.density, "kg/m^3"), "density")]
    if material.crystal is None:
        rows.insert(0, row("Poisson's ratio", f"{material.poissons_ratio:g}", "poissons_ratio"))
        rows.insert(0, row("Young's modulus E", _modulus(material.youngs_modulus), "youngs_modulus"))
    else:
        rows = [*_of_crystal(material, material.crystal), *rows]
    if material.yield_strength is not None:
        rows.append(row("yield strength", _stress(material.yield_strength), "yield_strength"))
    if material.ultimate_strength is not None:
        rows.append(row("tensile strength", _stress(material.ultimate_strength), "ultimate_strength"))
    return Table(["property", "value", "source"], [*rows, *_of_fatigue(material)])


def result(name: str | None) -> dict[str, Any]:
    """Return the library, or one material, as result.json has it."""
    listed = materials.library().values() if name is None else [find(name)]
    return {**header("materials"), "materials": {m.name: m.as_text() for m in listed}}


def _of_crystal(material: Material, crystal: Crystal) -> list[list[str]]:
    rows = [
        [key, units.to_text(getattr(crystal, key), "GPa", 5, si="Pa"), material.sources.get(key, material.source)]
        for key in ("c11", "c12", "c44")
    ]
    for direction in DIRECTIONS:
        index = "".join(f"{i:g}" for i in direction)
        rows.append([f"E along <{index}>", _modulus(crystal.along(direction)), "from c11, c12, c44"])
    along = "from them, as the part lies"
    rows.append(["E along the part's x", _modulus(material.youngs_modulus), along])
    rows.append(["Poisson's ratio, x to y", f"{material.poissons_ratio:.3f}", along])
    rows.append(["shear modulus of x and y", _modulus(material.shear_modulus), along])
    return rows


def _of_fatigue(material: Material) -> list[list[str]]:
    data = material.fatigue
    if data is None:
        return [["fatigue strength", "–", "no public source that states cycles and stress ratio is known here"]]
    rows = [["fatigue amplitude", _stress(data.strength), data.source or "not stated"]]
    rows.append(["after", f"{cycles(data.cycles)} cycles at a stress ratio of {data.stress_ratio:g}", data.specimen])
    if data.exponent is not None:
        rows.append(["S-N exponent", f"{data.exponent:g}", data.source])
    if data.mean_stress_sensitivity is not None:
        rows.append(["mean stress sensitivity", f"{data.mean_stress_sensitivity:g}", data.source])
    else:
        slope = f"{data.slope(material.ultimate_strength):.3f}"
        rows.append(["mean stress sensitivity", slope, "Goodman's line to the tensile strength"])
    return rows


def _orientation(crystal: Crystal) -> str:
    axes = ", ".join(
        f"{axis} along [{' '.join(f'{cosine:.3g}' for cosine in row)}]"
        for axis, row in zip("xyz", crystal.cosines + 0.0, strict=True)
    )
    return f"The part lies in the crystal with {axes}; Zener's ratio is {crystal.anisotropy:.3f}."


def _stress(value: float | None) -> str:
    return "–" if value is None else units.to_text(value, "MPa", si="Pa")


def _modulus(value: float) -> str:
    return units.to_text(value, "GPa", si="Pa")

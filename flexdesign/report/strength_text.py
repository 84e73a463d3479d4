"""What the report of a validation says of strength: the material's data, the peak of stress, where the energy sits."""

from __future__ import annotations

from flexdesign.core import units
from flexdesign.design.materials import Material
from flexdesign.fem import quantities
from flexdesign.fem.post_processing.stress import SINGULAR, growth
from flexdesign.report.document import Table
from flexdesign.report.wording import REGIONS, cycles
from flexdesign.workflows.validation import Validation

#: What the load cases of the energies are called.
CASES = {
    "K_in_output_free": "actuator force, output free",
    "K_out_input_free": "output force, input free",
    "K_out_input_held": "output force, input held",
}


def strengths(material: Material) -> list[str]:
    """Say what the material stands, where that comes from, and what is not known."""
    return [_static(material), _fatigue(material)]


def _static(material: Material) -> str:
    if material.yield_strength is None:
        note = f" ({material.note})" if material.note else ""
        return f"No yield strength of {material.name} is known, so that no safety is stated{note}."
    strength = units.to_text(material.yield_strength, "MPa", 3, si="Pa")
    source = material.sources.get("yield_strength", material.source)
    return f"Yield strength of {material.name}: {strength} ({source})."


def _fatigue(material: Material) -> str:
    data = material.fatigue
    if data is None:
        return f"No fatigue data of {material.name} are known, so that no safety against fatigue is stated."
    strength = units.to_text(data.strength, "MPa", 3, si="Pa")
    if data.mean_stress_sensitivity is not None or material.ultimate_strength is None:
        line = f"a mean stress takes {data.slope(None):.2g} of itself from that"
    else:
        ultimate = units.to_text(material.ultimate_strength, "MPa", 3, si="Pa")
        line = f"Goodman's line falls from there to the tensile strength, {ultimate}, at no amplitude"
    specimen = f"; {data.specimen}" if data.specimen else ""
    return (
        f"Fatigue strength: amplitude {strength} at {cycles(data.cycles)} cycles, stress ratio {data.stress_ratio:g}"
        f"{specimen} ({data.source}); {line}. The actuator swings between no drive and the stated one while the "
        "preload stays; the safety is the factor by which amplitude and mean can grow together. The data hold for "
        "smooth specimens: they leave out roughness and the recast layer of spark erosion."
    )


def _fillet_key(validation: Validation) -> str:
    """Return where a design gives its roots fillets, in brackets; nothing where a part has no key for it."""
    part_class = validation.study.design.part_class
    if hasattr(part_class, "plan"):
        return " (fillet of a flexure)"
    named = any(parameter.name == "fillet_radius" for parameter in part_class.dimensions)
    return " (dimensions.fillet_radius)" if named else ""


def peak(validation: Validation) -> str:
    """Say whether the peak of stress is a property of the design."""
    sizes = [level.size for level in validation.levels]
    peaks = [quantities.hinge_peak(level.solution) for level in validation.levels]
    seen = ", ".join(f"{value / peaks[-1]:.2f}" for value in peaks)
    if validation.sharp:
        return (
            "The hinge roots are drawn sharp, and there the stress of linear elasticity grows without bound as the "
            f"mesh is refined: here as h^{-growth(peaks, sizes):.2f} (peaks of these meshes relative to the finest: "
            f"{seen}), in the end as h^{-SINGULAR:.2f} (Williams 1952). The peak is no property of the design and has "
            "neither error nor safety. Judge by the nominal hinge stress, or give the roots the fillet that the cutter "
            f"will leave{_fillet_key(validation)}."
        )
    if validation.unresolved_fillet:
        return f"{validation.unresolved_fillet} Peaks of these meshes relative to the finest: {seen}."
    return (
        "The roots are round, and the peak approaches a limit (peaks of these meshes relative to the finest: "
        f"{seen}). Its value is that of the finest mesh, its error what the mesh before leaves to it if errors "
        "fall with the square root of the edge length (straight edges make a polygon of a curve, and peaks on it "
        "converge slowly), or, if larger, what the meshes before that leave to it with the first power. Finer meshes "
        "(mesh.at_root) narrow it."
    )


def shares(validation: Validation) -> dict[str, dict[str, float]]:
    """Return which part of the strain energy each region holds, by load case, extrapolated."""
    if not validation.has_members:
        return {}
    found = quantities.energy_shares(validation.finest.solution)
    return {
        key: {
            region: validation.limit(lambda s, k=key, r=region: quantities.energy_shares(s)[k][r]).value  # type: ignore[misc]
            for region in split
        }
        for key, split in found.items()
    }


def energies(validation: Validation) -> Table:
    """Return the shares as a table."""
    found = shares(validation)
    regions = [region for region in REGIONS if any(region in split for split in found.values())]
    rows = [
        [REGIONS[region], *(f"{100 * split.get(region, 0.0):.1f} %" for split in found.values())] for region in regions
    ]
    return Table(["strain energy in", *(CASES[key] for key in found)], rows, "Which region holds the strain energy")

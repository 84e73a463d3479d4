"""Which members carry the compliances, and which regions the strain energy."""

from __future__ import annotations

import numpy as np

from flexdesign.design.materials import Material
from flexdesign.fem.analysis import Solution
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.post_processing import resultants


def compliance_shares(material: Material, body: Domain, solution: Solution) -> dict[str, dict[str, float]]:
    """Split the compliances that the stiffnesses are the inverse of over the members, by the stiffness's key.

    With the input held, a unit output force comes with the input force -C12 / C11 that holds it: the load case is
    the one less that multiple of the other.
    """
    images = {section.member.name: _images(section, body) for section in solution.input_sections}
    c = solution.compliance
    inputs, outputs = solution.input_sections, solution.output_sections
    held = [o.minus(c.c12 / c.c11, i) for o, i in zip(outputs, inputs, strict=True)]
    cases = {
        "K_in_output_free": (inputs, c.c11),
        "K_out_input_free": (outputs, c.c22),
        "K_out_input_held": (held, c.c22 - c.c12**2 / c.c11),
    }
    return {
        key: resultants.shares((sections, sections), total, material, images)
        for key, (sections, total) in cases.items()
    }


def _images(section: resultants.Section, body: Domain) -> int:
    """How many members of the whole part a member of the domain represents: one more for each plane it lies off."""
    return int(np.prod([1 if abs(section.member.centre[plane.index]) < 1e-12 else 2 for plane in body.planes]))


def energy_shares(solution: Solution) -> dict[str, dict[str, float]]:
    """Return which part of the strain energy each region holds, for the load cases of `compliance_shares`.

    With the input held, a unit output force comes with the input force -C12 / C11.
    """
    c = solution.compliance
    cases = {
        "K_in_output_free": (1.0, 0.0),
        "K_out_input_free": (0.0, 1.0),
        "K_out_input_held": (-c.c12 / c.c11, 1.0),
    }
    shares = {}
    for key, (a, b) in cases.items():
        held = {region: a * a * u + 2 * a * b * v + b * b * w for region, (u, v, w) in solution.energies.items()}
        shares[key] = {region: energy / sum(held.values()) for region, energy in held.items()}
    return shares

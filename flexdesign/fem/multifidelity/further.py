"""What is asked of a design besides stiffness: modes, lateral motions and stress, of all symmetry classes.

They take several times as long as input and output alone, so that they are found only if asked for: on the coarse mesh,
by all quantities of `quantities.of_solution`, and corrected like the stiffnesses by the error known at an anchor,

    q* = q_B exp(g),   g = ln(q* / q_B)  at the anchor.

How g changes is not seen from a second coarse mesh here: off the anchors half of it is in doubt, and all of it in
lateral motions, small differences that few layers resolve. Frequencies were off by a twentieth of it, the coupling of
an actuator off its axis by half of it and more. What vanishes by symmetry, or changes too much from the coarse to the
fine meshes to be corrected, is left as it is, without an estimate.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from flexdesign.core.model import Quantity, by_key
from flexdesign.design.design import Design
from flexdesign.design.part import Part
from flexdesign.design.study import MeshSettings, ModeSettings, OutputSettings, Study
from flexdesign.fem import analysis, mesh_refinement
from flexdesign.fem.convergence import MeshNoise
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.mesh import TaggedMesh
from flexdesign.fem.quantities import of_solution

#: What a corrected quantity says of itself.
MORPHED = "FEM, coarse mesh corrected by the error of its neighbours'"
#: How the names of lateral motions begin.
LATERAL = ("coupling", "tilt", "table", "sensor")
#: Largest correction, relative: more than the stiffnesses of hinges are off on the coarsest mesh.
MOST = 0.15


@dataclass(frozen=True)
class Known:
    """What an anchor knows.

    Parameters
    ----------
    gaps, errors
        By the quantity's key g and the relative half-width of q*, of those that can be corrected.
    """

    gaps: Mapping[str, float] = field(default_factory=dict)
    errors: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class AdditionalQuantities:
    """What is asked besides.

    Parameters
    ----------
    modes
        How many modes are sought in each symmetry class.
    output
        What happens at the output.
    """

    modes: int
    output: OutputSettings = field(default_factory=OutputSettings)

    def on(self, mesh: TaggedMesh, design: Design, part: Part, domain: Domain) -> dict[str, Quantity]:
        """Return every quantity of a mesh by its key."""
        asked = ModeSettings(count=self.modes)
        study = Study(design.file, design.name, design, MeshSettings(), asked, self.output)
        actuator = design.actuator.installed_stiffness if design.actuator else 0.0
        solution = analysis.solve(part, design.material, domain, mesh, actuator=actuator, mode_count=self.modes)
        return by_key(of_solution(study, solution))

    def anchor_errors(
        self,
        coarse: Mapping[str, Quantity],
        fine: Sequence[Mapping[str, Quantity]],
        sizes: Sequence[float],
        scatter: MeshNoise,
    ) -> Known:
        """Return the error of an anchor's coarse mesh, from fine ones of edge lengths `sizes` [m] at the roots."""
        gaps, errors = {}, {}
        for limit in mesh_refinement.extrapolate_quantities(fine, sizes, scatter):
            here = coarse[limit.key].value if limit.key in coarse else 0.0
            if here * limit.value > 0 and abs(gap := math.log(limit.value / here)) < MOST:
                gaps[limit.key] = gap
                errors[limit.key] = (limit.half_width or 0.0) / abs(limit.value)
        return Known(gaps, errors)

    def correct(
        self, found: Mapping[str, Quantity], known: Sequence[Known], weights: Sequence[float], changed: float
    ) -> list[Quantity]:
        """Correct what one mesh gave, by anchors of these weights; their errors may have `changed`, relative."""
        corrected = []
        for key, quantity in found.items():
            if not all(key in anchor.gaps for anchor in known):
                corrected.append(replace(quantity, source="FEM, coarse mesh, not corrected"))
                continue
            gap = sum(weight * anchor.gaps[key] for weight, anchor in zip(weights, known, strict=True))
            error = sum(weight * anchor.errors[key] for weight, anchor in zip(weights, known, strict=True))
            value = quantity.value * math.exp(gap)
            doubt = (1.0 if quantity.name.startswith(LATERAL) else 0.5) * abs(gap) if changed else 0.0
            sigma = math.hypot(error, changed, doubt) * abs(value)
            corrected.append(replace(quantity, value=value, half_width=sigma, source=MORPHED))
        return corrected

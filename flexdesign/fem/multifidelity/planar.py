"""The planar evaluator: an extruded mechanism in plane stress, on a section mesh that moves from design to design."""

from __future__ import annotations

from dataclasses import replace

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.design.design import Design
from flexdesign.design.study import MeshSettings, OutputSettings
from flexdesign.fem.meshing.mesh import MeshError
from flexdesign.fem.meshing.methods import Extruded
from flexdesign.fem.meshing.morphing import Pattern
from flexdesign.fem.meshing.planar import Triangulation
from flexdesign.fem.multifidelity import extrusion
from flexdesign.fem.quantities import of_compliance
from flexdesign.fem.solving.plane_stress import Plate

#: How coarse the section's mesh is, as `Extruded` takes it; what it leaves open the correction takes along.
COARSENESS = 2.46


class Planar:
    """An evaluator of designs in plane stress; it keeps the triangles of the sections that it meets.

    Parameters
    ----------
    mesh
        How the section is graded.
    output
        What happens at the output, of which only the load counts here.
    coarseness
        Of the section's mesh; 1 is the finest of `validate`.
    """

    def __init__(
        self, mesh: MeshSettings | None = None, output: OutputSettings | None = None, coarseness: float = COARSENESS
    ) -> None:
        self.mesh, self.output, self.coarseness = mesh or MeshSettings(), output or OutputSettings(), coarseness
        self.patterns: list[Pattern] = []

    def evaluate(self, design: Design) -> list[Quantity]:
        """Return the quantities of `quantities.of_compliance`, without an estimate of their error.

        Raises
        ------
        InputError
            If the design cannot be built or its section not be meshed.
        """
        part, domain = extrusion.of_design(design)
        method = extrusion.method(part, domain, self.mesh)
        try:
            known = len(self.patterns)
            plan = self._plan(method)
            if len(self.patterns) > known:
                extrusion.require_solid(design, part, domain)
        except MeshError as error:
            raise InputError(design.file, "mesh", None, str(error)) from error
        compliance = Plate(domain, plan, design.material).compliance(part.ports())
        found = of_compliance(compliance, design.actuator, self.output.load)
        return [replace(quantity, source="planar FEM, plane stress") for quantity in found]

    def _plan(self, method: Extruded) -> Triangulation:
        """Return the triangles of a neighbour, moved, or new ones."""
        size = method.planar_size(self.coarseness)
        for pattern in self.patterns:
            try:
                return pattern.morph(method.section, size)
            except MeshError:
                continue
        self.patterns.append(Pattern(method.section, size, method.plan(self.coarseness)))
        return self.patterns[-1].morph(method.section, size)

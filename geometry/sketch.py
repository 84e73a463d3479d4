"""A planar mechanism that the design file itself draws: bodies, flexures, ground, inputs, output.

The tables are described in `flexdesign.design.sketch.reading`; geometry/sketches has examples. Everything that a part
offers follows from them: solid, section, ports, symmetry, linkage, and three models. In the ``rigid-body model``
flexures are beams between rigid bodies with masses; ``PRB`` has hinges that only rotate, and is left out where a
mechanism cannot move that way; ``compliance`` has the compliance of everything that is drawn.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar

from flexdesign.analytic import rigid_bodies
from flexdesign.analytic.compliance import ComplianceModel, nominal_effects
from flexdesign.analytic.rigid_bodies import RigidBodies
from flexdesign.core.model import Formulas, Linkage, Parameter, Quantity
from flexdesign.design.materials import Material
from flexdesign.design.part import Axis, Outline, Port, SymmetryPlane
from flexdesign.design.sketch import Plan, Section
from flexdesign.design.sketch import linkage as linkages


class Sketch:
    """A mechanism by the values of its dimensions [SI]; a design makes it a class of its own, with a plan."""

    dimensions: ClassVar[tuple[Parameter, ...]] = ()
    plan: ClassVar[Plan]

    @classmethod
    def planned(cls, plan: Plan) -> type[Sketch]:
        """Return the class of the mechanism that a plan draws."""
        own = {"plan": plan, "dimensions": plan.dimensions, "drawn_as": repr(plan.tables), "__module__": cls.__module__}
        if not plan.tables.of_role("input"):  # a joint: nothing drives it
            own["left_out"] = frozenset({"formulas", "formula_shares", "intermediates"})
        return type("Sketch", (cls,), own)

    def __init__(self, **dimensions: float) -> None:
        self.values = dimensions
        self.drawing = self.plan.at(dimensions)
        self.section = Section(self.drawing)

    def solid(self) -> Any:
        """Return the plate as one closed solid [mm]."""
        return self.section.solid()

    def outline(self) -> Outline | None:
        """Return the section by its corners; None with notches or fillets."""
        return self.section.outline()

    def notes(self) -> tuple[str, ...]:
        """Return which leaves are too stout for the models."""
        stout = [
            f"{flexure.name} ({1e3 * flexure.thickness:.4g} mm thick on {1e3 * flexure.length:.4g} mm of length)"
            for flexure in self.drawing.stout_leaves()
        ]
        if not stout:
            return ()
        return (f"The models take flexures for slender beams, which these are not: {', '.join(stout)}. Trust FEM.",)

    def prismatic(self) -> Axis:
        """Return z: the mechanism is cut from a plate."""
        return "z"

    def ports(self) -> tuple[Port, ...]:
        """Return inputs, output and ground."""
        return self.drawing.ports

    def symmetry(self) -> tuple[SymmetryPlane, ...]:
        """Return the symmetry planes that were found."""
        return self.section.symmetry()

    def linkage(self) -> Linkage:
        """Return flexures, arms and blocks as members between nodes; of a joint none, which is solved as a solid."""
        return self._linkage if self.drawing.carried_by("input") else Linkage({}, ())

    @cached_property
    def _linkage(self) -> Linkage:
        return linkages.linkage(self.section)

    def rigid_bodies(self, material: Material) -> RigidBodies:
        """Return the bodies as rigid, with the flexures as springs between them."""
        return rigid_bodies.of_drawing(self.drawing, self._linkage, material)

    def coupling(self, material: Material) -> Mapping[tuple[str, str], float]:
        """Return how far the output of one axis moves per extension of another's actuator, all else free.

        By the names of the axis that is driven and the one that moves; of an axis with itself it is the amplification.
        """
        axes = {axis: rigid_bodies.of_drawing(self.plan.at(self.values, axis), self._linkage, material)
                for axis in self.plan.axes}  # fmt: skip
        return rigid_bodies.coupling(axes)

    def formulas(
        self, material: Material, actuator_stiffness: float | None, output_load: float | None
    ) -> Mapping[str, Sequence[Quantity]]:
        """Return the quantities of the three models; none has a formula of its own."""

        def pivots() -> Sequence[Quantity]:
            return tuple(ComplianceModel.of_part(self, material, actuator_stiffness).quantities().values())

        def rigid() -> Sequence[Quantity]:
            return self.rigid_bodies(material).quantities(actuator_stiffness, output_load)

        def compliant() -> Sequence[Quantity]:
            model = ComplianceModel.of_part(self, material, actuator_stiffness)
            return tuple(model.having(nominal_effects(self)).quantities().values())

        springs = any(self.drawing.is_spring(flexure) for flexure in self.drawing.flexures.values())
        suffice = not springs and rigid_bodies.pivots_suffice(self._linkage, self.ports())
        by_pivots = {"PRB": pivots} if suffice else {}
        return Formulas({"rigid-body model": rigid, **by_pivots, "compliance": compliant})

    def formula_shares(self, material: Material) -> Mapping[str, Mapping[str, float]]:
        """Return what the compliances of the rigid bodies consist of [m/N]."""
        return self.rigid_bodies(material).shares()

    def intermediates(self, material: Material, force: float) -> Mapping[str, Quantity]:
        """Return nothing: there is no formula to follow step by step."""
        return {}

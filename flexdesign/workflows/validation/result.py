"""What a validation finds, and what made it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from flexdesign.core.model import Quantity
from flexdesign.design.study import Study
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.fem import convergence, mesh_refinement, quantities
from flexdesign.fem.analysis import Solution
from flexdesign.fem.large_stroke import LargeStroke
from flexdesign.fem.mesh_refinement import Level
from flexdesign.fem.meshing.domain import Domain
from flexdesign.fem.meshing.methods import Method
from flexdesign.fem.post_processing import stress
from flexdesign.workflows.validation.cross_check import CrossCheck
from flexdesign.workflows.validation.independent_mesh import IndependentCheck
from flexdesign.workflows.validation.model_hierarchy import ModelHierarchy


@dataclass(frozen=True)
class Comparison:
    """One quantity as the analytic models and FEM see it.

    Parameters
    ----------
    fem
        From FEM, extrapolated, with its discretisation error as sigma.
    analytic
        The same quantity from each analytic model that has it, by the model's name.
    """

    fem: Quantity
    analytic: Mapping[str, Quantity]

    def error(self, model: str) -> float | None:
        """Return the model's relative deviation from FEM, or None where it has no such quantity."""
        if model not in self.analytic or self.fem.value == 0:
            return None
        return self.analytic[model].value / self.fem.value - 1


@dataclass(frozen=True)
class Validation:
    """Everything a validation found.

    Parameters
    ----------
    study
        What was asked.
    domain, method, levels
        The fundamental domain, how it was meshed, and its meshes, coarse to fine.
    comparisons
        Table 1: FEM and the analytic models.
    further
        Quantities only FEM gives: stroke, load line, modes, coupling, stress.
    shares
        Where the compliances sit [m/N]: by the stiffness's key, what each kind of member and deformation carries.
    formula_shares
        The same as the first analytic model sees it.
    large
        What large displacements do on the way to full drive; None if they were not followed.
    hierarchy
        The way from the pseudo-rigid model to FEM; None for a part that the compliance model cannot take.
    cross_check
        The part solved in other ways, too; None if nobody asked.
    independent
        One mesh of another mesher; None if nobody wants it, or that mesher made all meshes.
    stage_model
        What dynamics needs; None without an actuator.
    seconds
        Wall time of the run.
    """

    study: Study
    domain: Domain
    method: Method
    levels: Sequence[Level]
    comparisons: Sequence[Comparison]
    further: Sequence[Quantity]
    shares: Mapping[str, Mapping[str, float]]
    formula_shares: Mapping[str, Mapping[str, float]]
    large: LargeStroke | None
    hierarchy: ModelHierarchy | None
    cross_check: CrossCheck | None
    independent: IndependentCheck | None
    stage_model: StageModel | None
    seconds: float

    @property
    def methods(self) -> set[str]:
        """Names of the methods that made meshes, of the checks too."""
        others = {way.method for way in self.cross_check.others} if self.cross_check else set()
        return {self.method.name, *others, *(["wild"] if self.independent else [])}

    @property
    def solvers(self) -> set[str]:
        """What solved the equations."""
        return {level.solution.facts["solver"] for level in self.levels}

    @property
    def finest(self) -> Level:
        """The finest mesh."""
        return self.levels[-1]

    @property
    def sharp(self) -> bool:
        """Whether hinge roots are sharp, so that the stress there grows without bound under refinement."""
        if self.domain.thin is not None:
            return self.domain.thin.is_sharp
        return any(stress.is_sharp(hinge) for hinge in self.study.design.part().linkage().of_kind("hinge"))

    @property
    def unresolved_fillet(self) -> str:
        """What is said of a fillet next to a thin region that the finest mesh does not follow; empty if it does.

        Of a part with sharp roots nothing is said: its peak has no limit at all.
        """
        return "" if self.sharp else quantities.unresolved_fillet(self.finest.solution)

    @property
    def has_input(self) -> bool:
        """Whether there are inputs, which an actuator can part; a joint has none."""
        return self.levels[-1].solution.compliance.has_input

    @property
    def has_members(self) -> bool:
        """Whether the part names hinges, arms and rods."""
        return bool(self.study.design.part().linkage().members)

    def limit(self, value: Callable[[Solution], float]) -> convergence.Extrapolated:
        """Extrapolate a number that every mesh's solution gives."""
        sizes = [level.size for level in self.levels]
        values = [value(level.solution) for level in self.levels]
        return convergence.extrapolate(values, sizes, mesh_noise=self.method.scatter)

    @property
    def modal(self) -> Level:
        """The finest mesh on which modes were sought."""
        return next(level for level in reversed(self.levels) if level.solution.modes)

    @property
    def estimated_error(self) -> float:
        """The largest relative error of stiffnesses and amplification, as estimated."""
        return mesh_refinement.estimated_error(self.found)

    @property
    def found(self) -> list[Quantity]:
        """Every quantity of FEM, whether formulas have it or not."""
        return [*(comparison.fem for comparison in self.comparisons), *self.further]

    @property
    def extrapolation(self) -> str:
        """How the limit for vanishing element size and its error were found, in words."""
        return convergence.describe(self.method.scatter)

    def fem(self, key: str) -> Quantity:
        """Return a FEM quantity by its key, e.g. ``K_in_output_free``."""
        for quantity in self.found:
            if quantity.key == key:
                return quantity
        raise KeyError(key)

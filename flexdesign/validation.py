"""Validation: from a design through solid, meshes and solves to FEM and formulas side by side.

Meshes and solutions are cached by content, so that an interrupted run resumes where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Any

from flexdesign import large_stroke, quantities, refinement, versions
from flexdesign import part as parts
from flexdesign.cache import Cache, content_key
from flexdesign.design import Design
from flexdesign.errors import InputError
from flexdesign.fem import convergence, domain, stress
from flexdesign.fem.analysis import Solution
from flexdesign.fem.domain import Domain
from flexdesign.fem.load_path import StrokePath
from flexdesign.fem.methods import Method
from flexdesign.files import as_text
from flexdesign.large_stroke import LargeStroke
from flexdesign.model import Quantity
from flexdesign.refinement import LIBRARIES, Level
from flexdesign.stage_model import StageModel
from flexdesign.study import Study

Progress = Callable[[str], None]


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
        Table 1: FEM beside the analytic models.
    further
        Quantities only FEM gives: stroke, load line, modes, coupling, stress.
    shares
        Where the compliances sit [m/N]: by the stiffness's key, what each kind of member and deformation carries.
    formula_shares
        The same as the first analytic model sees it.
    large
        What large displacements do on the way to full drive; None if they were not followed.
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
    stage_model: StageModel | None
    seconds: float

    @property
    def finest(self) -> Level:
        """The finest mesh."""
        return self.levels[-1]

    @property
    def sharp(self) -> bool:
        """Whether hinge roots are sharp, so that the stress there grows without bound under refinement."""
        return _sharp(self.study.design.part())

    def limit(self, value: Callable[[Solution], float]) -> convergence.Extrapolated:
        """Extrapolate a number that every mesh's solution gives."""
        sizes = [level.size for level in self.levels]
        values = [value(level.solution) for level in self.levels]
        return convergence.extrapolate(values, sizes, scatter=self.method.scatter)

    @property
    def modal(self) -> Level:
        """The finest mesh on which modes were sought."""
        return next(level for level in reversed(self.levels) if level.solution.modes)

    @property
    def estimated_error(self) -> float:
        """The largest relative error of stiffnesses and amplification, as estimated."""
        return refinement.estimated_error([comparison.fem for comparison in self.comparisons])

    @property
    def extrapolation(self) -> str:
        """How the limit for vanishing element size and its error were found, in words."""
        low, high = convergence.ORDERS
        return convergence.DESCRIPTION.format(low=low, high=high, scatter=100 * self.method.scatter)

    def fem(self, key: str) -> Quantity:
        """Return a FEM quantity by its key, e.g. ``K_in_output_free``."""
        for quantity in (*(c.fem for c in self.comparisons), *self.further):
            if quantity.key == key:
                return quantity
        raise KeyError(key)


def validate(study: Study, cache: Cache, progress: Progress = lambda _: None) -> Validation:
    """Run a validation.

    Parameters
    ----------
    study
        What to validate.
    cache
        Where meshes and solutions are looked up and kept.
    progress
        Is told what is going on.

    Raises
    ------
    InputError
        If the solid, a port or a mesh cannot be used.
    """
    began = perf_counter()
    design = study.design
    part = design.part()
    progress("building the solid")
    thinnest = min(hinge.thickness for hinge in part.linkage().of_kind("hinge"))
    try:
        mirrors = all(design.material.mirrors_in(plane.index) for plane in part.symmetry())  # a crystal may not
        body = domain.of_part(part, symmetric=mirrors, chord=thinnest / 100)
    except InputError as error:
        file = parts.file_of(type(part)) if error.file == "part" else error.file
        raise InputError(file, error.field, error.value, error.remedy) from error
    method = refinement.method_of(study, part, body)
    levels = refinement.refined(study, part, body, method, cache, progress)
    gathered = refinement.gathered(study, levels, method.scatter)
    comparisons, further = _compare(design, part, study.output.load, gathered)
    large = _large(study, part, body, levels[0], cache, progress)
    further += large.quantities() if large else []
    return Validation(
        study=study,
        domain=body,
        method=method,
        levels=levels,
        comparisons=comparisons,
        further=further,
        shares=_shares(design, body, levels),
        formula_shares=part.formula_shares(design.material),
        large=large,
        stage_model=quantities.stage_model(
            design,
            {q.key: q for q in further} | {c.fem.key: c.fem for c in comparisons},
            next(level.solution for level in reversed(levels) if level.solution.modes),
            large.effects() if large else {},
        ),
        seconds=perf_counter() - began,
    )


# --- from meshes to quantities ----------------------------------------------------------------------------------


def _sharp(part: parts.Part) -> bool:
    return any(stress.is_sharp(hinge) for hinge in part.linkage().of_kind("hinge"))


def _large(
    study: Study, part: parts.Part, body: Domain, level: Level, cache: Cache, progress: Progress
) -> LargeStroke | None:
    """Follow large displacements to full drive; None without an actuator, for a crystal, or if nobody wants it."""
    material, actuator, steps = study.design.material, study.design.actuator, study.output.large_steps
    if actuator is None or material.crystal is not None or steps == 0:
        return None
    stiffness, free = actuator.installed_stiffness, actuator.free_stroke
    ports = [vars(port) for port in part.ports()]
    mesh_key = content_key(*level.mesh.arrays().values())
    key = content_key(refinement.engine(), mesh_key, material.mechanics, stiffness, free, steps, ports)
    if (stored := cache.load("large", key)) is not None:
        return LargeStroke(StrokePath(**stored[0]), stiffness, free)

    def say(text: str) -> None:
        progress(f"large displacements: {text}")

    linear = level.solution.compliance
    found = large_stroke.follow(part, material, body, level.mesh, linear, stiffness, free, steps, say)
    cache.store("large", key, dict(vars(found.path)), {})
    return found


def _shares(design: Design, body: Domain, levels: Sequence[Level]) -> dict[str, dict[str, float]]:
    """Extrapolate every piece of the compliances; as that is linear, the pieces still add up."""
    sizes = [level.size for level in levels]
    found = [quantities.compliance_shares(design.material, body, level.solution) for level in levels]
    return {
        key: {p: convergence.extrapolate([f[key][p] for f in found], sizes).value for p in found[-1][key]}
        for key in found[-1]
    }


def _compare(
    design: Design, part: parts.Part, load: float | None, gathered: Sequence[Quantity]
) -> tuple[list[Comparison], list[Quantity]]:
    stiffness = design.actuator.installed_stiffness if design.actuator else None
    given = part.formulas(design.material, stiffness, load)
    formulas = {model: {q.key: q for q in found} for model, found in given.items()}
    comparisons, further = [], []
    for quantity in gathered:
        analytic = {model: found[quantity.key] for model, found in formulas.items() if quantity.key in found}
        if analytic:
            comparisons.append(Comparison(quantity, analytic))
        else:
            further.append(quantity)
    return comparisons, further


# --- provenance -------------------------------------------------------------------------------------------------


def provenance(study: Study) -> dict[str, Any]:
    """Return the inputs and versions that made a result."""
    design = study.design
    return {
        "design": design.name,
        "title": design.title,
        "provenance": design.provenance,
        "part": f"{design.part_class.__name__} ({parts.source_hash(design.part_class)})",
        "dimensions": {name: f"{value * 1e3:g} mm" for name, value in design.dimensions.items()},
        "material": design.material.as_text(),
        "actuator": as_text(design.actuator) if design.actuator else None,
        "mesh": as_text(study.mesh),
        "modes": as_text(study.modes),
        "output": as_text(study.output),
        "versions": versions.installed(LIBRARIES),
    }

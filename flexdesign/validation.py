"""Validation: from a design through solid, meshes and solves to FEM and formulas side by side.

Meshes and solutions are cached by content, so that an interrupted run resumes where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from flexdesign import part as parts
from flexdesign import quantities, units, versions
from flexdesign.cache import Cache, content_key
from flexdesign.design import Design
from flexdesign.errors import InputError
from flexdesign.fem import analysis, convergence, domain, gate, mesh, sizing
from flexdesign.fem.analysis import Solution
from flexdesign.fem.domain import Domain
from flexdesign.fem.gate import HingeCheck
from flexdesign.fem.mesh import MeshError, TaggedMesh
from flexdesign.files import as_text
from flexdesign.model import Member, Quantity
from flexdesign.stage_model import StageModel
from flexdesign.study import MeshSettings, Study

Progress = Callable[[str], None]

#: Distributions whose versions travel with every result.
LIBRARIES = ("cadquery", "pytetwild", "scikit-fem", "numpy", "scipy", "pypardiso", "pyvista", "meshio")


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
class Level:
    """One mesh and its solution.

    Parameters
    ----------
    size
        Mean length of its edges near the hinge roots [m]: the mesher follows the sizing field loosely, so that
        extrapolation goes by what is measured.
    mesh, solution
        The mesh of the fundamental domain, and what it gave.
    hinges
        What the mesh gate measured.
    seconds
        Wall time for mesh and solution; those of the run that made them, if cached.
    cached
        Whether the solution came from the cache.
    """

    size: float
    mesh: TaggedMesh
    solution: Solution
    hinges: Sequence[HingeCheck]
    seconds: float
    cached: bool


@dataclass(frozen=True)
class Validation:
    """Everything a validation found.

    Parameters
    ----------
    study
        What was asked.
    domain, levels
        The fundamental domain and its meshes, coarse to fine.
    comparisons
        Table 1: FEM beside the analytic models.
    further
        Quantities only FEM gives: stroke, load line, modes, coupling, stress.
    shares
        Where the compliances sit [m/N]: by the stiffness's key, what each kind of member and deformation carries.
    formula_shares
        The same as the first analytic model sees it.
    stage_model
        What dynamics needs; None without an actuator.
    seconds
        Wall time of the run.
    """

    study: Study
    domain: Domain
    levels: Sequence[Level]
    comparisons: Sequence[Comparison]
    further: Sequence[Quantity]
    shares: Mapping[str, Mapping[str, float]]
    formula_shares: Mapping[str, Mapping[str, float]]
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
        return convergence.extrapolate([value(level.solution) for level in self.levels], sizes)

    @property
    def modal(self) -> Level:
        """The finest mesh on which modes were sought."""
        return next(level for level in reversed(self.levels) if level.solution.modes)

    @property
    def extrapolation(self) -> str:
        """How the limit for vanishing element size and its error were found, in words."""
        low, high = convergence.ORDERS
        return convergence.DESCRIPTION.format(low=low, high=high, scatter=100 * convergence.SCATTER)

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
        body = domain.of_part(part, chord=thinnest / 100)
    except InputError as error:
        file = parts.file_of(type(part)) if error.file == "part" else error.file
        raise InputError(file, error.field, error.value, error.remedy) from error
    coarseness = [study.mesh.refinement**k for k in reversed(range(study.mesh.levels))]
    levels = [_level(study, part, body, factor, cache, progress) for factor in coarseness]
    gathered = _gather(study, levels)
    comparisons, further = _compare(design, part, study.output.load, gathered)
    return Validation(
        study=study,
        domain=body,
        levels=levels,
        comparisons=comparisons,
        further=further,
        shares=_shares(design, body, levels),
        formula_shares=part.formula_shares(design.material),
        stage_model=quantities.stage_model(
            design,
            {q.key: q for q in further} | {c.fem.key: c.fem for c in comparisons},
            next(level.solution for level in reversed(levels) if level.solution.modes),
        ),
        seconds=perf_counter() - began,
    )


# --- one mesh ---------------------------------------------------------------------------------------------------


def _level(study: Study, part: parts.Part, body: Domain, coarseness: float, cache: Cache, progress: Progress) -> Level:
    design = study.design
    began = perf_counter()
    leaves = part.linkage().of_kind("hinge")
    try:
        tagged, mesh_key = _mesh(study.mesh, part, body, coarseness, cache, progress)
        hinges = gate.check(tagged, body, leaves)
    except MeshError as error:
        raise InputError(design.file, "mesh", None, str(error)) from error
    actuator = design.actuator.installed_stiffness if design.actuator else 0.0
    # Lateral motions and modes converge sooner: with three meshes the finest goes without them.
    all_classes = coarseness > 1.0 or study.mesh.levels == 2
    count = study.modes.count if all_classes else 0
    material = design.material
    key = content_key(
        _engine(), mesh_key, vars(material), actuator, count, all_classes, versions.installed(LIBRARIES),
        [vars(port) for port in part.ports()], [vars(member) for member in part.linkage().members],
        [vars(plane) for plane in body.planes],
    )  # fmt: skip
    reach = min(leaf.thickness for leaf in leaves) / 2
    size = sizing.edge_length_at_roots(tagged.points, tagged.tets, sizing.root_edges(leaves, body)[0], reach)
    stored = cache.load("solution", key)
    if stored is not None:
        solution = Solution.from_store(*stored, part)
        return Level(size, tagged, solution, hinges, float(stored[1]["seconds"]), cached=True)

    def say(text: str) -> None:
        progress(f"solving: {text}")

    solution = analysis.solve(
        part, material, body, tagged, actuator=actuator, mode_count=count, all_classes=all_classes, progress=say
    )
    seconds = perf_counter() - began
    arrays, table = solution.to_store()
    cache.store("solution", key, arrays, table | {"seconds": seconds})
    return Level(size, tagged, solution, hinges, seconds, cached=False)


def _mesh(
    settings: MeshSettings, part: parts.Part, body: Domain, coarseness: float, cache: Cache, progress: Progress
) -> tuple[TaggedMesh, str]:
    """Return the mesh and the hash of its content (the mesher is not deterministic: its input does not identify it)."""
    hinges = part.linkage().of_kind("hinge")
    roots, owners = sizing.root_edges([*hinges, *part.linkage().of_kind("rod")], body)
    field = sizing.Sizing(
        roots=roots,
        at_roots=np.array([settings.at_root * coarseness * _resolved(owner) for owner in owners]),
        growth=settings.growth * coarseness,
        largest=coarseness * (settings.largest or _largest(part)),
    )
    envelope = settings.envelope * min(hinge.thickness for hinge in hinges)
    asked = (field.roots, field.at_roots, field.growth, field.largest, envelope)
    question = content_key(_engine(), body.fingerprint, *asked, versions.installed(LIBRARIES))
    stored = cache.load("mesh", question)
    if stored is not None:
        tagged = TaggedMesh(**stored[0])
    else:
        progress(f"meshing with {field.finest * 1e3:.3g} mm at the hinge roots")
        tagged = mesh.tetrahedralize(body, field, envelope)
        cache.store("mesh", question, tagged.arrays(), {})
    return tagged, content_key(*tagged.arrays().values())


def _resolved(member: Member) -> float:
    """Return the length that `mesh.at_root` counts in: a hinge's thickness, or less where fillets must be resolved.

    Arms and rods, stout and few, are resolved twice as finely for little cost, so that the hinges' error is left.
    """
    if member.kind != "hinge":
        return member.thickness / 2
    return min(0.6 * member.thickness, 1.5 * member.root_radius) if member.root_radius > 0 else member.thickness


def _largest(part: parts.Part) -> float:
    """Return the default of `mesh.largest`: arms and rods bend and stretch too, and want quadratic elements' due."""
    return 0.4 * min(m.thickness for m in part.linkage().members if m.kind in ("arm", "rod", "guide"))


def _sharp(part: parts.Part) -> bool:
    return any(hinge.root_radius == 0 for hinge in part.linkage().of_kind("hinge"))


# --- from meshes to quantities ----------------------------------------------------------------------------------


def _gather(study: Study, levels: Sequence[Level]) -> list[Quantity]:
    """Extrapolate every quantity over the meshes that know it; what grows without bound stays as the finest has it."""
    found = [{q.key: q for q in quantities.of_solution(study, level.solution)} for level in levels]
    gathered = []
    for key, quantity in found[0].items():
        if quantity.source == quantities.UNBOUNDED:
            gathered.append(found[-1][key])
            continue
        known = [(level, there[key].value) for level, there in zip(levels, found, strict=True) if key in there]
        limit = convergence.extrapolate([value for _, value in known], [level.size for level, _ in known])
        finest = known[-1][0].solution.facts["unknowns"]
        source = f"FEM, {len(known)} meshes to {finest} unknowns, extrapolated"
        gathered.append(replace(quantity, value=limit.value, source=source, sigma=limit.error))
    return gathered


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


@cache
def _engine() -> str:
    """Return a hash of the code that makes meshes and solutions, lest results of other code be taken for its."""
    sources = sorted(Path(analysis.__file__).parent.glob("*.py"))
    return content_key([source.read_text(encoding="utf-8") for source in sources])


def provenance(study: Study) -> dict[str, Any]:
    """Return the inputs and versions that made a result."""
    design = study.design
    return {
        "design": design.name,
        "title": design.title,
        "provenance": design.provenance,
        "part": f"{design.part_class.__name__} ({parts.source_hash(design.part_class)})",
        "dimensions": {name: f"{value * 1e3:g} mm" for name, value in design.dimensions.items()},
        "material": {
            "name": design.material.name,
            "youngs_modulus": units.to_text(design.material.youngs_modulus, "GPa", si="Pa"),
            "poissons_ratio": design.material.poissons_ratio,
            "density": units.to_text(design.material.density, "kg/m^3"),
            "yield_strength": units.to_text(design.material.yield_strength, "MPa", si="Pa"),
            "source": design.material.source,
        },
        "actuator": as_text(design.actuator) if design.actuator else None,
        "mesh": as_text(study.mesh),
        "modes": as_text(study.modes),
        "output": as_text(study.output),
        "versions": versions.installed(LIBRARIES),
    }

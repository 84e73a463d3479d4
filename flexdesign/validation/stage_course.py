"""The course of a stage's validation: parts, condensed mesh by mesh, put together, driven, and compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

from flexdesign import condensing, refinement, stage_coupling, units, versions
from flexdesign import part as parts
from flexdesign.assembly import Assembly
from flexdesign.cache import Cache
from flexdesign.condensing import StageLevel
from flexdesign.design import Design
from flexdesign.errors import InputError, suggest
from flexdesign.fem import second_order
from flexdesign.fem.assembled import AssembledStage
from flexdesign.fem.convergence import SCATTER, Scatter
from flexdesign.fem.corotated import CorotatedStage, NoEquilibrium
from flexdesign.fem.methods import Extruded
from flexdesign.files import as_text
from flexdesign.model import Quantity
from flexdesign.quantities.stage import of_stage
from flexdesign.quantities.stage_handover import stage_model_of
from flexdesign.stage_coupling import Cause, CrossMotion
from flexdesign.stage_model import StageModel
from flexdesign.study import Study
from flexdesign.validation.findings import Comparison

Progress = Callable[[str], None]


@dataclass(frozen=True)
class StageValidation:
    """Everything a stage's validation found.

    Parameters
    ----------
    study, assembly
        What was asked, and of what.
    levels
        The parts, on meshes from coarse to fine.
    stages
        Put together on the coarsest mesh, which is the one for pictures and large displacements, and on the finest.
    comparisons
        Stiffness, amplification and coupling: FEM beside the analytic models and published numbers.
    further
        Quantities only FEM gives.
    motions
        Each axis driven through large displacements; empty where those were not asked for.
    causes
        Of coupling of first order.
    variants
        By name what else was solved on the coarsest mesh, relative to the stage itself on that mesh, by key.
    stage_model
        What dynamics needs; None without an actuator.
    seconds
        Wall time of the run.
    """

    study: Study
    assembly: Assembly
    levels: Sequence[StageLevel]
    stages: tuple[AssembledStage, AssembledStage]
    comparisons: Sequence[Comparison]
    further: Sequence[Quantity]
    motions: Sequence[CrossMotion]
    causes: Sequence[Cause]
    variants: Mapping[str, Mapping[str, float]]
    stage_model: StageModel | None
    seconds: float

    @property
    def finest(self) -> StageLevel:
        """The finest mesh."""
        return self.levels[-1]

    def fem(self, key: str) -> Quantity:
        """Return a FEM quantity by its key, e.g. ``K_in_x_table_free``."""
        for quantity in (*(c.fem for c in self.comparisons), *self.further):
            if quantity.key == key:
                return quantity
        raise KeyError(key)


def validate_stage(study: Study, cache: Cache, progress: Progress = lambda _: None) -> StageValidation:
    """Run the validation of a stage.

    Parameters
    ----------
    study
        What to validate.
    cache
        Where meshes and condensed parts are looked up and kept.
    progress
        Is told what is going on.

    Raises
    ------
    InputError
        If a part, its mesh, or a published number cannot be used.
    """
    began, design = perf_counter(), study.design
    assembly = design.stage().assembly()
    _refuse_unknown(study, assembly)
    levels = _levels(study, assembly, cache, progress)
    stages = [_assembled(design, assembly, level) for level in levels]
    progress("putting the stage together")
    found = [{q.key: q for q in of_stage(study, stage)} for stage in stages]
    limits = refinement.limits(found, [level.size for level in levels], _scatter(levels))
    source = f"FEM, {len(levels)} meshes, the finest of {levels[-1].unknowns} unknowns condensed, extrapolated"
    limits = [replace(quantity, source=source) for quantity in limits]
    motions = _motions(study, assembly, levels[0], stages[0], progress)
    comparisons, further = _compare(study, limits, motions)
    known = {q.key: q for q in limits}
    return StageValidation(
        study=study,
        assembly=assembly,
        levels=levels,
        stages=(stages[0], stages[-1]),
        comparisons=comparisons,
        further=further,
        motions=motions,
        causes=stage_coupling.causes(stages[-1]),
        variants=_variants(study, found[0], cache, progress),
        stage_model=stage_model_of(design, stages[-1], known, stage_coupling.ratios(motions)),
        seconds=perf_counter() - began,
    )


def _levels(study: Study, assembly: Assembly, cache: Cache, progress: Progress) -> list[StageLevel]:
    """Condense on as many meshes as were asked for; the coarsest keeps what goes on inside."""
    levels = []
    for power in range(study.mesh.levels - 1, -1, -1):
        coarseness, first = study.mesh.refinement**power, power == study.mesh.levels - 1
        say = _counted(progress, study.mesh.levels - power, study.mesh.levels)
        levels.append(condensing.condensed(study, assembly, coarseness, cache, inside=first, progress=say))
    return levels


def _counted(progress: Progress, number: int, of: int) -> Progress:
    return lambda text: progress(f"mesh {number} of {of}: {text}")


def _assembled(design: Design, assembly: Assembly, level: StageLevel) -> AssembledStage:
    return AssembledStage(assembly, level.parts, design.material.density)


def _scatter(levels: Sequence[StageLevel]) -> Scatter:
    """Return that of extruded meshes, unless a part was meshed the other way, whose scatter is larger."""
    return SCATTER if any("wild" in kind.method for kind in levels[0].kinds) else Extruded.scatter


def _motions(
    study: Study, assembly: Assembly, level: StageLevel, linear: AssembledStage, progress: Progress
) -> list[CrossMotion]:
    if not study.output.large_steps:
        return []
    progress("integrating second order")
    energies = {id(kind.part): second_order.of(kind.part) for kind in level.kinds}
    stage = CorotatedStage(assembly, {name: energies[id(part)] for name, part in level.parts.items()})
    motions = []
    for axis in assembly.axes:
        progress(f"large displacements: driving {axis} both ways")
        extension = study.stage.inputs.get(axis) or _half_stroke(study)
        try:
            motions.append(stage_coupling.cross_motion(stage, linear, axis, extension))
        except NoEquilibrium as error:
            value = units.to_text(extension, "um", si="m")
            raise InputError(study.design.file, f"stage.inputs.{axis}", value, str(error)) from error
    return motions


def _half_stroke(study: Study) -> float:
    actuator = study.design.actuator
    return actuator.free_stroke / 2 if actuator else 10e-6


def _compare(
    study: Study, limits: Sequence[Quantity], motions: Sequence[CrossMotion]
) -> tuple[list[Comparison], list[Quantity]]:
    """Set FEM beside formulas and published numbers where there are any; the rest stands for itself."""
    design = study.design
    actuator = design.actuator.installed_stiffness if design.actuator else None
    models = {
        model: {q.key: q for q in found}
        for model, found in design.stage().formulas(design.material, actuator, None).items()
    }
    arms = design.stage().arms()
    aside: dict[str, Quantity] = {}
    for motion in motions:
        for to, length in stage_coupling.coupling_by_arms(motion.travel, arms, motion.axis).items():
            fem = next(q for q in motion.quantities() if q.name == f"coupling_{to}")
            aside[fem.key] = replace(
                fem, value=length / motion.travel, source="delta^2 / 2L, Lin et al. (2019), eq. (25)"
            )
    models["arms (25)"] = aside
    every = [*limits, *(q for motion in motions for q in motion.quantities())]
    by_key = {quantity.key: quantity for quantity in every}
    for label, numbers in study.published.items():
        models[label] = {key: _published(study, label, key, text, by_key) for key, text in numbers.items()}
    compared = [q for q in every if any(q.key in model for model in models.values())]
    comparisons = [Comparison(q, {name: m[q.key] for name, m in models.items() if q.key in m}) for q in compared]
    return comparisons, [q for q in every if q not in compared]


def _published(study: Study, label: str, key: str, text: str, known: Mapping[str, Quantity]) -> Quantity:
    """Read a number of others by the quantity it is compared with."""
    place = f"published.{label}.{key}"
    if key not in known:
        remedy = f"is no quantity of this stage{suggest(key, sorted(known))}"
        raise InputError(study.name, place, text, remedy)
    fem = known[key]
    try:
        value = units.from_text(text, fem.si)
    except ValueError as error:
        raise InputError(study.name, place, text, str(error)) from None
    return replace(fem, value=value, sigma=None, source=label)


def _refuse_unknown(study: Study, assembly: Assembly) -> None:
    for axis in study.stage.inputs:
        if axis not in assembly.axes:
            remedy = f"is no axis of this stage{suggest(axis, list(assembly.axes))}"
            raise InputError(study.name, f"stage.inputs.{axis}", axis, remedy)


def _variants(
    study: Study, found: Mapping[str, Quantity], cache: Cache, progress: Progress
) -> dict[str, dict[str, float]]:
    """Return each variant's quantities relative to the stage's own, on the coarsest mesh, by key."""
    ratios = {}
    for label, design in study.variants.items():
        other = replace(study, design=design)
        assembly = design.stage().assembly()
        coarseness = study.mesh.refinement ** (study.mesh.levels - 1)
        say = _labelled(progress, label)
        level = condensing.condensed(other, assembly, coarseness, cache, inside=True, progress=say)
        there = {q.key: q.value for q in of_stage(other, _assembled(design, assembly, level))}
        ratios[label] = {k: v / found[k].value for k, v in there.items() if k in found and not math.isclose(v, 0.0)}
    return ratios


def _labelled(progress: Progress, label: str) -> Progress:
    return lambda text: progress(f"variant {label}: {text}")


def provenance(study: Study) -> dict[str, Any]:
    """Return the inputs and versions that made a result."""
    design = study.design
    lengths = {p.name: p for p in design.part_class.dimensions}
    return {
        "design": design.name,
        "title": design.title,
        "provenance": design.provenance,
        "stage": f"{design.part_class.__name__} ({parts.source_hash(design.part_class)})",
        "dimensions": {
            name: f"{value * 1e3:g} mm" if lengths[name].si == "m" else f"{value:g}"
            for name, value in design.dimensions.items()
        },
        "material": design.material.as_text(),
        "actuator": as_text(design.actuator) if design.actuator else None,
        "mesh": as_text(study.mesh),
        "inputs": as_text(study.stage),
        "variants": list(study.variants),
        "versions": versions.installed(refinement.LIBRARIES),
    }

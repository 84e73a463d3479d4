"""The course of a stage's validation: parts, condensed mesh by mesh, put together, driven, and compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

from flexdesign.analytic import static_model
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.result_cache import Cache
from flexdesign.design import part as parts
from flexdesign.design.assembly import Assembly
from flexdesign.design.design import Design
from flexdesign.design.study import Study
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.fem import cross_axis_coupling, mesh_refinement, stage_condensation
from flexdesign.fem.convergence import MeshNoise
from flexdesign.fem.cross_axis_coupling import Cause, CrossMotion
from flexdesign.fem.quantities import stage_shares
from flexdesign.fem.quantities.stage import REPORTED_MODES
from flexdesign.fem.quantities.stage_modes import ModeShares, mode_shares
from flexdesign.fem.quantities.stage_shares import InputChain, Spring
from flexdesign.fem.stage_condensation import StageLevel
from flexdesign.fem.superelements.assembled_stage import AssembledStage
from flexdesign.workflows.validation import model_hierarchy, stage_drives
from flexdesign.workflows.validation.model_hierarchy import ModelHierarchy
from flexdesign.workflows.validation.result import Comparison
from flexdesign.workflows.validation.stage_model_from_stage import stage_model_of
from flexdesign.workflows.validation.stage_published import input_motion, read_published
from flexdesign.workflows.validation.stage_variants import variant_quantities

Progress = Callable[[str], None]

#: Number of the coarsest meshes for large displacements and variants.
DRIVEN = 2


@dataclass(frozen=True)
class StageValidation:
    """Everything a stage's validation found.

    Parameters
    ----------
    study, assembly
        What was asked, and of what.
    levels
        The parts, on meshes from coarse to fine.
    comparisons
        Stiffness, amplification and coupling: FEM, the analytic models and published numbers.
    further
        Quantities only FEM gives.
    motions
        Each axis driven through large displacements on the coarsest mesh; empty where those were not asked for.
    at_full_stroke
        The same with inputs that part by the free extension of the actuator; empty without an actuator.
    causes
        Of coupling of first order.
    springs, chains
        By axis what gives way, on the finest mesh.
    modes
        The lowest without actuators and, where there are any, with them, on the finest mesh.
    coarsest
        Quantities on the coarsest mesh, by key.
    variants
        By name and key what variants make of the stage's quantities.
    hierarchy
        From the pseudo-rigid stage to FEM, effect by effect; None where the parts are no frame.
    stage_model
        What dynamics needs; None without an actuator.
    seconds
        Wall time of the run.
    """

    study: Study
    assembly: Assembly
    levels: Sequence[StageLevel]
    comparisons: Sequence[Comparison]
    further: Sequence[Quantity]
    motions: Sequence[CrossMotion]
    at_full_stroke: Sequence[CrossMotion]
    causes: Sequence[Cause]
    springs: Mapping[str, Sequence[Spring]]
    chains: Mapping[str, InputChain]
    modes: tuple[Sequence[ModeShares], Sequence[ModeShares]]
    coarsest: Mapping[str, Quantity]
    variants: Mapping[str, Mapping[str, Quantity]]
    hierarchy: ModelHierarchy | None
    stage_model: StageModel | None
    seconds: float

    @property
    def finest(self) -> StageLevel:
        """The finest mesh."""
        return self.levels[-1]

    @property
    def stages(self) -> tuple[AssembledStage, AssembledStage]:
        """Put together on the coarsest mesh, which is the one for pictures, and on the finest."""
        return self.levels[0].stage, self.levels[-1].stage

    @property
    def inputs(self) -> dict[str, float]:
        """By axis how far each actuator parts its inputs where coupling and pictures are stated [m]."""
        return {axis: input_motion(self.study, axis) for axis in self.assembly.axes}

    @property
    def scatter(self) -> MeshNoise:
        """That of the meshes, by which results are extrapolated."""
        return stage_condensation.mesh_noise_of(self.levels)

    def fem(self, key: str) -> Quantity:
        """Return a FEM quantity by its key, e.g. ``K_in_x_table_free``."""
        for quantity in (*(c.fem for c in self.comparisons), *self.further):
            if quantity.key == key:
                return quantity
        raise KeyError(key)

    def as_in(self, variant: str, key: str) -> float | None:
        """Return a quantity as a variant has it, in SI; None for what the variant lacks."""
        found = self.variants[variant].get(key)
        return None if found is None else found.value


def validate_stage(study: Study, cache: Cache, progress: Progress = lambda _: None) -> StageValidation:
    """Run the validation of a stage.

    Parameters
    ----------
    study
        What to validate.
    cache
        Where meshes and condensed parts are looked up and kept.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If a part, its mesh, or a published number cannot be used.
    """
    began, design = perf_counter(), study.design
    assembly = design.stage().assembly()
    _refuse_unknown(study, assembly)
    _examine(design)
    published = read_published(study, assembly)
    levels = stage_condensation.refine(study, assembly, cache, progress, interior=DRIVEN)
    finest = levels[-1].stage
    found, sizes = [level.found for level in levels], [level.size for level in levels]
    limits = stage_condensation.gather_quantities(levels)
    driven = [
        stage_drives.Driven(
            study, level, cache, stage_condensation.with_label(progress, f"mesh {number} of {len(levels)}")
        ).motions()
        for number, level in enumerate(levels[:DRIVEN], 1)
    ]
    motions, full = driven[0]
    motions_found = [{**here, **_moved([*near, *far])} for here, (near, far) in zip(found, driven, strict=False)]
    motion_quantities = _moved([*motions, *full])
    source = f"FEM, large displacements on the {DRIVEN} coarsest of {len(levels)} meshes, extrapolated"
    limits += [
        replace(q, source=source)
        for q in mesh_refinement.extrapolate_quantities(
            motions_found, sizes[:DRIVEN], stage_condensation.mesh_noise_of(levels)
        )
        if q.key in motion_quantities
    ]
    comparisons, further = compare(study, limits, [*motions, *full], published)
    variants = {label: _variant(study, label, cache, progress) for label in study.variants}
    progress("compliance model, effect by effect")
    rungs = model_hierarchy.model_hierarchy(design, by_key(limits))
    spring = design.actuator.installed_stiffness if design.actuator else 0.0
    return StageValidation(
        study=study,
        assembly=assembly,
        levels=levels,
        comparisons=comparisons,
        further=further,
        motions=motions,
        at_full_stroke=full,
        causes=cross_axis_coupling.causes(finest),
        springs=stage_shares.springs(finest),
        chains=stage_shares.input_chains(design.stage(), design.material, finest, found[-1]),
        modes=(mode_shares(finest, 0.0, REPORTED_MODES), mode_shares(finest, spring, REPORTED_MODES) if spring else []),
        coarsest={**found[0], **_moved(motions)},
        variants={
            label: variant_quantities(motions_found, there, sizes[:DRIVEN], by_key(limits))
            for label, there in variants.items()
        },
        hierarchy=rungs,
        stage_model=stage_model_of(design, finest, by_key(limits), _quadratic(motions, by_key(limits))),
        seconds=perf_counter() - began,
    )


def compare(
    study: Study,
    limits: Sequence[Quantity],
    motions: Sequence[CrossMotion],
    published: Mapping[str, Mapping[str, Quantity]],
) -> tuple[list[Comparison], list[Quantity]]:
    """Compare FEM with formulas and published numbers where there are any; the rest is reported alone."""
    design = study.design
    actuator = design.actuator.installed_stiffness if design.actuator else None
    models: dict[str, Mapping[str, Quantity]] = {
        model: by_key(found) for model, found in design.stage().formulas(design.material, actuator, None).items()
    }
    beyond = _compliance(design)
    models["compliance"] = {key: q for key, q in beyond.items() if any(key in known for known in models.values())}
    arms = design.stage().arms()
    aside: dict[str, Quantity] = {}
    for motion in motions:
        for to, length in cross_axis_coupling.coupling_by_arms(motion.travel, arms, motion.axis).items():
            fem = next(q for q in motion.quantities() if q.name == f"coupling_{to}")
            aside[fem.key] = replace(
                fem, value=length / motion.travel, source="delta^2 / 2L, Lin et al. (2019), eq. (25)"
            )
    models["arms (25)"] = aside
    models |= published
    compared = [q for q in limits if any(q.key in model for model in models.values())]
    comparisons = [Comparison(q, {name: m[q.key] for name, m in models.items() if q.key in m}) for q in compared]
    return comparisons, [q for q in limits if q not in compared]


def _compliance(design: Design) -> Mapping[str, Quantity]:
    """Return the quantities of the compliance model with all that is drawn, by key; none where it is no frame."""
    try:
        return static_model.of_design(design).compliance({}).quantities()
    except InputError:
        return {}


def _examine(design: Design) -> None:
    """Raise InputError, before long work begins, if what the stage says by formulas cannot be used."""
    stage = design.stage()

    def require(fact: bool, method: str, remedy: str) -> None:
        if not fact:
            raise InputError(parts.file_of(type(stage)), f"{type(stage).__name__}.{method}()", None, remedy)

    stiffness = design.actuator.installed_stiffness if design.actuator else None
    given: object = stage.formulas(design.material, stiffness, None)
    models = list(given.values()) if isinstance(given, Mapping) else [None]
    known = all(isinstance(found, Sequence) and all(isinstance(q, Quantity) for q in found) for found in models)
    require(known, "formulas", "must return quantities by the model's name: {'PRB': [Quantity(...)]}, or {}")
    springs: object = stage.springs(design.material)
    require(isinstance(springs, Mapping), "springs", "must return by axis (name, count, Quantity, source), or {}")
    require(
        isinstance(stage.arms(), Mapping), "arms", "must return lengths [m] by (axis drawn aside, driven axis), or {}"
    )


def _refuse_unknown(study: Study, assembly: Assembly) -> None:
    """Refuse what a stage has not, and what is done for a part alone, before long work begins."""
    if study.mesh.cross_check:
        raise InputError(study.file, "mesh.cross_check", True, "is for a part alone; leave it out for a stage")
    for axis in study.stage.inputs:
        if axis not in assembly.axes:
            remedy = f"is no axis of this stage{suggest(axis, list(assembly.axes))}"
            raise InputError(study.file, f"stage.inputs.{axis}", axis, remedy)


def _variant(study: Study, label: str, cache: Cache, progress: Progress) -> list[dict[str, Quantity]]:
    """Return a variant's quantities on the coarsest meshes, by key."""
    design = study.variants[label]
    other, found = replace(study, design=design), []
    assembly, say = design.stage().assembly(), stage_condensation.with_label(progress, f"variant {label}")
    kinds = stage_condensation.build_solids(other, assembly, say)
    for power in range(study.mesh.levels - 1, study.mesh.levels - 1 - DRIVEN, -1):
        coarseness = study.mesh.refinement**power
        level = stage_condensation.condense(other, assembly, kinds, coarseness, cache, interior=True, progress=say)
        motions, _ = stage_drives.Driven(other, level, cache, say).motions(full=False)
        found.append({**level.found, **_moved(motions)})
    return found


def _quadratic(motions: Sequence[CrossMotion], limits: Mapping[str, Quantity]) -> dict[tuple[str, str], float]:
    """Return couplings of second order by (to, from) [1/m]: ratio over travel in the limit, signed as on a mesh."""
    found, signed = {}, cross_axis_coupling.ratios(motions)
    for motion in motions:
        travel, *ratios = (limits[quantity.key].value for quantity in motion.quantities())
        for to, ratio in zip(motion.even, ratios, strict=True):
            if (pair := (to, motion.axis)) in signed:
                found[pair] = math.copysign(ratio / travel, signed[pair])
    return found


def _moved(motions: Sequence[CrossMotion]) -> dict[str, Quantity]:
    return by_key(q for motion in motions for q in motion.quantities())

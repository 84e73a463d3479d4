"""Who answers for one case: the paper's formulas, the compliance model, finite elements, or experiments on a stage.

Formulas and finite elements state the same quantities by the same keys, of which finite elements in space have more.
Experiments are simulated on a stage model (`simulating`), which finite elements make of a design where no file has it.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from flexdesign.analytic import frame, part_models, static_model
from flexdesign.analytic.compliance import SOURCE
from flexdesign.analytic.stage_compliance import StageCompliance
from flexdesign.analytic.static_model import StaticModel
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.design import design as designs
from flexdesign.design.design import Design
from flexdesign.design.study import MeshSettings
from flexdesign.dynamics.stage_model import StageModel, with_overrides
from flexdesign.fem.multifidelity import Correction, FastSolid, Planar
from flexdesign.workflows.sweeps import fem_evaluators, simulating
from flexdesign.workflows.sweeps.plan import SweepPlan, settings_of
from flexdesign.workflows.sweeps.results import CaseResult, Results
from flexdesign.workflows.sweeps.sampling import Case
from flexdesign.workflows.sweeps.simulating import Bench

#: What finite elements give without modes.
DIRECT = ("K_in", "lambda", "K_out", "stroke", "blocked_force", "actuator_force")
#: What a part calls the models that are asked.
MODELS = {"pseudo-rigid": "PRB", "analytic": "compliance"}


@dataclass(frozen=True)
class EvaluationRequest:
    """A case as a worker gets it: everything it has to know, and nothing that a process could not be sent.

    Parameters
    ----------
    key
        Under which the answer is kept.
    file, overrides
        The design or stage model, and what differs from its file as ``table.key=value``.
    dimensions
        What else differs [SI].
    evaluator, mesh
        Who answers, and for finite elements the mesh settings as a study has them.
    modes
        How many modes of each symmetry class finite elements find; without any they give input and output alone.
    middle
        Overrides of the design about which the cases lie, from which finite elements learn how coarse meshes err.
    correction
        What finite elements in the plane leave out, learned from a few in space.
    bench
        What is simulated, if anything is.
    """

    key: str
    file: Path
    overrides: tuple[str, ...]
    dimensions: Mapping[str, float]
    evaluator: str
    mesh: Mapping[str, Any]
    modes: int = 0
    middle: tuple[str, ...] = ()
    correction: Correction | None = None
    bench: Bench | None = None


def evaluate_all(requests: Sequence[EvaluationRequest]) -> Results:
    """Return the answers to a batch of questions; one that fails has its reason for an answer."""
    return Results.of([evaluate(request) for request in requests])


def evaluate(request: EvaluationRequest) -> CaseResult:
    """Return the answer to one question, or why there is none."""
    began = time.perf_counter()
    try:
        found, error = _evaluate(request), ""
    except (InputError, ArithmeticError, ValueError) as refusal:
        found, error = (), str(refusal)
    return found, error, time.perf_counter() - began


@cache
def _read(file: Path, overrides: tuple[str, ...]) -> Design:
    return designs.read(file, overrides)


def _of(request: EvaluationRequest) -> Design:
    return version(request.file, request.overrides, request.dimensions)


def version(file: Path, overrides: tuple[str, ...], dimensions: Mapping[str, float]) -> Design:
    """Return a design with overrides and other dimensions [SI]; what only differs in dimensions is read once.

    Raises
    ------
    InputError
        If the design cannot be read, or a dimension is not plausible.
    """
    base = _read(file, overrides)
    if not dimensions:
        return base
    bounds = {p.name: p.plausible for p in base.part_class.dimensions}
    for name, value in dimensions.items():
        low, high = bounds[name]
        if not low <= value <= high:
            allowed = f"allowed: {low * 1e3:g} to {high * 1e3:g} mm"
            raise InputError(file, f"dimensions.{name}", f"{value * 1e3:g} mm", allowed)
    return replace(base, dimensions={**base.dimensions, **dimensions})


def version_of(plan: SweepPlan, case: Case) -> Design:
    """Return the design of a case of a sweep; raise InputError as `version` does."""
    overrides, dimensions = settings_of(case, {factor.key: factor for factor in plan.factors})
    everything = (*plan.overrides, *overrides)
    return version(plan.design.file, tuple(simulating.of_design(everything)), dimensions)


def _evaluate(request: EvaluationRequest) -> Sequence[Quantity]:
    if request.bench is not None:
        return by_simulation(request, request.bench)
    design = _of(request)
    if request.evaluator in MODELS:
        return by_formulas(design, MODELS[request.evaluator])
    settings = tuple(sorted(request.mesh.items()))
    if request.correction is not None:
        planar = _planar(request.file, request.middle, settings)
        return request.correction.apply(design, planar.evaluate(design))
    solid = _solid(request.file, request.middle, settings, request.modes)
    return fem_evaluators.by_elements(design, MeshSettings(**request.mesh), solid)


@cache
def _planar(file: Path, middle: tuple[str, ...], settings: tuple[tuple[str, Any], ...]) -> Planar:
    """Return an evaluator whose triangles are those of the middle in every process: others would answer otherwise."""
    planar = Planar(MeshSettings(**dict(settings)))
    with suppress(InputError):  # the middle itself may be one that cannot be built
        planar.evaluate(_read(file, middle))
    return planar


@cache
def _solid(file: Path, middle: tuple[str, ...], settings: tuple[tuple[str, Any], ...], modes: int) -> FastSolid:
    """Return an evaluator that all cases of a process share; one anchor for all, so that processes answer alike."""
    mesh = MeshSettings(**dict(settings))
    try:
        return fem_evaluators.fast_solid(mesh, modes, [_read(file, middle)])
    except InputError:  # the middle cannot be built, or is no extrusion
        return fem_evaluators.fast_solid(mesh, modes, [])


def learn_correction(requests: Sequence[EvaluationRequest]) -> Correction:
    """Return what the plane leaves out, from the designs of some questions.

    Raises
    ------
    InputError
        If one of them cannot be built or meshed.
    """
    first = requests[0]
    settings = tuple(sorted(first.mesh.items()))
    solid, planar = _solid(first.file, first.middle, settings, 0), _planar(first.file, first.middle, settings)
    return Correction.fit([_of(request) for request in requests], planar, solid)


def by_formulas(design: Design, model: str) -> list[Quantity]:
    """Return what an analytic model says of a part or a stage, and what follows from it with actuators.

    Raises
    ------
    InputError
        If there is no such model of it, or its dimensions cannot be built.
    """
    if model == MODELS["analytic"] and (design.is_stage or design.effects):
        found = _with_effects(design)
    else:
        found = _formula_values(design) if design.is_stage else _of_part(design, model)
    return found + _stroke_and_force(found, design)


def _with_effects(design: Design) -> list[Quantity]:
    """Return what the compliance model says, with the effects of the drawing and of the design."""
    try:
        model = StaticModel(design, {**static_model.nominal_effects(design), **design.effects}).compliance({})
        found = list(model.quantities().values())
        if isinstance(model, StageCompliance) and design.actuator:
            free = design.actuator.free_stroke
            for axis in model.assembly.axes:
                found.append(Quantity("stroke", model.stroke(axis, free), "m", "um", f"{axis}, table free", SOURCE))
        return found
    except frame.Mechanism as error:
        remedy = f"has no compliance model: {error}; name every hinge, arm and rod in linkage()"
        raise InputError(design.file, "part", design.part_class.__name__, remedy) from error


def _formula_values(design: Design) -> list[Quantity]:
    """Return what a stage's formulas say: as the paper counts its springs, and last as they are counted here."""
    stiffness = design.actuator.installed_stiffness if design.actuator else None
    *_, counted = design.stage().formulas(design.material, stiffness, None).values()
    return list(counted)


def _of_part(design: Design, model: str) -> list[Quantity]:
    """Return what one of a part's own models says."""
    stiffness = design.actuator.installed_stiffness if design.actuator else None
    formulas = part_models.formulas(design.part(), design.material, stiffness, None)
    if model not in formulas:
        remedy = f"has no model {model}: it has {', '.join(formulas)}"
        raise InputError(design.file, "part", design.part_class.__name__, remedy)
    return list(formulas[model])


def _stroke_and_force(found: Sequence[Quantity], design: Design) -> list[Quantity]:
    """Return stroke and blocked force where a model does not, along each axis of a stage, with its actuators installed.

    The actuator's free stroke d parts over its own stiffness k and K_in: the output moves by lambda d k / (k + K_in).
    Held, it pushes with that times K_out with the actuators installed, by superposition.
    """
    if design.actuator is None:
        return []
    values = {(quantity.name, quantity.boundary): quantity.value for quantity in found}
    k, free_stroke = design.actuator.installed_stiffness, design.actuator.free_stroke
    driven = []
    for k_in in found:
        free = k_in.boundary
        if k_in.name != "K_in" or not free.endswith(" free") or ("lambda", free) not in values:
            continue
        axis, _, _ = free.rpartition(", ")  # of a stage "X, table free", of a part "output free"
        installed = f"{axis}, actuators installed" if axis else "actuator installed"
        stroke = values.get(("stroke", free))
        if stroke is None:
            stroke = values["lambda", free] * free_stroke * k / (k + k_in.value)
            driven.append(Quantity("stroke", stroke, "m", "um", free, k_in.source))
        if (k_out := values.get(("K_out", installed))) is not None:
            held = f"{free.removesuffix(' free')} held"
            driven.append(Quantity("blocked_force", stroke * k_out, "N", "N", held, k_in.source))
    return driven


def by_simulation(request: EvaluationRequest, bench: Bench) -> list[Quantity]:
    """Return what experiments measure on a simulated stage, and the stiffness that finite elements gave it.

    Raises
    ------
    InputError
        If there is no such stage, or the experiments cannot be made on it.
    ValueError
        If no controller was found for any.
    """
    if bench.model is None:
        of_design = tuple(simulating.of_design(request.overrides))
        stage, found = _stage_of_design(
            request.file, of_design, tuple(request.dimensions.items()), tuple(sorted(request.mesh.items()))
        )
    else:
        stage, found = simulating.read(bench.model), []
    changed_stage = with_overrides(stage, simulating.of_stage(request.overrides))
    return [*found, *simulating.simulate_measures(changed_stage, bench, request.overrides)]


@lru_cache(maxsize=8)
def _stage_of_design(
    file: Path,
    overrides: tuple[str, ...],
    dimensions: tuple[tuple[str, float], ...],
    settings: tuple[tuple[str, Any], ...],
) -> tuple[StageModel, list[Quantity]]:
    return fem_evaluators.stage_model(version(file, overrides, dict(dimensions)), MeshSettings(**dict(settings)))

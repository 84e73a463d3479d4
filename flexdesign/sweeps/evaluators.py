"""Who answers for one case: the paper's formulas, the compliance model, finite elements in the plane or in space.

All state the same quantities by the same keys, of which finite elements in space have more.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from flexdesign import design as designs
from flexdesign import refinement
from flexdesign.cache import Cache
from flexdesign.design import Actuator, Design
from flexdesign.errors import InputError
from flexdesign.fem import domain
from flexdesign.model import Quantity
from flexdesign.multifidelity import Correction, FastSolid, Planar
from flexdesign.study import MeshSettings, ModeSettings, OutputSettings, Study
from flexdesign.sweeps.answers import Answer, Answers
from flexdesign.sweeps.plan import SweepPlan, settings_of
from flexdesign.sweeps.sampling import Case

#: Asked of finite elements where mesh settings state no accuracy.
ACCURACY = 0.01
#: What finite elements tell without modes.
DIRECT = ("K_in", "lambda", "K_out", "stroke", "blocked_force", "actuator_force")
#: What a part calls the models that are asked.
MODELS = {"pseudo-rigid": "PRB", "analytic": "compliance"}


@dataclass(frozen=True)
class Question:
    """A case as a worker gets it: everything it has to know, and nothing that a process could not be sent.

    Parameters
    ----------
    key
        Under which the answer is kept.
    file, overrides
        The design, and what differs from its file as ``table.key=value``.
    dimensions
        What else differs [SI].
    evaluator, mesh
        Who answers, and for finite elements the mesh settings as a study has them.
    modes
        How many modes of each symmetry class finite elements find; without any they tell input and output alone.
    middle
        Overrides of the design about which the cases lie, from which finite elements learn how coarse meshes err.
    correction
        What finite elements in the plane leave out, learned from a few in space.
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


def answers(questions: Sequence[Question]) -> Answers:
    """Return the answers to a batch of questions; one that fails has its reason for an answer."""
    return Answers.of([answer(question) for question in questions])


def answer(question: Question) -> Answer:
    """Return the answer to one question, or why there is none."""
    began = time.perf_counter()
    try:
        found, error = _evaluate(_of(question), question), ""
    except (InputError, ArithmeticError, ValueError) as refusal:
        found, error = (), str(refusal)
    return found, error, time.perf_counter() - began


@cache
def _read(file: Path, overrides: tuple[str, ...]) -> Design:
    return designs.read(file, overrides)


def _of(question: Question) -> Design:
    return version(question.file, question.overrides, question.dimensions)


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
    return version(plan.design.file, (*plan.overrides, *overrides), dimensions)


def _evaluate(design: Design, question: Question) -> Sequence[Quantity]:
    if question.evaluator in MODELS:
        return by_formulas(design, MODELS[question.evaluator])
    settings = tuple(sorted(question.mesh.items()))
    if question.correction is not None:
        planar = _planar(question.file, question.middle, settings)
        return question.correction.apply(design, planar.evaluate(design))
    solid = _solid(question.file, question.middle, settings, question.modes)
    return by_elements(design, MeshSettings(**question.mesh), solid)


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
        return fast_solid(mesh, modes, [_read(file, middle)])
    except InputError:  # the middle cannot be built, or is no extrusion
        return fast_solid(mesh, modes, [])


def corrected(questions: Sequence[Question]) -> Correction:
    """Return what the plane leaves out, from the designs of some questions.

    Raises
    ------
    InputError
        If one of them cannot be built or meshed.
    """
    first = questions[0]
    settings = tuple(sorted(first.mesh.items()))
    solid, planar = _solid(first.file, first.middle, settings, 0), _planar(first.file, first.middle, settings)
    return Correction.fit([_of(question) for question in questions], planar, solid)


def fast_solid(mesh: MeshSettings, modes: int = 0, anchors: Sequence[Design] = ()) -> FastSolid:
    """Return an evaluator of extruded parts with the accuracy that mesh settings ask for, or 1 %."""
    return FastSolid(mesh.accuracy or ACCURACY, mesh, modes=modes, anchors=anchors)


def by_formulas(design: Design, model: str) -> list[Quantity]:
    """Return what an analytic model says of a part, and what follows from it with an actuator.

    Raises
    ------
    InputError
        If the part has no such model, or its dimensions cannot be built.
    """
    actuator = design.actuator
    formulas = design.part().formulas(design.material, actuator.installed_stiffness if actuator else None, None)
    if model not in formulas:
        remedy = f"has no model {model}: it has {', '.join(formulas)}"
        raise InputError(design.file, "part", design.part_class.__name__, remedy)
    found = list(formulas[model])
    return found + _driven(found, actuator) if actuator else found


def _driven(found: Sequence[Quantity], actuator: Actuator) -> list[Quantity]:
    """Return stroke and blocked force of a two-port with an actuator between its inputs.

    The actuator's free stroke d parts over its own stiffness k and K_in: the output moves by lambda d k / (k + K_in).
    Held, it pushes with that times K_out with the actuator installed, by superposition.
    """
    values = {quantity.key: quantity for quantity in found}
    needed = ("K_in_output_free", "lambda_output_free", "K_out_actuator_installed")
    if any(key not in values for key in needed):
        return []
    k_in, ratio, k_out = (values[key].value for key in needed)
    k, source = actuator.installed_stiffness, values[needed[0]].source
    stroke = ratio * actuator.free_stroke * k / (k + k_in)
    return [
        Quantity("stroke", stroke, "m", "um", "output free", source),
        Quantity("blocked_force", stroke * k_out, "N", "N", "output held", source),
    ]


class _Nowhere(Cache):
    """A cache that keeps nothing: what is asked of many designs is asked of each once."""

    def load(self, stage: str, key: str) -> None:
        return None

    def store(self, stage: str, key: str, arrays: Any, table: Any) -> None:
        return None


def by_elements(design: Design, mesh: MeshSettings, solid: FastSolid) -> list[Quantity]:
    """Return what finite elements say of a part.

    Extruded parts are solved on coarse meshes whose error is known from designs near by; others, and where `mesh`
    asks for wild meshes, as a validation does it.

    Raises
    ------
    InputError
        If the solid or a mesh cannot be used.
    """
    part = design.part()
    axis = getattr(part, "prismatic", None)
    if axis is not None and axis() is not None and mesh.method != "wild":
        return solid.evaluate(design)
    study = Study(design.file, design.name, design, mesh, ModeSettings(), OutputSettings())
    body = domain.of_part(part, material=design.material, chord=domain.chord(part))
    method = refinement.method_of(study, part, body)
    levels = refinement.refined(study, part, body, method, _Nowhere(Path()), lambda _: None)
    return refinement.gathered(study, levels, method.scatter)

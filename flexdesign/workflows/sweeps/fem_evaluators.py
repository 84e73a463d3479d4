"""Finite elements as a sweep asks them: of one design after the other, most of which have much in common.

Extruded parts are solved on coarse meshes whose error is known from designs near by; other parts as a validation solves
them. Of whole stages each kind of part is condensed once for all designs that have it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.result_cache import Arrays, Cache
from flexdesign.design.design import Design
from flexdesign.design.study import MeshSettings, ModeSettings, OutputSettings, Study
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.fem import mesh_refinement, stage_condensation
from flexdesign.fem.mesh_refinement import Level
from flexdesign.fem.meshing import domain
from flexdesign.fem.multifidelity import FastSolid
from flexdesign.workflows.validation import stage_model_from_part
from flexdesign.workflows.validation.stage_model_from_stage import stage_model_of

#: Asked of extruded parts and of stages where mesh settings state no accuracy.
ACCURACY = 0.01
#: Edge length at the hinge roots, in hinge thicknesses, of the two meshes that stress and frequency are asked of: they
#: are then known to about 1 %, in seconds.
COARSE_AT_ROOT = 0.5
#: Quantities reported of an optimum in addition to its aim and limits.
REPORTED = ("hinge_stress", "safety_against_yield", "safety_against_fatigue", "first_frequency", "drive_frequency")
#: How boundaries call a part or stage with its actuators.
INSTALLED = "installed"
#: A process keeps so much of meshes and condensed parts of stages [bytes], the latest.
KEPT = 400e6


class _Nowhere(Cache):
    """A cache that keeps nothing: what is asked of many designs is asked of each once."""

    def load(self, stage: str, key: str) -> None:
        return None

    def store(self, stage: str, key: str, arrays: Any, table: Any) -> None:
        return None


class _InMemory(Cache):
    """A cache that keeps the latest answers of a process: neighbouring stages have most of their parts in common."""

    _kept: dict[tuple[str, str], tuple[Arrays, dict[str, Any]]] = {}  # noqa: RUF012 - one for the process

    def load(self, stage: str, key: str) -> tuple[Arrays, dict[str, Any]] | None:
        found = self._kept.pop((stage, key), None)
        if found is not None:
            self._kept[stage, key] = found  # which makes it the latest
        return found

    def store(self, stage: str, key: str, arrays: Mapping[str, NDArray[Any]], table: Mapping[str, Any]) -> None:
        self._kept[stage, key] = dict(arrays), dict(table)
        sizes = [sum(array.nbytes for array in arrays.values()) for arrays, _ in self._kept.values()]
        while sum(sizes) > KEPT and len(sizes) > 1:
            del self._kept[next(iter(self._kept))], sizes[0]


def fast_solid(mesh: MeshSettings, modes: int = 0, anchors: Sequence[Design] = ()) -> FastSolid:
    """Return an evaluator of extruded parts with the accuracy that mesh settings ask for, or 1 %."""
    return FastSolid(mesh.accuracy or ACCURACY, mesh, modes=modes, anchors=anchors)


def by_elements(design: Design, mesh: MeshSettings, solid: FastSolid) -> list[Quantity]:
    """Return what finite elements say of a part or a stage.

    Extruded parts are asked of `solid`; other parts, and where `mesh` asks for unstructured meshes, as a validation
    does it.

    Raises
    ------
    InputError
        If the solid or a mesh cannot be used.
    """
    if design.is_stage:
        return _solve_stage(design, mesh)[0]
    axis = getattr(design.part(), "prismatic", None)
    if axis is not None and axis() is not None and mesh.method != "wild":
        return solid.evaluate(design)
    return _solve_part(design, mesh)[0]


def stage_model(design: Design, mesh: MeshSettings) -> tuple[StageModel, list[Quantity]]:
    """Return the stage model that finite elements make of a design, without the effects of large displacements.

    The quantities that an accuracy is asked of come with it, with their estimated errors.

    Raises
    ------
    InputError
        If the solid or a mesh cannot be used, or nothing drives the stage.
    """
    if design.is_stage:
        found, finest = _solve_stage(design, mesh)
        stage = stage_model_of(design, finest.stage, by_key(found), {})
    else:
        found, levels = _solve_part(design, mesh)
        with_modes = next(level.solution for level in reversed(levels) if level.solution.modes)
        stage = stage_model_from_part.stage_model(design, by_key(found), with_modes)
    if stage is None:
        remedy = "is missing, so that nothing drives the stage; write [actuator]"
        raise InputError(design.file, "actuator", None, remedy)
    return stage, [quantity for quantity in found if quantity.name in mesh_refinement.ACCURACY_QUANTITIES]


def strength_and_modes(design: Design, mesh: MeshSettings, found: Sequence[Quantity]) -> list[Quantity]:
    """Return stress, safety and frequency of a part or a stage, where they are known.

    Parameters
    ----------
    design
        The part or the stage.
    mesh
        How to mesh.
    found
        What `by_elements` returned; a part that was extruded is also solved on two coarse meshes.

    Raises
    ------
    InputError
        If a mesh cannot be used.
    """
    if not design.is_stage and not any(q.name == "hinge_stress" for q in found):
        coarse = {"accuracy": None, "levels": 2, "at_root": mesh.at_root or COARSE_AT_ROOT}
        found = _solve_part(design, mesh.model_copy(update=coarse))[0]
    chosen = [q for q in found if q.name.startswith(REPORTED)]
    driven = {q.name for q in chosen if INSTALLED in q.boundary}  # without the actuator where there is none
    return [q for q in chosen if q.name not in driven or INSTALLED in q.boundary]


def _study(design: Design, mesh: MeshSettings) -> Study:
    return Study(design.file, design.name, design, mesh, ModeSettings(), OutputSettings())


def _solve_part(design: Design, mesh: MeshSettings) -> tuple[list[Quantity], list[Level]]:
    """Return what finite elements say of a part as a validation asks them, and on which meshes."""
    part, study = design.part(), _study(design, mesh)
    body = domain.of_part(part, material=design.material, chord=domain.chord(part))
    method = mesh_refinement.method_of(study, part, body)
    levels = mesh_refinement.refine(study, part, body, method, _Nowhere(Path()), lambda _: None)
    return mesh_refinement.gather_quantities(study, levels, method.scatter), levels


def _solve_stage(design: Design, mesh: MeshSettings) -> tuple[list[Quantity], stage_condensation.StageLevel]:
    """Return what finite elements say of a stage, on as many meshes as the accuracy takes, and the finest of these."""
    study = _study(design, mesh.model_copy(update={"accuracy": mesh.accuracy or ACCURACY}))
    levels = stage_condensation.refine(study, design.stage().assembly(), _InMemory(Path()))
    return stage_condensation.gather_quantities(levels), levels[-1]

"""A stage's axes driven through large displacements, each drive kept in the cache once it is found."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import cache as once
from time import perf_counter
from typing import Any

from flexdesign.core import units, versions
from flexdesign.core.errors import InputError
from flexdesign.core.result_cache import Arrays, Cache, content_key
from flexdesign.design.study import Study
from flexdesign.fem import cross_axis_coupling, mesh_refinement
from flexdesign.fem.cross_axis_coupling import CrossMotion
from flexdesign.fem.stage_condensation import StageLevel
from flexdesign.fem.superelements import corotated, second_order
from flexdesign.fem.superelements.corotated import CorotatedStage, NoEquilibrium, State
from flexdesign.workflows.validation.stage_published import input_motion

Progress = Callable[[str], None]


class Driven:
    """A stage on one mesh, to be driven through large displacements.

    Energies of second order are integrated when the first drive asks for them: a stage of which all drives are in the
    cache needs none.

    Parameters
    ----------
    study
        What was asked.
    level
        The stage on one mesh, its parts with what goes on inside.
    cache
        Where drives are looked up and kept.
    progress
        Receives a text about the progress.
    """

    def __init__(self, study: Study, level: StageLevel, cache: Cache, progress: Progress) -> None:
        self.study, self.level, self.cache, self.progress = study, level, cache, progress
        self._stage: CorotatedStage | None = None
        self._each = 0.0  # how long the last drive took that was computed [s]

    def motions(self, *, full: bool = True) -> tuple[list[CrossMotion], list[CrossMotion]]:
        """Drive each axis at the stated input and, if `full`, at the actuator's free stroke.

        Raises
        ------
        InputError
            If the stage has no equilibrium there.
        """
        if not self.study.output.large_steps:
            return [], []
        actuator = self.study.design.actuator
        near = {axis: input_motion(self.study, axis) for axis in self.level.stage.assembly.axes}
        free = actuator.free_stroke if actuator and full else None
        far = {axis: free for axis, extension in near.items() if free is not None and extension != free}
        drives = [*near.items(), *far.items()]
        found = list[CrossMotion]()
        for number, (axis, extension) in enumerate(drives, 1):
            left = f", {self._each * (len(drives) - number + 1):.0f} s left" if self._each else ""
            found.append(self._driven_motion(axis, extension, f"drive {number} of {len(drives)}{left}"))
        return found[: len(near)], found[len(near) :]

    def _driven_motion(self, axis: str, extension: float, words: str) -> CrossMotion:
        level = self.level
        key = content_key(
            _code(), [kind.key for kind in level.kinds], self.study.design.material.mechanics,
            repr(level.stage.assembly), axis, extension, versions.installed(mesh_refinement.LIBRARIES),
        )  # fmt: skip
        if (stored := self.cache.load("drive", key)) is not None:
            return _from_store(*stored)
        if self._stage is None:
            self.progress("integrating second order")
            energies = {id(kind.part): second_order.of(kind.part) for kind in level.kinds}
            parts = {name: energies[id(part)] for name, part in level.stage.parts.items()}
            self._stage = CorotatedStage(level.stage.assembly, parts)
        self.progress(f"large displacements: {words}")
        began = perf_counter()
        try:
            found = cross_axis_coupling.cross_motion(self._stage, level.stage, axis, extension)
        except NoEquilibrium as error:
            value = units.to_text(extension, "um", si="m")
            raise InputError(self.study.design.file, f"stage.inputs.{axis}", value, str(error)) from error
        self._each = perf_counter() - began
        self.cache.store("drive", key, *_to_store(found))
        return found


@once
def _code() -> str:
    """Return a hash of the code that makes drives of condensed parts; what makes those parts is in their own keys."""
    return content_key([inspect.getsource(module) for module in (corotated, second_order, cross_axis_coupling)])


def _to_store(found: CrossMotion) -> tuple[Arrays, dict[str, Any]]:
    state = {f"state {name}": value for name, value in vars(found.state).items()}
    table = {name: value for name, value in vars(found).items() if name not in ("turned", "state")}
    return {"turned": found.turned, **state}, table


def _from_store(arrays: Arrays, table: Mapping[str, Any]) -> CrossMotion:
    state = {key.removeprefix("state "): value for key, value in arrays.items() if key.startswith("state ")}
    return CrossMotion(**table, turned=arrays["turned"], state=State(**state))

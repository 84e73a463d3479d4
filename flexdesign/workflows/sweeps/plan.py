"""What a sweep does: what shall vary, how it is answered for, and what is wanted of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from flexdesign.core.errors import InputError
from flexdesign.design.design import Design
from flexdesign.design.study import MeshSettings
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.workflows.sweeps.pareto import Aim, Limit
from flexdesign.workflows.sweeps.sampling import Case, Factor, Method, cases
from flexdesign.workflows.sweeps.simulating import Bench

#: Who answers: the paper's formulas, the compliance model, finite elements in the plane or in space, or experiments.
Evaluator = Literal["pseudo-rigid", "analytic", "planar", "fem", "simulation"]


@dataclass(frozen=True)
class SweepPlan:
    """What a sweep does.

    Parameters
    ----------
    file, name, title
        Where it was read, the name of that file, and what people call it, or nothing.
    subject, subject_file, overrides
        The design or the stage model that is varied, its file, and what the command line changed of it.
    factors, method, count, seed
        What varies, and how it is sampled.
    evaluator, mesh
        Who answers for a case; and how, if finite elements do.
    bench
        What is simulated, if anything is.
    limits, aims
        What a design has to keep, and what is to be large or small.
    show
        Quantities of which the report has curves; by default those of limits and aims, or a few that everybody asks.
    """

    file: Path
    name: str
    title: str
    subject: Design | StageModel
    subject_file: Path
    overrides: tuple[str, ...]
    factors: tuple[Factor, ...]
    method: Method
    count: int
    seed: int
    evaluator: Evaluator
    mesh: MeshSettings
    bench: Bench | None
    limits: tuple[Limit, ...]
    aims: tuple[Aim, ...]
    show: tuple[str, ...]

    @property
    def design(self) -> Design:
        """The design that is varied.

        Raises
        ------
        InputError
            If it is a stage model that varies.
        """
        if isinstance(self.subject, Design):
            return self.subject
        raise InputError(self.file, "stage_model", self.subject.name, "has no dimensions; name a design in its place")

    @property
    def is_meshed(self) -> bool:
        """Whether answering takes meshes."""
        return self.evaluator in ("planar", "fem") or (self.bench is not None and self.bench.model is None)

    def cases(self) -> list[Case]:
        """Return all cases, in the order of the sample."""
        return list(cases(self.factors, self.method, self.count, self.seed))


def settings_of(case: Case, factors: Mapping[str, Factor]) -> tuple[tuple[str, ...], dict[str, float]]:
    """Return a case as overrides of the design, and as dimensions [SI] that need no reading."""
    overrides, dimensions = [], {}
    for key, value in case.values.items():
        if key.startswith("dimensions.") and isinstance(value, float):
            dimensions[key.removeprefix("dimensions.")] = value
        else:
            text = f"{value:.12g} {factors[key].unit}".removesuffix(" 1") if isinstance(value, float) else value
            overrides.append(f"{key}={text}")
    return tuple(overrides), dimensions

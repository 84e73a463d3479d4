"""Experiments on a simulated stage as the answer to a case: a stage model, changed as the case says, and its measures.

The stage model is a file, or what finite elements make of a design; of a design its dimensions, material and actuator
may vary, of either what a stage model holds, effects among it, and what a study of experiments holds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from flexdesign.core import toml_files
from flexdesign.core.model import Quantity
from flexdesign.dynamics import experiments, stage_model
from flexdesign.dynamics.experiments import AS_MODELLED, Plan, simulation, standard_experiments
from flexdesign.dynamics.experiments.simulation import Case as Run
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.dynamics.trajectories import Recorded

#: Tables of a stage model, and tables and keys of a study of experiments, that may vary.
STAGE_KEYS = ("axis", "controller", "coupling")
STUDY_KEYS = ("controllers", "variants", "robust_ms", "cycled")
#: Where the answers come from.
SOURCE = "simulation"


@dataclass(frozen=True)
class Bench:
    """What is simulated.

    Parameters
    ----------
    model
        File of the stage model; None where finite elements make one of the design.
    study
        File of the experiments; None for the standard ones.
    """

    model: Path | None
    study: Path | None

    def plan(self, stage: StageModel, overrides: Sequence[str] = ()) -> Plan:
        """Return the experiments on a stage, those overrides laid over them that belong to a study.

        Raises
        ------
        InputError
            If they cannot be made on this stage.
        """
        if self.study is None:
            return standard_experiments.plan(stage)
        return experiments.read(self.study, list(stage.axes), of_study(overrides))

    def inputs(self, overrides: Sequence[str]) -> list[object]:
        """Return all that a simulation depends on besides a design: texts of files, and what is laid over them."""
        found: list[object] = [list(of_stage(overrides)), list(of_study(overrides))]
        named = [path for path in (self.model, self.study) if path is not None]
        if self.model is not None:
            stage = stage_model.read(self.model, of_stage(overrides))
            named += [Path(name) for axis in stage.axes.values() for name in axis.effects if name.endswith(".py")]
            if self.study is not None:
                trajectories = [experiment.trajectory for experiment in self.plan(stage, overrides).experiments]
                named += [Path(each.file) for each in trajectories if isinstance(each, Recorded)]
        return found + [path.read_text(encoding="utf-8-sig") for path in named]


def of_stage(overrides: Sequence[str]) -> list[str]:
    """Return those overrides that belong to a stage model."""
    return [override for override in overrides if _table(override) in STAGE_KEYS]


def of_study(overrides: Sequence[str]) -> list[str]:
    """Return those overrides that belong to a study of experiments."""
    return [override for override in overrides if _table(override) in STUDY_KEYS]


def of_design(overrides: Sequence[str]) -> list[str]:
    """Return those overrides that belong to a design."""
    return [override for override in overrides if _table(override) not in (*STAGE_KEYS, *STUDY_KEYS)]


def _table(override: str) -> str:
    return toml_files.overridden(override).partition(".")[0]


@cache
def read(file: Path) -> StageModel:
    """Return a stage model; what many cases share is read once. Raise InputError as `stage_model.read` does."""
    return stage_model.read(file)


def simulate_measures(stage: StageModel, bench: Bench, overrides: Sequence[str]) -> list[Quantity]:
    """Return what the experiments measure on a stage.

    Raises
    ------
    InputError
        If they cannot be made on it.
    ValueError
        If no controller was found for any.
    """
    plan = bench.plan(stage, overrides)
    variants = experiments.variants(plan, lambda changes: stage_model.with_overrides(stage, changes))
    found = simulation.run(stage, variants, plan, lambda _: None)
    if not found.cases:
        raise ValueError(found.skipped[0].reason)
    return [quantity for run in found.cases for quantity in _of(run)]


def _of(run: Run) -> Iterator[Quantity]:
    """Yield the measures of a run, named by experiment, controller, variant, and axis where there are several."""
    words = [run.experiment.name, run.controller, *([] if run.variant == AS_MODELLED else [run.variant])]
    driven = run.experiment.axes

    def named(quantity: Quantity, axis: str) -> Quantity:
        boundary = " ".join(words if driven == (axis,) else [*words, axis])
        return replace(quantity, boundary=boundary, source=SOURCE)

    for axis, measures in run.measures.items():
        yield from (named(measure, axis) for measure in measures)
    for axis in driven:
        share = float(np.mean(np.abs(run.response.cut[run.row(axis)]) > 0))
        yield named(Quantity("time_at_limits", share, "1", "%"), axis)
    for axis, margin in run.margins.items():
        yield named(Quantity("largest_sensitivity", margin.ms, "1", "1"), axis)
        yield named(Quantity("closed_loop_bandwidth", margin.bandwidth, "Hz", "Hz"), axis)

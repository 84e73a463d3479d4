"""Stage models from Python: read one, simulate it, plan experiments for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexdesign.api.changing import overrides
from flexdesign.api.result import Result
from flexdesign.core import toml_files
from flexdesign.core.errors import InputError
from flexdesign.dynamics import experiments, stage_model
from flexdesign.dynamics.experiments import simulation, standard_experiments
from flexdesign.dynamics.experiments.simulation import Simulation
from flexdesign.dynamics.stage_model import StageModel

if TYPE_CHECKING:
    from flexdesign.diagnosis.experiment_design.planning import Plan

Progress = Callable[[str], None]


def read_model(model: str | Path | StageModel, changes: Sequence[str] = (), **tables: Any) -> StageModel:
    """Read a stage model.

    Parameters
    ----------
    model
        A path, or the bare name of one in studies/; a model in memory is changed.
    changes
        ``key=value``, as `--set` takes them.
    tables
        The same as nested tables: ``axis={"x": {"damping_ratio": 0.02}}``.

    Raises
    ------
    InputError
        If anything in it cannot be used.
    """
    given = overrides(changes, tables)
    if isinstance(model, StageModel):
        return stage_model.with_overrides(model, given) if given else model
    return stage_model.read(model, given)


def simulate(
    model: str | Path | StageModel = "lin2019_stage",
    study: str | Path | None = None,
    changes: Sequence[str] = (),
    *,
    progress: Progress = lambda _: None,
    **tables: Any,
) -> Result[Simulation]:
    """Simulate experiments on a stage, in open and closed loop.

    Parameters
    ----------
    model
        A stage model, its path or bare name.
    study
        A study of experiments, its path or bare name; without it, hysteresis, step, sine and staircase of each axis.
    changes, tables
        What differs of model and study, as `read_model` takes them.
    progress
        Receives a text about the progress.

    Raises
    ------
    InputError
        If anything cannot be used.
    """
    from flexdesign.report.simulation import simulation_report

    given = overrides(changes, tables)
    of_study = [each for each in given if toml_files.overridden(each) in experiments.SETTINGS]
    of_model = [each for each in given if each not in of_study]
    if of_study and not study:
        raise InputError("command line", "--set", of_study[0], "is a setting of a study of experiments; name the study")
    stage = read_model(model, of_model)
    plan = experiments.read(study, list(stage.axes), of_study) if study else standard_experiments.plan(stage)
    variants = experiments.variants(plan, lambda changes: read_model(model, [*of_model, *changes]))
    found = simulation.run(stage, variants, plan, progress)
    return Result(
        found,
        simulation_report.document(found),
        simulation_report.digest(found),
        partial(simulation_report.result, found),
        lambda folder: {"stage_model.toml": stage_model.to_toml(found.model, folder)},
    )


def plan(
    model: str | Path | StageModel,
    changes: Sequence[str] = (),
    *,
    progress: Progress = lambda _: None,
    **request: Any,
) -> Result[Plan]:
    """Plan experiments that reveal or separate effects, within the limits of the bench.

    Parameters
    ----------
    model
        A stage model, its path or bare name.
    changes
        ``key=value`` of the model.
    progress
        Receives a text about the progress.
    request
        Limits and aims, see `plan_experiments`: ``slew="500 V/s"``, ``resolve=("creep", "sensor_drift")``.

    Raises
    ------
    InputError
        If anything cannot be used, or a limit is missing.
    """
    from flexdesign.diagnosis.experiment_design.planning import plan_experiments
    from flexdesign.report.diagnosis import plan_pages

    found = plan_experiments(read_model(model, changes), progress, **request)
    return Result(
        found,
        plan_pages.document(found),
        plan_pages.separations(found.resolved) if found.resolved else plan_pages.table(found.files, found.limits),
        partial(plan_pages.result, found),
    )

"""A stage model as it is, compared with recorded runs; the unknown initial conditions of each run are fitted.

Before a record the stage had moved in ways that are not in it: its mode rings, its hysteresis is somewhere on a loop,
the trigger came a little late. A model is compared with these few numbers of each run fitted, and nothing else, as the
first step of a diagnosis' error ladder is; what they explain is stated as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from flexdesign.diagnosis.comparison import Comparison
from flexdesign.diagnosis.comparison.compare import remarks_of
from flexdesign.diagnosis.effect_selection.estimation_setup import (
    PRIOR_BOUND,
    case_of,
    evaluate_design,
    offset_rms,
    simulating,
)
from flexdesign.diagnosis.preparation.dataset import prepare
from flexdesign.diagnosis.result import ModelResiduals, compare_model
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.measurements.recordings import FrequencyResponse, Run


def compare(
    model: StageModel,
    recorded: Sequence[Run | FrequencyResponse],
    *,
    axis: str | None = None,
    noise: float | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Comparison:
    """Compare a stage model with runs: residuals with the initial conditions of each run fitted.

    Parameters
    ----------
    model
        The stage model; none of its numbers is fitted.
    recorded
        Runs and frequency responses.
    axis
        Which one; may be left out where model and runs leave no choice.
    noise
        Standard deviation of the noise of runs, where it is stated [response]; by default it is estimated.
    progress
        Receives the progress as text.

    Raises
    ------
    InputError
        If the axis is ambiguous, a run lacks its command or response or has it in another unit, or the model gives no
        numbers for a run.
    """
    # Roles matter to no prediction: every run is fitted by its own numbers alone.
    every = [replace(each, role="identify", role_is_stated=True) for each in recorded]
    progress("reading the noise")
    data = prepare(model, every, axis, None, noise)
    progress("fitting the initial conditions of each run")
    with simulating() as each:
        dynamics, task = case_of(model, data, each, progress)
        fit = evaluate_design(replace(task, free=(), prior_bound=PRIOR_BOUND), dynamics)
    progress("looking where it fails")
    nominal = ModelResiduals(
        axis=data.name,
        before=model,
        model=model,
        runs=data.runs,
        noise=data.noise,
        residuals_by_run={"found": fit.residuals_by_run},
        responses=data.responses,
        lines=data.lines,
    )
    found, roles = compare_model(nominal, "found"), {run.name: run.role for run in recorded}
    runs = tuple(
        replace(
            compared,
            role=roles[run.name],
            remarks=remarks_of(dynamics, run),
            offset_rms=offset_rms(dynamics, [run]),
        )
        for compared, run in zip(found.runs, data.runs, strict=True)
    )
    return replace(found, runs=runs, responses=tuple(replace(e, role=roles[e.name]) for e in found.responses))

"""A stage model as it is, compared with recorded runs; the unknown initial conditions of each run are fitted.

Before a record the stage had moved in ways that are not in it: its mode rings, its hysteresis is somewhere on a loop,
the trigger came a little late. A model is compared with these few numbers of each run fitted, and nothing else, as the
first step of a diagnosis' error ladder is; what they explain is stated as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter

import numpy as np

from flexdesign.diagnosis import comparison
from flexdesign.diagnosis.comparison import Comparison
from flexdesign.diagnosis.effect_selection.estimation_setup import PRIOR_BOUND, case_of, evaluate_design, simulating
from flexdesign.diagnosis.preparation.dataset import prepare
from flexdesign.diagnosis.preparation.initial_conditions import offset_residual
from flexdesign.diagnosis.result import ModelResiduals, compare_model
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.model_selection.fitted_model import predict_tests
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
        As `flexdesign.diagnosis.comparison.compare`.
    """
    began = perf_counter()
    plain = comparison.compare(model, recorded, axis=axis, progress=progress)
    if not plain.runs:
        return plain
    # Roles matter to no prediction: every run is fitted by its own numbers alone.
    every = [replace(each, role="identify", role_is_stated=True) for each in recorded if isinstance(each, Run)]
    progress("fitting the initial conditions of each run")
    data = prepare(model, every, plain.axis, None, noise)
    with simulating() as each:
        dynamics, task = case_of(model, data, each, progress)
        fit = evaluate_design(replace(task, free=(), prior_bound=PRIOR_BOUND), dynamics)
    residuals = predict_tests(task, fit).residuals_by_run
    roles = {run.name: run.role for run in plain.runs}
    alone = {run.name: float(np.sqrt(np.nanmean(offset_residual(dynamics, run) ** 2))) for run in data.runs}
    seen = tuple(replace(run, role=roles[run.name]) for run in data.runs)
    progress("looking where it fails")
    nominal = ModelResiduals(
        axis=plain.axis, before=model, model=model, runs=seen, noise=data.noise, residuals_by_run={"found": residuals}
    )
    found = compare_model(nominal, "found")
    runs = tuple(
        replace(run, offset_rms=alone[run.name], remarks=before.remarks)
        for run, before in zip(found.runs, plain.runs, strict=True)
    )
    return replace(found, runs=runs, responses=plain.responses, seconds=perf_counter() - began)

"""Diagnosis of one axis: calibrate the model, select effects, and decide what is named.

The parameters of the model itself are fitted first, those that finite elements determine within their uncertainty, so
that no effect is named for a stiffness that is one percent off. Effects are then selected, and the residual is compared
with the noise. Effects are named if the residual is noise, or if they explain a large share and no smooth function of
position, velocity and voltage explains more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.diagnosis.effect_selection.estimation_setup import (
    calibrate_task,
    case_of,
    choose_interpolation,
    simulating,
)
from flexdesign.diagnosis.effect_selection.per_run_parameters import of_runs, vary_by_run, vary_step
from flexdesign.diagnosis.effect_selection.prior_conflicts import conflicts, shown
from flexdesign.diagnosis.models_without_physics import is_better_curve, is_better_linear, smooth_residual_model
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, prepare
from flexdesign.diagnosis.preparation.frequencies import line_frequencies, mode_frequencies
from flexdesign.diagnosis.preparation.initial_conditions import offset_residual
from flexdesign.diagnosis.preparation.oversampling import oversampling_of
from flexdesign.diagnosis.preparation.windows import describe, is_very_long
from flexdesign.diagnosis.remainder import is_adequate
from flexdesign.diagnosis.result import Diagnosis, SelectionHistory
from flexdesign.diagnosis.verdict import Conclusion, decide, diagnosis_of
from flexdesign.diagnosis.windowed_selection import forward_in_windows
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.model_selection.determination import drop_undetermined, hold_undetermined
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    predict_tests,
)
from flexdesign.estimation.model_selection.forward_selection import forward
from flexdesign.estimation.model_selection.model_comparison import Step
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.model_selection.stepwise_selection import add_together, confusable, restart_without, select
from flexdesign.measurements.recordings import FrequencyResponse, Run

#: Largest number of effects that are added to explain runs in time, and to explain frequency responses: there a driver,
#: a delay and two modes act in bands of their own.
MOST_EFFECTS, MOST_EFFECTS_OF_LINES = 3, 5


def diagnose(
    model: StageModel,
    runs: Sequence[Run | FrequencyResponse],
    *,
    axis: str | None = None,
    more: Sequence[str] = (),
    tolerance: float | None = None,
    noise: float | None = None,
    threads: int = 2,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Find which physical effects a stage model lacks.

    Parameters
    ----------
    model
        The stage model; its uncertainties are the priors of its parameters.
    runs
        Runs in time and frequency responses; if no roles are stated, they are split.
    axis
        Name of the axis; needed only if model and runs leave a choice.
    more
        Paths of effects in addition to those of the catalogue.
    tolerance
        Least change of the prediction of a validation run by an effect, rms [response]; by default 0.05 % of the
        stroke or 0.3 of the noise, whichever is less. A residual below a stated tolerance counts as zero.
    noise
        Standard deviation of the noise of runs, if it is stated [response]; by default it is estimated.
    threads
        Number of simulations at a time.
    progress
        Receives the progress as text.

    Raises
    ------
    InputError
        If the axis is ambiguous, a run does not suit it, or no run may be fitted.
    """
    start_time = perf_counter()
    progress("reading the noise")
    data = prepare(model, runs, axis, tolerance, noise)
    recorded = [each for each in runs if isinstance(each, Run)]
    if oversampled := oversampling_of(recorded, data.name, data.tolerance):
        progress(f"{oversampled.what}: {oversampled.remedy}")
        data = _with_remark(data, f"{oversampled.what}; {oversampled.remedy}")
    with simulating(threads) as each:
        data = choose_interpolation(model, data, each, progress)
        dynamics, task = case_of(model, data, each, progress)

        step_forward = forward
        if is_very_long(data):
            remark = describe(data)
            progress(remark)
            data = _with_remark(data, remark)
            step_forward = partial(forward_in_windows, model, data)
        task, history = search(data, task, dynamics, partial(catalogue, data, dynamics, more=more), step_forward)
        progress("looking at the residual")
        history, conclusion = _conclude(data, task, history, dynamics)
        progress("finding the intervals")
        diagnosis = diagnosis_of(model, data, history, conclusion)
        if conclusion.verdict == "unknown" and (kind := _kind_of_model(data, task, history)):
            diagnosis = replace(diagnosis, remainder=f"{diagnosis.remainder}; {kind}")
    evaluations = sum(fit.solution.problem.evaluations for fit in (history.calibration, *history.fits))
    return replace(diagnosis, evaluations=evaluations, seconds=perf_counter() - start_time)


def _with_remark(data: DiagnosisData, remark: str) -> DiagnosisData:
    """Return the data set with a remark on each of its runs."""
    return replace(data, runs=tuple(replace(run, remarks=(*run.remarks, remark)) for run in data.runs))


def _conclude(
    data: DiagnosisData, task: EstimationTask, history: SelectionHistory, dynamics: AxisDynamics
) -> tuple[SelectionHistory, Conclusion]:
    """Return the history with the parameters that the named effects leave undetermined, and the conclusion."""
    smooth_model = smooth_residual_model(data, task, history.final)
    verdict, named, refusal = decide(data, task, history, smooth_model)
    named, held = hold_undetermined(task, named)
    history = replace(history, undetermined=(*history.undetermined, *held))
    determined = drop_undetermined(task, named)
    if determined is not named:  # the remaining effects must still explain enough
        kept = replace(history, fits=history.levels_to(determined)[1:])
        verdict, named, _ = decide(data, task, kept, smooth_model)
        refusal = refusal or "the 95 % interval of its strength holds its null"
    groups = confusable(task, named, history.steps)
    is_done = {*named.names} == {*history.final.names} and is_adequate(data, history.final, smooth_model)
    reported_conflicts, implied_effects = shown(
        data, task, named, conflicts(data, named), is_done=is_done, others=history.refused_beyond(named)
    )
    task.progress("predicting the test runs")
    scored = [run for run in data.runs if run.name in data.scored]
    error_ladder = [predict_tests(task, fit) for fit in (history.nominal, *history.levels_to(named))]
    return history, Conclusion(
        verdict=verdict,
        refusal=refusal,
        smooth_model=smooth_model,
        error_ladder=error_ladder,
        groups=groups,
        conflicts=reported_conflicts,
        implied_effects=implied_effects,
        offset_residual=np.concatenate([offset_residual(dynamics, run) for run in scored]) if scored else None,
        by_run=of_runs(task, error_ladder[-1]),
    )


def catalogue(
    data: DiagnosisData, dynamics: AxisDynamics, fit: FittedModel, *, more: Sequence[str] = ()
) -> tuple[Candidate, ...]:
    """Return the effects of the catalogue, and those of the paths `more`, as candidates at a calibrated fit."""
    return candidates(
        dynamics,
        more,
        line_frequencies(data, fit) if data.runs else (),
        mode_frequencies(data, fit),
        loaded=data.is_loaded,
        at_stack=data.is_at_stack,
        swings="natural_frequency" in fit.solution.problem.where.names,
        band=None if data.runs else data.band,
    )


def _kind_of_model(data: DiagnosisData, task: EstimationTask, history: SelectionHistory) -> str:
    """Return what kind of model explains more than the effects that were tried, in words; empty if none does."""
    if is_better_linear(data, history.calibration, history.final):
        return LINEAR_IS_BETTER
    return CURVE_IS_BETTER if is_better_curve(data, task, history.calibration, history.final) else ""


#: Shape of a remainder if nonlinear effects only imitate linear dynamics.
LINEAR_IS_BETTER = (
    "a linear system of second order explains more than the effects that were tried, so that the model lacks linear "
    "dynamics, such as a sensor of velocity or acceleration, or a part of the reading that follows the command at once"
)
#: Shape of a remainder if several static effects are the first terms of a series for another curve.
CURVE_IS_BETTER = (
    "a static curve of position and voltage explains more than the effects that were tried, so that the model lacks a "
    "nonlinearity without memory, such as a contact within a part of the stroke, or a sensor that is not straight"
)


def search(
    data: DiagnosisData,
    task: EstimationTask,
    dynamics: AxisDynamics,
    effects: Callable[[FittedModel], Sequence[Candidate]],
    step_forward: Callable[..., Step] = forward,
) -> tuple[EstimationTask, SelectionHistory]:
    """Calibrate and select effects; return the calibrated task, and the history of the selection.

    Parameters
    ----------
    data, task, dynamics
        The data, the task before calibration, and the model of the axis.
    effects
        Returns the candidates at the calibrated fit: trial frequencies follow from its residual.
    step_forward
        Returns the next forward step, as `forward` does.
    """
    calibrated_task = calibrate_task(data, task, dynamics)
    task, calibration = calibrated_task.task, calibrated_task.calibrated
    candidates_ = effects(calibration)
    most = MOST_EFFECTS if data.runs else MOST_EFFECTS_OF_LINES
    selecting = partial(
        select,
        candidates=candidates_,
        most=most,
        expansion_points=calibrated_task.origins,
        vary_step=partial(vary_step, task, candidates=candidates_),
        vary=partial(vary_by_run, task),
        step_forward=step_forward,
    )
    steps, fits = selecting(task, calibration)
    if not (fits or calibrated_task.is_refused):
        restarted = restart_without(task, calibration, steps[-1].trials)
        if restarted is not calibration:
            task, calibration = replace(task, calibrated_excess=restarted.excess), restarted
            steps, fits = selecting(task, calibration)
    last = fits[-1] if fits else calibration
    if not data.runs and (step := add_together(task, last, candidates_, most)) and step.chosen:
        steps, fits = selecting(task, calibration, confirmed=([*steps, step], [*fits, step.chosen.fit]))
    return task, SelectionHistory(
        calibrated_task.nominal,
        calibration,
        tuple(fits),
        tuple(steps),
        calibrated_task.undetermined,
        calibrated_task.is_refused,
    )

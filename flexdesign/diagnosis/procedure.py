"""Diagnosis of one axis: calibrate the model, select effects, and decide what is named.

The numbers of the model itself are fitted first, what finite elements know within its uncertainty, so that no effect is
blamed for a stiffness that is one percent off. Effects are then selected, and the residual is compared with the noise.
They are named if the residual is noise, or if they explain a large share and no smooth function of position,
velocity and voltage explains more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.diagnosis.effect_selection.estimation_setup import (
    PREDICTION_ERROR,
    calibrate_task,
    case_of,
    choose_interpolation,
    simulating,
)
from flexdesign.diagnosis.effect_selection.per_run_parameters import of_runs, vary_by_run, vary_step
from flexdesign.diagnosis.effect_selection.prior_conflicts import conflicts, shown
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, prepare, truncate
from flexdesign.diagnosis.preparation.frequencies import line_frequencies, mode_frequencies
from flexdesign.diagnosis.preparation.initial_conditions import offset_residual
from flexdesign.diagnosis.preparation.oversampling import oversampling_of
from flexdesign.diagnosis.remainder import is_adequate, is_better_linear, smooth_residual_model
from flexdesign.diagnosis.result import Diagnosis, SelectionHistory
from flexdesign.diagnosis.verdict import decide, reach_verdict
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.model_selection.determination import (
    drop_undetermined,
    hold_undetermined,
    restart_from_profiles,
)
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    fit_model,
    predict_tests,
    refine,
    with_effects,
    with_values,
)
from flexdesign.estimation.model_selection.model_comparison import Step, compare
from flexdesign.estimation.model_selection.restarts import escape
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.model_selection.stepwise_selection import add_together, confusable, select
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
        The stage model; its uncertainties say how far its numbers may move.
    runs
        What was recorded, frequency responses among it; where nobody chose roles, they are split.
    axis
        Which one; may be left out where model and runs leave no choice.
    more
        Paths of effects in addition to those of the catalogue.
    tolerance
        How far an effect must move the prediction of a validation run, rms [response]; by default 0.05 % of the
        stroke or 0.3 of the noise, whichever is less. A residual below a stated tolerance counts as none.
    noise
        Standard deviation of the noise of runs, where it is stated [response]; by default it is estimated.
    threads
        Simulations at a time.
    progress
        Receives the progress as text.

    Raises
    ------
    InputError
        If the axis is ambiguous, a run does not suit it, or no run may be fitted.
    """
    began = perf_counter()
    progress("reading the noise")
    data = prepare(model, runs, axis, tolerance, noise)
    recorded = [each for each in runs if isinstance(each, Run)]
    if oversampled := oversampling_of(recorded, data.name, data.tolerance):
        progress(f"{oversampled.what}: {oversampled.remedy}")
        remark = f"{oversampled.what}; {oversampled.remedy}"
        data = replace(data, runs=tuple(replace(run, remarks=(*run.remarks, remark)) for run in data.runs))
    with simulating(threads) as each:
        data = choose_interpolation(model, data, each, progress)
        dynamics, task = case_of(model, data, each, progress)

        preliminary = None
        if (short := truncate(data)) is not None:
            progress("searching in the first part of each run")
            _, case_of_parts = case_of(model, short, each, progress)
            _, preliminary = search(short, case_of_parts, dynamics, partial(catalogue, short, dynamics, more=more))
        task, history = search(data, task, dynamics, partial(catalogue, data, dynamics, more=more), preliminary)
        # Errors of simulation matter where they are not small compared with those of the fitted parameters.
        samples = history.final.solution.problem.dataset.samples
        if history.final.effects and PREDICTION_ERROR**2 * samples > history.final.discrepancy:
            progress("fitting once more, simulated more exactly")
            history = history.with_final(refine(task, history.final))
        progress("looking at the residual")
        if history.final.effects:
            history = history.with_final(restart_from_profiles(task, history.final))
        left = smooth_residual_model(data, task, history.final)
        verdict, named, refusal = decide(data, task, history, left)
        determined, fixed = drop_undetermined(task, named)
        if {*determined.names} < {*named.names}:  # the others must still explain enough
            kept = replace(history, fits=history.levels_to(determined)[1:])
            verdict, determined, _ = decide(data, task, kept, left)
            refusal = refusal or "the 95 % interval of its strength holds its null"
        named = determined
        named, held = hold_undetermined(task, named)
        history = replace(history, undetermined=(*history.undetermined, *fixed, *held))
        groups = confusable(task, named, history.steps)
        is_done = {*named.names} == {*history.final.names} and is_adequate(data, history.final, left)
        beyond, implied_effects = shown(data, task, named, conflicts(data, named), is_done=is_done)
        progress("predicting the test runs")
        scored = [run for run in data.runs if run.name in data.scored]
        alone = np.concatenate([offset_residual(dynamics, run) for run in scored]) if scored else None
        error_ladder = [predict_tests(task, fit) for fit in (history.nominal, *history.levels_to(named))]
        by_run = of_runs(task, error_ladder[-1])
        progress("finding the intervals")
        found = reach_verdict(
            model, data, history, left, verdict, error_ladder, groups, beyond, implied_effects, alone, by_run
        )
        found = replace(found, refusal=refusal)
        if verdict == "unknown" and is_better_linear(data, history.calibration, history.final):
            found = replace(found, remainder=f"{found.remainder}; {LINEAR_IS_BETTER}")
    evaluations = sum(fit.solution.problem.evaluations for fit in (history.calibration, *history.fits))
    return replace(found, evaluations=evaluations, seconds=perf_counter() - began)


def catalogue(
    data: DiagnosisData, dynamics: AxisDynamics, fit: FittedModel, *, more: Sequence[str] = ()
) -> tuple[Candidate, ...]:
    """Return the effects that are tried."""
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


#: What a remainder is said to look like where nonlinear effects only imitate linear dynamics.
LINEAR_IS_BETTER = (
    "a linear system of second order explains more than the effects that were tried, so that the model lacks linear "
    "dynamics, such as a sensor of velocity or acceleration, or a part of the reading that follows the command at once"
)


def search(
    data: DiagnosisData,
    task: EstimationTask,
    dynamics: AxisDynamics,
    effects: Callable[[FittedModel], Sequence[Candidate]],
    preliminary: SelectionHistory | None = None,
) -> tuple[EstimationTask, SelectionHistory]:
    """Calibrate and select effects; return the case as calibrated, and the course of the selection.

    Which effects are tried, and at what values, may follow from the residual of the calibration: `effects` decides.
    Effects that a search `preliminary` found in a part of the runs are fitted first.
    """
    begun = calibrate_task(data, task, dynamics, preliminary)
    task, calibration = begun.task, begun.calibrated
    every = effects(calibration)
    steps, fits = _confirm(task, calibration, preliminary.steps if preliminary else ())
    if fits and fits[-1].exceeds_noise:  # the whole runs may have another minimum than a part of them
        fits[-1] = escape(task, fits[-1])
    most = MOST_EFFECTS if data.runs else MOST_EFFECTS_OF_LINES
    selecting = partial(
        select,
        task,
        calibration,
        every,
        most,
        expansion_points=begun.origins,
        vary_step=partial(vary_step, task, candidates=every),
        vary=partial(vary_by_run, task),
    )
    steps, fits = selecting(confirmed=(steps, fits))
    last = fits[-1] if fits else calibration
    if not data.runs and (step := add_together(task, last, every, most)) and step.chosen:
        steps, fits = selecting(confirmed=([*steps, step], [*fits, step.chosen.fit]))
    return task, SelectionHistory(
        begun.nominal, calibration, tuple(fits), tuple(steps), begun.undetermined, begun.is_refused
    )


def _confirm(task: EstimationTask, fit: FittedModel, steps: Sequence[Step]) -> tuple[list[Step], list[FittedModel]]:
    """Return the steps of a selection in a part of the runs that all of them accept, and the fits after these."""
    confirmed, fits = list[Step](), list[FittedModel]()
    for step in steps:
        if step.chosen is None:
            break
        names = step.chosen.names
        task.progress(f"fitting with {' and '.join((*fit.names, *names))}, the whole runs")
        added = tuple(effect for effect in step.chosen.fit.effects if effect.name in names)
        model = with_values(with_effects(fit.model, added), step.chosen.fit.model)
        made = fit_model(task, task.fine(model), (*fit.effects, *added))
        trial = None if made is None else compare(task, fit, made, names, step.chosen.score)
        if trial is None or trial.reason:
            break
        fit = trial.fit
        fits.append(fit)
        confirmed.append(replace(step, chosen=trial))
    return confirmed, fits

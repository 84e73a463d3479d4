"""Diagnosis of one axis: calibrate the model, select effects, and decide what is named.

The parameters of the model itself are fitted first, those that finite elements determine within their uncertainty, so
that no effect is named for a stiffness that is one percent off. Effects are then selected, and the residual is compared
with the noise. Effects are named if the residual is noise, or if they explain a large share and no smooth function of
position, velocity and voltage explains more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import perf_counter
from typing import Any, Literal, cast

import numpy as np

from flexdesign.core.model import Model
from flexdesign.diagnosis.effect_selection.candidates import catalogue
from flexdesign.diagnosis.effect_selection.estimation_setup import (
    PLAUSIBLE_CHANGE,
    PRIOR_BOUND,
    case_of,
    evaluate_design,
    find_undetermined,
    not_simulated,
    offset_rms,
    simulating,
    with_calibrated_conditions,
)
from flexdesign.diagnosis.effect_selection.per_run_parameters import of_runs, vary_by_run, vary_step
from flexdesign.diagnosis.effect_selection.prior_conflicts import conflicts, shown
from flexdesign.diagnosis.models_without_physics import smooth_residual_model
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, prepare
from flexdesign.diagnosis.preparation.spectra import FEWEST_PER_PERIOD, oversampling_of
from flexdesign.diagnosis.result import Diagnosis
from flexdesign.diagnosis.verdict import Conclusion, decide, diagnosis_of, is_adequate
from flexdesign.diagnosis.windowed_selection import describe, forward_in_windows, windows
from flexdesign.dynamics.axis.axis_model import TRIGGERED_WITHIN, AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import TRIGGER
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.estimation.criterion import INCLUDES_NULL, INDISTINGUISHABLE, is_worse
from flexdesign.estimation.least_squares.levenberg_marquardt import INEXACT
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import (
    FittedModel,
    escape,
    evaluate_fit,
    fit_model,
    predict_tests,
    solve_case,
)
from flexdesign.estimation.model_selection.forward_selection import GROSS_MISFIT, forward
from flexdesign.estimation.model_selection.model_comparison import Step
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.model_selection.stepwise_selection import (
    SelectionHistory,
    add_together,
    confusable,
    drop_undetermined,
    hold_undetermined,
    restart_without,
    select,
)
from flexdesign.measurements.recordings import FrequencyResponse, Run

#: Largest number of effects that are added: a driver, a delay and two modes act in bands of their own.
MOST_EFFECTS = 4
#: Remarks if the intersample behaviour is not stated, by the behaviour that fits better than straight lines.
INTERPOLATION_TEXTS = {
    "smooth": "the command is taken as smooth between its samples, which fits better than straight lines",
    "hold": (
        "nobody says what the command does between its samples: that it is held fits better than straight lines, which "
        'would need a delay of half a sample; if it is held, write between_samples = "hold" in measurements.toml'
    ),
}


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
        progress(": ".join(oversampled))
        data = _with_remark(data, "; ".join(oversampled))
    with simulating(threads) as each:
        data = choose_interpolation(model, data, each, progress)
        dynamics, task = case_of(model, data, each, progress)

        step_forward = forward
        if data.is_very_long:
            remark = describe(data)
            progress(remark)
            data = _with_remark(data, remark)
            step_forward = partial(forward_in_windows, model, data)
        task, history = search(data, task, dynamics, partial(catalogue, data, dynamics, more=more), step_forward)
        progress("looking at the residual")
        history, conclusion = _conclude(data, task, history, dynamics)
        progress("finding the intervals")
        diagnosis = diagnosis_of(model, data, history, conclusion)
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
    verdict, named, refusals = decide(data, task, history, smooth_model)
    named, held = hold_undetermined(task, named)
    history = replace(history, undetermined=(*history.undetermined, *held))
    determined = drop_undetermined(task, named)
    if determined is not named:  # the remaining effects must still explain enough
        kept = replace(history, fits=history.levels_to(determined)[1:])
        lost = [effect for effect in named.effects if effect.name not in determined.names]
        refusals |= {effect.name: f"{effect.strength} {INCLUDES_NULL}" for effect in lost}
        verdict, named, others = decide(data, task, kept, smooth_model)
        refusals |= others
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
        refusals=refusals,
        smooth_model=smooth_model,
        error_ladder=error_ladder,
        groups=groups,
        conflicts=reported_conflicts,
        implied_effects=implied_effects,
        offset_rms=offset_rms(dynamics, scored) if scored else None,
        by_run=of_runs(task, error_ladder[-1]),
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
    selecting = partial(
        select,
        candidates=candidates_,
        most=MOST_EFFECTS,
        expansion_points=calibrated_task.expansion_points,
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
    if not data.runs and (step := add_together(task, last, candidates_, MOST_EFFECTS)) and step.chosen:
        steps, fits = selecting(task, calibration, confirmed=([*steps, step], [*fits, step.chosen.fit]))
    return task, SelectionHistory(
        calibrated_task.nominal,
        calibration,
        tuple(fits),
        tuple(steps),
        calibrated_task.undetermined,
        calibrated_task.is_refused,
    )


# --- calibration -----------------------------------------------------------------------------------------------------


def choose_interpolation(
    model: StageModel, data: DiagnosisData, each: Any, progress: Callable[[str], None]
) -> DiagnosisData:
    """Return the data set with the intersample behaviour that fits better, for commands for which none is stated.

    A measured command is smooth: straight lines reduce a sine of frequency w by the factor (w h)^2 / 12, which looks
    like a lag or a further mode. A command that was sent is often held: straight lines are half a sample early, which
    looks like a delay.
    """
    if all(run.between_is_stated for run in data.runs):
        return data
    progress("asking what commands do between their samples")
    alternative, fits = replace(data, runs=tuple(map(_interpolated_otherwise, data.runs))), list[FittedModel]()
    for variant in (data, alternative):
        searched = windows(variant, {}) if variant.is_very_long else variant
        dynamics, task = case_of(model, searched, each, lambda _: None)
        if (fit := fit_model(task, dynamics)) is None:
            return data
        fits.append(fit)
    critical = INDISTINGUISHABLE * max(fits[0].scale, 1.0)
    return alternative if fits[1].cost < fits[0].cost - critical else data


def _interpolated_otherwise(run: Run) -> Run:
    """Return a run with a command that is not linear between its samples, unless the behaviour is stated."""
    if run.between_is_stated:
        return run
    shape: Literal["hold", "smooth"] = "hold" if run.command_is == "dac" else "smooth"
    return replace(run, between_samples=shape, remarks=(*run.remarks, INTERPOLATION_TEXTS[shape]))


@dataclass(frozen=True, eq=False)
class CalibratedTask:
    """A task with its calibrated model, to which effects are added.

    Parameters
    ----------
    task
        The task, with the free parameters that the runs show, and the initial conditions of the calibrated model.
    nominal, fit, calibrated
        The model as designed, the fit of its parameters, and the one of both that is kept.
    undetermined
        Parameters of the model that the runs do not show.
    is_refused
        Whether calibration increased the validation error, so that the design values are kept.
    """

    task: EstimationTask
    nominal: FittedModel
    fit: FittedModel
    calibrated: FittedModel
    undetermined: tuple[str, ...]
    is_refused: bool

    @property
    def expansion_points(self) -> tuple[FittedModel, ...]:
        """Further fits from which effects are added: at a gross misfit, calibration may have imitated an effect."""
        return (self.nominal,) if self.fit.scale > GROSS_MISFIT and not self.is_refused else ()


def calibrate_task(
    data: DiagnosisData,
    task: EstimationTask,
    dynamics: AxisDynamics,
) -> CalibratedTask:
    """Fit the parameters of the model itself, and prepare the task for added effects.

    Raises
    ------
    InputError
        If the model cannot be simulated at the values it has.
    """
    task.progress("predicting with the model as it is")
    held = find_undetermined(task, dynamics)
    task = replace(task, free=tuple(name for name in task.free if name not in held))
    nominal = evaluate_design(replace(task, prior_bound=PRIOR_BOUND), dynamics)
    task.progress("calibrating")
    fit = calibrate(task, grid_frequency(task, grid_delay(task, dynamics)), nominal)
    if fit is not None:  # the ringing of a mode follows from its calibrated frequency and damping
        task = with_calibrated_conditions(task, cast(AxisDynamics, fit.model), data.rounded(fit))
        fit = fit_model(task, fit.model)
    if fit is None:
        raise not_simulated(dynamics)
    fit = escape(task, fit) if fit.exceeds_noise else fit
    increase = fit.validation_chi2 - nominal.validation_chi2
    is_refused = (
        bool(task.validate.records)
        and is_worse(data.error(fit), data.error(nominal))
        and increase > INDISTINGUISHABLE * fit.discrepancy
    )
    if is_refused or fit.scale > GROSS_MISFIT:
        nominal = evaluate_design(with_calibrated_conditions(task, dynamics, data.rounded(nominal)), nominal.model)
    calibrated = nominal if is_refused else fit
    task = replace(task, calibrated_excess=calibrated.excess)
    return CalibratedTask(task, nominal, fit, calibrated, held, is_refused)


def calibrate(task: EstimationTask, model: Model, nominal: FittedModel | None = None) -> FittedModel | None:
    """Fit the parameters of the model itself from their present values.

    If the design with fitted initial states explains more than that fit, the fit starts from there as well. Random
    starts in the plausible ranges are not used: with measured recordings they led to the same minimum.
    """
    solution = solve_case(task, model, effort=INEXACT)
    if nominal is not None and (solution is None or nominal.cost < solution.cost):
        solution = solve_case(task, nominal.model, effort=INEXACT) or solution
    return None if solution is None else evaluate_fit(task, solution, ())


def grid_delay(task: EstimationTask, dynamics: AxisDynamics) -> AxisDynamics:
    """Return the model with the common trigger delay or lead that fits best on a grid, if that is more than one step.

    If the delay exceeds half a period of the mode, a fit that starts from zero ends in another minimum. The
    grid reaches two periods.
    """
    if not math.isinf(task.prior_bound):
        return dynamics

    def late_by(late: float) -> AxisDynamics:
        return dynamics.replace({f"{run}:{TRIGGER}": late for run in dynamics.apart})

    step = 1 / (FEWEST_PER_PERIOD * dynamics.first.natural_frequency)
    farthest = min(2 / dynamics.first.natural_frequency, TRIGGERED_WITHIN[1])
    delays = np.arange(0.0, farthest, step)
    every = sorted([*delays.tolist(), *(-delays[1:]).tolist()], key=abs)
    best = min(every, key=lambda late: _nuisance_cost(task, late_by(late)))
    return late_by(best) if abs(best) > step else dynamics


def grid_frequency(task: EstimationTask, dynamics: AxisDynamics) -> AxisDynamics:
    """Return the model with the natural frequency that fits best on a grid, if that is more than one step away.

    Farther away than the width of the resonance, derivatives mislead. A payload or a loose part changes the frequency.
    """
    if "natural_frequency" not in task.free:  # the runs do not show it
        return dynamics
    nominal = dynamics.first.natural_frequency

    def tuned(factor: float) -> AxisDynamics:
        return dynamics.replace({"natural_frequency": factor * nominal})

    factors, spacing = np.linspace(1 - PLAUSIBLE_CHANGE, 1 + PLAUSIBLE_CHANGE, 21, retstep=True)
    best = min(factors.tolist(), key=lambda factor: _nuisance_cost(task, tuned(factor)))
    return tuned(best) if abs(best - 1) > 1.5 * spacing else dynamics


def _nuisance_cost(task: EstimationTask, model: AxisDynamics) -> float:
    """Return chi^2 of the fitted runs, with only the nuisance columns fitted."""
    problem = task.problem(task.identify, model)
    residuals = problem.residuals(problem.where.start)
    return math.inf if residuals is None else float(sum(part @ part for part in residuals))

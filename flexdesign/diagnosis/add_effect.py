"""One effect added to a stage model: fitted, judged on validation runs, written with its uncertainty."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from time import perf_counter

import numpy as np

from flexdesign import effects
from flexdesign.core import units
from flexdesign.core.errors import InputError
from flexdesign.core.model import OTHER, Disturbance
from flexdesign.diagnosis import procedure, verdict
from flexdesign.diagnosis.effect_selection import candidates, estimation_setup
from flexdesign.diagnosis.effect_selection.per_run_parameters import of_further_run, of_runs, with_runs
from flexdesign.diagnosis.identify import known_axis
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, prepare
from flexdesign.diagnosis.preparation.spectra import line_frequencies, mode_frequencies
from flexdesign.diagnosis.result import Diagnosis, IdentifiedEffect, ModelResiduals, Value
from flexdesign.dynamics import spectrum
from flexdesign.dynamics.axis.axis_choice import choose_axis
from flexdesign.dynamics.axis.axis_run import acts_before_stack
from flexdesign.dynamics.experiments import AS_MODELLED, simulation, standard_experiments
from flexdesign.dynamics.experiments.simulation import Simulation
from flexdesign.dynamics.stage_dynamics import missing
from flexdesign.dynamics.stage_model import StageModel, fields
from flexdesign.dynamics.stage_model.effect_names import known_effect
from flexdesign.estimation.criterion import HALF_WIDTH, INCLUDES_NULL, NOT_DETERMINED
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, predict_tests
from flexdesign.estimation.model_selection.forward_selection import fit_candidate
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.model_selection.stepwise_selection import SelectionHistory, drop_undetermined
from flexdesign.measurements.recordings import FrequencyResponse, Run

#: What shows an effect in a closed loop: a step and a sine, under these controllers.
SHOWN_REFERENCES, CONTROLLERS = ("step", "sine"), ("robust", "feedforward + robust")


@dataclass(frozen=True, eq=False, kw_only=True)
class AddedEffect(IdentifiedEffect, ModelResiduals):
    """An effect that was added to a stage model, needed or not.

    Parameters
    ----------
    without
        The recalibrated stage model, without the effect.
    calibration
        Fitted values of the parameters of the model itself.
    reason
        Why the effect is not needed; empty if it is.
    seconds
        Time that the fit took [s].
    """

    without: StageModel
    calibration: tuple[Value, ...]
    reason: str
    seconds: float


def add(
    model: StageModel,
    effect: str,
    runs: Sequence[Run | FrequencyResponse],
    *,
    axis: str | None = None,
    noise: float | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> AddedEffect:
    """Fit a stage model with one more effect, needed or not, and state whether it is needed.

    Parameters
    ----------
    model
        The stage model; its uncertainties are the priors of its parameters.
    effect
        A name of the catalogue, or the path of a file.
    runs
        Runs in time and frequency responses; if no roles are stated, they are split.
    axis
        Name of the axis; needed only if model and runs leave a choice.
    noise
        Standard deviation of the noise of runs, if it is stated [response]; by default it is estimated.
    progress
        Receives the progress as text.

    Raises
    ------
    InputError
        If the effect is unknown, acts on the axis already, needs a column that was not recorded or cannot be simulated;
        if the axis is ambiguous, a run does not suit it, or no run may be fitted.
    """
    began = perf_counter()
    name = known_effect(effect, "EFFECT")
    progress("reading the noise")
    data = prepare(model, runs, axis, None, noise)
    _check(data, name, model)
    with estimation_setup.simulating() as each:
        data = procedure.choose_interpolation(model, data, each, progress)
        dynamics, task = estimation_setup.case_of(model, data, each, progress)

        @cache
        def alone(fit: FittedModel) -> tuple[Candidate]:
            lines, peaks = line_frequencies(data, fit), mode_frequencies(data, fit)
            return (candidates.candidate_of(dynamics, name, lines, peaks),)

        task, history = procedure.search(data, task, dynamics, alone)
        (candidate,) = alone(history.calibration)
        final, reason = _fit_addition(task, history, candidate)
        error_ladder = [predict_tests(task, fit) for fit in (history.nominal, history.calibration, final)]
        final = error_ladder[-1]
        values = verdict.values_of(final)
        named = with_runs(verdict.identified_effect(data, error_ladder[1:], name, values), of_runs(task, final))
        own_values = tuple(values[number] for number in verdict.own_numbers(final))
    numbers, fitted_model = [*own_values, *of_further_run(named)], verdict.model_of(model, data, final, values)
    return AddedEffect(
        name=name,
        values=named.values,
        share=named.share,
        by_run=named.by_run,
        axis=data.name,
        before=model,
        without=verdict.model_of(model, data, history.calibration, {}),
        model=with_knowledge(fitted_model, data.name, numbers, data.recorded),
        calibration=own_values,
        error_ladder=verdict.error_steps(data, error_ladder),
        noise=data.noise,
        noise_floor=data.noise_rms,
        reason=reason,
        runs=data.runs,
        residuals_by_run={"calibrated": error_ladder[1].residuals_by_run, "found": final.residuals_by_run},
        seconds=perf_counter() - began,
        responses=data.responses,
        lines=data.lines,
    )


def _fit_addition(task: EstimationTask, history: SelectionHistory, candidate: Candidate) -> tuple[FittedModel, str]:
    """Return the fit with an effect, and why the effect is not needed."""
    step = history.steps[0]
    if not step.trials:  # the effect has no significant score; its interval then says how large it may be at most
        return fit_candidate(task, history.calibration, candidate), "no more than chance gives"
    best = step.chosen or step.trials[0]
    if best.reason and not best.reason.endswith(NOT_DETERMINED):
        return best.fit, best.reason
    # Trials are compared by the covariance; the interval that is stated with the effect decides.
    return best.fit, "" if drop_undetermined(task, best.fit) is best.fit else f"{candidate.strength} {INCLUDES_NULL}"


def _check(data: DiagnosisData, name: str, model: StageModel) -> None:
    """Refuse an effect that the model has already, or that the runs cannot show."""
    effect, number = effects.find(name), fields.AXIS_FIELDS.get(name)
    numbers = {**data.axis.numbers, "controller.delay": model.controller.delay}
    remedy = ""
    if name in candidates.NOISE_EFFECTS:
        remedy = "is noise to a fit, which leaves it out; write sensor.resolution into the model"
    elif name in data.axis.effects or (number and numbers[number] not in (0.0, math.inf)):
        place = f"{data.name}.{number}" if number else f"{data.name}.effects.{name}"
        remedy = f"acts on axis {data.name} already (axis.{place}); identify --free fits its numbers"
    elif data.is_at_stack and acts_before_stack(effect):
        remedy = "acts ahead of the stack, and these runs know the voltage at the stack: none of it is left to show"
    elif not data.runs and not spectrum.shows(effect):
        remedy = "changes nothing about small sines, which are all that frequency responses show; add runs in time"
    if remedy:
        raise InputError("command line", "EFFECT", name, remedy)
    for run in data.runs:
        if lacking := missing(data.name, effect, run.columns):
            needs = " and ".join("the response of another axis" if c == OTHER else f"a column {c}" for c in lacking)
            raise InputError(run.name, name, None, f"the effect needs {needs}, which the run lacks; leave the run out")


def size(
    model: StageModel,
    runs: Sequence[Run | FrequencyResponse],
    axis: str | None,
    option: str,
    text: str | None,
) -> float | None:
    """Return an option that is a size of the response [response], given with its unit or in percent of the stroke.

    Raises
    ------
    InputError
        If it is no positive number with a unit of the response, or a percentage.
    """
    if text is None:
        return None
    try:
        if text.strip().endswith("%"):
            value = units.from_text(text, "1") * prepare(model, runs, axis, None).stroke
        else:
            value = units.from_text(text, model.axes[choose_axis(model, runs, axis)].response, small=True)
        if not value > 0:
            raise ValueError("must be more than zero")
    except ValueError as error:
        raise InputError("command line", option, text, str(error)) from None
    return value


# --- uncertainty of the parameters --------------------------------------------------------------------------------


def values(found: Diagnosis) -> list[Value]:
    """Return all parameters that a diagnosis fitted, those of the model itself first."""
    return [*found.calibration, *(value for named in found.effects for value in of_further_run(named))]


def with_knowledge(
    model: StageModel, axis: str, fitted_values: Sequence[Value], runs: Sequence[Run | FrequencyResponse]
) -> StageModel:
    """Return a stage model that states the uncertainty of fitted parameters, and the runs they are from.

    Parameters
    ----------
    model, axis
        The model with the values.
    fitted_values
        Values with their 95 % intervals; the half-width over 1.96 becomes the standard deviation, relative.
    runs
        The runs, of which those of role ``identify`` are named as the source.
    """
    fitted_runs = list(dict.fromkeys(run.name.partition(":")[0] for run in runs if run.role == "identify"))
    numbers = model.axes[axis].numbers
    relative = {v.parameter.name: _relative(v) for v in fitted_values if v.parameter.name in numbers}
    return replace(model, axes={**model.axes, axis: known_axis(model.axes[axis], relative, fitted_runs)})


def _relative(value: Value) -> float:
    low, high = value.interval
    return (high - low) / (2 * HALF_WIDTH * abs(value.value)) if value.value and math.isfinite(high - low) else math.inf


# --- effect on a closed loop ------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class InTheLoop:
    """A closed loop without and with an effect.

    Parameters
    ----------
    simulation
        A step and a sine under controllers that were tuned on the stage without the effect; None if none could be run.
    reason
        Why not.
    """

    simulation: Simulation | None
    reason: str = ""


def in_the_loop(
    names: Sequence[str],
    axis: str,
    without: StageModel,
    model: StageModel,
    progress: Callable[[str], None] = lambda _: None,
) -> InTheLoop:
    """Simulate a closed loop on a stage without some effects and with them (`names`, on one axis).

    The controllers are tuned on the stage without them, as its owner would have tuned them.
    """
    added = [effects.find(name) for name in names]
    for effect in added:
        lacking = missing(axis, effect, {axis: np.zeros(0)})
        if lacking and all(isinstance(face, Disturbance) for face in effect.faces):
            other = ["another axis that moves" if each == OTHER else f"a record of {each}" for each in lacking]
            return InTheLoop(None, f"the effect needs {' and '.join(other)}, which these experiments do not have")
    with_effects = f"with {' and '.join(effect.name.replace('_', ' ') for effect in added)}"
    bare, full = (
        replace(each, axes={axis: each.axes[axis]}, coupling=type(each.coupling)()) for each in (without, model)
    )
    variants = {AS_MODELLED: bare, with_effects: full}
    wanted = {"controllers": CONTROLLERS, "variants": tuple(variants)}
    try:
        plan = standard_experiments.plan(bare)
        chosen = [e.model_copy(update=wanted) for e in plan.experiments if e.name.partition(" ")[0] in SHOWN_REFERENCES]
        return InTheLoop(simulation.run(bare, variants, replace(plan, experiments=tuple(chosen)), progress))
    except InputError as error:
        return InTheLoop(None, f"{error.field} {error.remedy}".strip())

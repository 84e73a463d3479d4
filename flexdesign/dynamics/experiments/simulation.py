"""Experiments on a stage: every controller on every variant, what came out of it, and what to beware of."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from flexdesign.core import units
from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError, suggest
from flexdesign.core.model import Quantity
from flexdesign.dynamics import disturbances
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.control import feedforward
from flexdesign.dynamics.control import pid as pids
from flexdesign.dynamics.control.margins import Margins, margins
from flexdesign.dynamics.control.sampled_loop import open_loop
from flexdesign.dynamics.experiments import AS_MODELLED, MEASURES, Experiment, Plan, Published, evaluate, pieces
from flexdesign.dynamics.experiments.loop_design import Designer, plant
from flexdesign.dynamics.simulate import Loop, Response
from flexdesign.dynamics.stage_model import AxisModel, StageModel

Progress = Callable[[str], None]
#: Samples of the response for one period of the fastest mode, so that no peak falls between them.
SAMPLES_PER_PERIOD = 25
#: What is said where readings are late.
LATE_READING = "readings are {} late; the loop is simulated with a command that is as late: motions are shown so, too"


@dataclass(frozen=True)
class Compared:
    """A published number compared with ours: None where ours could not be measured."""

    published: Published
    ours: Quantity | None
    axis: str


@dataclass(frozen=True)
class Case:
    """One controller on one variant of the stage.

    Parameters
    ----------
    experiment, variant, controller
        What was tried.
    axes
        Names of all axes of the stage, in the order of the arrays.
    reference
        What was asked for on the response's time, axes by samples: command [V] or motion [m].
    response
        What came of it.
    measures
        For each axis that moved, by name.
    pid, margins
        For each axis in a closed loop.
    cautions
        What to beware of, in sentences.
    """

    experiment: Experiment
    variant: str
    controller: str
    axes: tuple[str, ...]
    reference: Array
    response: Response
    measures: Mapping[str, tuple[Quantity, ...]]
    pid: Mapping[str, pids.PID]
    margins: Mapping[str, Margins]
    cautions: tuple[str, ...]

    def row(self, axis: str) -> int:
        """Return the row of an axis in the arrays."""
        return self.axes.index(axis)

    def measure(self, axis: str, name: str) -> Quantity | None:
        """Return a measure of an axis, or None."""
        return next((q for q in self.measures.get(axis, ()) if q.name == name), None)


class NoController(ValueError):
    """A rule or a search gives no controller for this stage."""


@dataclass(frozen=True)
class Skipped:
    """A run that could not be made, and why."""

    experiment: Experiment
    variant: str
    controller: str
    reason: str


@dataclass(frozen=True)
class Simulation:
    """All cases of a plan.

    Parameters
    ----------
    model, plan
        What was run.
    variants
        The stage models, by name of the variant.
    cases
        In the order of the plan.
    skipped
        What could not be run, because no controller was found.
    """

    model: StageModel
    plan: Plan
    variants: Mapping[str, StageModel]
    cases: tuple[Case, ...]
    skipped: tuple[Skipped, ...] = ()

    def of(self, experiment: Experiment) -> list[Case]:
        """Return the cases of an experiment."""
        return [case for case in self.cases if case.experiment.name == experiment.name]

    def compare_published(self, experiment: Experiment) -> list[tuple[Case, Compared]]:
        """Return published numbers compared with ours, for every case they belong to."""
        found = []
        for case in self.of(experiment):
            for published in experiment.published:
                axes = [published.axis] if published.axis else list(case.measures)
                if published.controller in ("", case.controller):
                    found += [(case, Compared(published, case.measure(axis, published.measure), axis)) for axis in axes]
        return found


def run(model: StageModel, variants: Mapping[str, StageModel], plan: Plan, progress: Progress) -> Simulation:
    """Run every experiment of a plan.

    Parameters
    ----------
    model
        The stage as modelled.
    variants
        The changed stages, by name.
    plan
        What to run.
    progress
        Receives the progress as text.

    Raises
    ------
    InputError
        If an axis responds in another unit than a length, or a trajectory cannot be sampled at the controller's rate.
    """
    known = {AS_MODELLED: model, **variants}
    for name, axis in model.axes.items():
        if axis.response != "m":
            remedy = "is no length; experiments are in micrometres, so give a model of such an axis to identify alone"
            raise InputError(f"{model.name}.toml", f"axis.{name}.gain", f"in {axis.response}/V", remedy)
        for measure in axis.fitted:
            if measure not in MEASURES:
                remedy = f"is not a known measure{suggest(measure, list(MEASURES))}"
                raise InputError(f"{model.name}.toml", f"axis.{name}.fitted", measure, remedy)
    if plan.cycled:
        known = {
            name: replace(v, axes={n: stages.after_full_cycles(a) for n, a in v.axes.items()})
            for name, v in known.items()
        }
        model = known[AS_MODELLED]
    designers = {stage.controller.rate: Designer(plan, 1.0 / stage.controller.rate) for stage in known.values()}
    for experiment in plan.experiments:  # what cannot be sampled is refused before anything is run
        for variant in experiment.variants:
            _sample_trajectory(plan, experiment, 1.0 / known[variant].controller.rate)
    cases, skipped = list[Case](), list[Skipped]()
    count, began = sum(len(each.variants) * len(each.controllers) for each in plan.experiments), perf_counter()
    for experiment in plan.experiments:
        for variant in experiment.variants:
            for controller in experiment.controllers:
                done = len(cases) + len(skipped)
                left = f", about {(perf_counter() - began) * (count / done - 1):.0f} s left" if done else ""
                progress(f"run {done + 1} of {count}{left}: {experiment.name}, {controller}, {variant}")
                design_model = model if _believes_otherwise(plan, variant) else known[variant]
                designer = designers[known[variant].controller.rate]
                try:
                    cases.append(_case(experiment, variant, controller, known[variant], design_model, designer))
                except NoController as error:
                    skipped.append(Skipped(experiment, variant, controller, str(error)))
    return Simulation(model, plan, known, tuple(cases), tuple(skipped))


def _believes_otherwise(plan: Plan, variant: str) -> bool:
    return variant in plan.variants and not plan.variants[variant].controllers_know


def _case(
    experiment: Experiment,
    variant: str,
    controller: str,
    truth: StageModel,
    design_model: StageModel,
    designer: Designer,
) -> Case:
    period, delay = designer.period, truth.controller.delay
    wanted = _sample_trajectory(designer.plan, experiment, period)
    loops, found, seen, cautions = {}, {}, {}, list[str]()
    for name, asked in zip(experiment.axes, wanted, strict=True):
        axis = design_model.axes[name]
        command, controllers = np.zeros_like(asked), []
        for piece in pieces(controller):
            if piece == "open loop":
                gain = stages.secant_gain(axis) * axis.driver.gain
                command = asked if experiment.command is not None else feedforward.secant(asked, gain)
            elif piece == "feedforward":
                command = _inverse(design_model, name, asked, period)
            else:
                try:
                    found[name] = designer.pid(piece, name, axis, design_model.controller.delay)
                except InputError as error:
                    raise NoController(f"{name}: the {error.file} {error.remedy}") from error
                if len(pieces(controller)) > 1:  # what a feedforward does must not look like a disturbance
                    found[name] = replace(found[name], proportional_weight=1.0, derivative_weight=1.0)
                controllers.append(pids.controller(found[name], piece))
                actual = plant(truth.axes[name], delay)
                seen[name] = margins(open_loop(actual, found[name], period))
                cautions += [f"{name}: {text}" for text in actual.concerns(period)]
                if not seen[name].stable:
                    cautions.append(f"{name}: {seen[name].says()}")
        cautions += _beyond(name, command, truth.axes[name])
        cautions += [
            f"{name}: {c}."
            for effect, values in stages.active_effects(truth.axes[name])
            for c in effect.cautions(values)
        ]
        loops[name] = Loop(command, asked if controllers else None, tuple(controllers))
    fastest = max(mode.frequency for axis in stages.stage(truth).axes for mode in axis.modes)
    finer = max(1, math.ceil(SAMPLES_PER_PERIOD * fastest * period))
    cautions += [
        f"{name}: {text}" for name in experiment.axes for text in disturbances.inactive_disturbances(truth, name)
    ]
    late = max(truth.axes[name].sensor.delay for name in experiment.axes)
    if late:
        cautions.append(LATE_READING.format(units.to_text(late, "ms", 3)))
    response = disturbances.run(truth, loops, period, delay=delay + late, oversampling=finer)
    reference = _on_response(experiment, list(truth.axes), response, period / finer)
    cautions += _ran(response, list(truth.axes), experiment)
    measured, unmeasured = evaluate.measure(
        experiment, reference, response, list(truth.axes), period / finer, bool(found)
    )
    written = truth.axes[experiment.axes[0]].response_units.large
    measured = {name: tuple(_in_unit(q, written) for q in quantities) for name, quantities in measured.items()}
    remarks, axes = tuple(dict.fromkeys([*cautions, *unmeasured])), tuple(truth.axes)
    return Case(experiment, variant, controller, axes, reference, response, measured, found, seen, remarks)


def _in_unit(quantity: Quantity, unit: str) -> Quantity:
    """Return a measure of a motion written in the unit of the axis: ``um/V`` becomes ``mm/V``."""
    motions = {"m": unit, "m/V": f"{unit}/V", "m*V": f"{unit}*V"}
    return replace(quantity, unit=motions.get(quantity.si, quantity.unit))


def _sample_trajectory(plan: Plan, experiment: Experiment, period: float) -> Array:
    """Return the trajectory, one row for each axis of the experiment."""
    number, key = plan.experiments.index(experiment) + 1, "command" if experiment.command is not None else "reference"
    try:
        rows = experiment.trajectory.sampled(period)
        if rows.shape[-1] < 3:
            raise ValueError(f"is over after {rows.shape[-1]} samples of {1e3 * period:g} ms; make it longer")
    except ValueError as error:
        raise InputError(plan.file, f"experiment {number} ({experiment.name}).{key}", None, str(error)) from error
    return np.broadcast_to(rows, (len(experiment.axes), rows.shape[-1]))


def _inverse(model: StageModel, name: str, asked: Array, period: float) -> Array:
    """Return the feedforward command that an axis model says gives the motion, its clock and lags made up for."""
    axis, delay = model.axes[name], model.controller.delay
    lag = 1 / (2 * math.pi * axis.driver.bandwidth)
    early = feedforward.advance(asked, period, 0.5 * period + delay + lag)
    try:
        return feedforward.inverse(early, axis.gain, axis.effects.get("bouc_wen")) / axis.driver.gain
    except ValueError as error:
        slope = f"{1e6 * axis.effects['bouc_wen']['a']:g} um/V"
        raise InputError(f"{model.name}.toml", f"axis.{name}.hysteresis.a", slope, str(error)) from error


def _on_response(experiment: Experiment, axes: Sequence[str], response: Response, period: float) -> Array:
    """Return what was asked on the response's finer samples; axes that were not asked for rest."""
    count = response.motion.shape[1]
    rows = np.zeros((len(axes), count))
    finer = np.atleast_2d(experiment.trajectory.sampled(period))[:, :count]
    for name, asked in zip(
        experiment.axes, np.broadcast_to(finer, (len(experiment.axes), finer.shape[1])), strict=True
    ):
        rows[axes.index(name)] = np.pad(asked, (0, count - len(asked)), mode="edge")
    return rows


# --- what to beware of ------------------------------------------------------------------------------------------


def _beyond(name: str, command: Array, axis: AxisModel) -> list[str]:
    low, high = stages.command_limits(axis)
    worst = command[np.argmax(np.maximum(command - high, low - command))]
    if low <= worst <= high:
        return []
    allowed = f"{units.to_text(low, 'V', 4)} to {units.to_text(high, 'V', 4)}"
    return [f"{name}: the command asks for {units.to_text(worst, 'V', 4)}, and {allowed} are allowed: it is cut off."]


def _ran(response: Response, axes: Sequence[str], experiment: Experiment) -> list[str]:
    remarks = []
    if response.diverged is not None:
        remarks.append(f"the motion runs away: the simulation stopped at {units.to_text(response.diverged, 's', 3)}.")
    for name in experiment.axes:
        cut = np.abs(response.cut[axes.index(name)]) > 0
        if cut.any():
            first = response.time[np.argmax(cut)]
            share = units.significant(100 * cut.mean(), 2)
            remarks.append(f"{name}: limits cut the command {share} % of the time, first at {first:.3g} s.")
    if response.diverged is None and response.error > 1e-5:
        remarks.append(f"the integration error is estimated at {response.error:.1e} of the span, more than usual.")
    return remarks


def validity(model: StageModel) -> list[str]:
    """Return what makes a model doubtful before anything is run: assumed numbers, and a clock too slow for it."""
    remarks = []
    for name, axis in model.axes.items():
        if axis.assumed:
            numbers = ", ".join(_with_ratio(axis, number) for number in axis.assumed)
            remarks.append(f"{name}: assumed, neither measured nor computed: {numbers}.")
        if axis.absent:
            remarks.append(f"{name}: not in the model, and assumed to be none: {', '.join(axis.absent)}.")
        if math.isnan(axis.gain):
            remarks.append(f"{name}: no gain, as the design states no actuator.voltage_range; simulations need it.")
        else:
            remarks += [f"{name}: {text}" for text in plant(axis, 0.0).concerns(1 / model.controller.rate)]
    return remarks


def _with_ratio(axis: AxisModel, number: str) -> str:
    """Return the name of a number, a damping ratio with its value."""
    ratio = number.rpartition(".")[2] == "damping_ratio" and axis.numbers.get(number)
    return f"{number} = {ratio:.3g}" if ratio else number


def stage_model_cautions(model: StageModel | None) -> list[str]:
    """Return what makes a stage model doubtful that a validation hands over; nothing where it hands over none."""
    return [f"Stage model, {text}" for text in group_by_axis(validity(model))] if model else []


def group_by_axis(sentences: Sequence[str]) -> list[str]:
    """Say once what `validity` says of several axes."""
    axes: dict[str, list[str]] = {}
    for sentence in sentences:
        axis, _, text = sentence.partition(": ")
        axes.setdefault(text, []).append(axis)
    return [f"{', '.join(names)}: {text}" for text, names in axes.items()]

"""Parameters that the runs move beyond their prior, and the physics that such a change represents.

A natural frequency that is far below what mass and stiffness give, each known to a few percent, is a payload or a soft
support; a gain beyond its uncertainty is a sensor out of calibration; runs that all begin late share a delay. The
prediction is the same either way: the prior decides, and not the runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.special import stdtrit

from flexdesign import effects
from flexdesign.core.errors import join_names
from flexdesign.core.model import Parameter, parameter_of
from flexdesign.diagnosis.effect_selection.candidates import SHOWN_BY_MASS
from flexdesign.diagnosis.preparation.dataset import GRID_TOLERANCE, DiagnosisData
from flexdesign.diagnosis.result import IdentifiedEffect, Value
from flexdesign.dynamics import spectrum
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.axis.axis_parameters import DELAY, SENSOR_DELAY, TRIGGER
from flexdesign.estimation.criterion import HALF_WIDTH, LARGE, significant_deviation
from flexdesign.estimation.least_squares.levenberg_marquardt import INEXACT
from flexdesign.estimation.least_squares.residual_function import value
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, fit_model
from flexdesign.estimation.model_selection.model_comparison import is_relevant


@dataclass(frozen=True, eq=False)
class Conflict:
    """A parameter beyond its prior.

    Parameters
    ----------
    words
        The parameter, its change and the significance, in words.
    group
        Effects that the change can represent; empty if none is known.
    named
        The first of these with its value; None if there is none.
    written
        Returns the model with the effect in it, and the parameter at its prior.
    number
        Name of the parameter; empty if the finding is from the readings themselves.
    rms
        Rms of the change of the readings, if the finding is from the readings themselves [response].
    is_overdamped
        Whether it is a damping ratio above what its prior and a softer support explain.
    """

    words: str
    group: tuple[str, ...] = ()
    named: IdentifiedEffect | None = None
    written: Callable[[AxisDynamics], AxisDynamics] = lambda model: model
    number: str = ""
    rms: float = 0.0
    is_overdamped: bool = False


def conflicts(data: DiagnosisData, fit: FittedModel) -> tuple[Conflict, ...]:
    """Return the parameters that moved beyond their prior, and what it may represent."""
    where = fit.solution.problem.where
    values, found = where.values(fit.solution.x), []
    small = _of_small_motions(fit, values)
    free = {name: about for name, about in data.known.items() if name in where.names}
    for name, (middle, sigma) in free.items():
        j = where.names.index(name)
        ratio, far = values[name] / middle, (values[name] - middle) / sigma
        # The prior may hold for small motions, for large ones, or for the range that a design was drawn for.
        low, high = sorted((values[name], small.get(name, values[name])))
        if max(low - middle, middle - high) <= significant_deviation() * sigma:
            continue
        words = f"{name} {100 * (ratio - 1):+.1f} %, {abs(far):.1f} standard deviations of the prior"
        if name == "gain" and not 1 / LARGE <= ratio <= LARGE:
            found.append(Conflict(_structural(ratio), number=name))
            continue
        x, half = float(fit.solution.x[j]), fit.half_width(j)
        # The uncertainty of the prior counts, too, however precisely the runs determine the present value.
        deviations = [abs(value(where.parameters[j], end) / middle - ratio) for end in (x - half, x + half)]
        wide = math.hypot(max(deviations), HALF_WIDTH * sigma / abs(middle) * ratio)
        ends = [ratio - wide, ratio + wide]
        is_determined = not ends[0] <= 1 <= ends[1]  # else the runs do not determine the change
        if is_determined and name == "natural_frequency" and far < 0:
            found.append(_frequency_shift(data, words, ratio, ends, is_stiffness=_follows(data, values)))
        elif is_determined and name == "gain":
            if not _follows(data, values):  # else a softer support changed the gain as well
                found.append(_gain_shift(data, words, ratio, ends))
        else:
            # c / (2 sqrt(k m)) falls with more mass, and grows with less stiffness as the frequency falls.
            slower = min(values.get("natural_frequency", math.inf) / data.axis.natural_frequency, 1.0)
            is_overdamped = name == "damping_ratio" and slower * values[name] - middle > significant_deviation() * sigma
            found.append(Conflict(words, number=name, is_overdamped=is_overdamped))
    more = (_delay_shift(data, fit), _quantisation(data))
    return (*found, *(conflict for conflict in more if conflict is not None))


def _of_small_motions(fit: FittedModel, values: Mapping[str, float]) -> dict[str, float]:
    """Return natural frequency and gain for small motions, with the stiffness and hysteresis of the added effects.

    The prior may include the stiffness of a spring, or exclude the part of the gain that hysteresis holds back in small
    motions, while an added effect now states it separately. The gain over a range lies between that of small motions
    and that of the largest ones, which hysteresis leaves behind.
    """
    model = cast(AxisDynamics, fit.model)
    added = {name: model.axis.effects[name] for name in fit.names if name in model.axis.effects}
    chain = stages.chain(model.name, replace(model.axis, effects=added))
    stiffer = max(1.0 + spectrum.added_stiffness(chain), 1.0)
    made = {}
    if "natural_frequency" in values:
        made["natural_frequency"] = values["natural_frequency"] * math.sqrt(stiffer)
    if "gain" in values:
        slope = max(abs(values["gain"]) + spectrum.added_gain(chain), 0.0)
        made["gain"] = math.copysign(slope / stiffer, values["gain"])
    return made


def _structural(ratio: float) -> str:
    """Return in words that no calibration error is as large as the ratio of a fitted gain to that of the design."""
    return (
        f"the fitted gain is {ratio:.2g} times that of the model. No calibration is that far off: a unit or a channel "
        "is wrong, or the structure of the model does not hold for these runs"
    )


def shown(
    data: DiagnosisData,
    task: EstimationTask,
    fit: FittedModel,
    found: Sequence[Conflict],
    *,
    is_done: bool,
    others: Sequence[FittedModel] = (),
) -> tuple[tuple[Conflict, ...], list[Conflict]]:
    """Return which conflicts are reported, and which of these imply an effect.

    If the residual exceeds the noise, a conflict must explain much to imply an effect or shifted columns. A conflict of
    an effect that is not implied is reported all the same. Two conflicts imply no effect, as they may imitate something
    else: a lower frequency of a mode that is overdamped besides, as with a lag; and a change that is absent from one of
    the other fits, which explain more with an effect that is not named.
    """
    beyond, implied = list[Conflict](), list[Conflict]()
    is_overdamped = any(conflict.is_overdamped for conflict in found)
    for conflict in found:
        is_claim = conflict.named is not None or conflict.number == TRIGGER
        is_possible = not (is_overdamped and conflict.number == "natural_frequency")
        if not is_done and (instead := _absent_with(data, fit, conflict, others)):
            is_possible, conflict = False, replace(conflict, words=f"{conflict.words}, but not with {instead}")
        is_shown = not is_claim or is_done or (is_possible and explains(data, task, fit, conflict))
        beyond += [conflict] if is_shown or conflict.named is not None else []
        implied += [conflict] if is_shown and conflict.named is not None else []
    return tuple(beyond), implied


def displaced(data: DiagnosisData, task: EstimationTask, calibration: FittedModel, fit: FittedModel) -> list[str]:
    """Return which of gain and natural frequency the effects of a fit moved far beyond their prior, and relevantly.

    That is by more than a factor of `criterion.LARGE`, which calibration alone did not need: effects and parameters
    then balance each other. At the end of its plausible range a parameter is judged as such.
    """

    def is_far(of: FittedModel, name: str) -> bool:
        where = of.solution.problem.where
        ratio = where.values(of.solution.x).get(name, data.known[name][0]) / data.known[name][0]
        return not 1 / LARGE <= ratio <= LARGE

    beyond = {conflict.number for conflict in conflicts(data, fit)} & {"gain", "natural_frequency"}
    far = [name for name in sorted(beyond - {*fit.ends()}) if is_far(fit, name) and not is_far(calibration, name)]
    return [name for name in far if is_relevant(task, fit, {name: data.known[name][0]})]


def _absent_with(data: DiagnosisData, fit: FittedModel, conflict: Conflict, others: Sequence[FittedModel]) -> str:
    """Return the effects with which a parameter is not beyond its prior, in words; empty if it always is."""
    if conflict.named is None or not conflict.number:
        return ""
    for other in others:
        if not any(each.number == conflict.number and each.named for each in conflicts(data, other)):
            return join_names([name.replace("_", " ") for name in other.names if name not in fit.names])
    return ""


def explains(data: DiagnosisData, task: EstimationTask, fit: FittedModel, conflict: Conflict) -> bool:
    """Return whether a parameter beyond its prior explains much compared with the residual, as an effect must.

    The fit is repeated with the parameter held at its prior.
    """
    rest = data.error(fit) ** 2 - data.known_noise(data.selecting) ** 2
    if not conflict.number:
        return conflict.rms**2 >= LARGE * rest
    model = cast(AxisDynamics, fit.model)
    if conflict.number == TRIGGER:
        task = replace(task, prior_bound=1.0)
        held = model.replace({f"{run}:{TRIGGER}": 0.0 for run in model.apart})
    else:
        task = replace(task, free=tuple(name for name in task.free if name != conflict.number))
        held = model.replace({conflict.number: data.known[conflict.number][0]})
    without = fit_model(task, held, fit.effects, effort=INEXACT)
    return without is None or data.error(without) ** 2 - data.error(fit) ** 2 >= LARGE * rest


def _follows(data: DiagnosisData, values: Mapping[str, float]) -> bool:
    """Tell whether gain and natural frequency changed as with a lower stiffness: gain times frequency^2 is constant.

    The stiffness falls with the square of the frequency, and x = F / k grows. The gain must be beyond its prior.
    """
    known = data.known
    if not {"gain", "natural_frequency"} <= known.keys():
        return False
    ratio = values.get("natural_frequency", data.axis.natural_frequency) / data.axis.natural_frequency
    if ratio > 1 - significant_deviation() * known["natural_frequency"][1] / known["natural_frequency"][0]:
        return False
    middle, sigma = known["gain"]
    rose = values["gain"] / middle
    return (values["gain"] - middle) * math.copysign(1.0, middle) > significant_deviation() * sigma and (
        abs(rose * ratio**2 - 1) < significant_deviation() * sigma / abs(middle)
    )


def _frequency_shift(
    data: DiagnosisData, words: str, ratio: float, ends: list[float], *, is_stiffness: bool
) -> Conflict:
    """Return the conflict of a lower natural frequency: more mass, or less stiffness."""
    # With a run of known payload, a change of the table's own mass would have been distinguished.
    is_mass = not (data.is_loaded or is_stiffness)
    group = (SHOWN_BY_MASS, "stiffness_loss") if is_mass else ("stiffness_loss",)
    name, numbers = group[0], [r**-2 - 1 if is_mass else 1 - r**2 for r in (ratio, *reversed(ends))]
    axis = data.axis

    def written(model: AxisDynamics) -> AxisDynamics:
        faster = {
            "natural_frequency": axis.natural_frequency,
            "damping_ratio": model.axis.damping_ratio * (1 / ratio if is_mass else ratio),
        }
        if not is_mass:
            faster["gain"] = model.axis.gain * ratio**2
        return _with(model.replace(faster), name, {"ratio": numbers[0]})

    return Conflict(words, group, _identified_effect(name, "ratio", numbers), written, "natural_frequency")


def _gain_shift(data: DiagnosisData, words: str, ratio: float, ends: list[float]) -> Conflict:
    """Return the conflict of another gain: that of the sensor, the amplifier, or the stack."""
    numbers, axis = [r - 1 for r in (ratio, *ends)], data.axis

    def written(model: AxisDynamics) -> AxisDynamics:
        return _with(model.replace({"gain": axis.gain}), "sensor_gain", {"error": numbers[0]})

    return Conflict(words, ("sensor_gain",), _identified_effect("sensor_gain", "error", numbers), written, "gain")


def _delay_shift(data: DiagnosisData, fit: FittedModel) -> Conflict | None:
    """Return the conflict of a trigger delay, or a lead, that all runs have in common; None if there is none."""
    where, variances = fit.solution.problem.where, np.diag(fit.solution.covariance)
    priors = [where.known.get(name, (0.0, math.inf))[1] for name in where.names]
    places = [  # of runs that say more of their delay than the prior does
        j for j, name in enumerate(where.names) if name.endswith(f":{TRIGGER}") and 2 * variances[j] < priors[j] ** 2
    ]
    if (count := len(places)) < 2:
        return None
    late, jitter = fit.solution.x[places], max(priors[j] for j in places)
    mean, least = float(np.mean(late)), significant_deviation() * jitter / math.sqrt(count)
    if mean < -least:
        words = (
            f"all runs began early, by {-1e3 * mean:.3g} ms in the mean: the reading answers before the command, so "
            "that their columns are shifted against each other"
        )
        # A command that is linear between its samples acts half a sample earlier than a held one.
        if any(run.between_samples == "hold" and run.between_is_stated for run in data.runs):
            words += ", or the command was not held between its samples, as `between_samples` says"
        return Conflict(words, number=TRIGGER)
    words = f"all runs began late, by {1e3 * mean:.3g} ms in the mean"
    if mean > least and np.isclose(late, [where.parameters[j].plausible[1] for j in places], rtol=1e-6, atol=0).any():
        return Conflict(f"{words}, the most that is plausible", number=TRIGGER)  # by how much is then unknown
    # Runs with less jitter than the prior determine their common delay better; a few hardly determine the scatter.
    half = float(stdtrit(count - 1, 0.975) * np.std(late, ddof=1)) / math.sqrt(count)
    # Common errors, such as that of the natural frequency, do not scatter between runs.
    half = max(half, fit.half_width_of(np.isin(np.arange(len(priors)), places) / count))
    if mean <= max(least, half):
        return None
    # If the command is the voltage at the stack, only the sensor can have a delay.
    effect, number = ("sensor_delay", SENSOR_DELAY) if data.is_at_stack else ("transport_delay", DELAY)
    parameter = parameter_of(fit.model, number)
    total = (parameter.start or 0.0) + mean
    named = IdentifiedEffect(effect, (Value(parameter, total, (total - half, total + half)),), 0.0)
    return Conflict(words, (effect,), named, lambda model: model.replace({number: total}), TRIGGER)


def _quantisation(data: DiagnosisData) -> Conflict | None:
    """Return the conflict of readings in coarse steps; None if they are not."""
    step = data.coarse_step
    if step is None:
        return None
    p = effects.find("quantisation").parameters[0]
    readings = np.concatenate([run.measured() for run in data.runs])
    error = GRID_TOLERANCE * step / len(np.unique(readings[np.isfinite(readings)]))
    rms = step / math.sqrt(12)
    is_irrelevant = data.is_asked and rms < data.tolerance
    named = IdentifiedEffect("quantisation", (Value(p, step, (step - error, step + error)),), 0.0)

    def written(model: AxisDynamics) -> AxisDynamics:
        return replace(model, axis=replace(model.axis, sensor=replace(model.axis.sensor, resolution=step)))

    words = "readings come in whole steps"
    return Conflict(words, ("quantisation",), None if is_irrelevant else named, written, rms=rms)


def _with(model: AxisDynamics, name: str, values: Mapping[str, float]) -> AxisDynamics:
    effects_ = {**model.axis.effects, name: dict(values)}
    return replace(model, axis=replace(model.axis, effects=effects_))


def _identified_effect(name: str, key: str, numbers: list[float]) -> IdentifiedEffect:
    parameter: Parameter = next(p for p in effects.find(name).parameters if p.name == key)
    low, high = sorted(numbers[1:])
    return IdentifiedEffect(name, (Value(replace(parameter, name=f"{name}.{key}"), numbers[0], (low, high)),), 0.0)

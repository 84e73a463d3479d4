"""From a stage model to a stage that runs: the effects that its parameters represent."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.core.errors import InputError
from flexdesign.core.model import OTHER, Adjust, Block, Disturbance, Effect, Resonance, Socket
from flexdesign.dynamics.signal_chain.chain import AxisChain, Oscillator, by_name
from flexdesign.dynamics.simulate import Stage
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.effects import bouc_wen
from flexdesign.measurements.recordings import AXES


def stage(model: StageModel) -> Stage:
    """Return a stage model's axes, coupling, limits and noise, ready to run."""
    names = list(model.axes)
    return Stage(
        tuple(chain(name, axis) for name, axis in model.axes.items()),
        np.eye(len(names)) + _matrix(names, model.coupling.linear),
        _matrix(names, model.coupling.quadratic),
        {name: command_limits(axis) for name, axis in model.axes.items()},
        {name: axis.sensor.noise for name, axis in model.axes.items()},
    )


def chain(name: str, axis: AxisModel) -> AxisChain:
    """Return the chain of one axis, its numbers and modes as its effects leave them."""
    given = by_name(active_effects(axis))
    numbers = _main_mode(axis, given)
    further = [Oscillator(mode.frequency, mode.damping_ratio, mode.share) for mode in axis.modes]
    for effect, values in given:
        further += [Oscillator(*face.mode(values)) for face in effect.faces if isinstance(face, Resonance)]
    share = 1.0 - sum(mode.share for mode in further)
    main = Oscillator(numbers["natural_frequency"], numbers["damping_ratio"], share)
    return AxisChain(name, numbers["gain"], (main, *further), tuple(given), axis.driver.gain)


def main_mode(axis: AxisModel) -> dict[str, float]:
    """Return natural frequency, damping ratio and gain of the main mode as the effects of an axis leave them, SI."""
    return _main_mode(axis, by_name(active_effects(axis)))


def _main_mode(axis: AxisModel, given: Sequence[tuple[Effect, Mapping[str, float]]]) -> dict[str, float]:
    numbers = {"natural_frequency": axis.natural_frequency, "damping_ratio": axis.damping_ratio, "gain": axis.gain}
    for effect, values in given:
        for face in effect.faces:
            if isinstance(face, Adjust) and face.of == "axis":
                numbers = face.apply(numbers, values)
    return numbers


def disturbance(
    name: str, axis: AxisModel, recorded: Mapping[str, NDArray[np.float64]], time: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return what the effects of an axis add to its reading in a recorded run [response], n values; None if nothing.

    Parameters
    ----------
    name, axis
        The axis and its numbers.
    recorded
        The columns of the run by name, n values each, SI.
    time
        Of the samples [s].

    Raises
    ------
    InputError
        If an effect needs a column that is not recorded; the message names it.
    """
    there, given = with_other(name, recorded), active_effects(axis)
    for effect, _ in by_name(given):
        if lacking := missing(name, effect, recorded):
            column = f"the response of another axis ({', '.join(each for each in AXES if each != name)})"
            needs = " and ".join(column if each == OTHER else f"a column {each}" for each in lacking)
            remedy = f"needs {needs}, which was not recorded; leave the effect or the run out"
            raise InputError("model", f"axis.{name}.effects.{effect.name}", None, remedy)
    return AxisChain(name, axis.gain, (), tuple(given)).disturbance(time, there)


def has_disturbance(axis: AxisModel) -> bool:
    """Tell whether an effect of an axis adds to its reading."""
    return any(isinstance(face, Disturbance) for effect, _ in active_effects(axis) for face in effect.faces)


def missing(name: str, effect: Effect, recorded: Mapping[str, NDArray[np.float64]]) -> tuple[str, ...]:
    """Return the columns that an effect on the axis `name` needs and a run lacks; `OTHER` for another axis."""
    there = with_other(name, recorded)
    columns = (column for face in effect.faces if isinstance(face, Disturbance) for column in face.columns)
    return tuple(dict.fromkeys(column for column in columns if column not in there))


def with_other(name: str, recorded: Mapping[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """Return recorded columns and, as `OTHER`, the first response of another axis than `name`, if there is one."""
    others = [each for each in AXES if each != name and each in recorded]
    return {**recorded, **({OTHER: recorded[others[0]]} if others else {})}


def active_effects(axis: AxisModel) -> list[tuple[Effect, Mapping[str, float]]]:
    """Return the effects of an axis with their values, those of driver and sensor among them."""
    named = dict(axis.effects)
    named |= {
        "driver_bandwidth": {"bandwidth": axis.driver.bandwidth},
        "driver_slew": {"slew": axis.driver.slew},
        "sensor_bandwidth": {"bandwidth": axis.sensor.bandwidth},
        "quantisation": {"step": axis.sensor.resolution},
    }
    found = [(effects.find(name), values) for name, values in named.items()]
    return [(effect, values) for effect, values in found if not effect.is_null(values)]


def stack_range(axis: AxisModel) -> tuple[float, float]:
    """Return the lowest and highest voltage at the stack: the narrower of what driver and actuator allow [V]."""
    ranges = [axis.driver.limits, axis.actuator.voltage_range if axis.actuator else None]
    known = [span for span in ranges if span is not None]
    return max((low for low, _ in known), default=-math.inf), min((high for _, high in known), default=math.inf)


def command_limits(axis: AxisModel) -> tuple[float, float]:
    """Return the lowest and highest command: those that give the ends of the range at the stack [V]."""
    first, last = sorted(limit / axis.driver.gain for limit in stack_range(axis))
    return first, last


def _matrix(names: list[str], entries: Mapping[tuple[str, str], float]) -> NDArray[np.float64]:
    matrix = np.zeros((len(names), len(names)))
    for (to, source), value in entries.items():
        matrix[names.index(to), names.index(source)] = value
    return matrix


def secant_gain(axis: AxisModel) -> float:
    """Return the chord of the steady loop over the whole range at the stack, or k_v where there is no range [m/V].

    It is what a user sees who divides stroke by voltage: less than k_v by what hysteresis holds back.
    """
    gain = main_mode(axis)["gain"]
    return math.copysign(abs(gain) - held_back(axis), gain)


def held_back(axis: AxisModel) -> float:
    """Return by how much hysteresis makes the chord of the steady loop over the whole range less steep [m/V]."""
    low, high = stack_range(axis)
    hysteresis = axis.effects.get("bouc_wen")
    if hysteresis is None or not math.isfinite(high - low):
        return 0.0
    bottom, top = _steady(hysteresis, low, high)
    return (top - bottom) / (high - low)


def after_full_cycles(axis: AxisModel) -> AxisModel:
    """Return an axis that was cycled over its whole range of voltage and rests at zero volts, where motion counts zero.

    One whose hysteresis says where it rests, or whose range has no ends or not zero in it, is returned as it is. So is
    one with a further hysteresis: that one starts as it was before the first voltage, and both have one past.
    """
    hysteresis = axis.effects.get("bouc_wen")
    low, high = stack_range(axis)
    if any(_remembers_motion(effect) for effect, _ in active_effects(axis) if effect.name != "bouc_wen"):
        return axis
    if hysteresis is None or hysteresis.get("rest") or not math.isfinite(high - low) or not low <= 0 <= high:
        return axis
    bottom, _ = _steady(hysteresis, low, high)
    # Where the gain is negative the hysteresis runs with the voltage upside down, and it is odd.
    rest = math.copysign(1.0, axis.gain) * bouc_wen.advance(bottom, low, 0.0, *_numbers(hysteresis))
    return replace(axis, effects={**axis.effects, "bouc_wen": {**hysteresis, "rest": rest}})


def _remembers_motion(effect: Effect) -> bool:
    """Tell whether an effect depends on where the stage came from: a hysteresis, or a force with states."""
    blocks = (face for face in effect.faces if isinstance(face, Block) and face.socket is Socket.FORCE)
    return effect.is_hysteresis or any(block.remembers for block in blocks)


def _steady(hysteresis: Mapping[str, float], low: float, high: float) -> tuple[float, float]:
    """Return the hysteresis at both ends of a steady loop."""
    bottom = top = 0.0
    for _ in range(5):
        bottom = bouc_wen.advance(top, high, low, *_numbers(hysteresis))
        top = bouc_wen.advance(bottom, low, high, *_numbers(hysteresis))
    return bottom, top


def _numbers(hysteresis: Mapping[str, float]) -> tuple[float, float, float, float]:
    return hysteresis["a"], hysteresis["b"], hysteresis["c"], hysteresis["n"]

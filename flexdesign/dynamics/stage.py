"""From a stage model to a stage that runs: which effects its numbers stand for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.dynamics.chain import AxisChain, Oscillator
from flexdesign.dynamics.simulate import Stage
from flexdesign.effects import bouc_wen
from flexdesign.model import Effect
from flexdesign.stage_model import AxisModel, StageModel


def stage(model: StageModel) -> Stage:
    """Return a stage model's axes, coupling, limits and noise, ready to run."""
    names = list(model.axes)
    return Stage(
        tuple(chain(name, axis) for name, axis in model.axes.items()),
        np.eye(len(names)) + _matrix(names, model.coupling.linear),
        _matrix(names, model.coupling.quadratic),
        {name: limits(axis) for name, axis in model.axes.items()},
        {name: axis.sensor.noise for name, axis in model.axes.items()},
    )


def chain(name: str, axis: AxisModel) -> AxisChain:
    """Return the chain of one axis."""
    main = Oscillator(axis.natural_frequency, axis.damping_ratio, 1.0 - sum(mode.share for mode in axis.modes))
    further = (Oscillator(mode.frequency, mode.damping_ratio, mode.share) for mode in axis.modes)
    return AxisChain(name, axis.gain, (main, *further), tuple(acting(axis)), axis.driver.gain)


def acting(axis: AxisModel) -> list[tuple[Effect, Mapping[str, float]]]:
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


def limits(axis: AxisModel) -> tuple[float, float]:
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
    low, high = stack_range(axis)
    hysteresis = axis.effects.get("bouc_wen")
    if hysteresis is None or not math.isfinite(high - low):
        return axis.gain
    bottom, top = _steady(hysteresis, low, high)
    return math.copysign(abs(axis.gain) - (top - bottom) / (high - low), axis.gain)


def cycled(axis: AxisModel) -> AxisModel:
    """Return an axis that was cycled over its whole range of voltage and rests at zero volts, where motion counts zero.

    One whose hysteresis says where it rests, or whose range has no ends or not zero in it, is returned as it is.
    """
    hysteresis = axis.effects.get("bouc_wen")
    low, high = stack_range(axis)
    if hysteresis is None or hysteresis.get("rest") or not math.isfinite(high - low) or not low <= 0 <= high:
        return axis
    bottom, _ = _steady(hysteresis, low, high)
    # Where the gain is negative the hysteresis runs with the voltage upside down, and it is odd.
    rest = math.copysign(1.0, axis.gain) * bouc_wen.advance(bottom, low, 0.0, *_numbers(hysteresis))
    return replace(axis, effects={**axis.effects, "bouc_wen": {**hysteresis, "rest": rest}})


def _steady(hysteresis: Mapping[str, float], low: float, high: float) -> tuple[float, float]:
    """Return the hysteresis at both ends of a steady loop."""
    bottom = top = 0.0
    for _ in range(5):
        bottom = bouc_wen.advance(top, high, low, *_numbers(hysteresis))
        top = bouc_wen.advance(bottom, low, high, *_numbers(hysteresis))
    return bottom, top


def _numbers(hysteresis: Mapping[str, float]) -> tuple[float, float, float, float]:
    return hysteresis["a"], hysteresis["b"], hysteresis["c"], hysteresis["n"]

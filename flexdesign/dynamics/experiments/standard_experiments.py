"""Experiments for a stage of which no study exists: each axis within its range, by controllers that need no numbers.

Hysteresis over the whole range, a step of a tenth of the stroke, a sine and a staircase over most of it.
"""

from __future__ import annotations

import math

from flexdesign.core.errors import InputError
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.experiments import Experiment, Plan
from flexdesign.dynamics.stage_model import AxisModel, StageModel

#: Of a stroke, that references stay within.
SHARE = 0.8
#: Time constants of the slowest mode for which a step is watched.
WATCHED = 8.0


def plan(model: StageModel) -> Plan:
    """Return experiments for every axis of a stage.

    Raises
    ------
    InputError
        If an axis has no range of voltage, rests outside of it, or does not move along a length.
    """
    file = f"{model.name}.toml" if model.name else "stage model"
    found = [experiment for name, axis in model.axes.items() for experiment in _of(name, axis, file)]
    return Plan("standard", "standard experiments", "", tuple(found), {}, {}, 1.6, True)


def _of(name: str, axis: AxisModel, file: str) -> list[Experiment]:
    low, high = stages.command_limits(axis)
    field = f"axis.{name}.actuator.voltage_range"
    if not math.isfinite(high - low):
        remedy = 'is missing, so no range to try; write voltage_range = ["0 V", "150 V"], or name a study'
        raise InputError(file, field, None, remedy)
    if not low <= 0 <= high:
        remedy = "does not hold zero volts, where a stage rests before a run; name a study of experiments"
        raise InputError(file, field, f"{low:g} V to {high:g} V", remedy)
    if axis.response != "m":
        raise InputError(file, f"axis.{name}.gain", axis.response, "is no length; name a study for this axis")
    gain = stages.secant_gain(axis) * axis.driver.gain
    farthest = gain * (high if high >= -low else low)  # from rest
    away, stroke = math.copysign(1.0, farthest), abs(gain) * (high - low)
    far = f"{1e6 * SHARE * farthest:.4g} um"
    ends = {"low": "0 um", "high": far} if away > 0 else {"low": far, "high": "0 um", "begin": "high"}
    modes = [(axis.natural_frequency, axis.damping_ratio), *((m.frequency, m.damping_ratio) for m in axis.modes)]
    slowest = max(1 / (2 * math.pi * frequency * max(min(damping, 1.0), 1e-3)) for frequency, damping in modes)
    closed = ("feedforward", "ziegler-nichols", "robust", "feedforward + robust")
    waves = {"frequency": "1 Hz", "cycles": 3}
    limits = {"low": f"{low:.6g} V", "high": f"{high:.6g} V"}
    tables = (
        ("hysteresis", "whole range of voltage", {"command": {"shape": "triangle", **limits, **waves}}, ("open loop",)),
        ("step", "a tenth of the stroke", {"reference": _step(0.1 * away * stroke, slowest)}, ("open loop", *closed)),
        ("sine", "1 Hz", {"reference": {"shape": "sine", **ends, **waves}}, ("open loop", *closed)),
        ("staircase", "ten stairs", {"reference": _stairs(far, slowest)}, ("open loop", *closed)),
    )
    return [
        Experiment.model_validate(
            {"name": f"{what} {name}", "title": title, "axes": (name,), "controllers": controllers, **asked}
        )
        for what, title, asked, controllers in tables
    ]


def _step(size: float, slowest: float) -> dict[str, str]:
    held = f"{max(WATCHED * slowest, 0.05):.4g} s"
    return {"shape": "step", "start": "0 um", "target": f"{1e6 * size:.4g} um", "wait": "20 ms", "hold": held}


def _stairs(far: str, slowest: float) -> dict[str, object]:
    return {
        "shape": "staircase",
        "low": "0 um",
        "high": far,
        "steps": 10,
        "dwell": f"{max(WATCHED * slowest, 0.05):.4g} s",
    }

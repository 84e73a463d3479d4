"""Inverse feedforward: the voltage that the model says gives the motion wanted (eq (27) of Lin et al., 2019)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.dynamics.signal_chain import kernels
from flexdesign.effects import bouc_wen


def secant(wanted: Array, gain: float) -> Array:
    """Return the command of a user who knows a gain alone [m/V]: wanted over gain."""
    return wanted / gain


def inverse(wanted: Array, gain: float, hysteresis: Mapping[str, float] | None) -> Array:
    """Return the voltages at which k_v v - h is the displacement wanted, one after the other.

    Parameters
    ----------
    wanted
        Displacement at each sample [m].
    gain
        k_v, signed [m/V].
    hysteresis
        a, b, c, n of Bouc-Wen in SI, or None.

    Raises
    ------
    ValueError
        If the hysteresis is so steep that a displacement belongs to several voltages: k_v <= a.
    """
    if hysteresis is None or hysteresis["a"] == 0:
        return wanted / gain
    if not abs(gain) > hysteresis["a"]:
        raise ValueError("the hysteresis is steeper than the gain (a >= k_v): there is no inverse")
    constants = [abs(gain), *bouc_wen.constants(hysteresis, 0.0)]
    return math.copysign(1.0, gain) * kernels.run_ticks(bouc_wen.invert, wanted, 2, constants)


def advance(wanted: Array, period: float, lead: float) -> Array:
    """Return a motion earlier by `lead` [s]: what a held and late command must aim at.

    A held command acts half a sample late on average, on top of the loop's delay.
    """
    time = period * np.arange(len(wanted))
    return np.interp(time + lead, time, wanted)

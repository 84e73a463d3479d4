"""Bandwidth of the voltage amplifier into the stack's capacitance: a first-order lag between command and voltage."""

from __future__ import annotations

import math

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.effects import _lag

EFFECT = Effect(
    name="driver_bandwidth",
    physics="The amplifier charges the stack's capacitance through its output resistance, so the voltage lags behind.",
    where="the voltage amplifier, between command and stack",
    reveal="a frequency response, or a step recorded faster than the lag; best the voltage at the stack itself",
    remedy="a faster amplifier, a lighter electrical load on it, or a model of the lag in the feedforward",
    remedies={
        PIEZO: "a stronger amplifier, a lower capacitance, or a model of the lag in the feedforward",
        "voice coil": "a current amplifier with more voltage, less inductance, or the lag in the feedforward",
        "motor": "a faster current loop, or a model of the lag in the feedforward",
    },
    reference="A. J. Fleming and K. K. Leang, Design, Modeling and Control of Nanopositioning Systems (2014)",
    parameters=(
        Parameter(
            "bandwidth",
            "Hz",
            "Hz",
            "-3 dB frequency of the loaded amplifier",
            math.inf,
            1e3,
            (1.0, 1e6),
            "inverse",
            screen=(30.0, 60.0, 120.0, 250.0, 500.0, 1000.0, 2000.0),
        ),
    ),
    faces=(
        Block(
            Socket.DRIVER,
            mode="replace",
            states=("v",),
            constants=_lag.constants,
            move=_lag.move,
            transfer=_lag.transfer,
        ),
    ),
    confused_with=("transport_delay", "sensor_bandwidth"),
    is_linear=True,
)

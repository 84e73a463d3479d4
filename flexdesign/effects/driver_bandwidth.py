"""Bandwidth of the voltage amplifier into the stack's capacitance: a first-order lag between command and voltage."""

from __future__ import annotations

from flexdesign.core.model import PIEZO, Effect, Socket
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
    parameters=(_lag.bandwidth("-3 dB frequency of the loaded amplifier"),),
    faces=(_lag.first_order(Socket.DRIVER, "v"),),
    confused_with=("transport_delay", "sensor_bandwidth"),
    is_linear=True,
)

"""Bandwidth of the position sensor: a first-order lag between motion and reading."""

from __future__ import annotations

import math

from flexdesign.core.model import Block, Effect, Parameter, Socket
from flexdesign.effects import _lag

EFFECT = Effect(
    name="sensor_bandwidth",
    physics="The sensor's electronics average over time, so the reading lags behind the motion.",
    where="the position sensor, between motion and reading",
    reveal="a frequency response against a faster sensor, or the sensor's own setting changed between two runs",
    remedy="a higher bandwidth setting of the sensor (more noise), or the lag in the model of the loop",
    reference="A. J. Fleming, A review of nanometer resolution position sensors, Sens. Actuators A 190 (2013)",
    parameters=(
        Parameter(
            "bandwidth",
            "Hz",
            "Hz",
            "-3 dB frequency of the sensor",
            math.inf,
            1e3,
            (1.0, 1e6),
            "inverse",
            screen=(30.0, 60.0, 120.0, 250.0, 500.0, 1000.0, 2000.0),
        ),
    ),
    faces=(
        Block(
            Socket.SENSOR,
            mode="replace",
            states=("y",),
            constants=_lag.constants,
            move=_lag.move,
            transfer=_lag.transfer,
        ),
    ),
    confused_with=("transport_delay", "driver_bandwidth"),
    is_linear=True,
)

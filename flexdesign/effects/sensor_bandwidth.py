"""Bandwidth of the position sensor: a first-order lag between motion and reading."""

from __future__ import annotations

from flexdesign.core.model import Effect, Socket
from flexdesign.effects import _lag

EFFECT = Effect(
    name="sensor_bandwidth",
    physics="The sensor's electronics average over time, so the reading lags behind the motion.",
    where="the position sensor, between motion and reading",
    reveal="a frequency response against a faster sensor, or the sensor's own setting changed between two runs",
    remedy="a higher bandwidth setting of the sensor (more noise), or the lag in the model of the loop",
    reference="A. J. Fleming, A review of nanometer resolution position sensors, Sens. Actuators A 190 (2013)",
    parameters=(_lag.bandwidth("-3 dB frequency of the sensor"),),
    faces=(_lag.first_order(Socket.SENSOR, "y"),),
    confused_with=("transport_delay", "driver_bandwidth"),
    is_linear=True,
)

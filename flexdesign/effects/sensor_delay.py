"""Delay of the position sensor: a reading is late. The stage model has a number for it."""

from __future__ import annotations

from flexdesign.core.model import Effect, Parameter

EFFECT = Effect(
    name="sensor_delay",
    physics=(
        "A digital sensor converts, filters and sends over a bus, so that a reading is late. Unlike a lag that changes "
        "no amplitude: the phase falls in proportion to frequency. Where the voltage at the stack was recorded, a "
        "delay of the command is no part of what is seen, and this one is."
    ),
    where="the position sensor, between motion and reading: sensor.delay of the stage model",
    reveal="steps of the voltage at the stack, recorded faster than the delay: the reading begins late, at full slope",
    remedy="a sensor with less filtering or a faster bus, or the delay in the design of the controller",
    reference="A. J. Fleming, A review of nanometer resolution position sensors, Sens. Actuators A 190 (2013)",
    parameters=(
        Parameter(
            "delay",
            "s",
            "ms",
            "how late readings are",
            0.0,
            1e-3,
            (0.0, 0.05),
            screen=(2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2),
        ),
    ),
    faces=(),
    confused_with=("transport_delay", "sensor_bandwidth"),
    is_linear=True,
)

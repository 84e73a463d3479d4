"""Transport delay: a command acts some time after it was given. The stage model has a number for it."""

from __future__ import annotations

from flexdesign.core.model import Effect, Parameter

EFFECT = Effect(
    name="transport_delay",
    physics=(
        "Sampling, computing, a bus and the converters take time, so that a command acts late. Unlike a lag it changes "
        "no amplitude: the phase falls in proportion to frequency."
    ),
    where="between the controller's output and the amplifier: controller.delay of the stage model",
    reveal="steps recorded faster than the delay, or a multisine: phase in proportion to frequency up to the highest",
    remedy="a faster loop, fewer buffers on the way, or the delay in the design of the controller",
    reference="K. J. Astrom and B. Wittenmark, Computer-Controlled Systems (1997)",
    parameters=(
        Parameter(
            "delay",
            "s",
            "ms",
            "how late commands act",
            0.0,
            1e-3,
            (0.0, 0.05),
            screen=(2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2),
        ),
    ),
    faces=(),
    confused_with=("driver_bandwidth", "sensor_bandwidth"),
    is_linear=True,
)

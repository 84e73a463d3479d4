"""The noise level of the response of an axis."""

from __future__ import annotations

import math
from collections.abc import Sequence

from flexdesign.dynamics.stage_model import AxisModel
from flexdesign.measurements.noise_level import NoiseFloor, noise_floor
from flexdesign.measurements.recordings import Run

#: Decades of decay after which a mode has rung down.
DECAY_DECADES = 3.0


def noise_of_axis(runs: Sequence[Run], name: str, axis: AxisModel) -> NoiseFloor:
    """Return the noise of the response of an axis, whose main mode rings down before a stretch is quiet."""
    return noise_floor(runs, name, settling_time=settling(axis), sensor_noise=axis.sensor.noise)


def settling(axis: AxisModel) -> float:
    """Return how long the main mode takes to decay by three decades [s].

    >>> from flexdesign.dynamics.stage_model import AxisModel
    >>> round(settling(AxisModel(118.3, 0.0242, 2e-6)), 3)
    0.384
    """
    rate = 2 * math.pi * axis.natural_frequency * min(max(axis.damping_ratio, 1e-3), 1.0)
    return DECAY_DECADES * math.log(10) / rate

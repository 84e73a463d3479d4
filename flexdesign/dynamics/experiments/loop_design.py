"""Controllers for the axes of a stage: the plant of a linear design, and the gains of a controller."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.control import ziegler_nichols
from flexdesign.dynamics.control.pid import PID, controller
from flexdesign.dynamics.control.plant import Plant
from flexdesign.dynamics.control.tuning import Tuning, tune
from flexdesign.dynamics.experiments import Plan
from flexdesign.dynamics.simulate import Loop, simulate
from flexdesign.dynamics.stage_model import AxisModel, StageModel

#: Length of the experiment that seeks the ultimate gain, in time constants of the slowest decay.
EXPERIMENT = 12.0
#: Least number of oscillations of the main mode.
OSCILLATIONS = 100.0
#: Voltage whose open-loop response is the size of its step.
EXPERIMENT_STEP = 1.0


def plant(axis: AxisModel, delay: float) -> Plant:
    """Return what a linear controller sees of an axis: its modes behind the secant gain, driver and sensor as lags.

    Parameters
    ----------
    axis
        The axis. A driver or a sensor of infinite bandwidth has no lag.
    delay
        Delay of the loop in addition to the hold and the sensor [s].
    """
    bandwidths = (axis.driver.bandwidth, axis.sensor.bandwidth)
    lags = tuple(1 / (2 * math.pi * bandwidth) for bandwidth in bandwidths if math.isfinite(bandwidth))
    share = axis.main_share
    further = tuple((mode.frequency, mode.damping_ratio, mode.share / share) for mode in axis.modes)
    gain = stages.secant_gain(axis) * axis.driver.gain * share
    return Plant(gain, axis.natural_frequency, axis.damping_ratio, delay + axis.sensor.delay, further, lags)


class Designer:
    """Makes controllers for the axes of a stage, each search once.

    Parameters
    ----------
    plan
        Where given gains and the limit of sensitivity come from.
    period
        Sampling period [s].
    """

    def __init__(self, plan: Plan, period: float) -> None:
        self.plan, self.period = plan, period
        self._robust = cache(self._tune)

    def pid(self, piece: str, name: str, axis: AxisModel, delay: float) -> PID:
        """Return the PID of a controller's name, for an axis and a loop delay [s].

        Raises
        ------
        InputError
            If a rule or a search finds none.
        """
        seen = plant(axis, delay)
        if piece in self.plan.controllers:
            gains = self.plan.controllers[piece].axis[name]
            return PID(gains.in_volts(seen.static_gain), gains.ti, gains.td)
        # Tuned for the mirrored plant where the gain is negative, and mirrored back.
        sign = math.copysign(1.0, seen.gain)
        upright = replace(seen, gain=abs(seen.gain))
        if piece == "ziegler-nichols":
            found = ziegler_nichols.rule(ziegler_nichols.ultimate(upright.discretise(self.period)))
        elif piece == "ziegler-nichols by experiment":
            return self._by_experiment(axis, seen)
        else:
            found = self._robust(upright).pid
        return found.scaled(sign)

    def _tune(self, seen: Plant) -> Tuning:
        return tune(seen, self.period, self.plan.robust_ms)

    def _by_experiment(self, axis: AxisModel, seen: Plant) -> PID:
        """Return the rule's PID from the oscillation of the simulated axis itself, hysteresis and all."""
        alone = StageModel({"x": replace(axis, sensor=replace(axis.sensor, noise=0.0))})
        stage = replace(stages.stage(alone), limits={})
        times = [1 / (2 * math.pi * frequency * damping) for frequency, damping, _ in seen.all_modes if damping > 0]
        slowest = max([*times, *seen.lags])
        count = math.ceil(max(EXPERIMENT * slowest, OSCILLATIONS / seen.natural_frequency) / self.period)
        step = np.full(count, EXPERIMENT_STEP * abs(seen.static_gain))

        def respond(kp: float) -> Array:
            loop = Loop(np.zeros(count), step, (controller(PID(kp)),))
            response = simulate(stage, {"x": loop}, self.period, delay=seen.delay, tolerance=1e-5)
            return response.reading[0]

        return ziegler_nichols.rule(ziegler_nichols.by_experiment(respond, self.period, 0.1 / seen.static_gain))

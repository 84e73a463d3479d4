"""Linear control design: plants and PIDs in a sampled loop, margins, tuning, and what printed gains imply.

Everything here is linear and exact for a zero-order hold with any delay. Hysteresis, limits and creep belong to the
simulator, which takes what `controller` returns.
"""

from flexdesign.dynamics.control.margins import Margins, margins
from flexdesign.dynamics.control.pid import PID, controller
from flexdesign.dynamics.control.plant import Plant
from flexdesign.dynamics.control.sampled_loop import open_loop, settling_time, simulate, stable_ranges
from flexdesign.dynamics.control.tuning import Tuning, assess, tune
from flexdesign.dynamics.control.ziegler_nichols import Ultimate, by_experiment, rule, ultimate

__all__ = [
    "PID",
    "Margins",
    "Plant",
    "Tuning",
    "Ultimate",
    "assess",
    "by_experiment",
    "controller",
    "margins",
    "open_loop",
    "rule",
    "settling_time",
    "simulate",
    "stable_ranges",
    "tune",
    "ultimate",
]

"""What is measured on responses: steps, tracking, hysteresis loops, contours, coupling.

All functions take samples at equal distances, in metres (or in volts, for an electronic analogue), and the sampling
period in seconds. Between samples the signals go straight.
"""

from flexdesign.dynamics.metrics.axes import Contour, Coupling, contour, coupling
from flexdesign.dynamics.metrics.following import Tracking, tracking
from flexdesign.dynamics.metrics.loops import Loop, loop
from flexdesign.dynamics.metrics.steps import StepResponse, step_response

__all__ = [
    "Contour",
    "Coupling",
    "Loop",
    "StepResponse",
    "Tracking",
    "contour",
    "coupling",
    "loop",
    "step_response",
    "tracking",
]

"""A first-order lag, tau y' = u - y, stepped exactly: what several effects share."""

from __future__ import annotations

import math

import numpy as np

from flexdesign import linear
from flexdesign.model.effect import Floats, Values


def constants(values: Values, step: float) -> tuple[float, ...]:
    """Return transition and weights to the middle and to the end of a step, and the step over the lag's time."""
    rate = 2 * math.pi * values["bandwidth"]
    return *to(rate, step, 0.5), *to(rate, step, 1.0), rate * step


def to(rate: float, step: float, until: float) -> tuple[float, ...]:
    """Return transition and weights of y' = rate (u - y) over a part of a step."""
    passed = linear.step(np.array([[-rate]]), np.array([rate]), step, until)
    return float(passed.transition[0, 0]), *map(float, passed.weights[0])


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Follow the input with tau y' = u - y, exactly.

    The three values stand for a parabola. After a jump of the input the lag is no parabola; the first value is then
    set so that the parabola has the lag's own mean, which keeps a lag that is much faster than the step from passing
    for a ramp. For a smooth input that changes nothing: Simpson's rule is of fourth order.
    """
    y, u0, u1, u2 = state[0], path[0], path[1], path[2]
    middle = constants[0] * y + constants[1] * u0 + constants[2] * u1 + constants[3] * u2
    end = constants[4] * y + constants[5] * u0 + constants[6] * u1 + constants[7] * u2
    first = y
    if constants[8] > 0.01:  # below, rounding would be larger than the difference
        first = u0 + 4.0 * u1 + u2 - 6.0 * (end - y) / constants[8] - 4.0 * middle - end
    out[0] += first
    out[1] += middle
    out[2] += end
    state[0] = end

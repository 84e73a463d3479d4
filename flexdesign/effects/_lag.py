"""A first-order lag, tau y' = u - y, stepped exactly: what several effects share."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Block, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values


def bandwidth(meaning: str) -> Parameter:
    """Return the parameter of a lag, its -3 dB frequency; infinite without a lag."""
    screen = (30.0, 60.0, 120.0, 250.0, 500.0, 1000.0, 2000.0)
    return Parameter("bandwidth", "Hz", "Hz", meaning, math.inf, 1e3, (1.0, 1e6), "inverse", screen=screen)


def first_order(socket: Socket, state: str) -> Block:
    """Return the block of a lag, whose state is its output."""
    return Block(socket, mode="replace", states=(state,), constants=constants, move=move, transfer=transfer)


def constants(values: Values, step: float) -> tuple[float, ...]:
    """Return transition and weights to the middle and to the end of a step, and the step over the lag's time."""
    rate = 2 * math.pi * values["bandwidth"]
    return *to(rate, step, 0.5), *to(rate, step, 1.0), rate * step


@lru_cache(maxsize=4096)
def to(rate: float, step: float, until: float) -> tuple[float, float, float, float]:
    """Return transition and weights of y' = rate (u - y) over a part of a step, u a parabola over the whole.

    The weights belong to u at start, middle and end. In closed form: a matrix exponential for each lag and length of
    step would cost as much as the steps.
    """
    constant, linear, square = moments(rate * step * until)
    linear, square = linear * until, square * until * until
    weights = constant - 3.0 * linear + 2.0 * square, 4.0 * (linear - square), 2.0 * square - linear
    return math.exp(-rate * step * until), *weights


def moments(x: float) -> tuple[float, float, float]:
    """Return the responses of a lag at s = 1 to the inputs 1, s and s^2 from s = 0 on, x the time over its own.

    They are the integrals of x exp(-x (1 - s)) s^j: by parts, or where that cancels, as the sum of
    (-1)^k j! / (j + k + 1)! x^(k + 1).

    >>> [round(moment, 6) for moment in moments(2.0)]
    [0.864665, 0.567668, 0.432332]
    """
    if x >= 1.0:
        constant = -math.expm1(-x)
        linear = 1.0 - constant / x
        return constant, linear, 1.0 - 2.0 * linear / x
    found = []
    for j in range(3):
        term = total = x / (j + 1)
        for k in range(1, 20):  # x^20 / 20! is below rounding
            term *= -x / (j + k + 1)
            total += term
        found.append(total)
    return found[0], found[1], found[2]


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> NDArray[np.complex128]:
    """Return 1 / (1 + j f / bandwidth)."""
    return np.asarray(1.0 / (1.0 + 1j * frequency / values["bandwidth"]))


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Follow the input with tau y' = u - y, exactly.

    The three values define a parabola. After a jump of the input the lag is no parabola; the first value is then
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

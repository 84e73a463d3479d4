"""Rate-dependent hysteresis of the piezo actuator: a play whose threshold grows with the rate of the voltage.

    z = max(v - r, min(v + r, z)),  r = threshold + slope |dv/dt|

and the displacement that drives the stage is less by weight (v - z). After Al Janaideh, Rakheja and Su (2009), who sum
several such plays with thresholds that grow with the rate.

Where the voltage jumps, its rate is infinite for no time at all: the play waits, and then goes where the threshold at
rest pushes it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values

#: A first value comes of a jump where it is this share of the step's way from where the voltage was, and the way bends.
JUMP, STRAIGHT = 0.01, 1e-9
#: Steps of each of two cycles for a describing function; the second counts.
POINTS = 96


def constants(values: Values, step: float) -> tuple[float, float, float, float]:
    """Return weight, threshold at rest, slope over the step, and where the play rests."""
    threshold = values["threshold"]
    rest = min(max(values.get("rest", 0.0), -threshold), threshold)
    return values["weight"], threshold, values["slope"] / step, rest


def glide(lag: float, change: float, threshold: float, before: float, curvature: float) -> float:
    """Return by how much more v - z is on a way than the mean of both its ends.

    Parameters
    ----------
    lag
        v - z at the start.
    change
        Of the voltage on the way.
    threshold, before
        At the end and at the start of the way.
    curvature
        By how much the mean voltage on the way is below the mean of both ends.
    """
    end, waits = lag + change, 1.0
    if abs(end) > threshold:  # the play waits, then it is pushed: a corner that a parabola through a step would miss
        side = 1.0 if end > 0.0 else -1.0
        waits = min(max((side * before - lag) / (end - side * threshold - lag + side * before), 0.0), 1.0)
        end = side * threshold
    corner = lag + waits * change
    return 0.5 * (waits * (lag + corner) + (1.0 - waits) * (corner + end) - lag - end) - waits * curvature


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Take the play along the voltage path; where the parabola turns, its rate is zero and the threshold smallest.

    As with a lag, the first of the three values is set so that their parabola has the mean of what lags. Where the
    first value of the path itself was set so, it is no voltage: the way then goes straight from where the voltage was,
    over each half at a rate of its own.
    """
    weight, rest = constants[0], constants[3]
    slope, bend = -3.0 * path[0] + 4.0 * path[1] - path[2], 2.0 * path[0] - 4.0 * path[1] + 2.0 * path[2]
    bends = abs(bend) > STRAIGHT * abs(slope)  # of a straight way rounding would say anything
    turn = -0.5 * slope / bend if bends else -1.0
    was, parabola = state[1], (path[0] + 4.0 * path[1] + path[2]) / 6.0
    lags = bends and abs(path[0] - was) > JUMP * abs(path[2] - was)
    v = was if lags else path[0]
    if lags:
        turn, bend, slope = -1.0, 0.0, 2.0 * (path[1] - v)
    at, threshold = 0.0, constants[1] + constants[2] * abs(slope)
    lag, mean = min(max(v - rest - state[0], -threshold), threshold), 0.0
    held = lag
    for node in range(1, 3):
        for _ in range(2):  # to the turn, if it is on the way, then to the node
            until = turn if at < turn < 0.5 * node else 0.5 * node
            to = path[0] + 0.5 * slope * turn if until == turn else path[node]
            before, threshold = threshold, constants[1] + constants[2] * abs(slope + 2.0 * bend * until)
            more = glide(lag, to - v, threshold, before, bend * (until - at) ** 2 / 6.0)
            reached = min(max(lag + to - v, -threshold), threshold)
            mean += (until - at) * (0.5 * (lag + reached) + more)
            at, v, lag = until, to, reached
            if until == 0.5 * node:
                break
        out[node] -= weight * (lag + rest)
        if node == 1:
            middle = lag
            if lags:
                slope = 2.0 * (path[2] - v)
                threshold = constants[1] + constants[2] * abs(slope)
                lag = min(max(lag, -threshold), threshold)
    if lags and v != was:  # what lags follows the mean voltage, which is not that of the straight way
        mean += (lag - held) / (v - was) * (parabola - 0.25 * (was + 2.0 * path[1] + v))
    out[0] -= weight * (6.0 * mean - 4.0 * middle - lag + rest)
    state[0], state[1] = v - lag - rest, v


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex | NDArray[np.complex128]:
    """Return the describing function of the play; the smallest sines do not move it unless its threshold is zero."""
    weight, threshold = values["weight"], values["threshold"]
    if amplitude == 0.0 and threshold > 0.0:
        return -weight
    size = amplitude or 1.0
    phase = 2 * math.pi * np.arange(1, POINTS + 1) / POINTS
    rate = 2 * math.pi * frequency * size * values["slope"]
    z, total = np.zeros(len(frequency)), np.zeros(len(frequency), dtype=np.complex128)
    for cycle in range(2):
        for angle in phase.tolist():
            v, r = size * math.sin(angle), (threshold if amplitude else 0.0) + rate * abs(math.cos(angle))
            z = np.maximum(v - r, np.minimum(v + r, z))
            total += cycle * (v - z) * np.exp(-1j * angle)
    return np.asarray(-weight * 2j * total / (POINTS * size))


def settled(values: Values, bias: float) -> float:
    """Return what is held back after the voltage went slowly from rest to a bias."""
    weight, threshold, _, rest = constants(values, 1.0)
    return -weight * (bias - max(bias - threshold, min(bias + threshold, rest)) + rest)


EFFECT = Effect(
    name="rate_dependent_hysteresis",
    physics=(
        "Domain walls need time to move, so that the loop between rising and falling voltage widens as the voltage "
        "changes faster, more than the mechanics and the amplifier explain."
    ),
    where="the piezo stack, between its voltage and its extension",
    reveal="triangles of one size at several rates, far below the resonance: the loop widens with the rate",
    remedy="slower commands, a rate-dependent model in the feedforward, or feedback from a position sensor",
    reference=(
        "M. Al Janaideh, S. Rakheja and C.-Y. Su, Experimental characterization and modeling of rate-dependent "
        "hysteresis of a piezoceramic actuator, Mechatronics 19 (2009)"
    ),
    parameters=(
        Parameter("weight", "m/V", "um/V", "gain that lags behind", 0.0, 0.1e-6, (0.0, 1e-4), "log"),
        Parameter(
            "slope",
            "s",
            "ms",
            "growth of the threshold with the rate",
            None,
            2e-3,
            (0.0, 1.0),
            screen=(3e-4, 1e-3, 3e-3, 1e-2, 3e-2),
        ),
        Parameter(
            "threshold", "V", "V", "threshold at rest", None, 2.0, (0.0, 1e3), screen=(0.0, 1.0, 3.0, 10.0, 30.0)
        ),
        Parameter("rest", "V", "V", "where the play rests at the start", None, 0.0, (-1e3, 1e3), per_run=True),
    ),
    faces=(
        Block(Socket.HYSTERESIS, states=("z", "v"), constants=constants, move=move, transfer=transfer, settled=settled),
    ),
    is_hysteresis=True,
    confused_with=("bouc_wen", "prandtl_ishlinskii", "driver_bandwidth", "structural_damping"),
)

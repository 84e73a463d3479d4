"""Prandtl-Ishlinskii hysteresis of the piezo actuator: the weighted sum of plays of several widths.

A play with threshold r follows the voltage v only when this pushes it: z = max(v - r, min(v + r, z)). What lags behind
is h = sum w_i (v - z_i), with r_i = reach i / N and i = 1 to N; weights fall or grow as exp(-shape i / N) and add up to
`weight`. The displacement that drives the stage is k_v v - h: after a turn its slope is k_v less the weights of all
plays that wait, and beyond twice `reach` it is k_v.
"""

from __future__ import annotations

import math

import numpy as np

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values

#: Number of plays.
PLAYS = 10
#: A first value comes of a jump where it is this share of the step's way from where the voltage was, and the way bends.
JUMP, STRAIGHT = 0.01, 1e-9


def constants(values: Values, step: float) -> tuple[float, ...]:
    """Return for each play its weight, its threshold, and where it rests."""
    relative = [math.exp(-values["shape"] * i / PLAYS) for i in range(1, PLAYS + 1)]
    numbers: list[float] = []
    for i, part in enumerate(relative, start=1):
        threshold = values["reach"] * i / PLAYS
        rest = min(max(values.get("rest", 0.0), -threshold), threshold)
        numbers += [values["weight"] * part / math.fsum(relative), threshold, rest]
    return tuple(numbers)


def hysteresis_lag(v: float, state: Floats, constants: Floats) -> float:
    """Return how much lags behind at a voltage, counted from rest; states are the plays' positions, and the voltage."""
    total = 0.0
    for i in range(PLAYS):
        total += constants[3 * i] * (v - state[i])
    return total


def follow(begin: float, end: float, curvature: float, state: Floats, constants: Floats) -> float:
    """Take all plays from voltage to voltage; return by how much more lags on the way than the mean of both ends.

    `curvature` is by how much the mean voltage on the way is below the mean of both ends. A play first waits, so that
    what lags grows with the voltage, then slips: the corner between is what a parabola through a step would miss.
    """
    more, way = 0.0, abs(end - begin)
    share = 1.0 / way if way > 0.0 else 0.0
    for i in range(PLAYS):
        weight, threshold, rest = constants[3 * i], constants[3 * i + 1], constants[3 * i + 2]
        z = max(end - threshold, min(end + threshold, rest + state[i])) - rest
        change = end - begin - (z - state[i])
        waits = abs(change) * share
        more += weight * (0.5 * change * (1.0 - waits) - waits * curvature)
        state[i] = z
    return more


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Take the plays along the voltage path, turning where the parabola turns.

    As with a lag, the first of the three values is set so that their parabola has the mean of what lags. Where the
    first value of the path itself was set so, it is no voltage: the way then goes straight from where the voltage was.
    """
    slope, bend = -3.0 * path[0] + 4.0 * path[1] - path[2], 2.0 * path[0] - 4.0 * path[1] + 2.0 * path[2]
    bends = abs(bend) > STRAIGHT * abs(slope)  # of a straight way rounding would say anything
    turn = -0.5 * slope / bend if bends else -1.0
    was, parabola = state[PLAYS], (path[0] + 4.0 * path[1] + path[2]) / 6.0
    lags = bends and abs(path[0] - was) > JUMP * abs(path[2] - was)
    first = was if lags else path[0]
    if lags:
        turn, bend = -1.0, 0.0
    elif first != was:  # a jump takes no time
        follow(was, first, 0.0, state, constants)
    at, v, lagging, mean = 0.0, first, hysteresis_lag(first, state, constants), 0.0
    held = lagging
    for node in range(1, 3):
        for _ in range(2):  # to the turn, if it is on the way, then to the node
            until = turn if at < turn < 0.5 * node else 0.5 * node
            to = path[0] + 0.5 * slope * turn if until == turn else path[node]
            more = follow(v, to, bend * (until - at) ** 2 / 6.0, state, constants)
            reached = hysteresis_lag(to, state, constants)
            mean += (until - at) * (0.5 * (lagging + reached) + more)
            at, v, lagging = until, to, reached
            if until == 0.5 * node:
                break
        out[node] -= lagging
        if node == 1:
            middle = lagging
    if lags and v != was:  # what lags follows the mean voltage, which is not that of the straight way
        mean += (lagging - held) / (v - was) * (parabola - 0.25 * (was + 2.0 * path[1] + v))
    out[0] -= 6.0 * mean - 4.0 * middle - lagging
    state[PLAYS] = v


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the describing function of all plays: one narrower than the sine waits, slips, and turns with it.

    Of a play the input less its position is known in closed form: for thresholds r below the amplitude A it is that of
    a slip over the way of 2 (A - r), whose real and imaginary parts follow from the angle of its corner.
    """
    numbers = np.array(constants(values, 0.0)).reshape(PLAYS, 3)
    if amplitude == 0.0:
        return complex(-numbers[:, 0].sum())
    corner = 1.0 - 2.0 * np.minimum(numbers[:, 1] / amplitude, 1.0)  # sine of the angle at which a play slips
    along = 0.5 + (np.arcsin(corner) + corner * np.sqrt(1.0 - corner**2)) / math.pi
    behind_it = (1.0 - corner**2) / math.pi
    return complex(-(numbers[:, 0] * (1.0 - along + 1j * behind_it)).sum())


def settled(values: Values, bias: float) -> float:
    """Return what is held back after the voltage went straight from rest to a bias."""
    numbers = np.array(constants(values, 0.0)).reshape(PLAYS, 3)
    weight, threshold, rest = numbers.T
    at = np.maximum(bias - threshold, np.minimum(bias + threshold, rest))
    return float(-(weight * (bias - at + rest)).sum())


EFFECT = Effect(
    name="prandtl_ishlinskii",
    physics=(
        "Domains in the ceramic switch with delay, so that the extension at a voltage depends on where the voltage "
        "came from. Here the loop is a sum of plays: after each turn the slope is low at first and grows with the "
        "voltage travelled, whatever the rate."
    ),
    where="the piezo stack, between its voltage and its extension",
    reveal="a slow triangle with minor loops: all branches that begin at a turn have the same shape",
    remedy="the inverse of the plays as feedforward (it is a sum of plays too), or feedback from a position sensor",
    remedies={
        PIEZO: "the inverse of the plays as feedforward (it is a sum of plays too), a charge amplifier, or feedback",
        "motor": "less friction and play in the drive, its inverse in the feedforward, or a sensor at the load",
    },
    reference=(
        "K. Kuhnen, Modeling, identification and compensation of complex hysteretic nonlinearities: a modified "
        "Prandtl-Ishlinskii approach, European Journal of Control 9 (2003)"
    ),
    parameters=(
        Parameter("weight", "m/V", "um/V", "gain that lags behind, all plays", 0.0, 0.2e-6, (0.0, 1e-4), "log"),
        Parameter(
            "reach",
            "V",
            "V",
            "threshold of the widest play",
            None,
            30.0,
            (0.1, 1e3),
            "log",
            screen=(5.0, 10.0, 20.0, 40.0, 80.0),
        ),
        Parameter(
            "shape",
            "1",
            "",
            "how fast weights fall with the threshold",
            None,
            0.0,
            (-10.0, 10.0),
            screen=(-3.0, 0.0, 3.0),
        ),
        Parameter("rest", "V", "V", "where the plays rest at the start", None, 0.0, (-1e3, 1e3), per_run=True),
    ),
    faces=(
        Block(
            Socket.HYSTERESIS,
            states=(*(f"z{i}" for i in range(1, PLAYS + 1)), "v"),
            constants=constants,
            move=move,
            transfer=transfer,
            settled=settled,
        ),
    ),
    is_hysteresis=True,
    confused_with=("bouc_wen", "rate_dependent_hysteresis", "asymmetric_hysteresis"),
)

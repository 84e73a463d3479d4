"""Asymmetric hysteresis of the piezo actuator: a loop that is wider at high voltage than at low.

A Bouc-Wen law driven by v |v| instead of v,

    dg = 2 strength |v| dv - b |dv| g

and the displacement that drives the stage is less by g, counted from where it rests at the start. Over a way on which
the voltage rises or falls and keeps its sign the solution is in closed form.
"""

from __future__ import annotations

import math

import numpy as np

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values

#: A first value comes of a jump where it is this share of the step's way from where the voltage was, and the way bends.
JUMP, STRAIGHT = 0.01, 1e-9
#: Cycles and steps of each, for a describing function; the last cycle counts.
CYCLES, POINTS = 3, 32


def constants(values: Values, step: float) -> tuple[float, float, float]:
    """Return strength, b, and g at rest."""
    return values["strength"], values["b"], values.get("rest", 0.0)


def advance(g: float, start: float, end: float, strength: float, b: float) -> float:
    """Return g [m] after the voltage went straight from `start` to `end` [V]."""
    if start * end < 0.0:
        g = stretch(g, start, 0.0, strength, b)
        start = 0.0
    return stretch(g, start, end, strength, b)


def stretch(g: float, start: float, end: float, strength: float, b: float) -> float:
    """Advance dg/dp = 2 strength sigma |v| - b g over the travel p, with sigma the sign of dv; v keeps its sign."""
    travel, sign = abs(end - start), 1.0 if end > start else -1.0
    x = b * travel
    if x > 0.1:
        once = -math.expm1(-x) / x  # mean of exp(-x (1 - s)) over s from 0 to 1, and with s in it
        twice = (1.0 - once) / x
    else:  # their series: exact to rounding here
        once = 1.0 - x / 2 * (
            1.0 - x / 3 * (1.0 - x / 4 * (1.0 - x / 5 * (1.0 - x / 6 * (1.0 - x / 7 * (1.0 - x / 8)))))
        )
        twice = 0.5 - x / 6 * (
            1.0 - x / 4 * (1.0 - x / 5 * (1.0 - x / 6 * (1.0 - x / 7 * (1.0 - x / 8 * (1.0 - x / 9)))))
        )
    source = abs(start) * once + (abs(end) - abs(start)) * twice
    return g * math.exp(-x) + 2.0 * strength * sign * travel * source


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Take the hysteresis along the voltage path, turning where the parabola turns.

    As in `bouc_wen`, the way goes from where the voltage was if the first value is a lag's or a slew limit's, and no
    voltage; what is held back follows the value.
    """
    strength, b, rest = constants[0], constants[1], constants[2]
    slope, bend = -3.0 * path[0] + 4.0 * path[1] - path[2], 2.0 * path[0] - 4.0 * path[1] + 2.0 * path[2]
    bends = abs(bend) > STRAIGHT * abs(slope)  # of a straight way rounding would say anything
    turn = -0.5 * slope / bend if bends else -1.0
    g, v = rest + state[0], state[1]
    held, was = g, v
    lags = bends and abs(path[0] - v) > JUMP * abs(path[2] - v)
    for node in range(1 if lags else 0, 3):
        if not lags and 0.0 < turn < 1.0 and 0.5 * (node - 1) < turn <= 0.5 * node:
            extreme = path[0] + 0.5 * slope * turn
            g, v = advance(g, v, extreme, strength, b), extreme
        g, v = advance(g, v, path[node], strength, b), path[node]
        out[node] -= g - rest
    if lags:
        out[0] -= held - rest + ((g - held) / (v - was) * (path[0] - was) if v != was else 0.0)
    state[0], state[1] = g - rest, v


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the describing function of a loop about a bias, or the slope there of the smallest ones."""
    strength, b, _ = constants(values, 0.0)
    if amplitude == 0.0:
        return -2.0 * strength * abs(bias)
    phase = 2 * math.pi * np.arange(1, POINTS + 1) / POINTS
    way, g, v = (bias + amplitude * np.sin(phase)).tolist(), 0.0, bias
    for _ in range(CYCLES):
        loop = []
        for to in way:
            g, v = advance(g, v, to, strength, b), to
            loop.append(g)
    return complex(-2j * np.mean(np.array(loop) * np.exp(-1j * phase)) / amplitude)


def settled(values: Values, bias: float) -> float:
    """Return what is held back after the voltage went straight from rest to a bias."""
    strength, b, rest = constants(values, 0.0)
    return rest - advance(rest, 0.0, bias, strength, b)


EFFECT = Effect(
    name="asymmetric_hysteresis",
    physics=(
        "More domains switch at a high field than at a low one, so that a loop of one size in voltage is wider at the "
        "top of the range than at its bottom, and the whole loop is not symmetric about its centre."
    ),
    where="the piezo stack, between its voltage and its extension",
    reveal="slow triangles of one size about several bias voltages: the loop widens with the bias",
    remedy="a hysteresis model with this term in the feedforward, or feedback from a position sensor",
    remedies={
        PIEZO: "a hysteresis model with this term in the feedforward, a charge amplifier, or feedback",
    },
    reference=(
        "G.-Y. Gu, L.-M. Zhu and C.-Y. Su, Modeling and compensation of asymmetric hysteresis nonlinearity for "
        "piezoceramic actuators with a modified Prandtl-Ishlinskii model, IEEE Trans. Ind. Electron. 61 (2014)"
    ),
    parameters=(
        Parameter(
            "strength", "m/V^2", "nm/V^2", "slope of the hysteresis at zero, per 2 v", 0.0, 1e-9, (0.0, 1e-7), "log"
        ),
        Parameter(
            "b",
            "1/V",
            "1/V",
            "how fast the loop saturates",
            None,
            0.02,
            (1e-5, 10.0),
            "log",
            screen=(0.003, 0.01, 0.03, 0.1, 0.3),
        ),
        Parameter("rest", "m", "um", "g at rest, where motion is zero", None, 0.0, (-1e-3, 1e-3), per_run=True),
    ),
    faces=(
        Block(Socket.HYSTERESIS, states=("g", "v"), constants=constants, move=move, transfer=transfer, settled=settled),
    ),
    is_hysteresis=True,
    confused_with=("bouc_wen", "electrostriction", "prandtl_ishlinskii"),
    actuators=(PIEZO, "other"),
)

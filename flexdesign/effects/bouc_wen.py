"""Bouc-Wen hysteresis of the piezo actuator, in the voltage: eqs (26), (28) and (29) of Lin et al. (2019).

Over a path of the voltage that rises or falls, with p the voltage travelled and sigma its sign,

    dh/dp = sigma a - (b sign(h) + sigma c) |h|^n

and the displacement that drives the stage is k_v v - h, counted from where it rests at the start: h is then zero in a
stage that was never driven, and negative in one that was cycled. Advancing in travelled voltage, not in time, keeps
the loop independent of the rate and right across jumps. For n = 1 each stretch is an exponential.
"""

from __future__ import annotations

import math

import numpy as np

from flexdesign.core.model import PIEZO, Block, Effect, Parameter, Socket
from flexdesign.core.model.effect import Floats, Values

#: A Runge-Kutta step in voltage, for n other than 1, covers this much of the loop's own voltage scale.
FINENESS = 0.04
#: Voltage scales in one direction after which the hysteresis is saturated to rounding.
SATURATED = 40.0
#: A first value comes of a jump where it is this share of the step's way from where the voltage was, and the way bends.
JUMP, STRAIGHT = 0.01, 1e-9
#: A describing function is that of the last of CYCLES cycles, each of POINTS steps; a loop about a bias that is small
#: compared with its voltage scale has then left its first branch.
CYCLES, POINTS = 3, 32


def advance(h: float, start: float, end: float, a: float, b: float, c: float, n: float) -> float:
    """Return the hysteresis displacement [m] after the voltage went straight from `start` to `end` [V]."""
    if end == start:
        return h
    sign = 1.0 if end > start else -1.0
    if n == 1.0:
        return _first_order(h, abs(end - start), sign * a, b, c, sign)
    left, to_zero = abs(end - start), 0.0
    if h * sign < 0.0:  # h runs towards zero, where the slope changes
        to_zero = _travel_to_zero(h, sign, a, b, c, n)
        if to_zero < left:
            h, left = 0.0, left - to_zero
    towards = h * sign < 0.0
    decay = sign * (c - b) if towards else sign * (b + c)
    near = to_zero if towards else abs(h / a)
    return _stretch(h, left, sign, decay, a, n, near, near - left if towards else near + left)


def _first_order(h: float, travel: float, slope: float, b: float, c: float, sign: float) -> float:
    """Advance the exponentials of n = 1: dh/dp = sign a - (b - c) h towards zero, - (b + c) h away from it."""
    if h * sign < 0.0:
        end = _relax(h, travel, slope, b - c)
        if end * sign <= 0.0:
            return end
        x = (b - c) * h / (slope - (b - c) * h)
        travel += h / (slope - (b - c) * h) * (math.log1p(x) / x if abs(x) > 1e-12 else 1.0)
        h = 0.0
    return _relax(h, travel, slope, b + c)


def _relax(h: float, travel: float, slope: float, rate: float) -> float:
    """Return h after a stretch of dh/dp = slope - rate h."""
    x = -rate * travel
    if abs(x) > 0.02:
        mean = math.expm1(x) / x
    else:  # its series, exact to rounding here and free of divisions
        mean = 1.0 + x * (1 / 2 + x * (1 / 6 + x * (1 / 24 + x * (1 / 120 + x * (1 / 720 + x / 5040)))))
    return h + (slope - rate * h) * travel * mean


def _stretch(h: float, travel: float, sign: float, decay: float, a: float, n: float, near: float, far: float) -> float:
    """Advance dh/dp = sign a - decay |h|^n while h keeps its sign; `decay` carries the sign of h.

    `near` and `far` are about how far the voltage is from where h is zero, at the start and at the end.
    """
    largest = abs(h)  # that |h| comes to on this stretch
    if h * sign >= 0.0:
        largest += a * travel
        if decay * sign > 0.0:
            largest = max(abs(h), min(largest, (a / abs(decay)) ** (1.0 / n)))
    scale = n * abs(decay) * largest ** (n - 1.0)
    if decay * sign > 0.0 and travel * scale > SATURATED:
        travel = SATURATED / scale
        far = near + travel
    # |h|^n is no polynomial near zero: steps that grow from there as the square of their number.
    begin, grow = math.sqrt(near), math.sqrt(far) - math.sqrt(near) if far < math.inf else 0.0
    steps = (
        1 + math.floor(min(2.0 * travel * scale / FINENESS, 1e4)) + math.floor(8.0 * abs(grow) / (begin + abs(grow)))
    )
    for i in range(steps):
        dp = travel / steps
        if far < math.inf:
            dp = abs(grow) / steps * abs(2.0 * begin + grow * (2 * i + 1) / steps)
        k1 = sign * a - decay * abs(h) ** n
        k2 = sign * a - decay * abs(h + 0.5 * dp * k1) ** n
        k3 = sign * a - decay * abs(h + 0.5 * dp * k2) ** n
        k4 = sign * a - decay * abs(h + dp * k3) ** n
        h += dp / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return h


def _travel_to_zero(h: float, sign: float, a: float, b: float, c: float, n: float) -> float:
    """Return how far the voltage travels until h is zero: p as a function of h, by quadrature."""
    decay = sign * (c - b)
    if (sign * a - decay * abs(h) ** n) * sign <= 0.0:
        return math.inf  # only outside b >= |c|: the loop runs away instead
    steps = 4 + math.floor(min(2 * n * abs(decay) * abs(h) ** n / a / FINENESS, 1e4))
    travel, left = 0.0, h
    for i in range(steps):  # Simpson's rule, on steps that shrink towards zero
        right = h * ((steps - i - 1) / steps) ** 2
        middle = 0.5 * (left + right)
        at_left, at_right = sign * a - decay * abs(left) ** n, sign * a - decay * abs(right) ** n
        travel += (right - left) / 6.0 * (1.0 / at_left + 4.0 / (sign * a - decay * abs(middle) ** n) + 1.0 / at_right)
        left = right
    return travel


def move(path: Floats, out: Floats, state: Floats, constants: Floats) -> None:
    """Take the hysteresis along the voltage path, turning where the parabola turns.

    After a jump of the command, a lag or a slew limit sets the first of the three values so that their parabola has the
    right mean. It is no voltage then: the way goes from where the voltage was, and what is held back follows the value.
    """
    a, b, c, n, rest = constants[0], constants[1], constants[2], constants[3], constants[4]
    slope, bend = -3.0 * path[0] + 4.0 * path[1] - path[2], 2.0 * path[0] - 4.0 * path[1] + 2.0 * path[2]
    bends = abs(bend) > STRAIGHT * abs(slope)  # of a straight way rounding would say anything
    turn = -0.5 * slope / bend if bends else -1.0
    h, v = rest + state[0], state[1]
    held, was = h, v
    lags = bends and abs(path[0] - v) > JUMP * abs(path[2] - v)
    node, passed = (1 if lags else 0), lags or turn <= 0.0
    while node < 3:  # to the three points, and the turn between; a loop, so that `advance` is compiled into it once
        turning = not passed and 2.0 * turn < node
        to = path[0] + 0.5 * slope * turn if turning else path[node]
        h, v = advance(h, v, to, a, b, c, n), to
        if turning:
            passed = True
        else:
            out[node] -= h - rest
            node += 1
    if lags:
        out[0] -= held - rest + ((h - held) / (v - was) * (path[0] - was) if v != was else 0.0)
    state[0], state[1] = h - rest, v


def constants(values: Values, step: float) -> tuple[float, float, float, float, float]:
    """Return a, b, c, n, and the hysteresis at rest."""
    return values["a"], values["b"], values["c"], values["n"], values.get("rest", 0.0)


def invert(wanted: float, state: Floats, constants: Floats) -> float:
    """Return the voltage at which k_v v - h is the displacement wanted, and go there.

    A `tick` for feedforward: state as for `move`, constants k_v and then those of `move`; k_v is larger than any slope
    of h, so that there is one such voltage.
    """
    gain, a, b, c, n, rest = constants[0], constants[1], constants[2], constants[3], constants[4], constants[5]
    h, v, wanted = rest + state[0], state[1], wanted - rest
    sign = 1.0 if wanted > gain * v - h else -1.0
    low, high = v, math.inf * sign  # the voltage lies between: k_v v - h rises with v
    trial, reached = v + (wanted - gain * v + h) / gain, h
    for _ in range(100):  # Newton's method, halving or doubling where it would leave the bracket
        reached = advance(h, v, trial, a, b, c, n)
        off = gain * trial - reached - wanted
        if off * sign < 0.0:
            low = trial
        else:
            high = trial
        turned = 1.0 if reached * sign >= 0.0 else -1.0
        before = trial
        trial -= off / (gain - a + (b * turned + c * sign) * abs(reached) ** n * sign)
        if not (trial - low) * sign > 0.0 or not (high - trial) * sign > 0.0:
            trial = 0.5 * (low + high) if abs(high) < math.inf else 2.0 * low - v
        if abs(trial - before) <= 1e-12 * abs(trial - v):
            break
    state[0], state[1] = advance(h, v, trial, a, b, c, n) - rest, trial
    return trial


def transfer(values: Values, frequency: Floats, bias: float, amplitude: float) -> complex:
    """Return the describing function of a loop that has settled about zero, or the slope there of the smallest ones."""
    a, b, c, n, _ = constants(values, 0.0)
    if amplitude == 0.0:
        return -a
    phase = 2 * math.pi * np.arange(1, POINTS + 1) / POINTS
    way, h, v = (amplitude * np.sin(phase)).tolist(), 0.0, 0.0
    for _ in range(CYCLES):
        loop = []
        for to in way:
            h, v = advance(h, v, to, a, b, c, n), to
            loop.append(h)
    return complex(-2j * np.mean(np.array(loop) * np.exp(-1j * phase)) / amplitude)


def settled(values: Values, bias: float) -> float:
    """Return what is held back after the voltage went straight from rest to a bias."""
    a, b, c, n, rest = constants(values, 0.0)
    return rest - advance(rest, 0.0, bias, a, b, c, n)


def cautions(values: Values) -> tuple[str, ...]:
    """Say where the loop can grow without bound or give energy away: outside b >= |c|."""
    if values["a"] > 0 and values["b"] < abs(values["c"]):
        return (
            f"Bouc-Wen with b = {values['b']:.4g} below |c| = {abs(values['c']):.4g}: the loop is neither bounded nor "
            "dissipative for every voltage",
        )
    return ()


EFFECT = Effect(
    name="bouc_wen",
    physics=(
        "Domains in the ceramic switch with delay, so that the extension at a voltage depends on where the voltage "
        "came from: the loop between rising and falling voltage is about a tenth of the stroke, whatever the frequency."
    ),
    where="the piezo stack, between its voltage and its extension",
    reveal="a slow triangle or sine over the whole voltage range: the loop does not close up as the rate falls",
    remedy="an inverse hysteresis feedforward, or feedback from a position sensor",
    remedies={
        PIEZO: "an inverse hysteresis feedforward, a charge amplifier, or feedback from a position sensor",
        "voice coil": "iron with less hysteresis or none in the field, an inverse hysteresis feedforward, or feedback",
        "motor": "less friction and play in the drive, its inverse in the feedforward, or a sensor at the load",
    },
    reference="Bouc-Wen as in eqs (26) to (29) of Lin, Yu, Wu and Shen (2019), Microsystem Technologies",
    parameters=(
        Parameter("a", "m/V", "um/V", "slope of the hysteresis where it is zero", 0.0, 0.3e-6, (0.0, 1e-4), "log"),
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
        Parameter("c", "1/V", "1/V", "how rising and falling branches differ", None, 0.0, (-10.0, 10.0)),
        Parameter("n", "1", "", "sharpness of the bend into saturation", None, 1.0, (1.0, 5.0)),
        Parameter(
            "rest", "m", "um", "hysteresis at rest, where motion is zero", None, 0.0, (-1e-3, 1e-3), per_run=True
        ),
    ),
    faces=(
        Block(Socket.HYSTERESIS, states=("h", "v"), constants=constants, move=move, transfer=transfer, settled=settled),
    ),
    is_hysteresis=True,
    confused_with=("creep", "driver_bandwidth", "prandtl_ishlinskii", "coulomb_friction"),
    cautions=cautions,
)

"""The stage in time: Runge-Kutta steps of fixed length, in plain loops compiled by numba.

Written to judge the package, so it shares nothing with it: neither code nor formulation. Everything advances in time on
a grid fifty times finer than the samples; the voltage's hysteresis advances by increments with the midpoint rule; the
modes are oscillators integrated by the classical fourth-order rule on drive values at the start, the middle and the
end of each step. One function goes through the chain of an axis, from command to what the sensor sees.
"""

from __future__ import annotations

import math
from enum import IntEnum, auto
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from studies.hidden_effect_trial.curves import integral

Array = NDArray[np.float64]

#: Play operators of Prandtl and Ishlinskii, decades of creep, and relaxation terms of structural damping.
PLAYS, DECADES, RELAXATIONS = 10, 4, 9
#: Slowest relaxation of structural damping [Hz], and their spacing in decades: half a decade up to 1 kHz.
SLOWEST, SPACING = 0.1, 0.5
#: A jump of the voltage is taken in pieces no longer than this [V].
PIECE = 0.1

#: What a step calls is put there before anything is compiled: arrays that are handed on are counted at every turn,
#: which took three quarters of the time.
inline = njit(error_model="numpy", inline="always")


class P(IntEnum):
    """Places in the vector of parameters; SI. A place that is not set holds zero, which means: not there."""

    @staticmethod
    def _generate_next_value_(name: str, start: int, count: int, last: list[Any]) -> int:
        return count

    GAIN = auto()  # base: m/V, rad/s, 1, m/V, 1/V, 1/V
    OMEGA = auto()
    ZETA = auto()
    A = auto()
    B = auto()
    C = auto()
    DRIVER_LAG = auto()  # s
    SLEW = auto()  # V/s
    LEVEL = auto()  # V
    CREEP = auto()
    CREEP_T0 = auto()
    ELECTROSTRICTION = auto()  # 1/V
    AMPLIFICATION = auto()  # 1/m
    PLAY_WEIGHT = auto()  # m/V
    PLAY_REACH = auto()  # V
    PLAY_SHAPE = auto()
    ASYMMETRY = auto()  # m/V^2
    ASYMMETRY_B = auto()  # 1/V
    RATE_WEIGHT = auto()  # m/V
    RATE_THRESHOLD = auto()  # V
    RATE_SLOPE = auto()  # s
    CUBIC = auto()  # 1/m^2
    QUADRATIC = auto()  # 1/m
    FRICTION = auto()  # m
    PRESLIDING = auto()  # m
    LOSS = auto()
    OPENING = auto()
    ONSET = auto()  # m
    SHARE = auto()
    OMEGA_2 = auto()  # rad/s
    ZETA_2 = auto()
    SHAKE = auto()  # m, Hz, rad
    SHAKE_HZ = auto()
    SHAKE_PHASE = auto()
    SENSOR_LAG = auto()  # s
    STOP_LOW = auto()  # outside the catalogue: a spring within a window of travel [m]
    STOP_HIGH = auto()
    STOP_STIFFNESS = auto()
    DRAG = auto()  # quadratic damping, over w^2 [s^2/m]
    KNEE = auto()  # slope of the drive beyond a knee [m]
    KNEE_SLOPE = auto()
    SLACK = auto()  # lost motion between stage and sensor target [m]
    SMOOTH_LEVEL = auto()  # friction that is a function of the velocity [m, m/s]
    SMOOTH_SPEED = auto()
    UNEVEN_REACH = auto()  # a structural error: a gain that depends on position, as `curves.integral` has it [m]
    UNEVEN_5 = auto()
    UNEVEN_6 = auto()
    UNEVEN_7 = auto()


COUNT = len(P)
_NAMES = {name: int(place) for name, place in P.__members__.items()}
(_GAIN, _OMEGA, _ZETA, _A, _B, _C, _DRIVER_LAG, _SLEW, _LEVEL, _CREEP, _CREEP_T0, _ELECTRO, _AMPLI) = range(13)
(_PLAY_W, _PLAY_R, _PLAY_S, _ASYM, _ASYM_B, _RATE_W, _RATE_R, _RATE_S) = range(13, 21)
(_CUBIC, _QUADRATIC, _FRICTION, _PRESLIDING, _LOSS, _OPENING, _ONSET, _SHARE, _OMEGA_2, _ZETA_2) = range(21, 31)
(_SHAKE, _SHAKE_HZ, _SHAKE_PHASE, _SENSOR_LAG, _LOW, _HIGH, _STOP, _DRAG, _KNEE, _KNEE_SLOPE, _SLACK) = range(31, 42)
(_SMOOTH, _SMOOTH_SPEED, _REACH, _FIVE, _SIX, _SEVEN) = range(42, 48)
assert (_NAMES["ELECTROSTRICTION"], _NAMES["RATE_SLOPE"], _NAMES["ZETA_2"], _NAMES["UNEVEN_7"]) == (11, 20, 30, 47)

#: States: voltage, Bouc-Wen, asymmetric loop, rate-dependent play, plays; then creep.
_V, _H, _G, _R, _PLAY = 0, 1, 2, 3, 4
_Z = _PLAY + PLAYS
UPSTREAM = _Z + DECADES
#: Mechanical states: position and velocity of both modes, relaxations; and what depends on the path alone: the bristle,
#: and where it was so.
_Y = 4
_BRISTLE = _Y + RELAXATIONS
_FROM = _BRISTLE + 1
MECHANICAL = _FROM + 1


@njit(cache=True, error_model="numpy")
def bouc_wen(h: float, dv: float, a: float, b: float, c: float) -> float:
    """Return h after a small change of voltage: dh = a dv - b |dv| h - c dv |h|, midpoint rule."""
    middle = h + 0.5 * (a * dv - b * abs(dv) * h - c * dv * abs(h))
    return h + a * dv - b * abs(dv) * middle - c * dv * abs(middle)


@inline
def _loops(s: Array, v: float, rate: float, p: Array) -> None:
    """Take all loops from the voltage s[0] to v [V]; `rate` is |dv/dt| [V/s]."""
    dv = v - s[_V]
    pieces = max(1, math.ceil(abs(dv) / PIECE))
    step = dv / pieces
    for i in range(pieces if dv != 0.0 else 0):
        s[_H] = bouc_wen(s[_H], step, p[_A], p[_B], p[_C])
        if p[_ASYM] != 0.0:
            at = s[_V] + (i + 0.5) * step
            half = s[_G] + 0.5 * (2.0 * p[_ASYM] * at * step - p[_ASYM_B] * abs(step) * s[_G])
            s[_G] += 2.0 * p[_ASYM] * at * step - p[_ASYM_B] * abs(step) * half
    s[_V] = v
    if p[_PLAY_W] != 0.0:
        for i in range(PLAYS):
            r = p[_PLAY_R] * (i + 1) / PLAYS
            s[_PLAY + i] = min(max(s[_PLAY + i], v - r), v + r)
    if p[_RATE_W] != 0.0:
        r = p[_RATE_R] + p[_RATE_S] * rate
        s[_R] = min(max(s[_R], v - r), v + r)


@inline
def _extension(s: Array, p: Array) -> float:
    """Return the drive that the voltage and its loops make, before the actuator's own additions [m]."""
    v = s[_V]
    d = p[_GAIN] * v - s[_H] - s[_G]
    if p[_PLAY_W] != 0.0:
        for i in range(PLAYS):
            d -= p[_PLAY_W] * math.exp(-p[_PLAY_S] * (i + 1) / PLAYS) * (v - s[_PLAY + i]) / PLAYS
    return d - p[_RATE_W] * (v - s[_R]) if p[_RATE_W] != 0.0 else d


@inline
def _drive(s: Array, p: Array) -> float:
    """Return the displacement that drives the modes [m]."""
    d = _extension(s, p)
    whole = d + p[_GAIN] * p[_ELECTRO] * s[_V] * s[_V] + p[_AMPLI] * d * d
    if p[_CREEP] != 0.0:
        for i in range(DECADES):
            whole += p[_CREEP] * s[_Z + i]
    if p[_KNEE_SLOPE] != 0.0:
        whole += p[_KNEE_SLOPE] * max(d - p[_KNEE], 0.0)
    if p[_REACH] != 0.0:
        whole += integral(2.0 * d / p[_REACH] - 1.0, p[_FIVE], p[_SIX], p[_SEVEN])
    return whole


@inline
def _lag(y: float, begin: float, end: float, step: float, tau: float) -> float:
    """Return where y, tau y' = u - y, comes to while u goes straight from `begin` to `end`."""
    behind = (end - begin) / step * tau
    return end - behind + (y - begin + behind) * math.exp(-step / tau)


@inline
def _amplifier(v: float, begin: float, end: float, step: float, p: Array) -> float:
    """Return the voltage after a step over which the command goes straight from `begin` to `end` [V]."""
    if p[_DRIVER_LAG] > 0.0:
        v = _lag(v, begin, end, step, p[_DRIVER_LAG])
    elif p[_SLEW] > 0.0:
        v += min(max(end - v, -p[_SLEW] * step), p[_SLEW] * step)
    else:
        v = end
    return v


@inline
def _limit_voltage(v: float, p: Array) -> float:
    return min(max(v, -p[_LEVEL]), p[_LEVEL]) if p[_LEVEL] > 0.0 else v


@inline
def _bristle(m: Array, x: float, p: Array) -> float:
    """Return the bristle's deflection at x: Dahl's z' = x' - |x'| z / presliding depends on the path alone [m].

    It is the exponential of that path, so that no velocity is too fast for the step.
    """
    end = math.copysign(p[_PRESLIDING], x - m[_FROM])
    return end + (m[_BRISTLE] - end) * math.exp(-abs(x - m[_FROM]) / p[_PRESLIDING])


@inline
def _force(x: float, velocity: float, m: Array, p: Array) -> float:
    """Return the sum of forces over the stiffness [m].

    What is open below an onset pulls the stage to x = opening * onset without any voltage. The onset counts from there:
    nobody sees another zero.
    """
    f = -(p[_CUBIC] * x + p[_QUADRATIC]) * x * x - p[_OPENING] * min(x - p[_ONSET] * (1.0 + p[_OPENING]), 0.0)
    if p[_FRICTION] != 0.0:
        f -= p[_FRICTION] * _bristle(m, x, p) / p[_PRESLIDING]
    if p[_LOSS] != 0.0:
        # A term g wT / (1 + w^2 T^2) every SPACING decades adds up to (pi / 2) g / (SPACING ln 10).
        g = p[_LOSS] * SPACING * math.log(10.0) * 2.0 / math.pi
        for i in range(RELAXATIONS):
            f -= g * (x - m[_Y + i])
    if p[_STOP] != 0.0:
        f -= p[_STOP] * min(max(x - p[_LOW], 0.0), p[_HIGH] - p[_LOW])
    if p[_SMOOTH] != 0.0:
        f -= p[_SMOOTH] * math.tanh(velocity / p[_SMOOTH_SPEED])
    return f - p[_DRAG] * velocity * abs(velocity)


@inline
def _rates(m: Array, drive: float, p: Array, out: Array) -> None:
    x, velocity = m[0] + m[2], m[1] + m[3]
    total = drive + _force(x, velocity, m, p)
    w = p[_OMEGA]
    out[0], out[1] = m[1], w * (w * ((1.0 - p[_SHARE]) * total - m[0]) - 2.0 * p[_ZETA] * m[1])
    if p[_SHARE] != 0.0:
        w = p[_OMEGA_2]
        out[2], out[3] = m[3], w * (w * (p[_SHARE] * total - m[2]) - 2.0 * p[_ZETA_2] * m[3])
    if p[_LOSS] != 0.0:
        for i in range(RELAXATIONS):
            out[_Y + i] = 2.0 * math.pi * SLOWEST * 10.0 ** (SPACING * i) * (x - m[_Y + i])


@njit(cache=True, error_model="numpy")
def _active(p: Array) -> int:
    """Return how many of the states change in time."""
    if p[_LOSS] != 0.0:
        return _BRISTLE
    return 4 if p[_SHARE] != 0.0 else 2


@inline
def _step(m: Array, d: Array, step: float, p: Array, k: Array, trial: Array, active: int) -> None:
    """Take the mechanics over a step by the classical fourth-order rule; d at start, middle and end."""
    _rates(m, d[0], p, k[0])
    for stage in range(1, 4):
        ahead = step if stage == 3 else 0.5 * step
        for i in range(active):
            trial[i] = m[i] + ahead * k[stage - 1, i]
        _rates(trial, d[2] if stage == 3 else d[1], p, k[stage])
    for i in range(active):
        m[i] += step / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])
    if p[_FRICTION] != 0.0:
        x = m[0] + m[2]
        m[_BRISTLE], m[_FROM] = _bristle(m, x, p), x
        trial[_BRISTLE], trial[_FROM] = m[_BRISTLE], m[_FROM]


@njit(cache=True, error_model="numpy")
def _add_base_motion(m: Array, p: Array) -> None:
    """Add the steady response to a base that has long been moving."""
    w = 2.0 * math.pi * p[_SHAKE_HZ]
    for i in range(2):
        own, zeta = (p[_OMEGA], p[_ZETA]) if i == 0 else (p[_OMEGA_2], p[_ZETA_2])
        if p[_SHAKE] != 0.0 and own > 0.0:
            share = 1.0 - p[_SHARE] if i == 0 else p[_SHARE]
            r = w / own
            size = share * p[_SHAKE] / math.hypot(1.0 - r * r, 2.0 * zeta * r)
            phase = p[_SHAKE_PHASE] - math.atan2(2.0 * zeta * r, 1.0 - r * r)
            m[2 * i] += size * math.sin(phase)
            m[2 * i + 1] += size * w * math.cos(phase)


@njit(cache=True, error_model="numpy")
def history(turns: Array, before: float, waited: float, shift: float, p: Array) -> Array:
    """Return the upstream states at the start of a record.

    Parameters
    ----------
    turns
        Voltages between which the stage was driven slowly, from rest at zero; the record begins at the last [V].
    before, waited
        Voltage at which it then rested long, and how long it has since waited at the last of the turns [V, s]: that is
        what creep remembers.
    shift
        Added to the Bouc-Wen hysteresis [m].
    p
        The parameters.
    """
    s = np.zeros(UPSTREAM)
    for turn in turns:
        _loops(s, _limit_voltage(turn, p), 0.0, p)
    s[_H] += shift
    now = _extension(s, p)
    for i in range(DECADES if p[_CREEP] != 0.0 else 0):
        s[_Z + i] = now + (p[_GAIN] * before - now) * math.exp(-waited / (p[_CREEP_T0] * 10.0**i))
    return s


@njit(cache=True, nogil=True, error_model="numpy")
def run(
    u: Array, held: bool, period: float, substeps: int, p: Array, start: Array, velocity: float, kick: Array
) -> Array:
    """Return what the sensor's target does, on the fine grid.

    Parameters
    ----------
    u
        Command at n samples [V].
    held
        Whether it waits between samples; otherwise it goes straight to the next.
    period
        Between samples [s].
    substeps
        Steps of the mechanics in a sample.
    p
        The parameters, `P`.
    start
        The upstream states, `history`.
    velocity
        Of the first mode at the start [m/s].
    kick
        Change of velocity at the beginning of each sample [m/s]; empty for none.

    Returns
    -------
    (n - 1) * substeps + 1 values [m].
    """
    step, s = period / substeps, start.copy()
    free = u[0]  # the amplifier's own output, before its limits
    m, k, d = np.zeros(MECHANICAL), np.zeros((4, MECHANICAL)), np.zeros(3)
    rest = _drive(s, p)
    x = rest
    for _ in range(200):  # at rest under the drive and all forces that depend on position alone
        m[_Y : _Y + RELAXATIONS], m[_FROM] = x, x
        x += 0.3 * (rest + _force(x, 0.0, m, p) - x)
    m[0], m[2], m[1] = (1.0 - p[_SHARE]) * x, p[_SHARE] * x, velocity
    m[_Y : _Y + RELAXATIONS], m[_FROM] = x, x
    _add_base_motion(m, p)
    x = m[0] + m[2]
    trial, active = m.copy(), _active(p)
    lagging, seen, out = x, x, np.empty((len(u) - 1) * substeps + 1)
    out[0] = x
    before = u[0]
    for sample in range(len(u) - 1):
        begin, end = u[sample], u[sample] if held else u[sample + 1]
        if len(kick):
            m[1] += kick[sample]
        direct = p[_DRIVER_LAG] == 0.0 and p[_SLEW] == 0.0  # else the rate of the voltage is not that of the command
        if begin != before and direct:
            _loops(s, _limit_voltage(begin, p), 0.0, p)
            free = begin
        elif p[_RATE_W] != 0.0 and direct:
            _loops(s, s[_V], abs(end - begin) / period, p)
        before = end
        for j in range(substeps):
            d[0] = _drive(s, p)
            for half in range(2):
                left = begin + (end - begin) * (2 * j + half) / (2 * substeps)
                right = begin + (end - begin) * (2 * j + half + 1) / (2 * substeps)
                free = _amplifier(free, left, right, 0.5 * step, p)
                v, was = _limit_voltage(free, p), _extension(s, p)
                rate = abs(v - s[_V]) / (0.5 * step)
                if p[_DRIVER_LAG] > 0.0 and v == free:
                    rate = abs(right - v) / p[_DRIVER_LAG]  # at the end of the half step, not its mean
                _loops(s, v, rate, p)
                if p[_CREEP] != 0.0:
                    now = _extension(s, p)
                    for i in range(DECADES):
                        tau = p[_CREEP_T0] * 10.0**i
                        s[_Z + i] += (0.5 * (was + now) - s[_Z + i]) * 0.5 * step / (tau + 0.25 * step)
                d[half + 1] = _drive(s, p)
            if p[_SHAKE] != 0.0:
                t = sample * period + j * step
                for i in range(3):
                    phase = 2.0 * math.pi * p[_SHAKE_HZ] * (t + 0.5 * i * step) + p[_SHAKE_PHASE]
                    d[i] += p[_SHAKE] * math.sin(phase)
            x, velocity = m[0] + m[2], m[1] + m[3]
            _step(m, d, step, p, k, trial, active)
            if p[_SENSOR_LAG] > 0.0:
                # Exact for straight lines, to the middle of the cubic through both ends and on: a lag may be faster
                # than the step.
                there = m[0] + m[2]
                middle = 0.5 * (x + there) + 0.125 * step * (velocity - m[1] - m[3])
                lagging = _lag(lagging, x, middle, 0.5 * step, p[_SENSOR_LAG])
                lagging = _lag(lagging, middle, there, 0.5 * step, p[_SENSOR_LAG])
                x = lagging
            else:
                x = m[0] + m[2]
            seen = min(max(seen, x - p[_SLACK]), x + p[_SLACK])
            out[sample * substeps + j + 1] = seen
    return out

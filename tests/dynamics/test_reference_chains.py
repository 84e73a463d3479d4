"""The reference for the dynamics checks itself: closed forms, exact linear steps, plain integration without events.

Most comparisons ask for 1e-9 of the stroke, which is what the reference promises; 1e-10 or better is found.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

from studies.benchmarks import dynamics_peer
from tests.reference import hysteretic_oscillator
from tests.reference.chains import BoucWen, Chain, Floats, Mode, Pid, Solution, solve, solve_loop
from tests.reference.hysteretic_oscillator import Oscillator

PROMISED = 1e-9
PERIOD = dynamics_peer.PERIOD
W0, ZETA, GAIN = 2 * math.pi * 118.3, 0.0242, 2.2e-6
MODE = Mode(W0, ZETA)
LAG = 1 / (2 * math.pi * 500)
LOOP = BoucWen(a=0.46e-6, b=0.0165, c=0.004)
KAPPA = 0.05 / 200e-6**2
FULL = Chain(
    gain=GAIN,
    modes=(Mode(W0, ZETA, 0.95), Mode(2.7 * W0, 0.01, 0.05)),
    driver_lag=LAG,
    hysteresis=LOOP,
    creep=((0.018, 0.1), (0.018, 1.0), (0.018, 10.0)),
    force=lambda x, speed: -KAPPA * x**3 - 1e-6 * speed,
    spring=BoucWen(a=0.2, b=4e3, c=-1e3),
    sensor_lag=1 / (2 * math.pi * 1000),
)


def error(found: Floats, right: Floats) -> float:
    """Return the largest error over the stroke."""
    return float(np.abs(found - right).max() / np.ptp(right))


def wave(n: int, frequency: float = 90.0) -> Floats:
    """Return n samples of a swelling sine about 60 V [V]."""
    t = np.arange(n) * PERIOD
    return 60 + 55 * np.sin(2 * np.pi * frequency * t) * t / t[-1]


# --- linear -----------------------------------------------------------------------------------------------------------


def test_step_of_lag_and_oscillator() -> None:
    """Partial fractions: x / (k_v u) = 1 - A e^(-t/tau) + 2 Re(C e^(pt)), at rest at t = 0."""
    u, t = 50.0, np.arange(60) * PERIOD
    found = solve(Chain(GAIN, (MODE,), LAG), np.full(60, u), PERIOD)
    sigma, p = 1 / LAG, W0 * (-ZETA + 1j * math.sqrt(1 - ZETA**2))
    A = W0**2 / (sigma**2 - 2 * ZETA * W0 * sigma + W0**2)
    C = np.linalg.solve(np.array([[1, 1], [p, p.conjugate()]]), np.array([A - 1, -A * sigma]))[0]
    right = GAIN * u * (1 - A * np.exp(-sigma * t) + 2 * np.real(C * np.exp(p * t)))
    assert error(found.position, right) < 1e-11
    assert found.voltage == pytest.approx(u * (1 - np.exp(-sigma * t)), rel=1e-13, abs=1e-12)


LINEAR = Chain(GAIN, FULL.modes, LAG, creep=FULL.creep, sensor_lag=FULL.sensor_lag)


def matrices() -> tuple[Floats, Floats, Floats]:
    """Return A, B and the rows of position and reading of `LINEAR`; states v, z, x_i, x_i', y."""
    A, B = np.zeros((9, 9)), np.zeros(9)
    A[0, 0], B[0] = -1 / LAG, 1 / LAG
    for i, (_, constant) in enumerate(LINEAR.creep, start=1):
        A[i, 0], A[i, i] = GAIN / constant, -1 / constant
    for i, mode in enumerate(LINEAR.modes):
        x, dx = 4 + i, 6 + i
        A[x, dx] = 1.0
        A[dx, x], A[dx, dx] = -(mode.w0**2), -2 * mode.zeta * mode.w0
        A[dx, :4] = mode.w0**2 * mode.share * np.array([GAIN, *(share for share, _ in LINEAR.creep)])
    A[8, 4:6], A[8, 8] = 1 / LINEAR.sensor_lag, -1 / LINEAR.sensor_lag
    rows = np.zeros((2, 9))
    rows[0, 4:6] = rows[1, 8] = 1.0
    return A, B, rows


def exactly(command: Callable[[float], float], breaks: Floats, samples: Floats) -> Floats:
    """Return position and reading at the samples, the command a straight line between breaks (with the samples)."""
    A, B, rows = matrices()
    big = np.zeros((11, 11))
    big[:9, :9], big[:9, 9], big[9, 10] = A, B, 1.0
    state, found, passages = np.zeros(9), [np.zeros(2)], {}
    for start, end in pairwise(np.unique(np.round(np.concatenate((breaks, samples)), 12))):
        early, late = (command(start + part * (end - start)) for part in (0.25, 0.75))
        slope = 2 * (late - early) / (end - start)
        here = early - 0.25 * slope * (end - start)
        length = round(end - start, 12)
        if length not in passages:
            passages[length] = expm(length * big)
        state = (passages[length] @ np.array([*state, here, slope]))[:9]
        if np.abs(samples - end).min() < 1e-9:
            found.append(rows @ state)
    return np.array(found).T


@pytest.mark.parametrize("delay", [0.0, 0.4e-3, 1e-3, 2.3e-3])
@pytest.mark.parametrize("between", ["hold", "linear"])
def test_linear_chain_with_delay(between: Any, delay: float) -> None:
    """Matrix exponentials over every stretch of the delayed command."""
    t, u = dynamics_peer.samples(0.039), wave(40)

    def command(moment: float) -> float:
        at = moment - delay
        if at < 0:
            return 0.0
        return float(np.interp(at, t, u) if between == "linear" else u[int(at / PERIOD)])

    position, reading = exactly(command, t[:-1] + delay % PERIOD, t)
    found = solve(LINEAR, u, PERIOD, between, delay=delay)
    assert error(found.position, position) < 1e-11
    assert error(found.reading, reading) < 1e-11


def test_loop_of_a_linear_chain() -> None:
    """The plant from its commands by matrix exponentials; the PID in its positional form, which needs no limits."""
    pid, delay = Pid(Kp=1.5e4, Ti=2e-3, Td=0.2e-3), 1.3e-3
    t, reference = dynamics_peer.samples(0.039), np.full(40, 100e-6)
    found = solve_loop(LINEAR, reference, PERIOD, pid, delay=delay)

    def command(moment: float) -> float:
        return float(found.command[int((moment - delay) / PERIOD)]) if moment > delay else 0.0

    position, reading = exactly(command, t[:-1] + 0.3e-3, t)
    assert error(found.position, position) < 1e-11
    assert error(found.reading, reading) < 1e-11
    e = reference - found.reading
    u = pid.Kp * (e + PERIOD / pid.Ti * np.cumsum(e) + pid.Td / PERIOD * np.diff(e, prepend=0.0))
    assert error(found.command, u) < 1e-12


def test_limits_hold_and_wind_nothing_up() -> None:
    """After back-calculation the next command starts from the last one applied: u' = clip(u + d feedforward + dP)."""
    pid = Pid(Kp=1.5e4, Ti=2e-3, Td=0.2e-3, limits=(0.0, 60.0))
    reference = np.where(np.arange(50) < 25, 180e-6, 0.0)
    ahead = 0.9 * reference / GAIN
    found = solve_loop(FULL, reference, PERIOD, pid, ahead)
    e = np.concatenate(([0.0, 0.0], reference - found.reading))
    dP = pid.Kp * (np.diff(e)[1:] + PERIOD / pid.Ti * e[2:] + pid.Td / PERIOD * np.diff(e, 2))
    right = np.clip(np.append(0.0, found.command[:-1]) + np.diff(ahead, prepend=0.0) + dP, 0.0, 60.0)
    assert found.command == pytest.approx(right, abs=1e-9)
    assert min((found.command == limit).sum() for limit in pid.limits) > 5


# --- hysteresis -------------------------------------------------------------------------------------------------------


def walk(bw: BoucWen, voltages: Floats) -> Floats:
    """Return h at the ends of straight paths between voltages, from rest at 0 V; closed forms for n = 1 and 2.

    With g = |h| and w the way: growing dg/dw = a - (b + c) g^n, shrinking dg/dw = -a - (b - c) g^n.
    """
    grow, shrink, n = bw.b + bw.c, bw.b - bw.c, bw.n
    top, bottom = (bw.a / grow) ** (1 / n), (bw.a / shrink) ** (1 / n)
    k, m = (grow, shrink) if n == 1 else (math.sqrt(bw.a * grow), math.sqrt(bw.a * shrink))
    h, found, last = 0.0, [], 0.0
    for v in voltages:
        way, rising = abs(v - last), math.copysign(1.0, v - last)
        if h * rising < 0:
            g = abs(h)
            to_zero = math.log1p(g / bottom) / m if n == 1 else math.atan(g / bottom) / m
            part = min(way, to_zero)
            left = (g + bottom) * math.exp(-m * part) - bottom
            h = math.copysign(left if n == 1 else bottom * math.tan(math.atan(g / bottom) - m * part), h)
            h, way = (0.0, way - part) if part == to_zero else (h, 0.0)
        if way > 0:
            g = abs(h)
            g = top + (g - top) * math.exp(-k * way) if n == 1 else top * math.tanh(math.atanh(g / top) + k * way)
            h = math.copysign(g, rising)
        found.append(h)
        last = v
    return np.array(found)


@pytest.mark.parametrize("bw", [LOOP, BoucWen(0.46e-6, 0.0165, -0.004), BoucWen(0.46e-6, 1e3, 300.0, n=2.0)])
@pytest.mark.parametrize("way", ["jumps", "ramps", "lag"])
def test_hysteresis_in_closed_form(bw: BoucWen, way: str) -> None:
    """Exponentials for n = 1, tanh and tan for n = 2; a held command through a lag turns round at samples alone."""
    u = np.concatenate(([120.0, 0.0, 120.0, -60.0], wave(30, 70.0)))
    chain = Chain(GAIN, (MODE,), LAG if way == "lag" else 0.0, bw)
    found = solve(chain, u, PERIOD, "linear" if way == "ramps" else "hold")
    assert error(found.hysteresis, walk(bw, found.voltage)) < 1e-11
    if way != "lag":
        assert np.array_equal(found.voltage, u)


def test_hysteresis_with_a_broken_exponent() -> None:
    """The way that a change of h takes is the integral of dv/dh."""
    bw = BoucWen(0.46e-6, 1.0, 0.3, n=1.4)
    u = np.array([20.0, 70.0, 50.0])
    h = solve(Chain(GAIN, (MODE,), 0.0, bw), u, PERIOD).hysteresis
    assert np.all(h > 0)
    for start, end, rising, way in ((0.0, h[0], 1, 20.0), (h[0], h[1], 1, 50.0), (h[1], h[2], -1, -20.0)):
        integral, _ = quad(lambda g, s=rising: 1 / (bw.a - (s * bw.b + bw.c) * g**bw.n), start, end, epsabs=0)
        assert integral == pytest.approx(way, rel=1e-11)


def test_the_voltage_turns_between_samples() -> None:
    """A lag behind a triangle turns round late; its extreme, found by bisection, is a corner of the path."""
    u = 10.0 * np.array([0.0, 1.0, 0.0, -1.0, 0.0, 1.0])
    found = solve(Chain(GAIN, (MODE,), LAG, LOOP), u, PERIOD, "linear")
    path: list[float] = []
    for v, here, there in zip(found.voltage, u[:-1], u[1:], strict=False):
        slope = (there - here) / PERIOD
        lead = v - here + LAG * slope

        def rate(t: float, slope: float = slope, lead: float = lead) -> float:
            return float(slope - lead / LAG * math.exp(-t / LAG))

        path.append(v)
        if rate(0.0) * rate(PERIOD) < 0:
            turn = float(brentq(rate, 0.0, PERIOD, xtol=1e-18))
            path.append(here + slope * turn - LAG * slope + lead * math.exp(-turn / LAG))
    path.append(found.voltage[-1])
    assert len(path) == 6 + 2
    right = walk(LOOP, np.array(path))[[path.index(v) for v in found.voltage]]
    assert error(found.hysteresis, right) < 1e-11


# --- the whole --------------------------------------------------------------------------------------------------------


def test_stiffening_oscillator_by_quadrature() -> None:
    """Without damping, x'^2 / 2 = w0^2 (d x - x^2 / 2 - kappa x^4 / 4) gives the time to any place on the way up."""
    d, kappa = 150e-6, 20 * KAPPA
    furthest = brentq(lambda x: x / 2 + kappa * x**3 / 4 - d, 0.0, 2 * d, xtol=1e-20)
    place = 0.6 * furthest

    def per_root(root: float) -> float:  # x = root^2 takes the singularity at the start away
        x = root * root
        return 2 / (W0 * math.sqrt(2 * d - x - kappa * x**3 / 2))

    moment, _ = quad(per_root, 0.0, math.sqrt(place), epsabs=0, epsrel=1e-13)
    chain = Chain(GAIN, (Mode(W0, 0.0),), force=lambda x, speed: -kappa * x**3)
    found = solve(chain, np.full(2, d / GAIN), moment)
    assert found.position[1] == pytest.approx(place, rel=1e-11)


def plainly(chain: Chain, u: Floats, rtol: float = 1e-12) -> Floats:
    """Return the positions by LSODA alone: no events, absolute values as they stand, v a state, straight commands."""
    assert chain.hysteresis and chain.spring and chain.force and len(chain.modes) == 2
    bw, spring, force = chain.hysteresis, chain.spring, chain.force
    shares, constants = np.array(chain.creep).T

    def both(bw: BoucWen, rate: float, h: float) -> float:
        return bw.a * rate - bw.b * abs(rate) * h * abs(h) ** (bw.n - 1) - bw.c * rate * abs(h) ** bw.n

    def rates(t: float, s: Floats, here: float, slope: float) -> list[float]:
        v, h, q, y, x1, x2, speed1, speed2 = s[:8]
        x, speed = x1 + x2, speed1 + speed2
        dv = (here + slope * t - v) / chain.driver_lag
        drive = chain.gain * v - h
        push = drive + shares @ s[8:] + force(x, speed) - q
        modes = zip(chain.modes, (x1, x2), (speed1, speed2), strict=True)
        pulls = [m.w0**2 * (m.share * push - xi) - 2 * m.zeta * m.w0 * speed_i for m, xi, speed_i in modes]
        out = [dv, both(bw, dv, h), both(spring, speed, q), (x - y) / chain.sensor_lag, speed1, speed2, *pulls]
        return out + list((drive - s[8:]) / constants)

    s = np.zeros(8 + len(shares))
    scales = np.array([100.0, *[1e-4] * 5, *[1e-4 * W0] * 2, *[1e-4] * len(shares)])
    found = [0.0]
    for here, there in pairwise(u):
        options: dict[str, Any] = {"rtol": rtol, "atol": rtol * scales, "max_step": PERIOD / 40}
        piece = solve_ivp(rates, (0.0, PERIOD), s, "LSODA", args=(here, (there - here) / PERIOD), **options)
        s = piece.y[:, -1]
        found.append(s[4] + s[5])
    return np.array(found)


@pytest.mark.parametrize("n", [1.0, 1.6])
def test_the_whole_chain_by_plain_integration(n: float) -> None:
    """Small steps at a tight tolerance cross the kinks without locating them, at the price of some digits."""
    scale = (1e-5) ** (1 - n)
    loop, spring = BoucWen(LOOP.a, LOOP.b * scale, LOOP.c * scale, n), BoucWen(0.2, 4e3 * scale, -1e3 * scale, n)
    chain = Chain(GAIN, FULL.modes, LAG, loop, FULL.creep, FULL.force, spring, FULL.sensor_lag)
    u = wave(25, 170.0)
    found = solve(chain, u, PERIOD, "linear")
    assert np.unique(np.sign(found.hysteresis)).size == 3  # both sides, and zero at the start
    assert error(found.position, plainly(chain, u)) < PROMISED


@pytest.mark.parametrize("how", ["hold", "linear", "loop"])
def test_a_tighter_tolerance_changes_nothing(how: Any) -> None:
    u = wave(40)

    def run(rtol: float) -> Solution:
        if how == "loop":
            pid = Pid(1.5e4, 2e-3, 0.2e-3, (-20.0, 150.0))
            return solve_loop(FULL, u / 120 * 150e-6, PERIOD, pid, delay=0.7e-3, rtol=rtol)
        return solve(FULL, u, PERIOD, how, rtol=rtol)

    usual, tight = run(1e-12), run(1e-13)
    assert error(usual.position, tight.position) < 0.1 * PROMISED
    assert error(usual.spring, tight.spring) < 0.1 * PROMISED


def test_rest_stays_rest() -> None:
    found = solve(FULL, np.zeros(5), PERIOD, delay=0.5e-3)
    assert not any(values.any() for values in vars(found).values())


@pytest.mark.parametrize("oscillator", [Oscillator(), Oscillator(beta=30.0, nu=1.5)])
@pytest.mark.parametrize("between", ["hold", "linear"])
def test_hysteretic_oscillator_in_its_own_terms(oscillator: Oscillator, between: Any) -> None:
    """The benchmark's equations as they are printed, by LSODA in small steps."""
    o, period = oscillator, 1 / hysteretic_oscillator.RATE
    force = hysteretic_oscillator.multisine(np.random.default_rng(3))[:40]
    found = hysteretic_oscillator.solve(o, force, between=between)

    def rates(t: float, s: Floats, here: float, slope: float) -> list[float]:
        y, speed, z = s
        dz = o.alpha * speed - o.beta * (
            o.gamma * abs(speed) * abs(z) ** (o.nu - 1) * z + o.delta * speed * abs(z) ** o.nu
        )
        return [speed, (here + slope * t - o.c * speed - o.k * y - z) / o.m, dz]

    s, right = np.zeros(3), [np.zeros(3)]
    for here, there in pairwise(force):
        slope = (there - here) / period if between == "linear" else 0.0
        options: dict[str, Any] = {"rtol": 1e-12, "atol": [1e-16, 1e-14, 1e-11], "max_step": period / 40}
        s = solve_ivp(rates, (0.0, period), s, "LSODA", args=(here, slope), **options).y[:, -1]
        right.append(s)
    y, _, z = np.array(right).T
    assert error(found.position, y) < PROMISED
    assert error(found.hysteretic_force, z) < PROMISED
    assert np.ptp(z) > 0.2 * o.alpha * np.ptp(y)


def test_multisine_of_the_benchmark() -> None:
    """50 N rms, all of it between 5 and 150 Hz, spread evenly."""
    force = hysteretic_oscillator.multisine(np.random.default_rng(5))
    lines, power = np.fft.rfftfreq(8192, 1 / 750), np.abs(np.fft.rfft(force)) ** 2
    inside = (lines >= 5) & (lines <= 150)
    assert power[inside] == pytest.approx(2500 / 2 * 8192**2 / inside.sum(), rel=1e-9)
    assert power[~inside].max() < 1e-20 * power.max()


@pytest.mark.parametrize("chain_name", dynamics_peer.CHAINS)
def test_peer_and_reference_solve_the_same_chains(chain_name: str) -> None:
    """The peer's own equations by LSODA, which takes kinks in its stride if its tolerance is a thousandth of ours."""
    for command in ("multisine",) if "loop" in dynamics_peer.CHAINS[chain_name] else ("multisine", "step"):
        found, _ = dynamics_peer.solve(chain_name, 0.03, 1e-12, command=command, method="LSODA", compiled=False)
        assert dynamics_peer.error(found, dynamics_peer.reference(chain_name, 0.03, command)) < PROMISED

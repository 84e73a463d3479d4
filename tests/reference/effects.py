"""Effects of the catalogue by other formulations than its own, with which they share no code.

Hysteresis follows a path that is dense and holds every turning point; forces are integrated in time, in one system with
the mass; what changes mass or stiffness is solved with mass, dashpot and spring in their own units.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Floats = NDArray[np.float64]
#: Of every solution in time; far below what the tests ask for.
RTOL = 1e-11


@dataclass(frozen=True)
class Branch:
    """A stretch of time on which the voltage neither turns nor changes its law: v = a + s t + c e^(-t / lag)."""

    begin: float
    end: float
    voltage: Callable[[Any], Any]
    rate: Callable[[Any], Any]
    ends_sample: bool


def branches(command: Floats, period: float, lag: float) -> Iterator[Branch]:
    """Yield the voltage behind a first-order lag (none if zero) of a command that is straight from sample to sample."""
    v = 0.0
    for k, (u0, u1) in enumerate(itertools.pairwise(command)):
        t0, slope = k * period, (u1 - u0) / period
        c = v - (u0 - slope * lag) if lag else 0.0

        def voltage(t: Any, t0: float = t0, u0: float = u0, slope: float = slope, c: float = c) -> Any:
            return u0 + slope * (t - t0 - lag) + (c * np.exp((t0 - t) / lag) if lag else 0.0)

        def rate(t: Any, t0: float = t0, slope: float = slope, c: float = c) -> Any:
            return slope - (c / lag * np.exp((t0 - t) / lag) if lag else 0.0 * t)

        cuts = [t0, t0 + period]
        if lag and c and 0 < (at := slope * lag / c) < 1 and (turn := t0 - lag * math.log(at)) < t0 + period:
            cuts.insert(1, turn)
        for begin, end in itertools.pairwise(cuts):
            yield Branch(begin, end, voltage, rate, end == cuts[-1])
        v = float(voltage(t0 + period))


def along(command: Floats, period: float, lag: float, step: Callable[[float, float], float]) -> Floats:
    """Return at each sample what `step(voltage, rate)` gives, called at both ends of every branch."""
    found = [step(float(command[0]), 0.0)]
    for branch in branches(command, period, lag):
        for t in (branch.begin, branch.end):
            last = step(float(branch.voltage(t)), float(branch.rate(t)))
        if branch.ends_sample:
            found.append(last)
    return np.array(found)


def plays(
    command: Floats, period: float, lag: float, weight: float, reach: float, shape: float, number: int = 10
) -> Floats:
    """Return what a sum of plays holds back, as a sum of stops: elastic until +-r, then it slips."""
    thresholds = reach * np.arange(1, number + 1) / number
    weights = np.exp(-shape * np.arange(1, number + 1) / number)
    weights *= weight / weights.sum()
    stops, last = np.zeros(number), [0.0]

    def step(v: float, rate: float) -> float:
        stops[:] = np.clip(stops + v - last[0], -thresholds, thresholds)
        last[0] = v
        return float(weights @ stops)

    return along(command, period, lag, step)


def rate_dependent_play(
    command: Floats, period: float, lag: float, weight: float, slope: float, threshold: float
) -> Floats:
    """Return what a play holds back whose threshold grows with the rate of the voltage."""
    z = [0.0]

    def step(v: float, rate: float) -> float:
        r = threshold + slope * abs(rate)
        z[0] = min(max(z[0], v - r), v + r)
        return weight * (v - z[0])

    return along(command, period, lag, step)


def asymmetric(command: Floats, period: float, lag: float, strength: float, b: float) -> Floats:
    """Return g of dg = 2 strength |v| dv - b |dv| g, integrated in time."""
    found, g = [0.0], 0.0
    for branch in branches(command, period, lag):
        rising = math.copysign(1.0, branch.rate(0.5 * (branch.begin + branch.end)))

        def slope(t: float, g: Floats, branch: Branch = branch, rising: float = rising) -> Floats:
            return (2 * strength * abs(branch.voltage(t)) - b * rising * g) * branch.rate(t)

        done = solve_ivp(slope, (branch.begin, branch.end), [g], method="DOP853", rtol=RTOL, atol=1e-20)
        g = float(done.y[0, -1])
        if branch.ends_sample:
            found.append(g)
    return np.array(found)


def moved(
    drive: Callable[[float], float],
    samples: int,
    period: float,
    frequency: float,
    damping_ratio: float,
    force: Callable[[float, float, Floats], float] = lambda x, v, z: 0.0,
    rates: Callable[[float, float, Floats], Floats] = lambda x, v, z: z,
    states: int = 0,
) -> Floats:
    """Return x at each sample: x'' + 2 zeta w x' + w^2 x = w^2 (drive + force(x, x', z)), z' = rates(x, x', z)."""
    w = 2 * math.pi * frequency

    def slope(t: float, s: Floats) -> Floats:
        x, v, z = s[0], s[1], s[2:]
        pull = drive(t) + force(x, v, z)
        return np.concatenate([[v, w * w * (pull - x) - 2 * damping_ratio * w * v], rates(x, v, z)])

    s = np.zeros(2 + states)
    found = [0.0]
    scale = np.full(2 + states, 1e-16)
    scale[1] *= w
    for k in range(samples - 1):  # from sample to sample: there the drive may bend
        s = solve_ivp(slope, (k * period, (k + 1) * period), s, method="DOP853", rtol=RTOL, atol=scale).y[:, -1]
        found.append(float(s[0]))
    return np.array(found)


def mass_on_spring(
    force: Callable[[float], float], samples: int, period: float, m: float, c: float, k: float
) -> Floats:
    """Return x at each sample of m x'' + c x' + k x = force(t)."""
    scale = np.array([1e-16, 1e-13])
    s, found = np.zeros(2), [0.0]
    for i in range(samples - 1):

        def slope(t: float, s: Floats) -> Floats:
            return np.array([s[1], (force(t) - c * s[1] - k * s[0]) / m])

        s = solve_ivp(slope, (i * period, (i + 1) * period), s, method="DOP853", rtol=RTOL, atol=scale).y[:, -1]
        found.append(float(s[0]))
    return np.array(found)

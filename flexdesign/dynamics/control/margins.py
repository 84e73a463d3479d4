"""How far a sampled loop is from instability, in numbers and in words.

The gain margin comes from the stability boundaries themselves (`sampled_loop.boundaries`) and is
confirmed by closed-loop poles, because a crossing of the real axis alone says nothing about which side is stable: a
light resonance makes several. Phase margin and peaks come from a frequency grid that is finest around every open- and
closed-loop pole. The definitions are those of Astrom and Hagglund, Advanced PID Control, 2006, chapter 4.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.units import significant, to_text
from flexdesign.dynamics.control.sampled_loop import Complexes, Matrices, matrices, stable_ranges


@dataclass(frozen=True)
class Margins:
    """Stability margins of a sampled loop.

    Parameters
    ----------
    stable
        Whether all closed-loop poles lie inside the unit circle.
    gain_margin
        The largest factor by which all gains may be multiplied: below it the loop is stable. Below 1 if the loop is
        unstable and smaller gains make it stable, zero if none do.
    smallest_gain
        The factor above which the loop is stable, in the same range of gains; zero where gains may fall to nothing.
    phase_margin
        The further phase lag that makes the loop unstable [deg]; infinity if no lag does, nan if it is unstable.
    delay_margin
        The further delay that does [s]; infinity or nan likewise.
    ms
        Largest sensitivity, the maximum of |1/(1 + L)|; nan if the loop is unstable.
    ms_frequency
        Where it lies [Hz].
    bandwidth
        Where |L/(1 + L)| first falls below 1/sqrt(2) of its static value [Hz]; nan if the loop is unstable.
    closed_loop_poles
        In the z plane, the outermost first.
    period
        Sampling period [s].
    """

    stable: bool
    gain_margin: float
    smallest_gain: float
    phase_margin: float
    delay_margin: float
    ms: float
    ms_frequency: float
    bandwidth: float
    closed_loop_poles: tuple[complex, ...]
    period: float

    def says(self) -> str:
        """Return the verdict in one or two sentences."""
        return self._of_stable() if self.stable else self._of_unstable()

    def _of_stable(self) -> str:
        gain = "without limit" if math.isinf(self.gain_margin) else f"by a factor of {significant(self.gain_margin, 3)}"
        if self.smallest_gain > 0:
            gain += f" (and must not fall by one of {significant(1 / self.smallest_gain, 3)})"
        if math.isinf(self.phase_margin):
            phase = "no further phase lag makes the loop unstable"
        else:
            delay = to_text(self.delay_margin, "ms", 3)
            phase = f"{significant(self.phase_margin, 3)} deg of phase lag, or {delay} of delay, are left"
        peak = f"disturbances grow at most {significant(self.ms, 3)}-fold (at {to_text(self.ms_frequency, 'Hz', 3)})"
        return f"stable: gains may rise {gain}; {phase}; {peak}."

    def _of_unstable(self) -> str:
        pole = self.closed_loop_poles[0]
        radius, frequency = abs(pole), abs(cmath.phase(pole)) / (2 * math.pi * self.period)
        where = f"at {to_text(frequency, 'Hz', 3)}" if frequency > 0 else "without oscillation"
        grows = math.log(2) * self.period / math.log(radius) if radius > 1 else math.inf
        speed = f"doubles every {to_text(grows, 'ms', 2)}" if grows < 1e3 else "does not die out"
        if self.gain_margin > 1:
            remedy = f"gains must rise by a factor of more than {significant(self.smallest_gain, 3)}"
        elif self.gain_margin > 0:
            remedy = f"gains must fall by a factor of more than {significant(1 / self.gain_margin, 3)}"
        else:
            remedy = "no smaller or larger gains of these proportions make it stable"
        verdict = f"the closed loop has a pole of modulus {radius:.4g}, a motion {where} that {speed}"
        return f"unstable: {verdict}; {remedy}."


def margins(loop: Any) -> Margins:
    """Return the margins of a sampled loop.

    Parameters
    ----------
    loop
        The open loop, a discrete single-input, single-output system of python-control, closed by negative feedback;
        see `flexdesign.dynamics.control.sampled_loop.open_loop`.
    """
    period = float(loop.dt)
    system = matrices(loop)
    poles = sorted(system.closed_poles(), key=abs, reverse=True)
    stable = system.is_stable()
    low, high = _gain_range(system, stable)
    if not stable:
        nothing = (math.nan,) * 5
        return Margins(False, high, low, *nothing, tuple(poles), period)
    angles = _fine_angles(system)
    response = system.response(angles)
    sensitivity = np.abs(1 / (1 + response))
    peak = int(np.argmax(sensitivity))
    lag, delay = _phase_and_delay(system, angles, response, period)
    width = _bandwidth(angles, response) / (2 * math.pi * period)
    at = angles[peak] / (2 * math.pi * period)
    return Margins(True, high, low, lag, delay, float(sensitivity[peak]), float(at), width, tuple(poles), period)


def largest_sensitivity(system: Matrices) -> float:
    """Return the maximum of |1/(1 + L)| on the unit circle, whether the loop is stable or not."""
    return float(np.max(np.abs(1 / (1 + system.response(_fine_angles(system))))))


def _gain_range(system: Matrices, stable: bool) -> tuple[float, float]:
    """Return the stable range of gains that holds 1, or the one next to it: the lower if there is one."""
    ranges = [(r.low.gain, r.high.gain) for r in stable_ranges(system)]
    if stable:
        return next(((low, high) for low, high in ranges if low <= 1 <= high), (1.0, 1.0))
    below = [r for r in ranges if r[1] <= 1]
    above = [r for r in ranges if r[0] >= 1]
    return below[-1] if below else above[0] if above else (0.0, 0.0)


def _fine_angles(system: Matrices) -> Array:
    """Return angles in (0, pi], dense around every pole of the open and the closed loop.

    A pole at a distance d from the circle makes a peak of width d: the points keep to d/50 inside it, and the largest
    value is then met to 2e-4 of itself.
    """
    parts = [np.geomspace(1e-5, math.pi, 400), np.linspace(0.005, math.pi, 600)]
    for pole in (*np.linalg.eigvals(system.a), *system.closed_poles()):
        if pole.imag < 0 or abs(pole) < 0.5:  # broad: the grid above sees it
            continue
        distance = max(abs(1 - abs(pole)), 1e-9)
        parts.append(float(np.angle(pole)) + distance * np.sinh(np.linspace(-6, 6, 601)))
    angles = np.unique(np.concatenate(parts))
    angles = angles[(angles > 1e-6) & (angles <= math.pi)]
    on_circle = [p for p in np.linalg.eigvals(system.a) if abs(abs(p) - 1) < 1e-12]  # there L is infinite
    clear = [np.abs(np.exp(1j * angles) - p) > 1e-12 for p in on_circle]
    return np.asarray(angles[np.all(clear, axis=0)] if clear else angles)


def _phase_and_delay(system: Matrices, angles: Array, response: Complexes, period: float) -> tuple[float, float]:
    """Return the smallest further lag [deg] and delay [s] that take the response through -1."""
    from scipy.optimize import brentq

    excess = np.abs(response) - 1
    lags = []
    for i in np.flatnonzero(excess[:-1] * excess[1:] < 0):
        at = brentq(lambda w: abs(system.response(w)[0]) - 1, angles[i], angles[i + 1], xtol=1e-14)
        lag = (cmath.phase(system.response(at)[0]) + math.pi) % (2 * math.pi)
        lags.append((lag, at))
    if not lags:
        return math.inf, math.inf
    return math.degrees(min(lag for lag, _ in lags)), min(lag / at for lag, at in lags) * period


def _bandwidth(angles: Array, response: Complexes) -> float:
    """Return the angle at which the complementary sensitivity first falls by 3 dB; pi if it never does."""
    ratio = np.abs(response / (1 + response))
    fallen = np.flatnonzero(ratio < ratio[0] / math.sqrt(2))
    if not fallen.size:
        return math.pi
    i = int(fallen[0])
    return float(np.interp(-ratio[0] / math.sqrt(2), -ratio[i - 1 : i + 1], angles[i - 1 : i + 1]))

"""The sampled loop of a plant and a PID: its open loop, its stability, its responses.

The controller reads at ``t = k T`` and commands at the same instant; what a real one takes longer is delay of the
plant. Command and reading are linear here; limits and hysteresis belong to the simulator.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.dynamics.control.pid import PID
from flexdesign.dynamics.control.plant import Plant

Complexes = NDArray[np.complex128]
#: Angles [rad per sample] nearer than this to 0 and pi are the ends of the unit circle, where every loop is real.
_ENDS = 1e-4


def open_loop(plant: Plant, pid: PID, period: float) -> Any:
    """Return the loop opened at the command, PID times sampled plant, as python-control's discrete `StateSpace`.

    Parameters
    ----------
    plant, pid
        What is in the loop.
    period
        Sampling period T [s].
    """
    import control as ct

    own = pid.realised(period)
    regulator = ct.ss(own.a, own.b_reading[:, None], own.c[None, :], own.d_reading, period)
    return -regulator * plant.discretise(period)


class Matrices(NamedTuple):
    """A discrete single-input, single-output system as plain arrays: a (n x n), b (n), c (n), d."""

    a: Array
    b: Array
    c: Array
    d: float

    def response(self, angles: ArrayLike) -> Complexes:
        """Return the response at ``z = exp(j angle)``; angles in rad per sample, 1-D."""
        z = np.exp(1j * np.atleast_1d(np.asarray(angles, dtype=float)))
        resolvent = z[:, None, None] * np.eye(len(self.a)) - self.a
        states = np.linalg.solve(resolvent, np.broadcast_to(self.b[:, None], (len(z), len(self.b), 1)).astype(complex))
        return np.asarray(states[:, :, 0] @ self.c + self.d, dtype=complex)

    def closed_poles(self, gain: float = 1.0) -> Complexes:
        """Return the poles of the loop closed with `gain` times this system and negative feedback."""
        feedback = self.a - np.outer(self.b, self.c) * (gain / (1 + gain * self.d))
        return np.linalg.eigvals(feedback).astype(complex)

    def is_stable(self, gain: float = 1.0) -> bool:
        """Tell whether all closed-loop poles lie inside the unit circle."""
        return bool(np.all(np.abs(self.closed_poles(gain)) < 1))


def matrices(loop: Any) -> Matrices:
    """Return the matrices of a discrete single-input, single-output system of python-control."""
    import control as ct

    system = ct.ss(loop)
    b, c = np.asarray(system.B, dtype=float).ravel(), np.asarray(system.C, dtype=float).ravel()
    return Matrices(np.asarray(system.A, dtype=float), b, c, float(np.asarray(system.D).item()))


class Boundary(NamedTuple):
    """A gain at which closed-loop poles lie on the unit circle, and their angle [rad per sample]."""

    gain: float
    angle: float


class StableRange(NamedTuple):
    """A range of gains, from `low` to `high`, in which the closed loop is stable."""

    low: Boundary
    high: Boundary


def boundaries(loop: Matrices) -> list[Boundary]:
    """Return every positive gain at which closed-loop poles lie on the unit circle, the smallest first.

    Exact: on the unit circle ``L = N/D`` is real where ``N(z) D(1/z) = N(1/z) D(z)``, a polynomial equation. No grid
    of frequencies is used, which a light resonance could slip through; the roots are then polished on L itself.
    """
    size = float(np.max(np.abs(loop.b))) * float(np.max(np.abs(loop.c))) or 1.0  # so that N keeps its digits
    denominator = np.poly(loop.a)
    numerator = np.poly(loop.a - np.outer(loop.b, loop.c) / size) - denominator + loop.d / size * denominator
    difference = np.convolve(numerator, denominator[::-1]) - np.convolve(numerator[::-1], denominator)
    angles = np.angle(np.roots(np.trim_zeros(difference))) if np.any(difference) else np.array([])
    found = [math.pi, 0.0]
    for angle in sorted(set(angles[(angles > _ENDS) & (angles < math.pi - _ENDS)])):
        polished = _real_near(loop, float(angle))
        if polished is not None and all(abs(polished - other) > 1e-9 for other in found):
            found.append(polished)
    found = [a for a in found if np.min(np.abs(np.linalg.eigvals(loop.a) - np.exp(1j * a)), initial=1) > 1e-9]
    values = loop.response(found).real if found else np.zeros(0)
    return sorted(Boundary(-1 / float(v), angle) for v, angle in zip(values, found, strict=True) if v < 0)


def _real_near(loop: Matrices, angle: float) -> float | None:
    """Return the angle next to `angle` at which the loop is real; None if there is none."""
    from scipy.optimize import brentq

    def imaginary(at: float) -> float:
        return float(loop.response(at)[0].imag)

    for reach in 10.0 ** np.arange(-10, -2):
        below, above = max(angle - reach, _ENDS / 2), min(angle + reach, math.pi - _ENDS / 2)
        if imaginary(below) * imaginary(above) <= 0:
            return float(brentq(imaginary, below, above, xtol=1e-15, rtol=1e-14))
    return None


def stable_ranges(loop: Matrices) -> list[StableRange]:
    """Return the ranges of positive gains for which the closed loop is stable, the lowest first.

    The boundaries come from `boundaries`; between two of them the poles are computed.
    """
    edges = [Boundary(0.0, 0.0), *boundaries(loop), Boundary(math.inf, math.pi)]
    ranges: list[StableRange] = []
    for low, high in itertools.pairwise(edges):
        if low.gain == 0:
            probe = high.gain / 2 if math.isfinite(high.gain) else 1.0
        else:
            probe = math.sqrt(low.gain * high.gain) if math.isfinite(high.gain) else 2 * low.gain
        if not loop.is_stable(probe):
            continue
        if ranges and ranges[-1].high == low:  # the poles touch the circle and turn back
            ranges[-1] = StableRange(ranges[-1].low, high)
        else:
            ranges.append(StableRange(low, high))
    return ranges


@dataclass(frozen=True)
class Response:
    """What a loop does in time.

    Parameters
    ----------
    time, output
        On a fine grid, between the samples too [s, reading].
    command
        One per sample.
    """

    time: Array
    output: Array
    command: Array


def simulate(
    plant: Plant, pid: PID | None, reference: ArrayLike, period: float, substeps: int = 10, load: float = 0.0
) -> Response:
    """Return the exact response of the linear loop from rest.

    Parameters
    ----------
    plant
        The plant.
    pid
        The controller; without one the reference, over the plant's static gain, is the command.
    reference
        One value per sample.
    period
        Sampling period T [s].
    substeps
        Moments of output per period.
    load
        A constant added to the command from the start, as a load disturbance.

    Raises
    ------
    InputError
        If the reference is not a row of finite numbers.
    """
    r = np.asarray(reference, dtype=float)
    if r.ndim != 1 or not np.all(np.isfinite(r)):
        raise InputError("loop", "reference", f"shape {r.shape}", "must be one row of finite numbers")
    stage = plant.sampled(period, substeps)
    own = (pid or PID(0.0)).realised(period)
    x, own_x = np.zeros(len(stage.a)), np.zeros(len(own.a))
    command, output = np.zeros(len(r)), np.zeros((len(r), substeps))
    for k, target in enumerate(r):
        reading = float(stage.c @ x)
        if pid is None:
            command[k] = target / plant.static_gain
        else:
            command[k] = own.c @ own_x + own.d_reference * target + own.d_reading * reading
        own_x = own.a @ own_x + own.b_reference * target + own.b_reading * reading
        output[k] = stage.between @ x + stage.direct * (command[k] + load)
        x = stage.a @ x + stage.b * (command[k] + load)
    time = np.asarray(np.arange(output.size) * (period / substeps), dtype=np.float64)
    return Response(time, output.ravel(), command)


def settling_time(time: ArrayLike, output: ArrayLike, final: float, band: float = 0.02) -> float:
    """Return when the output enters the band around `final` for good [s]; infinity if it does not.

    Parameters
    ----------
    time, output
        The response to a step at time zero [s, reading].
    final
        Where it ought to end.
    band
        Half width of the band, as a share of `final`.

    >>> settling_time([0.0, 1.0, 2.0, 3.0], [0.0, 0.9, 1.01, 1.0], final=1.0)
    2.0
    """
    t, y = np.asarray(time, dtype=float), np.asarray(output, dtype=float)
    outside = np.flatnonzero(~(np.abs(y - final) <= band * abs(final)))
    if outside.size == 0:
        return float(t[0])
    return math.inf if outside[-1] == len(t) - 1 else float(t[outside[-1] + 1])

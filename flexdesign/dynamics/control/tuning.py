"""A robust tuning for lightly damped plants: a fast reference step, subject to a limit on the sensitivity.

The limit is the one of constrained optimisation (Panagopoulos, Astrom and Hagglund 2002, Design of PID controllers
based on constrained optimisation, IEE Proceedings Control Theory and Applications 149; Astrom and Hagglund, Advanced
PID Control, 2006, chapter 6): the largest sensitivity Ms stays below a chosen value. It holds here for a family of
plants, with the natural frequencies off by some percent either way, because a controller that works on a light
resonance depends on where it lies.

The goal differs. The cited method maximises the integral gain, which on a light resonance leaves it ringing: a small
Ms does not say that the resonance is damped. Here the time-weighted absolute error of a reference step (ITAE), the
worst of the family, is made small; what rings on costs most. The set point enters through the integral part alone
(weights 0), so that the reference does not kick the resonance; the gains are as free as eq (33) of Lin et al. (2019).

On a light resonance Kp often comes out **negative**, and Ti and Td with it: integral and derivative part, Kp/Ti and
Kp Td, are positive and do the work. The zeros of the controller are then those of no PID in series form; eq (33) has
no objection.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.units import significant, to_text
from flexdesign.dynamics.control.margins import Margins, largest_sensitivity, margins
from flexdesign.dynamics.control.pid import PID, Realised
from flexdesign.dynamics.control.plant import Plant, Sampled
from flexdesign.dynamics.control.sampled_loop import Matrices, matrices, open_loop, settling_time, simulate

#: Where the search begins: Ki/w0, Kp and Kd w0, each times the plant's gain.
_STARTS = ((0.15, -0.2, 0.4), (0.05, 0.05, 0.1), (0.02, -0.02, 0.02), (0.3, 0.4, 0.2))
_SUBSTEPS = 4


@dataclass(frozen=True)
class Tuning:
    """A tuned controller and what it reaches.

    Parameters
    ----------
    pid
        The controller.
    margins
        Of the plant as given.
    worst_ms
        The largest sensitivity over the family of plants.
    open_loop_settling
        2 % settling time of the plant alone, its command stepping [s].
    settling
        Of a reference step on each plant of the family [s], the given plant in the middle; between samples too.
    noise_gain
        The largest gain from the noise of the reading to the command [command per reading].
    """

    pid: PID
    margins: Margins
    worst_ms: float
    open_loop_settling: float
    settling: tuple[float, ...]
    noise_gain: float

    def says(self) -> str:
        """Return what was reached, in a sentence."""
        own = to_text(self.settling[len(self.settling) // 2], "ms", 3)
        worst, alone = to_text(max(self.settling), "ms", 3), to_text(self.open_loop_settling, "ms", 3)
        ms = significant(self.worst_ms, 3)
        return f"a reference step settles to 2 % in {own} ({worst} at worst, {alone} in open loop), Ms {ms} at worst."


def tune(
    plant: Plant,
    period: float,
    ms: float = 1.6,
    frequency_error: float = 0.03,
    weights: tuple[float, float] = (0.0, 0.0),
    derivative_filter: float = 0.0,
) -> Tuning:
    """Return the PID of the smallest worst-case ITAE whose sensitivity stays below `ms` on the whole family.

    Deterministic: a simplex search (Nelder and Mead 1965) from several fixed starts, then from the best of them.

    Parameters
    ----------
    plant
        The plant.
    period
        Sampling period T [s].
    ms
        Limit of the largest sensitivity; 1.4 is cautious, 2 is bold.
    frequency_error
        By which share the natural frequencies may be off, either way.
    weights
        Weights of the set point in the proportional and the derivative part; (1, 1) is eq (33).
    derivative_filter
        Time constant of the derivative part's filter [s].

    Raises
    ------
    InputError
        If `ms` is not above 1, the frequency error not in 0 ... 0.5, the plant undamped, or no controller is found.
    """
    from scipy.optimize import minimize

    if not ms > 1:
        raise InputError("tuning", "ms", ms, "must be above 1; take 1.4 to 2")
    if not 0 <= frequency_error < 0.5:
        raise InputError("tuning", "frequency_error", frequency_error, "must lie between 0 and 0.5")
    if any(mode.damping_ratio == 0 for mode in plant.all_modes):
        raise InputError("plant", "damping_ratio", 0.0, "an undamped plant never settles; give its damping")
    family = [plant.shifted(factor) for factor in sorted({1 - frequency_error, 1.0, 1 + frequency_error})]
    search = _Search(plant, family, period, ms, weights, derivative_filter)

    def cost(at: Array) -> float:
        return search.cost(search.pid(at))

    starts = [np.array([math.log(ki), kp, kd]) for ki, kp, kd in _STARTS]
    rough = [minimize(cost, x, method="Nelder-Mead", options={"maxfev": 200, "xatol": 1e-3}) for x in starts]
    best = min(rough, key=lambda solution: float(solution.fun))
    fine = minimize(cost, best.x, method="Nelder-Mead", options={"maxfev": 600, "xatol": 1e-5, "fatol": 1e-9})
    return assess(search.pid(fine.x), plant, period, family, limit=1.01 * ms)


def assess(pid: PID, plant: Plant, period: float, family: Sequence[Plant] = (), limit: float = math.inf) -> Tuning:
    """Return what a controller reaches on a plant and on a family of plants around it.

    Raises
    ------
    InputError
        If the loop is unstable on the plant or on one of the family, or the largest sensitivity is above `limit`.
    """
    family = family or (plant,)
    loops = [matrices(open_loop(member, pid, period)) for member in family]
    worst = max(largest_sensitivity(loop) for loop in loops)
    if not all(loop.is_stable() for loop in loops) or worst > limit:
        what = f"no stable loop with a sensitivity below {limit:.3g} was found"
        raise InputError("tuning", "ms", worst, f"{what}; allow more, or sample faster")
    slowest = _slowest(plant)
    alone = simulate(plant, None, np.ones(math.ceil(6 * slowest / period) + 8), period)
    samples = len(alone.command)
    settled = []
    for member in family:
        response = simulate(member, pid, np.ones(samples), period)
        settled.append(settling_time(response.time, response.output, 1.0))
    return Tuning(
        pid,
        margins(open_loop(plant, pid, period)),
        worst,
        settling_time(alone.time, alone.output, 1.0),
        tuple(settled),
        _noise_gain(plant, pid, period),
    )


class _Closed(NamedTuple):
    """A closed loop under a unit step of the reference, which is its last state: x[k+1] = a x[k]; output rows."""

    a: Array
    output: Array


class _Search:
    """The optimisation: gains scaled by the plant's, costs in time units of its resonance."""

    def __init__(
        self,
        plant: Plant,
        family: Sequence[Plant],
        period: float,
        ms: float,
        weights: tuple[float, float],
        derivative_filter: float,
    ) -> None:
        self.gain, self.period, self.limit = plant.static_gain, period, ms
        self.w0 = 2 * math.pi * plant.natural_frequency
        self.weights, self.filter = weights, derivative_filter
        self.stages = [member.sampled(period, _SUBSTEPS) for member in family]
        self.samples = min(max(math.ceil(6 * _slowest(plant) / period), 64), 4096)
        near = np.concatenate([m.natural_frequency * np.linspace(0.7, 1.4, 120) for m in plant.all_modes])
        angles = np.concatenate([np.geomspace(1e-3, math.pi, 150), 2 * math.pi * period * near])
        self.angles = np.unique(angles[angles <= math.pi])
        loops = (matrices(member.discretise(period)) for member in family)
        self.responses = np.array([loop.response(self.angles) for loop in loops])

    def pid(self, at: Array) -> PID:
        """Return the controller at a point of the search: log(Ki/w0), Kp, Kd w0, times the plant's gain."""
        ki = math.exp(min(float(at[0]), 50.0)) * self.w0
        kp = float(at[1]) if abs(at[1]) > 1e-9 else 1e-9  # eq (33) has no integral part without a proportional one
        return PID(kp / self.gain, kp / ki, float(at[2]) / (self.w0 * kp), *self.weights, self.filter)

    def cost(self, pid: PID) -> float:
        """Return the worst ITAE of the family, with a steep penalty above the limit of the sensitivity."""
        own = pid.realised(self.period)
        itae = max(self._itae(_close_loop(stage, own)) for stage in self.stages)
        peak = float(np.max(np.abs(1 / (1 + _regulator(own, self.angles) * self.responses))))
        above = max(0.0, peak - self.limit)
        return itae * (1 + 100 * above) + 100 * above**2

    def _itae(self, loop: _Closed) -> float:
        """Return the integral of time times absolute error, in units of 1/w0^2; large if the loop is unstable."""
        radius = float(np.max(np.abs(np.linalg.eigvals(loop.a[:-1, :-1]))))
        if radius >= 1:
            return 1e6 * radius
        states, power = np.zeros((1, len(loop.a))), loop.a.T
        states[0, -1] = 1.0
        while len(states) < self.samples:  # doubles the record: x[n + k] = a^n x[k]
            states, power = np.vstack([states, states @ power]), power @ power
        error = np.abs(1 - states[: self.samples] @ loop.output.T).ravel()
        step = self.w0 * self.period / _SUBSTEPS
        return float(error @ np.arange(len(error))) * step**2


def _close_loop(stage: Sampled, own: Realised) -> _Closed:
    n, m = len(stage.a), len(own.a)
    command = np.concatenate([own.d_reading * stage.c, own.c, [own.d_reference]])
    a = np.zeros((n + m + 1, n + m + 1))
    a[:n, :n] = stage.a
    a[:n] += np.outer(stage.b, command)
    a[n:-1] = np.column_stack([np.outer(own.b_reading, stage.c), own.a, own.b_reference])
    a[-1, -1] = 1.0
    output = np.outer(stage.direct, command)
    output[:, :n] += stage.between
    return _Closed(a, output)


def _regulator(own: Realised, angles: Array) -> NDArray[np.complex128]:
    """Return the controller's response from error to command."""
    return -Matrices(own.a, own.b_reading, own.c, own.d_reading).response(angles)


def _noise_gain(plant: Plant, pid: PID, period: float) -> float:
    """Return the largest |C / (1 + L)|."""
    angles = np.linspace(1e-3, math.pi, 2000)
    regulator = _regulator(pid.realised(period), angles)
    response = matrices(plant.discretise(period)).response(angles)
    return float(np.max(np.abs(regulator / (1 + regulator * response))))


def _slowest(plant: Plant) -> float:
    """Return the longest time constant of the plant [s]; lags and delay, in series with the modes, add to theirs."""
    constants = []
    for frequency, damping, _ in plant.all_modes:
        w = 2 * math.pi * frequency
        slow = damping - math.sqrt(damping**2 - 1) if damping > 1 else damping
        constants.append(1 / (slow * w))
    return max(constants) + math.fsum(plant.lags) + plant.delay

"""Structural errors: what a bench, its sensor or its recorder does that no effect of the catalogue describes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from studies.hidden_effect_trial.curves import OF_GAIN, OF_SENSOR, curve, without_low_degrees
from studies.hidden_effect_trial.effects import Stage
from studies.hidden_effect_trial.recordings import PERIOD, Recording

Array = NDArray[np.float64]
#: What they are, and why none is an effect of the catalogue:
#: coarse_steps: the bench is itself a simulation, whose solver has steps of its own length and takes the command for
#:   straight between them. Each jump of the command is early or late by another part of a step: no common delay, nor a
#:   bandwidth, which would act on all jumps alike.
#: clock_jitter: readings are taken early or late by chance, at once or wandering. A delay of the catalogue is constant.
#: curved_sensor: a smooth error of the sensor's scale, of degree 4 to 7 in position, less the nearest cubic over the
#:   positions that were recorded. Squares and cubes are like electrostriction and stiffening.
#: uneven_gain: the actuator's gain depends on its position, as a polynomial of degree 5 to 7, ahead of the modes.
#: rounded_readings: smoothed forwards and backwards, so that nothing is late as behind a bandwidth; then rounded by a
#:   converter that keeps its last reading within a dead band. Only the rounding has a name (`TRUE`).
KINDS = ("coarse_steps", "clock_jitter", "curved_sensor", "uneven_gain", "rounded_readings")
#: Effects that a structural error truly contains: to name them is no invention.
TRUE = {"rounded_readings": ("quantisation",)}
#: A size is found to within this, on a logarithm, in this number of trials.
NEAR, TRIALS = 0.05, 24
#: Where the search for a size begins, and where it ends.
SIZES = {
    "coarse_steps": (0.37e-3, 3e-6, 8e-3),
    "clock_jitter": (1e-5, 1e-8, 0.5e-3),
    "curved_sensor": (1e-3, 1e-6, 0.1),
    "uneven_gain": (1e-2, 1e-5, 1.0),
    "rounded_readings": (3e-3, 1e-5, 0.05),
}


@dataclass(frozen=True)
class Fault:
    """A structural error.

    Parameters
    ----------
    kind
        One of `KINDS`.
    size
        Length of the solver's steps [s]; root mean square of the clock's error [s]; weight of the curve over half the
        range of positions; weight of the change of gain; steps of the reading over the stroke.
    weights
        Of Legendre polynomials: of the sensor from degree 0 on, of the gain from degree 5 on.
    span
        Lowest and highest position, where the curve of the sensor ends [m].
    memory
        For which the clock's error lasts [s].
    cutoff
        Frequency where smoothing leaves 61 % [Hz].
    dead
        Half width of the dead band beyond half a step, in steps.
    seed
        Of what happens at random.
    """

    kind: str
    size: float
    weights: tuple[float, ...] = ()
    span: tuple[float, float] = (0.0, 1.0)
    memory: float = 0.0
    cutoff: float = math.inf
    dead: float = 0.0
    seed: int = 0

    @property
    def period(self) -> float:
        """Length of the stretches over which the command is straight [s]."""
        return self.size if self.kind == "coarse_steps" else PERIOD

    def command(self, run: Recording) -> tuple[Array, bool]:
        """Return the command at the points of the solver, and whether it waits between them."""
        if self.kind != "coarse_steps":
            return run.u, run.held
        t = np.arange(math.ceil(run.n * PERIOD / self.size) + 2) * self.size / PERIOD
        if run.held:
            return run.u[np.minimum((t + 1e-9).astype(np.int64), run.n)], False
        return np.interp(t, np.arange(run.n + 1), run.u), False

    def gain(self, stage: Stage) -> tuple[float, ...]:
        """Return what the kernel needs of an uneven gain: the range of positions, and weights [m]; else nothing."""
        if self.kind != "uneven_gain":
            return ()
        return stage.stroke, *(0.5 * stage.stroke * self.size * weight for weight in self.weights)

    def timing_error(self, run: Recording) -> Array:
        """Return by how much each reading of a run is late [s]."""
        if self.kind != "clock_jitter":
            return np.zeros(run.n)
        pole = math.exp(-PERIOD / self.memory)
        white = np.random.default_rng([self.seed, run.seed]).standard_normal(run.n + 2000)
        late = lfilter([math.sqrt(1.0 - pole * pole)], [1.0, -pole], white)[2000:]
        return np.asarray(self.size * late)

    def sensor(self, x: Array) -> Array:
        """Return what the sensor shows at positions [m]."""
        if self.kind != "curved_sensor":
            return x
        low, high = self.span
        half = 0.5 * (high - low)
        return x + half * self.size * curve((x - low) / half - 1.0, self.weights)

    def recorder(self, y: Array, stage: Stage) -> Array:
        """Return what the recorder makes of readings [m]."""
        if self.kind != "rounded_readings":
            return y
        if math.isfinite(self.cutoff):
            y = gaussian_filter1d(y, 1.0 / (2.0 * math.pi * self.cutoff * PERIOD), mode="nearest")
        step = self.size * stage.stroke
        return _round_with_band(y, step, (0.5 + self.dead) * step) if step else y


@njit(cache=True, error_model="numpy")
def _round_with_band(y: Array, step: float, band: float) -> Array:
    """Return readings in whole steps, each kept until the signal is further than a band from it."""
    out, last = np.empty_like(y), step * np.round(y[0] / step)
    for i in range(len(y)):
        if abs(y[i] - last) > band:
            last = step * np.round(y[i] / step)
        out[i] = last
    return out


def draw_fault(
    rng: np.random.Generator, kind: str, positions: Array, target: float, error: Callable[[Fault], float]
) -> Fault | None:
    """Return a structural error of a stated size; None if there is none of such a shape.

    Parameters
    ----------
    rng
        Draws its shape.
    kind
        Of it.
    positions
        Of the stage in all runs [m].
    target
        Root mean square that it should have [m].
    error
        Returns the one that it has [m].
    """
    low, high = float(positions.min()), float(positions.max())
    fault = Fault(kind, 0.0, span=(low, high), seed=int(rng.integers(2**31)))
    if kind == "curved_sensor":
        weights = rng.standard_normal(len(OF_SENSOR))
        places = 2.0 * (positions - low) / (high - low) - 1.0
        fault = replace(fault, weights=without_low_degrees(weights / np.linalg.norm(weights), places))
    elif kind == "uneven_gain":
        weights = rng.standard_normal(len(OF_GAIN))
        fault = replace(fault, weights=tuple(float(w) for w in weights / np.linalg.norm(weights)))
    elif kind == "clock_jitter":
        fault = replace(fault, memory=float(np.exp(rng.uniform(math.log(1e-3), math.log(0.3)))))
    elif kind == "rounded_readings":
        share, dead = rng.uniform(0.2, 0.6), float(rng.uniform(0.1, 0.5))
        cutoff = _solve_size(lambda c: error(replace(fault, cutoff=1.0 / c)), share * target, (1e-2, 1e-3, 0.2))
        if cutoff is None:
            return None
        fault = replace(fault, cutoff=1.0 / cutoff, dead=dead)
    size = _solve_size(lambda size: error(replace(fault, size=size)), target, SIZES[kind])
    return None if size is None else replace(fault, size=size)


def _solve_size(error: Callable[[float], float], target: float, sizes: tuple[float, float, float]) -> float | None:
    """Return the size at which an error is as large as wanted, by regula falsi on logarithms."""
    size, low, high = sizes
    below: tuple[float, float] | None = None
    above: tuple[float, float] | None = None
    for _ in range(TRIALS):
        reached = max(error(size), 1e-6 * target)  # a solver whose points are the samples' own has no error
        if not math.isfinite(reached):
            return None
        if abs(math.log(reached / target)) < NEAR:
            return size
        if reached < target:
            below = size, reached
        else:
            above = size, reached
        if below and above:
            (x0, y0), (x1, y1) = below, above
            share = min(max(math.log(target / y0) / math.log(y1 / y0), 0.1), 0.9)
            size = x0 * (x1 / x0) ** share
        elif size in (low, high):
            return None
        else:
            size = min(max(size * min(max(target / reached, 0.1), 10.0), low), high)
    return None

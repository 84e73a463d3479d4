"""The plant of a control loop: a stage that answers a command like one or several modes, after lags and a delay.

The sampled plant is exact, for any delay: under a zero-order hold the input during one sampling period is the
command of one sample up to the moment when the next one arrives, and both parts integrate in closed form. This is
the modified z-transform (Jury 1958) in state space; see Astrom and Wittenmark, Computer-Controlled Systems, 3rd
edition 1997, chapter 2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError

#: Least samples per period of a mode: below, the controller does not see what happens between the samples.
FEWEST_SAMPLES = 4.0


class Mode(NamedTuple):
    """A further mode: natural frequency [Hz], damping ratio, and static gain as a share of the first mode's."""

    natural_frequency: float
    damping_ratio: float
    share: float


class Sampled(NamedTuple):
    """x[k+1] = a x[k] + b u[k], y[k] = c x[k]; `between` (m x n) and `direct` (m) give the output within a period.

    The output at ``(k + j / m) T``, j = 0 ... m - 1, is ``between[j] @ x[k] + direct[j] * u[k]``.
    """

    a: Array
    b: Array
    c: Array
    between: Array
    direct: Array


@dataclass(frozen=True)
class Plant:
    """G(s) = gain w0^2 / (s^2 + 2 zeta w0 s + w0^2) exp(-delay s), with further modes in parallel and lags in series.

    Parameters
    ----------
    gain
        Static gain of the first mode [reading per command].
    natural_frequency
        Undamped natural frequency of the first mode [Hz].
    damping_ratio
        Its damping ratio; 1 and more is allowed.
    delay
        Delay between command and reading, in addition to the hold [s].
    modes
        Further modes, each ``(natural_frequency [Hz], damping_ratio, share)``: its static gain is `share` times `gain`.
    lags
        Time constants tau [s] of first-order lags 1 / (1 + tau s) in series with the modes: driver, sensor.

    Raises
    ------
    InputError
        If a number is not finite, a frequency or a lag is not positive, or a damping ratio or the delay is negative.

    >>> Plant(gain=2.0, natural_frequency=100.0, damping_ratio=0.02).static_gain
    2.0
    """

    gain: float
    natural_frequency: float
    damping_ratio: float
    delay: float = 0.0
    modes: tuple[Mode | tuple[float, float, float], ...] = ()
    lags: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not math.isfinite(self.gain) or self.gain == 0:
            raise InputError("plant", "gain", self.gain, "must be finite and not zero")
        if not (math.isfinite(self.delay) and self.delay >= 0):
            raise InputError("plant", "delay", f"{self.delay:g} s", "must be zero or more")
        for i, mode in enumerate(self.all_modes):
            where = "" if i == 0 else f"modes.{i}."
            frequency, damping, share = mode
            if not (math.isfinite(frequency) and frequency > 0):
                raise InputError("plant", f"{where}natural_frequency", f"{frequency:g} Hz", "must be above zero")
            if not (math.isfinite(damping) and damping >= 0):
                raise InputError("plant", f"{where}damping_ratio", damping, "must be zero or more")
            if not math.isfinite(share):
                raise InputError("plant", f"{where}share", share, "must be a finite number")
        for i, lag in enumerate(self.lags, start=1):
            if not (math.isfinite(lag) and lag > 0):
                raise InputError("plant", f"lags.{i}", f"{lag:g} s", "must be above zero; leave out a lag that is none")

    @classmethod
    def from_time_constants(cls, gain: float, t1: float, t2: float, delay: float = 0.0) -> Plant:
        """Return the plant gain / ((1 + t1 s)(1 + t2 s)), the form of Lin et al. (2019), eq (31).

        Parameters
        ----------
        gain
            Static gain [reading per command].
        t1, t2
            Time constants [s].
        delay
            Delay in addition to the hold [s].

        Raises
        ------
        InputError
            If a time constant is not positive.

        >>> plant = Plant.from_time_constants(6.0777, 1.3708e-3, 1.3635e-3)
        >>> round(plant.natural_frequency, 2), round(plant.damping_ratio, 6)
        (116.41, 1.000004)
        """
        for name, value in (("t1", t1), ("t2", t2)):
            if not (math.isfinite(value) and value > 0):
                raise InputError("plant", name, f"{value:g} s", "must be above zero")
        root = math.sqrt(t1 * t2)
        return cls(gain, 1 / (2 * math.pi * root), (t1 + t2) / (2 * root), delay)

    @property
    def all_modes(self) -> tuple[Mode, ...]:
        """The first mode, with share 1, and the further ones."""
        return (Mode(self.natural_frequency, self.damping_ratio, 1.0), *(Mode(*mode) for mode in self.modes))

    @property
    def static_gain(self) -> float:
        """Reading per command at rest, all modes together."""
        return self.gain * sum(mode.share for mode in self.all_modes)

    def shifted(self, factor: float) -> Plant:
        """Return the plant with its natural frequencies multiplied by `factor`; static gain, lags and delay stay."""
        modes = tuple(Mode(m.natural_frequency * factor, m.damping_ratio, m.share) for m in self.all_modes[1:])
        return replace(self, natural_frequency=self.natural_frequency * factor, modes=modes)

    def response(self, frequencies: ArrayLike) -> NDArray[np.complex128]:
        """Return the frequency response of the continuous plant, lags and delay included and hold excluded.

        Parameters
        ----------
        frequencies
            In Hz, any shape.

        >>> Plant(1.0, 100.0, 0.01).response(100.0)
        np.complex128(-50j)
        """
        f = np.asarray(frequencies, dtype=float)
        total = self._modal(f) * np.exp(-2j * math.pi * f * self.delay)
        for lag in self.lags:
            total = total / (1 + 2j * math.pi * f * lag)
        return total

    def phase(self, frequencies: ArrayLike) -> Array:
        """Return the phase of `response` [deg], not wrapped: (-360, 0] from the modes, then lags and delay."""
        f = np.asarray(frequencies, dtype=float)
        modes = np.degrees(np.angle(self._modal(f)))
        total = np.where(modes > 0, modes - 360.0, modes) - 360.0 * f * self.delay
        for lag in self.lags:
            total = total - np.degrees(np.arctan(2 * math.pi * f * lag))
        return total

    def sampled(self, period: float, substeps: int = 1) -> Sampled:
        """Return the exact sampled plant behind a zero-order hold, and its output at `substeps` moments per period.

        Parameters
        ----------
        period
            Sampling period T [s].
        substeps
            Moments per period at which the output is wanted.

        Raises
        ------
        InputError
            If the period is not positive.
        """
        if not (math.isfinite(period) and period > 0):
            raise InputError("loop", "period", f"{period:g} s", "must be above zero")
        a, b, c = self._continuous()
        held, late = self._delay_in(period)
        n, oldest = len(a), int(late > 0)
        queue = held + oldest  # commands on their way, the oldest first: ..., u[k-2], u[k-1]; then comes u[k]
        rows = np.zeros((substeps + 1, n, n + queue + 1))  # the state at each moment per state, queue and u[k]
        for j in range(substeps + 1):
            time = period * j / substeps
            until, since = min(time, late), max(time - late, 0.0)  # before and after the next command takes over
            first, old = _step_matrices(a, b, until)
            second, new = _step_matrices(a, b, since)
            rows[j, :, :n] = second @ first
            rows[j, :, n] = second @ old
            rows[j, :, n + oldest] += new
        big, drive = np.zeros((n + queue, n + queue)), np.zeros(n + queue)
        big[:n], drive[:n] = rows[-1, :, :-1], rows[-1, :, -1]
        if queue:
            big[n : n + queue - 1, n + 1 :] = np.eye(queue - 1)
            drive[-1] = 1.0
        output = c @ rows[:-1]
        return Sampled(big, drive, output[0, :-1], output[:, :-1], output[:, -1])

    def discretise(self, period: float) -> Any:
        """Return the sampled plant as python-control's discrete `StateSpace`.

        Zero-order hold, command to reading; exact for any delay. See `sampled`.

        Parameters
        ----------
        period
            Sampling period T [s].
        """
        import control as ct

        a, b, c, _, _ = self.sampled(period)
        return ct.ss(a, b[:, None], c[None, :], 0.0, period)

    def concerns(self, period: float) -> list[str]:
        """Return what makes this sampling period unfit for the plant, in sentences; empty if nothing does.

        A lag is never a concern: it does not oscillate, so that it cannot pass for a slower oscillation.

        >>> Plant(1.0, 600.0, 0.02).concerns(1e-3)
        ['Sampling is too coarse: the mode at 600 Hz has 1.7 samples per period at 1000 Hz, and the controller sees it
        as one at 400 Hz.']
        """
        sentences, rate = [], 1 / period
        for frequency, damping, _ in self.all_modes:
            samples = rate / frequency
            if damping >= 1 or samples >= FEWEST_SAMPLES:
                continue
            alias = abs(frequency - rate * round(frequency / rate))
            seen = f"and the controller sees it as one at {alias:.4g} Hz" if samples < 2 else "take 10 or more"
            sentences.append(
                f"Sampling is too coarse: the mode at {frequency:.4g} Hz has {samples:.2g} samples per period "
                f"at {rate:.4g} Hz, {seen}."
            )
        return sentences

    def _continuous(self) -> tuple[Array, Array, Array]:
        """Return a, b, c of modes and lags: the command passes the lags one by one, and the last drives the modes.

        Each mode has a state pair (displacement, velocity over w0), so that it is balanced; then one state per lag.
        """
        modes, lags = self.all_modes, self.lags
        first = 2 * len(modes)  # of the lags' states
        n = first + len(lags)
        a, b, c = np.zeros((n, n)), np.zeros(n), np.zeros(n)
        drive = a[:, -1] if lags else b  # what acts on the modes: the last lag, or the command itself
        for i, (frequency, damping, share) in enumerate(modes):
            w, at = 2 * math.pi * frequency, slice(2 * i, 2 * i + 2)
            a[at, at] = w * np.array([[0.0, 1.0], [-1.0, -2 * damping]])
            drive[2 * i + 1], c[2 * i] = w, self.gain * share
        for i, lag in enumerate(lags):
            source = a[:, first + i - 1] if i else b
            source[first + i], a[first + i, first + i] = 1 / lag, -1 / lag
        return a, b, c

    def _modal(self, f: Array) -> NDArray[np.complex128]:
        """Return the response of the modes alone, without lags and delay, at frequencies [Hz]."""
        total: NDArray[np.complex128] = np.zeros(f.shape, dtype=complex)
        for frequency, damping, share in self.all_modes:
            ratio = f / frequency
            total = total + share / (1 - ratio**2 + 2j * damping * ratio)
        return self.gain * total

    def _delay_in(self, period: float) -> tuple[int, float]:
        """Return the whole sampling periods in the delay, and the rest of it [s]."""
        # A delay that is a whole number of periods but for rounding must not cost a state that does nothing.
        whole = math.floor(self.delay / period + 1e-9)
        rest = self.delay - whole * period
        return whole, rest if rest > 1e-9 * period else 0.0


def _step_matrices(a: Array, b: Array, time: float) -> tuple[Array, Array]:
    """Return exp(a t) and the integral of exp(a s) b over 0 ... t."""
    n = len(a)
    big = np.zeros((n + 1, n + 1))
    big[:n, :n], big[:n, n] = a * time, b * time
    exponential = expm(big)
    return exponential[:n, :n], exponential[:n, n]

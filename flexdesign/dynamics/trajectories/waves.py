"""Waves between two levels: sine, triangle, square, chirp and multisine."""

from __future__ import annotations

import math
from typing import Any, Literal, Self

import numpy as np
from pydantic import model_validator
from scipy.fft import irfft, next_fast_len

from flexdesign.core.arrays import Array
from flexdesign.core.toml_files import whole
from flexdesign.dynamics.trajectories.base import AnyLevel, Cycles, Duration, Frequency, Trajectory

#: A moment this close before a jump, in cycles, is at the jump: what rounding does to a time on the sampling grid.
_ROUNDING = 1e-7
#: A multisine of more tones is a slip in the resolution.
_MOST_TONES = 20_000


class _TwoLevels(Trajectory):
    """Something that moves between two levels, and starts at `low` unless it says otherwise."""

    low: AnyLevel
    high: AnyLevel

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if not self.low.value < self.high.value:
            raise ValueError(f'low = {self.low} is not below high = {self.high}; to stay at a level use shape = "hold"')
        return self

    def _scaled(self, share: Array) -> Array:
        """Return levels for numbers from 0 (low) to 1 (high); exact at both ends."""
        return self.low.value * (1.0 - share) + self.high.value * share


class _Cycles(_TwoLevels):
    """A wave that repeats; `cycles` need not be whole. With ``begin = "high"`` it is upside down."""

    frequency: Frequency
    cycles: Cycles = 1.0
    begin: Literal["low", "high"] = "low"

    def _scaled(self, share: Array) -> Array:
        return super()._scaled(share if self.begin == "low" else 1.0 - share)

    def _moving(self) -> float:
        return float(self.cycles / self.frequency)

    def _fastest(self) -> float:
        return float(self.frequency)


class Sine(_Cycles):
    """low + (high - low) (1 - cos 2 pi f t) / 2: starts at `low` without a jump in velocity."""

    shape: Literal["sine"] = "sine"

    def _at(self, time: Array) -> Array:
        return self._scaled(0.5 - 0.5 * np.cos(2 * np.pi * self.frequency * time))


class Triangle(_Cycles):
    """Constant velocity from `low` to `high` and back."""

    shape: Literal["triangle"] = "triangle"

    def _at(self, time: Array) -> Array:
        cycles = self.frequency * time
        return self._scaled(1.0 - np.abs(1.0 - 2.0 * (cycles - np.floor(cycles))))


class Square(_Cycles):
    """Half a cycle at `low`, then half a cycle at `high`; after whole cycles its last sample is back at `low`."""

    shape: Literal["square"] = "square"

    def _at(self, time: Array) -> Array:
        return self._scaled(np.floor(2 * self.frequency * time + _ROUNDING) % 2)


class Chirp(_TwoLevels):
    """A sine from `low` whose frequency goes from one end of `band` to the other in the time `time`.

    The frequency grows by equal factors in equal times (`sweep` ``"logarithmic"``) or by equal steps (``"linear"``).
    """

    shape: Literal["chirp"] = "chirp"
    band: tuple[Frequency, Frequency]
    time: Duration
    sweep: Literal["logarithmic", "linear"] = "logarithmic"

    @model_validator(mode="after")
    def _has_a_band(self) -> Self:
        if self.band[0] == self.band[1]:
            raise ValueError('has one frequency at both ends of its band; use shape = "sine"')
        return self

    def _moving(self) -> float:
        return float(self.time)

    def _fastest(self) -> float:
        return float(max(self.band))

    def _at(self, time: Array) -> Array:
        first, last = self.band
        passed = np.minimum(time, self.time) / self.time
        if self.sweep == "linear":
            cycles = self.time * (first * passed + (last - first) * passed**2 / 2)
        else:
            growth = math.log(last / first)
            cycles = self.time * first * np.expm1(growth * passed) / growth
        return self._scaled(0.5 - 0.5 * np.cos(2 * np.pi * cycles))


class Multisine(_TwoLevels):
    """Equal tones at every multiple of `resolution` within `band`; one cycle takes 1 / `resolution`.

    Phases are random, drawn from `seed`, or Schroeder's, which keep the peaks low: -pi n (n - 1) / N for tone n of N
    (M. R. Schroeder, Synthesis of low-peak-factor signals and binary sequences with low autocorrelation, IEEE Trans.
    Inf. Theory 16 (1970), for a flat spectrum). The sum is shifted and scaled so that its peaks come within 0.2 % of
    the range to `low` and `high` and never pass them. It starts wherever its phases put it.
    """

    shape: Literal["multisine"] = "multisine"
    band: tuple[Frequency, Frequency]
    resolution: Frequency
    cycles: Cycles = 1.0
    phases: Literal["random", "schroeder"] = "random"
    seed: whole(0, 2**32 - 1) = 0  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _has_tones(self) -> Self:
        tones = len(self.harmonics())
        if not tones:
            raise ValueError(
                "has no multiple of its resolution within its band; widen the band or refine the resolution"
            )
        if tones > _MOST_TONES:
            raise ValueError(f"has {tones} tones; at most {_MOST_TONES}: narrow the band or coarsen the resolution")
        return self

    def harmonics(self) -> range:
        """Return which multiples of `resolution` it holds."""
        first, last = (frequency / self.resolution for frequency in self.band)
        return range(math.ceil(first * (1 - 1e-9)), math.floor(last * (1 + 1e-9)) + 1)

    def _moving(self) -> float:
        return float(self.cycles / self.resolution)

    def _fastest(self) -> float:
        return float(self.harmonics()[-1] * self.resolution)

    def _at(self, time: Array) -> Array:
        tones, lowest = self._tones(), self.harmonics()[0]
        middle, half = _extent(tones, lowest)
        turn = np.exp(2j * np.pi * np.mod(self.resolution * time, 1.0))
        # The tones are a polynomial in `turn`: Horner's rule needs one product per tone instead of one cosine.
        total = np.polynomial.polynomial.polyval(turn, tones) * turn**lowest
        return self._scaled(0.5 + 0.5 * (total.real - middle) / half)

    def _tones(self) -> Any:
        """Return exp(i phase) of each tone."""
        count = len(self.harmonics())
        if self.phases == "schroeder":
            n = np.arange(1, count + 1)
            return np.exp(-1j * np.pi * n * (n - 1) / count)
        return np.exp(2j * np.pi * np.random.default_rng(self.seed).random(count))


def _extent(tones: Any, lowest: int) -> tuple[float, float]:
    """Return the middle of a sum of tones, and a bound of its distance from there, 0.13 % above the true one at most.

    A sum of tones up to harmonic h that is bounded by M on N > 2 h equidistant points is bounded by M / cos(pi h / N)
    everywhere (H. Ehlich and K. Zeller, Schwankung von Polynomen zwischen Gitterpunkten, Math. Z. 86 (1964)).
    """
    highest = lowest + len(tones) - 1
    points = 2 * next_fast_len(32 * highest, real=True)
    spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
    spectrum[lowest : highest + 1] = 0.5 * points * tones
    on_grid = irfft(spectrum, points)
    low, high = float(on_grid.min()), float(on_grid.max())
    return (high + low) / 2, (high - low) / 2 / math.cos(math.pi * highest / points)

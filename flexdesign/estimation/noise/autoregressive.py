"""Stationary autoregressive processes: their estimation from records, and the whitening of records with gaps."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.linalg import matmul_toeplitz, solve_toeplitz

from flexdesign.core.arrays import Array, Flags
from flexdesign.core.errors import InputError
from flexdesign.core.model import Observation

#: Fewest samples from which a correlation is estimated: with fewer, Schwarz's criterion finds none below 0.33.
FEWEST_SAMPLES = 30


@dataclass(frozen=True, eq=False)
class Process:
    """A stationary autoregressive process, e_t + a_1 e_(t-1) + ... + a_p e_(t-p) = w_t with white w.

    Parameters
    ----------
    reflections
        The reflection coefficients k_1 ... k_p, minus the partial autocorrelations; none for white noise.
    sigma
        Standard deviation of w, SI.

    Raises
    ------
    InputError
        If a reflection is not between -1 and 1, so that the noise would grow without bound, or sigma is not above zero.

    >>> Process.from_coefficients(np.array([1.0, -0.98]), 1.0).rms
    5.025
    """

    reflections: Array
    sigma: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.sigma) and self.sigma > 0):
            raise InputError("noise", "sigma", self.sigma, "give the standard deviation of the noise, above zero")
        if not np.all(np.abs(self.reflections) < 1):
            raise InputError(
                "noise", "process", None, "grows without bound; noise is described by a stationary process"
            )

    @classmethod
    def white(cls, sigma: float) -> Process:
        """Return white noise."""
        return cls(np.zeros(0), sigma)

    @classmethod
    def from_coefficients(cls, coefficients: Array, sigma: float) -> Process:
        """Return the process with the coefficients 1, a_1, ... a_p, by the step-down recursion."""
        a, reflections = np.asarray(coefficients, dtype=float), []
        while len(a) > 1:
            reflections.append(a[-1])
            if not abs(a[-1]) < 1:
                break
            a = ((a - a[-1] * a[::-1]) / (1 - a[-1] ** 2))[:-1]
        return cls(np.array(reflections[::-1]), sigma)

    @classmethod
    def from_covariances(cls, covariances: Array) -> Process:
        """Return the process that has these covariances at lags 0, 1, ... p, by the Yule-Walker equations."""
        coefficients = np.append(1.0, -solve_toeplitz(covariances[:-1], covariances[1:]))
        return cls.from_coefficients(coefficients, float(np.sqrt(coefficients @ covariances)))

    @property
    def order(self) -> int:
        """Number of past samples that a sample depends on."""
        return len(self.reflections)

    @cached_property
    def predictors(self) -> tuple[Array, ...]:
        """The best predictors from 0, 1, ... p samples, each 1, a_1, ... (Levinson's recursion)."""
        found = [np.ones(1)]
        for reflection in self.reflections:
            longer = np.append(found[-1], 0.0)
            found.append(longer + reflection * longer[::-1])
        return tuple(found)

    @property
    def coefficients(self) -> Array:
        """1, a_1, ... a_p."""
        return self.predictors[-1]

    @property
    def rms(self) -> float:
        """Standard deviation of the process, SI."""
        return self.sigma / float(np.sqrt(np.prod(1 - self.reflections**2)))

    @cached_property
    def start(self) -> Array:
        """Lower triangular matrix (p by p) that whitens the first p samples: row k predicts sample k from those before.

        Its inverse is the Cholesky factor of their covariance matrix.
        """
        variances = np.append(
            np.cumprod((1 - self.reflections**2)[::-1])[::-1], 1.0
        )  # sigma^2 over the error of each order
        rows = np.zeros((self.order, self.order))
        for order, row in enumerate(rows):
            row[: order + 1] = self.predictors[order][::-1] * np.sqrt(variances[order]) / self.sigma
        return rows

    def autocorrelation(self, count: int) -> Array:
        """Return the exact correlations at the lags 0, 1, ... count - 1, by the Yule-Walker recursion."""
        found = np.ones(count)
        for lag in range(1, count):
            predictor = self.predictors[min(lag, self.order)][1:]
            found[lag] = -predictor @ found[lag - len(predictor) : lag][::-1]
        return found

    def density(self, frequency: Array, period: float) -> Array:
        """Return the one-sided power spectral density [SI^2/Hz] at some frequencies [Hz], sampled every `period` s."""
        angles = 2j * np.pi * period * np.outer(np.asarray(frequency), np.arange(self.order + 1))
        return np.asarray(2 * period * self.sigma**2 / np.abs(np.exp(-angles) @ self.coefficients) ** 2)

    def whiten(self, columns: Array) -> Array:
        """Return columns (n by m) as independent numbers of variance one, if they hold this process; linear in them."""
        weights = self.coefficients / self.sigma
        whitened = np.empty(columns.shape)
        for k, column in enumerate(columns.T):
            whitened[:, k] = np.convolve(column, weights)[: len(columns)]
        count = min(self.order, len(columns))
        whitened[:count] = self.start[:count, :count] @ columns[:count]
        return whitened

    def periodic_autocorrelation(self, samples: int) -> Array:
        """Return the correlations at the lags 0, 1, ... of a periodic process of twice the samples or more, by FFT.

        In contrast to `autocorrelation` all lags cost O(n log n), and a root on the unit circle is no problem.
        """
        length = next_fast_len(2 * samples, real=True)
        inverse = np.abs(rfft(self.coefficients, length)) ** 2
        # A residual without noise has a root on the unit circle, where `inverse` is zero but for rounding.
        covariance = irfft(1 / np.maximum(inverse, np.finfo(float).eps * inverse.max()), length)
        return np.asarray(covariance / covariance[0])

    def inflation(self, samples: int) -> float:
        """Return how many samples count as one: the sum of the squared correlations over all lags (Bartlett 1946)."""
        return float(np.sum(self.periodic_autocorrelation(samples) ** 2)) if self.order else 1.0

    def quadratic(self, columns: Array) -> Array:
        """Return columns' R columns, with the correlation matrix R of the process; `columns` are n by m."""
        if not self.order:
            return columns.T @ columns
        lags = self.periodic_autocorrelation(len(columns))[: len(columns)]
        return np.asarray(columns.T @ matmul_toeplitz(lags, columns, check_finite=False))


def process_of(residual: Array) -> Process:
    """Return the process behind a residual by Burg's recursion, with innovations of variance one."""
    return Process(burg([residual]) if len(residual) >= FEWEST_SAMPLES else np.zeros(0), 1.0)


def burg(records: Sequence[Array], highest_order: float = math.inf) -> Array:
    """Return the reflection coefficients of the process behind some records, by Burg's recursion pooled over them.

    The order is that of the smallest n log(variance) + k log(n) (Schwarz 1978), so that white noise is found white: an
    empty array. It is 10 log10 of the length of the shortest record at most, as in R. See Percival and Walden (1993),
    Spectral Analysis for Physical Applications, section 9.5.
    """
    n, shortest = sum(map(len, records)), min(map(len, records))
    power = sum(float(r @ r) for r in records) / n
    if power == 0:
        return np.zeros(0)
    orders = range(1, int(min(highest_order, 10 * math.log10(max(shortest, 1)), shortest - 1)) + 1)
    reflections, scores = list[float](), [n * np.log(power)]
    forward, backward = [r[1:] for r in records], [r[:-1] for r in records]
    for order in orders:
        pairs = list(zip(forward, backward, strict=True))
        energy = sum(float(f @ f + b @ b) for f, b in pairs)
        reflection = -2 * sum(float(f @ b) for f, b in pairs) / energy if energy > 0 else 1.0
        power *= 1 - reflection**2
        if power <= 0:  # nothing is left to predict
            break
        reflections.append(reflection)
        scores.append(n * np.log(power) + order * np.log(n))
        forward = [(f + reflection * b)[1:] for f, b in pairs]
        backward = [(b + reflection * f)[:-1] for f, b in pairs]
    return np.array(reflections[: int(np.argmin(scores))])


# --- whitening -------------------------------------------------------------------------------------------------------


class Whitening(Protocol):
    """A linear filter that makes noise white, of variance one."""

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the whitened residual.

        Parameters
        ----------
        observation
            The observation of the residual.
        residual
            Samples by columns, SI, gaps as zeros; the result has the same shape and is linear in it.
        """


@dataclass(frozen=True)
class ColouredNoise:
    """White or coloured noise, by the autoregressive process of all observations, or of each by its name."""

    processes: Process | Mapping[str, Process]

    def process(self, name: str) -> Process:
        """Return the process of an observation.

        Raises
        ------
        InputError
            If that of this observation is not given.
        """
        if isinstance(self.processes, Process):
            return self.processes
        if name not in self.processes:
            raise InputError("fit", f"noise.{name}", None, "give the process of this observation's noise")
        return self.processes[name]

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the whitened residual, zero at gaps: values of the observation that are not finite.

        After a gap the process starts with an unknown past.

        Raises
        ------
        InputError
            If the noise of this observation is not given, or residual and measured samples do not match.
        """
        process = self.process(observation.name)
        present = np.isfinite(np.asarray(observation.measured()))
        if len(present) != len(residual):
            remedy = f"the residual has {len(residual)} samples, measured are {len(present)}"
            raise InputError("fit", observation.name, None, remedy)
        whitened = np.zeros(residual.shape)
        for first, last in stretches(present):
            whitened[first:last] = process.whiten(residual[first:last])
        return whitened


def stretches(flags: Flags) -> list[tuple[int, int]]:
    """Return the stretches in which flags are true: the first index of each, and the index after its last.

    >>> stretches(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    if flags.all():
        return [(0, len(flags))] if len(flags) else []
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))

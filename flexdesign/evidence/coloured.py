"""Coloured noise: stationary autoregressive processes, and the exact whitening of records that hold gaps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.signal import lfilter

from flexdesign.errors import InputError
from flexdesign.model import Observation

Array = NDArray[np.float64]
#: A correlation that has decayed to this share no longer counts.
FORGOTTEN = 1e-6
#: No correlation is followed over more samples.
LONGEST_MEMORY = 1 << 20


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

    Examples
    --------
    >>> slow = Process.from_coefficients(np.array([1.0, -0.98]), 1.0)
    >>> slow.rms
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
    def from_coefficients(cls, coefficients: Array, sigma: float) -> Process:
        """Return the process with the coefficients 1, a_1, ... a_p, by the step-down recursion."""
        a, reflections = np.asarray(coefficients, dtype=float), []
        while len(a) > 1:
            reflections.append(a[-1])
            if not abs(a[-1]) < 1:
                break
            a = ((a - a[-1] * a[::-1]) / (1 - a[-1] ** 2))[:-1]
        return cls(np.array(reflections[::-1]), sigma)

    @property
    def order(self) -> int:
        """How many samples of its past a sample depends on."""
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
        """What whitens the first p samples: lower triangular, p by p, each row the best prediction from those before.

        Its inverse is the Cholesky factor of their covariance matrix.
        """
        kept = np.append(np.cumprod((1 - self.reflections**2)[::-1])[::-1], 1.0)  # sigma^2 over the error of each order
        rows = np.zeros((self.order, self.order))
        for order, row in enumerate(rows):
            row[: order + 1] = self.predictors[order][::-1] * np.sqrt(kept[order]) / self.sigma
        return rows

    def autocorrelation(self) -> Array:
        """Return the correlations at lags 0, 1, ... until they are forgotten."""
        poles = np.abs(np.roots(self.coefficients)) if self.order else np.zeros(1)
        slowest = min(max(float(poles.max(initial=0.0)), 1e-9), 1 - 1e-9)
        lags = int(min(np.ceil(np.log(FORGOTTEN) / np.log(slowest)) + self.order + 1, LONGEST_MEMORY))
        length = next_fast_len(2 * lags, real=True)
        found = np.fft.irfft(1 / np.abs(np.fft.rfft(self.coefficients, length)) ** 2, length)[: lags + 1]
        return np.asarray(found / found[0])

    @property
    def inflation(self) -> float:
        """How many samples count as one for the variance: the sum of the squared autocorrelations (Bartlett 1946)."""
        correlation = self.autocorrelation()
        return float(2 * correlation @ correlation - 1)

    def density(self, frequency: Array, period: float) -> Array:
        """Return the one-sided power spectral density [SI^2/Hz] at some frequencies [Hz], sampled every `period` s."""
        angles = 2j * np.pi * period * np.outer(np.asarray(frequency), np.arange(self.order + 1))
        return np.asarray(2 * period * self.sigma**2 / np.abs(np.exp(-angles) @ self.coefficients) ** 2)

    def whiten(self, columns: Array, present: NDArray[np.bool_] | None = None) -> Array:
        """Return columns (n by m) as independent numbers of variance one, if they hold this process.

        Parameters
        ----------
        columns
            What is whitened; linear in it.
        present
            n flags, False at gaps. After each gap the process starts anew, its past unknown; rows at gaps are zero.
        """
        table = np.asarray(columns, dtype=float)
        if present is not None and not present.all():
            table = np.where(present[:, None], table, 0.0)
        made = self._errors(table) if self.order else table / self.sigma
        for first, last in stretches(np.ones(len(table), dtype=bool) if present is None else present):
            count = min(self.order, last - first)
            made[first : first + count] = self.start[:count, :count] @ table[first : first + count]
        return made if present is None or present.all() else np.where(present[:, None], made, 0.0)

    def _errors(self, table: Array) -> Array:
        """Return by how much columns differ from what their past predicts, over its standard deviation."""
        weights = self.coefficients / self.sigma
        if table.shape[1] > 1:
            return np.asarray(lfilter(weights, [1.0], table, axis=0))
        return np.convolve(table[:, 0], weights)[: len(table), None]  # as lfilter does it, without its ceremony


@dataclass(frozen=True)
class Coloured:
    """Coloured noise, as a `Whitening`.

    Parameters
    ----------
    processes
        The process of all observations, or of each by its name.
    """

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

    def rms(self, name: str) -> float:
        """Return the standard deviation of an observation's noise, SI."""
        return self.process(name).rms

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the whitened residual; zero at the gaps of the observation.

        Parameters
        ----------
        observation
            Where the residual comes from; values that are not finite are its gaps.
        residual
            Samples by channels, SI, gaps as zeros; of an observation with one channel any number of columns.

        Raises
        ------
        InputError
            If the noise of this observation is not given, or residual and measured samples do not match.
        """
        process = self.process(observation.name)
        present = np.isfinite(_columns(np.asarray(observation.measured())))
        if len(present) != len(residual) or present.shape[1] not in (1, residual.shape[1]):
            remedy = f"the residual is shaped {residual.shape}, measured are {present.shape}; give samples by channels"
            raise InputError("fit", observation.name, None, remedy)
        if present.shape[1] == 1 or np.all(present == present[:, :1]):
            return process.whiten(residual, present[:, 0])
        pairs = zip(residual.T, present.T, strict=True)
        return np.column_stack([process.whiten(column[:, None], there) for column, there in pairs])


def stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return where flags are up: the first index of each stretch and the index after its last.

    >>> stretches(np.array([True, True, False, True]))
    [(0, 2), (3, 4)]
    """
    if flags.all():
        return [(0, len(flags))] if len(flags) else []
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))


def _columns(array: NDArray[Any]) -> NDArray[Any]:
    table = array.reshape(len(array), -1) if array.ndim else array.reshape(1, 1)
    return np.hstack([table.real, table.imag]) if np.iscomplexobj(table) else table

"""Noise: what weighs the residuals of an observation, and the colour that a residual turns out to have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from flexdesign.errors import InputError
from flexdesign.model import Observation

Array = NDArray[np.float64]
#: Fewest samples in a row from which a colour is judged; shorter residuals are taken for white.
SHORTEST = 30


class Whitening(Protocol):
    """What turns noise into independent numbers of variance one."""

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the whitened residual.

        Parameters
        ----------
        observation
            Where the residual comes from.
        residual
            Samples by channels, SI, gaps as zeros; the result has the same shape and is linear in it.
        """


@dataclass(frozen=True)
class White:
    """White noise.

    Parameters
    ----------
    sigma
        Standard deviation in SI: one number for all observations, or by the observation's name a number or an array
        that broadcasts to samples by channels.
    """

    sigma: float | Mapping[str, float | Array]

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the residual over the standard deviation.

        Raises
        ------
        InputError
            If the noise of this observation is not given, or is not above zero.
        """
        sigma = self.sigma.get(observation.name) if isinstance(self.sigma, Mapping) else self.sigma
        if sigma is None or not np.all(np.asarray(sigma) > 0):
            remedy = "give the standard deviation of its noise, above zero"
            raise InputError("fit", f"noise.{observation.name}", sigma, remedy)
        return np.asarray(residual / np.asarray(sigma, dtype=float))


@dataclass(frozen=True)
class Scaled:
    """Noise so many times as large as other noise."""

    noise: Whitening
    factor: float

    def whiten(self, observation: Observation, residual: Array) -> Array:
        """Return the whitened residual."""
        return self.noise.whiten(observation, residual) / self.factor


#: Noise as `fit` takes it; None where it is unknown: white, alike in all observations, estimated from the residual.
Noise = None | float | Mapping[str, float | Array] | Whitening


@dataclass(frozen=True, eq=False)
class Colour:
    """The correlation between the samples of a stationary residual, as an autoregressive process.

    Parameters
    ----------
    coefficients
        1, a_1, ... a_k of e_t + a_1 e_(t-1) + ... = white; the 1 alone for a white residual.
    samples
        Length of the residual.
    """

    coefficients: Array
    samples: int

    @property
    def is_white(self) -> bool:
        """Tell whether no correlation was found."""
        return len(self.coefficients) == 1

    def spectrum(self) -> Array:
        """Return the power at the frequencies of a real transform of length `padded`, scaled to variance one."""
        power: Array = 1 / np.abs(np.fft.rfft(self.coefficients, self.padded)) ** 2
        return power / (self._weights() @ power / self.padded)

    @property
    def padded(self) -> int:
        """Length of transform at which lags up to the whole residual do not wrap around."""
        return int(next_fast_len(2 * self.samples, real=True))

    @property
    def inflation(self) -> float:
        """How many samples count as one: the sum of the squared autocorrelations over all lags (Bartlett 1946)."""
        return 1.0 if self.is_white else float(self._weights() @ self.spectrum() ** 2 / self.padded)

    def quadratic(self, columns: Array) -> Array:
        """Return columns' R columns, with the correlation matrix R of the residual; `columns` are samples by m."""
        if self.is_white:
            return columns.T @ columns
        transformed = np.fft.rfft(columns, self.padded, axis=0)
        weighted = (self._weights() * self.spectrum())[:, None] * transformed
        return np.asarray((transformed.conj().T @ weighted).real / self.padded)

    def _weights(self) -> Array:
        """Return how often each frequency of the real transform occurs in the full one."""
        weights = np.full(self.padded // 2 + 1, 2.0)
        weights[0] = 1.0
        if self.padded % 2 == 0:
            weights[-1] = 1.0
        return weights


def colour(residual: Array) -> Colour:
    """Return the colour of a residual (n), by Burg's recursion.

    The order is that of the smallest n log(variance) + k log(n) (Schwarz 1978), so that a white residual is found
    white; see Percival and Walden (1993), Spectral Analysis for Physical Applications, section 9.5, for the recursion.
    """
    n = len(residual)
    best = coefficients = np.ones(1)
    power = float(residual @ residual) / n if n else 0.0
    if n < SHORTEST or power == 0:
        return Colour(best, n)
    forward, backward = residual[1:], residual[:-1]
    lowest = n * np.log(power)
    for order in range(1, int(min(10 * np.log10(n), n / 5)) + 1):
        energy = float(forward @ forward + backward @ backward)
        if energy == 0:
            break
        reflection = -2 * float(forward @ backward) / energy
        longer = np.append(coefficients, 0.0)
        coefficients = longer + reflection * longer[::-1]
        power *= 1 - reflection**2
        if power <= 0:
            break
        score = n * np.log(power) + order * np.log(n)
        if score < lowest:
            lowest, best = score, coefficients
        forward, backward = (forward + reflection * backward)[1:], (backward + reflection * forward)[:-1]
    return Colour(best, n)

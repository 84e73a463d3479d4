"""The process behind quiet stretches of record, each with a trend of its own, by restricted maximum likelihood.

Trends take low frequencies out of short stretches, so that a residual is quieter than the noise was. The restricted
likelihood counts that (Patterson and Thompson 1971): it is the likelihood of what no trend can touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from flexdesign.evidence.coloured import Process

Array = NDArray[np.float64]
#: No process has a longer memory than this; a stretch holds its order so many times at least.
HIGHEST_ORDER, TIMES_ORDER = 16, 6
#: How near to one a reflection may come: the roots of an AR(1) then last ten thousand samples.
NEAREST = 1 - 1e-4
#: Weight of what keeps the process stationary: short stretches alone hardly tell slow noise from a random walk, whose
#: variance is infinite. One lowers the level of 3 s of AR(1) noise with 0.98 by a percent, of its error a tenth.
RESTING = 1.0
#: Rows of lagged samples that are multiplied at a time.
CHUNK = 20_000


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of record that should hold nothing but noise.

    Parameters
    ----------
    run
        Name of the run it comes from.
    first
        Its place in the run: the index of its first sample.
    values
        n samples, SI.
    trend
        What it may follow apart from noise: n by m, with orthonormal columns.
    """

    run: str
    first: int
    values: Array
    trend: Array

    @property
    def residual(self) -> Array:
        """The values, the trend taken out by ordinary least squares."""
        return np.asarray(self.values - self.trend @ (self.trend.T @ self.values))

    @property
    def freedom(self) -> int:
        """Number of samples less those that the trend takes."""
        return len(self.values) - self.trend.shape[1]


def estimate(stretches: Sequence[Stretch]) -> tuple[Process, float]:
    """Return the process whose restricted likelihood is largest, and the effective number of samples behind its rms.

    The order is that of the smallest Schwarz criterion by Burg's recursion, pooled over the stretches; its reflection
    coefficients are where the search begins. Of n effective samples, a standard deviation has the relative standard
    error 1 / sqrt(2 n); here this follows from the curvature of the likelihood.

    Parameters
    ----------
    stretches
        Their values, trends taken out, are not all zero.
    """
    reflections = burg([s.residual for s in stretches])
    if not len(reflections):
        return Process(np.zeros(0), _Likelihood(stretches, 0).sigma(np.zeros(0))), float(
            sum(s.freedom for s in stretches)
        )
    likelihood = _Likelihood(stretches, len(reflections))
    bound = np.arctanh(NEAREST)
    begin = np.arctanh(np.clip(reflections, -NEAREST, NEAREST))
    options = {"maxiter": 60}
    found: Any = minimize(likelihood, begin, method="L-BFGS-B", bounds=[(-bound, bound)] * len(begin), options=options)
    best = np.tanh(found.x)
    return Process(best, likelihood.sigma(best)), likelihood.effective(found.x)


def burg(residuals: Sequence[Array]) -> Array:
    """Return the reflection coefficients of the process behind some records, by Burg's recursion pooled over them.

    The order is that of the smallest n log(variance) + k log(n) (Schwarz 1978); an empty array for white noise.
    """
    n = sum(map(len, residuals))
    forward, backward = [r[1:] for r in residuals], [r[:-1] for r in residuals]
    power = sum(float(r @ r) for r in residuals) / n
    lowest, best = n * np.log(power), 0
    found: list[float] = []
    for order in range(1, min(HIGHEST_ORDER, min(map(len, residuals)) // TIMES_ORDER) + 1):
        pairs = list(zip(forward, backward, strict=True))
        energy = sum(float(f @ f + b @ b) for f, b in pairs)
        if energy <= 0:
            break
        reflection = -2 * sum(float(f @ b) for f, b in pairs) / energy
        power *= 1 - reflection**2
        if power <= 0:
            break
        found.append(reflection)
        if (score := n * np.log(power) + order * np.log(n)) < lowest:
            lowest, best = score, order
        forward = [(f + reflection * b)[1:] for f, b in pairs]
        backward = [(b + reflection * f)[:-1] for f, b in pairs]
    return np.array(found[:best])


class _Likelihood:
    """Minus twice the restricted log likelihood, from lagged products that are formed once.

    With the trends X, the whitening W of unit innovations and y the values, it is N log(RSS / N) + sum over stretches
    of log det(C) + log det(X' W' W X), where C is the covariance of a stretch and N the number of samples less trends.
    """

    def __init__(self, stretches: Sequence[Stretch], order: int) -> None:
        self.order, self.freedom = order, sum(s.freedom for s in stretches)
        tables = [np.column_stack([s.residual, s.trend]) for s in stretches]
        self.scale = float(np.sqrt(np.mean(np.concatenate([table[:, 0] for table in tables]) ** 2)))
        for table in tables:
            table[:, 0] /= self.scale
        self.width = max(table.shape[1] for table in tables)
        padded = [np.pad(table, ((0, 0), (0, self.width - table.shape[1]))) for table in tables]
        self.idle = np.stack([np.arange(self.width - 1) >= table.shape[1] - 1 for table in tables])
        self.beginnings = np.stack([table[:order] for table in padded])
        self.products = np.stack([self._lagged(table) for table in padded])

    def _lagged(self, table: Array) -> Array:
        """Return the products of a table with itself at all lags up to the order: (lags * lags) by (width * width)."""
        lags, n = self.order + 1, len(table)
        total = np.zeros((lags * self.width, lags * self.width))
        for first in range(self.order, n, CHUNK):
            last = min(first + CHUNK, n)
            block = np.hstack([table[first - k : last - k] for k in range(lags)])
            total += block.T @ block
        shaped = total.reshape(lags, self.width, lags, self.width).transpose(0, 2, 1, 3)
        return shaped.reshape(lags * lags, self.width * self.width)

    def _grams(self, reflections: Array) -> Array:
        process = Process(reflections, 1.0)
        weights = np.outer(process.coefficients, process.coefficients).ravel()
        grams = np.einsum("k,skp->sp", weights, self.products).reshape(-1, self.width, self.width)
        whitened = process.start @ self.beginnings
        return np.asarray(grams + whitened.transpose(0, 2, 1) @ whitened)

    def _parts(self, reflections: Array) -> tuple[float, float]:
        """Return the residual sum of squares and the log determinants."""
        grams = self._grams(reflections)
        inner, outer = grams[:, 1:, 1:].copy(), grams[:, 1:, 0]
        inner[:, np.arange(self.width - 1), np.arange(self.width - 1)] += self.idle  # columns that a stretch lacks
        solved = np.linalg.solve(inner, outer[..., None])[..., 0]
        squares = float(np.sum(grams[:, 0, 0] - np.sum(outer * solved, axis=1)))
        orders = np.arange(1, self.order + 1)
        spread = -len(grams) * float(orders @ np.log1p(-(reflections**2)))
        return squares, spread + float(np.linalg.slogdet(inner)[1].sum())

    def sigma(self, reflections: Array) -> float:
        """Return the innovation's standard deviation at which the likelihood is largest, SI."""
        return self.scale * float(np.sqrt(self._parts(reflections)[0] / self.freedom))

    def effective(self, at: Array) -> float:
        """Return the effective number of samples behind the process's rms, by the curvature at some coordinates."""
        step, count = 1e-3, len(at)
        moves = step * np.eye(count)

        def level(x: Array) -> float:
            reflections = np.tanh(x)
            return float(np.log(self.sigma(reflections))) - 0.5 * float(np.log1p(-(reflections**2)).sum())

        slope = np.array([level(at + move) - level(at - move) for move in moves]) / (2 * step)
        curvature = np.empty((count, count))
        for i in range(count):
            for j in range(i + 1):
                both, apart = moves[i] + moves[j], moves[i] - moves[j]
                corners = self(at + both) + self(at - both) - self(at + apart) - self(at - apart)
                curvature[i, j] = curvature[j, i] = corners / (4 * step**2)
        values, vectors = np.linalg.eigh(0.5 * curvature)
        certain = np.maximum(values, 1e-3 * max(float(values.max()), 1e-12))
        variance = float(np.sum((vectors.T @ slope) ** 2 / certain)) + 0.5 / self.freedom
        return 0.5 / variance

    def __call__(self, coordinates: Array) -> float:
        reflections = np.tanh(coordinates)
        squares, determinants = self._parts(reflections)
        drift = float(np.log1p(-(reflections**2)).sum())  # minus the log of the variance that past samples add
        return self.freedom * float(np.log(squares / self.freedom)) + determinants - RESTING * drift

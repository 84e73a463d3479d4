"""The process behind stretches of quiet record, each with a trend of its own, by restricted maximum likelihood (REML).

Trends take low frequencies out of short stretches, so that a residual is quieter than the noise was. The restricted
likelihood counts that (Patterson and Thompson 1971): it is the likelihood of what no trend can touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from scipy.optimize import minimize

from flexdesign.core.arrays import Array
from flexdesign.estimation.noise.autoregressive import Process, burg

#: Highest order of a noise process: sensors filter with a few poles, and each coefficient more slows every whitening.
HIGHEST_ORDER = 16
#: How near to one a reflection may come: an AR(1) then remembers ten thousand samples, the length of a usual record.
LARGEST_REFLECTION = 1 - 1e-4


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of record that should hold nothing but noise.

    Parameters
    ----------
    run, first
        Name of the run it comes from, and the index of its first sample there.
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
    def dof(self) -> int:
        """Number of samples less those that the trend takes."""
        return len(self.values) - self.trend.shape[1]

    def whitened(self, process: Process, columns: Array) -> Array:
        """Return columns (n by k) whitened, and the whitened trend taken out of them by least squares."""
        both = process.whiten(np.column_stack([self.trend, columns]))
        trend, rest = both[:, : self.trend.shape[1]], both[:, self.trend.shape[1] :]
        basis = np.linalg.qr(trend)[0]
        return np.asarray(rest - basis @ (basis.T @ rest))


def estimate(stretches: Sequence[Stretch]) -> tuple[Process, float]:
    """Return the process whose restricted likelihood is largest, and the effective number of samples behind its rms.

    Of n effective samples, a standard deviation has the relative standard error 1 / sqrt(2 n). Burg's recursion gives
    the order and where the search begins. All stretches have equally many trend columns; not all residuals are zero.
    """
    reflections = burg([s.residual for s in stretches], HIGHEST_ORDER)
    likelihood = _Likelihood(stretches, len(reflections))
    at = np.arctanh(np.clip(reflections, -LARGEST_REFLECTION, LARGEST_REFLECTION))
    if len(at):
        bound = np.arctanh(LARGEST_REFLECTION)
        found: Any = minimize(likelihood, at, method="L-BFGS-B", bounds=[(-bound, bound)] * len(at))
        at = found.x
    return likelihood.process(at), likelihood.effective(at)


class _Likelihood:
    """Minus twice the restricted log likelihood, from lagged products that are formed once.

    With the trends X, the whitening W of unit innovations and y the values, it is N log(RSS / N) + sum over stretches
    of log det(C) + log det(X' W' W X), where C is the covariance of a stretch and N the number of samples less trends.
    """

    def __init__(self, stretches: Sequence[Stretch], order: int) -> None:
        self.order, self.dof = order, sum(s.dof for s in stretches)
        residuals = [s.residual for s in stretches]
        self.scale = float(np.sqrt(np.mean(np.concatenate(residuals) ** 2)))
        tables = [np.column_stack([r / self.scale, s.trend]) for r, s in zip(residuals, stretches, strict=True)]
        self.beginnings = np.stack([table[:order] for table in tables])
        self.products = np.stack([self._lagged_products(table) for table in tables])

    def _lagged_products(self, table: Array) -> Array:
        """Return the products of a table (n by m) with itself at all pairs of lags: (order + 1)^2 by m * m."""
        shifted = [table[self.order - lag : len(table) - lag] for lag in range(self.order + 1)]
        return np.array([(one.T @ other).ravel() for one in shifted for other in shifted])

    def _parts(self, reflections: Array) -> tuple[float, float]:
        """Return the residual sum of squares and the log determinants."""
        process = Process(reflections, 1.0)
        weights = np.outer(process.coefficients, process.coefficients).ravel()
        whitened = process.start @ self.beginnings
        grams = whitened.transpose(0, 2, 1) @ whitened
        grams += np.einsum("k,skp->sp", weights, self.products).reshape(grams.shape)
        trends, mixed = grams[:, 1:, 1:], grams[:, 1:, 0]
        solution = np.linalg.solve(trends, mixed[..., None])[..., 0]
        squares = float(np.sum(grams[:, 0, 0] - np.sum(mixed * solution, axis=1)))
        log_variances = -len(grams) * float(np.arange(1, self.order + 1) @ np.log1p(-(reflections**2)))
        return squares, log_variances + float(np.linalg.slogdet(trends)[1].sum())

    def process(self, at: Array) -> Process:
        """Return the process at some coordinates, with the sigma at which the likelihood is largest."""
        reflections = np.tanh(at)
        return Process(reflections, self.scale * float(np.sqrt(self._parts(reflections)[0] / self.dof)))

    def effective(self, at: Array) -> float:
        """Return the effective number of samples behind the process's rms, by the curvature at the optimum."""
        step = 1e-3  # small compared with the standard error of a coordinate, 1 / sqrt(n)
        steps = step * np.eye(len(at))
        slope = np.array([np.log(self.process(at + m).rms / self.process(at - m).rms) for m in steps]) / (2 * step)
        curvature = np.empty((len(at), len(at)))
        for (i, a), (j, b) in combinations_with_replacement(enumerate(steps), 2):
            corners = self(at + a + b) + self(at - a - b) - self(at + a - b) - self(at - a + b)
            curvature[i, j] = curvature[j, i] = corners / (4 * step**2)
        values, vectors = np.linalg.eigh(0.5 * curvature)
        information = np.maximum(values, 1.0)  # no direction is less certain than one observation makes it
        variance = float(np.sum((vectors.T @ slope) ** 2 / information)) + 0.5 / self.dof
        return 0.5 / variance

    def __call__(self, at: Array) -> float:
        """Return it, plus Jeffreys' prior 1 / rms for a given sigma, at inverse hyperbolic tangents of reflections.

        The prior is needed: short stretches alone hardly distinguish slow noise from a random walk, whose rms is
        infinite.
        """
        reflections = np.tanh(at)
        squares, determinants = self._parts(reflections)
        prior = -float(np.log1p(-(reflections**2)).sum())  # log(rms^2 / sigma^2)
        return self.dof * float(np.log(squares / self.dof)) + determinants + prior

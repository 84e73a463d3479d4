"""Quiet stretches of record: the noise process behind them, and sinusoids in it, such as mains hum.

Each stretch has its own trend. Trends remove low frequencies from short stretches, so that the residual is smaller than
the noise. The restricted likelihood (REML) accounts for that (Patterson and Thompson 1971): it is the likelihood of the
data with the trends projected out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from scipy.fft import next_fast_len
from scipy.optimize import minimize, minimize_scalar
from scipy.special import chdtrc, gammainccinv, gammaincinv

from flexdesign.core.arrays import Array
from flexdesign.estimation.criterion import LEVEL, SHARE
from flexdesign.estimation.noise.autoregressive import Process, burg

#: Highest order of a noise process: sensors filter with a few poles, and each coefficient more slows every whitening.
HIGHEST_ORDER = 16
#: Fewest periods of a sinusoid in the longest stretch: slower ones are drift, which the trends remove in part.
FEWEST_PERIODS = 6


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of a run without motion, which contains noise only.

    Parameters
    ----------
    run, first
        Name of the run it comes from, and the index of its first sample there.
    values
        n samples, SI.
    trend
        Functions of the trend: n by m, with orthonormal columns.
    """

    run: str
    first: int
    values: Array
    trend: Array

    @property
    def residual(self) -> Array:
        """The values less the trend, by ordinary least squares."""
        return np.asarray(self.values - self.trend @ (self.trend.T @ self.values))

    @property
    def dof(self) -> int:
        """Number of samples less that of the functions of the trend."""
        return len(self.values) - self.trend.shape[1]

    def whitened(self, process: Process, columns: Array) -> Array:
        """Return columns (n by k) whitened, less the whitened trend by least squares."""
        both = process.whiten(np.column_stack([self.trend, columns]))
        trend, rest = both[:, : self.trend.shape[1]], both[:, self.trend.shape[1] :]
        basis = np.linalg.qr(trend)[0]
        return np.asarray(rest - basis @ (basis.T @ rest))


def estimate(stretches: Sequence[Stretch]) -> tuple[Process, float]:
    """Return the process whose restricted likelihood is largest, and the effective number of samples behind its rms.

    Of n effective samples, a standard deviation has the relative standard error 1 / sqrt(2 n). Burg's recursion gives
    the order and the starting point. All stretches have equally many trend columns; not all residuals are zero.
    """
    reflections = burg([s.residual for s in stretches], HIGHEST_ORDER)
    likelihood = _Likelihood(stretches, len(reflections))
    largest = 1 - 1 / likelihood.dof  # the correlation of an AR(1) then lasts as long as all stretches
    at = np.arctanh(np.clip(reflections, -largest, largest))
    if len(at):
        bound = np.arctanh(largest)
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
        self.first_rows = np.stack([table[:order] for table in tables])
        self.products = np.stack([self._lagged_products(table) for table in tables])

    def _lagged_products(self, table: Array) -> Array:
        """Return the products of a table (n by m) with itself at all pairs of lags: (order + 1)^2 by m * m."""
        shifted = [table[self.order - lag : len(table) - lag] for lag in range(self.order + 1)]
        return np.array([(one.T @ other).ravel() for one in shifted for other in shifted])

    def _parts(self, reflections: Array) -> tuple[float, float]:
        """Return the residual sum of squares and the log determinants."""
        process = Process(reflections, 1.0)
        weights = np.outer(process.coefficients, process.coefficients).ravel()
        whitened = process.start @ self.first_rows
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
        gradient = np.array([np.log(self.process(at + m).rms / self.process(at - m).rms) for m in steps]) / (2 * step)
        curvature = np.empty((len(at), len(at)))
        for (i, a), (j, b) in combinations_with_replacement(enumerate(steps), 2):
            corners = self(at + a + b) + self(at - a - b) - self(at + a - b) - self(at - a + b)
            curvature[i, j] = curvature[j, i] = corners / (4 * step**2)
        values, vectors = np.linalg.eigh(0.5 * curvature)
        information = np.maximum(values, 1.0)  # no direction is less certain than one observation makes it
        variance = float(np.sum((vectors.T @ gradient) ** 2 / information)) + 0.5 / self.dof
        return 0.5 / variance

    def __call__(self, at: Array) -> float:
        """Return the objective with Jeffreys' prior 1 / rms, at inverse hyperbolic tangents of the reflections.

        The prior is needed: short stretches alone hardly distinguish slow noise from a random walk, whose rms is
        infinite.
        """
        reflections = np.tanh(at)
        squares, determinants = self._parts(reflections)
        prior = -float(np.log1p(-(reflections**2)).sum())  # log(rms^2 / sigma^2)
        return self.dof * float(np.log(squares / self.dof)) + determinants + prior


# --- sinusoids -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Sinusoid:
    """A sinusoid: frequency [Hz] and amplitude [SI], the rms over the runs that contain it."""

    frequency: float
    amplitude: float


@dataclass(frozen=True, eq=False)
class _Fit:
    """A fitted sinusoid, the fall of the whitened sum of squares, and the stretches without it."""

    sinusoid: Sinusoid
    explained: float
    without: tuple[Stretch, ...]


def remove_sinusoids(stretches: Sequence[Stretch], period: float) -> tuple[tuple[Sinusoid, ...], tuple[Stretch, ...]]:
    """Find the sinusoids in quiet stretches, and return the stretches without them.

    A peak above the local median is fitted together with a noise process. It is a sinusoid if noise exceeds its
    likelihood ratio with a probability below `LEVEL`. The phase is constant within a run, and free between runs. All
    stretches have the same sampling period [s].
    """
    found, left = list[Sinusoid](), tuple(stretches)
    while True:
        tested = (_test_peak(left, peak, period) for peak in _peaks(left, period))
        fit = next((fit for fit in tested if fit is not None), None)
        if fit is None:
            break
        found.append(fit.sinusoid)
        left = fit.without
    return tuple(sorted(found, key=lambda each: each.frequency)), left


def _runs(stretches: Sequence[Stretch]) -> list[list[Stretch]]:
    return [[s for s in stretches if s.run == name] for name in dict.fromkeys(s.run for s in stretches)]


def _peaks(stretches: Sequence[Stretch], period: float) -> list[float]:
    """Return the frequencies of the highest peaks [Hz] of the sum of the periodograms of all runs.

    The sum over R runs of noise is distributed as Gamma(R); a level that noise is expected to exceed once is the limit.
    """
    from scipy.signal import find_peaks

    runs = _runs(stretches)
    begins = [min(s.first for s in run) for run in runs]
    spans = [max(s.first + len(s.values) for s in run) - begin for run, begin in zip(runs, begins, strict=True)]
    length = next_fast_len(4 * max(spans), real=True)
    power = np.zeros(length // 2 + 1)
    for run, begin, span in zip(runs, begins, spans, strict=True):
        record = np.zeros(span)
        for s in run:
            record[s.first - begin : s.first - begin + len(s.values)] = s.residual
        power += np.abs(np.fft.rfft(record, length)) ** 2 / sum(len(s.values) for s in run)
    resolution = length / max(len(s.values) for s in stretches)
    lowest = int(FEWEST_PERIODS * resolution)
    ratio = power / np.maximum(_local_median(power, 2 * lowest), np.finfo(float).tiny)
    median_ratio = gammainccinv(len(runs), 1 / len(power)) / gammaincinv(len(runs), 0.5)
    places = lowest + find_peaks(ratio[lowest:], height=median_ratio, distance=2 * resolution)[0]
    places = places[np.argsort(-ratio[places])]
    before, at, after = power[places - 1], power[places], power[places + 1]
    vertices = places + 0.5 * (before - after) / (before - 2 * at + after)  # of parabolas
    return [float(vertex) / (length * period) for vertex in vertices]


def _local_median(power: Array, width: int) -> Array:
    """Return the interpolated medians of blocks; the centre of the first is the lowest frequency of a peak."""
    width = min(width, len(power))
    blocks = power[: len(power) // width * width].reshape(-1, width)
    return np.interp(np.arange(len(power)), width * (np.arange(len(blocks)) + 0.5), np.median(blocks, axis=1))


def _test_peak(stretches: Sequence[Stretch], peak: float, period: float) -> _Fit | None:
    """Return the sinusoid at a peak [Hz]; None if noise, or the decay of a mode, explains the peak."""
    frequency = _refine(stretches, peak, period)
    without = _fit(stretches, frequency, period, Process.white(1.0)).without
    process = Process(burg([s.residual for s in without], HIGHEST_ORDER), 1.0)
    squares = sum(float(np.sum(s.whitened(process, s.residual) ** 2)) for s in without)
    if squares == 0:
        return None
    process = replace(process, sigma=float(np.sqrt(squares / sum(s.dof for s in without))))
    fit = _fit(stretches, frequency, period, process)
    dof = 2 * len(_runs(stretches))
    frequencies = max(s.first + len(s.values) for s in stretches) - min(s.first for s in stretches)
    is_noise = chdtrc(dof, fit.explained) * frequencies > LEVEL
    fades = _fit(fit.without, frequency, period, process, fading=True).explained
    # With noise that is not quite autoregressive, a strong sinusoid may seem to fade by a small share of its squares.
    dies_away = fades > SHARE * fit.explained and chdtrc(dof, fades) < LEVEL
    return None if is_noise or dies_away else fit


def _refine(stretches: Sequence[Stretch], peak: float, period: float) -> float:
    """Return the frequency of the sinusoid that explains most [Hz], within half a resolution of a peak.

    The peak alone is not precise: a strong sinusoid at its frequency would leave a beat, which would seem to fade.
    """
    resolution = 1 / (max(len(s.values) for s in stretches) * period)
    found = minimize_scalar(
        lambda shift: -_fit(stretches, peak + shift * resolution, period, Process.white(1.0)).explained,
        bounds=(-0.5, 0.5),
        method="bounded",
    )
    return float(peak + found.x * resolution)


def _fit(stretches: Sequence[Stretch], frequency: float, period: float, process: Process, fading: bool = False) -> _Fit:
    """Fit a sinusoid in each run by generalised least squares, together with the trends.

    The amplitude of a `fading` sinusoid grows from minus one to one within each stretch.
    """
    explained, without, squares = 0.0, list[Stretch](), list[float]()
    for run in _runs(stretches):
        waves = []
        for s in run:
            angle = 2 * np.pi * frequency * period * (s.first + np.arange(len(s.values)))
            size = np.linspace(-1, 1, len(angle)) if fading else 1.0
            waves.append(np.column_stack([size * np.cos(angle), size * np.sin(angle)]))
        tables = [np.column_stack([wave, s.residual]) for wave, s in zip(waves, run, strict=True)]
        whitened = np.concatenate([s.whitened(process, table) for s, table in zip(run, tables, strict=True)])
        weights = np.linalg.lstsq(whitened[:, :2], whitened[:, 2], rcond=None)[0]
        explained += float(np.sum((whitened[:, :2] @ weights) ** 2))
        squares.append(float(weights @ weights))
        without += [replace(s, values=s.values - wave @ weights) for s, wave in zip(run, waves, strict=True)]
    return _Fit(Sinusoid(frequency, float(np.sqrt(np.mean(squares)))), explained, tuple(without))

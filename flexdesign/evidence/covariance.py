"""How well the data determine the coordinates: covariance, degrees of freedom, and the directions that stay open.

The parameters minimise the sum of squared whitened residuals. Where the residual is white their covariance is the
classical one. Where it is coloured (by the noise, or because physics is missing) neighbouring samples say the same
thing twice, and the classical covariance is too small. Then the sandwich

    (J'J + P)^-1 (sum_i s_i^2 J_i' R_i J_i + P) (J'J + P)^-1

takes its place (Huber 1967; with correlated errors, Hansen 1982). J is the Jacobian without offsets, P the precision
of what was known. The correlation R_i of a record's channel is that of the autoregressive process found in its residual
(`noise.colour`), rather than a sum over lags: at the correlations seen here a lag window would need more samples than
there are. The variance s_i^2 counts the degrees of freedom that the fit takes from a coloured residual, and Student's
quantile those that are left after samples are counted as `Colour.inflation` says.

The colour found in a residual is too pale where few independent samples stand behind each parameter: for 100 samples of
correlation 0.9 from one to the next, intervals hold the truth in five of six replicas instead of 19 of 20; from 400
samples on in 91 to 97 of 100.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.evidence.noise import Colour, colour
from flexdesign.evidence.residuals import Residuals

Array = NDArray[np.float64]
#: A direction in which the scaled Jacobian is below this share of its largest is lost in the simulator's error.
RANK = 1e-4
#: A parameter takes part in a direction with more than this weight.
TAKES_PART = 0.03
#: Residuals larger than given noise explains are noticed at this level.
LEVEL = 0.01
#: Confidence of intervals.
CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Spread:
    """What the residual at the minimum says about the coordinates.

    Parameters
    ----------
    covariance
        Of the coordinates, without the open directions.
    bread
        (J'J + P)^-1: what the covariance would be if the residual were white of variance one.
    jacobian
        Of data and known parameters, open directions taken out.
    open
        Directions that neither data nor earlier knowledge determine, one a row: weights in coordinates scaled by
        their influence, unit length.
    quantile
        Student's, for intervals.
    dof
        Degrees of freedom left; infinite where the noise is given and explains the residual.
    variance
        Of the whitened residual.
    reduced
        The cost of the data over its degrees of freedom, whitened by the noise as given: the reduced chi^2.
    inflation
        How many samples count as one, for each record.
    taken
        Degrees of freedom that the fit takes from each record.
    """

    covariance: Array
    bread: Array
    jacobian: Array
    open: Array
    quantile: float
    dof: float
    variance: float
    reduced: float
    inflation: tuple[float, ...]
    taken: tuple[float, ...]

    @property
    def half(self) -> Array:
        """Half-widths of the intervals of the coordinates."""
        return self.quantile * np.sqrt(np.diag(self.covariance))

    def is_open(self, j: int) -> bool:
        """Tell whether coordinate `j` takes part in an open direction."""
        return bool(np.any(np.abs(self.open[:, j]) > TAKES_PART))

    def company(self, j: int) -> list[int]:
        """Return the coordinates that stand in for `j` in its open directions."""
        shared = np.abs(self.open.T @ self.open[:, j]) > TAKES_PART**2
        return [i for i in np.flatnonzero(shared).tolist() if i != j and self.is_open(i)]


@dataclass(frozen=True, eq=False)
class _Series:
    """One channel of one record."""

    record: int
    rows: slice
    colour: Colour
    energy: float
    samples: int


def spread(residuals: Residuals, x: Array, jacobian: Array, noise_is_known: bool) -> Spread:
    """Return what is known about the coordinates at the minimum `x`.

    Parameters
    ----------
    residuals, x
        The residuals and where they are smallest.
    jacobian
        Of the data's residual at `x`.
    noise_is_known
        Whether the noise was given; otherwise its variance is taken from the residual.
    """
    data = residuals.data(x)
    prior = residuals.before_jacobian(x)
    cleaned, bread, lost = _bread(jacobian, prior)
    series = _series(residuals, data)
    parts = [s.colour.quadratic(cleaned[s.rows]) for s in series]
    taken = [float(np.sum(bread * part)) + _offsets(residuals, s) for s, part in zip(series, parts, strict=True)]
    # A colour so red that the fit seems to take every sample leaves a tenth of them, so that variances stay finite.
    left = [max(s.samples - t, 0.1 * s.samples) for s, t in zip(series, taken, strict=True)]
    pooled = sum(s.energy for s in series) / sum(left)
    coloured = any(not s.colour.is_white for s in series)
    counted = sum(s.samples / s.colour.inflation for s in series)
    dof = max(counted - len(x) + len(lost) - residuals.offsets, 1.0)
    given = residuals.scale**-2 if noise_is_known else 0.0
    explained = not coloured and pooled * dof < given * _chi_square(dof)
    variances = [max(s.energy / rest, given) for s, rest in zip(series, left, strict=True)]
    if not coloured:
        variances = [given if explained else pooled] * len(series)
    meat = sum((v * part for v, part in zip(variances, parts, strict=True)), prior.T @ prior)
    return Spread(
        covariance=bread @ meat @ bread,
        bread=bread,
        jacobian=np.vstack([cleaned, prior]),
        open=lost,
        quantile=_student(math.inf if explained else dof),
        dof=math.inf if explained else dof,
        variance=given if explained else pooled,
        reduced=pooled * residuals.scale**2,
        inflation=tuple(_of_records(residuals, series, [s.colour.inflation for s in series], mean=True)),
        taken=tuple(_of_records(residuals, series, taken)),
    )


def _bread(jacobian: Array, prior: Array) -> tuple[Array, Array, Array]:
    """Return the Jacobian without directions lost in the simulator's error, (J'J + P)^-1, and what stays open.

    The columns are scaled to length one first, so that units do not matter.
    """
    length = np.linalg.norm(jacobian, axis=0)
    length[length == 0] = 1.0
    left, singular, right = np.linalg.svd(jacobian / length, full_matrices=False)
    singular = np.where(singular < RANK * max(singular[0], 1e-300), 0.0, singular)
    right = np.where(np.abs(right) < 1e-9, 0.0, right)
    stacked = np.vstack([singular[:, None] * right * length, prior])
    scale = np.linalg.norm(stacked, axis=0)
    scale[scale == 0] = 1.0
    _, strength, axes = np.linalg.svd(stacked / scale)
    strength = np.concatenate([strength, np.zeros(len(axes) - len(strength))])
    good = strength > 1e-9
    spreads = axes[good] / scale / strength[good, None]
    return (left * singular) @ right * length, spreads.T @ spreads, axes[~good]


def _series(residuals: Residuals, data: Array) -> list[_Series]:
    series = []
    for index, (record, part) in enumerate(zip(residuals.records, residuals.parts, strict=True)):
        n, channels = record.measured.shape
        for channel in range(channels):
            rows = slice(part.start + channel * n, part.start + (channel + 1) * n)
            energy = float(data[rows] @ data[rows])
            series.append(_Series(index, rows, colour(data[rows]), energy, int(record.present[:, channel].sum())))
    return series


def _offsets(residuals: Residuals, series: _Series) -> float:
    """Return the degrees of freedom that the offset takes from a residual of this colour."""
    record = residuals.records[series.record]
    first = series.rows.start - residuals.parts[series.record].start
    basis = record.offset[first : first + len(record.measured)]
    return float(np.trace(series.colour.quadratic(basis))) if basis.size else 0.0


def _of_records(
    residuals: Residuals, series: list[_Series], numbers: list[float], *, mean: bool = False
) -> list[float]:
    sums = []
    for index in range(len(residuals.records)):
        own = [number for s, number in zip(series, numbers, strict=True) if s.record == index]
        sums.append(sum(own) / (len(own) if mean else 1))
    return sums


def _student(dof: float) -> float:
    from scipy.special import ndtri, stdtrit

    return float(ndtri((1 + CONFIDENCE) / 2) if math.isinf(dof) else stdtrit(dof, (1 + CONFIDENCE) / 2))


def _chi_square(dof: float) -> float:
    """Return what chi^2 exceeds with the probability `LEVEL`."""
    from scipy.special import chdtri

    return float(chdtri(dof, LEVEL))

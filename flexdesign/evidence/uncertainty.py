"""How well the data determine the coordinates: covariance, degrees of freedom, and directions without information.

The parameters minimise the sum of squared whitened residuals. Where the residual is white their covariance is the
classical one. Where it is coloured (by the noise, or because physics is missing) neighbouring samples carry the same
information, and the classical covariance is too small. Then the sandwich

    (J'J + P)^-1 (sum_i s_i^2 J_i' R_i J_i + P) (J'J + P)^-1

takes its place (Huber 1967; with correlated errors, Hansen 1982). J is the Jacobian without nuisance columns, P the
precision of prior knowledge. The correlation R_i of a record's channel is that of the autoregressive process found in
its residual (`noise.colour`), rather than a sum over lags: at the correlations seen here a lag window would need more
samples than there are. The variance s_i^2 counts the degrees of freedom that the fit takes from a coloured residual,
and Student's quantile those that remain after samples are counted as `Colour.inflation` says.

The correlation estimated from a residual is too small where few independent samples stand behind each parameter: for
100 samples of correlation 0.9 from one to the next, intervals hold the truth in five of six replicas instead of 19 of
20; from 400 samples on in 91 to 97 of 100.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexdesign.evidence.autoregressive import Colour, colour
from flexdesign.evidence.marquardt import Solution

Array = NDArray[np.float64]
#: A direction in which the scaled Jacobian is below this share of its largest is lost in the simulator's error.
RANK = 1e-4
#: A parameter takes part in a direction with more than this weight.
TAKES_PART = 0.03
#: A residual larger than the given noise explains is noticed at this level.
LEVEL = 0.01
#: Confidence of intervals.
CONFIDENCE = 0.95


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What the residual at the minimum says about the coordinates.

    Parameters
    ----------
    covariance
        Of the coordinates, without the null space.
    bread
        (J'J + P)^-1: what the covariance would be if the residual were white of variance one.
    information
        J'J + P, the null space taken out.
    null_space
        Directions that neither data nor prior knowledge determine, one a row: weights in coordinates scaled by their
        influence, unit length.
    quantile
        Student's, for intervals.
    dof
        Degrees of freedom of the residual; infinite where the noise is given and explains the residual.
    variance
        Of the whitened residual.
    reduced_chi2
        The cost of the data over its degrees of freedom, in units of the given noise.
    inflation
        How many samples count as one, for each record.
    effective_dof
        Degrees of freedom that the fit takes from each record.
    """

    covariance: Array
    bread: Array
    information: Array
    null_space: Array
    quantile: float
    dof: float
    variance: float
    reduced_chi2: float
    inflation: tuple[float, ...]
    effective_dof: tuple[float, ...]

    @property
    def half_width(self) -> Array:
        """Half-widths of the intervals of the coordinates."""
        return self.quantile * np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the coordinates; rows without variance are zero off the diagonal."""
        sigma = np.sqrt(np.diag(self.covariance))
        sigma = np.where(sigma > 0, sigma, 1.0)
        matrix = self.covariance / np.outer(sigma, sigma)
        np.fill_diagonal(matrix, 1.0)
        return np.asarray(matrix)

    def in_null_space(self, j: int) -> bool:
        """Tell whether coordinate `j` takes part in the null space."""
        return bool(np.any(np.abs(self.null_space[:, j]) > TAKES_PART))

    def confounded_with(self, j: int) -> list[int]:
        """Return the coordinates that can replace `j` along its directions in the null space."""
        shared = np.abs(self.null_space.T @ self.null_space[:, j]) > TAKES_PART**2
        return [i for i in np.flatnonzero(shared).tolist() if i != j and self.in_null_space(i)]


@dataclass(frozen=True, eq=False)
class _Channel:
    """One channel of one record: its residual, and the sandwich's part of it."""

    record: int
    colour: Colour
    energy: float
    samples: int
    meat: Array
    taken: float

    @property
    def left(self) -> float:
        """Degrees of freedom of the residual.

        A colour so red that the fit seems to take every sample leaves a tenth of them, so that variances stay finite.
        """
        return max(self.samples - self.taken, 0.1 * self.samples)


def uncertainty(solution: Solution, known_variance: float | None = 1.0) -> Uncertainty:
    """Return what is known about the coordinates at a minimum.

    Parameters
    ----------
    solution
        The minimum, with its Jacobian.
    known_variance
        Of the whitened residual where the noise is given; None where it is unknown, and is taken from the residual.
    """
    where, records = solution.problem.where, solution.problem.suite.records
    prior = solution.problem.before_slopes(solution.x)
    data = np.zeros((len(solution.x), len(solution.x)))
    for part in solution.slopes:
        data[np.ix_(part.places, part.places)] += part.matrix.T @ part.matrix
    cleaning, root, bread, null = _decomposed(data, prior)
    channels = _channels(solution, cleaning, bread)
    given = known_variance or 0.0
    pooled = sum(c.energy for c in channels) / sum(c.left for c in channels)
    is_coloured = any(not c.colour.is_white for c in channels)
    nuisance = sum(float(np.sum(record.basis[: len(record.measured)] ** 2)) for record in records)
    fitted = float(np.sum(bread * (cleaning.T @ data @ cleaning))) + nuisance
    dof = max(sum(c.samples / c.colour.inflation for c in channels) - fitted, 1.0)
    is_explained = not is_coloured and pooled * dof < given * _chi2(dof)
    # What is known of nuisance columns and of parameters counts with the variance that it states.
    meat = prior.T @ prior + sum((_nuisance_prior(solution, cleaning)), np.zeros_like(data))
    for c in channels:
        common = given if is_explained else pooled
        meat = meat + (max(c.energy / c.left, given) if is_coloured else common) * c.meat
    own = [[c for c in channels if c.record == r] for r in range(len(records))]
    return Uncertainty(
        covariance=bread @ meat @ bread,
        bread=bread,
        information=root.T @ root,
        null_space=null if len(null) else np.zeros((0, len(where.names))),
        quantile=_student(math.inf if is_explained else dof),
        dof=math.inf if is_explained else dof,
        variance=given if is_explained else pooled,
        reduced_chi2=pooled / (given or 1.0),
        inflation=tuple(float(np.mean([c.colour.inflation for c in each])) for each in own),
        effective_dof=tuple(sum(c.taken for c in each) for each in own),
    )


def _decomposed(data: Array, prior: Array) -> tuple[Array, Array, Array, Array]:
    """Return what takes lost directions out of a Jacobian, a root of J'J + P, its inverse, and the null space.

    Parameters
    ----------
    data
        J'J of the data, whose columns are scaled to length one first, so that units do not matter.
    prior
        Rows of prior knowledge.
    """
    length = np.sqrt(np.diag(data))
    length = np.where(length > 0, length, 1.0)
    strength, axes = np.linalg.eigh(data / np.outer(length, length))
    seen = strength > RANK**2 * max(strength[-1], 1e-300) if len(strength) else strength > 0
    strength, axes = strength[seen], np.where(np.abs(axes) < 1e-9, 0.0, axes)[:, seen]
    cleaning = (axes / length[:, None]) @ (axes * length[:, None]).T
    root = np.vstack([np.sqrt(strength)[:, None] * (axes * length[:, None]).T, prior])
    scale = np.linalg.norm(root, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    _, singular, right = np.linalg.svd(root / scale)
    singular = np.concatenate([singular, np.zeros(len(right) - len(singular))])
    good = singular > 1e-9
    spreads = right[good] / scale / singular[good, None]
    return cleaning, root, spreads.T @ spreads, right[~good]


def _channels(solution: Solution, cleaning: Array, bread: Array) -> list[_Channel]:
    made = []
    parts = zip(solution.problem.suite.records, solution.residuals, solution.slopes, strict=True)
    for index, (record, residual, slopes) in enumerate(parts):
        columns = slopes.matrix @ cleaning[slopes.places]
        present = record.present.reshape(record.channels, -1)
        for rows, there in zip(record.series(), present, strict=True):
            found = colour(residual[rows])
            meat = found.quadratic(columns[rows])
            offsets = float(np.trace(found.quadratic(record.basis[rows]))) if record.basis.size else 0.0
            energy = float(residual[rows] @ residual[rows])
            taken = float(np.sum(bread * meat)) + offsets
            made.append(_Channel(index, found, energy, int(there.sum()), meat, taken))
    return made


def _nuisance_prior(solution: Solution, cleaning: Array) -> list[Array]:
    """Return what the rows add that state how large nuisance columns may be."""
    made = []
    for record, slopes in zip(solution.problem.suite.records, solution.slopes, strict=True):
        rows = slopes.matrix[len(record.measured) :] @ cleaning[slopes.places]
        made.append(rows.T @ rows)
    return made


def _student(dof: float) -> float:
    from scipy.special import ndtri, stdtrit

    return float(ndtri((1 + CONFIDENCE) / 2) if math.isinf(dof) else stdtrit(dof, (1 + CONFIDENCE) / 2))


def _chi2(dof: float) -> float:
    """Return what chi^2 exceeds with the probability `LEVEL`."""
    from scipy.special import chdtri

    return float(chdtri(dof, LEVEL))

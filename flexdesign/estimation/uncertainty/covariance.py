"""How well the data determine the coordinates: covariance, degrees of freedom, and directions without information.

The parameters minimise the sum of squared whitened residuals. Where the residual is white their covariance is the
classical one. Where it is coloured (by the noise, or because physics is missing) neighbouring samples carry the same
information, and the classical covariance is too small. Then the sandwich

    (J'J + P)^-1 (sum_i s_i^2 J_i' R_i J_i + P) (J'J + P)^-1

takes its place (Huber 1967; with correlated errors, Hansen 1982). J is the Jacobian without nuisance columns, P the
precision of prior knowledge. The correlation R_i of a record is that of the autoregressive process found in its
residual (`noise.autoregressive`), rather than a sum over lags: at the correlations seen here a lag window would need
more samples than there are. The variance s_i^2 counts the degrees of freedom that the fit takes from a coloured
residual, and Student's quantile those that remain after samples are counted as `Autocorrelation.inflation` says.

The correlation estimated from a residual is too small where few independent samples stand behind each parameter: for
100 samples of correlation 0.9 from one to the next, intervals hold the truth in five of six replicas instead of 19 of
20; from 400 samples on in 91 to 97 of 100.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.estimation.least_squares.levenberg_marquardt import Solution, add_normal
from flexdesign.estimation.noise.autoregressive import estimate_autocorrelation

#: Confidence of intervals; a residual is larger than the given noise explains at this level. Both by convention.
CONFIDENCE, MISFIT_LEVEL = 0.95, 0.01
#: A singular value of the scaled Jacobian below this share of the largest counts as zero: the simulator's error of
#: 1e-7 over the relative change of 1e-3 by which central differences move the response.
RANK_TOLERANCE = 1e-4
#: A parameter takes part in a null direction with more than this weight: far above `RANK_TOLERANCE`, the error of a
#: direction.
NULL_WEIGHT = 0.03


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What the residual at the minimum says about the coordinates.

    Parameters
    ----------
    covariance
        Of the coordinates, without the null space.
    inverse_hessian
        (J'J + P)^-1: what the covariance would be if the residual were white of variance one.
    null_space
        Directions that neither data nor prior knowledge determine, one a row: weights in coordinates scaled by their
        influence, unit length.
    quantile
        For intervals: Student's, or the normal one where the noise is given and explains the residual.
    variance
        Of the whitened residual.
    inflation
        How many samples count as one, for each record.
    """

    covariance: Array
    inverse_hessian: Array
    null_space: Array
    quantile: float
    variance: float
    inflation: tuple[float, ...]

    @property
    def half_width(self) -> Array:
        """Half-widths of the intervals of the coordinates."""
        return self.quantile * self._deviations

    @property
    def correlation(self) -> Array:
        """Correlation matrix of the coordinates; rows without variance are zero off the diagonal."""
        sigma = np.where(self._deviations > 0, self._deviations, 1.0)
        matrix = self.covariance / np.outer(sigma, sigma)
        np.fill_diagonal(matrix, 1.0)
        return np.asarray(matrix)

    @property
    def _deviations(self) -> Array:
        """Standard deviations of the coordinates; infinite where the variance is lost in rounding."""
        variance = np.diag(self.covariance)
        return np.where(variance >= 0, np.sqrt(np.maximum(variance, 0.0)), np.inf)

    def in_null_space(self, j: int) -> bool:
        """Tell whether coordinate `j` takes part in the null space."""
        return bool(np.any(np.abs(self.null_space[:, j]) > NULL_WEIGHT))

    def confounded_with(self, j: int) -> list[int]:
        """Return the coordinates that can replace `j` along its directions in the null space."""
        shared = np.abs(self.null_space.T @ self.null_space[:, j]) > NULL_WEIGHT**2
        return [i for i in np.flatnonzero(shared).tolist() if i != j and self.in_null_space(i)]


def uncertainty(solution: Solution, known_variance: float | None = 1.0) -> Uncertainty:
    """Return what is known about the coordinates at a minimum.

    Parameters
    ----------
    solution
        The minimum, with its Jacobian.
    known_variance
        Of the whitened residual where the noise is given; None where it is unknown, and is taken from the residual.
    """
    from scipy.special import chdtri, ndtri, stdtrit

    records, given = solution.problem.dataset.records, known_variance or 0.0
    prior = solution.problem.prior_jacobian(solution.x)
    data = add_normal(np.zeros((len(solution.x), len(solution.x))), solution.jacobian)
    projection, inverse_hessian, null_space = _decompose(data, prior)
    jacobians = [part.matrix @ projection[part.places] for part in solution.jacobian]
    counts = [len(record.measured) for record in records]
    residuals = [whole[:count] for whole, count in zip(solution.residuals, counts, strict=True)]
    colours = [estimate_autocorrelation(residual) for residual in residuals]
    scores = [c.quadratic(j[:count]) for c, j, count in zip(colours, jacobians, counts, strict=True)]
    taken = [  # degrees of freedom that the fit takes from a record, with its nuisance columns
        float(np.sum(inverse_hessian * score)) + float(np.trace(c.quadratic(record.basis[:count])))
        for c, score, record, count in zip(colours, scores, records, counts, strict=True)
    ]
    inflation = np.array([colour.inflation for colour in colours])
    samples = np.array([int(record.present.sum()) for record in records])
    chi2 = np.array([float(residual @ residual) for residual in residuals])
    # A slowly varying residual seems to be fitted altogether; a tenth of the samples keeps variances finite.
    left = np.maximum(samples - taken, 0.1 * samples)
    pooled = float(chi2.sum() / left.sum())
    parameters = float(np.sum(inverse_hessian * (projection.T @ data @ projection)))
    parameters += solution.problem.dataset.nuisance_dof
    dof = max(float(np.sum(samples / inflation)) - parameters, 1.0)
    is_white = all(colour.is_white for colour in colours)
    is_explained = is_white and pooled * dof < given * float(chdtri(dof, MISFIT_LEVEL))
    variance = given if is_explained else pooled
    variances = np.full(len(records), variance) if is_white else np.maximum(chi2 / left, given)
    # What is known of nuisance columns and of parameters counts with the variance that it states.
    known = np.vstack([prior, *(j[count:] for j, count in zip(jacobians, counts, strict=True))])
    score_covariance = known.T @ known + sum(v * score for v, score in zip(variances, scores, strict=True))
    upper = (1 + CONFIDENCE) / 2
    return Uncertainty(
        covariance=inverse_hessian @ score_covariance @ inverse_hessian,
        inverse_hessian=inverse_hessian,
        null_space=null_space,
        quantile=float(ndtri(upper) if is_explained else stdtrit(dof, upper)),
        variance=variance,
        inflation=tuple(inflation.tolist()),
    )


def _decompose(data: Array, prior: Array) -> tuple[Array, Array, Array]:
    """Return the projection that takes null directions out of a Jacobian, (J'J + P)^-1, and the null space.

    The columns of J are scaled to length one, so that units do not matter; `prior` are rows of prior knowledge.
    """
    length = np.sqrt(np.diag(data))
    length = np.where(length > 0, length, 1.0)
    strength, axes = np.linalg.eigh(data / np.outer(length, length))
    seen = strength > RANK_TOLERANCE**2 * strength.max(initial=1e-300)
    strength, axes = strength[seen], np.where(np.abs(axes) < 1e-9, 0.0, axes)[:, seen]
    projection = (axes / length[:, None]) @ (axes * length[:, None]).T
    root = np.vstack([np.sqrt(strength)[:, None] * (axes * length[:, None]).T, prior])
    scale = np.linalg.norm(root, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    _, singular, right = np.linalg.svd(root / scale)
    singular = np.concatenate([singular, np.zeros(len(right) - len(singular))])
    good = singular > 1e-9
    inverse = right[good] / scale / singular[good, None]
    return projection, inverse.T @ inverse, right[~good]

"""How well the data determine the coordinates: covariance, directions without information, and profile likelihood.

The parameters minimise the sum of squared whitened residuals. If the residual is white, their covariance is the
classical one. If it is coloured (by the noise, or because physics is missing), neighbouring samples carry the same
information, and the classical covariance is too small. Then the sandwich

    (J'J + P)^-1 (sum_i s_i^2 J_i' R_i J_i + P) (J'J + P)^-1

takes its place (Huber 1967; with correlated errors, Hansen 1982). J is the Jacobian without nuisance columns, P the
precision of prior knowledge. The correlation R_i of a record is that of the autoregressive process found in its
residual (`noise.autoregressive`), rather than a sum over lags: at the correlations seen here a lag window would need
more samples than there are. The variance s_i^2 counts the degrees of freedom that the fit takes from a coloured
residual, and Student's quantile those that remain after samples are counted as `Process.inflation` says.

The correlation estimated from a residual is too small where few independent samples stand behind each parameter: for
100 samples of correlation 0.9 from one to the next, intervals hold the truth in five of six replicas instead of 19 of
20; from 400 samples on in 91 to 97 of 100.

The covariance supposes that the cost is a parabola. To check it, a parameter is displaced to the end of its interval
and the others are fitted again; the cost must then have risen by the square of the quantile (Venzon and Moolgavkar
1988; Raue et al. 2009, Bioinformatics 25, 1923-1929). Where the residual is coloured that rise is scaled by the ratio
of the sandwich variance to the bread (Rotnitzky and Jewell 1990). Elsewhere the end is a root of the profile, which is
bracketed and found by Brent's method.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.estimation.criterion import CONFIDENCE, HALF_WIDTH, LEVEL
from flexdesign.estimation.least_squares.dataset import DIFFERENCE_STEP, SIMULATION_ROUNDING
from flexdesign.estimation.least_squares.levenberg_marquardt import INEXACT, ROUGH, Columns, Solution, add_normal, solve
from flexdesign.estimation.noise.autoregressive import process_of

#: Relative accuracy of the ends of intervals: a user sees no twentieth of one.
ACCURACY = 0.05
#: A parameter takes part in a null direction with more than this weight: halfway, on a scale of logarithms, from
#: `DIFFERENCE_STEP`, the error of a direction, to one.
NULL_WEIGHT = math.sqrt(DIFFERENCE_STEP)


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Covariance of the coordinates at a minimum, and the quantities that intervals need.

    Parameters
    ----------
    covariance
        Covariance of the coordinates, without the null space.
    inverse_hessian
        (J'J + P)^-1: the covariance for a white residual of variance one.
    null_space
        Directions that neither data nor priors determine, one a row: weights in coordinates scaled by their influence,
        of unit length.
    quantile
        Quantile for intervals: Student's, or the normal one if the noise is given and explains the residual.
    variance
        Variance of the whitened residual.
    inflation
        Number of samples that count as one, for each record.
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
    """Return the covariance of the coordinates at a minimum.

    A singular value of the scaled Jacobian below `DIFFERENCE_STEP`, its relative error, counts as zero.

    Parameters
    ----------
    solution
        The minimum, with its Jacobian.
    known_variance
        Variance of the whitened residual if the noise is given; None if it is unknown and follows from the residual.
    """
    from scipy.special import chdtri, stdtrit

    records, given = solution.problem.dataset.records, known_variance or 0.0
    prior = solution.problem.prior_jacobian(solution.x)
    data = add_normal(np.zeros((len(solution.x), len(solution.x))), solution.jacobian)
    projection, inverse_hessian, null_space = _decompose(data, prior)
    jacobians = [part.matrix @ projection[part.places] for part in solution.jacobian]
    counts = [len(record.measured) for record in records]
    residuals = [whole[:count] for whole, count in zip(solution.residuals, counts, strict=True)]
    processes = [process_of(residual) for residual in residuals]
    scores = [p.quadratic(j[:count]) for p, j, count in zip(processes, jacobians, counts, strict=True)]
    fitted_dof = [  # degrees of freedom that the fit takes from a record, with its nuisance columns
        float(np.sum(inverse_hessian * score)) + float(np.trace(p.quadratic(record.basis[:count])))
        for p, score, record, count in zip(processes, scores, records, counts, strict=True)
    ]
    inflation = np.array([process.inflation(count) for process, count in zip(processes, counts, strict=True)])
    samples = np.array([int(record.present.sum()) for record in records])
    chi2 = np.array([float(residual @ residual) for residual in residuals])
    # For a slowly varying residual all degrees of freedom may seem fitted; a tenth of them keeps variances finite.
    residual_dof = np.maximum(samples - fitted_dof, 0.1 * samples)
    pooled = float(chi2.sum() / residual_dof.sum())
    parameters = float(np.sum(inverse_hessian * (projection.T @ data @ projection)))
    parameters += solution.problem.dataset.nuisance_dof
    dof = max(float(np.sum(samples / inflation)) - parameters, 1.0)
    is_white = not any(process.order for process in processes)
    is_explained = is_white and pooled * dof < given * float(chdtri(dof, LEVEL))
    variance = given if is_explained else pooled
    variances = np.full(len(records), variance) if is_white else np.maximum(chi2 / residual_dof, given)
    # Priors of nuisance columns and of parameters count with their own variance.
    known = np.vstack([prior, *(j[count:] for j, count in zip(jacobians, counts, strict=True))])
    score_covariance = known.T @ known + sum(v * score for v, score in zip(variances, scores, strict=True))
    return Uncertainty(
        covariance=inverse_hessian @ score_covariance @ inverse_hessian,
        inverse_hessian=inverse_hessian,
        null_space=null_space,
        quantile=HALF_WIDTH if is_explained else float(stdtrit(dof, (1 + CONFIDENCE) / 2)),
        variance=variance,
        inflation=tuple(inflation.tolist()),
    )


def _decompose(data: Array, prior: Array) -> tuple[Array, Array, Array]:
    """Return the projection that removes null directions from a Jacobian, (J'J + P)^-1, and the null space.

    The columns of J are scaled to length one, so that units do not matter; `prior` are rows of prior knowledge.
    """
    length = np.sqrt(np.diag(data))
    length = np.where(length > 0, length, 1.0)
    strength, axes = np.linalg.eigh(data / np.outer(length, length))
    is_determined = strength > SIMULATION_ROUNDING * strength.max(initial=1e-300)
    strength, axes = strength[is_determined], np.where(np.abs(axes) < 1e-9, 0.0, axes)[:, is_determined]
    projection = (axes / length[:, None]) @ (axes * length[:, None]).T
    root = np.vstack([np.sqrt(strength)[:, None] * (axes * length[:, None]).T, prior])
    scale = np.linalg.norm(root, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    _, singular, right = np.linalg.svd(root / scale)
    singular = np.concatenate([singular, np.zeros(len(right) - len(singular))])
    has_rank = singular > 1e-9
    inverse = right[has_rank] / scale / singular[has_rank, None]
    return projection, inverse.T @ inverse, right[~has_rank]


# --- profile likelihood ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Profile:
    """The interval of one coordinate after its ends were checked.

    Parameters
    ----------
    low, high
        The ends; a bound of the coordinate where the interval is open on that side.
    open_low, open_high
        Whether the cost rises too little all the way to the bound.
    corrected
        Whether an end differs from that of the covariance.
    better
        A point that fits better than the supposed minimum, if one was met.
    """

    low: float
    high: float
    open_low: bool
    open_high: bool
    corrected: bool
    better: Array | None = None


@lru_cache(maxsize=16)  # the strength of an effect is asked for before all numbers are
def profile(solution: Solution, uncertainty: Uncertainty, j: int) -> Profile:
    """Return the interval of coordinate `j`, each end checked by fitting the others again."""
    path = _Path(solution, uncertainty, j)
    low, open_low, corrected_low = path.end(-1.0)
    high, open_high, corrected_high = path.end(1.0)
    return Profile(low, high, open_low, open_high, corrected_low or corrected_high, path.better)


class _Path:
    """The profile of one coordinate: the best fit of the others at each of its values."""

    def __init__(self, solution: Solution, uncertainty: Uncertainty, j: int) -> None:
        self.minimum, self.problem, self.j = solution, solution.problem, j
        self.others = np.array([i for i in range(len(solution.x)) if i != j], dtype=int)
        where, variance = self.problem.where, uncertainty.inverse_hessian[j, j]
        if uncertainty.in_null_space(j):  # no influence near the minimum: the whole range is searched
            self.tangent = np.eye(len(solution.x))[j]
            self.half = math.inf if math.isfinite(where.span[j]) else float(where.sizes(solution.x)[j])
            self.expected = uncertainty.quantile**2 * uncertainty.variance
        else:
            # Parameters of single runs are held: the response is not smooth in initial states.
            shared = [parameter.run in ("", where.parameters[j].run) for parameter in where.parameters]
            self.tangent = np.where(shared, uncertainty.inverse_hessian[:, j] / variance, 0.0)
            self.half = float(uncertainty.half_width[j])
            self.expected = float(self.half**2 / variance)
        self.floor = self.problem.dataset.floor
        self.columns: Columns = {k: parts for k, parts in solution.columns().items() if k != where.names[j]}
        self.better: Array | None = None

    def end(self, side: float) -> tuple[float, bool, bool]:
        """Return the end of the interval on one side, whether it is open, and whether the covariance erred."""
        from scipy.optimize import brentq

        x, where = float(self.minimum.x[self.j]), self.problem.where
        bound = float((where.lower if side < 0 else where.upper)[self.j])
        room = abs(bound - x)
        if room == 0 or self.expected <= self.floor:  # costs would differ by rounding only
            return x + side * min(self.half, room), self.half >= room, False
        # By distance from the minimum: the derivatives of all coordinates. By the logarithm of distance: half the
        # logarithm of the relative rise, which is a straight line if the cost is a power of the distance.
        derivatives, columns = {0.0: side * self.tangent}, {0.0: self.columns}

        @cache
        def excess(at: float) -> float:
            distance = math.exp(at)
            if x + side * distance == x:  # without displacement no rise
                return math.log(SIMULATION_ROUNDING) / 2
            nearest = max(d for d in derivatives if d < distance)
            guess = derivatives[nearest] * distance
            increase, displacement, columns[distance] = self.cost_increase(side * distance, guess, columns[nearest])
            derivatives[distance] = displacement / distance
            rise = math.log(np.clip(increase / self.expected, SIMULATION_ROUNDING, 1 / SIMULATION_ROUNDING)) / 2
            # From a better point the fit is repeated, so that the search may end there.
            return 0.0 if abs(rise) <= ACCURACY or self.better is not None else rise

        first = min(self.half, where.span[self.j] / 8, room)
        if first == self.half and abs(excess(math.log(first))) <= ACCURACY:
            return x + side * first, False, False
        bracket = _bracket(excess, math.log(first), math.log(room))
        if bracket is None:
            return bound, True, self.half < room
        root = brentq(excess, *bracket, xtol=ACCURACY, maxiter=8, disp=False)
        return x + side * math.exp(float(root)), False, True

    def cost_increase(self, displacement: float, guess: Array, columns: Columns) -> tuple[float, Array, Columns]:
        """Return the rise of the profile above the minimum, the displacement of all coordinates, and the Jacobian.

        The other coordinates take steps with a Jacobian from nearer to the minimum; each step costs one simulation. The
        cost at their end can only be too high. If it is, they are fitted with a new Jacobian, which is also used
        farther out, but not nearer to the minimum.
        """
        where, small = self.problem.where, ACCURACY * self.expected + self.floor
        x = np.clip(self.minimum.x + guess, where.lower, where.upper)
        x[self.j] = np.clip(self.minimum.x[self.j] + displacement, where.lower[self.j], where.upper[self.j])
        others = self.problem.fixed(self.j, float(x[self.j]), x)
        found = solve(others, x[self.others], replace(INEXACT, jacobians=0), columns, small=small)
        if found is None:
            return math.inf, x - self.minimum.x, columns
        if self._above_minimum(x, found) > (1 + ACCURACY) ** 2 * self.expected and self.others.size:
            found = solve(others, found.x, replace(ROUGH, share=0.0), found.columns(), small=small) or found
            columns = found.columns()
        increase = self._above_minimum(x, found)
        if -increase > small:
            self.better = x
        return increase, x - self.minimum.x, columns

    def _above_minimum(self, x: Array, found: Solution) -> float:
        """Set the other coordinates to their fitted values, and return the cost there less that of the minimum."""
        x[self.others] = found.x
        return self.problem.cost(x, list(found.residuals)) - self.minimum.cost


def _bracket(excess: Callable[[float], float], first: float, last: float) -> tuple[float, float] | None:
    """Return logarithms of distances that bracket the end of an interval; None if it is beyond the last.

    Steps outwards are factors of two, so that the other coordinates can follow a valley that bends. Steps inwards, from
    a covariance that is far too wide, are factors of eight.
    """
    inside = outside = first
    if excess(first) < 0:
        doubled = [first + k * math.log(2) for k in range(1, 7)]
        for outside in [*(d for d in doubled if d < last), *([last] if math.isfinite(last) else [])]:
            if excess(outside) >= 0:
                return inside, outside
            inside = outside
        return None
    while excess(inside) > 0:
        inside, outside = inside - math.log(8), inside
    return inside, outside

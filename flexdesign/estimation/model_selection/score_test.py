"""Score of every effect that might explain a residual, without fitting any of them.

An effect at a trial strength moves the prediction by d (whitened). What the free parameters of the model can imitate is
projected out, d' = d - J (J'J)^-1 J'd. chi^2 promises to fall by (d'e)^2 / d'd', with the residual e: the score
statistic of Rao (1948) with a secant in the place of the derivative, so that effects with a threshold, whose derivative
is zero at the null, are found as well. Hidden constants are tried on a grid. A sinusoid has two such columns in each
run, as its phase is another in each.

The critical value of the largest score follows from the correlations between all d': without any effect the scaled
scores are Gaussian with these correlations, so that the largest of them can be drawn (a bootstrap over the catalogue).
Errors that are no Gaussian noise, as those of rounding, are drawn themselves.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import minimize_scalar
from scipy.special import chdtrc, chdtri

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Model, Observation
from flexdesign.estimation.least_squares.levenberg_marquardt import Solution

#: The free parameters imitate an effect if less than this fraction of its squares is independent of them.
INDEPENDENT_SHARE = 1e-8
#: A move smaller than this, in shares of the data, is rounding.
NEGLIGIBLE_MOVE = 1e-12
#: A promise counts only if the strength that it needs is no more than this many times that of the catalogue.
LARGEST_EXTRAPOLATION = 300.0
#: Trial strengths change the prediction by at most this number of standard deviations of the noise, rms: what the free
#: parameters imitate is projected out to first order.
LARGEST_MOVE = 3.0
#: Strengths of a limit or a delay that are tried between those of its grid.
STRENGTHS_TRIED = 10
#: Draws of chance, and the share of them whose largest score is the critical value that is continued to rarer ones.
NULL_DRAWS, SIMULATED_LEVEL = 4000, 0.01


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect that might be missing.

    Parameters
    ----------
    name
        Its name.
    add
        Returns a model with the effect in it.
    strength
        Name of the number that is its strength.
    free
        Names of all its numbers that a fit may move.
    trials
        Values of its numbers at which it is tried; the strength is among them.
    phase
        Name of the number that is the phase of a sinusoid, another in each run; empty if there is none.
    signed
        Whether the strength may be of either sign.
    has_own_trials
        Whether the strength is tried at values of its own, as a limit or a delay is: derivatives at its null mislead.
    like
        Names of effects that it may be taken for.
    after
        Name of the effect that must already be in the model: one that a model has several times; empty if there is
        none.
    trace
        Returns the columns by which the effect shows in an observation whatever the rest of the model does, such as a
        line at its frequency, n by k [response]; None for an observation that cannot show them. None if all that the
        effect does to a prediction speaks for it.
    """

    name: str
    add: Callable[[Model], Model]
    strength: str
    free: tuple[str, ...]
    trials: tuple[Mapping[str, float], ...]
    phase: str = ""
    signed: bool = False
    has_own_trials: bool = False
    like: tuple[str, ...] = ()
    after: str = ""
    trace: Callable[[Model, Observation], Array | None] | None = None

    @property
    def hidden(self) -> tuple[str, ...]:
        """Names of the constants that do nothing at null strength and are tried at several positive values."""
        tried = {name: {values[name] for values in self.trials} for name in self.free if name != self.strength}
        return tuple(name for name, values in tried.items() if len(values) > 1 and min(values) > 0)


@dataclass(frozen=True, eq=False)
class Direction:
    """What one trial does to the whitened prediction.

    Parameters
    ----------
    candidate, values
        The trial; its numbers, SI.
    move
        The move of the prediction, whitened, record after record.
    projection
        J' times the move.
    projected_norm2, predicted_gain
        d'd' and d'e.
    columns
        How many columns stand behind it: two in each run for a sinusoid.
    scale
        The trial's strength over that of the catalogue.
    """

    candidate: Candidate
    values: Mapping[str, float]
    move: Array
    projection: Array
    projected_norm2: float
    predicted_gain: float
    columns: int = 1
    scale: float = 1.0

    @property
    def best_step(self) -> float:
        """How many times the trial's strength the residual asks for."""
        return self.predicted_gain / self.projected_norm2

    def can_have(self, step: float) -> bool:
        """Tell whether a multiple of the trial's strength has a possible sign and is not far from the catalogue's."""
        return (step > 0 or self.candidate.signed) and abs(step) * self.scale <= LARGEST_EXTRAPOLATION

    @property
    def reduction_as_it_is(self) -> float:
        """By how much the cost would fall at the trial's own strength."""
        return 2.0 * self.predicted_gain - self.projected_norm2

    @property
    def start(self) -> dict[str, float]:
        """Values from which a fit may begin."""
        if self.candidate.has_own_trials:
            return dict(self.values)
        return {**self.values, self.candidate.strength: self.values[self.candidate.strength] * self.best_step}

    @property
    def predicted_reduction(self) -> float:
        """By how much the cost would fall, as if one column did it; zero where the strength cannot be had."""
        if not self.can_have(self.best_step):
            return 0.0
        more = chdtri(self.columns, SIMULATED_LEVEL) - chdtri(1, SIMULATED_LEVEL)
        return max(self.predicted_gain * self.best_step - float(more), 0.0)


def score_of_columns(solution: Solution, columns: Sequence[Array | None]) -> float:
    """Return the score of columns, each with an amount of its own in each record: by how much chi^2 would fall.

    Parameters
    ----------
    solution
        The fit.
    columns
        For each record n by k [response]; None for one without any.
    """
    dataset, projections, grams, gradients = solution.problem.dataset, list[Array](), list[Array](), list[Array]()
    for record, part, jacobian, residual in zip(
        dataset.records, columns, solution.jacobian, solution.residuals, strict=True
    ):
        if part is None:
            continue
        whitened = dataset.whitened_columns(record, part)
        projection = np.zeros((len(solution.x), whitened.shape[1]))
        projection[jacobian.places] = jacobian.matrix.T @ whitened
        projections.append(projection)
        grams.append(whitened.T @ whitened)
        gradients.append(whitened.T @ residual)
    if not grams:
        return 0.0
    shared, gradient = np.hstack(projections), np.concatenate(gradients)
    own = block_diag(*grams) - shared.T @ solution.covariance @ shared
    return float(gradient @ np.linalg.pinv(own, rcond=INDEPENDENT_SHARE, hermitian=True) @ gradient)


class Screening:
    """The directions of all candidates at a solution.

    Parameters
    ----------
    solution
        The fit.
    candidates
        Effects that might be missing.
    coarse
        Makes a model that predicts less exactly and faster.
    """

    def __init__(
        self,
        solution: Solution,
        candidates: Sequence[Candidate],
        coarse: Callable[[Model], Model] = lambda model: model,
    ) -> None:
        self.solution, self.coarse = solution, coarse
        problem = solution.problem
        self.model = coarse(problem.at(solution.x))
        self.inverse = solution.covariance
        self.ends = np.cumsum([record.rows for record in problem.dataset.records])[:-1]
        self.residual = np.concatenate(solution.residuals)
        self.here = [np.asarray(self.model.predict(record.observation)) for record in problem.dataset.records]
        trials = [(candidate, values) for candidate in candidates for values in candidate.trials]
        found = problem.each(lambda trial: self._try(*trial), trials)
        self.directions = [direction for direction in found if direction is not None]

    def _try(self, candidate: Candidate, values: Mapping[str, float]) -> Direction | None:
        """Return the direction of a trial; None where it cannot be simulated, or the free parameters imitate it."""
        try:
            with np.errstate(all="ignore"):
                model = self.coarse(candidate.add(self.model))
                if candidate.phase:
                    return self._sinusoid(candidate, model, values)
                move = self._move(model, values)
                if move is None or candidate.has_own_trials:
                    return None if move is None else self._direction(candidate, values, move)
                scale = min(LARGEST_MOVE / max(float(np.sqrt(np.mean(move**2))), 1e-300), 1.0)
                if scale < 1:
                    values = {**values, candidate.strength: values[candidate.strength] * scale}
                    move = self._move(model, values)
                found = None if move is None else self._direction(candidate, values, move)
                return None if found is None else replace(found, scale=scale)
        except (ArithmeticError, InputError):
            return None

    def _move(self, model: Model, values: Mapping[str, float]) -> Array | None:
        """Return by how much an effect moves the prediction, whitened, record after record; None where not finite."""
        dataset, there = self.solution.problem.dataset, model.replace(values)
        parts = list[Array]()
        for record, before in zip(dataset.records, self.here, strict=True):
            change = np.asarray(there.predict(record.observation)) - before
            if not np.isfinite(change).all():
                return None
            parts.append(dataset.whitened(record, change))
        return np.concatenate(parts)

    def _direction(self, candidate: Candidate, values: Mapping[str, float], move: Array) -> Direction | None:
        """Return a direction; None where the model can imitate it."""
        projection = self.solution.project(np.split(move, self.ends))
        whole = float(move @ move)
        projected_norm2 = whole - float(projection @ self.inverse @ projection)
        if (
            whole <= (NEGLIGIBLE_MOVE * self.solution.problem.dataset.size) ** 2
            or projected_norm2 < INDEPENDENT_SHARE * whole
        ):
            return None
        return Direction(candidate, values, move, projection, projected_norm2, float(move @ self.residual))

    def _sinusoid(self, candidate: Candidate, model: Model, values: Mapping[str, float]) -> Direction | None:
        """Return the direction of a sinusoid with the best phase in each run."""
        names, columns = self.solution.problem.dataset.names, []
        for phase in (0.0, math.pi / 2):
            move = self._move(model, {**values, **{f"{n}:{candidate.phase}": phase for n in names}})
            if move is None:
                return None
            for begin, end in zip((0, *self.ends), (*self.ends, len(move)), strict=True):
                column = np.zeros(len(move))
                column[begin:end] = move[begin:end]
                columns.append(column)
        matrix = np.column_stack(columns)
        projection = self.solution.project(np.split(matrix, self.ends))
        gram = matrix.T @ matrix - projection.T @ self.inverse @ projection
        amounts = np.linalg.pinv(gram, rcond=1e-8, hermitian=True) @ (matrix.T @ self.residual)
        sines, cosines = amounts[: len(names)], amounts[len(names) :]
        size = float(np.sqrt(np.mean(sines**2 + cosines**2)))
        if size == 0:
            return None
        phases = {f"{n}:{candidate.phase}": math.atan2(c, s) for n, s, c in zip(names, sines, cosines, strict=True)}
        found = self._direction(candidate, {**values, **phases}, matrix @ (amounts / size))
        return None if found is None else replace(found, columns=len(amounts))

    def cosines(self, directions: Sequence[Direction]) -> Array:
        """Return the cosines between directions, after projection on the free parameters."""
        if not directions:
            return np.zeros((0, 0))
        changes = np.array([direction.move for direction in directions])
        projection = np.array([direction.projection for direction in directions])
        inner = changes @ changes.T - projection @ self.inverse @ projection.T
        length = np.sqrt(np.array([direction.projected_norm2 for direction in directions]))
        return np.asarray(inner / np.outer(length, length))

    def critical_value(self, level: float, errors: Iterable[Mapping[str, Array]] = (), seed: int = 0) -> float:
        """Return what the largest score exceeds with a probability if nothing is missing.

        The quantile of a few thousand draws is continued to rarer ones as chi^2 of one degree of freedom falls off.

        Parameters
        ----------
        level
            Family-wise probability.
        errors
            Draws of what readings may be off by, by the name of the observation [response], if that is not Gaussian.
        seed
            Of Gaussian draws.
        """
        plain = [direction for direction in self.directions if direction.columns == 1]
        if not plain:
            return float(chdtri(1, level))
        null_errors = np.array([self._scaled(plain, error) for error in errors])
        if not len(null_errors):
            cosines, rng = self.cosines(plain), np.random.default_rng(seed)
            null_errors = rng.multivariate_normal(np.zeros(len(plain)), cosines, NULL_DRAWS, "ignore", method="eigh")
        signed = np.array([direction.candidate.signed for direction in plain])
        largest = np.where(signed, np.abs(null_errors), np.maximum(null_errors, 0.0)).max(axis=1)
        single = float(np.quantile(largest**2, 1 - SIMULATED_LEVEL))
        comparisons = SIMULATED_LEVEL / float(
            chdtrc(1, single)
        )  # this number of independent ones would be exceeded as often
        return float(chdtri(1, level / max(comparisons, 1.0)))

    def _scaled(self, directions: Sequence[Direction], error: Mapping[str, Array]) -> Array:
        """Return d'e over the length of d' for readings that are off by an error."""
        dataset = self.solution.problem.dataset
        parts = [dataset.whitened(record, error[record.observation.name]) for record in dataset.records]
        whole, projection = np.concatenate(parts), self.inverse @ self.solution.project(parts)
        return np.array(
            [(d.move @ whole - d.projection @ projection) / math.sqrt(d.projected_norm2) for d in directions]
        )

    def at_best_strength(self, direction: Direction) -> Direction:
        """Return the direction of a limit or a delay at the strength that explains most as it is.

        It is searched between the neighbouring trials (Brent 1973): beyond a threshold a limit changes nearly nothing,
        and a little before it too much.
        """
        candidate, name = direction.candidate, direction.candidate.strength
        tried = sorted({values[name] for values in candidate.trials})
        place = tried.index(direction.values[name])
        ends = tried[max(place - 1, 0)], tried[min(place + 1, len(tried) - 1)]
        found = [direction]

        def rise(logarithm: float) -> float:
            made = self._try(candidate, {**direction.values, name: math.exp(logarithm)})
            found.extend([] if made is None else [made])
            return 0.0 if made is None else -made.reduction_as_it_is

        minimize_scalar(rise, bounds=np.log(ends), method="bounded", options={"maxiter": STRENGTHS_TRIED})
        return max(found, key=lambda each: each.reduction_as_it_is)

    def best(self) -> list[list[Direction]]:
        """Return for each candidate its directions, best first; the candidate that promises most first."""
        by_name: dict[str, list[Direction]] = {}
        for direction in sorted(self.directions, key=lambda direction: -direction.predicted_reduction):
            if direction.predicted_reduction > 0:
                by_name.setdefault(direction.candidate.name, []).append(direction)
        return list(by_name.values())

    def pairs(self, most: int = 5) -> list[tuple[float, Direction, Direction]]:
        """Return pairs of candidates with what they promise together, best first."""
        cosines = self.cosines(self.directions)
        made = []
        for i, j in itertools.combinations(range(len(self.directions)), 2):
            a, b, cosine = self.directions[i], self.directions[j], float(cosines[i, j])
            if a.candidate.name == b.candidate.name or 1 - cosine**2 < INDEPENDENT_SHARE:
                continue
            p, q = a.predicted_gain / math.sqrt(a.projected_norm2), b.predicted_gain / math.sqrt(b.projected_norm2)
            of_a, of_b = (p - cosine * q) / (1 - cosine**2), (q - cosine * p) / (1 - cosine**2)
            if a.can_have(of_a / math.sqrt(a.projected_norm2)) and b.can_have(of_b / math.sqrt(b.projected_norm2)):
                made.append((of_a * p + of_b * q, a, b))
        best = dict[frozenset[str], tuple[float, Direction, Direction]]()
        for pair in sorted(made, key=lambda pair: -pair[0]):
            best.setdefault(frozenset((pair[1].candidate.name, pair[2].candidate.name)), pair)
        return list(best.values())[:most]

"""Score of every effect that might explain a residual, without fitting any of them.

An effect at a trial strength moves the prediction by d (whitened). What the free parameters of the model can imitate is
projected out, d' = d - J (J'J)^-1 J'd. With the residual e after their own step, which is zero at the minimum, the
predicted reduction of chi^2 is (d'e)^2 / d'd'. It is the score statistic of Rao (1948) with a secant in place of the
derivative, so that effects with a threshold, whose derivative is zero at the null, are found as well. Nonlinear
parameters are tried on a grid. A sinusoid has two columns in each run, because its phase differs from run to run.

The critical value of the largest score follows from the correlations between all d'. Without any effect the scaled
scores are Gaussian with these correlations, so that the largest score can be simulated (a parametric bootstrap over the
catalogue).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtri

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Model, Observation, parameter_of
from flexdesign.estimation.criterion import LARGE, LEVEL, significant_deviation
from flexdesign.estimation.least_squares.dataset import SIMULATION_ROUNDING
from flexdesign.estimation.least_squares.levenberg_marquardt import Solution


@dataclass(frozen=True, eq=False)
class Candidate:
    """An effect that might be missing.

    Parameters
    ----------
    name
        Name of the effect.
    add
        Returns a model with the effect in it.
    strength
        Name of its strength: the parameter with a null.
    free
        Names of all its free parameters, the strength among them.
    trials
        Trial values of its parameters, the strength among them.
    phase
        Name of the parameter that is the phase of a sinusoid and differs from run to run; empty if there is none.
    signed
        Whether the strength may have either sign.
    has_own_trials
        Whether the strength has trial values of its own, as a limit or a delay has: derivatives at its null mislead.
    after
        For an effect that a model may have several times: the name of the one that must be in the model before; else
        empty.
    trace
        Returns the columns that must be significant by themselves, such as a line at the frequency of a sinusoid, n by
        k [response]; None for an observation that cannot show them. None for effects without such columns.
    """

    name: str
    add: Callable[[Model], Model]
    strength: str
    free: tuple[str, ...]
    trials: tuple[Mapping[str, float], ...]
    phase: str = ""
    signed: bool = False
    has_own_trials: bool = False
    after: str = ""
    trace: Callable[[Model, Observation], Array | None] | None = None

    @property
    def hidden(self) -> tuple[str, ...]:
        """Names of the nonlinear parameters, which have no influence at null strength and have several trial values."""
        tried = {name: {values[name] for values in self.trials} for name in self.free if name != self.strength}
        return tuple(name for name, values in tried.items() if len(values) > 1 and min(values) > 0)


@dataclass(frozen=True, eq=False)
class Direction:
    """The change of the whitened prediction by one trial.

    Parameters
    ----------
    candidate, values
        The effect, and its trial values, SI.
    move
        The change d of the prediction, whitened, record after record.
    projection
        J'd.
    projected_norm2, predicted_gain
        d'd' and d'e, see the module.
    columns
        Number of columns that were fitted: two in each run for a sinusoid, else one.
    plausible
        Plausible range of the strength, SI; unlimited if it has trials of its own.
    """

    candidate: Candidate
    values: Mapping[str, float]
    move: Array
    projection: Array
    projected_norm2: float
    predicted_gain: float
    columns: int = 1
    plausible: tuple[float, float] = (-math.inf, math.inf)

    @property
    def best_step(self) -> float:
        """Multiple of the trial strength that minimises chi^2."""
        return self.predicted_gain / self.projected_norm2

    def is_possible(self, step: float) -> bool:
        """Tell whether a multiple of the trial strength has a possible sign and is plausible, or not far beyond."""
        estimate = step * self.values[self.candidate.strength] / LARGE  # the score is a linear estimate
        is_plausible = self.plausible[0] <= estimate <= self.plausible[1]
        return is_plausible and (step > 0 or self.candidate.signed)

    @property
    def start(self) -> dict[str, float]:
        """Starting values of a fit."""
        if self.candidate.has_own_trials:
            return dict(self.values)
        return {**self.values, self.candidate.strength: self.values[self.candidate.strength] * self.best_step}

    @property
    def predicted_reduction(self) -> float:
        """Predicted fall of the cost, less the chance of additional columns; zero for an impossible strength."""
        if not self.is_possible(self.best_step):
            return 0.0
        more = chdtri(self.columns, LEVEL) - chdtri(1, LEVEL)
        return max(self.predicted_gain * self.best_step - float(more), 0.0)


def score_of_columns(solution: Solution, columns: Sequence[Array | None]) -> float:
    """Return the score of columns, each with its own coefficient in each record: the predicted fall of chi^2.

    Parameters
    ----------
    solution
        The fit.
    columns
        For each record n by k [response]; None for a record without columns.
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
    shared = np.hstack(projections)
    gradient = np.concatenate(gradients) + shared.T @ solution.newton_step
    own = block_diag(*grams) - shared.T @ solution.covariance @ shared
    return float(gradient @ np.linalg.pinv(own, rcond=SIMULATION_ROUNDING, hermitian=True) @ gradient)


class Screening:
    """The directions of all candidates at a solution.

    Parameters
    ----------
    solution
        The fit.
    candidates
        Effects that might be missing.
    coarse
        Returns a model that predicts less exactly and faster.
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
        self.predicted = [np.asarray(self.model.predict(record.observation)) for record in problem.dataset.records]
        trials = [(candidate, values) for candidate in candidates for values in candidate.trials]
        directions = problem.each(lambda trial: self._try(*trial), trials)
        self.directions = [direction for direction in directions if direction is not None]

    def _try(self, candidate: Candidate, values: Mapping[str, float]) -> Direction | None:
        """Return the direction of a trial; None where it cannot be simulated, or the free parameters imitate it."""
        try:
            with np.errstate(all="ignore"):
                model = self.coarse(candidate.add(self.model))
                direction = self._direction_of(candidate, model, values)
                if direction is None or candidate.has_own_trials:
                    return direction
                return replace(direction, plausible=parameter_of(model, candidate.strength).plausible)
        except (ArithmeticError, InputError):
            return None

    def _direction_of(self, candidate: Candidate, model: Model, values: Mapping[str, float]) -> Direction | None:
        """Return the direction of a trial in a model with the effect."""
        if candidate.phase:
            return self._sinusoid(candidate, model, values)
        move = self._move(model, values)
        if move is None or candidate.has_own_trials:
            return None if move is None else self._direction(candidate, values, move)
        # As small as the noise: what the free parameters imitate is projected out to first order.
        scale = min(significant_deviation() / max(float(np.sqrt(np.mean(move**2))), 1e-300), 1.0)
        if scale < 1:
            values = {**values, candidate.strength: values[candidate.strength] * scale}
            move = self._move(model, values)
        return None if move is None else self._direction(candidate, values, move)

    def _move(self, model: Model, values: Mapping[str, float]) -> Array | None:
        """Return the change of the prediction by an effect, whitened, record after record; None where not finite."""
        dataset, with_effect = self.solution.problem.dataset, model.replace(values)
        parts = list[Array]()
        for record, before in zip(dataset.records, self.predicted, strict=True):
            change = np.asarray(with_effect.predict(record.observation)) - before
            if not np.isfinite(change).all():
                return None
            parts.append(dataset.whitened(record, change))
        return np.concatenate(parts)

    def _direction(self, candidate: Candidate, values: Mapping[str, float], move: Array) -> Direction | None:
        """Return a direction; None where the model can imitate it."""
        projection = self.solution.project(np.split(move, self.ends))
        norm2 = float(move @ move)
        projected_norm2 = norm2 - float(projection @ self.inverse @ projection)
        # The square of the relative error of the Jacobian is the rounding of the simulator.
        if norm2 <= self.solution.problem.dataset.floor or projected_norm2 < SIMULATION_ROUNDING * norm2:
            return None
        predicted_gain = float(self.solution.predicted_gain(move, projection))
        return Direction(candidate, values, move, projection, projected_norm2, predicted_gain)

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
        inverse = np.linalg.pinv(gram, rcond=SIMULATION_ROUNDING, hermitian=True)
        amounts = inverse @ self.solution.predicted_gain(matrix, projection)
        sines, cosines = amounts[: len(names)], amounts[len(names) :]
        size = float(np.sqrt(np.mean(sines**2 + cosines**2)))
        if size == 0:
            return None
        phases = {f"{n}:{candidate.phase}": math.atan2(c, s) for n, s, c in zip(names, sines, cosines, strict=True)}
        direction = self._direction(candidate, {**values, **phases}, matrix @ (amounts / size))
        return None if direction is None else replace(direction, columns=len(amounts))

    def cosines(self, directions: Sequence[Direction]) -> Array:
        """Return the cosines between directions, after projection on the free parameters."""
        if not directions:
            return np.zeros((0, 0))
        changes = np.array([direction.move for direction in directions])
        projection = np.array([direction.projection for direction in directions])
        inner = changes @ changes.T - projection @ self.inverse @ projection.T
        length = np.sqrt(np.array([direction.projected_norm2 for direction in directions]))
        return np.asarray(inner / np.outer(length, length))

    def critical_value(self, level: float, seed: int = 0) -> float:
        """Return the value that the largest score exceeds with a probability `level` if nothing is missing.

        It is a quantile of simulations, the number of which is such that ten exceed it.

        Parameters
        ----------
        level
            Family-wise probability.
        seed
            Seed of the simulations.
        """
        plain = [direction for direction in self.directions if direction.columns == 1]
        if not plain:
            return float(chdtri(1, level))
        cosines, rng = self.cosines(plain), np.random.default_rng(seed)
        draws = rng.multivariate_normal(np.zeros(len(plain)), cosines, round(10 / level), "ignore", method="eigh")
        signed = np.array([direction.candidate.signed for direction in plain])
        largest = np.where(signed, np.abs(draws), np.maximum(draws, 0.0)).max(axis=1)
        return float(np.quantile(largest**2, 1 - level))

    def best(self) -> list[list[Direction]]:
        """Return for each candidate its directions, best first; the candidate with the largest score first."""
        by_name: dict[str, list[Direction]] = {}
        for direction in sorted(self.directions, key=lambda direction: -direction.predicted_reduction):
            if direction.predicted_reduction > 0:
                by_name.setdefault(direction.candidate.name, []).append(direction)
        return list(by_name.values())

    def pairs(self, most: int = 5) -> list[tuple[float, Direction, Direction]]:
        """Return pairs of candidates with their joint score, best first."""
        cosines = self.cosines(self.directions)
        pairs = []
        for i, j in itertools.combinations(range(len(self.directions)), 2):
            a, b, cosine = self.directions[i], self.directions[j], float(cosines[i, j])
            if a.candidate.name == b.candidate.name or 1 - cosine**2 < SIMULATION_ROUNDING:
                continue
            p, q = a.predicted_gain / math.sqrt(a.projected_norm2), b.predicted_gain / math.sqrt(b.projected_norm2)
            of_a, of_b = (p - cosine * q) / (1 - cosine**2), (q - cosine * p) / (1 - cosine**2)
            if a.is_possible(of_a / math.sqrt(a.projected_norm2)) and b.is_possible(
                of_b / math.sqrt(b.projected_norm2)
            ):
                pairs.append((of_a * p + of_b * q, a, b))
        best = dict[frozenset[str], tuple[float, Direction, Direction]]()
        for pair in sorted(pairs, key=lambda pair: -pair[0]):
            best.setdefault(frozenset((pair[1].candidate.name, pair[2].candidate.name)), pair)
        return list(best.values())[:most]

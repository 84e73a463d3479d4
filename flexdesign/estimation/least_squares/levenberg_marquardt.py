"""Least squares for a data set: Marquardt's method on normal equations that are filled record by record.

Marquardt (1963), SIAM J. Appl. Math. 11, 431-441, with the damping of each coordinate in proportion to its own
curvature; bounds are kept by holding what would leave them. A Jacobian costs many residuals, so that it is updated
from step to step (Broyden 1965, Math. Comp. 19, 577-593) as long as it predicts what happens.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from flexdesign.core.arrays import Array, Flags
from flexdesign.estimation.criterion import LARGE
from flexdesign.estimation.least_squares.residual_function import JacobianBlock, Problem

#: A step with a predicted reduction of chi^2 below this, times the discrepancy, is the last: it changes no parameter by
#: a third of its standard deviation.
SMALL_REDUCTION = 0.1
#: An updated Jacobian serves while the gain ratio, actual by predicted reduction, is at least this, and for this
#: number of steps; it shows convergence if the gain ratio of the last step was within `LARGE`.
LEAST_GAIN_RATIO, MOST_UPDATES = 0.1, 12
#: Damping: its first value, and its factors after a good and a bad step.
DAMPING, DAMPING_DECREASE, DAMPING_INCREASE = 1e-3, 0.2, 8.0
#: The search ends if the Jacobian was computed this number of times at one point without a better step.
MOST_FAILURES = 2


@dataclass(frozen=True)
class Effort:
    """When a fit ends.

    Parameters
    ----------
    jacobians
        Largest number of times that the Jacobian is computed; with zero, the fit uses the given one until the cost
        stops falling.
    share
        A step with a predicted reduction below this share of chi^2 is the last, too.
    is_exact
        Whether the Jacobian is computed once more at the end.
    holds_initial_states
        Whether the initial states of runs are held until the other parameters have converged.
    """

    jacobians: int = 20
    share: float = 0.0
    is_exact: bool = True
    holds_initial_states: bool = False


#: A fit to convergence; and one from which no covariance follows.
FULL, INEXACT = Effort(), Effort(is_exact=False)
#: A rough fit that ranks candidates.
ROUGH = Effort(3, 1e-3, is_exact=False)


@dataclass(frozen=True, eq=False)
class Solution:
    """The point at which a search ended.

    Parameters
    ----------
    problem
        The problem.
    x
        Coordinates of the point.
    cost
        Sum of squares at the point.
    residuals, jacobian
        Of each record; the Jacobian may be that of a point one short step away.
    normal
        J'J with the prior, coordinates by coordinates.
    """

    problem: Problem
    x: Array
    cost: float
    residuals: tuple[Array, ...]
    jacobian: tuple[JacobianBlock, ...]
    normal: Array

    @property
    def covariance(self) -> Array:
        """Covariance of the coordinates, for the stated noise."""
        return _inverse(self.normal)

    @property
    def misfit(self) -> float:
        """Sum of squares of the residuals, without the priors of the parameters."""
        return sum(float(part @ part) for part in self.residuals)

    def columns(self) -> dict[str, list[Array | None]]:
        """Return the Jacobian by the name of the parameter: a column for each record, or None if it does not act."""
        columns: dict[str, list[Array | None]] = {}
        for j, name in enumerate(self.problem.where.names):
            places = [np.flatnonzero(part.places == j) for part in self.jacobian]
            columns[name] = [
                part.matrix[:, place[0]] if len(place) else None
                for part, place in zip(self.jacobian, places, strict=True)
            ]
        return columns

    @cached_property
    def residual(self) -> Array:
        """The residuals, record after record."""
        return np.concatenate(self.residuals)

    @cached_property
    def newton_step(self) -> Array:
        """The step to the minimum of the linearised problem within the bounds; zero where the search has converged."""
        gradient = _gradient(self.problem, self.x, self.jacobian, self.residuals)
        return _step(self.normal, gradient, 0.0, self.x, self.problem, np.zeros(len(self.x), dtype=bool))

    def predicted_gain(self, columns: Array, projection: Array) -> Array:
        """Return d'e of a direction, or of several as columns, after the step of the free parameters.

        `projection` is J'd, see `project`.
        """
        return np.asarray(columns.T @ self.residual + projection.T @ self.newton_step)

    def project(self, parts: Sequence[Array]) -> Array:
        """Return J'v for a vector v, or for k vectors as columns, in parts, one for each record."""
        total = np.zeros((len(self.x), *parts[0].shape[1:]))
        for jacobian, part in zip(self.jacobian, parts, strict=True):
            total[jacobian.places] += jacobian.matrix.T @ part
        return total


Columns = Mapping[str, Sequence[Array | None]]


def solve(
    problem: Problem, start: Array, effort: Effort = FULL, old: Columns | None = None, *, small: float | None = None
) -> Solution | None:
    """Return the minimum near a point; None where the model fails there.

    Parameters
    ----------
    problem
        Residuals and their Jacobian.
    start
        Coordinates; moved into the bounds.
    effort
        When the search ends.
    old
        Columns of the Jacobian of a fit nearby, see `Problem.jacobian`; the search begins with them.
    small
        A step with a predicted reduction below this is the last; by default `SMALL_REDUCTION` times the discrepancy,
        see `Dataset.discrepancy`, or the share of chi^2 that the effort states.
    """
    x = np.clip(start, problem.where.lower, problem.where.upper)
    if (residuals := problem.residuals(x)) is None:
        return None
    search = _Search(problem, x, residuals, old, small)
    if effort.holds_initial_states:
        search.hold_initial_states()
    if not effort.jacobians:
        search.fresh = True  # a step that fails is made shorter
        search.descend(effort.share)
    for left in reversed(range(effort.jacobians)):
        # An updated Jacobian may predict too small a reduction: if the fit must be exact, a new one decides.
        if search.descend(effort.share) and (search.fresh or not effort.is_exact):
            break
        if search.jacobians_here == MOST_FAILURES or not (left or effort.is_exact):
            break
        search.update_jacobian()
    return search.solution()


def linearise(problem: Problem, x: Array) -> Solution | None:
    """Return the solution at a given point, with the Jacobian there; None where the model fails."""
    residuals = problem.residuals(x)
    return None if residuals is None else _Search(problem, x, residuals, None, None).solution()


def refine_minimum(solution: Solution, small: float) -> Solution:
    """Return the solution after further steps with its Jacobian, until the predicted reduction is below `small`."""
    search = _Search(solution.problem, solution.x, list(solution.residuals), solution.columns(), small)
    search.fresh = True
    search.descend(0.0)
    return search.solution()


class _Search:
    """State of a search: a point, its residuals, and a Jacobian that was computed there or updated."""

    def __init__(
        self, problem: Problem, x: Array, residuals: list[Array], old: Columns | None, small: float | None
    ) -> None:
        self.problem, self.x, self.residuals, self.small = problem, x, residuals, small
        self.cost, self.damping, self.gain_ratio = problem.cost(x, residuals), DAMPING, 0.0
        self.least_reduction = self._least_reduction()
        self.jacobians_here = 0
        parameters = problem.where.parameters
        has_others = any(not parameter.run for parameter in parameters)
        self.kinked = np.array([bool(has_others and p.run and p.screen) for p in parameters], dtype=bool)
        self.held, self.is_released = np.zeros(len(x), dtype=bool), False
        self.update_jacobian(old)
        self.fresh = not old

    def update_jacobian(self, old: Columns | None = None) -> None:
        """Compute the Jacobian here."""
        self.jacobian = self.problem.jacobian(self.x, self.residuals, old)
        self.problem.symmetrise(self.jacobian)
        self.normal = _normal(self.problem, self.x, self.jacobian)
        self.fresh, self.is_undamped, self.jacobians_here = True, False, self.jacobians_here + 1

    def descend(self, share: float) -> bool:
        """Take steps while the Jacobian is accurate; return whether the search has converged to a share of the cost."""
        for _ in range(MOST_UPDATES):
            enough = max(self.least_reduction, share * self.cost)
            gradient = _gradient(self.problem, self.x, self.jacobian, self.residuals)
            step = _step(self.normal, gradient, self.damping, self.x, self.problem, self.held)
            predicted_reduction = -float(2 * gradient @ step + step @ self.normal @ step)
            if predicted_reduction < 0:
                # A step that was clipped to the bounds is no minimum of the bounded parabola.
                self.damping = max(self.damping, 1e-6) * DAMPING_INCREASE
                continue
            if predicted_reduction <= enough and not self.is_undamped:
                # Along a valley, damping itself may keep the predicted reduction small.
                self.damping, self.is_undamped = 0.0, True
                continue
            if predicted_reduction <= enough and self.held.any():
                self._release()
                return False
            if predicted_reduction <= enough:
                return self.fresh or 1 / LARGE < self.gain_ratio < LARGE
            tried = self.problem.residuals(self.x + step)
            reached = self.problem.cost(self.x + step, tried)
            if tried is not None and reached < self.cost:
                was_fresh = self.fresh
                self._go(step, tried, reached, predicted_reduction)
                if self.gain_ratio < LEAST_GAIN_RATIO:
                    if was_fresh:
                        self.hold_initial_states()
                    return False
                self.is_released = False
            elif not self.fresh:
                return False
            elif self.is_released or not self.hold_initial_states():
                self.damping = max(self.damping, 1e-6) * DAMPING_INCREASE
        return False

    def _least_reduction(self) -> float:
        """Return the least predicted reduction of a step that is not the last."""
        if self.small is not None:
            return self.small
        return SMALL_REDUCTION * self.problem.dataset.discrepancy(self.residuals)

    def hold_initial_states(self) -> bool:
        """Hold the initial states of runs; return whether that changes the next step.

        The cost has kinks in the initial states, at which a hysteresis begins to move the other way, and no derivative
        shows them. The other coordinates then converge by themselves (block coordinate descent: Bertsekas, Nonlinear
        Programming, section 3.7).
        """
        if self.held.any() or not self.kinked.any():
            return False
        self.held = self.kinked.copy()
        return True

    def _release(self) -> None:
        """Release the initial states after the other coordinates have converged."""
        self.held, self.is_released = np.zeros(len(self.x), dtype=bool), True
        self.damping, self.is_undamped, self.jacobians_here = DAMPING, False, 0

    def _go(self, step: Array, tried: list[Array], reached: float, predicted_reduction: float) -> None:
        """Take a step, and update the Jacobian by Broyden's formula (1965)."""
        weighted = np.diag(self.normal) * step
        weighted = weighted / max(float(weighted @ step), 1e-300)
        for part, before, after in zip(self.jacobian, self.residuals, tried, strict=True):
            error = after - before - part.matrix @ step[part.places]
            part.matrix[:] += np.outer(weighted[part.places], error).T  # columns are contiguous in memory
        self.problem.symmetrise(self.jacobian)
        self.gain_ratio = (self.cost - reached) / predicted_reduction
        self.x, self.residuals, self.cost = self.x + step, tried, reached
        self.least_reduction = self._least_reduction()
        self.damping *= DAMPING_DECREASE if self.gain_ratio > 0.5 else 1.0
        self.normal = _normal(self.problem, self.x, self.jacobian)
        self.fresh, self.is_undamped, self.jacobians_here = False, False, 0

    def solution(self) -> Solution:
        """Return the present point as a solution."""
        residuals, jacobian = tuple(self.residuals), tuple(self.jacobian)
        return Solution(self.problem.at_solution(self.x), self.x, self.cost, residuals, jacobian, self.normal)


def _normal(problem: Problem, x: Array, jacobian: Sequence[JacobianBlock]) -> Array:
    prior = problem.prior_jacobian(x)
    return add_normal(prior.T @ prior, jacobian)


def add_normal(total: Array, jacobian: Sequence[JacobianBlock]) -> Array:
    """Return J'J added to a matrix, coordinates by coordinates."""
    for part in jacobian:
        total[np.ix_(part.places, part.places)] += part.matrix.T @ part.matrix
    return total


def _gradient(problem: Problem, x: Array, jacobian: Sequence[JacobianBlock], residuals: Sequence[Array]) -> Array:
    total = problem.prior_jacobian(x).T @ problem.prior_residual(x)
    for part, residual in zip(jacobian, residuals, strict=True):
        total[part.places] += part.matrix.T @ residual
    return np.asarray(total)


def _step(normal: Array, gradient: Array, damping: float, x: Array, problem: Problem, held: Flags) -> Array:
    """Return the damped step within the bounds; held coordinates stay.

    Coordinates that would leave the bounds go to the bound, and the step of the others is computed again.
    """
    lower, upper = problem.where.lower - x, problem.where.upper - x
    scale = np.sqrt(np.where(np.diag(normal) > 0, np.diag(normal), 1.0))
    damped = normal / np.outer(scale, scale) + damping * np.eye(len(x))
    step, moving = np.zeros(len(x)), ~held
    for _ in range(len(x)):
        places, stopped = np.flatnonzero(moving), np.flatnonzero(~moving)
        if not len(places):
            break
        pull = gradient[places] / scale[places] + damped[np.ix_(places, stopped)] @ (scale * step)[stopped]
        inner = damped[np.ix_(places, places)]
        step[places] = -np.linalg.lstsq(inner, pull, rcond=1e-14)[0] / scale[places]
        leaving = moving & ((step < lower) | (step > upper))
        if not leaving.any():
            break
        step[leaving] = np.clip(step, lower, upper)[leaving]
        moving &= ~leaving
    return np.clip(step, lower, upper)


def _inverse(normal: Array) -> Array:
    scale = np.sqrt(np.where(np.diag(normal) > 0, np.diag(normal), 1.0))
    return np.asarray(
        np.linalg.pinv(normal / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    )

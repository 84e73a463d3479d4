"""The fit of `identify`: weighted nonlinear least squares from several starts, with intervals and identifiability."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.errors import InputError
from flexdesign.core.model import Model, Observation
from flexdesign.core.parallel_map import shared_pool
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.levenberg_marquardt import Effort, Solution, solve
from flexdesign.estimation.least_squares.multistart import Starts, multistart
from flexdesign.estimation.least_squares.residual_function import Problem, coordinates
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from flexdesign.estimation.uncertainty.identifiability import Estimate, check_intervals, estimates
from flexdesign.estimation.uncertainty.intervals import Uncertainty, uncertainty


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model, with the estimates of its parameters.

    Parameters
    ----------
    model
        The model with the best values, also of parameters that the data do not determine.
    estimates
        The estimate of each free parameter, in the order of `free`.
    correlation
        Correlation matrix of their coordinates, in that order. Parameters in the null space have no correlation.
    rms, inflation
        Of each observation: the root mean square of measured less predicted less offset, SI; and the number of
        correlated samples that count as one, which is 1 if the residual is white.
    starts
        The results of the starts.
    evaluations
        Number of simulations.
    """

    model: Model
    estimates: tuple[Estimate, ...]
    correlation: Array
    rms: tuple[float, ...]
    inflation: tuple[float, ...]
    starts: Starts
    evaluations: int

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a free parameter by its name."""
        return {estimate.name: estimate for estimate in self.estimates}[name]

    @property
    def values(self) -> dict[str, float]:
        """The determined values, SI."""
        return {e.name: e.value for e in self.estimates if e.value is not None}

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the parameters that the data do not determine."""
        return tuple(e.name for e in self.estimates if not e.determined)


def fit(
    model: Model,
    observations: Sequence[Observation],
    free: Sequence[str],
    *,
    known: Mapping[str, tuple[float, float]] | None = None,
    starts: int = 8,
    progress: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Fit free parameters of a model to observations, and state which of them the data determine.

    The noise is unknown and the same in all observations; its level and its spectrum are those of the residual. Each
    observation has an unknown offset, which is linear and is eliminated exactly (Golub and Pereyra 1973), so that the
    intervals include its uncertainty. If the model fails at some values (numbers that are not finite, an
    ArithmeticError), the cost there is infinite.

    Parameters
    ----------
    model, observations, free
        The model, with the present values as `start` of its parameters; the observations of role `identify`; and the
        names of the parameters to be fitted.
    known
        Gaussian priors: means and standard deviations, SI; those of parameters that are not free are ignored.
    starts
        Largest number of starts.
    progress
        Receives the progress as text. An exception raised here, or Ctrl-C, ends the fit.

    Raises
    ------
    InputError
        If names, observations or numbers of samples do not fit together, or the model fails everywhere.
    """
    if starts < 1:
        raise InputError("fit", "starts", starts, "a fit needs at least one start")
    where = coordinates(model, free, known or {})
    _check(observations)
    dataset = Dataset(observations, ColouredNoise(Process.white(1.0)), _offset)
    if dataset.samples <= len(free) + len(observations):
        asked = f"{len(free)} parameters and {len(observations)} offsets need more samples than that"
        raise InputError("fit", "observations", f"{dataset.samples} samples", asked)
    with shared_pool(min(2, os.cpu_count() or 1)) as each:
        problem = Problem(dataset, model, where, each)
        first, summary, minima = multistart(problem, starts, progress)
        progress("checking the intervals")
        best, found, intervals, is_better = check_intervals(first, range(len(free)), _converge)
        return Fit(
            model=problem.at(best.x),
            estimates=estimates(best, found, intervals, minima),
            correlation=found.correlation,
            rms=_rms(best),
            inflation=found.inflation,
            starts=replace(summary, converged=0) if is_better else summary,
            evaluations=problem.evaluations,
        )


def _converge(solution: Solution) -> tuple[Solution, Uncertainty]:
    """Return the minimum to full accuracy and its uncertainty, prior knowledge weighed against the residual.

    The weight follows from the residual of the fit itself, in which correlated samples count as fewer, so that both are
    found in turn.
    """
    scale = 1.0
    for _ in range(6):
        problem = solution.problem.fresh(
            solution.problem.dataset.with_shapes(_offset, ColouredNoise(Process.white(scale))), central=True
        )
        # To a thousandth of a standard deviation for 10 000 samples; without noise to where values are rounded.
        solution = solve(problem, solution.x, Effort(30, 1e-10), small=1e-6 * problem.dataset.floor) or solution
        found = uncertainty(solution, None)
        factor = math.sqrt(found.variance * float(np.mean(found.inflation)))
        if not problem.where.known or not factor or abs(factor - 1) < 0.02:  # 95 % intervals show no 2 %
            break
        scale *= factor
    return solution, found


def _rms(solution: Solution) -> tuple[float, ...]:
    """Return the root mean square of the residual of each observation, SI."""
    dataset, model = solution.problem.dataset, solution.problem.at(solution.x)
    rests = [dataset.remainder(record, np.asarray(model.predict(record.observation))) for record in dataset.records]
    return tuple(math.sqrt(float(np.nanmean(rest**2))) for rest in rests)


def _check(observations: Sequence[Observation]) -> None:
    if not observations:
        raise InputError("fit", "observations", None, "a fit needs something that was measured")
    names = [observation.name for observation in observations]
    for observation in observations:
        if observation.role != "identify":
            raise InputError("fit", observation.name, observation.role, "is kept for validation; a fit may not see it")
        if names.count(observation.name) > 1:
            raise InputError("fit", observation.name, None, "is given twice; every observation needs a name of its own")


def _offset(observation: Observation) -> tuple[Array, Array]:
    return np.ones((len(observation.measured()), 1)), np.array([math.inf])

"""The fit of `identify`: weighted nonlinear least squares from several starts, with intervals and identifiability."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.errors import InputError
from flexdesign.core.model import Model, Observation
from flexdesign.estimation.least_squares.dataset import Dataset, Shapes, channels
from flexdesign.estimation.least_squares.levenberg_marquardt import Effort, Solution, solve
from flexdesign.estimation.least_squares.multistart import Starts, multistart
from flexdesign.estimation.least_squares.parallel_map import shared_pool
from flexdesign.estimation.least_squares.parameter_transforms import coordinates
from flexdesign.estimation.least_squares.residual_function import Problem
from flexdesign.estimation.noise.whitening import Noise, White, Whitening
from flexdesign.estimation.uncertainty.covariance import Uncertainty, uncertainty
from flexdesign.estimation.uncertainty.identifiability import Estimate, estimates
from flexdesign.estimation.uncertainty.intervals import check_intervals

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Match:
    """How well the fitted model matches one observation.

    Parameters
    ----------
    name
        Name of the observation.
    residual, rms
        Measured less predicted less offset, SI, shaped as measured, NaN at gaps; and its root mean square.
    offset
        The offset of each channel, SI; zeros if none was taken out.
    inflation
        How many samples count as one because neighbours are correlated; 1 if the residual is white.
    """

    name: str
    residual: NDArray[Any]
    offset: tuple[float, ...]
    rms: float
    inflation: float


@dataclass(frozen=True, eq=False)
class Fit:
    """A fitted model and what the data say about its parameters.

    Parameters
    ----------
    model
        The model with the best values, those among them that the data do not determine.
    estimates
        The verdict on each free parameter, in the order asked for.
    correlation
        Of the free parameters' coordinates, in that order. Parameters in an open direction have no correlation.
    matches
        How well each observation is matched.
    cost
        Sum of squares of whitened residuals and of the prior.
    reduced_chi2
        None where the noise was not given.
    dof
        Degrees of freedom behind the intervals, correlated samples counted as fewer; infinite where the noise was
        given and explains the residual.
    starts
        How the starts ended.
    evaluations, failures
        Number of simulations, and of those without finite values.
    """

    model: Model
    estimates: tuple[Estimate, ...]
    correlation: Array
    matches: tuple[Match, ...]
    cost: float
    reduced_chi2: float | None
    dof: float
    starts: Starts
    evaluations: int
    failures: int

    def __getitem__(self, name: str) -> Estimate:
        """Return the verdict on one parameter that was free."""
        return {estimate.name: estimate for estimate in self.estimates}[name]

    @property
    def values(self) -> dict[str, float]:
        """The determined values, SI."""
        return {e.name: e.value for e in self.estimates if e.value is not None}

    @property
    def sigmas(self) -> dict[str, float]:
        """The standard deviations of the determined values, SI."""
        return {e.name: e.sigma for e in self.estimates if e.sigma is not None}

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
    noise: Noise = None,
    offsets: bool | Collection[str] = True,
    starts: int = 8,
    seed: int = 0,
    threads: int | None = None,
    profiles: bool = True,
    reveal: Mapping[str, str] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Fit:
    """Fit free parameters of a model to what was measured, and say which of them the data determine.

    The offsets are linear and are eliminated exactly (Golub and Pereyra 1973), so that the parameters carry their
    uncertainty. A model that fails at some values (numbers that are not finite, an ArithmeticError) is taken to fit
    infinitely badly there.

    Parameters
    ----------
    model, observations, free
        The model, whose parameters' `start` are the present values; what was measured, for identification; and the
        names of the parameters to be fitted.
    known
        Prior knowledge, Gaussian: values with standard deviations, SI; of parameters that are not free it is ignored.
    noise
        The noise of the observations, SI. Unknown by default: white, alike in all observations, its level taken from
        the residual.
    offsets
        Whether each channel of each observation has an unknown offset; or the names of the observations where it has.
    starts, seed
        How many starts may be followed, and the seed of their sample.
    threads
        How many simulations run at a time; two by default, if there are two processors.
    profiles
        Whether intervals are checked by profile likelihood: about five simulations per parameter where they are right.
    reveal
        The experiment that would show a parameter, by its name, for the reasons given.
    progress
        Receives the progress as text. An exception raised here, or Ctrl-C, ends the fit.

    Raises
    ------
    InputError
        If names, noise, observations or numbers of samples do not fit together, or the model fails everywhere.
    """
    if starts < 1:
        raise InputError("fit", "starts", starts, "a fit needs at least one start")
    where = coordinates(model, free, known or {})
    _check(observations)
    dataset = Dataset(observations, _whitening(noise), _offsets(offsets))
    count = sum(record.columns.shape[1] for record in dataset.records)
    if dataset.samples <= len(free) + count:
        asked = f"{len(free)} parameters and {count} offsets need more samples than that"
        raise InputError("fit", "observations", f"{dataset.samples} samples", asked)
    with shared_pool(_thread_count(threads)) as each:
        problem = Problem(dataset, model, where, each)
        first, summary, minima = multistart(problem, starts, seed, progress)
        progress("checking the intervals")
        refine = partial(_converge, dataset, noise is not None)
        best, found, intervals, is_better = check_intervals(first, range(len(free)), refine, profiles)
        return Fit(
            model=problem.at(best.x),
            estimates=tuple(_with_advice(e, reveal or {}) for e in estimates(best, found, intervals, minima)),
            correlation=found.correlation,
            matches=_matches(best, found),
            cost=best.cost,
            reduced_chi2=None if noise is None else found.reduced_chi2,
            dof=found.dof,
            starts=replace(summary, converged=0) if is_better else summary,
            evaluations=problem.evaluations,
            failures=problem.failures,
        )


def _converge(dataset: Dataset, noise_is_known: bool, solution: Solution) -> tuple[Solution, Uncertainty]:
    """Return the minimum to full accuracy and its uncertainty, prior knowledge weighed against the residual.

    Where the noise is unknown, or correlated samples count as fewer, the weight follows from the residual of the fit
    itself, so that both are found in turn.
    """
    scale = 1.0
    for _ in range(6):
        problem = solution.problem.fresh(dataset.scaled(scale) if scale != 1 else dataset, central=True)
        # To a thousandth of a standard deviation for 10 000 samples; without noise to where values are rounded.
        solution = solve(problem, solution.x, Effort(30, 1e-10), small=1e-6 * problem.dataset.floor) or solution
        found = uncertainty(solution, scale**-2 if noise_is_known else None)
        factor = math.sqrt(found.variance * float(np.mean(found.inflation)))
        if not problem.where.known or not factor or abs(factor - 1) < 0.02:  # 95 % intervals show no 2 %
            break
        scale *= factor
    return solution, found


def _with_advice(estimate: Estimate, reveal: Mapping[str, str]) -> Estimate:
    """Return an estimate that names the experiment which would show a parameter that is not determined."""
    if estimate.determined or estimate.name not in reveal:
        return estimate
    return replace(estimate, reason=f"{estimate.reason}; would show it: {reveal[estimate.name]}")


def _matches(solution: Solution, found: Uncertainty) -> tuple[Match, ...]:
    dataset, model, made = solution.problem.dataset, solution.problem.at(solution.x), []
    for record, inflation in zip(dataset.records, found.inflation, strict=True):
        predicted = np.asarray(model.predict(record.observation))
        offset = tuple(float(o) for o in dataset.amounts(record, record.difference(predicted)))
        residual = dataset.remainder(record, predicted)
        rms = math.sqrt(float(np.nanmean(residual**2)))
        name, shaped = record.observation.name, record.reshape(residual)
        made.append(Match(name, shaped, offset or (0.0,) * record.channels, rms, inflation))
    return tuple(made)


def _check(observations: Sequence[Observation]) -> None:
    if not observations:
        raise InputError("fit", "observations", None, "a fit needs something that was measured")
    names = [observation.name for observation in observations]
    for observation in observations:
        if observation.role != "identify":
            raise InputError("fit", observation.name, observation.role, "is kept for validation; a fit may not see it")
        if names.count(observation.name) > 1:
            raise InputError("fit", observation.name, None, "is given twice; every observation needs a name of its own")


def _offsets(wanted: bool | Collection[str]) -> Shapes:
    """Return what makes a column for each channel of the observations that have offsets."""

    def shapes(observation: Observation) -> tuple[Array, Array]:
        values, count = channels(np.asarray(observation.measured()))
        has_offsets = wanted if isinstance(wanted, bool) else observation.name in wanted
        columns = np.kron(np.eye(count), np.ones((len(values) // count, 1)))[:, : count * has_offsets]
        return np.asarray(columns, dtype=np.float64), np.full(count * has_offsets, math.inf)

    return shapes


def _whitening(noise: Noise) -> Whitening:
    if noise is None:
        return White(1.0)
    return White(noise) if isinstance(noise, (int, float, Mapping)) else noise


def _thread_count(threads: int | None) -> int:
    """Return the number of threads; by default two, where there are as many processors."""
    count = min(2, os.cpu_count() or 1) if threads is None else threads
    if count < 1:
        raise InputError("fit", "threads", threads, "a fit needs at least one thread")
    return count

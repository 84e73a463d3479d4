"""The estimation problem of a diagnosis: identification and validation runs, free parameters, and their priors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Model
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.least_squares.parameter_transforms import Coordinates, coordinate, coordinates
from flexdesign.estimation.least_squares.residual_function import Map, Problem


@dataclass(frozen=True, eq=False)
class EstimationTask:
    """The estimation problem of a diagnosis.

    Parameters
    ----------
    identify, validate
        Runs that are fitted, and runs by which models are chosen.
    free
        Names of the free parameters of the model itself.
    known
        Returns the priors of the parameters of a model: mean and standard deviation, SI, by name.
    bare
        Returns a model without the effects that were added to it.
    tolerance
        Least change of the prediction of a validation run by an effect, rms [response].
    coarse, fine
        Return a model that is simulated less exactly and faster, for screening; and exactly.
    each
        Maps simulations, and fits, perhaps over threads; see `least_squares.parallel_map`.
    progress
        Receives the progress as text.
    calibrated_excess
        Chi^2 of the fitted runs less the number of samples, for the model without effects; see `forward`.
    noise_rms
        Rms noise of the runs by which models are chosen [response]; zero if it is unknown.
    test
        Runs that are neither fitted nor choose a model; None if there are none.
    prepared
        Returns the task with the initial conditions that the effects of a model need.
    prior_bound
        Largest distance of a parameter of one run from the mean of its prior, in standard deviations.
    weights
        Weights of the values of an observation, by its name, in addition to `tolerance`; one where it is missing.
    scales
        For an observation whose values are not equally noisy, by its name: typical noise over the noise of each value.
        Its rms residual is stated with these factors.
    scored
        Names of the observations whose rms residual is stated; by default those of `validate`, or all without any.
    """

    identify: Dataset
    validate: Dataset
    free: tuple[str, ...]
    known: Callable[[Model], Mapping[str, tuple[float, float]]]
    bare: Callable[[Model], Model]
    tolerance: float
    coarse: Callable[[Model], Model] = lambda model: model
    fine: Callable[[Model], Model] = lambda model: model
    each: Map = map
    progress: Callable[[str], None] = lambda _: None
    calibrated_excess: float = 0.0
    noise_rms: float = 0.0
    test: Dataset | None = None
    prepared: Callable[[EstimationTask, Model], EstimationTask] = lambda task, _: task
    prior_bound: float = math.inf
    weights: Mapping[str, Array] = field(default_factory=dict)
    scales: Mapping[str, Array] = field(default_factory=dict)
    scored: tuple[str, ...] = ()

    def problem(self, dataset: Dataset, model: Model, free: Sequence[str] = ()) -> Problem:
        """Return the least-squares problem of a data set: a model with free parameters, and with those of each run."""
        return Problem(dataset, model, self._coordinates(model, free, dataset), self.each)

    def _coordinates(self, model: Model, free: Sequence[str], dataset: Dataset) -> Coordinates:
        runs = {record.observation.name for record in dataset.records}
        own = [parameter.name for parameter in model.parameters() if parameter.run in runs]
        names = [*free, *own]
        if not names:  # frequency responses have no parameters of their own
            return Coordinates((), {}, np.zeros(0), np.zeros(0), np.zeros(0))
        known = {name: about for name, about in self.known(model).items() if name in names}
        return _bound_by_priors(coordinates(model, names, known), self.prior_bound)


def _bound_by_priors(where: Coordinates, prior_bound: float) -> Coordinates:
    """Return coordinates with parameters of one run within this number of standard deviations of their priors."""
    lower, upper = where.lower.copy(), where.upper.copy()
    for j, parameter in enumerate(where.parameters):
        if parameter.run and parameter.name in where.known:
            middle, sigma = where.known[parameter.name]
            lower[j] = max(lower[j], coordinate(parameter, middle - prior_bound * sigma))
            upper[j] = min(upper[j], coordinate(parameter, middle + prior_bound * sigma))
    return replace(where, lower=lower, upper=upper, start=np.clip(where.start, lower, upper))

"""Differences of the predictions of two models: the change due to an effect, compared with the tolerance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from flexdesign.core.arrays import Array
from flexdesign.core.model import Model, parameter_of
from flexdesign.estimation.least_squares.dataset import Dataset, Record
from flexdesign.estimation.least_squares.parameter_transforms import null_of
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.score_test import Candidate


def difference(dataset: Dataset, before: Model, after: Model, weights: Mapping[str, Array]) -> float:
    """Return the rms difference of the predictions of two models for new runs, without offsets [response].

    New runs have the initial conditions of the old ones, except for the trigger delay. Observations with weights (see
    `EstimationTask`) are compared separately: the larger difference is returned.
    """
    weighted = [record for record in dataset.records if record.observation.name in weights]
    plain = [record for record in dataset.records if record.observation.name not in weights]
    return max(_rms_difference(records, before, after, weights) for records in (plain, weighted) if records)


def largest_difference(task: EstimationTask, before: Model, after: Model) -> float:
    """Return the larger of the differences for the fitted and for the validation runs, see `difference`."""
    datasets = [dataset for dataset in (task.identify, task.validate) if dataset.records]
    return max(difference(dataset, before, after, task.weights) for dataset in datasets)


def _rms_difference(records: Sequence[Record], before: Model, after: Model, weights: Mapping[str, Array]) -> float:
    squares, count = 0.0, 0
    nulls = [{p.name: p.null for p in model.parameters() if p.run and p.null is not None} for model in (before, after)]
    models = [model.replace(values) for model, values in zip((before, after), nulls, strict=True)]
    for record in records:
        first, second = (np.asarray(model.predict(record.observation)) for model in models)
        change = without_offset(record, second - first, weights)
        squares, count = squares + float(np.sum(change**2)), count + len(change)
    return math.sqrt(squares / count)


def without_effect(model: Model, effect: Candidate) -> Model:
    """Return a model in which an effect is at its null in all runs; all other parameters stay."""
    null = null_of(parameter_of(model, effect.strength))
    deviations = {p.name: 0.0 for p in model.parameters() if p.run and p.name.endswith(f":{effect.strength}")}
    return model.replace({effect.strength: null, **deviations})


def without_offset(record: Record, values: Array, weights: Mapping[str, Array]) -> Array:
    """Return the present values less their mean; for an observation with weights, the weighted values."""
    weight = weights.get(record.observation.name)
    if weight is not None:
        return np.asarray((values * weight)[record.present])
    present = values[record.present]
    return np.asarray(present - np.mean(present))

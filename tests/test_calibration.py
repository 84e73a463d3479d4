"""Calibration: a tone whose frequency has local minima."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from flexdesign.diagnosis.effect_selection.estimation_setup import evaluate_design
from flexdesign.diagnosis.procedure import calibrate
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.sums import HELD, NAMES, SIGMA, N, Sum, offset
from tests.estimation.toys import Array, Run, parameter


def tone(start: float) -> tuple[Sum, EstimationTask]:
    """A tone of five periods: the cost has a false minimum for every period more or less."""

    def shape(v: Mapping[str, float], run: Any) -> Array:
        return np.asarray(v["size"] * np.sin(2 * math.pi * v["f"] * run.t) + 0 * v[f"{run.name}:own"])

    own = [parameter(f"{name}:own", 0.0, -1.0, 1.0, run=name) for name in (*NAMES, *HELD)]
    model = Sum().plus(shape, parameter("size", 1.0, 0.1, 3.0), parameter("f", start, 4.0, 8.0), *own)
    truth, rng = model.replace({"size": 1.5, "f": 5.3}), np.random.default_rng(0)

    def dataset(names: Sequence[str]) -> Dataset:
        blank = [Run(name, np.arange(N) / N, None) for name in names]
        made = [dataclasses.replace(r, data=truth.predict(r) + SIGMA * rng.standard_normal(N)) for r in blank]
        return Dataset(made, ColouredNoise(Process.white(SIGMA)), offset)

    return model, EstimationTask(dataset(NAMES), dataset(HELD), ("size", "f"), lambda _: {}, lambda _: model, 1e-3)


@pytest.mark.parametrize("start", [5.2, 7.3])
def test_calibration_finds_the_minimum_near_the_better_start(start: float) -> None:
    """From the seventh period on the fit is caught; the design, if it explains more, is a second start."""
    model, about = tone(start)
    nominal = evaluate_design(about, model.replace({"f": 5.2, "size": 1.4}))
    fit = calibrate(about, model, nominal)
    assert fit is not None and not fit.exceeds_noise
    assert fit.solution.problem.where.values(fit.solution.x)["f"] == pytest.approx(5.3, abs=0.01)
    alone = calibrate(about, model)
    assert alone is not None and alone.exceeds_noise is (start == 7.3)


def test_calibration_of_a_model_that_always_fails_is_none() -> None:
    model, about = tone(5.0)
    fails = model.plus(lambda v, run: np.full(len(run.t), np.nan))
    assert calibrate(about, fails) is None


def test_a_model_without_numbers_of_its_own_stays_as_it_is() -> None:
    model, about = tone(7.3)
    fit = calibrate(dataclasses.replace(about, free=()), model)
    assert fit is not None and fit.exceeds_noise

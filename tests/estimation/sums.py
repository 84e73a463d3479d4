"""Sums of random columns in some runs: what a fit of strengths must find follows from linear algebra alone."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import numpy as np

from flexdesign.core.model import Effect, Observation, Parameter
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.fitted_model import FittedModel, fit_model, with_effects
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process, Whitening
from tests.estimation.toys import Array, Run, parameter

Shape = Callable[[Mapping[str, float], Any], Array]
N = 60
NAMES = ("one", "two", "three")
SIGMA = 0.1
HELD = ("kept", "apart")
EFFECTS = ("a", "b", "c", "d", "e", "f")


@dataclass(frozen=True, eq=False)
class Sum:
    """A sum of shapes: what a fit of strengths must find follows from linear algebra alone."""

    shapes: tuple[Shape, ...] = ()
    every: tuple[Parameter, ...] = ()

    def parameters(self) -> tuple[Parameter, ...]:
        return self.every

    def replace(self, values: Mapping[str, float]) -> Sum:
        assert set(values) <= {p.name for p in self.every}
        return Sum(self.shapes, tuple(dataclasses.replace(p, start=values.get(p.name, p.start)) for p in self.every))

    def with_effect(self, effect: Effect) -> Sum:
        raise NotImplementedError

    def predict(self, observation: Any) -> Array:
        v = {p.name: float(p.start or 0.0) for p in self.every}
        return np.sum([np.zeros(len(observation.t)), *(shape(v, observation) for shape in self.shapes)], axis=0)

    def plus(self, shape: Shape, *more: Parameter) -> Sum:
        return Sum((*self.shapes, shape), (*self.every, *more))


def column(run: Any, name: str) -> Array:
    """The same random numbers whenever they are asked for."""
    return np.random.default_rng([crc32(run.name.encode()), crc32(name.encode())]).standard_normal(len(run.t))


def strength(name: str, start: float = 0.0, low: float = -1e3, high: float = 1e3, **more: Any) -> Parameter:
    return parameter(name, start, low, high, null=0.0, **more)


def linear(name: str, made_of: Mapping[str, float] | None = None) -> Shape:
    """A strength times a mixture of random columns, by default its own."""
    mixture = made_of or {name: 1.0}
    return lambda v, run: v[name] * np.sum([share * column(run, c) for c, share in mixture.items()], axis=0)


def candidate(name: str, made_of: Mapping[str, float] | None = None, trial: float = 0.1, **more: Any) -> Candidate:
    """An effect that is linear in its strength."""
    low, high = more.pop("between", (-1e3, 1e3))
    number = strength(name, 0.0, low, high)
    return Candidate(
        name, lambda model: as_sum(model).plus(linear(name, made_of), number), name, (name,), ({name: trial},), **more
    )


def as_sum(model: Any) -> Sum:
    assert isinstance(model, Sum)
    return model


def base(*names: str, start: float = 0.0) -> Sum:
    model = Sum()
    for name in names:
        model = model.plus(linear(name), strength(name, start))
    return model


def offset(observation: Observation) -> tuple[Array, Array]:
    return np.ones((len(observation.measured()), 1)), np.array([math.inf])


def columns(model: Sum, observed: Sequence[Run], names: Sequence[str], of: Whitening) -> Array:
    """Whitened columns of a linear model with an offset for each run, those of the offsets first."""
    made = []
    for i, run in enumerate(observed):
        shifts = np.zeros((len(run.t), len(observed)))
        shifts[:, i] = 1.0
        own = [model.replace({n: float(n == name) for n in names}).predict(run) for name in names]
        made.append(of.whiten(run, np.column_stack([shifts, *own])))
    return np.vstack(made)


def least(matrix: Array, right: Array) -> float:
    """The least sum of squares."""
    return float(np.sum((right - matrix @ np.linalg.lstsq(matrix, right)[0]) ** 2))


# --- runs of a known truth -------------------------------------------------------------------------------------------


def stage() -> Sum:
    """Two numbers that are known to exist, and one of each run."""
    own = [parameter(f"{name}:own", 0.0, -10.0, 10.0, run=name) for name in (*NAMES, *HELD)]
    return base("p", "q").plus(lambda v, run: v.get(f"{run.name}:own", 0.0) * column(run, "own"), *own)


def recorded(truth: Mapping[str, float], seed: int = 0, names: Sequence[str] = NAMES) -> list[Run]:
    rng = np.random.default_rng([seed, len(names)])

    def data(name: str) -> Array:
        run = Run(name, np.arange(N) / N, None)
        amounts = {"p": 2.0, "q": -1.0, "own": rng.normal(), **truth}
        total = sum((amount * column(run, c) for c, amount in amounts.items()), start=rng.normal() * np.ones(N))
        return np.asarray(total + SIGMA * rng.standard_normal(N))

    return [Run(name, np.arange(N) / N, data(name)) for name in names]


def task(
    truth: Mapping[str, float], seed: int = 0, tolerance: float = 1e-3, held: Any = None, **known: Any
) -> EstimationTask:
    """Three runs for the fit and two kept apart, in which the truth may be another."""
    noise = ColouredNoise(Process.white(SIGMA))
    kept = recorded(truth if held is None else held, seed, HELD)
    identify, validate = Dataset(recorded(truth, seed), noise, offset), Dataset(kept, noise, offset)
    return EstimationTask(identify, validate, ("p", "q"), lambda _: known, lambda _: stage(), tolerance)


def calibrated_stand(about: EstimationTask) -> FittedModel:
    found = fit_model(about, stage())
    assert found is not None
    return found


def effects(**more: Candidate) -> list[Candidate]:
    return [more.get(name, candidate(name, signed=True)) for name in EFFECTS]


def fit_with(about: EstimationTask, added: Sequence[Candidate]) -> FittedModel:
    found = fit_model(about, with_effects(stage(), added), tuple(added))
    assert found is not None
    return found

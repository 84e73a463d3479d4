"""Models of one formula, and what they would be measured as: nothing here shares code with the fit."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexdesign.core.model import Effect, Parameter

Array = NDArray[np.float64]
Formula = Callable[[Mapping[str, float], Array], Any]


@dataclass(frozen=True, eq=False)
class Run:
    """Some numbers measured at some times."""

    name: str
    t: Array
    data: Any
    role: Literal["identify", "validate"] = "identify"

    def measured(self) -> Any:
        return self.data


@dataclass(frozen=True)
class Toy:
    """A formula with parameters."""

    formula: Formula
    every: tuple[Parameter, ...]

    def parameters(self) -> tuple[Parameter, ...]:
        return self.every

    def replace(self, values: Mapping[str, float]) -> Toy:
        assert set(values) <= {p.name for p in self.every}
        changed = (dataclasses.replace(p, start=values.get(p.name, p.start)) for p in self.every)
        return Toy(self.formula, tuple(changed))

    def with_effect(self, effect: Effect) -> Toy:
        raise NotImplementedError

    def predict(self, observation: Any) -> Any:
        return self.formula(self.values(), observation.t)

    def values(self) -> dict[str, float]:
        return {p.name: p.start for p in self.every if p.start is not None}


def parameter(name: str, start: float | None, low: float, high: float, **more: Any) -> Parameter:
    """A number without a unit unless `more` says otherwise."""
    return Parameter(name, more.pop("si", "1"), more.pop("unit", ""), name, start=start, plausible=(low, high), **more)


def oscillation(v: Mapping[str, float], t: Array) -> Array:
    """A decaying oscillation."""
    w = 2 * np.pi * v["f"]
    return np.asarray(v["a"] * np.exp(-v["zeta"] * w * t) * np.sin(w * np.sqrt(1 - v["zeta"] ** 2) * t + v["phi"]))


OSCILLATION = Toy(
    oscillation,
    (
        parameter("a", 1.5, 0.1, 10.0, si="m", unit="um"),
        parameter("f", 3.0, 0.5, 10.0, si="Hz", unit="Hz"),
        parameter("zeta", 0.05, 1e-3, 0.5, scale="log"),
        parameter("phi", 0.3, -1.5, 1.5, si="rad", unit="rad"),
    ),
)
TRUTH = {"a": 2.0, "f": 3.1, "zeta": 0.03, "phi": 0.5}


def ar1(rng: np.random.Generator, n: int, sigma: float, rho: float) -> Array:
    """Noise whose next sample remembers the share `rho` of the last; standard deviation `sigma`."""
    noise = sigma * rng.standard_normal(n)
    noise[1:] *= np.sqrt(1 - rho**2)
    for k in range(1, n):
        noise[k] += rho * noise[k - 1]
    return noise


def run(toy: Toy, truth: Mapping[str, float], t: Array, noise: Any = 0.0, name: str = "run") -> Run:
    """What a toy with the values `truth` would be measured as."""
    return Run(name, t, toy.formula({**toy.values(), **truth}, t) + noise)

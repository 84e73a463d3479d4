"""Runs of a play operator, whose chi^2 has many local minima, and the global one by differential evolution.

Play has kinks wherever the voltage turns, and the state in which a run began is unknown.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import differential_evolution

from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.model_selection.estimation_task import EstimationTask
from flexdesign.estimation.model_selection.score_test import Candidate
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from tests.estimation.sums import NAMES, Sum, as_sum, offset, strength
from tests.estimation.toys import Array, Run, parameter

HELD, VALUES, SEEDS = "kept", 120, 20
#: Bounds of the threshold.
LEAST, MOST = 0.02, 1.0


def play(voltage: Array, threshold: Any, state: Any) -> Array:
    """The output follows the voltage at a distance of the threshold; values by numbers of (threshold, state) pairs."""
    y = np.clip(state, voltage[0] - threshold, voltage[0] + threshold)
    found = [y]
    for u in voltage[1:]:
        y = np.clip(y, u - threshold, u + threshold)
        found.append(y)
    return np.array(found)


def voltage(name: str, seed: int) -> Array:
    """Three sinusoids of random frequencies and phases; the largest value is one."""
    rng, t = np.random.default_rng([seed, *name.encode()]), np.arange(VALUES) / VALUES
    parts = zip((1.0, 0.6, 0.4), (1.0, rng.uniform(2, 3), rng.uniform(4, 6)), rng.uniform(0, 2 * np.pi, 3), strict=True)
    total = sum((size * np.sin(2 * np.pi * f * t + phase) for size, f, phase in parts), start=np.zeros(VALUES))
    return np.asarray(total / np.abs(total).max())


@dataclass(frozen=True)
class Problem:
    """Runs of a known truth, and the model of which they lack nothing; it begins with a wrong threshold."""

    task: EstimationTask
    model: Sum
    effect: Candidate
    voltages: dict[str, Array]
    sigma: float

    def least(self, seed: int) -> tuple[float, float]:
        """Return the global minimum of chi^2, and the threshold there; what is linear is projected out."""
        offsets = np.kron(np.eye(len(NAMES)), np.ones((VALUES, 1)))
        q = np.linalg.qr(np.column_stack([offsets, np.concatenate([self.voltages[name] for name in NAMES])]))[0]
        data = np.concatenate([record.observation.measured() for record in self.task.identify.records]) / self.sigma
        data = data - q @ (q.T @ data)

        def chi_squared(x: Array) -> Array:
            moved = np.concatenate([play(self.voltages[n], x[0], x[1 + i]) for i, n in enumerate(NAMES)])
            moved = moved - q @ (q.T @ moved)
            return np.asarray(data @ data - (data @ moved) ** 2 / np.maximum(np.sum(moved**2, axis=0), 1e-9))

        found = differential_evolution(
            chi_squared,
            [(LEAST, MOST), *len(NAMES) * [(-1.0, 1.0)]],
            vectorized=True,
            updating="deferred",
            popsize=30,
            maxiter=400,
            tol=1e-10,
            rng=seed,
            polish=False,
        )
        return float(found.fun), float(found.x[0])


def problem(seed: int, sigma: float) -> Problem:
    voltages = {name: voltage(name, seed) for name in (*NAMES, HELD)}
    rng = np.random.default_rng(seed)
    threshold = rng.uniform(0.1, 0.4)
    screen = (-0.7, -0.35, 0.0, 0.35, 0.7)
    own = [parameter(f"{name}:state", 0.0, -1.0, 1.0, run=name, screen=screen) for name in voltages]
    effect = Candidate(
        "play",
        lambda model: as_sum(model).plus(
            lambda v, run: v["w"] * play(voltages[run.name], v["r"], v[f"{run.name}:state"]),
            strength("w"),
            parameter("r", 0.2, LEAST, MOST, scale="log"),
            *own,
        ),
        "w",
        ("w", "r"),
        tuple({"w": 0.1, "r": r} for r in (0.1, 0.2, 0.4)),
        signed=True,
    )
    full = effect.add(Sum().plus(lambda v, run: v["p"] * voltages[run.name], strength("p")))
    states = {f"{name}:state": rng.uniform(-0.8, 0.8) for name in voltages}
    truth = full.replace({"p": 2.0, "w": 0.5, "r": threshold, **states})

    def dataset(*names: str) -> Dataset:
        blank = [Run(name, np.arange(VALUES) / VALUES, None) for name in names]
        noise = [rng.normal() + sigma * rng.standard_normal(VALUES) for _ in names]
        made = [dataclasses.replace(r, data=truth.predict(r) + e) for r, e in zip(blank, noise, strict=True)]
        return Dataset(made, ColouredNoise(Process.white(sigma)), offset)

    task = EstimationTask(dataset(*NAMES), dataset(HELD), ("p",), lambda _: {}, lambda _: full, 1e-3)
    # Up to a factor of two off, as a screening with thresholds at every factor of four would leave it.
    begun = full.replace({"w": 0.3, "r": threshold * 2 ** rng.uniform(-1, 1)})
    return Problem(task, as_sum(begun), effect, voltages, sigma)

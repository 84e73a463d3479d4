"""The diagnosis finds the hysteretic spring of the Bouc-Wen benchmark, from a linear model that a user would write."""

from __future__ import annotations

import numpy as np
from scipy.signal import chirp

from flexdesign.diagnosis.procedure import diagnose
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.measurements.recordings import Run
from tests.reference import hysteretic_oscillator
from tests.reference.hysteretic_oscillator import RATE, Oscillator

NOISE = 8e-6  # m, as in the benchmark


def recorded(name: str, force: np.ndarray, rng: np.random.Generator) -> Run:
    """Solve by independent code; the force counts as a command in V."""
    position = hysteretic_oscillator.solve(Oscillator(), force, rtol=1e-8).position
    position = position + NOISE * rng.standard_normal(len(force))
    return Run(name, np.arange(len(force)) / RATE, {"u": force, "x": position}, {"u": "V", "x": "m"})


def test_the_spring_is_named_with_the_numbers_of_the_benchmark() -> None:
    rng = np.random.default_rng(4)
    runs = [recorded(name, hysteretic_oscillator.multisine(rng, points=1024), rng) for name in ("first", "second")]
    sweep = 40.0 * chirp(np.arange(1500) / RATE, 20.0, 2.0, 50.0)
    axis = AxisModel(36.0, 0.02, 1e-5, uncertainty={"natural_frequency": 0.2, "gain": 0.5, "damping_ratio": 1.0})
    found = diagnose(StageModel({"x": axis}), [*runs, recorded("sweep", sweep, rng)], threads=2)
    assert (found.verdict, [effect.name for effect in found.effects]) == ("effects-found", ["hysteretic_spring"])
    o = Oscillator()
    truth = {"share": o.share, "gamma": o.beta * o.gamma, "delta": o.beta * o.delta}
    values = {value.parameter.name.rpartition(".")[2]: value for value in found.effects[0].values}
    for name, right in truth.items():
        low, high = values[name].interval
        assert low - (high - low) / 2 < right < high + (high - low) / 2, name  # 95 % of fits are within the interval
        assert high - low < 0.1 * abs(right), name

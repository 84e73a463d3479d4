"""The linear system that nonlinear effects are compared with, on a simulator of SciPy: a sensor of acceleration."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import StateSpace, lsim

from flexdesign.diagnosis import diagnose, models_without_physics
from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.diagnosis.effect_selection.estimation_setup import case_of
from flexdesign.diagnosis.preparation.dataset import prepare
from flexdesign.diagnosis.procedure import calibrate_task
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import ActuatorData, AxisModel, StageModel
from flexdesign.estimation.least_squares.dataset import Dataset
from flexdesign.estimation.model_selection.forward_selection import fit_candidate
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from flexdesign.measurements.recordings import Run

Array = NDArray[np.float64]
FREQUENCY, DAMPING_RATIO = 12.7, 0.02
PERIOD, SAMPLES, NOISE = 0.01, 1000, 2e-9
GAIN = 1e-6


def command(seed: int) -> Array:
    """Random levels of four samples each [V]."""
    return np.repeat(np.random.default_rng(seed).uniform(-1, 1, SAMPLES // 4), 4)


def responses(force: Array) -> tuple[Array, Array]:
    """Return position, and velocity over the angular frequency, of the mode under a held force, by SciPy."""
    w = 2 * math.pi * FREQUENCY
    a = w * np.array([[0.0, 1.0], [-1.0, -2 * DAMPING_RATIO]])
    system = StateSpace(a, w * np.array([[0.0], [1.0]]), np.eye(2), np.zeros((2, 1))).to_discrete(PERIOD)
    states = np.zeros((len(force), 2))
    for k in range(len(force) - 1):
        states[k + 1] = system.A @ states[k] + system.B[:, 0] * force[k]
    return states[:, 0], states[:, 1]


def run(name: str, role: str, seed: int) -> Run:
    """A recording of the acceleration over the square of the angular frequency."""
    u = command(seed)
    position, velocity = responses(u - u[0])
    acceleration = GAIN * (u - u[0] - position - 2 * DAMPING_RATIO * velocity)
    x = acceleration + NOISE * np.random.default_rng([seed, 1]).standard_normal(SAMPLES)
    time = PERIOD * np.arange(SAMPLES)
    return Run(name, time, {"u": u, "x": x}, {"u": "V", "x": "m"}, "hold", role, between_is_stated=True)


def test_the_mode_responds_as_by_scipy() -> None:
    """Held forces by the discrete system; forces that are straight between samples by `lsim`."""
    force = command(4)
    for found, expected in zip(
        models_without_physics.mode_response(force, FREQUENCY, DAMPING_RATIO, PERIOD),
        responses(force - force[0]),
        strict=True,
    ):
        assert found == pytest.approx(expected, abs=1e-9)
    w = 2 * math.pi * FREQUENCY
    system = StateSpace(
        w * np.array([[0.0, 1.0], [-1.0, -2 * DAMPING_RATIO]]), [[0.0], [w]], np.eye(2), np.zeros((2, 1))
    )
    _, expected, _ = lsim(system, force - force[0], PERIOD * np.arange(len(force)))
    straight = models_without_physics.mode_response(force, FREQUENCY, DAMPING_RATIO, PERIOD, held=False)
    assert np.column_stack(straight) == pytest.approx(expected, abs=1e-9)


def test_the_linear_system_leaves_the_noise() -> None:
    """Started a fifth off; chi^2 of 2,000 values with noise, less eight numbers, to four standard errors."""
    model = AxisDynamics("x", AxisModel(FREQUENCY, DAMPING_RATIO, GAIN), max_command=1.0)
    runs = [run("one", "identify", 1), run("two", "identify", 2)]
    dataset = Dataset(
        runs, ColouredNoise(Process.white(NOISE)), lambda observation: (np.ones((SAMPLES, 1)), np.array([math.inf]))
    )
    chi2 = models_without_physics._chi2(dataset, model, 1.2 * FREQUENCY, 0.1)
    assert chi2 == pytest.approx(2 * SAMPLES, abs=4 * math.sqrt(4 * SAMPLES))


def stage() -> StageModel:
    axis = AxisModel(12.0, 0.05, GAIN, actuator=ActuatorData(free_stroke=GAIN, voltage_range=(-1.0, 1.0)))
    axis = replace(axis, uncertainty={"natural_frequency": 0.5, "gain": 1.0, "damping_ratio": 1.0})
    return StageModel({"x": axis})


def loop(name: str, role: str, seed: int) -> Run:
    """A recording of the position, of a stage with hysteresis."""
    values = {"a": 0.4 * GAIN, "b": 3.0, "c": 0.5, "n": 1.0, "rest": 0.0}
    axis = AxisModel(FREQUENCY, DAMPING_RATIO, GAIN, effects={"bouc_wen": values})
    seen = run(name, role, seed)
    predicted = AxisDynamics("x", axis, max_command=1.0).predict(seen)
    noise = NOISE * np.random.default_rng([seed, 2]).standard_normal(SAMPLES)
    return replace(seen, columns={**seen.columns, "x": np.asarray(predicted) + noise})


@pytest.mark.parametrize(("record", "is_better"), [(run, True), (loop, False)])
def test_hysteresis_must_leave_less_than_a_linear_system(record: Callable[..., Run], is_better: bool) -> None:
    """It imitates the phase of a sensor of acceleration; where it is there, no linear system does as well."""
    runs = [record("one", "identify", 1), record("two", "validate", 2)]
    data = prepare(stage(), runs, None, None, None)
    dynamics, task = case_of(stage(), data, map, lambda _: None)
    begun = calibrate_task(data, task, dynamics)
    (hysteresis,) = (c for c in candidates(dynamics) if c.name == "bouc_wen")
    fit = fit_candidate(begun.task, begun.calibrated, hysteresis)
    assert models_without_physics.is_better_linear(data, begun.calibrated, fit) is is_better


def test_nothing_is_named_in_the_reading_of_an_acceleration() -> None:
    found = diagnose(stage(), [run("one", "identify", 1), run("two", "validate", 2)])
    assert found.verdict == "unknown" and found.effects == ()
    assert models_without_physics.LINEAR_IS_BETTER in found.refusals.values()


def test_linear_effects_are_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    from types import SimpleNamespace

    monkeypatch.setattr(models_without_physics, "_chi2", lambda *_: 0.0)
    axis = SimpleNamespace(natural_frequency=1.0, damping_ratio=0.1)
    data = SimpleNamespace(runs=(1,), responses=(), axis=axis)
    base = SimpleNamespace(model=SimpleNamespace(axis=axis))

    def better(*names: str, **more: object) -> bool:
        solution = SimpleNamespace(problem=SimpleNamespace(dataset=None))
        fit = SimpleNamespace(names=names, fitted_chi2=1.0, solution=solution)
        return models_without_physics.is_better_linear(
            cast(models_without_physics.DiagnosisData, SimpleNamespace(**{**vars(data), **more})), base, fit
        )  # type: ignore[arg-type]

    assert better("creep", "coulomb_friction") and not better("creep", "second_mode")
    assert not better("coulomb_friction", runs=()) and not better("coulomb_friction", responses=(1,))

"""A piezo that is sampled far below its natural frequency, with loops of one amplitude to fit and of others to check.

The recordings are of a simulator of their own: plays behind a lag (Kuhnen 2003, European Journal of Control 9,
407-418). Other models imitate the loops of one sine: a mode about the sampling rate, which remembers each step of a
held command; and functions of position and velocity.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from flexdesign.diagnosis import diagnose
from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.diagnosis.effect_selection.estimation_setup import case_of, find_undetermined
from flexdesign.diagnosis.models_without_physics import is_better_smooth
from flexdesign.diagnosis.preparation.dataset import prepare
from flexdesign.diagnosis.procedure import calibrate_task
from flexdesign.dynamics.signal_chain import exact_step
from flexdesign.dynamics.stage_model import ActuatorData, AxisModel, StageModel
from flexdesign.estimation.model_selection.forward_selection import fit_candidate
from flexdesign.measurements.recordings import Run

PERIOD, NOISE, LAG = 0.005, 60e-9, 0.022
THRESHOLDS, WEIGHTS = (0.15, 0.4, 0.8, 1.3), (1.2e-6, 1.2e-6, 1.2e-6, 1.2e-6)
GAIN = 8e-6


def play(u: NDArray[np.float64], threshold: float) -> NDArray[np.float64]:
    found, now = np.empty_like(u), 0.0
    for k, value in enumerate(u):
        found[k] = now = min(max(now, value - threshold), value + threshold)
    return found


def piezo(name: str, role: str, size: NDArray[np.float64]) -> Run:
    """Return the run of a sine of 1 Hz about 1.8 V with an amplitude that may change [V]."""
    t = PERIOD * np.arange(len(size))
    u = 1.8 + size * np.sin(2 * math.pi * t)
    lagging, now = np.empty_like(u), u[0]
    for k, value in enumerate(u):
        lagging[k] = now = value + (now - value) * math.exp(-PERIOD / LAG)
    x = GAIN * lagging + sum(w * play(lagging, r) for w, r in zip(WEIGHTS, THRESHOLDS, strict=True))
    noise = NOISE * np.random.default_rng(len(name)).standard_normal(len(t))
    return Run(name, t, {"u": u, "x": x + noise}, {"u": "V", "x": "m"}, "hold", role, between_is_stated=True)


def stage(frequency: float) -> StageModel:
    uncertainty = {"natural_frequency": 0.5, "gain": 0.1, "damping_ratio": 1.0}
    actuator = ActuatorData(free_stroke=120e-6, voltage_range=(0.0, 10.0))
    return StageModel({"x": AxisModel(frequency, 0.05, 12e-6, actuator=actuator, uncertainty=uncertainty)})


def recordings() -> list[Run]:
    changing = np.concatenate([np.full(600, 1.6), np.linspace(1.6, 0.0, 200), np.zeros(200), np.linspace(0, 1.7, 400)])
    return [piezo("alike", "identify", np.full(1000, 1.8)), piezo("changing", "validate", changing)]


def test_a_mode_at_the_sampling_rate_does_not_answer_between_its_samples() -> None:
    """After a whole period an undamped mode is where it was, whatever the held command is: e^(2 pi J) is one."""
    w = 2 * math.pi / PERIOD
    passage = exact_step.step(w * np.array([[0.0, 1.0], [-1.0, 0.0]]), w * np.array([0.0, 1.0]), PERIOD)
    assert passage.transition == pytest.approx(np.eye(2), abs=1e-12)
    assert passage.weights.sum(axis=1) == pytest.approx(np.zeros(2), abs=1e-12)


@pytest.mark.parametrize(("frequency", "is_held"), [(300.0, True), (170.0, True), (160.0, False), (60.0, False)])
def test_a_mode_near_the_sampling_rate_and_beyond_is_not_fitted(frequency: float, is_held: bool) -> None:
    """The sampling rate is 200 Hz; the range of the frequency reaches 1.2 times that of the design."""
    data = prepare(stage(frequency), recordings(), None, None, NOISE)
    dynamics, task = case_of(stage(frequency), data, map, lambda _: None)
    assert ("natural_frequency" in find_undetermined(task, dynamics)) is is_held


def test_smooth_functions_that_hold_for_one_amplitude_do_not_stand_for_plays() -> None:
    """Fitted to the loops of one sine they leave less than the plays do, as these lack the lag; not to those of all."""
    model = stage(300.0)
    data = prepare(model, recordings(), None, None, NOISE)
    dynamics, task = case_of(model, data, map, lambda _: None)
    begun = calibrate_task(data, task, dynamics)
    (effect,) = (each for each in candidates(dynamics) if each.name == "prandtl_ishlinskii")
    fit = fit_candidate(begun.task, begun.calibrated, effect)
    assert not is_better_smooth(data, begun.task, begun.calibrated, fit)


@pytest.mark.slow
def test_plays_are_found_in_slow_loops_of_one_amplitude() -> None:
    found = diagnose(stage(300.0), recordings(), noise=NOISE)
    assert found.effects[0].name == "prandtl_ishlinskii"
    assert found.effects[0].share > 0.9
    # The gain of the design is that of the range, between those of small and of large motions: no sensor is off.
    assert not found.conflicts

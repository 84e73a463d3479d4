"""Smooth functions and curves in the place of effects, on a simulator of its own: what a stage lacks besides effects.

The stage is an oscillator with a nonlinear spring. Outside of the catalogue are a sensor that is not straight, a
damping that grows with the displacement, and a spring that the stage touches within a part of its stroke.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest import mock

import numpy as np
import pytest
from numpy.typing import NDArray

from flexdesign.diagnosis import models_without_physics
from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.diagnosis.effect_selection.estimation_setup import case_of
from flexdesign.diagnosis.models_without_physics import is_better_curve, is_better_smooth
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, prepare
from flexdesign.diagnosis.procedure import CalibratedTask, calibrate_task
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import ActuatorData, AxisModel, StageModel
from flexdesign.estimation.model_selection.forward_selection import fit_candidate
from flexdesign.measurements.recordings import Run

FREQUENCY, DAMPING_RATIO, GAIN = 5.5, 0.57, 0.4e-3
PERIOD, SAMPLES, NOISE, STEPS = 0.01, 1000, 3e-7, 10
T = PERIOD * np.arange(SAMPLES)


#: Restoring force over the linear stiffness, beyond the linear one [m].
Spring = Callable[[float], float]


def position(u: NDArray[np.float64], spring: Spring, damped: float) -> NDArray[np.float64]:
    """Return the position under a command that is straight between its samples, by Runge and Kutta's method."""
    w, step = 2 * math.pi * FREQUENCY, PERIOD / STEPS
    fine = np.interp(0.5 * step * np.arange(2 * STEPS * SAMPLES + 1), T, u)

    def rates(x: float, v: float, force: float) -> tuple[float, float]:
        return v, w**2 * (GAIN * force - x - spring(x)) - 2 * DAMPING_RATIO * w * v * (1 + damped * x**2)

    found, x, v = [0.0], 0.0, 0.0
    for k in range(0, 2 * STEPS * (SAMPLES - 1), 2):
        a = rates(x, v, fine[k])
        b = rates(x + step / 2 * a[0], v + step / 2 * a[1], fine[k + 1])
        c = rates(x + step / 2 * b[0], v + step / 2 * b[1], fine[k + 1])
        d = rates(x + step * c[0], v + step * c[1], fine[k + 2])
        x, v = (y + step / 6 * (p + 2 * q + 2 * r + s) for y, p, q, r, s in zip((x, v), a, b, c, d, strict=True))
        if (k + 2) % (2 * STEPS) == 0:
            found.append(x)
    return np.array(found)


def run(name: str, role: str, u: NDArray[np.float64], spring: Spring, damped: float, distorted: float) -> Run:
    x = position(u, spring, damped)
    noise = NOISE * np.random.default_rng(len(name)).standard_normal(SAMPLES)
    columns = {"u": u, "x": x + distorted * x**3 + noise}
    return Run(name, T, columns, {"u": "V", "x": "m"}, "linear", role, between_is_stated=True)


def calibrated(spring: Spring, damped: float, distorted: float) -> tuple[DiagnosisData, CalibratedTask, AxisDynamics]:
    """Return the data of three runs, the calibration of a linear model, and that model."""
    sines = 0.6 * np.sin(2 * math.pi * 1.0 * T) + 0.3 * np.sin(2 * math.pi * 3.1 * T)
    steps = 0.9 * np.sign(np.sin(2 * math.pi * 0.4 * T)) * (T > 1.25)
    runs = [
        run("sines", "identify", sines, spring, damped, distorted),
        run("steps", "identify", steps, spring, damped, distorted),
        run("other sines", "validate", 0.9 * sines[::-1], spring, damped, distorted),
    ]
    axis = AxisModel(5.0, 0.5, GAIN, actuator=ActuatorData(free_stroke=GAIN, voltage_range=(-1.0, 1.0)))
    axis = replace(axis, uncertainty={"natural_frequency": 0.5, "gain": 0.5, "damping_ratio": 1.0})
    stage = StageModel({"x": axis})
    data = prepare(stage, runs, None, None, NOISE)
    dynamics, task = case_of(stage, data, map, lambda _: None)
    return data, calibrate_task(data, task, dynamics), dynamics


@pytest.mark.parametrize(
    ("name", "cubic", "damped", "distorted", "expected"),
    [
        ("stress_stiffening", 3e6, 4e6, -0.4e6, False),  # it is there, next to the others
        ("asymmetric_hysteresis", 3e6, 1e7, -0.4e6, True),  # it imitates them
        ("stress_stiffening", 0.0, 0.0, -0.4e6, True),  # it imitates the sensor
    ],
)
def test_an_effect_is_needed_next_to_what_else_the_model_lacks(
    name: str, cubic: float, damped: float, distorted: float, expected: bool
) -> None:
    data, begun, dynamics = calibrated(lambda x: cubic * x**3, damped, distorted)
    (effect,) = (each for each in candidates(dynamics) if each.name == name)
    fit = fit_candidate(begun.task, begun.calibrated, effect)
    assert is_better_smooth(data, begun.task, begun.calibrated, fit) is expected


@pytest.mark.parametrize(
    ("spring", "names", "expected"),
    [
        # A spring from 0.05 to 0.15 mm: three effects are the first terms of a series for it, one effect is no series.
        (lambda x: 0.3 * min(max(x - 0.05e-3, 0.0), 0.1e-3), ("preload_loss", "quadratic_stiffness", "creep"), True),
        (lambda x: 0.3 * min(max(x - 0.05e-3, 0.0), 0.1e-3), ("preload_loss", "creep"), False),
        # Both are there, next to a damping that is not in the catalogue.
        (lambda x: 300.0 * x**2 + 3e6 * x**3, ("quadratic_stiffness", "stress_stiffening"), False),
    ],
)
def test_effects_that_are_terms_of_another_curve_explain_less_than_a_curve(
    spring: Spring, names: tuple[str, ...], expected: bool
) -> None:
    data, begun, dynamics = calibrated(spring, 1e6, 0.0)
    fit = begun.calibrated
    for name in names:
        (effect,) = (each for each in candidates(dynamics) if each.name == name)
        fit = fit_candidate(begun.task, fit, effect)
    assert is_better_curve(data, begun.task, begun.calibrated, fit) is expected


@pytest.mark.parametrize(
    ("linear", "curve", "smooth", "expected"),
    [
        (True, True, True, "the model lacks linear dynamics"),
        (False, True, True, "a contact within a part of the stroke"),
        (False, False, True, "smooth functions of position"),
        (False, False, False, ""),
    ],
)
def test_the_answer_says_what_kind_of_model_explains_more(
    linear: bool, curve: bool, smooth: bool, expected: str
) -> None:
    none: Any = None
    with mock.patch.multiple(
        models_without_physics,
        is_better_linear=lambda *_: linear,
        is_better_curve=lambda *_: curve,
        is_better_smooth=lambda *_: smooth,
    ):
        said = models_without_physics.better_kind(none, none, none, none)
    assert expected in said and bool(said) == bool(expected)

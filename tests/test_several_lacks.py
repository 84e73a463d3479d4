"""Smooth functions in the place of effects, on a simulator of its own: a stage that lacks an effect and more besides.

The stage is Duffing's oscillator. Outside of the catalogue are a sensor that is not straight, and a damping that grows
with the displacement.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.diagnosis.effect_selection.estimation_setup import calibrate_task, case_of
from flexdesign.diagnosis.models_without_physics import is_better_smooth
from flexdesign.diagnosis.preparation.dataset import prepare
from flexdesign.dynamics.stage_model import ActuatorData, AxisModel, StageModel
from flexdesign.estimation.model_selection.forward_selection import fit_candidate
from flexdesign.measurements.recordings import Run

FREQUENCY, DAMPING_RATIO, GAIN = 5.5, 0.57, 0.4e-3
PERIOD, SAMPLES, NOISE, STEPS = 0.01, 1000, 3e-7, 10
T = PERIOD * np.arange(SAMPLES)


def position(u: NDArray[np.float64], cubic: float, damped: float) -> NDArray[np.float64]:
    """Return the position under a command that is straight between its samples, by Runge and Kutta's method."""
    w, step = 2 * math.pi * FREQUENCY, PERIOD / STEPS
    fine = np.interp(0.5 * step * np.arange(2 * STEPS * SAMPLES + 1), T, u)

    def rates(x: float, v: float, force: float) -> tuple[float, float]:
        return v, w**2 * (GAIN * force - x - cubic * x**3) - 2 * DAMPING_RATIO * w * v * (1 + damped * x**2)

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


def run(name: str, role: str, u: NDArray[np.float64], cubic: float, damped: float, distorted: float) -> Run:
    x = position(u, cubic, damped)
    noise = NOISE * np.random.default_rng(len(name)).standard_normal(SAMPLES)
    columns = {"u": u, "x": x + distorted * x**3 + noise}
    return Run(name, T, columns, {"u": "V", "x": "m"}, "linear", role, between_is_stated=True)


@pytest.mark.parametrize(
    ("name", "cubic", "damped", "distorted", "expected"),
    [
        ("stress_stiffening", 3e6, 4e6, -0.4e6, False),  # it is there, next to the others
        ("asymmetric_hysteresis", 6e6, 1e7, -0.4e6, True),  # it imitates them
        ("stress_stiffening", 0.0, 0.0, -0.4e6, True),  # it imitates the sensor
    ],
)
def test_an_effect_is_needed_next_to_what_else_the_model_lacks(
    name: str, cubic: float, damped: float, distorted: float, expected: bool
) -> None:
    sines = 0.6 * np.sin(2 * math.pi * 1.0 * T) + 0.3 * np.sin(2 * math.pi * 3.1 * T)
    steps = 0.9 * np.sign(np.sin(2 * math.pi * 0.4 * T)) * (T > 1.25)
    runs = [
        run("sines", "identify", sines, cubic, damped, distorted),
        run("steps", "identify", steps, cubic, damped, distorted),
        run("other sines", "validate", 0.9 * sines[::-1], cubic, damped, distorted),
    ]
    axis = AxisModel(5.0, 0.5, GAIN, actuator=ActuatorData(free_stroke=GAIN, voltage_range=(-1.0, 1.0)))
    axis = replace(axis, uncertainty={"natural_frequency": 0.5, "gain": 0.5, "damping_ratio": 1.0})
    stage = StageModel({"x": axis})
    data = prepare(stage, runs, None, None, NOISE)
    dynamics, task = case_of(stage, data, map, lambda _: None)
    begun = calibrate_task(data, task, dynamics)
    (effect,) = (each for each in candidates(dynamics) if each.name == name)
    fit = fit_candidate(begun.task, begun.calibrated, effect)
    assert is_better_smooth(data, begun.task, begun.calibrated, fit) is expected

"""Friction by another law than that of the catalogue: F tanh(v / v_s), integrated by SciPy with no code of the engine.

The stage is a mass on a spring of 18.3 N/mm with 0.06 N of friction that turns over within 50 um/s; readings have 20 nm
of noise. Dahl's law describes it but for the turns, so that a remainder stays: that must not hide the friction, nor
call for effects that are not there.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from flexdesign.diagnosis import Diagnosis, diagnose
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.measurements.recordings import Run

Array = NDArray[np.float64]
STIFFNESS, FREQUENCY, DAMPING, GAIN = 18.3e3, 118.0, 0.02, 1.2e-6
FRICTION, TURNS_OVER, NOISE = 0.06, 50e-6, 20e-9
PERIOD = 1e-3
#: What a user would write: numbers that are a little off, and how well they are known.
MODEL = AxisModel(
    1.03 * FREQUENCY, 0.025, 1.02 * GAIN, uncertainty={"natural_frequency": 0.05, "damping_ratio": 0.5, "gain": 0.05}
)
#: Friction over stiffness, by which the catalogue measures it [m].
LEVEL = FRICTION / STIFFNESS


def commands() -> dict[str, Array]:
    """Slow triangles of two sizes, a multisine and steps to fit; a decaying sine and other steps to judge [V]."""
    t, rng = PERIOD * np.arange(4000), np.random.default_rng(3)
    quiet = np.minimum(t / 0.3, 1.0)
    tones = 4.0 * np.arange(1, 15)
    multisine = sum(np.sin(2 * math.pi * f * t + rng.uniform(0, 2 * math.pi)) for f in tones)
    return {
        "triangle_large": 40 + 40 * (4 * np.abs((t + 0.5) % 1 - 0.5) - 1),
        "triangle_small": quiet * (30 + 8 * np.sin(2 * math.pi * 2 * t)),
        "multisine": quiet * (35 + 20 * multisine / np.abs(multisine).max()),
        "steps": np.repeat(rng.uniform(5, 75, 16), 250),
        "decaying_sine": quiet * (40 + 35 * np.exp(-t / 2) * np.sin(2 * math.pi * 3 * t)),
        "levels": np.repeat(rng.uniform(10, 70, 16), 250),
    }


def motion(command: Array) -> Array:
    """Return the positions of the mass at the samples [m]; the command is straight between its samples."""
    w = 2 * math.pi * FREQUENCY
    mass = STIFFNESS / w**2
    t = PERIOD * np.arange(len(command))

    def rates(time: float, state: Array) -> list[float]:
        place = min(int(time / PERIOD), len(command) - 2)
        u = command[place] + (command[place + 1] - command[place]) * (time / PERIOD - place)
        friction = FRICTION / mass * math.tanh(state[1] / TURNS_OVER)
        return [state[1], w**2 * (GAIN * u - state[0]) - 2 * DAMPING * w * state[1] - friction]

    start = [GAIN * command[0], 0.0]
    found = solve_ivp(rates, (0, t[-1]), start, "LSODA", t, max_step=PERIOD / 2, rtol=1e-7, atol=[1e-10, 1e-8])
    assert found.success
    return np.asarray(found.y[0])


def recordings(structural: float) -> list[Run]:
    """Return runs; a structural error of some share of the stroke, rms, is periodic in position, as no effect is."""
    rng, stroke, runs = np.random.default_rng(8), 80 * GAIN, []
    for name, command in commands().items():
        x = motion(command)
        reading = x + structural * stroke * math.sqrt(2) * np.sin(2 * math.pi * x / (0.13 * stroke))
        role = "validate" if name in ("decaying_sine", "levels") else "identify"
        columns = {"u": command, "x": reading + NOISE * rng.standard_normal(len(x))}
        time = PERIOD * np.arange(len(x))
        runs.append(Run(name, time, columns, {"u": "V", "x": "m"}, "linear", role, between_is_stated=True))
    return runs


def test_the_simulator_holds_friction_back() -> None:
    """On a slow triangle the loop is as wide as twice the friction over the stiffness."""
    command = commands()["triangle_large"]
    x = motion(command)
    off = x - GAIN * command
    rising, middle = np.gradient(command) > 0, np.abs(command - 40) < 20
    width = np.mean(off[~rising & middle]) - np.mean(off[rising & middle])
    damping = 2 * DAMPING / (2 * math.pi * FREQUENCY) * 2 * 160 * GAIN  # of the viscous damper, at 160 V/s both ways
    assert width == pytest.approx(2 * LEVEL + damping, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("structural", [0.0, 4e-4], ids=["noise alone", "structural error of 0.04 % of the stroke"])
def test_friction_of_another_law_is_named_with_its_remainder(structural: float) -> None:
    found: Diagnosis = diagnose(StageModel({"x": MODEL}), recordings(structural), noise=NOISE)
    assert found.verdict == "effects-found"
    assert [effect.name for effect in found.effects] == ["coulomb_friction"]
    level = next(v for v in found.effects[0].values if v.parameter.name.endswith("level"))
    # At the speeds of these runs, 50 to 500 um/s, tanh is between 0.76 and 1: the constant of the catalogue is lower.
    assert 0.76 * LEVEL < level.value < LEVEL
    assert found.remainder_rms > 0 and found.remainder

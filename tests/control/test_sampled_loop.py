"""Stability boundaries against closed forms, responses against python-control and against the analytic step."""

from __future__ import annotations

import math

import control as ct
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexdesign.core.errors import InputError
from flexdesign.dynamics.control.pid import PID, controller
from flexdesign.dynamics.control.plant import Plant
from flexdesign.dynamics.control.sampled_loop import matrices, open_loop, settling_time, simulate, stable_ranges

PERIOD = 1e-3


def test_all_stable_ranges_of_random_loops_are_found() -> None:
    """Against closed-loop poles at 400 gains for each of 150 loops; some have several ranges, or one above zero."""
    random, several, above_zero = np.random.default_rng(11), 0, 0
    gains = np.geomspace(1e-2, 1e2, 400)
    for _ in range(150):
        zeros, poles = (random.uniform(0.3, 1.1, 2) * np.exp(1j * random.uniform(0, math.pi, 2)) for _ in range(2))
        up, down = (np.poly([*r, *r.conj()]).real for r in (zeros, poles))
        ranges = stable_ranges(matrices(ct.tf(up[1:], down, 1.0)))
        up = np.concatenate([[0.0], up[1:]])
        brute = np.array([np.max(np.abs(np.roots(down + k * up))) for k in gains]) < 1
        inside = np.zeros(len(gains), dtype=bool)
        for low, high in ranges:
            inside |= (gains > low.gain) & (gains < high.gain)
        np.testing.assert_array_equal(inside, brute)
        several += len(ranges) > 1
        above_zero += bool(ranges) and ranges[0].low.gain > 0
    assert several > 0
    assert above_zero > 3


@given(
    frequency=st.floats(20.0, 450.0),
    damping=st.floats(1e-3, 2.0),
    delay=st.floats(0.0, 4e-3),
    second=st.floats(0.0, 0.5),
)
def test_closed_loop_poles_lie_on_the_circle_at_the_first_boundary(
    frequency: float, damping: float, delay: float, second: float
) -> None:
    loop = matrices(Plant(3.0, frequency, damping, delay, ((2.3 * frequency, damping, second),)).discretise(PERIOD))
    low, high = stable_ranges(loop)[0]
    assert low.gain == 0
    if math.isfinite(high.gain):
        # The boundary is polished to 1e-14 in frequency; 1e-6 in gain moves the poles by more than rounding does.
        assert loop.is_stable(high.gain * (1 - 1e-6))
        assert not loop.is_stable(high.gain * (1 + 1e-6))


def test_open_loop_is_the_product_of_python_controls_parts() -> None:
    plant, pid = Plant(6.0777, 118.3, 0.0242, 1.4e-3), PID(0.01355, 3.988e-3, 0.997e-3)
    z = np.exp(1j * np.array([0.05, 0.7, 2.0]))
    theirs = pid.transfer_function(PERIOD)(z) * plant.discretise(PERIOD)(z)
    np.testing.assert_allclose(open_loop(plant, pid, PERIOD)(z), theirs, rtol=1e-10)


def test_step_response_at_samples_is_python_controls() -> None:
    plant, pid = Plant(6.0777, 118.3, 0.0242), PID(0.01355, 3.988e-3, 0.997e-3)
    closed = ct.feedback(pid.transfer_function(PERIOD) * ct.tf(plant.discretise(PERIOD)), 1)
    theirs = ct.step_response(closed, np.arange(200) * PERIOD).outputs
    ours = simulate(plant, pid, np.ones(200), PERIOD, substeps=4).output[::4]
    np.testing.assert_allclose(ours, theirs, atol=1e-8)


def test_the_kernel_in_the_loop_gives_the_same_commands() -> None:
    plant = Plant(6.0777, 118.3, 0.0242, 0.4e-3)
    pid = PID(-0.05, -1.8e-3, -2.9e-3, proportional_weight=0.3, derivative_weight=0.1, derivative_filter=0.4e-3)
    reference = np.sin(0.1 * np.arange(100))
    stage, made = plant.sampled(PERIOD), controller(pid)
    x, state, numbers = np.zeros(len(stage.a)), np.zeros(5), np.array(made.constants(made.values, PERIOD))
    theirs = []
    for r in reference:
        theirs.append(made.tick(r, float(stage.c @ x), 0.0, state, numbers))
        x = stage.a @ x + stage.b * theirs[-1]
    np.testing.assert_allclose(simulate(plant, pid, reference, PERIOD).command, theirs, atol=1e-12)


def test_open_loop_step_is_the_textbooks() -> None:
    """y = 1 - exp(-zeta w t)(cos wd t + zeta / sqrt(1 - zeta^2) sin wd t), held or not: a step is held anyway."""
    zeta, w = 0.0242, 2 * math.pi * 118.3
    run = simulate(Plant(6.0777, 118.3, zeta), None, np.ones(500), PERIOD)
    wd, slant = w * math.sqrt(1 - zeta**2), zeta / math.sqrt(1 - zeta**2)
    exact = 1 - np.exp(-zeta * w * run.time) * (np.cos(wd * run.time) + slant * np.sin(wd * run.time))
    np.testing.assert_allclose(run.output, exact, atol=1e-10)
    # The envelope enters the band at `latest`; the last swing outside is at most half a period before.
    latest = math.log(50 / math.sqrt(1 - zeta**2)) / (zeta * w)
    assert latest - math.pi / wd <= settling_time(run.time, run.output, 1.0) <= latest


def test_integral_action_removes_a_load() -> None:
    run = simulate(Plant(2.0, 118.3, 0.5), PID(0.05, 2e-3), np.ones(400), PERIOD, load=0.3)
    assert run.output[-1] == pytest.approx(1.0, abs=1e-6)
    assert run.command[-1] == pytest.approx(0.5 - 0.3, abs=1e-6)


def test_what_never_settles_takes_for_ever() -> None:
    assert settling_time([0.0, 1.0], [1.0, math.nan], 1.0) == math.inf
    assert settling_time([0.0, 1.0], [0.0, 0.5], 1.0) == math.inf


def test_a_reference_with_gaps_is_refused() -> None:
    with pytest.raises(InputError, match="loop: reference"):
        simulate(Plant(2.0, 118.3, 0.5), None, [1.0, math.nan], PERIOD)

"""Three forms of one controller: the printed sum, the kernel and the transfer function."""

from __future__ import annotations

import math

import control as ct
import numpy as np
import pytest
from numba import njit

from flexdesign.core.errors import InputError
from flexdesign.dynamics.control.pid import PID, controller, tick

PERIOD = 1e-3
PRINTED = PID(0.01355, 3.988e-3, 0.997e-3)
ALL = PID(1.3, 3e-3, 1e-3, proportional_weight=0.4, derivative_weight=0.2, derivative_filter=2e-3)
KINDS = [
    PRINTED,
    ALL,
    PID(1.3),
    PID(1.3, td=1e-3),
    PID(1.3, td=1e-3, derivative_filter=1e-3),
    PID(2.0, 2e-3),
    PID(-0.3, -2e-3, -3e-3),
]
RNG = np.random.default_rng(5)
REFERENCE, READING = RNG.normal(size=(2, 60))


def commands(pid: PID, excess: np.ndarray | None = None) -> np.ndarray:
    made = controller(pid)
    state, numbers = np.zeros(len(made.states)), np.array(made.constants(made.values, PERIOD))
    cut = np.zeros(60) if excess is None else excess
    return np.array([made.tick(REFERENCE[k], READING[k], cut[k], state, numbers) for k in range(60)])


def test_the_kernel_is_equation_33() -> None:
    p, e = PRINTED, np.concatenate([[0.0, 0.0], REFERENCE - READING])
    change = p.kp * ((e[2:] - e[1:-1]) + PERIOD / p.ti * e[2:] + p.td / PERIOD * (e[2:] - 2 * e[1:-1] + e[:-2]))
    np.testing.assert_allclose(commands(p), np.cumsum(change), atol=1e-14)


@pytest.mark.parametrize("pid", KINDS)
def test_transfer_function_and_states_are_the_kernel(pid: PID) -> None:
    own = pid.realised(PERIOD)
    x, ours = np.zeros(len(own.a)), []
    for r, y in zip(REFERENCE, READING, strict=True):
        ours.append(own.c @ x + own.d_reference * r + own.d_reading * y)
        x = own.a @ x + own.b_reference * r + own.b_reading * y
    np.testing.assert_allclose(ours, commands(pid), atol=1e-12)
    if pid is not ALL:  # the weights have no part in the transfer function
        error = REFERENCE - READING
        theirs = ct.forced_response(pid.transfer_function(PERIOD), inputs=error).outputs
        np.testing.assert_allclose(theirs, commands(pid), atol=1e-10)


def test_the_kernel_compiles_and_agrees_with_itself() -> None:
    made, compiled = controller(ALL), njit(tick)
    state, numbers = np.zeros(len(made.states)), np.array(made.constants(made.values, PERIOD))
    compiled_commands = [compiled(REFERENCE[k], READING[k], 0.0, state, numbers) for k in range(60)]
    np.testing.assert_allclose(compiled_commands, commands(ALL), atol=1e-13)


def test_at_a_limit_the_integral_does_not_wind_up() -> None:
    """After a second at the limit an error of the other sign must pull the command off it at once."""
    made = controller(PID(1.0, 10e-3))
    state, numbers = np.zeros(len(made.states)), np.array(made.constants(made.values, PERIOD))
    excess, applied = 0.0, 0.0
    for _ in range(1000):
        requested = made.tick(10.0, 0.0, excess, state, numbers)
        applied = min(requested, 5.0)
        excess = requested - applied
    assert applied == 5.0
    requested = made.tick(-1.0, 0.0, excess, state, numbers)
    # Eq (33) from the limit: 5 + Kp (de + T/Ti e) = 5 + (-11 - 0.1).
    assert requested == pytest.approx(5.0 - 11.0 - 0.1)


def test_a_proportional_controller_forgets_the_limit() -> None:
    excess = np.zeros(60)
    excess[10] = 3.0
    np.testing.assert_array_equal(commands(PID(1.3), excess), commands(PID(1.3)))


@pytest.mark.parametrize(
    ("numbers", "field"),
    [({"kp": math.nan}, "kp"), ({"kp": 1.0, "ti": 0.0}, "ti"), ({"kp": 1.0, "derivative_filter": -1.0}, "filter")],
)
def test_what_is_no_controller_is_refused(numbers: dict[str, float], field: str) -> None:
    with pytest.raises(InputError, match=f"controller: .*{field}"):
        PID(**numbers)

"""Exact steps of linear systems, against SciPy's matrix exponential and a tight integration."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from flexdesign.dynamics.signal_chain import exact_step


@pytest.mark.parametrize("until", [0.5, 1.0])
def test_a_step_is_the_passage_under_a_parabola(until: float) -> None:
    a, b, values = np.array([[0.0, 1.0], [-50.0, -2.0]]), np.array([0.0, 50.0]), np.array([1.0, -2.0, 0.5])
    parabola = np.polyfit([0.0, 0.15, 0.3], values, 2)
    start = np.array([0.1, 0.2])
    right = solve_ivp(
        lambda t, x: a @ x + b * np.polyval(parabola, t), (0, 0.3 * until), start, rtol=1e-12, atol=1e-13
    ).y[:, -1]
    passed = exact_step.step(a, b, 0.3, until)
    assert passed.transition @ start + passed.weights @ values == pytest.approx(right, abs=1e-11)


@given(st.floats(1e-6, 30.0), st.floats(0.0, 3.0))
def test_transition_is_the_matrix_exponential(angle: float, damping: float) -> None:
    a = angle * np.array([[0.0, 1.0], [-1.0, -2.0 * damping]])
    assert exact_step.step(a, np.array([0.0, 1.0]), 1.0).transition == pytest.approx(expm(a), abs=1e-12)

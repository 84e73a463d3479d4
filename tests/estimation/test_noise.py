"""The colour of residuals, against the autocorrelations that textbooks give in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import toeplitz

from flexdesign.estimation.noise.autoregressive import Process, process_of
from tests.estimation.toys import ar1


@pytest.mark.parametrize("rho", [-0.5, 0.3, 0.9])
def test_quadratic_form_is_that_of_the_correlation_matrix(rho: float) -> None:
    """An AR(1) process has the autocorrelation rho^k. Lags beyond twice the length wrap around: 0.9^120 is 3e-6."""
    n = 120
    columns = np.random.default_rng(0).standard_normal((n, 3))
    matrix = toeplitz(rho ** np.arange(n))
    found = Process.from_coefficients(np.array([1.0, -rho]), 1.0)
    assert found.quadratic(columns) == pytest.approx(columns.T @ matrix @ columns, rel=1e-4, abs=1e-3)
    assert found.inflation(n) == pytest.approx((1 + rho**2) / (1 - rho**2), rel=1e-4)


def test_white_residuals_are_found_white_and_counted_one_by_one() -> None:
    """An order too many costs log(400) = 6: chi^2 of one degree exceeds it once in 70, and there are a few orders."""
    residuals = np.random.default_rng(0).standard_normal((300, 400))
    white = [process_of(residual) for residual in residuals]
    assert np.mean([not c.order for c in white]) > 0.94
    chosen = next(c for c in white if not c.order)
    assert chosen.inflation(400) == 1.0
    assert np.array_equal(chosen.quadratic(residuals[:2].T), residuals[:2] @ residuals[:2].T)


def test_coefficients_of_a_long_record_are_recovered() -> None:
    """AR(2) with poles at 0.95 exp(+-0.5 i); the standard error of the coefficients is sqrt((1 - a2^2) / n)."""
    rng = np.random.default_rng(1)
    a1, a2 = -2 * 0.95 * math.cos(0.5), 0.95**2
    x = np.zeros(20_000)
    drive = rng.standard_normal(len(x))
    for k in range(2, len(x)):
        x[k] = drive[k] - a1 * x[k - 1] - a2 * x[k - 2]
    found = process_of(x[1000:])
    assert found.coefficients[:3] == pytest.approx([1.0, a1, a2], abs=4 * math.sqrt((1 - a2**2) / len(x)))


def test_short_and_vanishing_residuals_are_taken_for_white() -> None:
    assert not process_of(ar1(np.random.default_rng(0), 20, 1.0, 0.9)).order
    assert not process_of(np.zeros(100)).order
    assert not process_of(np.zeros(0)).order

"""Coloured noise: whitening against covariance matrices in closed form, and against the noise itself."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from flexdesign.core.errors import InputError
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process

Array = NDArray[np.float64]
SLOW = Process.from_coefficients(np.array([1.0, -0.98]), 0.3)
#: Poles at 0.95 exp(+-0.5 i).
RINGING = Process.from_coefficients(np.array([1.0, -2 * 0.95 * np.cos(0.5), 0.95**2]), 2.0)


@dataclass
class Given:
    values: NDArray[Any]
    name: str = "run"
    role: str = "identify"

    def measured(self) -> NDArray[Any]:
        return self.values


def covariance(process: Process, n: int) -> Array:
    """The covariance matrix, from the impulse response alone: sum of h_k h_(k+lag) sigma^2."""
    response = lfilter([1.0], process.coefficients, np.eye(1, 4000)[0])
    lags = [response[: 4000 - k] @ response[k:] for k in range(n)]
    return np.asarray(process.sigma**2 * toeplitz(lags))


@pytest.mark.parametrize("process", [Process(np.zeros(0), 0.5), SLOW, RINGING], ids=["white", "slow", "ringing"])
def test_whitening_is_the_inverse_root_of_the_covariance(process: Process) -> None:
    """W C W' is the identity, and W is lower triangular, so that its diagonal gives the determinant."""
    n = 60
    whitening, matrix = process.whiten(np.eye(n)), covariance(process, n)
    assert whitening @ matrix @ whitening.T == pytest.approx(np.eye(n), abs=1e-9)
    assert np.array_equal(whitening, np.tril(whitening))
    assert np.log(np.diag(whitening)).sum() == pytest.approx(-0.5 * np.linalg.slogdet(matrix)[1], rel=1e-9)
    assert process.rms == pytest.approx(np.sqrt(matrix[0, 0]), rel=1e-9)


def test_gaps_cut_a_record_into_independent_ones() -> None:
    n, columns = 50, np.random.default_rng(0).standard_normal((50, 3))
    measured = np.zeros(n)
    measured[[0, 20, 21, 22, 40]] = np.nan
    whitened = ColouredNoise(RINGING).whiten(Given(measured), columns)
    assert not whitened[np.isnan(measured)].any()
    for part in (slice(1, 20), slice(23, 40), slice(41, 50)):
        assert whitened[part] == pytest.approx(RINGING.whiten(columns[part]), abs=1e-12)


def test_whitened_noise_has_variance_one_from_the_first_sample_on() -> None:
    """AR(1) with 0.98. Of 4000 records the variance at one sample has a standard error of sqrt(2 / 4000) = 0.022."""
    rng = np.random.default_rng(1)
    noise = np.empty((200, 4000))
    noise[0] = SLOW.rms * rng.standard_normal(4000)
    for k in range(1, 200):
        noise[k] = 0.98 * noise[k - 1] + SLOW.sigma * rng.standard_normal(4000)
    measured = np.zeros(200)
    measured[100:103] = np.nan
    whitened = ColouredNoise(SLOW).whiten(Given(measured), noise)
    there = np.isfinite(measured)
    assert np.abs(whitened[[0, 1, 99, 103, 104]].var(axis=1) - 1).max() < 4 * 0.0224
    assert np.abs(whitened[there].var(axis=1) - 1).max() < 5 * 0.0224
    lagged = np.mean(whitened[there][1:] * whitened[there][:-1])
    assert abs(lagged) < 4 / np.sqrt(196 * 4000)


@pytest.mark.parametrize("process", [SLOW, RINGING], ids=["slow", "ringing"])
def test_spectrum_and_correlation_are_those_of_the_process(process: Process) -> None:
    """The density integrates to the variance; the correlation is the covariance over its first entry."""
    period, n = 1e-3, 20_000
    frequency = (np.arange(n) + 0.5) / (2 * n * period)
    assert np.mean(process.density(frequency, period)) / (2 * period) == pytest.approx(process.rms**2, rel=1e-6)
    matrix = covariance(process, 300)
    assert process.autocorrelation(200) == pytest.approx(matrix[0, :200] / matrix[0, 0], abs=1e-5)


def test_one_in_fifty_slow_samples_counts() -> None:
    """Bartlett: (1 + rho^2) / (1 - rho^2)."""
    assert SLOW.inflation(1000) == pytest.approx((1 + 0.98**2) / (1 - 0.98**2), rel=1e-4)


def test_twenty_columns_of_eighty_seconds_take_well_under_a_tenth_of_a_second() -> None:
    columns, observation = np.zeros((80_000, 20)), Given(np.zeros(80_000))
    began = perf_counter()
    ColouredNoise(RINGING).whiten(observation, columns)
    assert perf_counter() - began < 0.5  # 0.03 s on an idle core; the margin is for a busy one


def test_what_cannot_be_whitened_is_refused() -> None:
    with pytest.raises(InputError, match="without bound"):
        Process.from_coefficients(np.array([1.0, -1.02]), 1.0)
    with pytest.raises(InputError, match="above zero"):
        Process(np.zeros(0), 0.0)
    with pytest.raises(InputError, match=r"noise\.run"):
        ColouredNoise({"other": SLOW}).whiten(Given(np.zeros(5)), np.zeros((5, 1)))
    with pytest.raises(InputError, match="measured are 5"):
        ColouredNoise(SLOW).whiten(Given(np.zeros(5)), np.zeros((4, 1)))

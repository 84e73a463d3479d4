"""What a measured command does between its samples: beside the same signal sampled sixteen times as finely."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexdesign.dynamics.signal_chain.chain import AxisChain, Oscillator
from flexdesign.dynamics.signal_chain.interpolation import derivatives, smooth
from flexdesign.dynamics.simulate import Loop, Stage, simulate

FREQUENCIES = (13.0, 41.0, 68.0, 110.0)
PERIOD = 1 / 610.0
AXIS = AxisChain("x", 1e-6, (Oscillator(68.0, 0.05),))


def _signal(time: np.ndarray) -> np.ndarray:
    """Return four sines under a window that begins and ends at zero with all its derivatives small."""
    window = np.sin(np.pi * np.clip(time / 2.0, 0, 1)) ** 4
    return window * sum(np.cos(2 * math.pi * f * time + f) for f in FREQUENCIES)


def _motion(fineness: int, between: str, delay: float = 0.0, oversampling: int = 1) -> np.ndarray:
    time = PERIOD / fineness * np.arange(1220 * fineness + 1)
    found = simulate(
        Stage((AXIS,)),
        {"x": Loop(_signal(time))},
        PERIOD / fineness,
        between_samples=between,
        delay=delay,
        oversampling=oversampling,
        tolerance=1e-6,
    )
    return found.motion[0, :: fineness * oversampling]


@pytest.fixture(scope="module")
def exact() -> np.ndarray:
    """Return the motion with lines between samples sixteen times as fine: wrong by (w h / 16)^2 / 12, 2e-4 at 68 Hz."""
    return _motion(16, "linear")


def _error(motion: np.ndarray, exact: np.ndarray) -> float:
    return float(np.sqrt(np.mean((motion - exact) ** 2) / np.mean(exact**2)))


def test_a_smooth_command_is_what_its_samples_say(exact: np.ndarray) -> None:
    # Cubics are wrong by (w h)^4 / 720: 3e-4 at the mode, 2e-3 at 110 Hz, of which the mode passes a tenth.
    assert _error(_motion(1, "smooth"), exact) < 1e-3


def test_lines_between_samples_are_not(exact: np.ndarray) -> None:
    # (w h)^2 / 12 at the mode, 4.1 %, is what makes lines look like a gain that falls with frequency.
    assert _error(_motion(1, "linear"), exact) == pytest.approx((2 * math.pi * 68 * PERIOD) ** 2 / 12, rel=0.1)


def test_a_delay_by_a_part_of_a_sample_keeps_it_smooth() -> None:
    late = 0.37 * PERIOD
    assert _error(_motion(1, "smooth", late), _motion(16, "linear", late)) < 1e-3


def test_more_samples_of_the_response_see_the_same_command(exact: np.ndarray) -> None:
    assert _error(_motion(1, "smooth", oversampling=4), exact) < 1e-3


def test_values_at_the_samples_are_kept() -> None:
    values = np.random.default_rng(1).normal(size=50)
    assert np.array_equal(smooth(values, np.arange(49.0)), values[:-1])


def test_slopes_of_few_samples_exist() -> None:
    assert np.array_equal(derivatives(np.ones(1)), np.zeros(1))
    assert derivatives(np.array([0.0, 1.0])).shape == (2,)

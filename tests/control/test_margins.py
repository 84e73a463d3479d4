"""Margins against closed forms, python-control on plain loops, and brute force where its margins cannot be trusted."""

from __future__ import annotations

import math

import control as ct
import numpy as np
import pytest

from flexdesign.dynamics.control.margins import margins
from flexdesign.dynamics.control.pid import PID
from flexdesign.dynamics.control.plant import Plant
from flexdesign.dynamics.control.sampled_loop import matrices, open_loop

PERIOD = 1e-3
LIGHT = Plant(6.0777, 118.3, 0.0242)
LAGGING = Plant(20.0, 80.0, 0.7, lags=(0.5e-3, 0.05e-3))
PRINTED = PID(0.01355, 3.988e-3, 0.997e-3)


def test_integrator_with_one_sample_of_delay() -> None:
    """L = g / (z (z - 1)): poles reach the circle at g = 1; |L| = 1 where 2 sin(w/2) = g, phase -90 deg - 3 w/2."""
    g = 0.3
    found = margins(ct.tf([g], [1, -1, 0], PERIOD))
    w = 2 * math.asin(g / 2)
    assert found.gain_margin == pytest.approx(1 / g, rel=1e-9)
    assert found.phase_margin == pytest.approx(90 - math.degrees(1.5 * w), rel=1e-9)
    assert found.delay_margin == pytest.approx((math.pi / 2 - 1.5 * w) / w * PERIOD, rel=1e-9)


@pytest.mark.parametrize("plant", [LIGHT, Plant(6.3621, 133.0, 0.099), Plant(20.0, 80.0, 0.7), LAGGING])
def test_agrees_with_python_control_where_the_loop_is_plain(plant: Plant) -> None:
    loop = open_loop(plant, PRINTED, PERIOD)
    ours = margins(loop)
    gain_margin, phase_margin, *_ = ct.stability_margins(loop)
    assert ours.gain_margin == pytest.approx(gain_margin, rel=1e-6)
    assert ours.phase_margin == pytest.approx(phase_margin, rel=1e-6)
    # Its distance from -1 is not used: on the first of these loops it returns 1/1.72, where a plain grid has 1/3.53.
    z = np.exp(1j * np.linspace(1e-3, math.pi, 20001))
    assert ours.ms == pytest.approx(np.max(np.abs(1 / (1 + loop(z)))), rel=1e-3)


def test_the_margins_of_a_vanishing_lag_tend_to_those_of_none() -> None:
    every: tuple[tuple[float, ...], ...] = ((), (10e-6,), (1e-6,))
    plain, wide, narrow = (margins(open_loop(Plant(20.0, 80.0, 0.7, lags=lags), PRINTED, PERIOD)) for lags in every)
    for name in ("gain_margin", "phase_margin"):
        none = getattr(plain, name)
        # At first order: a tenth of the lag costs a tenth of the margin, to its second order, 1e-5 s beside 1e-3 s.
        assert none - getattr(wide, name) == pytest.approx(10 * (none - getattr(narrow, name)), rel=0.05)
        assert getattr(wide, name) < none


@pytest.mark.parametrize("damping", [0.02, 1e-3, 1e-5])
def test_a_sharp_resonance_does_not_slip_through(damping: float) -> None:
    """Gain margin by bisection on the poles; Ms on a grid made for this one resonance."""
    plant, pid = Plant(1.0, 118.3, damping), PID(0.1 * damping, 0.1 / 350)
    loop = open_loop(plant, pid, PERIOD)
    system, found = matrices(loop), margins(loop)
    low, high = 1.0, 1e6
    while high / low > 1 + 1e-12:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if system.is_stable(middle) else (low, middle)
    assert found.stable
    # Poles near the circle move by damping * 0.1 while the gain doubles; rounding blurs them by 1e-14.
    assert found.gain_margin == pytest.approx(low, rel=1e-13 / damping + 1e-9)
    centre, width = 2 * math.pi * 118.3 * PERIOD, 0.75 * damping
    own = np.abs(1 / (1 + system.response(centre + width * np.linspace(-20, 20, 20001))))
    assert found.ms == pytest.approx(own.max(), rel=1e-3)


def test_a_conditionally_stable_loop_names_both_ends() -> None:
    """L = K (z - 0.8) / ((z - 1)(z - 1.1)): by Jury's conditions stable for 1/8 < K < 4.2/1.8."""
    loop = ct.tf([1, -0.8], np.poly([1.0, 1.1]), PERIOD)
    found = margins(0.5 * loop)
    assert found.stable
    assert (found.smallest_gain, found.gain_margin) == pytest.approx((0.25, 4.2 / 0.9), rel=1e-9)
    assert "must not fall by one of 4.00" in found.says()
    assert "must rise by a factor of more than 2.00" in margins(loop / 16).says()


def test_unstable_gains_are_said_with_the_factor_that_mends_them() -> None:
    found = margins(open_loop(LIGHT, PRINTED.scaled(5.0), PERIOD))
    assert not found.stable and abs(found.closed_loop_poles[0]) > 1
    assert math.isnan(found.ms)
    safe = margins(open_loop(LIGHT, PRINTED, PERIOD)).gain_margin
    assert found.gain_margin == pytest.approx(safe / 5, rel=1e-9)
    assert f"must fall by a factor of more than {5 / safe:.2f}" in found.says()
    assert found.says().startswith("unstable: the closed loop has a pole of modulus 1.0")


def test_bandwidth_of_an_integrating_loop() -> None:
    """L = g / (z - 1) closes to the first-order lag g / (z - 1 + g)."""
    g = 0.05
    found = margins(ct.tf([g], [1, -1], PERIOD))
    # |g / (e^jw - 1 + g)|^2 = 1/2 gives cos w = 1 - g^2 / (2 (1 - g)).
    w = math.acos(1 - g**2 / (2 * (1 - g)))
    assert found.bandwidth == pytest.approx(w / (2 * math.pi * PERIOD), rel=1e-3)


def test_a_loop_that_never_reaches_one_has_no_phase_margin() -> None:
    found = margins(open_loop(Plant(1.0, 100.0, 1.0), PID(0.2), PERIOD))
    assert found.phase_margin == math.inf
    assert "no further phase lag" in found.says()

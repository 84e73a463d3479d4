"""Metrics against closed forms, root finding, and a plain implementation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from flexdesign.dynamics.metrics import contour, coupling, loop, step_response, tracking

Array = NDArray[np.float64]

OMEGA = 2 * math.pi * 100.0
STEP = 1e-5  # 1000 samples a cycle: a sampled peak is low by (OMEGA STEP)^2 / 8 = 5e-6 of the swing at most


def second_order(time: Array, zeta: float) -> Array:
    """Return the unit step response of a resonance."""
    root = math.sqrt(1 - zeta**2)
    phase = OMEGA * root * time
    return 1 - np.exp(-zeta * OMEGA * time) * (np.cos(phase) + zeta / root * np.sin(phase))


def crossing(zeta: float, level: float, low: float, high: float) -> float:
    return float(brentq(lambda t: second_order(np.array(t), zeta) - level, low, high, xtol=1e-14))


def last_exit(zeta: float, band: float) -> float:
    """Return when the response enters the band for good: from the last peak outside, by root finding."""
    half_cycle = math.pi / (OMEGA * math.sqrt(1 - zeta**2))
    peaks = half_cycle * np.arange(1, 400)  # where the velocity is zero
    outside = [t for t in peaks if abs(second_order(np.array(t), zeta) - 1) > band]
    sign = math.copysign(1.0, float(second_order(np.array(outside[-1]), zeta)) - 1)
    return crossing(zeta, 1 + sign * band, outside[-1], outside[-1] + half_cycle)


# --- Steps


@pytest.mark.parametrize("zeta", [0.02, 0.1, 0.5])
@pytest.mark.parametrize(("start", "target"), [(0.0, 60e-6), (50e-6, -10e-6)])
def test_step_of_a_resonance(zeta: float, start: float, target: float) -> None:
    at = 0.0123
    time = STEP * np.arange(60_000)
    shape = np.where(time < at, 0.0, second_order(np.maximum(time - at, 0.0), zeta))
    measured = step_response(time, start + (target - start) * shape, target, at=at)

    overshoot = abs(target - start) * math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2))
    assert measured.overshoot == pytest.approx(overshoot, rel=2e-5)  # 5e-6 of a swing that is under twice the overshoot
    # Straight lines between samples are off by (OMEGA STEP)^2 / 8 of the swing, here over a slope that is not small.
    peak = math.pi / (OMEGA * math.sqrt(1 - zeta**2))
    rise = crossing(zeta, 0.9, 0.0, peak) - crossing(zeta, 0.1, 0.0, peak)
    assert measured.rise_time == pytest.approx(rise, abs=STEP / 100)
    assert measured.settling_time == pytest.approx(last_exit(zeta, 0.02), abs=STEP / 100)
    # The mean over the tail is below what the envelope leaves when the tail begins.
    assert abs(measured.steady_error) <= abs(target - start) * math.exp(-zeta * OMEGA * (0.54 - at)) + 1e-18


def test_a_wider_band_is_settled_into_earlier() -> None:
    time = STEP * np.arange(60_000)
    response = second_order(time, 0.05)
    assert step_response(time, response, 1.0, at=0.0, band=0.05).settling_time == pytest.approx(
        last_exit(0.05, 0.05), abs=STEP / 100
    )


def test_steps_that_do_not_arrive() -> None:
    time = 1e-3 * np.arange(1000)
    response = 8e-6 * (1 - np.exp(-time / 0.01))  # comes to rest at 80 % of what was asked for
    measured = step_response(time, response, 10e-6, at=0.0)
    assert measured.rise_time == math.inf
    assert measured.settling_time == math.inf
    assert measured.overshoot == 0.0
    assert measured.steady_error == pytest.approx(2e-6, rel=1e-9)
    measured = step_response(time, response, 8e-6, at=0.0)
    # exp(-t / tau) = 0.02; chords of an exponential are off by h^2 / (8 tau) = 1.3e-5 s
    assert measured.settling_time == pytest.approx(0.01 * math.log(50), abs=2e-5)
    assert measured.rise_time == pytest.approx(0.01 * math.log(9), abs=4e-5)


def test_the_level_before_the_step_may_be_given() -> None:
    time = 1e-3 * np.arange(1000)
    response = 10e-6 * (1 - 0.5 * np.exp(-time / 0.01))  # seen from 5 um on; the step began at 0
    measured = step_response(time, response, 10e-6, at=0.0, start=0.0)
    assert measured.settling_time == pytest.approx(0.01 * math.log(25), abs=2e-5)  # 0.5 exp(-t / tau) = 0.02


def test_a_response_that_is_there_at_once_settles_at_once() -> None:
    time = 1e-3 * np.arange(100)
    measured = step_response(time, np.where(time < 0.02, 0.0, 5e-6), 5e-6, at=0.02)
    assert (measured.settling_time, measured.overshoot, measured.rise_time) == (0.0, 0.0, 0.0)


def test_step_quantities_carry_units_and_the_band() -> None:
    time = 1e-3 * np.arange(1000)
    shown = [str(q) for q in step_response(time, 1e-5 * (time > 0), 1e-5, at=0.0, band=0.05).quantities("bench")]
    assert shown == [
        "rise_time = 0.8000 ms",
        "overshoot = 0 um",
        "settling_time (band 5 %) = 0.9500 ms",
        "steady_error = 0 um",
    ]


# --- Tracking


def test_tracking_error_of_a_delayed_sine() -> None:
    """The difference of two sines d apart is a sine of amplitude 2 A sin(omega d / 2)."""
    period, omega, delay, amplitude = 1e-3, 2 * math.pi, 7.4e-3, 20e-6
    time = period * np.arange(3001)
    reference, response = (amplitude * np.sin(omega * (time - d)) for d in (0.0, delay))
    measured = tracking(reference, response, period)
    error = 2 * amplitude * math.sin(omega * delay / 2)
    assert measured.max == pytest.approx(error, rel=1e-5)  # (omega period)^2 / 8 = 5e-6
    assert measured.rms == pytest.approx(error / math.sqrt(2), rel=1e-3)  # one sample more than three cycles
    assert measured.max_relative == pytest.approx(error / (2 * amplitude), rel=1e-5)
    assert measured.lag == 0.0
    # The error is largest where the difference's phase is that of a peak.
    assert (measured.at - delay / 2) % 0.5 == pytest.approx(0.0, abs=period) or (
        measured.at - delay / 2
    ) % 0.5 == pytest.approx(0.5, abs=period)

    freed = tracking(reference, response, period, longest_lag=20e-3)
    assert freed.lag == pytest.approx(delay, abs=period / 1000)
    assert freed.max < amplitude * 1e-5  # what straight lines between the samples of the reference leave


@pytest.mark.parametrize("lag", [0.0, 0.3, 1.0, 4.75, 8.0])
def test_lag_of_a_ramp_is_found_exactly(lag: float) -> None:
    samples = np.arange(200.0)
    measured = tracking(1e-6 * samples, 1e-6 * (samples - lag), 1.0, longest_lag=8.0)
    assert measured.lag == pytest.approx(lag, abs=1e-9)
    assert measured.max == pytest.approx(0.0, abs=1e-18)


def test_a_lag_beyond_the_longest_is_not_removed() -> None:
    samples = np.arange(200.0)
    measured = tracking(1e-6 * samples, 1e-6 * (samples - 5.0), 1.0, longest_lag=2.5)
    assert measured.lag == pytest.approx(2.5)
    assert measured.max == pytest.approx(2.5e-6)


def test_tracking_of_a_reference_that_stands_still() -> None:
    still = np.full(50, 3e-6)
    assert tracking(still, still, 1e-3).max_relative == 0.0
    assert tracking(still, still + 1e-6, 1e-3).max_relative == math.inf


# --- Loops


@pytest.mark.parametrize("samples", [2000, 1234.5])
@pytest.mark.parametrize("gain", [2e-6, -2e-6])
def test_loop_that_is_an_ellipse(samples: float, gain: float) -> None:
    """Area pi U X sin(phi), opening 2 X sin(phi)."""
    period, phase, half = 1e-4, 0.3, 60.0
    frequency = 1 / (samples * period)
    time = period * np.arange(round(3.3 * samples))
    u = 60.0 + half * np.cos(2 * np.pi * frequency * time)
    x = 100e-6 + gain * half * np.cos(2 * np.pi * frequency * time - phase)
    measured = loop(u, x, period, frequency)
    swing = abs(gain) * half
    # Polygons of N corners: area short by (2 pi / N)^2 / 6 < 5e-6, peaks by (2 pi / N)^2 / 8.
    assert measured.area == pytest.approx(math.pi * half * swing * math.sin(phase), rel=1e-5)
    assert measured.width == pytest.approx(2 * swing * math.sin(phase), rel=1e-4)
    assert measured.span == pytest.approx(2 * swing, rel=1e-5)
    assert measured.secant_gain == pytest.approx(gain, rel=1e-5)
    assert measured.width_relative == pytest.approx(math.sin(phase), rel=1e-4)


def test_a_response_that_leads_has_a_negative_area() -> None:
    turn = 2 * np.pi * np.arange(1001) / 500
    measured = loop(np.sin(turn), np.sin(turn + 0.1), 1.0, 1 / 500)
    assert measured.area == pytest.approx(-math.pi * math.sin(0.1), rel=1e-4)  # (2 pi / 500)^2 / 6 = 3e-5


def test_loop_of_a_play_operator_and_only_its_last_cycle_counts() -> None:
    """Play of radius r: x follows u at a distance of r; opening 2 r, span less by 2 r, a parallelogram."""
    radius, top, samples = 5.0, 60.0, 480  # a sample every 0.25 V, so that the corners are samples
    u = top * (1 - np.abs(1 - 2 * (np.arange(3 * samples + 1) / samples % 1)))
    x, out = 40.0, []  # a first cycle of its own
    for value in u:
        x = min(max(x, value - radius), value + radius)
        out.append(x)
    measured = loop(u, 1e-6 * np.array(out), 1.0, 1 / samples)
    assert measured.span == pytest.approx((top - 2 * radius) * 1e-6)
    assert measured.width == pytest.approx(2 * radius * 1e-6)
    # From (0, r) along the bottom to (2 r, r), (top, top - r), (top - 2 r, top - r).
    assert measured.area == pytest.approx(2 * radius * (top - 2 * radius) * 1e-6, rel=1e-9)
    assert measured.secant_gain == pytest.approx((top - 2 * radius) / top * 1e-6)


def test_loop_width_bears_a_command_measured_with_noise() -> None:
    rng = np.random.default_rng(1)
    turn = 2 * np.pi * np.arange(4001) / 2000
    x = 1e-4 * np.cos(turn - 0.2)
    clean = loop(60 * np.cos(turn), x, 1.0, 1 / 2000).width
    noisy = loop(60 * np.cos(turn) + rng.uniform(-0.2, 0.2, turn.size), x, 1.0, 1 / 2000).width
    # 0.2 V of command to either side at a slope of up to 1e-4 m / 60 V, and 0.4 V of ironing, on either branch
    assert noisy == pytest.approx(clean, abs=2 * 0.6 * 1e-4 / 60)


def test_quantities_carry_the_units_people_read() -> None:
    turn = 2 * np.pi * np.arange(1001) / 500
    u, x = 60 + 60 * np.cos(turn), 1e-4 * np.cos(turn - 0.1)
    of_loop = {q.name: q.formatted(3) for q in loop(u, x, 1.0, 1 / 500).quantities()}
    assert of_loop["loop_span"] == "200 um" and of_loop["secant_gain"] == "1.67 um/V"
    # sin(0.1) = 0.0998
    assert (of_loop["loop_width"], of_loop["loop_width_relative"]) == ("20.0 um", "9.98 %")
    samples = np.arange(201.0)
    lagging = tracking(1e-6 * samples, 1e-6 * samples - 4e-6, 1e-3)
    assert [str(q) for q in lagging.quantities()] == [
        "max_error = 4.000 um",
        "rms_error = 4.000 um",
        "max_error_relative = 2.000 %",
        "rms_error_relative = 2.000 %",
        "lag = 0 ms",
    ]
    freed = tracking(samples, samples - 4, 1e-3, longest_lag=0.01).quantities("made", si="V")
    assert (freed[0].key, freed[0].si, freed[0].source) == ("max_error_lag_removed", "V", "made")
    assert freed[-1].value == pytest.approx(4e-3)


# --- Several axes


def there_and_back(points: int) -> tuple[Array, Array]:
    """Return a path at 45 degrees, there and back, and the unit vector to its side."""
    along = np.concatenate([np.linspace(0, 1, points), np.linspace(1, 0, points)[1:]]) * 200e-6
    return np.stack([along, along]), np.array([[-1.0], [1.0]]) / math.sqrt(2)


def test_contour_sees_the_distance_and_not_the_lag() -> None:
    path, side = there_and_back(501)
    late = np.concatenate([np.repeat(path[:, :1], 7, axis=1), path[:, :-7]], axis=1)
    assert contour(path, late, 1e-3, within=0.02).max < 1e-15
    off = np.where(np.arange(path.shape[1]) < 501, 2e-6, -3e-6)
    measured = contour(path, late + off * side, 1e-3, within=0.02)
    assert measured.max == pytest.approx(3e-6, rel=1e-9)
    assert measured.rms == pytest.approx(math.sqrt((501 * 4 + 500 * 9) / 1001) * 1e-6, rel=1e-9)
    assert measured.at == pytest.approx(0.501, abs=0.02)  # the first of the way back, or where rounding puts it
    assert measured.quantities()[0].formatted() == "3.000 um"


def test_contour_does_not_take_the_way_back_for_the_way_there() -> None:
    """Two legs 1 um apart: 0.8 um off the first leg is 0.2 um off the second, which is not where it should be."""
    x = np.concatenate([np.linspace(0, 10e-6, 1001), np.linspace(10e-6, 0, 1001)])
    y = np.concatenate([np.zeros(1001), np.full(1001, 1e-6)])
    path = np.stack([x, y])
    motion = path.copy()
    motion[1, 300] = 0.8e-6
    measured = contour(path, motion, 1e-3, within=0.05)
    assert measured.max == pytest.approx(0.8e-6)
    assert measured.at == pytest.approx(0.3)
    assert contour(path, motion, 1e-3, within=5.0).max == pytest.approx(0.2e-6)


@pytest.mark.parametrize("reach", [5, 59])
def test_contour_agrees_with_a_plain_implementation(reach: int) -> None:
    rng = np.random.default_rng(7)
    path, motion = rng.normal(size=(3, 60)).cumsum(axis=1), rng.normal(size=(3, 60)).cumsum(axis=1)
    distances = []
    for k in range(60):
        near = []
        for j in range(max(0, k - reach), min(59, k + reach)):
            a, b, p = path[:, j], path[:, j + 1], motion[:, k]
            part = min(1.0, max(0.0, float((p - a) @ (b - a) / ((b - a) @ (b - a)))))
            near.append(float(np.linalg.norm(p - a - part * (b - a))))
        distances.append(min(near))
    measured = contour(path, motion, 0.1, within=0.1 * reach)
    assert measured.max == pytest.approx(max(distances), rel=1e-12)
    assert measured.rms == pytest.approx(math.sqrt(sum(d**2 for d in distances) / 60), rel=1e-12)
    assert measured.at == pytest.approx(0.1 * int(np.argmax(distances)))


def test_coupling_is_the_ratio_of_the_motions() -> None:
    """The paper's measurement: 4.628 um of 262.64 um are 1.76 %."""
    turn = np.linspace(0, 2 * np.pi, 1001)
    measured = coupling(262.64e-6 * (1 - np.cos(turn)) / 2, -4.628e-6 * (1 - np.cos(turn)) / 2)
    assert measured.quantities()[0].formatted(3) == "1.76 %"


# --- Refusals


def test_metrics_refuse_what_they_cannot_measure() -> None:
    t, x = np.arange(20.0), np.arange(20.0)
    holed = np.where(t == 5, np.nan, x)
    with pytest.raises(ValueError, match="a sample is not finite"):
        step_response(t, holed, 1.0, at=0.0)
    with pytest.raises(ValueError, match="which is none"):
        step_response(t, x, 0.0, at=0.0)
    with pytest.raises(ValueError, match="fewer than three samples"):
        step_response(t, x, 1.0, at=18.5)
    with pytest.raises(ValueError, match="between 0 and 1"):
        step_response(t, x, 1.0, at=0.0, band=2.0)
    with pytest.raises(ValueError, match="of one length"):
        tracking(x, x[1:], 1.0)
    with pytest.raises(ValueError, match="does not fit a record"):
        tracking(x, x, 1.0, longest_lag=15.0)
    with pytest.raises(ValueError, match="sampling period is more than zero"):
        tracking(x, x, 0.0)
    with pytest.raises(ValueError, match="longer than the record of 20"):
        loop(x, x, 1.0, 1 / 30)
    with pytest.raises(ValueError, match="stands still"):
        loop(np.zeros(20), x, 1.0, 0.1)
    with pytest.raises(ValueError, match="turns more than twice"):
        loop(np.sin(t), x, 1.0, 1 / 18)
    with pytest.raises(ValueError, match="axes x n"):
        contour(x, x, 1.0, within=1.0)
    with pytest.raises(ValueError, match="nearest point"):
        contour(np.stack([x, x]), np.stack([x, x]), 1.0, within=0.0)
    with pytest.raises(ValueError, match="driven axis stands still"):
        coupling(np.zeros(5), np.ones(5))

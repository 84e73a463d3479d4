"""Plants behind the gains of Lin et al. (2019), eq (34), found again from the two numbers they hold."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.dynamics.control.pid import PID
from flexdesign.dynamics.control.plant import Plant
from flexdesign.dynamics.control.plants_from_gains import compare, consistency, plants_for_delays, plants_for_frequency
from flexdesign.dynamics.control.ziegler_nichols import rule, ultimate

PERIOD = 1e-3
XY, XY_GAIN = PID(0.01355, 3.988e-3, 0.997e-3), 6.0777
Z, Z_GAIN = PID(0.04894, 3.134e-3, 0.7835e-3), 6.3621


@pytest.mark.parametrize("printed", [XY, Z])
def test_printed_gains_follow_the_rule(printed: PID) -> None:
    assert consistency(printed) == pytest.approx(1.0, abs=3e-4)  # half a digit of Td and Ti


@pytest.mark.parametrize(
    ("printed", "gain", "delay", "frequency", "damping"),
    [
        (XY, XY_GAIN, 0, (118.3, 0.05), (0.0242, 5e-5)),
        (XY, XY_GAIN, 1, (122.3, 0.05), (0.060, 5e-4)),
        (XY, XY_GAIN, 2, (128.8, 0.05), (0.063, 5e-4)),
        (Z, Z_GAIN, 0, (133.0, 0.5), (0.099, 5e-4)),
    ],
)
def test_known_plants_are_found(
    printed: PID, gain: float, delay: int, frequency: tuple[float, float], damping: tuple[float, float]
) -> None:
    """Against values worked out before and apart from this code, to half of their last digit."""
    (found,) = plants_for_delays(printed, PERIOD, gain, [delay])
    assert found.plant.natural_frequency == pytest.approx(frequency[0], abs=frequency[1])
    assert found.plant.damping_ratio == pytest.approx(damping[0], abs=damping[1])
    assert found.plant.delay == delay * PERIOD


def test_the_printed_frequency_of_z_asks_for_delay() -> None:
    nearest, *rest = plants_for_frequency(Z, PERIOD, Z_GAIN, 177.57)
    assert nearest.plant.damping_ratio == pytest.approx(0.255, abs=1e-3)
    assert nearest.plant.delay == pytest.approx(1.46e-3, abs=5e-6)
    # One oscillation of 6.3 ms later the phase is the same again.
    assert [c.plant.delay for c in rest] == [pytest.approx(1.46e-3 + 6.268e-3, rel=1e-2)]


def test_the_printed_frequency_of_xy_fits_no_delay() -> None:
    """No damping and no delay up to ten samples make 116.41 Hz oscillate at 125.4 Hz under the printed gain."""
    assert plants_for_frequency(XY, PERIOD, XY_GAIN, 116.41) == []


@pytest.mark.parametrize(
    "plant", [Plant(2.0, 90.0, 0.3, 1e-3), Plant(2.0, 60.0, 1.7, 2e-3), Plant(2.0, 200.0, 0.02, 0.5e-3)]
)
def test_a_plant_is_found_from_its_own_tuning(plant: Plant) -> None:
    own = rule(ultimate(plant.discretise(PERIOD)))
    by_delay = plants_for_delays(own, PERIOD, plant.gain, [plant.delay / PERIOD])
    by_frequency = plants_for_frequency(own, PERIOD, plant.gain, plant.natural_frequency)
    for found in (by_delay, by_frequency):
        assert any(_like(c.plant, plant) for c in found), [c.says() for c in found]
        for candidate in found:
            again = rule(ultimate(candidate.plant.discretise(PERIOD)))
            assert (again.kp, again.ti) == pytest.approx((own.kp, own.ti), rel=1e-5)


def _like(one: Plant, other: Plant) -> bool:
    numbers = ((p.natural_frequency, p.damping_ratio, 1e-2 + p.delay) for p in (one, other))
    return bool(np.allclose(*numbers, rtol=1e-5))


def test_a_frequency_response_tells_them_apart() -> None:
    candidates = plants_for_delays(XY, PERIOD, XY_GAIN)
    told = compare(candidates, np.linspace(1, 200, 400))
    ultimate_phase = [math.degrees(np.angle(c.plant.response(1 / (2 * XY.ti)))) for c in candidates]
    # The hold costs half a sample of phase, about 22.6 deg, so the continuous plants are near -157 deg there ...
    assert np.ptp(ultimate_phase) < 3
    # ... but far from each other between and above the resonances.
    assert told.largest_phase_difference > 90
    assert f"{told.largest_phase_difference:.3g} deg" in told.says()
    i = int(np.argmax(np.ptp(told.phase, axis=0)))
    assert told.frequencies[i] == told.best_frequency


def test_what_implies_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="controller: ti"):
        plants_for_delays(PID(1.0), PERIOD, 1.0)
    with pytest.raises(InputError, match="faster than sampling"):
        plants_for_delays(PID(1.0, 0.9e-3), PERIOD, 1.0)
    with pytest.raises(InputError, match="sign"):
        plants_for_frequency(XY, PERIOD, -1.0, 100.0)
    with pytest.raises(InputError, match="two or more"):
        compare([], [1.0])

"""What the robust tuning promises, checked on loops of its own and on plants it was not tuned for."""

from __future__ import annotations

import math

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.dynamics.control.pid import PID
from flexdesign.dynamics.control.plant import Plant
from flexdesign.dynamics.control.sampled_loop import matrices, open_loop, settling_time, simulate
from flexdesign.dynamics.control.tuning import assess, tune

PERIOD = 1e-3
XY, Z = Plant(6.0777, 118.3, 0.0242), Plant(6.3621, 133.0, 0.099)


@pytest.mark.parametrize("plant", [XY, Z], ids=["XY", "Z"])
@pytest.mark.parametrize("weights", [(0.0, 0.0), (1.0, 1.0)], ids=["integral reference", "eq 33"])
def test_settles_in_less_than_half_the_open_loop_time(plant: Plant, weights: tuple[float, float]) -> None:
    tuned = tune(plant, PERIOD, weights=weights)
    # Measured again here, over a longer time, on a finer grid, and between the frequencies it was tuned for.
    for factor in (0.97, 0.985, 1.0, 1.015, 1.03):
        run = simulate(plant.shifted(factor), tuned.pid, np.ones(600), PERIOD, substeps=40)
        assert settling_time(run.time, run.output, 1.0) < tuned.open_loop_settling / 2
    assert tuned.settling[1] < tuned.open_loop_settling / 2


def test_the_limit_on_sensitivity_holds_over_the_family() -> None:
    tuned = tune(XY, PERIOD, ms=1.4, frequency_error=0.02)
    angles = np.linspace(1e-3, math.pi, 20000)
    for factor in (0.98, 1.0, 1.02):
        response = matrices(open_loop(XY.shifted(factor), tuned.pid, PERIOD)).response(angles)
        assert np.max(np.abs(1 / (1 + response))) < 1.4 * 1.01  # the search weighs it on its own, coarser grid


def test_a_load_dies_out_too() -> None:
    """The resonance is damped, not cancelled: a kick at the command rings no longer than the reference step."""
    tuned = tune(XY, PERIOD)
    run = simulate(XY, tuned.pid, np.zeros(200), PERIOD, load=1.0)
    settled = settling_time(run.time, run.output + 1.0, 1.0, band=0.02 * float(np.max(np.abs(run.output))))
    assert settled < 30e-3


def test_gains_scale_with_the_plant_and_nothing_else_changes() -> None:
    one, other = tune(XY, PERIOD), tune(Plant(6.0777e-6, 118.3, 0.0242), PERIOD)
    assert other.pid.kp * 1e-6 == pytest.approx(one.pid.kp, rel=1e-3)
    assert other.settling == pytest.approx(one.settling, rel=0.02)


def test_printed_gains_do_not_halve_the_settling_time() -> None:
    """Lin et al. (2019) say more than 50 % shorter; on plants that give eq (34), its gains do not reach that."""
    xy = assess(PID(0.01355, 3.988e-3, 0.997e-3), XY, PERIOD)
    z = assess(PID(0.04894, 3.134e-3, 0.7835e-3), Z, PERIOD)
    assert xy.settling[0] == pytest.approx(0.217, abs=2e-3)
    assert xy.settling[0] > xy.open_loop_settling
    assert z.settling[0] == pytest.approx(0.069, abs=1e-3)
    assert z.settling[0] > z.open_loop_settling
    assert "a reference step settles to 2 % in 216 ms" in xy.says()


def test_delay_costs_speed() -> None:
    fast, slow = tune(XY, PERIOD), tune(Plant(6.0777, 118.3, 0.0242, 2e-3), PERIOD)
    assert slow.settling[1] > fast.settling[1]


def test_a_lag_costs_speed_and_is_tuned_for() -> None:
    fast, slow = tune(Z, PERIOD), tune(Plant(6.3621, 133.0, 0.099, lags=(1e-3,)), PERIOD)
    assert slow.settling[1] > fast.settling[1]
    assert slow.worst_ms < 1.6 * 1.01


def test_the_settling_of_a_slow_lag_is_waited_for() -> None:
    """The mode is over long before: 1 - y = exp(-t / tau) / |1 - 2 zeta / (w tau) + 1 / (w tau)^2|."""
    lag, plant = 50e-3, Plant(1.0, 118.3, 0.5, lags=(50e-3,))
    turns = 2 * math.pi * 118.3 * lag
    settled = lag * math.log(50 / (1 - 2 * 0.5 / turns + 1 / turns**2))
    found = assess(PID(0.01, 10e-3), plant, PERIOD)
    assert found.open_loop_settling == pytest.approx(settled, abs=PERIOD / 10)  # the grid of the output


def test_what_cannot_be_tuned_is_refused() -> None:
    with pytest.raises(InputError, match="tuning: ms"):
        tune(XY, PERIOD, ms=1.0)
    with pytest.raises(InputError, match="frequency_error"):
        tune(XY, PERIOD, frequency_error=0.7)
    with pytest.raises(InputError, match="undamped"):
        tune(Plant(1.0, 100.0, 0.0), PERIOD)
    with pytest.raises(InputError, match="no stable loop"):
        assess(PID(10.0), XY, PERIOD)

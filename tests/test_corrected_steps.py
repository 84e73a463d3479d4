"""Predictions with coarse steps, corrected once by what fine steps change, are as exact as those near by."""

from __future__ import annotations

import numpy as np

from flexdesign.diagnosis.effect_selection.estimation_setup import correct_steps
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import AxisModel
from flexdesign.measurements.recordings import Run

PERIOD = 1e-3
FRICTION = {"coulomb_friction": {"level": 2e-6, "presliding": 1e-6}}
CUBIC = {"stress_stiffening": {"cubic": 0.2 / 80e-6**2}}
AXIS = AxisModel(118.3, 0.0242, 1e-6, effects={**FRICTION, **CUBIC})


def test_a_corrected_prediction_is_exact_where_it_was_made_and_nearly_so_close_by() -> None:
    time = PERIOD * np.arange(1500)
    command = 40.0 + 30.0 * np.sin(2 * np.pi * (5.0 + 20.0 * time) * time)
    run = Run("sweep", time, {"u": command, "x": np.zeros(1500)}, {"u": "V", "x": "m"})
    coarse = AxisDynamics("x", AXIS, delay=0.0).with_steps(4, fixed=True)
    fine = coarse.with_steps(64, fixed=True)
    corrected = correct_steps(coarse, [run], 1e-8, lambda function, items: [function(each) for each in items])

    def error(of: AxisDynamics, exact: AxisDynamics) -> float:
        return float(np.sqrt(np.mean((of.predict(run) - exact.predict(run)) ** 2)))

    assert error(coarse, fine) > 1e-9
    assert error(corrected, fine) < 1e-3 * error(coarse, fine)
    moved = {"natural_frequency": 118.3 * 1.0001, "gain": 1.0001e-6}
    assert error(corrected.replace(moved), fine.replace(moved)) < 0.1 * error(
        coarse.replace(moved), fine.replace(moved)
    )
    assert error(corrected.with_steps(4, fixed=True), coarse) == 0.0

"""Numbers that differ from run to run: drifts of known rates on runs from an integrator that is not ours (SciPy)."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import TransferFunction, lsim

from flexdesign.core.serialise import to_json
from flexdesign.diagnosis import Diagnosis, add_effect, diagnose
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.measurements.recordings import Run
from flexdesign.report.diagnosis import diagnosis_report, diagnosis_result, diagnosis_text

Array = NDArray[np.float64]
AXIS = AxisModel(118.3, 0.03, 1.98e-6, uncertainty={"natural_frequency": 0.02, "gain": 0.1, "damping_ratio": 1.0})
MODEL = StageModel({"x": AXIS})
#: The stage is a little other than its model.
GAIN, NATURAL, DAMPING = 2.05e-6, 117.5, 0.025
SAMPLES, PERIOD, NOISE = 1200, 1e-3, 1e-8
ROLES = ("identify",) * 4 + ("validate",) * 2


def run(number: int, rate: float, wander: Callable[[np.random.Generator], Array]) -> Run:
    """Rest, then steps of a held command through the mode; an offset, a drift and 10 nm of noise on the reading."""
    rng, fine = np.random.default_rng(number), 10
    command = np.concatenate([np.zeros(SAMPLES // 4), np.repeat(rng.uniform(0.0, 80.0, 9), SAMPLES // 12)])
    w, t = 2 * np.pi * NATURAL, PERIOD * np.arange(float(SAMPLES))
    mode = TransferFunction([GAIN * w * w], [1, 2 * DAMPING * w, w * w])
    times = PERIOD / fine * np.arange(SAMPLES * fine)
    moved = lsim(mode, np.repeat(command, fine), times, interp=False)[1][::fine]
    read = moved + rate * t + rng.normal(0, 1e-6) + NOISE * rng.standard_normal(SAMPLES) + wander(rng)
    columns, role = {"u": command, "x": read}, ROLES[number]
    return Run(f"run{number}", t, columns, {"u": "V", "x": "m"}, "hold", role, role_is_stated=True)  # type: ignore[arg-type]


@cache
def found_in(
    rates: tuple[float, ...], wander: Callable[[np.random.Generator], Array] = lambda _: np.zeros(1)
) -> Diagnosis:
    return diagnose(MODEL, [run(k, rate, wander) for k, rate in enumerate(rates)], threads=1)


def rate_of(value: float, rates: Sequence[float]) -> object:
    """Offset and slope are fitted to n samples of noise: the slope is known to root 12 over n^1.5; four times that."""
    return pytest.approx(value, abs=4 * np.sqrt(12 / SAMPLES**3) * NOISE / PERIOD)


@pytest.mark.parametrize(
    "rates",
    [
        (3.0e-7, 2.0e-7, 6.0e-7, 1.0e-7, 4.0e-7, 2.5e-7),
        (3.0e-7, -3.0e-7, 2.0e-7, -2.4e-7, 3.0e-7, -2.0e-7),  # one rate for all runs explains nothing
    ],
    ids=["one sign", "both signs"],
)
def test_a_drift_whose_rate_differs_is_found_with_the_rate_of_each_run(rates: tuple[float, ...]) -> None:
    found = found_in(rates)
    (drift,) = found.effects
    assert (drift.name, found.verdict) == ("sensor_drift", "effects-found")
    assert set(drift.by_run) == {f"run{k}" for k in range(6)}
    for k, rate in enumerate(rates):
        assert drift.by_run[f"run{k}"].value == rate_of(rate, rates)
    # The model holds the mean over the fitted runs.
    (mean,) = drift.values
    assert mean.value == rate_of(float(np.mean(rates[:4])), rates)
    assert found.model.axes["x"].effects["sensor_drift"]["rate"] == pytest.approx(mean.value, rel=1e-9)
    assert found.error == pytest.approx(NOISE, rel=0.05)
    # What a further run may have is told by the scatter of the runs.
    better = add_effect.with_knowledge(found.model, "x", add_effect.values(found), found.runs)
    known = better.axes["x"].uncertainty["sensor_drift.rate"] * abs(mean.value)
    assert known == pytest.approx(np.std(rates, ddof=1), rel=0.02)


def test_a_drift_with_one_rate_has_one_number() -> None:
    found = found_in((3e-7,) * 6)
    (drift,) = found.effects
    assert drift.name == "sensor_drift" and not drift.by_run
    low, high = drift.values[0].interval
    assert low < 3e-7 < high


def test_a_random_walk_is_no_rate_of_each_run() -> None:
    """A line through a random walk explains most of it, and says nothing of how it goes on."""
    found = found_in((3e-7,) * 6, lambda rng: 2e-9 * np.cumsum(rng.standard_normal(SAMPLES)))
    assert "sensor_drift" in [named.name for named in found.effects]
    assert not any(named.by_run for named in found.effects)


def test_the_report_has_the_value_of_each_run() -> None:
    found = found_in((3.0e-7, 2.0e-7, 6.0e-7, 1.0e-7, 4.0e-7, 2.5e-7))
    result = diagnosis_result.result(found, [])
    assert set(result["effects"][0]["by_run"]) == {f"run{k}" for k in range(6)}
    json.dumps(to_json(result), allow_nan=False)
    document = diagnosis_report.document(found, [])
    (table,) = (t for section in document.sections for t in section.tables if "run to run" in (t.caption or ""))
    assert [row[0] for row in table.rows] == [f"run{k}" for k in range(6)]
    assert "differs from run to run, from" in diagnosis_text.effect(found, found.effects[0])


def test_an_effect_that_is_added_may_differ_from_run_to_run() -> None:
    rates = (3.0e-7, 2.0e-7, 6.0e-7, 1.0e-7, 4.0e-7, 2.5e-7)
    runs = [run(k, rate, lambda _: np.zeros(1)) for k, rate in enumerate(rates)]
    added = add_effect.add(MODEL, "sensor_drift", runs)
    assert not added.reason
    assert added.values[0].value == rate_of(float(np.mean(rates[:4])), rates)
    assert added.by_run["run4"].value == rate_of(rates[4], rates)


def test_a_deviation_adds_to_the_mean() -> None:
    drifting = replace(AXIS, effects={"sensor_drift": {"rate": 2e-7}})
    model = AxisDynamics("x", drifting, 100.0, apart=("run0",), by_run={"sensor_drift.rate": 1e-7})
    one = run(0, 0.0, lambda _: np.zeros(1))
    (own,) = (p for p in model.parameters() if p.name == "run0:sensor_drift.rate")
    (mean,) = (p for p in model.parameters() if p.name == "sensor_drift.rate")
    assert (own.start, own.run, mean.twin) == (0.0, "run0", "sensor_drift.rate")
    faster = model.replace({"run0:sensor_drift.rate": 5e-8})
    assert faster.predict(one) - model.predict(one) == pytest.approx(5e-8 * one.time, abs=1e-15)
    same = model.replace({"sensor_drift.rate": 2.5e-7})
    assert faster.predict(one) == pytest.approx(same.predict(one), abs=1e-15)

"""A sensor that is late, seen where the voltage at the stack was recorded: closed forms that the package has not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

from flexdesign.diagnosis import Diagnosis, diagnose
from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.dynamics import stage_model
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.experiments.loop_design import plant
from flexdesign.dynamics.stage_model import AxisModel, Sensor, StageModel, to_toml
from flexdesign.measurements.recordings import FrequencyResponse, Run

Array = NDArray[np.float64]
AXIS = AxisModel(118.3, 0.03, 1.98e-6, uncertainty={"natural_frequency": 0.02, "gain": 0.1, "damping_ratio": 1.0})
GAIN, NATURAL, DAMPING, LATE = 2.05e-6, 117.5, 0.025, 7e-4
PERIOD, NOISE = 1e-3, 1e-8
LINES = np.geomspace(1.0, 400.0, 160)


def response(f: Array, late: float) -> NDArray[np.complex128]:
    ratio = f / NATURAL
    return np.asarray(GAIN / (1 - ratio**2 + 2j * DAMPING * ratio) * np.exp(-2j * np.pi * f * late))


def sweep(late: float) -> FrequencyResponse:
    """Per volt at the stack, with the noise that a coherence of 0.999 means."""
    rng, h = np.random.default_rng(0), response(LINES, late)
    sigma = np.abs(h) * np.sqrt(0.001 / (64 * 0.999))
    noisy = h + sigma * (rng.standard_normal(160) + 1j * rng.standard_normal(160))
    coherence = np.full(160, 0.999)
    return FrequencyResponse("sweep", LINES, noisy, coherence=coherence, averages=32, command_is="stack")


def run(name: str, role: Literal["identify", "validate"], seed: int, late: float) -> Run:
    """Rest, then a multisine of the voltage that begins by itself from zero; the reading is the steady response to it.

    Below 60 Hz each line stands in for a motion that never began: a window of a second leaves nothing of its beginning.
    """
    rng, t = np.random.default_rng(seed), PERIOD * np.arange(3000.0)
    fine = np.arange(-1.0, 5.0, PERIOD / 8)
    window = np.clip(np.minimum((fine - 0.4) / 0.8, (3.4 - fine) / 0.8), 0.0, 1.0)
    envelope = np.sin(np.pi / 2 * window) ** 4
    lines = rng.uniform(3.0, 60.0, 12)
    volts = 6.0 * envelope * sum(np.sin(2 * np.pi * f * fine + rng.uniform(0, 6.28)) for f in lines) + 40.0 * envelope
    # A periodic signal of six seconds: its spectrum times the closed form is its answer, late by any time.
    spectrum = np.fft.rfft(volts)
    moved = np.fft.irfft(spectrum * response(np.fft.rfftfreq(len(fine), PERIOD / 8), late), len(fine))
    at = np.searchsorted(fine, t - 1e-9)
    read = moved[at] + NOISE * rng.standard_normal(3000)
    columns = {"u": volts[at], "v": volts[at], "x": read}
    return Run(name, t, columns, {"u": "V", "v": "V", "x": "m"}, "smooth", role, role_is_stated=True)


def delay_of(found: Diagnosis) -> tuple[float, tuple[float, float]]:
    (named,) = found.effects
    assert (found.verdict, named.name) == ("effects-found", "sensor_delay")
    (value,) = named.values
    assert value.parameter.name == "sensor.delay"
    return value.value, value.interval


def test_a_late_sensor_is_found_in_a_frequency_response_of_the_stack() -> None:
    found = diagnose(StageModel({"x": AXIS}), [sweep(LATE)], threads=1)
    value, (low, high) = delay_of(found)
    assert abs(value - LATE) < high - low < 0.05 * LATE
    assert found.model.axes["x"].sensor.delay == pytest.approx(value)
    assert found.model.controller.delay == 0.0


@pytest.mark.parametrize("late", [LATE, 3.2e-3])
def test_a_late_sensor_is_found_in_runs_with_the_voltage_at_the_stack(late: float) -> None:
    runs = [run("a", "identify", 1, late), run("b", "identify", 2, late), run("c", "validate", 3, late)]
    found = diagnose(StageModel({"x": AXIS}), runs, noise=NOISE, threads=1)
    value, (low, high) = delay_of(found)
    assert abs(value - late) < high - low < 0.02 * LATE  # a 95 % interval misses one in twenty
    assert found.model.axes["x"].sensor.delay == pytest.approx(value)
    assert found.model.controller.delay == 0.0


def test_a_sensor_in_time_is_not_named() -> None:
    found = diagnose(StageModel({"x": AXIS}), [sweep(0.0)], threads=1)
    assert (found.verdict, found.effects) == ("nothing-missing", ())


def test_it_is_tried_only_where_the_stacks_voltage_is_known() -> None:
    model = AxisDynamics("x", AXIS, 75.0)
    names, at_stack = ({c.name for c in candidates(model, at_stack=known)} for known in (False, True))
    assert "sensor_delay" not in names and "transport_delay" in names
    assert "sensor_delay" in at_stack and "transport_delay" not in at_stack


def test_a_prediction_is_late_by_it() -> None:
    late = replace(AXIS, sensor=Sensor(delay=3 * PERIOD))
    held = replace(run("a", "identify", 1, 0.0), between_samples="hold", command_is="stack")
    plain, shifted = (AxisDynamics("x", axis, 100.0).predict(held) for axis in (AXIS, late))
    assert shifted[3:] == pytest.approx(plain[:-3], abs=1e-12)
    for kind in ("stack", "dac"):
        lines = replace(sweep(0.0), command_is=kind)  # type: ignore[arg-type]
        before, after = (AxisDynamics("x", axis, 100.0).response(lines) for axis in (AXIS, late))
        assert after == pytest.approx(before * np.exp(-2j * np.pi * LINES * 3 * PERIOD), rel=1e-9)


def test_it_is_written_read_and_part_of_a_loop(tmp_path: Path) -> None:
    late = replace(AXIS, sensor=Sensor(delay=LATE))
    path = tmp_path / "late.toml"
    path.write_text(to_toml(StageModel({"x": late}), tmp_path))
    assert 'delay = "0.7 ms"' in path.read_text()
    assert stage_model.read(str(path)).axes["x"].sensor.delay == pytest.approx(LATE)
    assert plant(late, 1e-3).delay == pytest.approx(1e-3 + LATE)

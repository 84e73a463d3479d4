"""Comparison: errors that are known beforehand are found, with their shares, and noise is not taken for an error."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from flexdesign.cli import app
from flexdesign.core.errors import InputError
from flexdesign.diagnosis import comparison
from flexdesign.diagnosis.comparison import Comparison, where
from flexdesign.diagnosis.comparison.compare import reversal_doubt
from flexdesign.diagnosis.initialised_comparison import compare
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import AxisModel, Driver, StageModel, to_toml
from flexdesign.estimation.noise.autoregressive import ColouredNoise, Process
from flexdesign.measurements.noise_level import NoiseFloor
from flexdesign.measurements.recordings import Run, write_run
from flexdesign.measurements.recordings.command_segments import steps
from flexdesign.report import comparison_text, render
from flexdesign.report.diagnosis import comparison_report

Array = NDArray[np.float64]
PERIOD, NOISE = 1e-3, 40e-9
AXIS = AxisModel(118.3, 0.0242, 2.2e-6)
CREEPING = replace(AXIS, effects={"creep": {"per_decade": 0.02, "t0": 0.1}})


def model(axis: AxisModel = AXIS) -> StageModel:
    return StageModel({"x": axis}, name="stage")


def levels() -> Array:
    return np.repeat([0.0, 40.0, 90.0, 60.0, 100.0, 20.0], 800)


def sine(frequency: float = 5.0) -> Array:
    t = PERIOD * np.arange(4000)
    return np.where(t < 0.5, 0.0, 50 * np.sin(2 * np.pi * frequency * (t - 0.5)))


def recorded(name: str, command: Array, axis: AxisModel = AXIS, seed: int = 0) -> Run:
    """What a stage would be measured as, with white noise and an offset."""
    time = PERIOD * np.arange(len(command))
    run = Run(name, time, {"u": command, "x": np.zeros(len(time))}, {"u": "V", "x": "m"}, "hold")
    response = AxisDynamics("x", axis, 100.0, tolerance=1e-8).predict(run) + 3e-6
    response = response + NOISE * np.random.default_rng(seed).standard_normal(len(time))
    return replace(run, columns={"u": command, "x": response})


@cache
def creeping() -> Comparison:
    return compare(model(), [recorded("steps", levels(), CREEPING), recorded("sine", sine(2.0), CREEPING, 1)])


@cache
def sound() -> Comparison:
    return compare(model(), [recorded("steps", levels()), recorded("sine", sine(), seed=1)])


def white(level: float, *names: str) -> NoiseFloor:
    process = Process(np.zeros(0), level)
    return NoiseFloor(ColouredNoise(process), dict.fromkeys(names, level), "told", True, (), math.inf)


def made(name: str, command: Any, response: Array, period: float = PERIOD) -> Run:
    command = np.asarray(command, dtype=float)
    time = period * np.arange(len(command))
    return Run(name, time, {"u": command, "x": response}, {"u": "V", "x": "m"}, "hold")


# --- errors -----------------------------------------------------------------------------------------------------------


def test_the_error_of_a_right_model_is_the_noise() -> None:
    """Of n = 4000 numbers the deviation is known to 1 / sqrt(2 n) = 1.1 %; four times that."""
    for run in sound().runs:
        assert run.rms == pytest.approx(NOISE, rel=0.045)
        assert run.ratio == pytest.approx(1.0, abs=0.06)
        assert run.largest == pytest.approx(3.7 * NOISE, rel=0.25)  # the largest of 4000 normal numbers
    assert sound().noise.source.startswith("quiet stretches")
    assert sound().agrees and not creeping().agrees
    assert "nothing in these runs says that the model fails" in " ".join(comparison_report.summary(sound()))


def test_the_error_of_a_wrong_gain_is_known_beforehand() -> None:
    """A gain 1 % too high misses by 1 % of a slow response about its mean; 5 Hz of 118 adds (5 / 118)^2."""
    (run,) = compare(model(replace(AXIS, gain=1.01 * AXIS.gain)), [recorded("sine", sine())]).runs
    spread = float(np.std(run.measured))
    assert run.rms == pytest.approx(math.hypot(0.01 * spread, NOISE), rel=0.01)
    assert run.r2 == pytest.approx(1 - (run.rms / spread) ** 2, abs=1e-6)
    assert run.of_stroke == pytest.approx(run.rms / np.ptp(run.measured), rel=1e-9)
    assert float(np.mean(run.residual)) == pytest.approx(0.0, abs=1e-12)


def test_a_reversed_sign_is_asked_about() -> None:
    """A sensor of the other polarity; a wrong gain of the right sign and a still stage are no such thing."""
    said = [
        " ".join(comparison_report.summary(compare(model(replace(AXIS, gain=factor * AXIS.gain)), [recorded("a", u)])))
        for factor, u in ((-1.0, levels()), (0.5, levels()), (-1.0, 0 * levels()))
    ]
    assert ["command or of the response reversed" in each for each in said] == [True, False, False]
    turned, sensed = recorded("a", levels()), recorded("b", levels(), replace(AXIS, gain=-AXIS.gain))
    residual = sensed.measured() - turned.measured()
    assert "reversed" in reversal_doubt([sensed], [], {"b": residual})
    assert not reversal_doubt([turned], [], {"a": 0 * residual})


def test_every_run_has_initial_conditions_of_its_own() -> None:
    run = recorded("sine", sine())
    late = replace(run, time=run.time[:2970], columns={k: v[1030:] for k, v in run.columns.items()}, name="late")
    first, second = compare(model(), [run, late]).runs
    assert np.isfinite(first.measured).all() and np.isfinite(second.measured).all()
    assert second.rms == pytest.approx(NOISE, rel=0.06)


def test_units_wrong_by_a_thousand_end_it_or_are_said_first() -> None:
    run = recorded("sine", sine())
    wrong = replace(run, columns={**run.columns, "x": 1e-3 * run.columns["x"]})
    with pytest.raises(InputError, match=r"sine: column x = .* is a thousandth of .* the unit of x or of u"):
        compare(model(), [recorded("steps", levels()), wrong])
    dead = replace(run, columns={**run.columns, "x": NOISE * np.random.default_rng(2).standard_normal(len(run.time))})
    found = compare(model(), [recorded("steps", levels()), dead])
    assert comparison_report.summary(found)[0].startswith("Take care: sine: x spans ")
    assert any("is its unit right" in remark for remark in comparison_report.result(found)["runs"][1]["remarks"])


def test_the_voltage_at_the_stack_is_what_counts() -> None:
    """An amplifier of 20 Hz is not in the model, and need not be: its output was recorded."""
    slow = replace(AXIS, driver=Driver(bandwidth=20.0))
    run = recorded("sine", sine(2.0), slow)
    voltage = AxisDynamics("x", slow, 100.0, tolerance=1e-8)._simulate(run, None).voltage[0]
    known = replace(run, columns={**run.columns, "v": voltage}, si={**run.si, "v": "V"}, name="known")
    told, other = compare(model(), [run, known]).runs
    assert other.rms == pytest.approx(NOISE, rel=0.06) and told.rms > 10 * NOISE
    assert not any("moved too" in remark for remark in other.remarks)
    assert any("v, the voltage at the stack, drives the model" in remark for remark in other.remarks)


def test_a_model_without_numbers_for_a_run_is_refused() -> None:
    run = recorded("sine", sine())
    blank = replace(run, columns={**run.columns, "x": np.where(run.time < 3.0, np.nan, run.columns["x"])})
    assert compare(model(), [run, replace(blank, name="cut")]).runs[1].rms == pytest.approx(NOISE, rel=0.1)
    with pytest.raises(InputError, match="no response of axis x"):
        compare(model(), [replace(run, columns={"u": run.columns["u"], "y": run.columns["x"]})], axis="x")


# --- where ------------------------------------------------------------------------------------------------------------


def test_shares_sum_to_one_and_what_creeps_lies_late_and_slow() -> None:
    found = creeping()
    assert [b.by for b in found.where] == [
        "run", "frequency", "position", "velocity", "voltage", "time since the last step",
    ]  # fmt: skip
    for breakdown in found.where:
        assert sum(p.share for p in breakdown.parts) == pytest.approx(1.0)
        assert sum(p.weight for p in breakdown.parts) == pytest.approx(1.0)
        assert all(0 <= p.share <= 1 for p in breakdown.parts)
    slow, frequency, run = found.by("velocity"), found.by("frequency"), found.by("run")
    assert slow and frequency and run
    assert next(p.share for p in slow.parts if p.label == "at rest") > 0.5
    assert frequency.parts[0].upper == pytest.approx(2**-0.5) and frequency.parts[0].share > 0.5
    assert run.parts[0].share > 0.8


def test_shares_are_those_of_the_squares_above_the_noise() -> None:
    """Two runs of unlike length, which count alike: 3 and 4 um of error, 9 : 16, beneath noise of 5 um."""
    rng = np.random.default_rng(0)
    residuals = {n: 5.0 * rng.standard_normal(m) + sign * np.resize([1.0, -1.0], m)
                 for n, m, sign in (("a", 400_000, 3.0), ("b", 200_000, 4.0))}  # fmt: skip
    runs = [made(n, np.zeros(len(r)), r) for n, r in residuals.items()]
    predictions = {n: np.zeros(len(r)) for n, r in residuals.items()}
    by_run, by_frequency, *_ = where(residuals, runs, predictions, white(5.0, "a", "b"))
    # a mean square of 25 + 9 is known to (25 sqrt(2) + ...) / sqrt(200 000) = 0.1, of 25 in all
    assert [p.share for p in by_run.parts] == pytest.approx([9 / 25, 16 / 25], abs=0.02)
    assert [p.rms for p in by_run.parts] == pytest.approx([math.sqrt(34), math.sqrt(41)], rel=0.01)
    assert by_frequency.parts[-1].share == pytest.approx(1.0, abs=0.03)  # alternating signs: half the sampling rate


@pytest.mark.parametrize(("frequency", "band"), [(0.3, 0), (1.0, 1), (50.0, 7), (130.0, 8)])
def test_a_sine_lies_in_its_octave(frequency: float, band: int) -> None:
    t = PERIOD * np.arange(10_000)
    residual = 1e-6 * np.sin(2 * np.pi * frequency * t)
    run = made("a", np.zeros(len(t)), residual)
    by_frequency = where({"a": residual}, [run], {"a": np.zeros(len(t))}, white(1e-9, "a"))[1]
    low, high = by_frequency.parts[band].lower, by_frequency.parts[band].upper
    assert low <= frequency < high
    assert by_frequency.parts[band].share > 0.99
    assert by_frequency.dominant() == (by_frequency.parts[band],)


def test_an_error_of_one_region_is_found_there() -> None:
    """A triangle of 0 to 100 um; the sensor errs above 80 um while rising: one fifth of the range, half of the time."""
    t = PERIOD * np.arange(8000)
    x = 1e-6 * np.interp(t % 2, [0, 1, 2], [0, 100, 0])
    rising = np.gradient(x) > 0
    residual = np.where((x > 80e-6) & rising, 1e-6, 0.0) + 1e-9 * np.random.default_rng(0).standard_normal(len(t))
    found = {b.by: b for b in where({"a": residual}, [made("a", x / 1e-6, x)], {"a": x}, white(1e-9, "a"))}
    assert found["position"].concentrated == (found["position"].parts[-1],)
    assert found["position"].parts[-1].share == pytest.approx(1.0, abs=1e-3)
    assert found["position"].parts[-1].weight == pytest.approx(0.2, abs=2e-3)
    assert found["position"].parts[-1].lower == pytest.approx(80e-6)
    assert found["voltage"].parts[-1].share == pytest.approx(1.0, abs=1e-3)
    assert [p.label for p in found["velocity"].concentrated] == ["up fast"]
    assert found["position"].contrast == pytest.approx(0.8, abs=5e-3)
    assert "time since the last step" not in found


def test_an_error_that_dies_away_lies_just_after_the_step() -> None:
    u = np.repeat([0.0, 10.0, 0.0, 20.0], 1000)
    since = np.tile(PERIOD * np.arange(1000), 4)
    residual = np.where(np.arange(4000) < 1000, 0.0, 1e-6 * np.exp(-since / 0.004))
    *_, after = where({"a": residual}, [made("a", u, u)], {"a": u}, white(1e-12, "a"))
    assert after.by == "time since the last step"
    assert [p.upper for p in after.parts] == pytest.approx([0.01, 0.1, 1.0])
    # ten samples of a squared decay of 2 ms: 1 - exp(-10 / 2)
    assert after.parts[0].share == pytest.approx(1 - math.exp(-5), abs=1e-3)
    assert after.covers == pytest.approx(1.0, abs=1e-6)


def test_rests_after_steps_end_where_the_command_moves_again() -> None:
    u = np.concatenate([np.zeros(50), np.full(50, 10.0), 10 + 0.1 * np.arange(50), np.full(50, 15.0)])
    assert steps(u) == [(50, 101, 10.0)]
    assert steps(np.zeros(100)) == []


def test_nothing_above_the_noise_has_no_shares() -> None:
    zero = np.zeros(100)
    for breakdown in where({"a": zero}, [made("a", np.arange(100.0), zero)], {"a": zero}, white(1.0, "a")):
        assert sum(p.share for p in breakdown.parts) == 0.0
        assert breakdown.dominant() == () and breakdown.concentrated == ()


# --- report -----------------------------------------------------------------------------------------------------------


def test_sentences_say_where() -> None:
    said = comparison_text.sentences(creeping())
    assert len(said) == 3
    assert said[0].startswith("The model fails mostly in steps: ")
    assert said[1].startswith("The model fails mostly below 0.71 Hz: ")


def test_every_picture_and_number_is_written(tmp_path: Path) -> None:
    document = comparison_report.document(creeping())
    names = [figure.file for figure in document.figures]
    pictures = ["shares.svg", "spectrum.svg", "position.svg", "steps.svg", "coherence.svg"]
    assert names == [*pictures, "run_steps.svg", "run_sine.svg", "loop_sine.svg"]
    written = render.write(tmp_path, document, comparison_report.result(creeping()), {})
    assert all(path.stat().st_size > 1000 for path in written)
    content = json.loads((tmp_path / "result.json").read_text())
    assert content["noise_floor"]["value"] == pytest.approx(NOISE, rel=0.1)
    assert content["noise_floor"]["unit"] == content["runs"][0]["rms_error"]["unit"] == "m"
    assert content["runs"][0]["rms_error"]["value"] == pytest.approx(creeping().runs[0].rms)
    assert [b["by"] for b in content["where"]] == [b.by for b in creeping().where]
    assert len(content["sentences"]) == 3


def test_the_command_line_compares(tmp_path: Path) -> None:
    run = recorded("sine", sine(), CREEPING)
    write_run(tmp_path / "sine.csv", run.time, {"u [V]": run.columns["u"], "x [um]": run.columns["x"]})
    (tmp_path / "stage.toml").write_text(to_toml(model()), encoding="utf-8")
    command = ["compare", str(tmp_path / "stage.toml"), str(tmp_path / "sine.csv"), "--out", str(tmp_path / "out")]
    answer = CliRunner().invoke(app, command)
    assert "Next: flexdesign diagnose" in answer.stderr
    assert answer.exit_code == 0, answer.output
    assert "times that" in answer.output and "sine" in answer.output
    assert (tmp_path / "out" / "report.html").is_file()
    as_json = CliRunner().invoke(app, [*command, "--json"])
    assert json.loads(as_json.stdout)["kind"] == "comparison"


def test_residuals_of_any_model_can_be_divided() -> None:
    """What a diagnosis hands over: arrays by the names of runs."""
    found = creeping()
    again = comparison.where(
        {r.name: r.residual for r in found.runs}, found.observed, {r.name: r.predicted for r in found.runs}, found.noise
    )
    assert repr(again) == repr(found.where)  # parts without limits have NaN, which equals nothing

"""Trajectories against their formulas, spectra and geometry; and what their tables refuse."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from flexdesign.core import toml_files
from flexdesign.core.errors import InputError
from flexdesign.dynamics.trajectories import Level, Multisine, Sine, Trajectory, shapes

Array = NDArray[np.float64]
PERIOD = 1e-3
VOLTS = {"low": "0 V", "high": "120 V"}
TABLES: dict[str, dict[str, Any]] = {
    "sine": {**VOLTS, "frequency": "0.5 Hz", "cycles": 3},
    "square": {"low": "0 um", "high": "60 um", "frequency": "0.5 Hz", "cycles": 2},
    "triangle": {**VOLTS, "frequency": "2 Hz", "cycles": 2.5},
    "staircase": {**VOLTS, "steps": 6, "dwell": "0.2 s"},
    "step": {"start": "0 um", "target": "60 um", "wait": "50 ms", "hold": "0.3 s"},
    "hold": {"level": "60 V", "time": "0.25 s"},
    "chirp": {**VOLTS, "band": ["1 Hz", "100 Hz"], "time": "2 s"},
    "multisine": {**VOLTS, "band": ["1 Hz", "100 Hz"], "resolution": "1 Hz"},
    "line": {"points": [["0 um", "0 um"], ["262 um", "262 um"], ["0 um", "0 um"]], "velocity": "100 um/s"},
}
DURATIONS = {
    "sine": 6.0,
    "square": 4.0,
    "triangle": 1.25,
    "staircase": 2.6,
    "step": 0.35,
    "hold": 0.25,
    "chirp": 2.0,
    "multisine": 1.0,
    "line": 2 * 262 * math.sqrt(2) / 100,
}


def made(shape: str, **changes: Any) -> Trajectory:
    return Trajectory.model_validate({"shape": shape, **TABLES[shape], **changes})


def turning(frequency: float, time: Array) -> Array:
    return (1 - np.cos(2 * np.pi * frequency * time)) / 2


# --- What all shapes share


def test_every_shape_is_tried_here() -> None:
    assert set(shapes()) == {*TABLES, "csv"}


@pytest.mark.parametrize("shape", TABLES)
def test_duration_number_of_samples_and_limits(shape: str) -> None:
    trajectory = made(shape)
    assert trajectory.duration == pytest.approx(DURATIONS[shape])
    samples = trajectory.sampled(PERIOD)
    assert samples.shape[-1] == round(DURATIONS[shape] / PERIOD) + 1
    assert samples.shape[:-1] == (() if trajectory.axes == 1 else (trajectory.axes,))
    values = [level.value for level in trajectory.levels() if "/" not in level.si]
    assert min(values) - 1e-12 <= samples.min() and samples.max() <= max(values) + 1e-12
    assert trajectory.si == ("m" if shape in ("square", "step", "line") else "V")


@pytest.mark.parametrize("shape", TABLES)
def test_a_rest_comes_before_the_motion_and_changes_nothing_else(shape: str) -> None:
    moving, rested = (made(shape, rest=rest).sampled(PERIOD) for rest in ("0 s", "0.1 s"))
    assert np.ptp(rested[..., :100], axis=-1) == pytest.approx(0.0)
    # Times that differ by a rounding of 1e-16 s or so, at velocities of up to 4e4 V/s
    assert rested[..., 100:] == pytest.approx(moving, abs=1e-9)


@pytest.mark.parametrize("shape", TABLES)
def test_a_table_is_written_back_as_it_was_read(shape: str) -> None:
    trajectory = made(shape, rest="0.1 s")
    assert Trajectory.model_validate(toml_files.as_text(trajectory)) == trajectory


@pytest.mark.parametrize(
    ("shape", "longest"),
    [("sine", 1.0), ("triangle", 0.25), ("chirp", 0.005), ("multisine", 0.005), ("staircase", 0.2), ("step", 0.05)],
)
def test_sampling_too_coarse_for_the_motion_is_refused(shape: str, longest: float) -> None:
    made(shape).sampled(longest)
    with pytest.raises(ValueError, match=f"cannot follow this trajectory: sample every {1000 * longest:g}"):
        made(shape).sampled(1.01 * longest)


@pytest.mark.parametrize("period", [0.0, -1e-3, math.nan, math.inf])
def test_a_sampling_period_must_be_positive(period: float) -> None:
    with pytest.raises(ValueError, match="sampling period is more than zero"):
        made("sine").sampled(period)


def test_a_slip_in_the_period_does_not_fill_the_memory() -> None:
    with pytest.raises(ValueError, match=r"gives 6e\+12 samples"):
        made("sine").sampled(1e-12)


# --- Waves


def test_sine_starts_at_low_without_a_jump_in_velocity() -> None:
    samples = made("sine").sampled(PERIOD)
    assert samples == pytest.approx(120 * turning(0.5, PERIOD * np.arange(6001)), abs=1e-12)
    assert samples[[0, 1000, 2000]] == pytest.approx([0.0, 120.0, 0.0], abs=1e-12)
    assert samples[1] == pytest.approx(120 * (math.pi * 0.5 * PERIOD) ** 2, rel=1e-5)  # next term: (pi f t)^2 / 3


def test_square_begins_with_half_a_cycle_at_low_and_ends_there() -> None:
    samples = made("square").sampled(PERIOD)
    expected = np.concatenate([np.tile(np.repeat([0.0, 60e-6], 1000), 2), [0.0]])
    assert samples == pytest.approx(expected, abs=1e-18)


@given(samples=st.integers(1, 500), cycles=st.integers(1, 50), period=st.floats(1e-6, 1.0))
def test_square_jumps_at_the_sample_whatever_the_rounding(samples: int, cycles: int, period: float) -> None:
    frequency = 1 / (2 * samples * period)
    square = made("square", frequency=f"{frequency!r} Hz", cycles=cycles)
    expected = np.concatenate([np.tile(np.repeat([0.0, 60e-6], samples), cycles), [0.0]])
    assert np.abs(square.sampled(period) - expected).max() < 1e-18


def test_triangle_goes_at_constant_velocity_and_may_end_half_way() -> None:
    samples = made("triangle").sampled(PERIOD)
    assert samples[[0, 250, 500, 1250]] == pytest.approx([0.0, 120.0, 0.0, 120.0], abs=1e-9)
    assert np.abs(np.diff(samples)) == pytest.approx(120 * 2 * 2 * PERIOD)


@pytest.mark.parametrize("sweep", ["logarithmic", "linear"])
@pytest.mark.parametrize("band", [(1.0, 100.0), (100.0, 1.0)])
def test_chirp_has_the_frequency_it_should_at_every_moment(sweep: str, band: tuple[float, float]) -> None:
    """The phase of the analytic shape is the integral of the frequency; here by quadrature on a fine grid."""
    chirp = made("chirp", band=[f"{f} Hz" for f in band], sweep=sweep)
    step = 1e-5
    passed = (np.arange(200_000) + 0.5) * step / 2.0
    ratio = band[1] / band[0]
    frequency = band[0] * (ratio**passed if sweep == "logarithmic" else 1 + (ratio - 1) * passed)
    phase = 2 * np.pi * np.concatenate([[0.0], np.cumsum(frequency) * step])
    expected = 120 * (1 - np.cos(phase)) / 2
    # Midpoint rule: |f''| h^2 T / 24 < 1e-6 cycles at |f''| < 600 Hz/s^2; times 60 V 2 pi
    assert np.abs(chirp.sampled(step) - expected).max() < 1e-6 * 2 * math.pi * 60


@pytest.mark.parametrize("phases", ["random", "schroeder"])
def test_multisine_has_equal_tones_in_its_band_and_none_outside(phases: str) -> None:
    table = {"band": ["3 Hz", "40 Hz"], "resolution": "0.5 Hz", "phases": phases}
    samples = made("multisine", **table).sampled(PERIOD)
    spectrum = np.abs(np.fft.rfft(samples[:-1])) / 1000  # 2000 samples are one cycle; half of them a cosine's share
    assert samples[-1] == pytest.approx(samples[0], abs=1e-9)
    tones = spectrum[6:81]
    assert tones == pytest.approx(tones[0], rel=1e-9)
    assert np.delete(spectrum, range(6, 81))[1:] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("top", [2, 30, 200])
def test_multisine_fills_its_range_and_never_leaves_it(seed: int, top: int) -> None:
    samples = made("multisine", band=["1 Hz", f"{top} Hz"], seed=seed).sampled(1 / (200 * top))
    low, high = float(samples.min()), float(samples.max())
    # The bound is 0.13 % high at most, and 200 samples in the shortest cycle miss a peak by (pi / 200)^2 / 2 = 0.012 %.
    assert low >= 0.0 and high <= 120.0
    assert high - low >= 120.0 * (1 - 0.002)
    assert (low + high) / 2 == pytest.approx(60.0, abs=0.15)


def test_multisine_phases_follow_the_seed_and_schroeder_keeps_peaks_low() -> None:
    one, again, other = (made("multisine", seed=seed).sampled(PERIOD) for seed in (1, 1, 2))
    assert np.array_equal(one, again)
    assert np.abs(one - other).max() > 10
    crest = {
        name: np.ptp(values) / 2 / values.std()
        for name, values in {"random": one, "schroeder": made("multisine", phases="schroeder").sampled(PERIOD)}.items()
    }
    # Schroeder's phases come near 1.7 for a flat band; random ones lie near sqrt(2 ln N), above 2.5.
    assert crest["schroeder"] < 1.9 < 2.4 < crest["random"]


def test_multisine_cycles_repeat() -> None:
    twice = made("multisine", cycles=2).sampled(PERIOD)
    assert twice[1000:] == pytest.approx(twice[:1001], abs=1e-9)


# --- Moves


def test_step_and_hold() -> None:
    expected = np.concatenate([np.zeros(50), np.full(301, 60e-6)])
    assert made("step").sampled(PERIOD) == pytest.approx(expected, abs=1e-18)
    assert np.array_equal(made("hold").sampled(PERIOD), np.full(251, 60.0))


def test_staircase_up_and_down() -> None:
    stairs = np.repeat([0, 20, 40, 60, 80, 100, 120, 100, 80, 60, 40, 20, 0], 200).astype(float)
    assert made("staircase").sampled(PERIOD) == pytest.approx(np.append(stairs, 0.0))
    assert made("staircase", back=False).sampled(PERIOD) == pytest.approx(np.append(stairs[:1400], 120.0))


def test_line_keeps_its_velocity_along_the_path_and_passes_its_corners() -> None:
    points = [["0 um", "0 um", "0 um"], ["30 um", "40 um", "0 um"], ["30 um", "40 um", "-20 um"]]
    line = made("line", points=points, velocity="10 um/s")
    assert line.duration == pytest.approx(5.0 + 2.0)
    samples = line.sampled(PERIOD)
    assert np.linalg.norm(np.diff(samples, axis=1), axis=0) == pytest.approx(10e-6 * PERIOD, rel=1e-6)
    assert samples[:, [0, 2500, 5000, 6000, 7000]] * 1e6 == pytest.approx(
        np.array([[0, 15, 30, 30, 30], [0, 20, 40, 40, 40], [0, 0, 0, -10, -20]]), abs=1e-9
    )


def test_line_there_and_back_as_in_the_paper() -> None:
    line = made("line", velocity="10 um/s")
    samples = line.sampled(PERIOD)
    middle = round(262 * math.sqrt(2) / 10 / PERIOD)
    assert np.array_equal(samples[0], samples[1])
    # The corner lies between two samples, which are 10 nm apart along the path.
    assert samples[0, middle] == pytest.approx(262e-6, abs=10e-9)
    assert samples[0, [0, -1]] == pytest.approx(0.0, abs=10e-9)


def test_line_waits_at_its_points_and_may_have_one_axis() -> None:
    line = made("line", points=["0 V", "10 V", "5 V"], velocity="100 V/s", dwell="0.1 s")
    assert line.si == "V" and line.axes == 1
    samples = line.sampled(0.05)
    assert samples == pytest.approx([0, 5, 10, 10, 10, 5, 5, 5])


# --- Files of the user's own


def test_csv_is_resampled_by_straight_lines_in_si(tmp_path: Path) -> None:
    (tmp_path / "my.csv").write_text("# mine\nt [ms],u [mV],x [um]\n5,0,1\n7,2000,2\n8,1000,4\n")
    table = {"shape": "csv", "file": "my.csv", "column": "u [V]"}
    volts = Trajectory.model_validate(table).with_folder(tmp_path)
    assert volts.si == "V" and volts.axes == 1 and volts.duration == pytest.approx(3e-3)
    assert volts.sampled(0.5e-3) == pytest.approx([0, 0.5, 1.0, 1.5, 2.0, 1.5, 1.0])
    metres = Trajectory.model_validate({**table, "column": ["x [um]", "x [um]"]}).with_folder(tmp_path)
    assert metres.sampled(1e-3) == pytest.approx(np.array([[1, 1.5, 2, 4]] * 2) * 1e-6)


@pytest.mark.parametrize(
    ("content", "column", "message"),
    [
        ("t [s],u [V]\n0,1\n1,2\n", "ux [V]", r"my.csv: header: there is no column ux \[V\]; found u \[V\]"),
        ("t [s],u [V]\n0,1\n1,2\n", "u [um]", r"my.csv: header: there is no column u \[um\]; found u \[V\]"),
        ("t [s],u [V]\n0,1\n", "u [V]", "has one row"),
        ("t [s],u [V]\n0,1\n0,2\n", "u [V]", "line 3, column t = 0 s: is not later than the row before"),
        ("t [s],u [V]\n0,1\n1,nan\n", "u [V]", "line 3, column u = nan: is not a finite number"),
    ],
)
def test_csv_that_cannot_be_followed(content: str, column: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "my.csv").write_text(content)
    trajectory = Trajectory.model_validate({"shape": "csv", "file": str(tmp_path / "my.csv"), "column": column})
    with pytest.raises(InputError, match=message):
        trajectory.sampled(PERIOD)


# --- Tables that are refused


class Experiment(toml_files.Table):
    command: Trajectory


def refusal(**table: Any) -> str:
    with pytest.raises(InputError) as caught:
        toml_files.check(Experiment, {"command": table}, Path("loops.toml"))
    return str(caught.value).removeprefix("loops.toml: ")


def test_a_field_of_a_file_takes_any_shape() -> None:
    command = toml_files.check(Experiment, {"command": {"shape": "sine", **TABLES["sine"]}}, Path("loops.toml")).command
    assert isinstance(command, Sine)
    assert command.low == Level(0.0, "V") and str(command.high) == "120 V"
    assert isinstance(Experiment(command=command).command, Sine)


@pytest.mark.parametrize(
    ("shape", "changes", "message"),
    [
        ("sine", {"shape": "sinus"}, "command.shape = sinus: is not a known shape; did you mean sine?"),
        ("sine", {"shape": None}, f"command.shape: is missing; known: {', '.join(shapes())}"),
        ("sine", {"hi": "3 V"}, "command.hi = 3 V: is not a key of a sine; did you mean high?"),
        ("sine", {"high": "nan V"}, 'command.high = nan V: expected a finite number with its unit, for example "60 V"'),
        ("sine", {"high": 120}, "command.high = 120: expected a finite number with its unit"),
        ("sine", {"high": "120 N"}, "command.high = 120 N: expected a finite number with its unit"),
        ("sine", {"high": "120 um"}, "command: mixes volts and metres"),
        ("sine", {"high": "-1 V"}, "command: low = 0 V is not below high = -1 V"),
        ("sine", {"frequency": "0 Hz"}, "command.frequency = 0 Hz: allowed: more than 0"),
        ("sine", {"frequency": "2 s"}, "command.frequency = 2 s: 's' is wrong here"),
        ("hold", {"time": "0 s"}, "command.time = 0 s: allowed: more than 0"),
        ("step", {"wait": "-1 s"}, "command.wait = -1 s: allowed: more than 0"),
        ("sine", {"rest": "-1 s"}, "command.rest = -1 s: allowed: 0 to"),
        ("staircase", {"steps": 0}, "command.steps = 0: allowed: 1 to"),
        ("chirp", {"band": ["1 Hz", "1 Hz"]}, "command: has one frequency at both ends"),
        ("chirp", {"band": ["1 Hz", "x"]}, "command.band = x: entry 2: does not begin with a number"),
        ("chirp", {"band": ["1 Hz"]}, "command.band: entry 2: is missing"),
        ("multisine", {"resolution": "150 Hz"}, "command: has no multiple of its resolution within its band"),
        ("multisine", {"resolution": "1 mHz"}, "command: has 99001 tones; at most 20000"),
        ("multisine", {"phases": "best"}, "command.phases = best: expected 'random' or 'schroeder'"),
        ("line", {"points": "home"}, "command.points = home: expected a list of points"),
        ("line", {"points": [["0 um", "0 um"]]}, "command: needs at least two points"),
        ("line", {"points": [["0 um", "0 um"], ["1 um", "2 N"]]}, "command.points = 2 N: entry 2.2: expected a finite"),
        ("line", {"points": [["0 um", "0 um"], ["1 um"]]}, "command: needs the same number of axes"),
        ("line", {"points": ["0 um", "1 um", "1 um"]}, "command: has the same point twice, as points 2 and 3"),
        ("line", {"velocity": "0 um/s"}, "command.velocity = 0 um/s: must be more than zero"),
        ("line", {"velocity": "1 V/s"}, "command: mixes volts and metres"),
    ],
)
def test_what_a_table_refuses(shape: str, changes: dict[str, Any], message: str) -> None:
    said = refusal(**{"shape": shape, **TABLES[shape], **changes})
    assert said.startswith(message)


def test_what_is_missing_is_named_with_what_else_is_needed() -> None:
    assert refusal(shape="sine", low="0 V") == "command.high: is missing; a sine needs low, high, frequency"
    assert refusal(shape="csv", file="a.csv", column="u").startswith(
        "command.column = u: entry 1: write name and unit, for example x [um]"
    )
    assert refusal(shape="csv", file="a.csv", column=["u [V]", "x [um]"]).startswith("command: mixes volts and metres")
    assert refusal(shape="csv", file="a.csv", column=[]).startswith("command: names no column")
    with pytest.raises(InputError, match=r"command = sine: expected a table such as \{ shape"):
        toml_files.check(Experiment, {"command": "sine"}, Path("loops.toml"))


def test_multisine_says_which_tones_it_has() -> None:
    multisine = made("multisine", band=["0.1 Hz", "0.7 Hz"], resolution="0.1 Hz")
    assert isinstance(multisine, Multisine)
    assert list(multisine.harmonics()) == [1, 2, 3, 4, 5, 6, 7]

"""Oversampled runs: fewer samples behind a low-pass, against closed forms and the exact response to a held command."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter, ss2tf
from typer.testing import CliRunner

import flexdesign as fd
from flexdesign.cli import app
from flexdesign.core.errors import InputError
from flexdesign.diagnosis.preparation.spectra import oversampling_of
from flexdesign.measurements.noise_level import noise_floor
from flexdesign.measurements.recordings import Run, read_run, write_run
from flexdesign.measurements.recordings.decimation import decimate, noise_gain

FACTOR = 12
T = np.arange(6000) * 1e-4


def fewer(values: np.ndarray, column: str = "x", between: str = "linear") -> tuple[np.ndarray, np.ndarray]:
    time, found, _ = decimate(T, {column: values}, FACTOR, between)  # type: ignore[arg-type]
    return time, found[column]


@pytest.mark.parametrize("cycles_per_sample", [0.0, 0.05, 0.24])
def test_slow_sines_are_as_they_were(cycles_per_sample: float) -> None:
    """A window of Kaiser for 80 dB ripples by 1e-4, and as much at zero, where it is scaled to nothing."""
    wave = np.cos(2 * np.pi * cycles_per_sample * T / (FACTOR * 1e-4) + 0.4)
    time, found = fewer(wave)
    assert found == pytest.approx(np.cos(2 * np.pi * cycles_per_sample * time / (FACTOR * 1e-4) + 0.4), abs=2e-4)


@pytest.mark.parametrize("cycles_per_sample", [0.5, 0.9, 2.2])
def test_what_the_lower_rate_cannot_show_is_cut_off(cycles_per_sample: float) -> None:
    """By 80 dB, within the few decibels of the formula of Kaiser."""
    _, found = fewer(np.cos(2 * np.pi * cycles_per_sample * T / (FACTOR * 1e-4)))
    assert np.abs(found).max() < 2e-4


def test_white_noise_is_lowered_as_is_said() -> None:
    noise = np.random.default_rng(1).standard_normal(400_000)
    _, found, _ = decimate(np.arange(400_000.0), {"x": noise}, FACTOR, "linear")
    assert found["x"].std() == pytest.approx(noise_gain(FACTOR), rel=0.02)  # 33,000 values: 0.4 %
    assert noise_gain(FACTOR) == pytest.approx((0.75 / FACTOR) ** 0.5, rel=0.05)  # of an ideal low-pass


def test_a_held_command_acts_half_a_sample_late() -> None:
    """A ramp of steps that are held is on average the ramp half a sample later; a reading is none."""
    ramp = np.arange(6000.0)
    for column, between, late in (("u", "hold", 0.5), ("u", "linear", 0.0), ("x", "hold", 0.0)):
        time, found = fewer(ramp, column, between)
        assert found == pytest.approx(time / 1e-4 - late, abs=1e-6)


def test_gaps_of_readings() -> None:
    wave = np.sin(2 * np.pi * 3 * T)
    short, long = wave.copy(), wave.copy()
    short[1000:1005] = long[3000:3100] = np.nan
    assert fewer(short)[1] == pytest.approx(fewer(wave)[1], abs=1e-5)  # bent by (w h)^2 / 8 in the gap
    time, found = fewer(long)
    reach = 10 * FACTOR
    touched = (time >= T[3000 - reach]) & (time <= T[3099 + reach])
    assert (np.isnan(found) == touched).all()
    assert found[~touched] == pytest.approx(fewer(wave)[1][~touched])


# --- In a folder


def oscillator(u: np.ndarray, period: float, f0: float = 100.0) -> np.ndarray:
    """Return what a mass on a spring makes of a held command, exactly."""
    w = 2 * np.pi * f0
    a, b = np.array([[0, 1], [-(w**2), -0.04 * w]]), np.array([[0], [2e-6 * w**2]])
    *system, _ = cont2discrete((a, b, np.array([[1.0, 0.0]]), np.zeros((1, 1))), period, method="zoh")
    numerator, denominator = ss2tf(*system)
    return np.asarray(lfilter(numerator[0], denominator, u))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs of steps, at 1000 samples in a period of the mode."""
    where = tmp_path_factory.mktemp("runs")
    time = np.arange(30_000) * 1e-5
    for name, seed in (("a", 1), ("b", 2)):
        rng = np.random.default_rng(seed)
        u = np.repeat(rng.uniform(0, 50, 10), 3000)
        u[:3000] = 0.0
        x = oscillator(u, 1e-5) + 20e-9 * rng.standard_normal(len(u))
        write_run(where / f"{name}.csv", time, {"u [V]": u, "x [um]": x})
    model = '[axis.x]\nnatural_frequency = "100 Hz"\ndamping_ratio = 0.02\ngain = "2 um/V"\n'
    (where / "model.toml").write_text("format = 1\n" + model)
    return where


def describe(folder: Path, text: str) -> None:
    (folder / "measurements.toml").write_text(f'between_samples = "hold"\nnoise = "20 nm"\n{text}')


def test_the_exact_response_is_predicted_at_the_lower_rate(folder: Path) -> None:
    describe(folder, "decimate = 40\n")
    run = read_run(folder / "a.csv")
    assert run.period == pytest.approx(4e-4)
    assert run.between_samples == "smooth"
    assert run.between_is_stated
    found = fd.compare(folder / "model.toml", [folder / "a.csv", folder / "b.csv"])
    # Of the noise 2.7 nm are left; a delay of half a recorded sample would make 100 nm.
    assert all(match.rms < 10e-9 for match in found.runs)


def test_stated_noise_is_that_of_the_recorded_readings(folder: Path) -> None:
    describe(folder, "decimate = 40\n")
    run = read_run(folder / "a.csv")
    # The command of this record moves all the time, as far as is said here: the stated noise counts.
    moving = Run(**{**vars(run), "columns": {**run.columns, "u": run.time + run.columns["u"]}})
    noise = noise_floor([moving], "x")
    assert noise.rms["a"] == pytest.approx(20e-9 * noise_gain(40))


def test_readings_in_steps_keep_the_noise_that_steps_make() -> None:
    """At rest a sensor of 10 nm shows nothing else: 10 nm / sqrt 12 in each reading (Bennett 1948), averaged."""
    x = 1e-8 * np.round(1e2 * np.sin(2 * np.pi * T) * (T < 0.5))
    time, found, _ = decimate(T, {"u": np.where(T < 0.5, np.sin(2 * np.pi * T), 0.0), "x": x}, FACTOR, "linear")
    run = Run("a", time, found, {"u": "V", "x": "m"}, noise_gain=noise_gain(FACTOR), steps={"x": 1e-8})
    assert noise_floor([run], "x").rms["a"] == pytest.approx(1e-8 / 12**0.5 * noise_gain(FACTOR), rel=1e-6)


def test_check_says_how_many_samples_would_do_and_then_nothing(folder: Path) -> None:
    describe(folder, "")
    found = fd.check([folder / "a.csv", folder / "b.csv"])
    (said,) = [each for each in found.suspicions if "decimate = " in each.remedy]
    factor = int(said.remedy.partition("decimate = ")[2].split()[0])
    # Of 1000 samples in a period of the mode more than eight are left; steps also excite what is faster.
    assert 1e5 / factor > 8 * 100
    assert factor > 5
    describe(folder, "decimate = 2\n")  # of the rest half would do, too; it is chosen
    assert "decimate" not in str(fd.check([folder / "a.csv", folder / "b.csv"]).suspicions)
    describe(folder, f"decimate = {factor}\n")
    found = fd.check([folder / "a.csv", folder / "b.csv"])
    assert not [each for each in found.suspicions if "decimate" in each.remedy or "low-pass" in each.what]


def test_a_short_piece_of_a_slow_run_has_no_say() -> None:
    """As what is left of a record behind its last gap; its spectral lines are wider than the band of the motion."""
    rng = np.random.default_rng(2)
    time = np.arange(20_000) * 1e-3
    u = np.sin(2 * np.pi * time)
    x = 1e-6 * u + 1e-9 * rng.standard_normal(len(time))
    runs = [
        Run(name, time[rows], {"u": u[rows], "x": x[rows]}, {"u": "V", "x": "m"})
        for name, rows in (("long", slice(None)), ("short", slice(600)))
    ]
    alone, both = (oversampling_of(runs[:count], "x", 1e-9) for count in (1, 2))
    assert alone is not None and both is not None
    assert alone[1].partition(":")[0] == both[1].partition(":")[0]


def test_a_response_that_follows_up_to_the_nyquist_frequency_is_not_oversampled() -> None:
    u = np.random.default_rng(0).standard_normal(20_000)
    run = Run("a", np.arange(20_000) * 1e-4, {"u": u, "x": 1e-6 * u}, {"u": "V", "x": "m"})
    assert oversampling_of([run], "x", 1e-9) is None


def test_too_large_a_factor_is_refused(folder: Path) -> None:
    describe(folder, "decimate = 1500\n")
    with pytest.raises(InputError, match=r"decimate.*1500.*leaves 0 of 30000 samples.*choose a smaller number"):
        read_run(folder / "a.csv")


def test_import_passes_it_on(folder: Path, tmp_path: Path) -> None:
    describe(folder, "")
    text = (folder / "a.csv").read_text().replace("t [s],u [V],x [um]", "time (s);command (V);position (um)")
    (tmp_path / "log.txt").write_text(text.replace(",", ";"))
    (tmp_path / "map.toml").write_text(
        'decimate = 40\n[[run]]\n[run.columns.t]\nvariable = "time"\nunit = "s"\n'
        '[run.columns.u]\nvariable = "command"\nunit = "V"\n[run.columns.x]\nvariable = "position"\nunit = "um"\n'
    )
    result = CliRunner().invoke(
        app, ["import", f"{tmp_path / 'log.txt'}", "--map", f"{tmp_path / 'map.toml'}", "-o", f"{tmp_path / 'runs'}"]
    )
    assert result.exit_code == 0, result.output
    assert "one sample in 40 is used" in " ".join(result.output.split())
    assert read_run(tmp_path / "runs" / "log.csv").period == pytest.approx(4e-4)

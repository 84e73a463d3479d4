"""Very long recordings: effects are searched in windows, and decided on all values."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import chirp, lsim

import flexdesign as fd
from flexdesign.diagnosis import diagnose, windowed_selection
from flexdesign.diagnosis.preparation import dataset
from flexdesign.diagnosis.preparation.dataset import DiagnosisData, prepare
from flexdesign.diagnosis.windowed_selection import windows
from flexdesign.dynamics import stage_model
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.estimation.model_selection.forward_selection import forward
from flexdesign.measurements.recordings import Run, read_runs, splitting
from studies.benchmarks.diagnosis import case_of
from studies.hidden_effect_trial import folder
from tests.estimation.sums import calibrated_stand, effects, task

PERIOD, NOISE = 2e-4, 2e-8
#: A main mode, and a second one: frequency [Hz], damping ratio, static response [m/V].
MAIN, SECOND = (404.0, 0.05, 0.99e-6), (1100.0, 0.01, 0.0495e-6)
SHARE = SECOND[2] / (MAIN[2] + SECOND[2])


def responding(command: np.ndarray, modes: tuple[tuple[float, float, float], ...]) -> np.ndarray:
    """Return the response of modes in parallel to straight lines between samples, by matrix exponentials (SciPy)."""
    time, found = PERIOD * np.arange(len(command)), np.zeros(len(command))
    for frequency, damping_ratio, gain in modes:
        w = 2 * np.pi * frequency
        found += lsim(([gain * w**2], [1.0, 2 * damping_ratio * w, w**2]), command, time)[1]
    return found


def swept(count: int, modes: tuple[tuple[float, float, float], ...]) -> Run:
    """Return a sweep from 5 Hz to 0.4 of the sampling rate."""
    time = PERIOD * np.arange(count)
    command = 50.0 * np.minimum(1.0, time / 0.1) + 8.0 * chirp(time, 5.0, time[-1], 0.4 / PERIOD, phi=-90.0)
    reading = responding(command, modes) + NOISE * np.random.default_rng(0).standard_normal(count)
    return Run("sweep", time, {"u": command, "x": reading}, {"u": "V", "x": "m"}, "linear", between_is_stated=True)


def stage(frequency: float = 400.0) -> StageModel:
    uncertainty = {"natural_frequency": 0.05, "gain": 0.05, "damping_ratio": 0.5}
    return StageModel({"x": AxisModel(frequency, 0.05, 1e-6, uncertainty=uncertainty)})


@pytest.fixture(scope="module")
def data() -> DiagnosisData:
    return prepare(stage(MAIN[0]), [swept(120_000, (MAIN,))], None, None)


def test_windows_are_chosen_in_proportion_to_the_squared_residual_and_its_mean(data: DiagnosisData) -> None:
    # A residual in a share f of the record: (1 + f) / 2 of the windows are there, Madow (1949).
    run, share = data.of("identify")[0], 0.25
    there = np.isfinite(run.measured())
    place = np.cumsum(there) / there.sum()
    inside = there & (place > 0.5) & (place <= 0.5 + share)
    found = windows(data, {run.name: np.where(inside, 1e-6, 0.0)}).of("identify")
    middles = [np.searchsorted(run.time, each.time[-500]) for each in found]
    hit = sum(bool(inside[middle]) for middle in middles)
    assert len(found) == 9  # of twelve, those of three quarters of the record
    assert hit == pytest.approx((1 + share) / 2 * len(found), abs=1.0)


def test_without_residuals_windows_are_spread_evenly(data: DiagnosisData) -> None:
    starts = np.array([each.time[-1000] for each in windows(data, {}).of("identify")])
    even = (np.arange(len(starts)) + 0.5) / len(starts) * 120_000 * PERIOD
    assert np.abs(starts - even).max() < 0.08 * 120_000 * PERIOD  # blocks for validation lie between


def test_a_window_is_predicted_as_the_whole_run(data: DiagnosisData) -> None:
    """After its lead: what the mode did before has decayed to a thousandth."""
    run = data.of("identify")[0]
    model = AxisDynamics("x", data.axis, 58.0)
    whole = model.predict(run)
    for part in windows(data, {}).of("identify"):
        first = int(np.searchsorted(run.time, part.time[0] - 0.5 * PERIOD))
        read = np.isfinite(part.measured())
        expected = whole[first : first + len(part.time)]
        lead = int(np.flatnonzero(read)[0])
        assert np.abs(model.predict(part) - expected)[read].max() < 2e-3 * np.ptp(whole)
        assert first == 0 or lead >= data.axis.settling_time / PERIOD - 1
        assert np.array_equal(part.measured()[read], run.measured()[first : first + len(part.time)][read])


def test_windows_of_one_record_are_one_record(data: DiagnosisData) -> None:
    parts = windows(data, {})
    assert data.is_very_long and not parts.is_very_long
    assert data.is_one_record and parts.is_one_record
    other = replace(data.of("identify")[0], name="other:identify")
    assert not replace(data, runs=(*data.runs, other)).is_one_record
    assert all(parts.noise.rms[run.name] == data.noise.rms[run.name.rpartition(":")[0]] for run in parts.runs)


def test_a_long_sweep_is_validated_about_each_of_its_resonances() -> None:
    """In a slow sweep a resonance lies within one of eight blocks: two thirds of its width are in another one."""
    fitted, kept = splitting.split([swept(240_000, ())])
    judged = np.flatnonzero(np.isfinite(kept.measured()))
    assert np.diff(judged).max() < splitting.SAMPLES_OF_BLOCKS * 5 / 8
    assert len(judged) == pytest.approx(240_000 / 4, rel=0.1)
    assert not (np.isfinite(fitted.measured()) & np.isfinite(kept.measured())).any()


@pytest.mark.parametrize(
    ("name", "is_slow"),
    [
        ("creep", True),
        ("sensor_drift", True),
        ("prandtl_ishlinskii", True),
        ("hysteretic_spring", True),
        ("second_mode", False),
        ("transport_delay", False),
        ("quadratic_stiffness", False),
    ],
)
def test_what_may_last_longer_than_a_window_is_searched_in_all_samples(name: str, is_slow: bool) -> None:
    assert windowed_selection.is_slow(name) == is_slow


def test_what_a_part_of_the_values_chose_is_confirmed_or_refused_by_all() -> None:
    whole, other = task({"d": 0.3}), task({}, seed=1)
    chosen = forward(whole, calibrated_stand(whole), effects()).chosen
    assert chosen is not None and chosen.names == ("d",)
    trial = windowed_selection.confirm(whole, calibrated_stand(whole), chosen)
    # The same fit again, to a fraction of what one value of noise costs.
    assert trial is not None and not trial.reason and trial.gain == pytest.approx(chosen.gain, abs=0.05)
    refused = windowed_selection.confirm(other, calibrated_stand(other), chosen)
    assert refused is not None and refused.reason


@pytest.mark.slow
@pytest.mark.parametrize("noise", ["1.98e-8", ""], ids=["known noise", "unknown noise"])
def test_hysteresis_is_found_in_very_long_recordings(
    noise: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Its loops last for seconds, a window for one."""
    monkeypatch.setattr(dataset, "VERY_LONG", 50_000)
    folder.write(case_of("prandtl_ishlinskii"), tmp_path, tmp_path / "answer.toml")
    runs = [run for run in read_runs([tmp_path / folder.RUNS]) if noise or "quiet" not in run.name]
    model = stage_model.read(str(tmp_path / folder.MODEL), [])
    found = diagnose(model, runs, noise=float(noise) if noise else None)
    assert [effect.name for effect in found.effects] == ["prandtl_ishlinskii"]


@pytest.mark.slow
def test_a_second_mode_is_found_in_a_long_sweep(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dataset, "VERY_LONG", 50_000)
    monkeypatch.setattr(splitting, "SAMPLES_OF_BLOCKS", 15_000)
    said = list[str]()
    found = fd.diagnose(stage(), [swept(60_000, (MAIN, SECOND))], progress=said.append)
    assert found.verdict == "effects-found"
    (effect,) = found.effects
    truth = {"share": SHARE, "frequency": SECOND[0], "damping_ratio": SECOND[1]}
    assert effect.name == "second_mode"
    for value in effect.values:
        low, high = value.interval
        margin = 0.5 * (high - low)  # of three intervals of 95 % one may miss the truth by a little
        assert low - margin < truth[value.parameter.name.rpartition(".")[2]] < high + margin
    assert found.error == pytest.approx(NOISE, rel=0.02)
    assert any("windows" in text for text in said)
    assert "Of 60000 samples, effects were searched in 12 windows of 1000" in " ".join(str(found).split())

"""Several effects in one frequency response, modes among them: closed forms that the package does not share."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from flexdesign import effects
from flexdesign.core.errors import InputError
from flexdesign.diagnosis import Diagnosis, diagnose
from flexdesign.diagnosis.effect_selection.candidates import candidates
from flexdesign.dynamics import stage_model
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import AxisModel, StageModel, to_toml
from flexdesign.measurements.recordings import FrequencyResponse, Role, Run
from flexdesign.report.diagnosis import diagnosis_result, diagnosis_text

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
#: A mode: its share of the static response, its frequency [Hz] and its damping ratio.
Mode = tuple[float, float, float]
GAIN, COHERENCE, AVERAGES = 2.05e-6, 0.999, 32
UNCERTAINTY = {"natural_frequency": 0.02, "gain": 0.1, "damping_ratio": 1.0}


def formula(
    f: Array, main: float, modes: Sequence[Mode], bandwidth: float = np.inf, delay: float = 0.0, damping: float = 0.025
) -> Complex:
    """Modes beside the main one, behind a lag of first order and a delay."""
    whole = [(1 - sum(share for share, _, _ in modes), main, damping), *modes]
    moved = sum((s / (1 - (f / at) ** 2 + 2j * zeta * f / at) for s, at, zeta in whole), np.zeros(len(f), complex))
    return np.asarray(GAIN * moved * np.exp(-2j * np.pi * f * delay) / (1 + 1j * f / bandwidth))


def found_in(f: Array, main: float, response: Complex) -> Diagnosis:
    """Diagnose an axis that is thought to have one mode, 0.7 % too high, from a response with Gaussian noise."""
    rng = np.random.default_rng(0)
    sigma = np.abs(response) * np.sqrt((1 - COHERENCE) / (2 * AVERAGES * COHERENCE))
    noisy = response + sigma * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
    sweep = FrequencyResponse("sweep", f, noisy, coherence=np.full(len(f), COHERENCE), averages=AVERAGES)
    axis = AxisModel(1.007 * main, 0.03, 1.98e-6, uncertainty=UNCERTAINTY)
    return diagnose(StageModel({"x": axis}), [sweep], threads=1)


def is_held(found: Diagnosis, name: str, key: str, truth: float) -> bool:
    """Tell whether twice the half-width of an interval holds the truth: a 95 % interval misses one in twenty."""
    values = [value for named in found.effects if named.name == name for value in named.values]
    value = next(each for each in values if each.parameter.name.rpartition(".")[2] == key)
    return abs(value.value - truth) < value.interval[1] - value.interval[0]


LOW, HIGH = np.geomspace(1.0, 400.0, 160), np.geomspace(20.0, 4500.0, 300)
SEVERAL = {
    "two": (LOW, 117.5, [(0.05, 260.0, 0.01), (0.04, 180.0, 0.015)]),
    "one below": (LOW, 117.5, [(0.05, 260.0, 0.01), (-0.03, 60.0, 0.02)]),
    "three": (LOW, 117.5, [(0.05, 260.0, 0.01), (0.04, 180.0, 0.015), (-0.02, 60.0, 0.02)]),
    "narrow": (HIGH, 1175.0, [(0.02, 2600.0, 0.004), (0.01, 1800.0, 0.004)]),
}


@pytest.mark.parametrize("modes", list(SEVERAL))
def test_an_axis_may_have_several_further_modes(modes: str) -> None:
    f, main, truth = SEVERAL[modes]
    found = found_in(f, main, formula(f, main, truth))
    assert (found.verdict, found.remainder) == ("effects-found", "")
    assert {effects.original(named.name) for named in found.effects} == {"second_mode"}
    assert len(found.effects) == len(truth)
    for share, at, zeta in truth:
        near = min(found.effects, key=lambda named: abs(named.values[1].value - at))
        for key, number in {"share": share, "frequency": at, "damping_ratio": zeta}.items():
            assert is_held(found, near.name, key, number)


@pytest.mark.parametrize(("f", "main", "scale"), [(LOW, 117.5, 1.0), (HIGH, 1175.0, 10.0)], ids=["100 Hz", "1 kHz"])
def test_a_driver_a_delay_and_two_modes_are_found_together(f: Array, main: float, scale: float) -> None:
    modes = [(0.05, 260.0 * scale, 0.01), (0.04, 180.0 * scale, 0.015)]
    found = found_in(f, main, formula(f, main, modes, 300.0 * scale, 6e-4 / scale))
    assert (found.verdict, found.remainder) == ("effects-found", "")
    names = [effects.original(named.name) for named in found.effects]
    lag = next(name for name in names if name.endswith("bandwidth"))
    assert sorted(names) == sorted([lag, "second_mode", "second_mode", "transport_delay"])
    # A first-order lag is one wherever it is.
    assert {lag, *next(group for group in found.confusable if group[0] == lag)} == {
        "driver_bandwidth",
        "sensor_bandwidth",
    }
    assert is_held(found, lag, "bandwidth", 300.0 * scale)
    assert is_held(found, "transport_delay", "delay", 6e-4 / scale)


def test_a_lag_and_a_delay_are_no_mode() -> None:
    """A mode without a peak and a lag would do nearly as well."""
    found = found_in(LOW, 117.5, formula(LOW, 117.5, [], 300.0, 6e-4))
    assert {named.name for named in found.effects} <= {"driver_bandwidth", "sensor_bandwidth", "transport_delay"}
    assert len(found.effects) == 2 and not found.remainder


def test_a_further_mode_is_written_and_read_and_comes_after_the_first(tmp_path: Path) -> None:
    f, main, truth = SEVERAL["two"]
    found = found_in(f, main, formula(f, main, truth))
    path = tmp_path / "better.toml"
    path.write_text(to_toml(found.model, tmp_path))
    again = stage_model.read(str(path)).axes["x"]
    assert set(again.effects) == {"second_mode", "second_mode.2"}
    assert again.numbers["second_mode.2.frequency"] == pytest.approx(180.0, rel=1e-3)
    # In words and in numbers both are told apart.
    assert "another second mode (second_mode.2)" in diagnosis_text.verdict(found)
    result = diagnosis_result.result(found, [])
    assert [each["name"] for each in result["effects"]] == ["second_mode", "second_mode.2"]
    json.dumps(result, allow_nan=False)


STEADY = {
    "narrow": [(0.03, 291.0, 0.002)],
    "below": [(0.05, 61.0, 0.003)],
    "two": [(0.1, 233.0, 0.004), (-0.03, 371.0, 0.003)],
}


def steady(name: str, role: Role, seed: int, modes: Sequence[Mode], **more: float) -> Run:
    """One period of a multisine that has run for long: the record begins while all modes ring. Noise: 20 nm."""
    rng, rate, count = np.random.default_rng(seed), 4000.0, 6000
    f = np.fft.rfftfreq(count, 1 / rate)
    sent = np.where((f >= 2) & (f <= 400), np.exp(2j * np.pi * rng.random(len(f))) / np.maximum(f, 20), 0)
    command, answer = (np.fft.irfft(line, count) for line in (sent, sent * formula(f, 120.0, modes, **more)))
    size = 10 / np.abs(command).max()
    reading = size * answer + 2e-8 * rng.standard_normal(count)
    columns, units = {"u": size * command, "x": reading}, {"u": "V", "x": "m"}
    return Run(
        name, np.arange(count) / rate, columns, units, "smooth", role, between_is_stated=True, role_is_stated=True
    )


ROLES: tuple[Role, ...] = ("identify", "validate", "test")


def steady_axis(damping: float) -> AxisModel:
    """The axis of such records as it is thought to be, 2.5 % too fast."""
    uncertainty = {"natural_frequency": 0.05, "gain": 0.1, "damping_ratio": 0.5}
    return AxisModel(123.0, damping, 1.98e-6, uncertainty=uncertainty)


@pytest.mark.parametrize("delay", [0.0, 4e-4], ids=["nothing", "a delay"])
def test_a_lightly_damped_mode_that_rings_all_the_time_hides_nothing_and_is_nothing(delay: float) -> None:
    runs = [steady(role, role, seed, [], delay=delay, damping=0.004) for seed, role in enumerate(ROLES)]
    found = diagnose(StageModel({"x": steady_axis(0.01)}), runs, threads=1)
    assert (found.verdict, found.remainder) == ("effects-found" if delay else "nothing-missing", "")
    assert found.error == pytest.approx(2e-8, rel=0.1)
    if delay:  # the best lag, with the best trigger, leaves chi^2 72 % above the noise: the mode rings too well
        (named,) = found.effects
        assert (named.name, found.confusable) == ("transport_delay", ())
        low, high = named.values[0].interval
        assert low < delay < high
    calibrated = {value.parameter.name: value.value for value in found.calibration}
    assert calibrated["natural_frequency"] == pytest.approx(120.0, rel=1e-4)
    assert calibrated["damping_ratio"] == pytest.approx(0.004, rel=0.02)


@pytest.mark.parametrize(
    "modes", ["two", *(pytest.param(each, marks=pytest.mark.slow) for each in ("narrow", "below"))]
)
def test_modes_are_found_in_records_that_begin_while_they_ring(modes: str) -> None:
    """They are narrower than the steps of the catalogue's frequencies, and ring by more than the stroke."""
    truth = STEADY[modes]
    runs = [steady(role, role, seed, truth) for seed, role in enumerate(ROLES)]
    found = diagnose(StageModel({"x": steady_axis(0.03)}), runs, threads=1)
    assert (found.verdict, found.remainder) == ("effects-found", "")
    assert len(found.effects) == len(truth)
    assert found.error == pytest.approx(2e-8, rel=0.3)
    for share, at, zeta in truth:
        near = min(found.effects, key=lambda named: abs(named.values[1].value - at))
        for value, number in zip(near.values, (share, at, zeta), strict=True):
            assert value.value == pytest.approx(number, rel=0.025)


def test_another_mode_is_tried_beside_one_only() -> None:
    plain = AxisDynamics("x", AxisModel(118.3, 0.03, 1.98e-6), 100.0)
    after = {each.name: each.after for each in candidates(plain)}
    assert [after[name] for name in ("second_mode", "second_mode.2", "second_mode.3")] == [
        "",
        "second_mode",
        "second_mode.2",
    ]
    one = {"share": 0.05, "frequency": 260.0, "damping_ratio": 0.01}
    model = replace(plain, axis=replace(plain.axis, effects={"second_mode": one}))
    (next_one,) = (each for each in candidates(model) if each.name == "second_mode.2")
    assert next_one.after == ""
    both = next_one.add(model)
    assert {p.name for p in both.parameters()} >= {"second_mode.share", "second_mode.2.share"}
    with pytest.raises(ValueError, match="not a known effect"):
        effects.find("creep.2")
    with pytest.raises(InputError, match="is no effect"):
        plain.with_effect(effects.find("creep"), "creep.2")

"""Frequency responses in comparison, diagnosis and addition: known answers from closed forms that the package has not.

Responses are transfer functions written down here, with Gaussian noise of the size that the stated coherence means. The
runs in time beside them come from SciPy's lsim.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import TransferFunction, lsim

from flexdesign.cli import app
from flexdesign.core.errors import InputError
from flexdesign.core.serialise import to_json
from flexdesign.diagnosis import Diagnosis, add_effect, diagnose
from flexdesign.diagnosis.experiment_design.discrimination import proposals
from flexdesign.diagnosis.initialised_comparison import compare
from flexdesign.dynamics.stage_model import AxisModel, StageModel, to_toml
from flexdesign.measurements.noise_level.lines import LineNoise, noise_of_lines
from flexdesign.measurements.recordings import FrequencyResponse, Run
from flexdesign.report.diagnosis import (
    addition_report,
    comparison_report,
    diagnosis_report,
    diagnosis_result,
    diagnosis_text,
    response_pages,
)

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
AXIS = AxisModel(118.3, 0.03, 1.98e-6, uncertainty={"natural_frequency": 0.02, "gain": 0.1, "damping_ratio": 1.0})
MODEL = StageModel({"x": AXIS})
#: The stage is a little other than its model.
GAIN, NATURAL, DAMPING = 2.05e-6, 117.5, 0.025
FAST, SLOW = np.geomspace(1.0, 400.0, 160), np.geomspace(0.01, 10.0, 100)


def mode(f: Array, natural: float = NATURAL, damping: float = DAMPING) -> Complex:
    return np.asarray(1 / (1 - (f / natural) ** 2 + 2j * damping * f / natural))


def measured(
    f: Array, response: Complex, seed: int = 0, coherence: float | None = 0.999, averages: int = 32
) -> FrequencyResponse:
    """Return a response with the noise that a coherence means; without one that of 0.999, unsaid."""
    share, rng = coherence or 0.999, np.random.default_rng(seed)
    sigma = np.abs(response) * np.sqrt((1 - share) / (2 * averages * share))
    noisy = response + sigma * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
    if coherence is None:
        return FrequencyResponse("sweep", f, noisy)
    return FrequencyResponse("sweep", f, noisy, coherence=np.full(len(f), share), averages=averages)


def found_in(response: FrequencyResponse) -> Diagnosis:
    return diagnose(MODEL, [response], threads=1)


def first(found: Diagnosis) -> tuple[set[str], dict[str, tuple[float, tuple[float, float]]]]:
    """Return the effect that was found with all that it cannot be told from, and its numbers with their intervals."""
    assert found.verdict == "effects-found"
    (named,) = found.effects
    group = next((set(group) for group in found.confusable if group[0] == named.name), {named.name})
    return group, {v.parameter.name.rpartition(".")[2]: (v.value, v.interval) for v in named.values}


@pytest.mark.parametrize("coherence", [0.999, 0.9])
def test_a_response_that_the_model_explains_lacks_nothing(coherence: float) -> None:
    found = found_in(measured(FAST, GAIN * mode(FAST), coherence=coherence))
    assert found.verdict == "nothing-missing"
    values = {value.parameter.name: value.value for value in found.calibration}
    assert values["natural_frequency"] == pytest.approx(NATURAL, rel=2e-3)
    assert found.noise.known and not found.confidence


def test_without_coherence_a_white_residual_may_be_noise() -> None:
    """The noise, 0.4 % of a line, is more than the tolerance of unknown noise; nothing in it has a shape."""
    response = measured(FAST, GAIN * mode(FAST), coherence=None)
    size = float(np.sqrt(np.mean(np.abs(response.response) ** 2)))
    for tolerance, verdict in ((None, "nothing-missing"), (0.1 * size, "nothing-missing")):
        found = diagnose(MODEL, [response], tolerance=tolerance, threads=1)
        assert (found.verdict, found.effects) == (verdict, ())
        assert not found.noise.known and "the noise of these runs is unknown" in found.confidence


DELAY, BANDWIDTH = 6e-4, 300.0
CREEPING = sum(0.02 / (1 + 2j * np.pi * SLOW * 0.1 * 10.0**k) for k in range(4))
HIDDEN = {
    "driver": (
        FAST,
        GAIN * mode(FAST) / (1 + 1j * FAST / BANDWIDTH),
        {"driver_bandwidth", "sensor_bandwidth"},
        {"bandwidth": BANDWIDTH},
    ),
    "delay": (
        FAST,
        GAIN * mode(FAST) * np.exp(-2j * np.pi * FAST * DELAY),
        {"transport_delay"},
        {"delay": DELAY},
    ),
    "second mode": (
        FAST,
        GAIN * (0.95 * mode(FAST) + 0.05 * mode(FAST, 260.0, 0.01)),
        {"second_mode"},
        {"share": 0.05, "frequency": 260.0, "damping_ratio": 0.01},
    ),
    "creep": (SLOW, GAIN * mode(SLOW) * (1 + CREEPING), {"creep"}, {"per_decade": 0.02, "t0": 0.1}),
    "payload": (
        FAST,
        GAIN * mode(FAST, 118.3 / np.sqrt(1.5), 0.03 / np.sqrt(1.5)),
        {"payload_mass", "stiffness_loss"},
        {"ratio": 0.5},
    ),
}


@pytest.mark.parametrize("hidden", list(HIDDEN))
def test_a_hidden_effect_is_named_with_its_numbers(hidden: str) -> None:
    """Each number within twice its interval's half-width: a 95 % interval misses one in twenty."""
    f, response, expected, numbers = HIDDEN[hidden]
    group, values = first(found_in(measured(f, response)))
    assert group == expected
    for name, number in numbers.items():
        value, (low, high) = values[name]
        assert abs(value - number) < high - low
    strength, (low, high) = next(iter(values.values()))
    if hidden != "payload":  # what the mass was is known no better than the model says
        assert high - low < 0.15 * strength


def test_effects_of_which_none_alone_explains_a_certain_share_are_added_together() -> None:
    """Two modes and a delay: beside the two others, each by itself leaves a residual in which its fall is chance."""
    f, rng = np.linspace(5.0, 1500.0, 400), np.random.default_rng(2)
    shares, frequencies, delay = (-0.289, -0.383), (737.9, 530.0), 2.25e-4
    total = (1 - sum(shares)) * mode(f, 217.7, 0.012)
    total += sum(share * mode(f, at, 0.012) for share, at in zip(shares, frequencies, strict=True))
    white = rng.standard_normal((2, len(f))) + 1j * rng.standard_normal((2, len(f)))
    response = GAIN * (total * np.exp(-2j * np.pi * f * delay) * (1 + 0.02 * white[0]) + 0.006 * white[1])
    axis = replace(AXIS, natural_frequency=250.0, uncertainty={"natural_frequency": 0.2, "gain": 0.3})
    said = list[str]()
    found = diagnose(StageModel({"x": axis}), [FrequencyResponse("sweep", f, response)], progress=said.append)
    assert any(line.startswith("asking which of") for line in said)
    assert {named.name for named in found.effects} == {"transport_delay", "second_mode", "second_mode.2"}
    values = {v.parameter.name.split(".", 1)[-1]: v.value for named in found.effects for v in named.values}
    by_effect = {named.name: {v.parameter.name: v.value for v in named.values} for named in found.effects}
    assert values["delay"] == pytest.approx(delay, rel=0.03)
    for share, at in zip(shares, frequencies, strict=True):
        (name,) = (n for n in ("second_mode", "second_mode.2") if abs(by_effect[n][f"{n}.frequency"] / at - 1) < 0.01)
        assert by_effect[name][f"{name}.share"] == pytest.approx(share, rel=0.1)


def test_what_no_effect_explains_is_unknown() -> None:
    notch = (1 - (FAST / 62) ** 2 + 0.04j * FAST / 62) / (1 - (FAST / 62) ** 2 + 0.12j * FAST / 62)
    found = found_in(measured(FAST, GAIN * mode(FAST) * notch))
    assert (found.verdict, found.effects) == ("unknown", ())
    assert "times the noise remains" in found.remainder
    assert all(name.startswith(("magnitude near", "phase near")) for name in found.sparse_model.terms)


def test_a_lag_of_another_law_is_no_lag_without_a_remainder() -> None:
    """One over 1 + (j f / f0)^0.6 is a lag, but not of the catalogue; the nearest one leaves many times the noise."""
    found = found_in(measured(FAST, GAIN * mode(FAST) / (1 + (1j * FAST / 200.0) ** 0.6)))
    assert found.remainder_rms > 10 * found.noise_floor
    assert {named.name for named in found.effects} <= {"driver_bandwidth", "sensor_bandwidth"}
    said = diagnosis_text.verdict(found)
    if found.effects:
        assert "What remains, " in said and "is no effect that is known here" in said
        assert "of the line)" in said and "stroke" not in said


def test_an_effect_that_moves_no_line_by_what_is_asked_for_is_not_named() -> None:
    f, response, expected, _ = HIDDEN["driver"]
    found = diagnose(MODEL, [measured(f, response)], tolerance=1e-4, threads=1)
    assert not found.effects
    tried = {name: each.outcome for each in found.candidates for name in each.names if len(each.names) == 1}
    assert any("less than the tolerance" in tried[name] for name in expected)


def run(name: str, role: Literal["identify", "validate"], seed: int, bandwidth: float) -> Run:
    """Return steps of a held command through mode and lag, from an integrator that is not ours; 10 nm of noise."""
    rng, fine = np.random.default_rng(seed), 10
    command = np.concatenate([np.zeros(600), np.repeat(rng.uniform(0.0, 80.0, 12), 100)])
    w, t = 2 * np.pi * NATURAL, 1e-3 * np.arange(float(len(command)))
    below = np.polymul([1.0, 2 * DAMPING * w, w * w], [1 / (2 * np.pi * bandwidth), 1.0])
    times = 1e-3 / fine * np.arange(len(command) * fine)
    moved = lsim(TransferFunction([GAIN * w * w], below), np.repeat(command, fine), times, interp=False)[1][::fine]
    read = moved + 1e-8 * rng.standard_normal(len(command))
    return Run(name, t, {"u": command, "x": read}, {"u": "V", "x": "m"}, "hold", role, role_is_stated=True)


def with_runs(bandwidth: float, of_sweep: float) -> Diagnosis:
    runs = [run("a", "identify", 1, bandwidth), run("b", "validate", 2, bandwidth)]
    sweep = measured(FAST, GAIN * mode(FAST) / (1 + 1j * FAST / of_sweep))
    return diagnose(MODEL, [*runs, sweep], threads=1)


def test_a_response_beside_two_runs_is_explained_together_with_them() -> None:
    found = with_runs(BANDWIDTH, BANDWIDTH)
    group, values = first(found)
    assert group == {"driver_bandwidth", "sensor_bandwidth"}
    assert values["bandwidth"][0] == pytest.approx(BANDWIDTH, rel=2e-3)
    # The ladder is of the runs, in metres; the response has its own section.
    assert found.error_ladder[-1].error == pytest.approx(1e-8, rel=0.05)
    assert [each.name for each in found.responses] == ["sweep:identify", "sweep:validate"]
    document, result = diagnosis_report.document(found, []), diagnosis_result.result(found, [])
    assert {"Frequency responses", "Where it fails"} <= {section.title for section in document.sections}
    final = result["frequency_responses"]["final"]
    assert final[0]["error_over_noise"] == pytest.approx(1.0, abs=0.3)
    json.dumps(to_json(result), allow_nan=False)


def test_a_response_that_contradicts_the_runs_is_not_drowned_by_them() -> None:
    """The sweep saw an amplifier that the runs did not: 240 values against thousands."""
    assert with_runs(1e5, BANDWIDTH).verdict == "unknown"


def test_a_comparison_says_in_which_band_a_model_fails() -> None:
    response = measured(FAST, 1.98e-6 * mode(FAST, 118.3, 0.03) / (1 + 1j * FAST / BANDWIDTH))
    found = compare(MODEL, [response])
    (sweep,) = found.responses
    expected = np.abs(1 - (1 + 1j * FAST / BANDWIDTH))
    assert sweep.left == pytest.approx(expected, rel=0.15, abs=0.02)
    assert sweep.noise_floor == pytest.approx(np.sqrt(0.001 / 0.999 / 32), rel=0.1)
    document, result = comparison_report.document(found), comparison_report.result(found)
    assert "at 180 to 360 Hz" in document.summary[0]
    assert [figure.file for section in document.sections for figure in section.figures] == ["bode_sweep.svg"]
    assert result["frequency_responses"][0]["largest_error_at"]["value"] == 400.0
    clean = compare(MODEL, [measured(FAST, 1.98e-6 * mode(FAST, 118.3, 0.03))])
    assert "Nothing is above the noise" in comparison_report.summary(clean)[0]
    both = comparison_report.document(compare(MODEL, [run("a", "identify", 1, BANDWIDTH), response]))
    assert both.title.endswith("against run a and frequency response sweep")


def test_an_effect_is_added_from_a_response_alone() -> None:
    response = measured(FAST, GAIN * mode(FAST) / (1 + 1j * FAST / BANDWIDTH))
    found = add_effect.add(MODEL, "driver_bandwidth", [response])
    assert not found.reason
    assert found.model.axes["x"].driver.bandwidth == pytest.approx(BANDWIDTH, rel=5e-3)
    assert found.share == pytest.approx(1.0, abs=0.01)
    assert "identified from sweep" in found.model.axes["x"].sources["driver.bandwidth"]
    loop = add_effect.InTheLoop(None, "not asked")
    assert "Frequency responses" in {section.title for section in addition_report.document(found, loop).sections}
    json.dumps(to_json(addition_report.result(found, loop)), allow_nan=False)
    with pytest.raises(InputError, match="small sines"):
        add_effect.add(MODEL, "mains_hum", [response])


def test_a_bias_shows_what_bends() -> None:
    """Electrostriction about two bias voltages: the gain grows by 2 q v, which recalibration cannot follow."""
    sweeps = []
    for bias in (0.0, 20.0, 60.0, 90.0):
        sweep = measured(FAST, (GAIN + 2 * 3e-9 * bias) * mode(FAST), seed=int(bias))
        sweeps.append(replace(sweep, name=f"at {bias:g} V", bias=bias))
    group, values = first(diagnose(MODEL, sweeps, threads=1))
    assert "electrostriction" in group
    if "quadratic" in values:
        assert values["quadratic"][0] == pytest.approx(3e-9, rel=0.02)


def test_what_is_missing_far_above_the_main_mode_is_found_where_the_noise_is_unknown() -> None:
    """Two inertias and a soft coupling, on a suspension at 2 Hz that the band from 11 Hz does not show.

    Lines are a thousandth of the static response and less, so that a share of that one would be no tolerance.
    """
    lines = np.arange(11.0, 251.0)
    twin = mode(lines, 2.0, 0.1) + 1e-3 * mode(lines, 76.0, 0.02)
    axis = replace(AXIS, natural_frequency=2.0, damping_ratio=0.1, gain=GAIN, uncertainty=AXIS.uncertainty)
    found = diagnose(StageModel({"x": axis}), [measured(lines, GAIN * twin, coherence=None)], threads=1)
    assert found.verdict == "effects-found" and [effect.name for effect in found.effects] == ["second_mode"]
    frequency = next(v for v in found.effects[0].values if v.parameter.name.endswith("frequency"))
    assert frequency.value == pytest.approx(76.0, rel=2e-3)


def test_a_response_of_the_other_sign_is_asked_for() -> None:
    doubt = "is the sign of the gain, of the command or of the response reversed"
    assert doubt in found_in(measured(FAST, -GAIN * mode(FAST))).confidence
    assert doubt not in found_in(measured(FAST, GAIN * mode(FAST, 140.0))).confidence


def test_errors_are_shares_of_the_line() -> None:
    """A response 5 % above the model is off by 1/21 of each line, whatever each line weighs."""
    ratio = FAST / AXIS.natural_frequency
    response = 1.05 * AXIS.gain / (1 - ratio**2 + 2j * AXIS.damping_ratio * ratio)
    found = found_in(measured(FAST, response, coherence=0.99999))  # noise is 0.04 % of a line, of the mean 0.006 %
    share = found.error_ladder[0].error / response_pages.line_size(found)
    assert share == pytest.approx(0.05 / 1.05, abs=2e-4)
    ladder = diagnosis_report.ladder_table(found)
    assert dict(zip(ladder.columns, ladder.rows[0], strict=True))["of the line"] == "4.8 %"
    assert found.error < response_pages.line_size(found)
    assert "of the line" in diagnosis_text.verdict(found)


def test_the_commands_take_a_file(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    response = measured(FAST, GAIN * mode(FAST) / (1 + 1j * FAST / BANDWIDTH))
    rows = [
        f"{f!r},{1e6 * abs(h)!r},{float(np.degrees(np.angle(h)))!r},0.999,32"
        for f, h in zip(FAST.tolist(), response.response.tolist(), strict=True)
    ]
    sweep, model = tmp_path / "sweep.csv", tmp_path / "model.toml"
    sweep.write_text("\n".join(["f [Hz], magnitude [um/V], phase [deg], coherence, averages", *rows]))
    model.write_text(to_toml(MODEL, tmp_path))
    for verb, kind in (("compare", "comparison"), ("diagnose", "diagnosis")):
        out = tmp_path / verb
        done = CliRunner().invoke(app, [verb, str(model), str(sweep), "--out", str(out)])
        assert done.exit_code == 0, done.output
        assert json.loads((out / "result.json").read_text())["kind"] == kind
        assert "driver bandwidth" in done.output or verb == "compare"
        assert ("of the line" if verb == "diagnose" else "rms of the measured line") in done.output
        assert (out / "bode_sweep.svg").is_file()
    refused = CliRunner().invoke(app, ["identify", str(model), str(sweep), "--out", str(tmp_path / "fit")])
    assert "flexdesign diagnose fits gain, damping and natural frequency to it" in str(refused.exception)


def test_a_diagnosis_of_responses_says_what_would_tell_a_group_apart_or_why_not() -> None:
    f, response, _, _ = HIDDEN["driver"]
    found = found_in(measured(f, response))
    (telling,) = proposals(found)
    assert "voltage_range" in telling.reason
    document = diagnosis_report.document(found, [telling])
    assert "the validation lines of sweep" in document.summary[0]
    assert "nm/V" in document.summary[0]


def test_errors_of_lines_are_weighted_means() -> None:
    """An error of the same size at every line is that size, however unequal the noise of the lines."""
    rng = np.random.default_rng(5)
    frequencies = np.geomspace(1.0, 400.0, 40)
    response = FrequencyResponse("f", frequencies, 1e-6 * np.exp(1j * frequencies), role="validate")
    sigma = 1e-9 * np.exp(2.0 * rng.standard_normal(40))
    floor = noise_of_lines([response], {"f": LineNoise(sigma, known=True, dof=40.0)})
    scale = floor.rms["f"] / sigma
    assert np.sqrt(np.mean((scale * 3e-8) ** 2)) == pytest.approx(3e-8)
    assert sigma.min() < floor.rms["f"] < sigma.max()

"""What a user sees of a diagnosis and of an addition: words, report, result.json, the model that is written.

The recordings are those of `studies/hidden_effect_demo`, made by a simulator that shares no code with the engine; what
is hidden in them stands in answer.toml.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from flexdesign import diagnosis, effects
from flexdesign.cli import app
from flexdesign.core.errors import InputError
from flexdesign.core.serialise import to_json
from flexdesign.diagnosis import Diagnosis, Value, add_effect, initialised_comparison
from flexdesign.diagnosis.experiment_design.discrimination import proposals
from flexdesign.diagnosis.preparation.dataset import prepare
from flexdesign.diagnosis.preparation.spectra import FEWEST_PER_PERIOD
from flexdesign.diagnosis.result import CandidateRecord, compare_model
from flexdesign.dynamics import stage_model
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import AxisModel, StageModel
from flexdesign.measurements import recordings as runs
from flexdesign.measurements.recordings import Run
from flexdesign.report.diagnosis import (
    addition_report,
    diagnosis_charts,
    diagnosis_report,
    diagnosis_result,
    diagnosis_text,
)
from tests.conftest import Ended

DEMO = Path(__file__).parent.parent / "studies" / "hidden_effect_demo"
ANSWER = tomllib.loads((DEMO / "answer.toml").read_text())
CUBIC = ANSWER["effects"]["stress_stiffening"]["cubic"]
GROUP = ("stress_stiffening", "quadratic_stiffness")


@cache
def recordings() -> tuple[Run, ...]:
    return tuple(runs.read_runs([DEMO / "runs"]))


@cache
def stage() -> StageModel:
    return stage_model.read(str(DEMO / "model.toml"), [])


@cache
def diagnosed() -> Diagnosis:
    """The demo's diagnosis; it takes a quarter of a minute, so that all tests look at one."""
    return diagnosis.diagnose(stage(), recordings())


@cache
def added() -> add_effect.AddedEffect:
    return add_effect.add(stage(), "stress_stiffening", recordings())


def unknown() -> Diagnosis:
    """A diagnosis of something that no effect explains, made of the demo's."""
    left = {key: diagnosed().residuals_by_run["calibrated"] for key in ("calibrated", "found")}
    said = "9 times the noise remains; of smooth functions these explain most: force: position^3"
    return replace(
        diagnosed(),
        verdict="unknown",
        effects=(),
        possible_effects={"preload_loss": 0.4},
        remainder=said,
        residuals_by_run=left,
    )


def test_effects_of_one_step_share_what_they_explain() -> None:
    shares = {"creep": 0.5, "preload_loss": 0.4, "base_motion": 0.4}
    tried = (("creep",), ("preload_loss", "base_motion"))
    steps = tuple(CandidateRecord(names, (), 1e-6, 0.5, 9.0, "added") for names in tried)
    text = diagnosis_text.possible(replace(unknown(), possible_effects=shares, candidates=steps))
    assert "creep (50 %) and preload loss and base motion (together 40 %)" in text.lower()


def test_what_hinders_a_simulated_experiment_is_a_field_of_the_model() -> None:
    """`diagnose` has no option of the sampling rate, as `plan` has."""
    found = diagnosed()
    slow = replace(found.model, controller=replace(found.model.controller, rate=50.0))
    group = ("creep", "base_motion")
    (proposal,) = proposals(replace(found, model=slow, confusable=(group,)))
    assert proposal.reason.startswith("controller.rate is too slow to see the resonance")
    assert "--" not in proposal.reason


# --- the demo -------------------------------------------------------------------------------------------------------


def test_the_demo_is_found_out() -> None:
    found = diagnosed()
    assert found.verdict == "effects-found"
    assert [named.name for named in found.effects] == list(ANSWER["effects"])
    (value,) = found.effects[0].values
    # An interval of 95 % misses the truth once in twenty; twice its width it hardly ever does.
    middle, width = value.value, value.interval[1] - value.interval[0]
    assert abs(middle - CUBIC) < width
    assert width < 0.05 * CUBIC


def test_the_ladder_is_what_the_runs_kept_apart_leave() -> None:
    found = diagnosed()
    kept = [run.name for run in found.runs if run.role == "validate"]
    assert len(kept) == 2
    for rung, which in ((found.error_ladder[2], "calibrated"), (found.error_ladder[-1], "found")):
        left = np.concatenate([np.asarray(found.residuals_by_run[which][name], dtype=float) for name in kept])
        assert rung.error == pytest.approx(np.sqrt(np.nanmean(left**2)), rel=1e-9)


def test_result_holds_everything_with_its_unit() -> None:
    result = json.loads(json.dumps(to_json(diagnosis_result.result(diagnosed(), ()))))
    keys = "verdict effects candidates confusable near ladder noise_floor remainder where conflicts confidence made_by"
    assert set(keys.split()) <= set(result)
    (effect,) = result["effects"]
    (number,) = effect["parameters"]
    assert (effect["name"], number["name"], number["unit"]) == ("stress_stiffening", "cubic", "1/m^2")
    assert number["interval"][0] < number["value"] < number["interval"][1]
    labels = ["as designed, offsets alone", "as designed", "recalibrated", "+ stress_stiffening"]
    assert [step["label"] for step in result["ladder"]] == labels
    assert {step["error"]["unit"] for step in result["ladder"]} == {"m"}
    assert result["made_by"]["versions"]["flexdesign"]
    assert {run["role"] for run in result["made_by"]["runs"]} == {"identify", "validate"}
    shares = {}
    for which in ("calibrated", "final"):
        by = {b["by"]: b["parts"] for b in result["where"][which]}
        assert {"run", "frequency", "position", "velocity", "voltage"} <= set(by)
        shares[which] = [sum(part["share"] for part in parts) for parts in by.values()]
    assert shares["calibrated"] == pytest.approx([1.0] * len(shares["calibrated"]))
    assert all(share == pytest.approx(1.0) or share == 0.0 for share in shares["final"])  # nothing may be left


def test_where_it_failed_is_where_the_effect_acts() -> None:
    # Guides that stiffen move the resonance: the error lies about the mode, and in the run that reaches farthest.
    before = compare_model(diagnosed(), "calibrated")
    band = max(next(b for b in before.where if b.by == "frequency").parts, key=lambda part: part.share)
    assert band.lower < 118.3 < band.upper
    assert band.share > 0.5
    after = compare_model(diagnosed(), "found")
    assert after.rms < 0.02 * before.rms


def test_words_are_those_of_a_mechanical_engineer() -> None:
    said = " ".join(diagnosis_text.summary(diagnosed(), ()))
    for part in (
        "Missing: stress stiffening.",
        "1/mm^2 (95 %:",
        "explains",
        "What to do about it",
        "folded guides",
        "noise is",
    ):
        assert part in said
    assert "_" not in said


def test_the_report_opens_with_ladder_and_has_every_section() -> None:
    document = diagnosis_report.document(diagnosed(), ())
    assert [section.title for section in document.sections][:4] == [
        "The error ladder", "Where it fails", "Measured and predicted", "The effect: stress stiffening",
    ]  # fmt: skip
    files = [figure.file for figure in document.figures]
    assert len(set(files)) == len(files)
    assert {"ladder.svg", "spectrum_before.svg", "position_after.svg", "run_5-decaying-sine.svg"} <= set(files)
    effect = effects.find("stress_stiffening")
    text = " ".join(document.sections[3].paragraphs)
    assert all(part in text for part in (effect.physics, effect.where, effect.reveal, effect.remedy, effect.reference))


def test_effects_beside_a_remainder_are_said_with_it() -> None:
    """In one sentence after the effects: how much, of the noise and of the stroke."""
    found = replace(diagnosed(), remainder_rms=4e-7, stroke=2e-4, noise_floor=4e-8, remainder="the residual is slow")
    said = diagnosis_text.summary(found, ())
    assert said[0].endswith(
        "What remains, 0.400 µm (10 times the noise, 0.20 % of the stroke), is no effect that is known here."
    )
    assert any(part.startswith("What remains looks like this.") and "The residual is slow." in part for part in said)
    unsaid = replace(found, noise=replace(found.noise, known=False))
    assert diagnosis_text.summary(unsaid, ())[0].endswith(
        "the noise is unknown. What remains, 0.400 µm (0.20 % of the stroke), is no effect that is known here."
    )
    result = diagnosis_result.result(found, ())["remainder"]
    assert (result["rms"]["value"], result["over_noise"]) == pytest.approx((4e-7, 10.0))
    assert to_json(diagnosis_result.result(unsaid, ()))["remainder"]["over_noise"] is None


def test_an_unknown_verdict_says_what_was_refused_and_why() -> None:
    """What explains most first; nothing of what explains little, is chance, or was tried with other effects."""
    tried = [
        (("creep",), (), 0.5, 9.0),
        (("sensor_drift",), (), 0.7, 0.9),
        (("second_mode",), (), 0.87, 123.0),
        (("coulomb_friction",), (), 0.75, 9.0),
        (("bouc_wen",), ("creep",), 0.99, 9.0),
    ]
    records = tuple(CandidateRecord(names, present, 1e-7, *more, "is at an end") for names, present, *more in tried)
    found = replace(diagnosed(), verdict="unknown", effects=(), candidates=records)
    (said,) = [text for text in diagnosis_text.summary(found, ()) if "refused" in text]
    first, second = said.index("second mode, 87 %"), said.index("Coulomb friction, 75 %")
    assert first < second and "(is at an end)" in said
    assert not any(name in said for name in ("creep", "drift", "Bouc-Wen"))


def test_numbers_that_the_runs_do_not_show_are_said() -> None:
    said = " ".join(diagnosis_text.summary(replace(diagnosed(), undetermined=("natural_frequency",)), ()))
    assert "These runs do not determine natural frequency" in said
    assert "do not show" not in " ".join(diagnosis_text.summary(diagnosed(), ()))


# --- the other verdicts ---------------------------------------------------------------------------------------------


def test_nothing_missing_names_nothing() -> None:
    found = diagnosed()
    clean = replace(found, verdict="nothing-missing", effects=(), error_ladder=found.error_ladder[:2], candidates=())
    said = " ".join(diagnosis_text.summary(clean, ()))
    assert said.startswith("Nothing is missing.")
    assert "stiffening" not in said
    assert not any("What it is" in section.title for section in diagnosis_report.document(clean, ()).sections)


def test_unknown_says_what_it_looks_like_and_what_comes_near() -> None:
    said = " ".join(diagnosis_text.summary(unknown(), ()))
    assert said.startswith("Something is missing, and no effect known here explains a large and certain share of it.")
    assert "force: position^3" in said
    assert (
        "of what calibration leaves: preload loss (40 %)." in said and "flexdesign add MODEL preload_loss RUNS" in said
    )
    assert re.search(r"What remains looks like this. .*where the main mode is", said)
    assert diagnosis_report.document(unknown(), ()).sections[0].title == "The error ladder"


def test_what_cannot_be_told_apart_comes_with_the_experiment_that_would() -> None:
    found = replace(diagnosed(), confusable=(GROUP,))
    (told,) = proposals(found)
    (resolved,) = told.resolved
    best = resolved.proposed[0]
    # Odd or even in the position: runs about one bias cannot tell, one that reaches far on one side can.
    assert best.over_noise > 3
    assert best.difference == pytest.approx(best.over_noise * found.noise_floor)
    said = diagnosis_text.apart(GROUP, (told,))
    assert said.startswith("These runs do not distinguish stress stiffening from quadratic stiffness.")
    assert f"{best.command.name.replace('_', ' ')} " in said
    result = diagnosis_result.result(found, (told,))
    assert result["confusable"] == [list(GROUP)]
    assert result["tell_apart"][0]["pairs"][0]["experiments"][0]["over_noise"] == best.over_noise


def test_experiments_are_simulated_as_fast_as_the_modes_ask_for() -> None:
    """A controller that samples a slow stage ten times as often as its modes need costs ten times the simulations."""
    found = replace(diagnosed(), confusable=(GROUP,))
    frequency = found.model.axes["x"].natural_frequency
    fast = replace(found.model, controller=replace(found.model.controller, rate=1000 * frequency))
    (told,) = proposals(replace(found, model=fast))
    commands = [each.command for each in told.resolved[0].separations]
    assert all(command.period * frequency == pytest.approx(1 / FEWEST_PER_PERIOD, rel=0.01) for command in commands)


def test_a_stage_without_limits_is_told_what_is_missing_for_experiments() -> None:
    found = replace(diagnosed(), confusable=(GROUP,))
    bare = replace(found.model.axes["x"], actuator=None)
    (told,) = proposals(replace(found, model=replace(found.model, axes={"x": bare})))
    assert not told.resolved
    assert told.reason
    assert told.reason in diagnosis_text.apart(GROUP, (told,))


def test_an_effect_is_doubted_with_the_numbers_that_the_runs_do_not_determine() -> None:
    """Of a loop only its size is stated; the model holds b and c, and b is below |c|."""
    axis = diagnosed().model.axes["x"]
    held = {"a": 1e-7, "b": 0.01, "c": 0.02, "n": 1.0, "rest": 0.0}
    model = replace(diagnosed().model, axes={"x": replace(axis, effects={"bouc_wen": held})})
    size = effects.find("bouc_wen").parameters[0]
    value = Value(replace(size, name="bouc_wen.a"), 1e-7, (0.9e-7, 1.1e-7))
    named = replace(diagnosed().effects[0], name="bouc_wen", values=(value,))
    section = diagnosis_report._effect(replace(diagnosed(), model=model, effects=(named,)), named)
    assert any("b = 0.01 below |c| = 0.02" in text for text in section.paragraphs)


def test_pictures_suit_the_effect() -> None:
    assert diagnosis_report.pictures(["creep"])[0] == "steps"
    assert diagnosis_report.pictures(["mains_hum"])[0] == "spectrum"
    assert diagnosis_report.pictures(["bouc_wen"])[0] == "position"
    assert "position" in diagnosis_report.pictures(["stress_stiffening"])[:2]


def test_the_ladder_is_drawn_over_a_logarithm_only_where_it_spans_much() -> None:
    far = [diagnosis_charts.Step("as designed", 3.0, "3 µm"), diagnosis_charts.Step("+ creep", 0.02, "20 nm")]
    near = [diagnosis_charts.Step("as designed", 0.03, "30 nm"), diagnosis_charts.Step("+ creep", 0.02, "20 nm")]
    wide, narrow = (diagnosis_charts.error_ladder(steps, 0.02, "20 nm", "µm") for steps in (far, near))
    assert wide.startswith(b"<?xml")
    assert wide != narrow


# --- the model that is written --------------------------------------------------------------------------------------


def read_back(model: StageModel, tmp_path: Path) -> StageModel:
    path = tmp_path / "better.toml"
    path.write_text(stage_model.to_toml(model))
    return stage_model.read(str(path), [])


def predictions(axis: AxisModel) -> list[Any]:
    dynamics = AxisDynamics("x", axis, 100.0, tolerance=1e-7)
    return [dynamics.predict(run) for run in recordings()]


@pytest.mark.parametrize("found", [diagnosed, added], ids=["diagnose", "add"])
def test_the_written_model_gives_the_same_predictions(found: Any, tmp_path: Path) -> None:
    answer = found()
    again = read_back(answer.model, tmp_path).axes["x"]
    for name, value in answer.model.axes["x"].effects["stress_stiffening"].items():
        assert again.effects["stress_stiffening"][name] == pytest.approx(value, rel=1e-6)
    # Files hold seven digits, each number within 5e-7 of itself; the mode, of quality 20, makes 20 times as much of it.
    for one, other in zip(predictions(answer.model.axes["x"]), predictions(again), strict=True):
        assert np.max(np.abs(one - other)) < 1e-5 * np.max(np.abs(one)) + 1e-12


def test_what_is_known_of_the_numbers_is_written(tmp_path: Path) -> None:
    (value,) = added().values
    again = read_back(added().model, tmp_path).axes["x"]
    half = 0.5 * (value.interval[1] - value.interval[0])
    # A normal distribution holds 95 % within 1.96 standard deviations; the file has two digits.
    assert again.uncertainty["stress_stiffening.cubic"] == pytest.approx(half / 1.96 / value.value, rel=0.05)
    assert again.sources["stress_stiffening.cubic"].startswith("identified from 1-quiet, ")
    assert "5-decaying-sine" not in again.sources["stress_stiffening.cubic"]


def test_a_bound_without_an_end_is_no_uncertainty() -> None:
    parameter = next(p for p in effects.find("driver_bandwidth").parameters)
    value = Value(replace(parameter, name="driver.bandwidth"), 1000.0, (500.0, np.inf))
    model = add_effect.with_knowledge(stage(), "x", [value], recordings())
    assert "driver.bandwidth" not in model.axes["x"].uncertainty


# --- comparing ------------------------------------------------------------------------------------------------------


def missed(model: StageModel) -> tuple[float, float]:
    """Rms error of the demo's validation runs as `compare` states it: with initial conditions, and offsets alone."""
    kept = [run for run in initialised_comparison.compare(model, recordings()).runs if run.role == "validate"]
    assert len(kept) == 2
    fitted = np.concatenate([run.residual for run in kept])
    alone = [(run.offset_rms or 0.0, np.isfinite(run.residual).sum()) for run in kept]
    squares = sum(rms**2 * count for rms, count in alone) / sum(count for _, count in alone)
    return float(np.sqrt(np.nanmean(fitted**2))), float(np.sqrt(squares))


def test_compare_and_the_ladder_say_the_same_of_the_model_as_designed() -> None:
    fitted, alone = missed(stage())
    errors = {rung.label: rung.error for rung in diagnosed().error_ladder}
    assert fitted == pytest.approx(errors["as designed"], rel=0.01)
    assert alone == pytest.approx(errors["as designed, offsets alone"], rel=1e-3)


def test_compare_with_the_better_model_is_at_the_noise(tmp_path: Path) -> None:
    """As the ladder says; without initial conditions nobody would see it."""
    better = read_back(diagnosed().model, tmp_path)
    fitted, alone = missed(better)
    assert fitted == pytest.approx(diagnosed().error_ladder[-1].error, rel=0.05)
    assert fitted < 1.15 * diagnosed().noise_floor
    assert missed(stage())[0] > 10 * fitted
    assert alone > fitted


# --- adding ---------------------------------------------------------------------------------------------------------


def test_adding_what_is_hidden_brings_the_error_to_the_noise() -> None:
    found = added()
    assert not found.reason
    assert found.share > 0.99
    (value,) = found.values
    assert value.interval[0] < CUBIC < value.interval[1] or abs(value.value / CUBIC - 1) < 0.01
    assert [rung.label for rung in found.error_ladder] == ["as designed", "recalibrated", "+ stress_stiffening"]
    assert found.error_ladder[-1].error < 1.15 * found.noise_floor < found.error_ladder[1].error


def test_an_effect_that_is_not_needed_is_said_to_be(tmp_path: Path) -> None:
    better = add_effect.add(added().model, "creep", recordings())
    assert better.reason
    without_effect, (low, _) = 0.0, better.values[0].interval
    assert low == pytest.approx(without_effect, abs=1e-3)
    assert "creep" in read_back(better.model, tmp_path).axes["x"].effects


@pytest.mark.parametrize(
    ("reason", "said"),
    [
        ("no more than chance gives", "It is not needed: it explains no more than chance gives."),
        ("moves the prediction by less than the tolerance", "It is not needed: it moves the prediction by less"),
        (
            "second_mode.share at the end of what is plausible",
            "It is not determined: the fit puts second_mode.share at the end of what is plausible.",
        ),
        (
            "creep.share and creep.time is not determined: its null is less than 1.96 standard errors away",
            "It is not determined: the null of creep.share and creep.time is less than 1.96 standard errors away.",
        ),
    ],
)
def test_why_an_effect_is_not_added_is_a_sentence(reason: str, said: str) -> None:
    text = addition_report.summary(replace(added(), reason=reason))
    assert any(sentence.startswith(said) for sentence in text)


def looped(found: add_effect.AddedEffect) -> add_effect.InTheLoop:
    return add_effect.in_the_loop((found.name,), found.axis, found.without, found.model)


def test_the_loop_is_simulated_without_and_with_the_effect() -> None:
    loop = looped(added())
    assert loop.simulation is not None
    variants = {case.variant for case in loop.simulation.cases}
    assert variants == {"as modelled", "with stress stiffening"}
    feedforward = [case for case in loop.simulation.cases if case.controller == "feedforward + robust"]
    errors = {c.variant: c.measure("x", "max_error") for c in feedforward if c.experiment.name == "sine x"}
    without, with_it = errors["as modelled"], errors["with stress stiffening"]
    assert without is not None
    assert with_it is not None
    # The feedforward inverts a stage without it, so that all of it is left to the loop.
    assert with_it.value > 2 * without.value


def test_what_has_no_cause_in_experiments_is_not_simulated() -> None:
    for name, needs in (("thermal_expansion", "a record of T"), ("abbe_error", "another axis that moves")):
        loop = looped(replace(added(), name=name))
        assert loop.simulation is None
        assert needs in loop.reason


def test_what_a_sensor_picks_up_moves_a_closed_loop() -> None:
    """A slow hum is taken for motion: the loop moves against it, all of it, and a feedforward does not."""
    hum, quiet = {"mains_hum": {"amplitude": 1e-6, "frequency": 2.0, "phase": 0.0}}, added().without
    axis = quiet.axes["x"]
    humming = replace(quiet, axes={"x": replace(axis, effects={**axis.effects, **hum})})
    loop = looped(replace(added(), name="mains_hum", model=humming))
    assert loop.simulation is not None
    steps = {
        case.variant: case.response.motion[0]
        for case in loop.simulation.cases
        if (case.experiment.name, case.controller) == ("sine x", "robust")
    }
    moved = steps["with mains hum"] - steps["as modelled"]
    assert np.max(np.abs(moved)) == pytest.approx(1e-6, rel=0.2)


# --- the commands ---------------------------------------------------------------------------------------------------


def test_diagnose_writes_report_and_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = diagnosed()
    monkeypatch.setattr(diagnosis, "diagnose", lambda *_, **__: found)
    out, model = tmp_path / "out", tmp_path / "better.toml"
    arguments = ["diagnose", str(DEMO / "model.toml"), str(DEMO / "runs"), "--out", str(out), "-o", str(model)]
    told = CliRunner().invoke(app, arguments)
    assert told.exit_code == 0, told.output
    assert "Missing: stress stiffening" in " ".join(told.stdout.split())
    assert "noise floor" in told.stdout
    assert {"report.html", "report.md", "result.json", "ladder.svg"} <= {path.name for path in out.iterdir()}
    assert stage_model.read(str(model), []).axes["x"].effects["stress_stiffening"]["cubic"]
    result = CliRunner().invoke(app, [*arguments[:-2], "--json"])
    assert json.loads(result.stdout) == json.loads((out / "result.json").read_text())
    assert (out / "stage_model.toml").read_text() == model.read_text()
    simulated = CliRunner().invoke(app, ["simulate", str(model), "--out", str(tmp_path / "simulated")])
    assert simulated.exit_code == 0, simulated.output


def test_add_takes_an_effect_of_ones_own(tmp_path: Path) -> None:
    mine = tmp_path / "my_guides.py"
    source = Path(str(effects.__path__[0])) / "stress_stiffening.py"
    mine.write_text(source.read_text().replace('name="stress_stiffening"', 'name="my_guides"'))
    out, model = tmp_path / "out", tmp_path / "better.toml"
    arguments = ["add", str(DEMO / "model.toml"), str(mine), str(DEMO / "runs"), "--out", str(out), "-o", str(model)]
    told = CliRunner().invoke(app, arguments)
    assert told.exit_code == 0, told.output
    assert "My guides: cubic 0.76" in told.stdout
    assert '[axis.x.effects."my_guides.py"]' in model.read_text() and str(tmp_path) not in model.read_text()
    (name,) = set(stage_model.read(str(model), []).axes["x"].effects) - {"bouc_wen"}
    assert effects.find(name).name == "my_guides"
    result = json.loads((out / "result.json").read_text())
    assert (result["effect"]["name"], result["effect"]["needed"]) == ("my_guides", True)
    assert result["effect"]["parameters"][0]["value"] == pytest.approx(CUBIC, rel=0.01)
    assert result["loop"]["simulated"]


def test_sizes_are_stated_in_a_unit_or_in_percent_of_the_stroke() -> None:
    """The stroke is the largest peak-to-peak reading of a run, whatever the gain of the model, as for `compare`."""
    stroke = max(float(np.ptp(run.columns["x"])) for run in recordings())
    for text, value in (("0.1 %", 1e-3 * stroke), ("5%", 0.05 * stroke), ("0.2 um", 2e-7), (None, None)):
        assert add_effect.size(stage(), recordings(), None, "--tolerance", text) == pytest.approx(value)
    wrong = stage_model.read(str(DEMO / "model.toml"), ["axis.x.gain=0.3 um/V"])
    assert prepare(wrong, recordings(), None, None).stroke == pytest.approx(stroke)
    assert initialised_comparison.compare(wrong, recordings()).runs[0].stroke == pytest.approx(stroke)


@pytest.mark.parametrize("verb", ["diagnose", "compare", "add"])
def test_a_stated_noise_reaches_the_fit(verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[str, Any] = {}

    def stop(*_: Any, **options: Any) -> None:
        asked.update(options)
        raise InputError("test", "asked", None, "no more")

    for module, name in ((diagnosis, "diagnose"), (initialised_comparison, "compare"), (add_effect, "add")):
        monkeypatch.setattr(module, name, stop)
    given = [str(DEMO / "model.toml"), *(["creep"] if verb == "add" else []), str(DEMO / "runs")]
    more = ["--tolerance", "0.1 %"] if verb == "diagnose" else []
    CliRunner().invoke(app, [verb, *given, "--noise", "3 nm", *more, "--out", str(tmp_path / "out")])
    assert asked["noise"] == pytest.approx(3e-9)
    if more:
        assert asked["tolerance"] == pytest.approx(add_effect.size(stage(), recordings(), None, "--tolerance", "0.1 %"))


@pytest.mark.parametrize("stated", [None, 3e-9])
def test_a_stated_noise_is_taken_as_it_is(stated: float | None) -> None:
    """Whatever the quiet record shows, 20 nm; test runs and those that are fitted alike."""
    about = prepare(stage(), recordings(), None, None, stated)
    assert about.noise.known
    assert (about.noise.source == "as stated") is (stated is not None)
    assert about.noise_rms == pytest.approx(stated or 2e-8, rel=0.1)
    if stated:
        ones = np.ones((len(about.runs[1].time), 1))
        assert about.whitening.whiten(about.runs[1], stated * ones) == pytest.approx(ones)


# --- bad input ------------------------------------------------------------------------------------------------------


def kept_apart() -> list[Run]:
    return [replace(run, role="validate", role_is_stated=True) for run in recordings()]


def along_y() -> list[Run]:
    turned = [({**run.columns, "y": run.columns["x"]}, {**run.si, "y": run.si["x"]}) for run in recordings()]
    return [
        replace(
            run,
            columns={k: v for k, v in columns.items() if k != "x"},
            si={k: v for k, v in si.items() if k != "x"},
            axis="y",
        )
        for run, (columns, si) in zip(recordings(), turned, strict=True)
    ]


@pytest.mark.parametrize(
    ("effect", "given", "names"),
    [
        ("crep", recordings, ("crep", "did you mean creep")),
        ("nowhere.py", recordings, ("nowhere.py", "no Python file")),
        ("bouc_wen", recordings, ("bouc_wen", "acts on axis x already")),
        ("thermal_expansion", recordings, ("1-quiet", "thermal_expansion", "a column T", "leave the run out")),
        ("cross_coupling", recordings, ("1-quiet", "cross_coupling", "another axis")),
        ("quantisation", recordings, ("quantisation", "sensor.resolution")),
        ("creep", kept_apart, ("RUNS", "role identify")),
        ("creep", along_y, ("1-quiet", "no response of axis x")),
    ],
)
def test_add_refuses_in_one_message(effect: str, given: Any, names: tuple[str, ...]) -> None:
    with pytest.raises(InputError) as refused:
        add_effect.add(stage(), effect, list(given()))
    for name in names:
        assert name in str(refused.value)


@pytest.mark.parametrize("given", [kept_apart, along_y])
def test_diagnose_refuses_runs_that_do_not_fit(given: Any) -> None:
    with pytest.raises(InputError):
        diagnosis.diagnose(stage(), given())


@pytest.mark.parametrize(
    ("arguments", "names"),
    [
        (["diagnose", "{model}", "{runs}", "--effect", "crep"], ("--effect = crep", "did you mean creep")),
        (["diagnose", "{model}", "{runs}", "--tolerance", "5 V"], ("--tolerance = 5 V", "length")),
        (["diagnose", "{model}", "{runs}", "--tolerance", "-5 nm"], ("--tolerance = -5 nm", "more than zero")),
        (["diagnose", "{model}", "{runs}", "--tolerance", "much"], ("--tolerance = much",)),
        (["diagnose", "{model}", "{runs}", "--tolerance", "-1 %"], ("--tolerance = -1 %", "more than zero")),
        (["diagnose", "{model}", "{runs}", "--noise", "3 V"], ("--noise = 3 V", "length")),
        (["diagnose", "{model}", "{runs}", "--noise", "3"], ("--noise = 3", 'write for example "3 nm"')),
        (["diagnose", "{model}", "{runs}", "--noise", "0 nm"], ("--noise = 0 nm", "more than zero")),
        (["compare", "{model}", "{runs}", "--noise", "nan"], ("--noise = nan",)),
        (["add", "{model}", "creep", "{runs}", "--noise", "inf nm"], ("--noise = inf nm",)),
        (["diagnose", "{model}", "{runs}", "--axis", "y"], ("--axis = y", "no such axis")),
        (["diagnose", "{model}", "nowhere"], ("nowhere",)),
        (["add", "{model}", "crep", "{runs}"], ("EFFECT = crep", "did you mean creep")),
        (["add", "{model}", "thermal_expansion", "{runs}"], ("thermal_expansion", "a column T")),
    ],
)
def test_commands_end_with_one_message(
    arguments: list[str], names: tuple[str, ...], tmp_path: Path, command_line: Callable[..., Ended]
) -> None:
    given = [a.format(model=DEMO / "model.toml", runs=DEMO / "runs") for a in arguments]
    told = command_line(*given, "--out", str(tmp_path / "out"))
    assert told.code == 2
    assert told.stdout == ""
    said = [line for line in told.stderr.splitlines() if line.startswith("flexdesign: ")]
    assert len(said) == 1
    assert "Traceback" not in told.stderr
    for name in names:
        assert name in said[0]
    assert not (tmp_path / "out").exists()

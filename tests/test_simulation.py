"""Simulations of small stages: measures against closed forms, what is said plainly, what the command line writes."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.core.serialise import to_json
from flexdesign.dynamics import experiments, stage_model
from flexdesign.dynamics import stage_dynamics as stages
from flexdesign.dynamics.experiments import simulation, standard_experiments
from flexdesign.dynamics.experiments.simulation import Case, Simulation
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.measurements.recordings import read_run, read_runs
from flexdesign.report import published_rows
from flexdesign.report.render import to_markdown
from flexdesign.report.simulation import simulation_report

Run = Callable[..., Any]

#: One axis whose motion has closed forms: a linear resonator.
LINEAR = """\
format = 1

[axis.x]
natural_frequency = "100 Hz"
damping_ratio = 0.1
gain = "2 um/V"
"""
RANGE = """
[axis.x.actuator]
free_stroke = "40 um"
voltage_range = ["0 V", "100 V"]
"""
HYSTERESIS = """\
hysteresis = { model = "bouc-wen", a = "0.4 um/V", b = "0.02 1/V", c = "0.005 1/V", n = 1 }
"""
STEP = 'reference = { shape = "step", start = "0 um", target = "10 um", wait = "5 ms", hold = "300 ms" }'
SINE = 'command = { shape = "sine", low = "0 V", high = "50 V", frequency = "1 Hz", cycles = 2 }'


def experiment(what: str, more: str = "", name: str = "tried", axes: str = '["x"]') -> str:
    return f'\n[[experiment]]\nname = "{name}"\naxes = {axes}\n{what}\n{more}\n'


def read(folder: Path, text: str) -> StageModel:
    (folder / "model.toml").write_text(text)
    return stage_model.read(folder / "model.toml")


def simulated(folder: Path, model: str, study: str) -> Simulation:
    """Return what a study, given without its first line, makes of a model."""
    stage = read(folder, model)
    (folder / "study.toml").write_text(f"format = 1\n{study}")
    plan = experiments.read(folder / "study.toml", list(stage.axes))
    changed = experiments.variants(plan, lambda changes: stage_model.read(folder / "model.toml", changes))
    return simulation.run(stage, changed, plan, lambda _: None)


def measured(case: Case, name: str, axis: str = "x") -> float:
    found = case.measure(axis, name)
    assert found is not None
    return found.value


def report(found: Simulation) -> str:
    return to_markdown(simulation_report.document(found))


# --- measures against closed forms ----------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.05, 0.1, 0.3])
def test_an_open_loop_step_overshoots_and_settles_as_a_resonator_does(tmp_path: Path, damping: float) -> None:
    """Overshoot exp(-pi zeta / sqrt(1 - zeta^2)); settling where 1 - y last leaves two percent.

    25 samples in a period: the highest of them is at most half a sample, pi/25 of phase, beside the peak, so that the
    overshoot falls short by 0.8 % at most. The response leaves the band within one sample, 0.4 ms.
    """
    model = LINEAR.replace("0.1\n", f"{damping}\n")
    case = simulated(tmp_path, model, experiment(STEP)).cases[0]
    root, w = math.sqrt(1 - damping**2), 2 * math.pi * 100
    peak = 10e-6 * math.exp(-math.pi * damping / root)
    assert 0.992 * peak <= measured(case, "overshoot") <= peak * (1 + 1e-6)
    time = np.arange(0, 0.3, 1e-6)
    error = np.exp(-damping * w * time) * np.cos(w * root * time - math.asin(damping)) / root
    settled = time[np.flatnonzero(np.abs(error) > 0.02)[-1]]
    assert measured(case, "settling_time") == pytest.approx(settled, abs=0.4e-3)
    assert measured(case, "steady_error") == pytest.approx(0, abs=1e-9)  # exp(-0.05 w 0.27 s) of 10 um is 2 nm
    assert case.response.error < 1e-6


def test_motion_that_couples_is_what_ratio_and_square_make_of_it(tmp_path: Path) -> None:
    """y = r x + q x^2, eq (25) with q = 1/2L: over a slow sine from zero to A, y/x comes to r + q A."""
    model = LINEAR + '\n[axis.y]\nnatural_frequency = "100 Hz"\ndamping_ratio = 0.1\ngain = "1 um/V"\n'
    model += '\n[coupling]\ny_from_x = "1.5 %"\n\n[coupling.quadratic]\ny_from_x = "0.02 1/mm"\n'
    case = simulated(tmp_path, model, experiment(SINE)).cases[0]
    # 100 um; half a cycle per second on a resonance of 100 Hz is quasi-static to (1/100)^2 = 1e-4
    assert measured(case, "amplitude") == pytest.approx(100e-6, rel=2e-4)
    assert measured(case, "coupling", "y") == pytest.approx(0.015 + 0.02e3 * 100e-6, rel=2e-4)


def test_what_a_sensor_sees_of_another_axis_is_part_of_the_loop(tmp_path: Path) -> None:
    """An integrating controller of y holds its reading, so that y moves by the share of x the other way."""
    model = LINEAR + RANGE + '\n[axis.y]\nnatural_frequency = "100 Hz"\ndamping_ratio = 0.1\ngain = "2 um/V"\n'
    model += '\n[axis.y.effects.abbe_error]\nlinear = "5 %"\n'
    model += '\n[axis.y.effects.thermal_expansion]\ncoefficient = "1 um/K"\n'
    case = simulated(tmp_path, model, experiment(STEP, 'controllers = ["robust"]', axes='["x", "y"]')).cases[0]
    assert case.response.motion[:, -1] == pytest.approx([10e-6, 9.5e-6], rel=1e-3)
    assert any("y: thermal expansion needs a record of T" in said for said in case.cautions)


def test_a_slow_sine_spans_the_gain_times_the_voltage(tmp_path: Path) -> None:
    """Without hysteresis the loop is as wide as its phase: 2 zeta f/f0 of the resonance, pi f T of the held command."""
    case = simulated(tmp_path, LINEAR, experiment(SINE)).cases[0]
    assert measured(case, "loop_span") == pytest.approx(100e-6, rel=2e-4)
    assert measured(case, "secant_gain") == pytest.approx(2e-6, rel=2e-4)
    assert measured(case, "loop_width_relative") == pytest.approx(2 * 0.1 / 100 + math.pi * 1e-3, rel=0.01)


def test_feedforward_inverts_the_hysteresis_that_it_knows(tmp_path: Path) -> None:
    """At a tenth of a hertz dynamics are gone (2 zeta f/f0 = 2e-4): only the inverse is left to err."""
    model = LINEAR + HYSTERESIS + RANGE
    what = 'reference = { shape = "sine", low = "0 um", high = "120 um", frequency = "0.1 Hz", cycles = 2 }'
    found = simulated(tmp_path, model, experiment(what, 'controllers = ["open loop", "feedforward"]'))
    alone, forward = (measured(case, "max_error") for case in found.cases)
    assert alone > 4e-6  # some percent of 120 um
    assert forward < 1e-3 * 120e-6
    assert forward < alone / 10


def test_a_stage_that_was_cycled_closes_its_first_loop(tmp_path: Path) -> None:
    """At rest after many cycles a further one over the whole range returns to zero; a fresh stage's first does not."""
    whole = SINE.replace("50 V", "100 V").replace("cycles = 2", "cycles = 1")
    ends = {}
    for cycled in ("true", "false"):
        found = simulated(tmp_path, LINEAR + HYSTERESIS + RANGE, f"cycled = {cycled}\n{experiment(whole)}")
        ends[cycled] = abs(found.cases[0].response.motion[0, -1]) / measured(found.cases[0], "amplitude")
    assert ends["true"] < 1e-3  # what the phase of the resonance leaves: (2 pi f)^2-terms of order 1e-4
    assert ends["false"] > 0.02


def test_controllers_that_do_not_know_are_made_for_the_stage_they_believe(tmp_path: Path) -> None:
    study = '\n[variants.soft]\nset = ["axis.x.natural_frequency=85 Hz"]\n'
    study += '\n[variants.hidden]\nset = ["axis.x.natural_frequency=85 Hz"]\ncontrollers_know = false\n'
    study += experiment(STEP, 'controllers = ["ziegler-nichols"]\nvariants = ["as modelled", "soft", "hidden"]')
    modelled, soft, hidden = simulated(tmp_path, LINEAR, study).cases
    assert hidden.pid == modelled.pid != soft.pid
    assert hidden.margins["x"].ms != modelled.margins["x"].ms  # but they act on the stage there is


def test_a_variant_may_have_a_clock_of_its_own(tmp_path: Path) -> None:
    study = '\n[variants.slow]\nset = ["controller.rate=500 Hz"]\n'
    study += experiment(STEP, 'controllers = ["ziegler-nichols"]\nvariants = ["as modelled", "slow"]')
    fast, slow = simulated(tmp_path, LINEAR, study).cases
    assert (fast.margins["x"].period, slow.margins["x"].period) == (1e-3, 2e-3)
    assert slow.response.time[-1] == pytest.approx(0.304)  # 5 ms are two periods and a half: it waits three


# --- said plainly, before or as it matters ----------------------------------------------------------------------------

WILD = '\n[controllers.wild.axis.x]\nkp = "1 V/um"\nti = "1 ms"\n'
TRIED = 'controllers = ["open loop", "wild", "ziegler-nichols"]'


def test_unstable_gains_are_named_and_the_others_run(tmp_path: Path) -> None:
    """kp k_v = 2 on a light resonance, and no voltage limits: the motion grows without bound."""
    found = simulated(tmp_path, LINEAR, WILD + experiment(STEP, TRIED))
    alone, wild, tame = found.cases
    assert wild.response.diverged is not None and 0.005 < wild.response.diverged < 0.3
    assert wild.response.time[-1] < wild.response.diverged
    assert (alone.response.diverged, tame.response.diverged) == (None, None)
    assert wild.measures == {} and alone.measures and tame.measures
    text = report(found)
    assert re.search(
        r"Caution \(wild\): x: unstable: the closed loop has a pole of modulus [\d.]+, a motion at \d+", text
    )
    assert "gains must fall by a factor of more than" in text
    stopped = re.search(r"the motion runs away: the simulation stopped at ([\d.]+) s", text)
    assert stopped and float(stopped[1]) == pytest.approx(wild.response.diverged, rel=0.005)
    assert "Unstable: tried (wild, as modelled)." in text
    row = next(line for line in text.splitlines() if line.startswith("| wild |"))
    assert "unstable" in row
    assert "integration error is estimated at" not in text  # there is none to estimate


def test_the_growth_of_an_unstable_loop_is_that_of_its_pole(tmp_path: Path) -> None:
    """Sample after sample the envelope grows by the modulus of the outermost pole."""
    wild = simulated(tmp_path, LINEAR, WILD + experiment(STEP, 'controllers = ["wild"]')).cases[0]
    radius = abs(wild.margins["x"].closed_loop_poles[0])
    size, half = np.abs(wild.response.motion[0]), len(wild.response.time) // 2
    lasted = (len(size) - half) // 2
    late, early = size[-lasted:].max(), size[half : half + lasted].max()
    passed = 1e3 * (wild.response.time[len(size) - lasted] - wild.response.time[half])  # samples of 1 ms
    # Peaks are read off a grid of finite width: good to a few percent in the exponent.
    assert math.log(late / early) / passed == pytest.approx(math.log(radius), rel=0.1)


def test_an_unstable_loop_within_limits_is_measured_and_named(tmp_path: Path) -> None:
    """Voltage limits turn the growth into an oscillation that never settles."""
    found = simulated(tmp_path, LINEAR + RANGE, WILD + experiment(STEP, TRIED))
    wild = found.cases[1]
    assert wild.response.diverged is None
    assert measured(wild, "settling_time") == math.inf
    text = report(found)
    assert "(wild): x: unstable" in text and "(wild): x: limits cut the command" in text
    assert "| never |" in next(line for line in text.splitlines() if line.startswith("| wild |"))


def test_a_diverged_run_gives_valid_json(tmp_path: Path) -> None:
    found = simulated(tmp_path, LINEAR, WILD + experiment(STEP, TRIED))
    text = json.dumps(to_json(simulation_report.result(found)), allow_nan=False)
    case = json.loads(text)["cases"][1]
    assert case["diverged"]["unit"] == "s" and case["measures"] == {}
    assert case["margins"]["x"]["stable"] is False


def test_sampling_too_coarse_for_the_resonance_is_said_before_anything_is_run(tmp_path: Path) -> None:
    model = LINEAR.replace("100 Hz", "600 Hz").replace("0.1\n", "0.02\n")
    said = "Sampling is too coarse: the mode at 600 Hz has 1.7 samples per period at 1000 Hz, and the controller sees"
    assert [text for text in simulation.validity(read(tmp_path, model)) if text.startswith(f"x: {said}")]
    found = simulated(tmp_path, model, WILD + experiment(STEP, 'controllers = ["wild"]'))
    assert any(caution.startswith(f"x: {said}") for caution in found.cases[0].cautions)
    summary = report(found).partition("\n## ")[0]
    assert said in summary
    assert not simulation.validity(read(tmp_path, LINEAR))


def test_a_model_of_a_design_without_voltages_says_that_it_has_no_gain(tmp_path: Path) -> None:
    model = read(tmp_path, LINEAR)
    axes = {name: replace(axis, gain=math.nan) for name, axis in model.axes.items()}
    (remark,) = simulation.stage_model_cautions(replace(model, axes=axes))
    assert "no gain" in remark and "actuator.voltage_range" in remark


def test_a_command_beyond_the_limits_is_said_with_its_share_of_time(tmp_path: Path) -> None:
    """A sine from 0 to 120 V is above 100 V for acos(2 x 100/120 - 1) / pi of the time, 27 %, first after 0.37 s."""
    beyond = SINE.replace("50 V", "120 V")
    case = simulated(tmp_path, LINEAR + RANGE, experiment(beyond)).cases[0]
    above = math.acos(2 * 100 / 120 - 1) / math.pi
    begins = math.ceil(1e3 * (1 - above) / 2) / 1e3  # with a sample of the controller
    first, then = case.cautions
    assert first == "x: the command asks for 120.0 V, and 0 V to 100.0 V are allowed: it is cut off."
    assert then == f"x: limits cut the command {100 * above:.0f} % of the time, first at {begins:.3g} s."
    assert measured(case, "amplitude") == pytest.approx(200e-6, rel=0.01)  # what 100 V give, and a little swing


def test_a_command_wholly_beyond_the_limits_leaves_nothing_to_measure(tmp_path: Path) -> None:
    below = SINE.replace('low = "0 V", high = "50 V"', 'low = "-50 V", high = "-10 V"')
    two = LINEAR + RANGE + '\n[axis.y]\nnatural_frequency = "90 Hz"\ndamping_ratio = 0.1\ngain = "1 um/V"\n'
    case = simulated(tmp_path, two, experiment(below)).cases[0]
    assert "limits cut the command 100 % of the time, first at 0 s." in case.cautions[1]
    assert measured(case, "amplitude") == 0 and "y" not in case.measures


def test_a_closed_loop_at_its_limits_is_said_with_share_and_first_moment(tmp_path: Path) -> None:
    """200 um are all that 100 V give; a sine to 220 um is out of reach from some moment on."""
    what = 'reference = { shape = "sine", low = "0 um", high = "220 um", frequency = "1 Hz", cycles = 1 }'
    case = simulated(tmp_path, LINEAR + RANGE, experiment(what, 'controllers = ["robust"]')).cases[0]
    (said,) = [text for text in case.cautions if "limits cut" in text]
    share, first = map(float, re.findall(r"([\d.]+) %.* at ([\d.]+) s", said)[0])
    reach = math.acos(1 - 2 * 200 / 220) / (2 * math.pi)  # when the reference passes what 100 V hold
    assert first == pytest.approx(reach, abs=0.01)  # the loop lags, and presses, by some samples of 1 ms
    assert share / 100 == pytest.approx(1 - 2 * reach, abs=0.03)


@pytest.mark.parametrize(("c", "warned"), [("0.03", True), ("-0.03", True), ("0.02", False), ("-0.02", False)])
def test_bouc_wen_outside_of_its_bounds_is_warned_about(tmp_path: Path, c: str, warned: bool) -> None:
    model = LINEAR + HYSTERESIS.replace("0.005", c) + RANGE
    found = simulated(tmp_path, model, experiment(SINE))
    said = "(open loop): x: Bouc-Wen with b = 0.02 below |c| = 0.03: the loop is neither bounded nor dissipative"
    assert (said in report(found)) == warned


def test_a_run_too_short_for_its_measures_says_so(tmp_path: Path) -> None:
    """Five samples in a cycle are too few for a loop; the sine is run all the same."""
    model = LINEAR.replace("100 Hz", "1 Hz")
    short = SINE.replace("1 Hz", "200 Hz")
    case = simulated(tmp_path, model, experiment(short)).cases[0]
    assert [q.name for q in case.measures["x"]] == ["amplitude"]
    assert case.cautions == ("x: not measured: a cycle of 5 samples is too short, or longer than the record of 11.",)


@pytest.mark.parametrize("cycles", [0.2, 0.5, 1.0, 1.5])
def test_parts_of_a_square_wave_are_run(tmp_path: Path, cycles: float) -> None:
    square = f'reference = {{ shape = "square", low = "0 um", high = "9 um", frequency = "5 Hz", cycles = {cycles} }}'
    case = simulated(tmp_path, LINEAR, experiment(square)).cases[0]
    names = {q.name for q in case.measures["x"]}
    assert ("settling_time" in names) == (cycles >= 1)


def test_what_is_shown_as_unstable_did_diverge(tmp_path: Path) -> None:
    """A hold of volts has neither loop nor step to measure; that is no instability."""
    hold = 'command = { shape = "hold", level = "5 V", time = "50 ms" }'
    rows = simulation_report.digest(simulated(tmp_path, LINEAR, experiment(hold))).rows
    assert "unstable" not in str(rows)


def test_a_published_zero_is_compared(tmp_path: Path) -> None:
    zero = 'published = [{ measure = "overshoot", value = "0 um", place = "Fig 1", axis = "x" }]'
    text = report(simulated(tmp_path, LINEAR, experiment(STEP, zero)))
    row = next(line for line in text.splitlines() if "| 0 um |" in line)
    assert "7.2" in row  # exp(-pi 0.1 / sqrt(0.99)) of 10 um


# --- what a difference proves -----------------------------------------------------------------------------------------


def verdicts(found: Simulation) -> dict[str, str]:
    """Return what the table says of each published number, by measure and run."""
    return {f"{row[1]}: {row[2]}": row[5] for row in published_rows.table(found).rows}


def compared(measure: str, value: str, uncertainty: str = "", axis: str = "x") -> str:
    spread = f', uncertainty = "{uncertainty}"' if uncertainty else ""
    return f'published = [{{ measure = "{measure}", value = "{value}"{spread}, place = "Fig 1", axis = "{axis}" }}]'


def test_a_number_that_the_stage_was_set_to_proves_nothing(tmp_path: Path) -> None:
    study = experiment(SINE, compared("loop_span", "100 um", "1 um"))
    free = verdicts(simulated(tmp_path, LINEAR, study))
    held = verdicts(simulated(tmp_path, LINEAR + 'fitted = ["loop_span"]\n', study))
    assert free["loop span, x: open loop"].endswith("within ±")
    assert held["loop span, x: open loop"] == "used to set the model"


def test_an_axis_set_to_what_is_no_measure_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        simulated(tmp_path, LINEAR + 'fitted = ["loop_spam"]\n', experiment(SINE))
    assert (caught.value.file, caught.value.field, caught.value.value) == ("model.toml", "axis.x.fitted", "loop_spam")
    assert "did you mean loop_span?" in caught.value.remedy


def test_a_difference_has_a_cause_that_was_seen_or_is_unexplained(tmp_path: Path) -> None:
    """Of 120 um 50 V reach 100, for no reason that is known, and a range of 40 V allows 80."""
    study = experiment(SINE, compared("loop_span", "120 um", "1 um"))
    said = verdicts(simulated(tmp_path, LINEAR, study))["loop span, x: open loop"]
    assert said == "-20.0 um, beyond ±: unexplained"
    narrow = LINEAR + RANGE.replace("100 V", "40 V")
    said = verdicts(simulated(tmp_path, narrow, study))["loop span, x: open loop"]
    assert said.endswith("beyond ±: limits cut the command")


def test_an_unstable_loop_is_the_cause(tmp_path: Path) -> None:
    study = WILD + experiment(STEP, 'controllers = ["wild"]\n' + compared("overshoot", "1 um", "0.1 um"))
    found = simulated(tmp_path, LINEAR + RANGE, study)
    assert not found.cases[0].margins["x"].stable
    (said,) = verdicts(found).values()
    assert said.endswith("beyond ±: the loop is unstable")  # rather than the limits, which cut its command as well


def test_the_damping_that_a_published_settling_takes_gives_it(tmp_path: Path) -> None:
    """A stage with the ratio that the report states settles when it was printed to, to half a period of 10 ms."""
    slow = STEP.replace("300 ms", "900 ms")
    study = experiment(slow, compared("settling_time", "400 ms"))
    guessed = LINEAR + 'assumed = ["damping_ratio"]\n'
    text = report(simulated(tmp_path, guessed, study))
    said = re.search(r"of 400 ms at 100\.0 Hz needs a ratio of ([\d.]+); the model has 0\.100 \(assumed\)", text)
    assert said
    with_it = simulated(tmp_path, LINEAR.replace("0.1\n", f"{said[1]}\n"), study).cases[0]
    assert measured(with_it, "settling_time") == pytest.approx(0.4, abs=5e-3)
    assert "assumed" not in report(simulated(tmp_path, LINEAR, study)).partition("*Published")[0]


def test_a_variant_may_multiply_what_the_model_has(tmp_path: Path) -> None:
    study = '\n[variants.more]\nset = ["axis.x.hysteresis.a*=1.2", "axis.x.damping_ratio *= 0.5"]\n'
    study += experiment(SINE, 'variants = ["more"]')
    axis = simulated(tmp_path, LINEAR + HYSTERESIS + RANGE, study).variants["more"].axes["x"]
    assert axis.effects["bouc_wen"]["a"] == pytest.approx(0.48e-6, rel=1e-12)
    assert axis.damping_ratio == pytest.approx(0.05, rel=1e-12)
    with pytest.raises(InputError) as caught:
        simulated(tmp_path, LINEAR, study)  # which has no hysteresis
    assert caught.value.field == "variants.more.set"
    assert caught.value.value == "axis.x.hysteresis.a*=1.2"


# --- the command line -------------------------------------------------------------------------------------------------

STUDY = (
    "format = 1\n"
    + '\n[variants.soft]\nset = ["axis.x.damping_ratio=0.05"]\n'
    + '\n[controllers.mine.axis.x]\nkp = "0.01 V/um"\nti = "5 ms"\n'
    + experiment(STEP, 'controllers = ["open loop", "mine"]\nvariants = ["as modelled", "soft"]', "a step")
    + experiment(SINE.replace("1 Hz", "10 Hz"), name="a loop")
)


@pytest.fixture
def inputs(tmp_path: Path) -> Path:
    (tmp_path / "model.toml").write_text(LINEAR + HYSTERESIS + RANGE)
    (tmp_path / "study.toml").write_text(STUDY)
    return tmp_path


def test_a_run_writes_report_and_figures(inputs: Path, command_line: Run) -> None:
    ended = command_line("simulate", "model.toml", "study.toml", "--runs")
    assert ended.code == 0
    folder = inputs / "reports" / "model_study"
    written = {path.name for path in folder.iterdir()}
    text = (folder / "report.md").read_text(encoding="utf-8")
    figures = set(re.findall(r"!\[[^]]*\]\(([^)]+)\)", text))
    assert figures == {"a_step_time.svg", "a_step_soft_time.svg", "a_loop_loop.svg"}
    assert written == {"report.html", "report.md", "result.json", "stage_model.toml", "runs", *figures}
    assert all((folder / figure).read_text(encoding="utf-8").lstrip().startswith("<?xml") for figure in figures)
    assert (folder / "report.html").read_text(encoding="utf-8").count("data:image/svg+xml") == len(figures)
    for name in ("report.html", "report.md", "result.json", "stage_model.toml"):
        assert name in ended.stdout
    again = stage_model.read(folder / "stage_model.toml").axes["x"]
    ran = stages.after_full_cycles(
        stage_model.read(inputs / "model.toml").axes["x"]
    )  # the stage that the report is about
    assert again.numbers == pytest.approx(ran.numbers, rel=1e-6)
    assert again.effects["bouc_wen"]["rest"] < 0
    described = (folder / "runs" / "measurements.toml").read_text(encoding="utf-8")
    assert described.count('between_samples = "hold"') == 5


def test_recordings_are_what_identify_reads(inputs: Path, command_line: Run) -> None:
    assert command_line("simulate", "model.toml", "study.toml", "--runs", "--out", "out").code == 0
    runs = {run.name: run for run in read_runs([inputs / "out" / "runs"])}
    assert set(runs) == {f"a_step_{c}_{v}" for c in ("open_loop", "mine") for v in ("as_modelled", "soft")} | {
        "a_loop_open_loop_as_modelled"
    }
    sine = read_run(inputs / "out" / "runs" / "a_loop_open_loop_as_modelled.csv")
    assert (sine.commands, sine.responses) == (("ux",), ("x",))
    assert np.ptp(sine.command()) == pytest.approx(50)
    result = json.loads((inputs / "out" / "result.json").read_text(encoding="utf-8"))
    travel = result["cases"][-1]["measures"]["x"][0]
    assert (travel["name"], travel["unit"]) == ("amplitude", "um")
    assert np.ptp(sine.measured()) * 1e6 == pytest.approx(travel["value"], rel=1e-5)  # digits in the file


def test_json_has_stdout_to_itself_and_is_deterministic(
    inputs: Path, command_line: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a report the date alone differs, unless the environment states it."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    first = command_line("simulate", "model.toml", "study.toml", "--json", "--out", "one")
    second = command_line("simulate", "model.toml", "study.toml", "--json", "--out", "two")
    assert (first.code, second.code) == (0, 0)
    assert first.stdout == second.stdout == (inputs / "one" / "result.json").read_text(encoding="utf-8")
    files = [{p.name: p.read_bytes() for p in (inputs / folder).iterdir()} for folder in ("one", "two")]
    assert files[0] == files[1]
    result = json.loads(first.stdout)
    assert [case["controller"] for case in result["cases"]] == ["open loop", "mine"] * 2 + ["open loop"]
    assert result["cases"][1]["gains"]["x"]["kp"]["unit"] == "V/um"
    assert "run 1 of 5: a step, open loop" in first.stderr and "left: a step, mine, soft" in first.stderr


def test_an_override_reaches_model_and_study(inputs: Path, command_line: Run) -> None:
    (inputs / "study.toml").write_text("format = 1\n" + experiment(STEP, 'controllers = ["robust"]'))
    changes = ("--set", "axis.x.gain=3 um/V", "--set", "robust_ms=1.3", "--set", "title=mine")
    ended = command_line("simulate", "model.toml", "study.toml", "--json", *changes)
    assert ended.code == 0
    robust = json.loads(ended.stdout)["cases"][0]
    assert robust["margins"]["x"]["largest_sensitivity"] <= 1.3 * (1 + 1e-3)
    (folder,) = (inputs / "reports").iterdir()
    assert folder.name == "model_study_axis.x.gain_3_um_V_robust_ms_1.3_title_mine"
    assert stage_model.read(folder / "stage_model.toml").axes["x"].gain == pytest.approx(3e-6)
    assert "mine" in (folder / "report.md").read_text(encoding="utf-8").splitlines()[0]


@pytest.mark.parametrize(
    "where",
    ["dynamics.disturbances.run", "report.simulation.simulation_figures.draw", "report.render.to_html"],
)
def test_an_interruption_leaves_what_was_there(
    inputs: Path, command_line: Run, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """While it simulates, draws or writes."""
    calls = []

    def interrupted(*_: object, **__: object) -> NoReturn:
        calls.append(where)
        raise KeyboardInterrupt

    (inputs / "out").mkdir()
    (inputs / "out" / "report.html").write_text("the last one")
    monkeypatch.setattr(f"flexdesign.{where}", interrupted)
    ended = command_line("simulate", "model.toml", "study.toml", "--json", "--runs", "--out", "out")
    assert (ended.code, ended.stdout, len(calls)) == (130, "", 1)
    assert ended.stderr.splitlines()[-1].startswith("flexdesign: interrupted")
    assert [(p.name, p.read_text()) for p in (inputs / "out").iterdir()] == [("report.html", "the last one")]
    fresh = command_line("simulate", "model.toml", "study.toml", "--json", "--out", "new")
    assert fresh.code == 130 and not (inputs / "new").exists()


def test_the_help_says_what_there_is(command_line: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("TERMINAL_WIDTH", "120")
    ended = command_line("simulate", "-h")
    assert ended.code == 0
    for words in ("flexdesign simulate lin2019_stage lin2019_experiments", "robust_ms", "--runs", "--json", "--set"):
        assert words in ended.stdout


# --- experiments of a stage that has no study -----------------------------------------------------------------------


def standard(folder: Path, text: str, *controllers: str) -> Simulation:
    """Return the standard experiments, under these controllers alone where some are named."""
    stage = read(folder, text)
    plan = standard_experiments.plan(stage)
    if controllers:
        fewer = (e.model_copy(update={"controllers": controllers}) for e in plan.experiments if e.reference)
        plan = replace(plan, experiments=(plan.experiments[0], *fewer))
    return simulation.run(stage, {}, plan, lambda _: None)


def test_a_stage_written_by_hand_is_tried_out(tmp_path: Path, command_line: Run) -> None:
    (tmp_path / "mine.toml").write_text(LINEAR + HYSTERESIS + RANGE)
    ended = command_line("simulate", "mine.toml")
    assert ended.code == 0
    text = (tmp_path / "reports" / "mine_standard" / "report.md").read_text(encoding="utf-8")
    for title in ("hysteresis x", "step x", "sine x", "staircase x"):
        assert f"\n## {title}: " in text
    for controller in ("open loop", "feedforward", "ziegler-nichols", "robust", "feedforward + robust"):
        assert f"| {controller} | x |" in text
    assert "Caution" not in text.partition("\n## staircase x")[0]  # within the range, and no loop is unstable


@pytest.mark.parametrize("low", [0, -50, -100])
def test_standard_experiments_stay_within_the_range(tmp_path: Path, low: int) -> None:
    found = standard(tmp_path, LINEAR + RANGE.replace('"0 V"', f'"{low} V"'), "open loop", "feedforward")
    assert not [text for case in found.cases for text in case.cautions if "are allowed" in text]
    swept = found.cases[0].response.command[0]
    assert (swept.min(), swept.max()) == (low, 100)


def test_a_stage_of_negative_gain_is_the_mirror_of_a_positive_one(tmp_path: Path) -> None:
    """Bouc-Wen is odd: with gain and reference of the other sign every motion is, to rounding, the other way round."""
    model = LINEAR + HYSTERESIS + RANGE
    upright, inverted = (standard(tmp_path, model.replace('"2 um', f'"{sign}2 um')) for sign in ("", "-"))
    assert len(upright.cases) == len(inverted.cases) == 16
    for one, other in zip(upright.cases, inverted.cases, strict=True):
        assert other.response.motion == pytest.approx(-one.response.motion, abs=1e-12)
        assert {axis: pid.kp for axis, pid in other.pid.items()} == {axis: -pid.kp for axis, pid in one.pid.items()}


def test_a_controller_that_does_not_exist_is_left_out_and_named(tmp_path: Path) -> None:
    """Without any damping no proportional gain is stable, and Ziegler and Nichols have no experiment to make."""
    found = standard(tmp_path, LINEAR.replace("0.1\n", "0\n") + RANGE, "open loop", "ziegler-nichols")
    left = {(skipped.experiment.name, skipped.controller) for skipped in found.skipped}
    assert ("step x", "ziegler-nichols") in left
    text = report(found)
    assert "Not run: ziegler-nichols on as modelled: x: the plant is unstable under small proportional gains" in text
    assert all(case.controller != "ziegler-nichols" for case in found.cases)


@pytest.mark.parametrize("gain", [15.0, -15.0])
def test_the_driver_gain_changes_the_command_and_nothing_else(inputs: Path, gain: float) -> None:
    """Limits and hysteresis are at the stack: every controller must find the same stage behind any amplifier."""
    upright = stage_model.read(inputs / "model.toml")
    axis = upright.axes["x"]
    amplified = replace(upright, axes={"x": replace(axis, driver=replace(axis.driver, gain=gain))})
    plans = [standard_experiments.plan(model) for model in (upright, amplified)]
    pairs = [
        simulation.run(model, {}, replace(plans[0], variants={}), lambda _: None) for model in (upright, amplified)
    ]
    assert [e.name for e in plans[0].experiments] == [e.name for e in plans[1].experiments]
    for one, other in zip(pairs[0].cases, pairs[1].cases, strict=True):
        if one.experiment.command is None:
            assert other.response.motion == pytest.approx(one.response.motion, abs=1e-11)
            assert other.response.command == pytest.approx(one.response.command / gain, abs=1e-6)


def test_beside_a_feedforward_all_of_a_pid_sees_the_reference(inputs: Path) -> None:
    model = stage_model.read(inputs / "model.toml")
    cases = {
        (c.experiment.name, c.controller): c
        for c in simulation.run(model, {}, standard_experiments.plan(model), lambda _: None).cases
    }
    both, alone = cases["sine x", "feedforward + robust"], cases["sine x", "feedforward"]
    assert both.pid["x"].proportional_weight == both.pid["x"].derivative_weight == 1.0
    assert cases["sine x", "robust"].pid["x"].proportional_weight == 0.0
    errors = [case.measure("x", "max_error") for case in (both, alone)]
    assert errors[0] is not None and errors[1] is not None
    assert errors[0].value < errors[1].value


def test_the_terminal_says_of_what_a_share_is(tmp_path: Path) -> None:
    """Without published numbers the table holds what was measured; "of span 0.1 %" names nothing."""
    found = simulated(tmp_path, LINEAR, experiment(SINE))
    (row,) = simulation_report.digest(found).rows
    assert row[3].startswith("loop width per span ")

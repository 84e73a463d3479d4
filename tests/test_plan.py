"""Commands for the bench keep their limits exactly, show what they are for, and come back as runs."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flexdesign.core import units
from flexdesign.core.errors import InputError
from flexdesign.diagnosis.experiment_design.commands import Command
from flexdesign.diagnosis.experiment_design.discrimination import resolve_effects
from flexdesign.diagnosis.experiment_design.effect_strength import inertia, on, reading
from flexdesign.diagnosis.experiment_design.experiments import ADDED_MASS, suite_of
from flexdesign.diagnosis.experiment_design.limits import COMMAND_GRID, Limits, of_axis
from flexdesign.diagnosis.experiment_design.planning import Plan
from flexdesign.dynamics import stage_model
from flexdesign.dynamics.axis.axis_model import AxisDynamics
from flexdesign.dynamics.stage_model import ActuatorData, AxisModel, ControllerTiming, Driver, StageModel
from flexdesign.measurements.recordings import read_runs, write_run

Run = Callable[..., Any]

FREQUENCY, DAMPING, GAIN = 100.0, 0.03, 2e-6


def stage(rate: float = 1000.0, volts: tuple[float, float] | None = (0.0, 100.0), **numbers: Any) -> StageModel:
    """Return a stage of one axis; linear unless effects are given."""
    known = {"natural_frequency": FREQUENCY, "damping_ratio": DAMPING, "gain": GAIN, **numbers}
    actuator = known.pop("actuator", ActuatorData(40e-6, volts))
    return StageModel({"x": AxisModel(**known, actuator=actuator)}, ControllerTiming(rate), name="bench")


def planned(model: StageModel, asked: dict[str, Any] | None = None, seed: int = 1) -> tuple[Limits, dict[str, Any]]:
    limits = of_axis(model, "x", **(asked or {}))
    commands = suite_of(limits.dynamics(model, "x"), limits, seed)
    return limits, {command.name: command for command in commands}


# --- limits -------------------------------------------------------------------------------------------------------


@settings(max_examples=15)
@given(
    frequency=st.floats(20.0, 400.0),
    damping=st.floats(0.005, 1.2),
    gain=st.sampled_from([2e-6, -0.5e-6]),
    low=st.sampled_from([-150.0, -20.0, 0.0, 10.0]),
    width=st.floats(15.0, 250.0),
    slew=st.one_of(st.just(math.inf), st.floats(3e3, 1e6)),
    samples=st.floats(4.0, 12.0),
    amplifier=st.sampled_from([1.0, 15.0, -1.0]),
)
def test_random_stages_keep_every_limit(
    frequency: float, damping: float, gain: float, low: float, width: float, slew: float, samples: float,
    amplifier: float,
) -> None:  # fmt: skip
    """No sample leaves the range, no step between samples the slew limit, by as much as a rounding error."""
    rate = float(round(samples * frequency))
    driver = Driver(gain=amplifier, slew=slew * abs(amplifier))
    ends = sorted((low * amplifier, (low + width) * amplifier))
    model = stage(rate, tuple(ends), natural_frequency=frequency, damping_ratio=damping, gain=gain, driver=driver)
    try:
        limits, commands = planned(model)
    except InputError as refused:  # a slew limit may leave nothing of a multisine; then the message says so
        assert "slew" in refused.remedy
        assume(False)
    assert (limits.low, limits.high) == pytest.approx((low, low + width), abs=1e-9)
    for command in commands.values():
        assert command.samples.min() >= limits.low and command.samples.max() <= limits.high
        assert np.abs(np.diff(command.samples)).max() <= limits.slew / rate
        assert command.samples[0] == pytest.approx(limits.home, abs=COMMAND_GRID)
        assert command.samples[-1] == pytest.approx(limits.home, abs=COMMAND_GRID)
        assert np.array_equal(np.rint(command.samples / COMMAND_GRID) / round(1 / COMMAND_GRID), command.samples)


def test_a_stated_range_slew_and_current_narrow_the_model_s() -> None:
    actuator = ActuatorData(40e-6, (0.0, 100.0), capacitance=2e-6, count=2)
    model = stage(actuator=actuator)
    limits, commands = planned(model, dict(volts=(10.0, 60.0), current=0.02))
    assert (limits.low, limits.high, limits.home) == (10.0, 60.0, 10.0)
    assert limits.slew == pytest.approx(0.02 / 4e-6)  # i = C dv/dt, two stacks in parallel
    currents = [limits.current(command.slew) for command in commands.values()]
    assert max(currents) <= 0.02
    assert max(currents) > 0.019  # the large multisines use what there is


def test_the_whole_range_is_used() -> None:
    _, commands = planned(stage())
    triangle = commands["triangle_slow"].samples
    assert triangle.max() == pytest.approx(100.0, abs=0.2)  # a turn falls between samples
    assert commands["hold"].duration > 100.0
    assert commands["quiet"].duration == pytest.approx(2.0)
    assert np.ptp(commands["quiet"].samples) == 0.0


def test_commands_are_the_same_for_the_same_seed() -> None:
    model = stage()
    once, again, other = (planned(model, seed=seed)[1] for seed in (3, 3, 4))
    assert all(np.array_equal(once[name].samples, again[name].samples) for name in once)
    assert not np.array_equal(once["multisine_large_a"].samples, other["multisine_large_a"].samples)
    assert np.array_equal(once["added_mass"].samples, once["multisine_medium_a"].samples)


REFUSED: list[tuple[StageModel, dict[str, Any], str, str]] = [
    (stage(), dict(volts=(-10.0, 50.0)), "--volts", "outside of 0 V to 100 V"),
    (stage(), dict(volts=(50.0, 10.0)), "--volts", "the lower one"),
    (stage(volts=None), {}, "axis.x.actuator.voltage_range", "voltage_range ="),
    (stage(), dict(current=0.1), "axis.x.actuator.capacitance", "--slew"),
    (stage(rate=200.0), {}, "controller.rate", "sample at 313 Hz or more"),
    (stage(), dict(rate=250.0), "--rate", "sample at"),
    (stage(), dict(bandwidth=110.0), "--bandwidth", "from 125 Hz to at most 400 Hz"),
    (stage(), dict(bandwidth=600.0), "--bandwidth", "from 125 Hz to at most 400 Hz"),
    (stage(), dict(slew=1e-3), "--slew", "per sample"),
]


@pytest.mark.parametrize(("model", "asked", "field", "words"), REFUSED)
def test_what_cannot_be_kept_is_refused(model: StageModel, asked: dict[str, Any], field: str, words: str) -> None:
    with pytest.raises(InputError) as refused:
        of_axis(model, "x", **(asked or {}))
    assert refused.value.field == field
    assert words in refused.value.remedy


def test_a_slew_that_leaves_nothing_of_a_multisine_is_refused() -> None:
    with pytest.raises(InputError, match="slew limit leaves"):
        planned(stage(), dict(slew=50.0))


# --- what commands hold -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frequency", "damping", "rate"), [(100.0, 0.03, 1000.0), (30.0, 0.5, 500.0), (900.0, 0.01, 8e3)]
)
def test_multisines_cover_the_resonance_and_nothing_above_the_bandwidth(
    frequency: float, damping: float, rate: float
) -> None:
    limits, commands = planned(stage(rate, natural_frequency=frequency, damping_ratio=damping))
    for name in ("multisine_small_a", "multisine_medium_b", "multisine_large_a"):
        command = commands[name]
        count, end = round(command.cycle * rate), round(command.marks[-1] * rate)
        kept = command.samples[end - 2 * count : end]
        assert len(command.marks) == 3
        assert np.array_equal(kept[:count], kept[count:])
        amplitude = np.abs(np.fft.rfft(kept[:count])) * 2 / count
        tones = np.flatnonzero(amplitude[1:] > 0.5 * amplitude[1:].max()) + 1
        hertz = tones / command.cycle
        assert hertz[0] <= frequency / 20 and hertz[-1] >= 1.3 * frequency
        assert hertz[-1] <= limits.bandwidth <= 0.4 * rate
        assert np.array_equal(tones, np.arange(tones[0], tones[-1] + 1))
        others = np.delete(amplitude, [0, *tones])
        assert others.max() < COMMAND_GRID  # what rounding to the grid leaves
        if damping < 0.1:  # several tones within the width of the resonance
            assert np.sum(np.abs(hertz - frequency) < damping * frequency) >= 3
        crest = np.ptp(kept) / 2 / kept.std()
        assert crest < 3.2  # of 30 draws the best; a single one has 3.5 in the mean


@pytest.mark.parametrize("slew", [1e3, 2e3])
def test_large_multisines_of_a_slow_driver_are_narrower_not_smaller(slew: float) -> None:
    limits, commands = planned(stage(), dict(slew=slew))
    spans, highest = dict[str, float](), dict[str, float]()
    for level in ("small", "medium", "large"):
        command = commands[f"multisine_{level}_a"]
        count, end = round(command.cycle * limits.rate), round(command.marks[-1] * limits.rate)
        kept = command.samples[end - count : end]
        amplitude = np.abs(np.fft.rfft(kept))[1:]
        spans[level] = float(np.ptp(kept)) / limits.span
        highest[level] = float(np.flatnonzero(amplitude > 0.5 * amplitude.max())[-1] + 1) / command.cycle
        assert np.abs(np.diff(command.samples)).max() <= limits.slew / limits.rate
    assert spans["large"] > 2 * spans["medium"] > 4 * spans["small"]
    assert highest["large"] < highest["medium"] / 2 < highest["small"] / 2
    assert highest["small"] >= 1.3 * FREQUENCY
    assert f"up to {units.hertz(highest['large'], 2)}" in commands["multisine_large_a"].purpose


def test_the_motion_stays_within_the_static_range() -> None:
    """By the transfer function of a mode, tone by tone: sharing nothing with the simulation that shaped it."""
    limits, commands = planned(stage(damping_ratio=0.01))
    command = commands["multisine_large_a"]
    assert "range of motion" in command.scaled
    count, end = round(command.cycle * 1000), round(command.marks[-1] * 1000)
    spectrum = np.fft.rfft(command.samples[end - count : end])
    ratio = np.fft.rfftfreq(count, 1e-3) / FREQUENCY
    motion = GAIN * np.fft.irfft(spectrum / (1 - ratio**2 + 0.02j * ratio), count)
    middle, half = GAIN * limits.level(0.5), 0.5 * GAIN * limits.span
    # Samples are held, and the first period is no steady state: both change the peak by some percent.
    assert np.abs(motion - middle).max() < half * 1.1
    assert np.abs(motion - middle).max() > 0.5 * half


def test_triangles_run_at_two_rates() -> None:
    _, commands = planned(stage())
    assert commands["triangle_fast"].slew > 6 * commands["triangle_slow"].slew


def test_validation_runs_are_of_other_shapes() -> None:
    _, commands = planned(stage())
    kinds = {role: {c.kind for c in commands.values() if c.role == role} for role in ("identify", "validate")}
    assert kinds["validate"] and not kinds["validate"] & kinds["identify"]


# --- files --------------------------------------------------------------------------------------------------------


def test_files_are_runs_once_a_response_is_added(tmp_path: Path) -> None:
    model = stage()
    limits, commands = planned(model)
    chosen = [commands[name] for name in ("quiet", "multisine_small_a", "staircase", "added_mass", "random_levels")]
    plan = Plan("a bench", "x", model.axes["x"], chosen, limits, None, 20e-9)
    plan.write(tmp_path / "runs")
    for file, command in plan.files.items():
        write_run(tmp_path / "runs" / file, command.time, {"u [V]": command.samples, "x [um]": GAIN * command.samples})
    read = read_runs([tmp_path / "runs"])
    assert [run.name for run in read] == [file.removesuffix(".csv") for file in plan.files]
    for run, command in zip(read, chosen, strict=True):
        assert (run.role, run.between_samples) == (command.role, "hold")
        assert np.array_equal(run.command(), command.samples)
        assert run.period == pytest.approx(command.period, rel=1e-9)


def test_command_files_are_refused_where_a_file_is_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("not a folder")
    with pytest.raises(InputError, match="cannot be written"):
        Plan("a bench", "x", None, [], None, None, None).write(tmp_path / "runs")  # type: ignore[arg-type]


def test_the_command_files_alone_say_what_is_missing(tmp_path: Path) -> None:
    model = stage()
    limits, commands = planned(model)
    Plan("a bench", "x", model.axes["x"], [commands["quiet"]], limits, None, None).write(tmp_path)
    with pytest.raises(InputError, match="no response"):
        read_runs([tmp_path])


def test_the_added_mass_is_suggested_from_the_model_s() -> None:
    heavy = stage(mass=0.05, stiffness=0.05 * (2 * math.pi * FREQUENCY) ** 2)
    for model, words in ((heavy, '"5.0 g"'), (stage(), "# conditions")):
        limits, commands = planned(model)
        plan = Plan("", "x", model.axes["x"], [commands["added_mass"]], limits, None, None)
        assert words in plan.description()
    assert "lowers the resonance by about 5 %" in planned(stage())[1]["added_mass"].note
    assert math.sqrt(1 / (1 + ADDED_MASS)) == pytest.approx(0.953, abs=1e-3)


# --- what tells two effects apart ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def menu() -> tuple[AxisDynamics, list[Command]]:
    changes = ["axis.x.damping_ratio=0.0242", 'axis.x.sensor.resolution="0 um"']  # its steps are as large as effects
    model = stage_model.read("lin2019_stage", changes)
    limits = of_axis(model, "x")
    dynamics = limits.dynamics(model, "x")
    return dynamics, list(suite_of(dynamics, limits))


@pytest.mark.parametrize(
    ("pair", "best"),
    [
        (("payload_mass", "stiffness_loss"), {"added_mass"}),
        (("creep", "bouc_wen"), {"hold"}),
        (("driver_bandwidth", "transport_delay"), {"multisine_large_a", "multisine_large_b", "steps"}),
    ],
)
def test_the_experiment_that_separates_two_effects(
    menu: tuple[AxisDynamics, list[Command]], pair: tuple[str, str], best: set[str]
) -> None:
    found = resolve_effects(menu[0], pair, menu[1], 20e-9)
    assert found.proposed[0].command.name in best
    standard = next(each for each in found.separations if each.command.name == "multisine_medium_a")
    assert found.separations[0].difference > 1.5 * standard.difference


def test_what_no_experiment_separates_is_said_so(menu: tuple[AxisDynamics, list[Command]]) -> None:
    """Two couplings to another axis, both in proportion to its motion, are one as long as it is all that is seen."""
    found = resolve_effects(menu[0], ("abbe_error", "pair_mismatch"), menu[1], 20e-9)
    assert not found.proposed


def test_one_effect_twice_is_refused(menu: tuple[AxisDynamics, list[Command]]) -> None:
    with pytest.raises(InputError, match="names one effect twice"):
        resolve_effects(menu[0], ("creep", "creep"), menu[1], 20e-9)


def test_mass_and_compliance_follow_from_frequency_and_gain() -> None:
    """A payload of 20 % weighs 1.2 times as much and gives as before; a loss of 20 % gives 1 / 0.8 times as much."""
    model = stage()
    dynamics = of_axis(model, "x").dynamics(model, "x")
    payload = on(dynamics, "payload_mass").at(0.2)
    loss = on(dynamics, "stiffness_loss").at(0.2)
    assert inertia(payload) == pytest.approx((1.2, 1.0))
    assert inertia(loss) == pytest.approx((1.0, 1.25))


def test_a_known_mass_lowers_the_resonance_as_springs_and_masses_have_it() -> None:
    """On a stage with a payload of half its mass, a tenth more is 0.1 / 1.5, and the resonance falls by its root."""
    model, rate = stage(damping_ratio=0.01), 1000.0
    limits, commands = planned(model)
    payload = on(limits.dynamics(model, "x"), "payload_mass").at(0.5)
    peaks = []
    for name in ("multisine_medium_a", "added_mass"):
        command = commands[name]
        count, end = round(command.cycle * rate), round(command.marks[-1] * rate)
        found = np.fft.rfft(reading(payload, command)[end - count : end])
        sent = np.fft.rfft(command.samples[end - count : end])
        near = np.arange(round(60 * command.cycle), round(100 * command.cycle))
        peaks.append(near[np.argmax(np.abs(found[near] / sent[near]))] / command.cycle)
    apart = 1 / commands["added_mass"].cycle  # a peak is found to the nearest tone
    assert peaks[0] == pytest.approx(FREQUENCY / math.sqrt(1.5), abs=apart)
    assert peaks[1] == pytest.approx(FREQUENCY / math.sqrt(1.6), abs=apart)


# --- the command --------------------------------------------------------------------------------------------------


def test_the_command_writes_files_and_a_report(tmp_path: Path, command_line: Run) -> None:
    ended = command_line(
        "plan", "lin2019_stage", "--set", "axis.x.damping_ratio=0.03", "--slew", "none", "--json", "--out", "bench"
    )  # fmt: skip
    assert ended.code == 0
    result = json.loads(ended.stdout)
    assert result["kind"] == "plan" and result["seed"] == 1
    written = {path.name for path in (tmp_path / "bench" / "commands").iterdir()}
    assert written == {"measurements.toml", *(command["file"] for command in result["commands"])}
    assert {"report.html", "report.md", "result.json", "commands.svg"} <= {
        p.name for p in (tmp_path / "bench").iterdir()
    }


def test_the_command_resolves(tmp_path: Path, command_line: Run) -> None:
    ended = command_line(
        "plan", "lin2019_stage", "--set", "axis.x.damping_ratio=0.03", "--resolve", "payload_mass", "stiffness_loss",
        "--sensor-noise", "20 nm", "--slew", "none", "--out", "bench",
    )  # fmt: skip
    assert ended.code == 0
    assert "Added mass distinguishes payload_mass from stiffness_loss best" in " ".join(ended.stdout.split())
    assert "17_" not in {path.name[:3] for path in (tmp_path / "bench" / "commands").iterdir()}
    assert any("added_mass" in path.name for path in (tmp_path / "bench" / "commands").iterdir())


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "axis.x.driver.slew: is missing: no command is written"),
        (("--current", "50 mA"), "axis.x.actuator.capacitance: is missing"),
        (("--axis", "q"), "the model has no such axis; it has x, y, z"),
        (("--slew", "5 mm"), "--slew = 5 mm"),
        (("--rate", "-5 Hz"), "must be more than zero"),
        (("--resolve", "creep", "nonsense", "--slew", "none"), "is not a known effect"),
        (("--volts", "-20 V", "50 V"), "outside of 0 V to 131.4 V"),
    ],
)
def test_the_command_refuses(command_line: Run, arguments: tuple[str, ...], words: str) -> None:
    ended = command_line("plan", "lin2019_stage", *arguments, "--out", "bench")
    assert (ended.code, ended.stdout) == (2, "")
    assert words in ended.stderr
    assert not Path("bench").exists()

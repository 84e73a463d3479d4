"""Sweeps whose cases are simulated experiments: against theory, and against the same experiments asked one by one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from flexdesign.core.errors import InputError
from flexdesign.core.result_cache import Cache
from flexdesign.design import study
from flexdesign.dynamics import experiments, stage_model
from flexdesign.dynamics.experiments import simulation
from flexdesign.report.sweeps import sweep_report
from flexdesign.workflows import sweeps
from flexdesign.workflows.sweeps import Sweep
from flexdesign.workflows.sweeps.store import Store
from flexdesign.workflows.validation import validate

STAGE = """format = 1
[axis.x]
mass = "40 g"
stiffness = "30 N/mm"
damping_ratio = 0.05
gain = "1.5 um/V"
[axis.x.actuator]
free_stroke = "40 um"
voltage_range = ["-20 V", "150 V"]
[controller]
rate = "20 kHz"
"""
STEP = """format = 1
[[experiment]]
name = "step"
axes = ["x"]
reference = { shape = "step", start = "0 um", target = "10 um", wait = "2 ms", hold = "200 ms" }
controllers = ["open loop"]
"""
SWEEP = """format = 1
stage_model = "stage.toml"
experiments = "step.toml"
evaluator = "simulation"
[vary]
"""


@pytest.fixture
def swept(tmp_path: Path) -> Callable[..., Sweep]:
    """Run a sweep over what is said to vary; `step` is what the experiments are."""

    def run(vary: str, step: str = STEP, jobs: int = 1) -> Sweep:
        (tmp_path / "stage.toml").write_text(STAGE)
        (tmp_path / "step.toml").write_text(step)
        (tmp_path / "study.toml").write_text(SWEEP + vary)
        return sweeps.run(sweeps.read(tmp_path / "study.toml"), Store(tmp_path / "out"), jobs=jobs)

    return run


def test_overshoot_of_a_step_is_that_of_a_damped_resonator(swept: Callable[..., Sweep]) -> None:
    found = swept('"axis.x.damping_ratio" = { from = 0.02, to = 0.4, count = 4 }')
    assert not found.failed
    damping = np.array([case.values["axis.x.damping_ratio"] for case in found.cases], dtype=float)
    theory = 10e-6 * np.exp(-math.pi * damping / np.sqrt(1 - damping**2))
    assert found.results.column("overshoot_step_open_loop") == pytest.approx(theory, rel=2e-3)


def test_four_times_the_mass_takes_twice_the_time(swept: Callable[..., Sweep]) -> None:
    found = swept('"axis.x.mass*" = [1, 4]')
    once, twice = found.results.column("rise_time_step_open_loop")
    assert twice == pytest.approx(2 * once, rel=0.02)  # but for the hold of the command, 50 us


def test_answers_are_those_of_the_experiments_alone(swept: Callable[..., Sweep], tmp_path: Path) -> None:
    closed = STEP.replace('["open loop"]', '["robust"]')
    vary = '"axis.x.effects.creep.per_decade" = [0.0, 0.05]\nrobust_ms = [1.4, 1.8]\n"controller.rate" = ["4 kHz"]'
    found = swept(vary, closed, jobs=2)
    assert not found.failed
    for place, case in enumerate(found.cases):
        creep, peak = (float(case.values[key]) for key in ("axis.x.effects.creep.per_decade", "robust_ms"))
        changes = [f"axis.x.effects.creep.per_decade={creep}", "controller.rate=4 kHz"]
        stage = stage_model.read(tmp_path / "stage.toml", changes)
        plan = experiments.read(tmp_path / "step.toml", ["x"], [f"robust_ms={peak}"])
        (alone,) = simulation.run(stage, {}, plan, lambda _: None).cases
        there = {quantity.key: quantity.value for quantity in found.results.at(place)}
        for measure in alone.measures["x"]:
            assert there[f"{measure.name}_step_robust"] == pytest.approx(measure.value, rel=1e-12)
        assert there["largest_sensitivity_step_robust"] == pytest.approx(alone.margins["x"].ms, rel=1e-12)
        assert there["largest_sensitivity_step_robust"] < peak * 1.001


def test_a_command_beyond_its_limits_is_told(swept: Callable[..., Sweep]) -> None:
    found = swept('"axis.x.gain" = ["1.5 um/V", "0.05 um/V"]')
    within, beyond = found.results.column("time_at_limits_step_open_loop")
    assert within == 0
    assert beyond > 0.9


def test_what_changes_an_answer_changes_its_key(swept: Callable[..., Sweep]) -> None:
    assert swept('"axis.x.mass*" = [1, 2]').computed == 2
    assert swept('"axis.x.mass*" = [1, 2, 3]').computed == 1
    assert swept('"axis.x.mass*" = [1, 2]', STEP.replace("10 um", "11 um")).computed == 2


def test_a_stage_changed_in_memory_is_one_changed_in_its_file(tmp_path: Path) -> None:
    (tmp_path / "stage.toml").write_text(STAGE)
    changes = ["axis.x.mass*=1.5", "axis.x.effects.creep.per_decade=0.02", "controller.rate=10 kHz"]
    read = stage_model.read(tmp_path / "stage.toml")
    assert stage_model.with_overrides(read, changes) == stage_model.read(tmp_path / "stage.toml", changes)


@pytest.mark.parametrize(
    ("vary", "said"),
    [
        ('"axis.x.massa" = ["1 g"]', r"mass\b"),
        ('"axis.q.mass" = ["1 g"]', "no axis q"),
        ('"axis.x.mass" = ["1 um"]', "1 um"),
        ('"dimensions.width" = ["1 mm"]', "nothing of what varies"),
        ('"controllers.mine.axis.x.kp" = ["1 V/m", "2 V/m"]\nrobust_ms = [9]', "5"),
    ],
)
def test_what_cannot_vary_is_refused_before_anything_runs(
    swept: Callable[..., Sweep], tmp_path: Path, vary: str, said: str
) -> None:
    with pytest.raises(InputError, match=said) as refused:
        swept(vary)
    assert Path(refused.value.file).name == "study.toml"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('stage_model = "stage.toml"', "", "design: is missing"),
        ('stage_model = "stage.toml"', 'stage_model = "stage.toml"\ndesign = "bridge_amplifier"', "with a design"),
        ('evaluator = "simulation"', 'evaluator = "fem"', "stage_model = .*evaluator"),
    ],
)
def test_what_does_not_go_together_is_refused(tmp_path: Path, old: str, new: str, said: str) -> None:
    (tmp_path / "stage.toml").write_text(STAGE)
    (tmp_path / "step.toml").write_text(STEP)
    (tmp_path / "study.toml").write_text(SWEEP.replace(old, new) + '"axis.x.mass*" = [1, 2]')
    with pytest.raises(InputError, match=said):
        sweeps.read(tmp_path / "study.toml")


COARSE = {"mesh.levels": 2, "mesh.at_root": 0.7}
OF_DESIGN = """format = 1
design = "bridge_amplifier"
experiments = "step.toml"
evaluator = "simulation"
[mesh]
levels = 2
at_root = 0.7
[vary]
"axis.y.damping_ratio" = [0.02, 0.1]
"""


def of_design(folder: Path, axis: str) -> sweeps.SweepPlan:
    """Return a sweep of a design's damping, of which finite elements make the stage model."""
    step = STEP.replace('["x"]', f'["{axis}"]').replace('"10 um"', '"-10 um"')  # the bridge pulls its output in
    (folder / "step.toml").write_text(step)
    (folder / "study.toml").write_text(OF_DESIGN)
    return sweeps.read(folder / "study.toml")


def test_finite_elements_make_the_stage_of_a_design(tmp_path: Path) -> None:
    found = sweeps.run(of_design(tmp_path, "y"), Store(tmp_path / "out"), jobs=1)
    assert not found.failed
    overrides = [f"{key}={value}" for key, value in COARSE.items()]
    validated = validate(study.read("bridge_amplifier", [*overrides, "output.large_steps=0"]), Cache(tmp_path))
    assert validated.stage_model is not None
    for place, damping in enumerate((0.02, 0.1)):
        stage = stage_model.with_overrides(validated.stage_model, [f"axis.y.damping_ratio={damping}"])
        plan = experiments.read(tmp_path / "step.toml", ["y"])
        (run,) = simulation.run(stage, {}, plan, lambda _: None).cases
        measured = {quantity.name: quantity.value for quantity in run.measures["y"]}
        assert measured["overshoot"] > 0
        for name, value in measured.items():
            assert found.results.column(f"{name}_step_open_loop")[place] == pytest.approx(value, rel=1e-12), name
    stiffness = next(c.fem for c in validated.comparisons if c.fem.name == "K_in")
    assert found.results.column(stiffness.key)[0] == pytest.approx(stiffness.value, rel=1e-9)
    error = max(found.results.relative_errors(["K_in", "lambda", "K_out"]))
    for share, is_missed in ((2.0, False), (0.5, True)):
        mesh = found.plan.mesh.model_copy(update={"accuracy": share * error})
        asked = replace(found, plan=replace(found.plan, mesh=mesh))
        assert ("NOT reached in 2 of 2 cases" in " ".join(sweep_report.summary(asked))) == is_missed


def test_experiments_on_another_axis_than_a_design_has_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"step\.toml.*x: is not an axis of the stage model; known: y"):
        of_design(tmp_path, "x")

"""A whole stage on coarse meshes, from the command line to the report."""

from __future__ import annotations

import io
import json
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import flexdesign as fd
from flexdesign import cli
from flexdesign.analytic import static_model
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity, by_key
from flexdesign.core.result_cache import Cache
from flexdesign.design import design as designs
from flexdesign.design import study as studies
from flexdesign.design.part import Piece
from flexdesign.dynamics import experiments, stage_model
from flexdesign.dynamics.experiments import simulation
from flexdesign.fem import cross_axis_coupling, mesh_refinement, stage_condensation
from flexdesign.fem.mesh_refinement import MOST_LEVELS
from flexdesign.fem.quantities.stage import StageStatics
from flexdesign.fem.quantities.stage_modes import mode_shares
from flexdesign.fem.stage_condensation import StageLevel
from flexdesign.fem.superelements import second_order, superelement
from flexdesign.fem.superelements.superelement import Superelement
from flexdesign.report import published_rows
from flexdesign.report.validation import stage_report
from flexdesign.report.validation.stage_text import Axes
from flexdesign.workflows import stage_sizing
from flexdesign.workflows.sweeps import fem_evaluators
from flexdesign.workflows.validation import stage_published, stage_variants
from flexdesign.workflows.validation import validate_stage as stage_course
from flexdesign.workflows.validation.validate_stage import StageValidation, validate_stage
from tests.conftest import FOUR_SIDED, Ended
from tests.test_lin2019 import steady_span

#: What two solutions of the same equations may differ by; couplings that symmetry forbids are nothing but that.
ROUNDING, NOTHING = 1e-9, 1e-12

#: Coarse enough for half a minute: stiffnesses are right within a few percent, symmetry and balance exactly.
STUDY = f"""\
format = 1
title = "Stage on coarse meshes"
design = "{FOUR_SIDED.as_posix()}"

[mesh]
levels = 2
at_root = 1.0
growth = 1.5
largest = "8 mm"

[stage.inputs]
x = "20 um"
y = "20 um"
z = "40 um"

[published.theirs]
K_out_x_inputs_free = "19.0 N/mm"
coupling_y_x_input_of_20_um = "0.076 %"
coupling_y_x_input_of_30_um = "0.1 %"

[published.measured]
travel_z_input_of_40_um = "222.96 ± 15 um"
coupling_x_z_input_of_40_um = "0.96 ± 6.7 %"

[variants]
"one side" = ["dimensions.lateral_branches=2"]
"""


@dataclass(frozen=True)
class Run:
    """What one command did."""

    code: int
    found: StageValidation
    folder: Path
    cache: Path
    file: Path


def ran(folder: Path, text: str, cache: Path, *options: str) -> Run:
    """Validate a study from the command line."""
    folder.mkdir(exist_ok=True)
    file, found = folder / "coarse.toml", []
    file.write_text(text, encoding="utf-8")

    def recorded(*arguments: object) -> StageValidation:
        found.append(validate_stage(*arguments))  # type: ignore[arg-type]
        return found[-1]

    where = ["--out", str(folder / "out"), "--cache", str(cache), "--export", str(folder / "stage.step")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(stage_course, "validate_stage", recorded)
        patch.setattr(sys, "argv", ["flexdesign", "validate", str(file), *where, *options])
        patch.setattr(sys, "dont_write_bytecode", True)
        code = 0
        try:
            cli.main()
        except SystemExit as stop:
            code = int(stop.code or 0)
    return Run(code, found[0], folder / "out", cache, file)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("stage")
    return ran(folder, STUDY, folder / "cache")


@pytest.fixture(scope="module")
def thicker(run: Run) -> Run:
    """Return the stage with thicker hinges in its limbs, small displacements alone."""
    text = STUDY.partition("[published.theirs]")[0]
    changes = ["--set", "dimensions.limb_hinge_thickness=0.7 mm", "--set", "output.large_steps=0"]
    return ran(run.file.parent / "thicker", text, run.cache, *changes)


def test_command_writes_report_model_pictures_and_solid(run: Run) -> None:
    assert run.code == 0
    names = {path.name for path in run.folder.iterdir()}
    assert {"report.html", "report.md", "result.json", "stage_model.toml", "stage.png"} <= names
    assert {"deformation_x.png", "deformation_z.png", "mode_1.png", "mode_4.png"} <= names
    assert "ADVANCED_FACE" in (run.folder.parent / "stage.step").read_text(encoding="utf-8")


def test_the_page_turns_the_stage_and_stays_small(run: Run) -> None:
    """A page is below 5 MB; this stage's, on coarse meshes, leaves room for one of five times as many triangles."""
    page = (run.folder / "report.html").read_text(encoding="utf-8")
    assert page.count('data-kind="view"') == 1
    assert len(page.encode()) < 2.6e6


def test_pictures_show_the_stage(run: Run) -> None:
    """A stage fills part of the picture, and a driven one has the colours of rest and of the largest motion."""
    for name in ("stage.png", "deformation_x.png", "mode_1.png"):
        pixels = np.asarray(Image.open(io.BytesIO((run.folder / name).read_bytes())).convert("RGB")).reshape(-1, 3)
        assert 0.1 < np.mean(pixels.min(axis=1) < 235) < 0.9
    moved = np.asarray(Image.open(run.folder / "deformation_x.png").convert("RGB")).reshape(-1, 3).astype(int)
    assert np.mean(np.ptp(moved, axis=1) > 60) > 0.01  # the table and its limbs, bright; at rest all is grey


def test_a_symmetric_stage_has_equal_axes_and_no_coupling_of_first_order(run: Run) -> None:
    found = run.found
    assert found.causes[0].largest < 1e-6
    for name in ("K_out_{}_inputs_free", "K_in_{}_table_free", "lambda_{}_table_free"):
        assert found.fem(name.format("x")).value == pytest.approx(found.fem(name.format("y")).value, rel=1e-6)
    assert Axes(found).listed == ["x", "z"]
    assert Axes(found).label("y") == "X/Y"


def test_coupling_of_second_order_is_even_and_grows_with_the_square(run: Run) -> None:
    near = next(motion for motion in run.found.motions if motion.axis == "x")
    far = next(motion for motion in run.found.at_full_stroke if motion.axis == "x")
    assert abs(near.odd["z"]) < 1e-6 * abs(near.even["z"])
    # What is of fourth order is the tilt squared of this, 1e-6; a percent leaves room for stiffening guides.
    assert far.quadratic("z") == pytest.approx(near.quadratic("z"), rel=1e-2)
    # Arms draw towards the frame: the table sinks, by no more than if they were rigid between ideal hinges.
    drawn = near.travel**2 / 2 / run.found.study.design.dimensions["strut_length"]
    assert -drawn < near.even["z"] < -0.5 * drawn


def test_arms_on_both_sides_draw_equally_and_on_one_side_by_half_the_square_over_their_length(run: Run) -> None:
    found = run.found
    assert found.fem("coupling_y_x_input_of_20_um").value == 0
    alone = found.as_in("one side", "coupling_y_x_input_of_20_um")
    ideal = found.fem("travel_x_input_of_20_um").value / 2 / found.study.design.dimensions["limb_length"]
    # The block they draw at gives way, so that less than the ideal is left of it.
    assert alone is not None
    assert 0.5 * ideal < alone < ideal


def test_half_the_amplifiers_hold_half(run: Run) -> None:
    """Of K_out, what amplifiers and limbs hold is halved; struts and what else tilts stay."""
    whole = run.found.fem("K_out_x_inputs_free").value
    half = run.found.as_in("one side", "K_out_x_inputs_free")
    assert half is not None
    assert 0.5 < half / whole < 0.55


def test_large_displacements_are_freed_from_the_error_of_their_meshes(run: Run) -> None:
    """For small inputs the travel is the linear amplification's, which was extrapolated by itself.

    What is of third order in the travel falls with the square of the input: travel per input at 20 and at 40 um tell
    that of none. The coarsest mesh alone is further off: that is the error of which there is an estimate.
    """
    found = run.found
    for axis in "xy":
        ratio = found.fem(f"lambda_{axis}_table_free")
        near, far = (found.fem(f"travel_{axis}_input_of_{um}_um") for um in (20, 40))
        assert near.half_width is not None
        linear = (4 * near.value / 20e-6 - far.value / 40e-6) / 3
        assert linear == pytest.approx(ratio.value, rel=1e-3)
        assert near.half_width / near.value < 0.03
        assert abs(found.coarsest[near.key].value / 20e-6 / ratio.value - 1) > 2e-2
    aside = found.fem("coupling_z_x_input_of_20_um")
    assert aside.half_width is not None and 0 < aside.half_width < 0.1 * aside.value


def test_variants_have_estimates_of_their_own(run: Run) -> None:
    """Half the amplifiers have half the stiffness whatever the mesh: hardly more than the stage's error is left."""
    half, whole = run.found.variants["one side"]["K_out_x_inputs_free"], run.found.fem("K_out_x_inputs_free")
    assert half.half_width is not None and whole.half_width is not None
    assert half.half_width / half.value == pytest.approx(whole.half_width / whole.value, rel=0.1)
    text = (run.folder / "report.md").read_text(encoding="utf-8")
    assert half.formatted() in text
    assert "Large displacements are solved on the two coarsest meshes." in text


@pytest.mark.parametrize("order", [1.1, 1.5, 2.0])
def test_what_a_variant_changes_is_found_within_its_estimate(order: float) -> None:
    """Stage and variant have errors of their own that fall with a power; the truth is a third of the stage's, and 7."""
    sizes = (1.35, 1.0)

    def level(size: float, *, variant: bool) -> dict[str, Quantity]:
        error = size**order
        values = {"K": 100.0 / 3 * (1 + 0.02 * error) if variant else 100.0 * (1 + 0.05 * error)}
        values["lost"] = 7.0 * (1 - 0.03 * error) if variant else 0.0
        if variant:
            values["more"] = 1.0
        return {name: Quantity(name, value, "1", "", "") for name, value in values.items()}

    here, there = ([level(size, variant=variant) for size in sizes] for variant in (False, True))
    limits = {name: Quantity(name, value, "1", "", "", half_width=0.5) for name, value in (("K", 100.0), ("lost", 0.0))}
    found = stage_variants.variant_quantities(here, there, sizes, limits)
    assert set(found) == {"K", "lost"}
    for name, truth in (("K", 100 / 3), ("lost", 7.0)):
        sigma = found[name].half_width
        assert sigma is not None
        assert abs(found[name].value - truth) < sigma < 0.05 * truth
        assert abs(there[-1][name].value - truth) > abs(found[name].value - truth)


def test_springs_of_all_kinds_add_up_to_the_stiffness(run: Run) -> None:
    statics = StageStatics(run.found.stages[-1])
    for axis, springs in run.found.springs.items():
        along = statics.along(axis)
        assert sum(s.stiffness for s in springs) == pytest.approx(1 / (along @ statics.free @ along), rel=1e-9)


def test_modes_answer_with_all_of_the_static_motion_and_symmetric_pairs_are_told_apart(run: Run) -> None:
    stage, actuator = run.found.stages[0], run.found.study.design.actuator
    assert actuator is not None
    every = mode_shares(stage, actuator.installed_stiffness, stage.size)
    for axis in "xyz":
        # Frequencies range over five decades, and rounding goes with their squares.
        assert sum(mode.participation[axis] for mode in every) == pytest.approx(1.0, abs=1e-5)
    for mode in every[:6]:
        assert abs(mode.participation["x"] * mode.participation["y"]) < 1e-6
        assert sum(mode.table.values()) < 1


def test_formula_and_fem_of_the_amplifier_bracket_what_the_stage_has(run: Run) -> None:
    """An amplifier by FEM, loaded by what the springs counted hold, has the stage's K_in but for what joins them."""
    for chain in run.found.chains.values():
        assert chain.formula > chain.amplifier  # pseudo-rigid bodies are stiffer than the elastic amplifier
        assert chain.stage == pytest.approx(chain.amplifier, rel=0.05)


@pytest.mark.slow
def test_thicker_limb_hinges_stiffen_formula_and_fem_alike(run: Run, thicker: Run) -> None:
    def springs(of: StageValidation) -> float:
        design = of.study.design
        return sum(row[2].value for row in design.stage().springs(design.material)["x"])

    other = thicker.found
    counted = springs(other) - springs(run.found)
    seen = other.fem("K_out_x_inputs_free").value - run.found.fem("K_out_x_inputs_free").value
    design = run.found.study.design
    limb = next(row[2].value for row in design.stage().springs(design.material)["x"] if row[0] == "limb hinges")
    assert counted == pytest.approx(((0.7 / 0.63) ** 3 - 1) * limb, rel=1e-9)
    # Hinges in series with what else gives way take part of it: two thirds of what is counted is in them at rest.
    share = next(s.stiffness for s in run.found.springs["x"] if s.kind.startswith("limb leaf, 0.63")) / limb
    assert seen == pytest.approx(share * counted, rel=0.25)
    assert other.fem("K_out_z_inputs_free").value == pytest.approx(
        run.found.fem("K_out_z_inputs_free").value, rel=1e-3
    )  # they hardly bend as the table is lifted


@pytest.mark.slow
def test_thicker_limb_hinges_are_in_the_solid_and_in_the_report(run: Run, thicker: Run) -> None:
    """Sixteen leaves, 3.30 mm long and 10 mm high, are 0.07 mm thicker: the STEP files differ by as much metal."""
    import cadquery as cq

    assert thicker.code == 0
    volumes = [cq.importers.importStep(str(each.file.parent / "stage.step")).val().Volume() for each in (run, thicker)]
    assert volumes[1] - volumes[0] == pytest.approx(16 * 3.30 * 10 * 0.07, rel=1e-4)  # of 1.7e6 mm^3, good to 1e-10
    text, fem = (thicker.folder / "report.md").read_text(encoding="utf-8"), thicker.found.fem("K_out_x_inputs_free")
    assert "| limb_hinge_thickness | 0.7 mm |" in text
    assert "| limb leaf, 0.7 mm | 16 |" in text and "limb leaf, 0.63 mm" not in text
    assert f"| K_out X/Y, inputs free | {fem.formatted()} |" in text


def test_theory_climbs_to_fem_and_fem_is_written_as_a_table(run: Run) -> None:
    """On coarse meshes FEM is a few percent stiff."""
    ladder = run.found.hierarchy
    assert ladder is not None
    assert ladder.rungs[0].size > 0.2
    assert ladder.rungs[-1].size < 0.05
    text = (run.folder / "report.md").read_text(encoding="utf-8")
    assert "## From the pseudo-rigid model to FEM" in text and "K_out X/Y" in text
    design = run.found.study.design
    table = static_model.read([run.folder / "fem.csv"], design)
    assert {row.key for row in table.rows} == {
        q.key for q in static_model.of_design(design).compliance({}).quantities().values()
    }
    for row in table.rows:
        assert row.value == pytest.approx(run.found.fem(row.key).value, rel=1e-6)


def test_table_1_has_the_findings(run: Run) -> None:
    table = stage_report.table_1(run.found)
    fem = run.found.fem("K_out_x_inputs_free")
    rows = {row[0]: row for row in table.rows}
    column = list(table.columns).index("theirs")
    row = rows["K_out X/Y, inputs free"]
    number, _, deviation = row[column].partition(" (")
    assert (row[1], number) == (fem.formatted(), "19.0")
    assert float(deviation.removesuffix(" %)")) == pytest.approx(100 * (19.0e3 / fem.value - 1), abs=0.05)
    coupling = rows["coupling X→Y, input of 20 um"]
    assert (coupling[1], coupling[column]) == ("0 (by symmetry)", "0.076")  # no deviation from nothing


def test_every_row_on_the_terminal_has_its_unit(run: Run) -> None:
    rows = {row[0]: row[1:] for row in stage_report.brief_table_1(run.found).rows}
    fem = run.found.fem("K_out_x_inputs_free")
    assert f"{rows['K_out X/Y [N/mm]'][0]} N/mm" == fem.formatted()
    assert rows["coupling X→Y [%]"][0] == "0 (by symmetry)" and "0.076" in rows["coupling X→Y [%]"]
    assert "λ X/Y" in rows


def test_report_says_what_is_reconstructed_circular_measured_and_unexplained(run: Run) -> None:
    text = (run.folder / "report.md").read_text(encoding="utf-8")
    assert text.startswith("# Stage on coarse meshes, reconstructed: validation")
    for heading in ("What explains the differences", "Coupling", "Tilt of the table", "What is assumed"):
        assert f"## {heading}\n" in text
    assert "deviation from that, unexplained" in text
    # One pair of numbers has one deviation in every table; of a motion that symmetry forbids there is none.
    lines = [line for line in text.splitlines() if line.startswith("| K_out X/Y")]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    (first,) = (cell for row in rows for cell in row if cell.startswith("19.0 ("))
    (second,) = (row[2] for row in rows if row[:2] == ["K_out X/Y", "19.0 N/mm"])
    assert first == f"19.0 ({second})"
    assert "| coupling X→Y | 0.076 % | symmetry forbids it |" in text and "-100.0 %" not in text
    assert "nothing: the number itself lies inside the uncertainty" in text  # 0.96 ± 6.7 %
    assert "differs by more than the uncertainty: unexplained" in text  # 223 of 358 um


def test_result_has_every_number_with_its_unit(run: Run) -> None:
    result = json.loads((run.folder / "result.json").read_text(encoding="utf-8"))
    assert result["kind"] == "stage validation"
    quantities = result["quantities"]
    assert all(each["unit"] and math.isfinite(each["value"]) for each in quantities)
    found = next(q for q in quantities if (q["name"], q["boundary"]) == ("K_out", "x, inputs free"))
    assert found["value"] == pytest.approx(run.found.fem("K_out_x_inputs_free").value / 1e3, rel=1e-12)
    assert result["made_by"]["provenance"].startswith("reconstructed")
    assert {cause["name"] for cause in result["coupling"]["first_order"]} >= {"none", "Abbe arm"}


def test_stage_model_reads_back(run: Run) -> None:
    model = stage_model.read(run.folder / "stage_model.toml")
    for name, axis in model.axes.items():
        fem = run.found.fem(f"K_out_{name}_actuators_installed").value
        assert axis.stiffness == pytest.approx(fem, rel=1e-6)  # seven digits are written
        assert axis.mass == pytest.approx(fem / (2 * math.pi * axis.natural_frequency) ** 2, rel=1e-6)
    assert set(model.coupling.quadratic) == {("z", "x"), ("z", "y")}
    limit = run.found.fem("coupling_z_x_input_of_20_um").value / run.found.fem("travel_x_input_of_20_um").value
    assert model.coupling.quadratic["z", "x"] == pytest.approx(-limit, rel=1e-6)  # the table sinks


def test_the_stacks_hysteresis_is_in_the_stage_model_and_the_loop_spans_the_travel(run: Run) -> None:
    """The loop is integrated by Euler's steps of 1e-3 V, in code that shares nothing with the engine."""
    actuator = run.found.study.design.actuator
    assert actuator is not None and actuator.hysteresis is not None and actuator.voltage_range is not None
    for name, axis in stage_model.read(run.folder / "stage_model.toml").axes.items():
        travel = run.found.fem(f"stroke_{name}_table_free").value
        reached = travel / actuator.free_stroke
        assert axis.effects["bouc_wen"]["a"] == pytest.approx(actuator.hysteresis.a * reached, rel=1e-6)
        assert steady_span(axis, *actuator.voltage_range) == pytest.approx(travel, rel=1e-4)
        assert "bouc_wen" in axis.assumed  # the paper prints none


def test_the_experiments_of_the_paper_run_on_the_stage_that_fem_found(run: Run) -> None:
    """The loop spans FEM's travel, which nobody set to the printed one; what differs is said to be unexplained."""
    file = run.folder / "stage_model.toml"
    stage = stage_model.read(file)
    plan = experiments.read("lin2019_experiments", list(stage.axes))
    changed = experiments.variants(plan, lambda changes: stage_model.read(file, changes))
    assert set(changed) == set(plan.variants)
    own, more = (each.axes["x"].effects["bouc_wen"] for each in (stage, changed["unknown hysteresis"]))
    assert [more[name] / own[name] for name in ("a", "b", "c")] == pytest.approx([1.2, 1.2, 1.0])
    first = replace(plan, experiments=tuple(each for each in plan.experiments if each.name == "P8 X"))
    found = simulation.run(stage, changed, first, lambda _: None)
    span = found.cases[0].measure("x", "loop_span")
    # At 0.5 Hz the stage follows but for (f / f0)^2, 4e-5 of it, and the phase of its damping.
    assert span is not None
    assert span.value == pytest.approx(run.found.fem("stroke_x_table_free").value, rel=5e-4)
    said = {row[1]: row[5] for row in published_rows.table(found).rows}
    off = 1e6 * span.value - 238
    assert said["loop span, x"] == f"{off:+#.3g} um, beyond ±: unexplained"


@pytest.mark.slow
def test_stage_model_can_be_simulated(run: Run, command_line: Callable[..., Ended], tmp_path: Path) -> None:
    ended = command_line("simulate", str(run.folder / "stage_model.toml"), "--out", str(tmp_path / "simulated"))
    assert ended.code == 0, ended.stderr
    assert (tmp_path / "simulated" / "report.html").is_file()


@pytest.mark.parametrize(
    ("key", "text", "said"),
    [
        ("K_out_x_input_free", "19 N/mm", "no quantity of this stage"),
        ("K_out_x_inputs_free", "19", "unit"),
        ("K_out_x_inputs_free", "19 mm", "stiffness"),
        ("K_out_x_inputs_free", "19 ± -1 N/mm", "must be positive"),
        ("K_out_x_inputs_free", "19 ± N/mm", "begin with a number"),
    ],
)
def test_published_numbers_that_cannot_be_used(run: Run, key: str, text: str, said: str) -> None:
    asked = replace(run.found.study, published={"theirs": {key: text}})
    with pytest.raises(InputError, match=said) as refused:
        stage_published.read_published(asked, run.found.assembly)
    assert refused.value.file == str(run.file)
    assert refused.value.field == f"published.theirs.{key}"
    assert refused.value.value == text


def test_a_mistyped_published_key_is_refused_before_work_begins(
    command_line: Callable[..., Ended], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage_condensation, "condense", lambda *_, **__: pytest.fail("work began"))
    file = tmp_path / "mistyped.toml"
    file.write_text(STUDY.replace("coupling_x_z_input", "couplin_x_z_input"), encoding="utf-8")
    ended = command_line("validate", str(file))
    assert ended.code == 2
    (said,) = ended.stderr.splitlines()
    place = f"{file}: published.measured.couplin_x_z_input_of_40_um = 0.96 ± 6.7 %"
    remedy = "is no quantity of this stage; did you mean coupling_x_z_input_of_40_um?"
    assert said.startswith(f"flexdesign: {place}: {remedy}")


def test_what_is_expected_is_what_is_found(run: Run) -> None:
    """Published numbers are read by what is expected before anything is known."""
    asked = replace(run.found.study, published={"all": {key: f"1 {q.unit}" for key, q in run.found.coarsest.items()}})
    read = stage_published.read_published(asked, run.found.assembly)["all"]
    assert list(read) == list(run.found.coarsest)
    for key, quantity in run.found.coarsest.items():
        assert replace(read[key], value=0.0, half_width=None, source="") == replace(
            quantity, value=0.0, half_width=None, source=""
        )


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--set", "stage.inputs.w=20 um"), ("stage.inputs.w", "is no axis of this stage")),
        (("--set", "mesh.cross_check=true"), ("mesh.cross_check", "a part alone")),
        (("--export", "stage.vtu"), ("stage.vtu", "a stage has no mesh of the whole", ".step")),
    ],
)
def test_what_a_stage_has_not_is_refused_before_work_begins(
    command_line: Callable[..., Ended], arguments: tuple[str, str], said: tuple[str, ...]
) -> None:
    ended = command_line("validate", "lin2019_xyz_stage", *arguments)
    assert ended.code == 2
    for words in said:
        assert words in ended.stderr.replace("\n", " ")


@pytest.mark.parametrize("asked", [0.2, 0.01, 1e-4])
def test_a_stage_is_refined_until_its_estimate_is_small_enough(
    run: Run, asked: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Meshes that are wrong by 10 % of their edge length."""
    lengths: list[float] = []

    def condensed(
        _study: object, _stage: object, _kinds: object, coarseness: float, *_: object, **__: object
    ) -> StageLevel:
        lengths.append(coarseness)
        k_in = Quantity("K_in", 1.0 + 0.1 * coarseness, "N/m", "N/mm", "x, table free")
        return StageLevel(coarseness, run.found.finest.kinds, run.found.finest.stage, by_key([k_in]))

    monkeypatch.setattr(stage_condensation, "condense", condensed)
    study = replace(run.found.study, mesh=run.found.study.mesh.model_copy(update={"accuracy": asked}))
    levels = stage_condensation.refine(study, run.found.assembly, Cache(run.cache))
    limits = [stage_condensation.gather_quantities(levels[:count]) for count in range(2, len(levels) + 1)]
    errors = [mesh_refinement.estimated_error(limit) for limit in limits]
    assert all(error > asked for error in errors[:-1]) and (errors[-1] <= asked or len(levels) == MOST_LEVELS)
    assert lengths == sorted(lengths, reverse=True) and lengths[0] == study.mesh.refinement
    assert abs(limits[-1][0].value - 1) < errors[-1]


def test_an_accuracy_that_a_stage_does_not_reach_is_said_in_the_headline(run: Run) -> None:
    study = run.found.study
    for asked, is_said in ((1e-4, True), (0.2, False)):
        found = replace(run.found, study=replace(study, mesh=study.mesh.model_copy(update={"accuracy": asked})))
        assert any("NOT reached" in line for line in stage_report._summary(found)) is is_said


def assert_same(found: Quantity, known: Quantity) -> None:
    """The same but for rounding, which goes with where in memory a matrix came to lie."""
    assert replace(found, value=0.0, half_width=0.0) == replace(known, value=0.0, half_width=0.0)
    assert found.value == pytest.approx(known.value, rel=ROUNDING, abs=NOTHING)
    assert found.half_width == pytest.approx(known.half_width, abs=ROUNDING * abs(known.value) + NOTHING)


@pytest.mark.slow
def test_a_sweep_asks_stages_as_a_validation_does(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """No other quantities and no other stage model, but for rounding; and another actuator makes no part anew."""
    settings, design = run.found.study.mesh.model_copy(update={"accuracy": 0.2}), run.found.study.design
    made: list[str] = []
    condense = superelement.condense

    def counted(piece: Piece, *arguments: Any, **options: Any) -> Superelement:
        made.append(type(piece).__name__)
        return condense(piece, *arguments, **options)

    monkeypatch.setattr(superelement, "condense", counted)
    solid = fem_evaluators.fast_solid(settings)
    for quantity in fem_evaluators.by_elements(design, settings, solid):
        assert_same(quantity, run.found.fem(quantity.key))
    handed_over, validated = fem_evaluators.stage_model(design, settings)[0], run.found.stage_model
    assert validated is not None and handed_over.axes.keys() == validated.axes.keys()
    for name, axis in validated.axes.items():
        assert handed_over.axes[name].numbers == pytest.approx(axis.numbers, rel=ROUNDING, abs=NOTHING)
    assert handed_over.coupling.quadratic == {} != validated.coupling.quadratic
    kinds = len(run.found.assembly.kinds())
    assert len(made) == len(run.found.levels) * kinds
    stronger = designs.read(design.file, ["actuator.stiffness*=2"])
    stiff, soft = (by_key(fem_evaluators.by_elements(each, settings, solid)) for each in (stronger, design))
    assert len(made) == len(run.found.levels) * kinds
    assert stiff["stroke_x_table_free"].value > 1.01 * soft["stroke_x_table_free"].value
    assert_same(stiff["K_in_x_table_free"], soft["K_in_x_table_free"])


def test_a_second_run_drives_no_axis_again(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> object:
        raise AssertionError("is in the cache")

    monkeypatch.setattr(cross_axis_coupling, "cross_motion", refused)
    monkeypatch.setattr(second_order, "of", refused)
    monkeypatch.setattr(superelement, "condense", refused)
    again = fd.validate(run.file, cache=run.cache).found
    assert isinstance(again, StageValidation)
    for key in ("travel_x_input_of_20_um", "coupling_z_x_input_of_20_um", "K_out_x_inputs_free"):
        assert again.fem(key).value == run.found.fem(key).value
    for one, other in zip(run.found.motions, again.motions, strict=True):
        assert np.array_equal(one.state.rotations, other.state.rotations)


def test_every_drive_is_kept(run: Run) -> None:
    keys = list((run.cache / "drive").glob("*.npz"))
    # x, y and z at 20, 20 and 40 um on two meshes, of the stage and of its variant; 40 um is the free stroke, too.
    assert len(keys) == 2 * (3 + 2) + 2 * 3


@pytest.mark.parametrize(
    ("method", "answer", "remedy"),
    [
        ("formulas", "None", "must return quantities by the model's name"),
        ("formulas", "{'PRB': [1.0]}", "must return quantities by the model's name"),
        ("formulas", "1 / 0", "fails with ZeroDivisionError"),
        ("springs", "None", "must return by axis"),
        ("arms", "[]", "must return lengths [m]"),
    ],
)
def test_what_a_stage_says_is_examined_before_anything_is_condensed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str, answer: str, remedy: str
) -> None:
    def condensed(*_: object, **__: object) -> None:
        raise AssertionError("it was condensed")

    monkeypatch.setattr(stage_condensation, "refine", condensed)
    found = designs.find("lin2019_xyz_stage")
    source = (found.parent / "xyz_stage.py").read_text(encoding="utf-8")
    arguments = {"formulas": "self, material, actuator_stiffness, output_load", "springs": "self, material"}
    own = f"    def {method}({arguments.get(method, 'self')}):\n        return {answer}\n\n    def _their_{method}("
    assert source.count(f"    def {method}(") == 1
    (tmp_path / "mine.py").write_text(source.replace(f"    def {method}(", own), encoding="utf-8")
    text = found.read_text(encoding="utf-8").replace('"xyz_stage"', '"mine.py"')
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    for part in ("bridge_amplifier", "leaf_hinge"):
        (tmp_path / f"{part}.py").write_text(
            (found.parent / f"{part}.py").read_text(encoding="utf-8"), encoding="utf-8"
        )
    with pytest.raises(InputError) as refused:
        validate_stage(studies.read(str(tmp_path / "mine.toml")), Cache(tmp_path / "cache"))
    assert (Path(refused.value.file).name, refused.value.field) == ("mine.py", f"XYZStage.{method}()")
    assert remedy in refused.value.remedy


# --- masses of (18) to (22), and the shipped stage --------------------------------------------------------------------


def test_masses_of_21_stand_beside_modal_masses_and_frequencies(run: Run) -> None:
    """M_s + 4 M_b in X, M_s + 2 M_b + 2 M_p in Z; the modal mass at the table carries K_out at its frequency."""
    design = run.found.study.design
    masses = design.stage()._masses(design.material)  # type: ignore[attr-defined]
    expected = {
        "x": masses.table + 4 * masses.amplifier_xy,
        "z": masses.table + 2 * masses.amplifier_z + 2 * masses.guide,
    }
    for axis, mass in expected.items():
        (row,) = (c for c in run.found.comparisons if c.fem.key == f"output_mass_{axis}_inputs_free")
        assert row.analytic["paper (21)"].value == pytest.approx(mass)
        assert row.fem.value > row.analytic["springs counted"].value > mass
        frequency, stiffness = (
            run.found.fem(f"{name}_{axis}_inputs_free").value for name in ("output_frequency", "K_out")
        )
        assert row.fem.value * (2 * np.pi * frequency) ** 2 == pytest.approx(stiffness, rel=0.15)
        assert run.found.fem(f"output_mass_{axis}_actuators_installed").value > 0
    text = (run.folder / "report.md").read_text(encoding="utf-8")
    assert "| modal mass X/Y, inputs free |" in text and "reflects the choices alone" in text


def test_springs_of_the_formulas_hold_no_masses(run: Run) -> None:
    design = run.found.study.design
    for rows in design.stage().springs(design.material).values():
        assert all(quantity.si == "N/m" for _, _, quantity, _ in rows)


@pytest.mark.slow
def test_the_shipped_stage_has_what_it_was_sized_to(tmp_path: Path) -> None:
    """Formulas and arms exactly; K_out and travels by FEM within two percent, what such coarse meshes are good for."""
    study = studies.read("table1", ["output.large_steps=0", "mesh.at_root=0.3", 'mesh.largest="2.5 mm"'])
    store = Cache(tmp_path)
    store.prepare()
    levels = stage_condensation.refine(study, study.design.stage().assembly(), store)
    rows = stage_sizing.rows_of(
        "lin2019_stage_targets", study.design, by_key(stage_condensation.gather_quantities(levels))
    )
    assert len(rows) == 11
    for row in rows:
        assert row.met or (row.target.kind == "elements" and abs(row.off) < 0.02), row

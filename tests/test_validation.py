"""The whole path on a coarse mesh: study to report, twice."""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from PIL import Image, ImageSequence

from flexdesign.core.errors import InputError
from flexdesign.core.result_cache import Cache
from flexdesign.design import study
from flexdesign.dynamics import stage_model
from flexdesign.fem import quantities
from flexdesign.report import render, terminal
from flexdesign.report.document import Document, Table
from flexdesign.report.pictures import SWING
from flexdesign.report.validation import explanation, table_1, validation_pictures, validation_report
from flexdesign.testing import assert_agrees
from flexdesign.workflows.validation import Validation, validate
from tests.conftest import Ended

#: Coarse enough for seconds, fine enough to be right within a few percent.
COARSE = ("mesh.levels=2", "mesh.at_root=0.7", "modes.count=1")


@pytest.fixture(scope="module")
def cache(shared_cache: Path) -> Path:
    return shared_cache


@pytest.fixture(scope="module")
def validation(cache: Path) -> Validation:
    return validate(study.read("bridge_amplifier", COARSE), Cache(cache))


@pytest.fixture(scope="module")
def document(validation: Validation) -> Document:
    return validation_report.document(validation)


def test_one_formula_is_enough_for_a_report(validation: Validation) -> None:
    """The report says of FEM all that it found, and of the formulas the one quantity that they have."""
    first, *others = validation.comparisons
    one = replace(validation, comparisons=[first], further=[*validation.further, *(c.fem for c in others)])
    for found in (one, replace(one, hierarchy=None)):
        sections = [explanation.section(found), *validation_report.document(found).sections]
        assert len(table_1.table(found).rows) == 1
        assert sections[0].tables[0].columns.count("PRB") == 1


def test_port_limits(validation: Validation) -> None:
    """lambda^2 K_out / K_in <= 1 (a passive two-port), and an actuator is softer than a held input."""
    k_in, ratio = validation.fem("K_in_output_free").value, validation.fem("lambda_output_free").value
    free, held = validation.fem("K_out_input_free").value, validation.fem("K_out_input_held").value
    installed = validation.fem("K_out_actuator_installed").value
    assert 0 < ratio**2 * free / k_in < 1
    assert free < installed < held
    assert held == pytest.approx(free / (1 - ratio**2 * free / k_in), rel=2e-2)  # each extrapolated on its own


def test_convex_bridge_draws_its_output_in(validation: Validation) -> None:
    assert validation.fem("lambda_output_free").value < 0
    assert validation.fem("stroke_output_free").value < 0


def test_load_line_ends_at_the_blocked_force(validation: Validation) -> None:
    compliance = validation.finest.solution.compliance
    actuator = validation.study.design.actuator
    assert actuator is not None
    k, s = actuator.installed_stiffness, actuator.free_stroke
    # Held output: the actuator pushes with F, the holding force P keeps y = C12 F + C22 P = 0, and e = C11 F + C12 P.
    c11, c12, c22 = compliance.c11, compliance.c12, compliance.c22
    force = s / (c11 - c12**2 / c22 + 1 / k)
    assert compliance.blocked_force(s, k) == pytest.approx(c12 / c22 * force, rel=1e-9)


def test_shares_add_up_and_hinge_bending_leads(validation: Validation) -> None:
    split = validation.shares["K_in_output_free"]
    limit = validation.limit(lambda solution: solution.compliance.c11)  # linear, so that extrapolated pieces add up
    assert sum(split.values()) == pytest.approx(limit.value, rel=1e-9)
    assert max(split, key=lambda piece: split[piece]) == "hinge bending"


def test_hinges_carry_half_the_actuator_force(validation: Validation) -> None:
    """Statics alone: each arm carries half the force, whatever the material."""
    for section in validation.finest.solution.input_sections:
        if section.member.kind == "hinge":
            assert abs(section.normal) == pytest.approx(0.5, rel=0.05)
        if section.member.kind == "rod":
            assert abs(section.shear) == pytest.approx(0.5, rel=0.02)


def test_checks_hold(validation: Validation) -> None:
    for level in validation.levels:
        assert level.solution.checks.reciprocity < 1e-6
        assert level.solution.checks.balance < 1e-8
        assert level.solution.checks.energy < 1e-6


def test_coupling_vanishes_by_symmetry_and_appears_off_axis(validation: Validation) -> None:
    assert validation.fem("coupling_x_actuator_on_axis").value == 0
    assert validation.fem("coupling_z_actuator_on_axis").value == 0
    assert validation.fem("coupling_z_actuator_0.1_mm_off_axis_in_z").value != 0


def test_second_run_comes_from_the_cache(validation: Validation, cache: Path) -> None:
    again = validate(study.read("bridge_amplifier", COARSE), Cache(cache))
    assert all(level.cached for level in again.levels)
    for first, second in zip(validation.comparisons, again.comparisons, strict=True):
        assert second.fem == first.fem


def test_an_accuracy_takes_as_many_meshes_as_it_needs(cache: Path) -> None:
    """The estimates hold what three and more meshes find; what cannot be reached is said."""
    said: list[str] = []

    def to(asked: str) -> Validation:
        overrides = ("modes.count=1", "output.large_steps=0", f'mesh.accuracy="{asked}"')
        return validate(study.read("bridge_amplifier", overrides), Cache(cache), said.append)

    rough, fine = to("2 %"), to("0.5 %")
    assert len(rough.levels) == 2 and rough.estimated_error <= 0.02
    assert len(fine.levels) == 3 and fine.estimated_error <= 0.005
    for key in ("K_in_output_free", "lambda_output_free", "K_out_input_free"):
        assert abs(rough.fem(key).value - fine.fem(key).value) <= rough.fem(key).half_width
    assert any("asked for 0.5 %" in line for line in said)
    text = render.to_markdown(validation_report.document(fine))
    assert "Asked for was an error of at most 0.5 %" in text and "reached" in text


def test_an_accuracy_that_is_not_reached_is_said_in_the_headline(
    validation: Validation, capsys: pytest.CaptureFixture[str]
) -> None:
    """On the terminal and on top of the report; by the quantity whose estimate is the largest, formulas or not."""
    mesh = validation.study.mesh
    missed = replace(validation, study=replace(validation.study, mesh=mesh.model_copy(update={"accuracy": 1e-4})))
    document = validation_report.document(missed)
    worst = 100 * validation.estimated_error
    (said,) = (line for line in document.summary if "NOT reached" in line)
    assert "0.01 % was asked for" in said and f"is {worst:.2g} %" in said
    judged = [q for q in validation.found if q.name in ("K_in", "lambda", "K_out")]
    assert validation.estimated_error == max(abs((q.half_width or 0.0) / q.value) for q in judged)
    terminal.brief(document, table_1.brief(missed), [])
    assert "NOT reached" in capsys.readouterr().out
    for asked in (None, 0.2):
        easy = replace(validation.study, mesh=mesh.model_copy(update={"accuracy": asked}))
        told = validation_report.document(replace(validation, study=easy))
        assert not any("NOT reached" in line for line in told.summary)


def test_large_displacements_begin_with_the_linear_answers_and_reach_full_drive(validation: Validation) -> None:
    """A bridge that is drawn in gets steeper: less amplification at rest than at the end, and a stiffer input."""
    large, coarse = validation.large, validation.levels[0].solution.compliance
    assert large is not None and large.drive[0] == 0.0 and large.drive[-1] >= 1.0
    assert large.path.input_stiffness[0] == pytest.approx(coarse.input_stiffness, rel=1e-5)
    assert large.path.amplification[0] == pytest.approx(coarse.amplification, rel=1e-5)
    assert large.output_stiffness[0] == pytest.approx(coarse.output_stiffness(large.actuator), rel=1e-5)
    # In the first step linear theory is off by no more than the change of the tangents.
    assert large.path.output[1] == pytest.approx(coarse.c12 * large.path.force[1], rel=0.06)
    assert validation.stage_model is not None
    q = validation.stage_model.axes["y"].effects["quadratic_stiffness"]["quadratic"]
    change = next(quantity for quantity in validation.further if quantity.name == "K_out_change")
    travel = next(quantity for quantity in validation.further if "large" in quantity.boundary)
    assert 2 * q * travel.value == pytest.approx(change.value, abs=0.03)


def test_a_changed_dimension_changes_solid_and_models_alike(validation: Validation) -> None:
    thinner = study.read("bridge_amplifier", [*COARSE, 'dimensions.hinge_thickness="0.45 mm"']).design
    part, before = thinner.part(), validation.study.design.part()
    assert part.solid().Volume() < before.solid().Volume()
    k_out = {q.key: q.value for q in part.formulas(thinner.material, None, None)["PRB"]}["K_out_input_free"]
    ratio = k_out / validation.comparisons[2].analytic["PRB"].value
    assert ratio == pytest.approx(0.9**3, rel=1e-9)


def test_the_summary_says_what_the_stage_model_assumes(validation: Validation) -> None:
    """Nothing in a design tells of hysteresis: a piezo engineer must not think that there is none."""
    summary = validation_report.document(validation).summary
    known = "damping_ratio = 0.01, modes.1.damping_ratio = 0.01"
    assert f"Stage model, y: assumed, neither measured nor computed: {known}." in summary
    absent = "hysteresis, creep, sensor noise, driver bandwidth"
    assert f"Stage model, y: not in the model, and assumed to be none: {absent}." in summary
    assert validation.stage_model is not None
    assert f"assumed to be none, for lack of data: {absent}" in stage_model.to_toml(validation.stage_model)


def test_stage_model_is_the_finite_element_model(validation: Validation, tmp_path: Path) -> None:
    model = validation.stage_model
    assert model is not None
    axis, actuator = model.axes["y"], validation.study.design.actuator
    assert actuator is not None and actuator.voltage_range == (0.0, 150.0)
    assert axis.natural_frequency == validation.fem("drive_frequency_actuator_installed").value
    assert axis.stiffness == validation.fem("K_out_actuator_installed").value
    assert axis.gain == pytest.approx(validation.fem("stroke_output_free").value / 150.0)
    assert axis.mass == pytest.approx(axis.stiffness / (2 * math.pi * axis.natural_frequency) ** 2)
    path = tmp_path / "stage_model.toml"
    path.write_text(stage_model.to_toml(model), encoding="utf-8")
    again = stage_model.read(path).axes["y"]
    assert (again.natural_frequency, again.gain) == pytest.approx((axis.natural_frequency, axis.gain), rel=1e-6)


def test_stress_at_a_stated_stroke_scales_with_it(validation: Validation) -> None:
    design = ("actuator.preload=0 N",)
    solution = validation.finest.solution
    one = quantities.stresses(study.read("bridge_amplifier", [*design, "output.stroke=100 um"]), solution)
    two = quantities.stresses(study.read("bridge_amplifier", [*design, "output.stroke=200 um"]), solution)
    assert two[0].name == "hinge_stress"
    assert two[0].value == pytest.approx(2 * one[0].value, rel=1e-12)


def test_report_is_complete_and_self_contained(validation: Validation, document: Document, tmp_path: Path) -> None:
    written = render.write(tmp_path, document, validation_report.result(validation), {})
    page = (tmp_path / "report.html").read_text()
    assert {path.name for path in written} == {path.name for path in tmp_path.iterdir()}
    assert not re.search(r"src=\"(?!data:)", page), "the page must open offline"
    linked = set(re.findall(r"href=\"(?!#)([^\"]*)\"", page))
    assert linked == {"result.json"} <= {path.name for path in written}, "links go to files beside the report"
    assert (tmp_path / "report.html").stat().st_size < 5e6
    assert "prefers-color-scheme: dark" in page
    assert page.count("<img") == len(document.figures) >= 8
    markdown = (tmp_path / "report.md").read_text()
    assert "input stiffness K_in" in markdown and "eq. (17)" in markdown
    content = json.loads((tmp_path / "result.json").read_text())
    for quantity in content["quantities"]:
        assert quantity["unit"], quantity
    assert content["made_by"]["versions"]["scikit-fem"]


def test_pictures_show_something(document: Document) -> None:
    pictures = [figure for figure in document.figures if figure.file.endswith(".png")]
    modes = [figure for figure in pictures if figure.file.startswith("mode_")]
    assert len(pictures) - len(modes) == 5
    assert len(modes) == 5  # the lowest of each symmetry class, and the one that carries three quarters of the output
    for picture in pictures:
        image = Image.open(io.BytesIO(picture.data)).convert("RGB")
        assert image.width >= (700 if picture in modes else 1000)
        colours = np.unique(np.asarray(image.resize((80, 50))).reshape(-1, 3), axis=0)
        assert len(colours) > 20, f"{picture.file} is nearly blank"
    assert sum(len(figure.data) for figure in modes) < 1e6


def test_the_mode_that_carries_the_output_moves(
    validation: Validation,
) -> None:
    """Frames swing from one side through rest to the other and back; the other pictures stand still."""
    document = validation_report.document(validation)
    pictures = {figure: Image.open(io.BytesIO(figure.data)) for figure in document.figures if "mode_" in figure.file}
    (moving,) = [figure for figure, image in pictures.items() if getattr(image, "n_frames", 1) > 1]
    assert "the mode that carries the output, moving" in moving.caption
    frames = [np.asarray(frame.convert("L"), float) for frame in ImageSequence.Iterator(pictures[moving])]
    assert len(frames) == 2 * (len(SWING) - 1) and SWING[0] == 1.0 and SWING[-1] == -1.0
    rest = frames[len(SWING) // 2]
    away = [float(np.abs(frame - rest).mean()) for frame in frames]
    assert away[0] > away[1] > away[2] > away[3] > away[4] == 0.0 == away[12]
    assert away[1:] == pytest.approx(away[:0:-1], rel=1e-2)  # it goes back as it came


def test_ranges_stand_with_the_numbers() -> None:
    """Words stand on the left, and what begins with a sign is a number, be there a space behind it or none."""
    table = Table(["", "range", "sign", "word"], [["a", "± 0.5 %", "-1", "to 3"], ["b", "-1 to +2 %", "+2", "–"]])
    assert table.wordy == [True, False, False, True]


def test_odd_modes_are_mirrored_oddly(validation: Validation) -> None:
    """The whole shape of a mode that is odd in x has u_y(-x) = -u_y(x), of one that is even u_y(-x) = u_y(x)."""
    modes = validation_pictures.drawn_modes(validation)
    reel = validation_pictures.reel(validation, modes)
    quarter = len(validation.modal.solution.positions)
    for (mode, _), shot in zip(modes, reel.shots, strict=True):
        here, there = shot.displacement[:quarter], shot.displacement[quarter : 2 * quarter]
        np.testing.assert_allclose(reel.points[quarter : 2 * quarter], reel.points[:quarter] * [-1, 1, 1])
        sign = 1 if "even in x" in mode.symmetry else -1
        np.testing.assert_allclose(there, sign * here * [-1, 1, 1])


def test_effective_masses_are_told_with_the_part_s_mass(validation: Validation) -> None:
    """The mass is density times volume; by symmetry a mode shakes along one axis at most, here each axis with one."""
    told = validation_report.result(validation)
    material = validation.study.design.material
    volume = validation.study.design.part().solid().Volume() * 1e-9
    assert told["mass"] == {"value": pytest.approx(material.density * volume, rel=1e-6), "unit": "kg"}
    axes = set()
    for mode in told["modes"]:
        masses = [mode["effective_mass"][axis] for axis in "xyz"]
        assert sum(mass > 0 for mass in masses) <= 1 and sum(masses) < told["mass"]["value"]
        axes |= {axis for axis, mass in zip("xyz", masses, strict=True) if mass > 0}
    assert axes == {"x", "y", "z"}


# --- the table's motion -------------------------------------------------------------------------------------------


def test_the_table_moves_by_the_stroke_and_tilts_as_the_coupling_says(validation: Validation) -> None:
    on_axis, off_axis = "full_voltage_actuator_on_axis", "full_voltage_actuator_0.1_mm_off_axis_in_z"
    stroke = validation.fem("stroke_output_free")
    assert validation.fem(f"table_u_y_{on_axis}").value == pytest.approx(stroke.value, rel=1e-9)
    for component in ("u_x", "u_z", "theta_x", "theta_y", "theta_z"):
        assert validation.fem(f"table_{component}_{on_axis}").value == 0  # by symmetry
    # The coupling is per travel on the axis, which the offset changes by its square: (0.1 mm / 20 mm)^2 or less.
    turn, tilt = validation.fem(f"table_theta_x_{off_axis}"), validation.fem("tilt_actuator_0.1_mm_off_axis_in_z")
    assert abs(turn.value) == pytest.approx(tilt.value * abs(stroke.value), rel=3e-3)  # each extrapolated on its own
    assert turn.si == "rad" and turn.unit == "urad" and turn.half_width


def test_the_sensor_s_point_is_fixed_to_the_table(validation: Validation) -> None:
    """u + theta x r, r from the middle of the output's face; without an actuator per newton of its force."""
    sensor = ["2 mm", "31 mm", "-9 mm"]
    asked = study.read("bridge_amplifier", [f"output.sensor={json.dumps(sensor)}"])
    compliance = validation.levels[0].solution.compliance
    found = {q.key: q.value for q in quantities.six_degrees(asked, compliance, off_axis=True)}
    output = next(port for port in asked.design.part().ports() if port.role == "output")
    arm = np.array([2e-3, 31e-3, -9e-3]) - output.point

    def motion(point: str, kind: str) -> np.ndarray:
        return np.array([found[f"{point}_{kind}_{axis}_full_voltage_actuator_0.1_mm_off_axis_in_z"] for axis in "xyz"])

    assert np.linalg.norm(motion("table", "theta")) > 0
    np.testing.assert_array_equal(motion("sensor", "theta"), motion("table", "theta"))
    expected = motion("table", "u") + np.cross(motion("table", "theta"), arm)
    np.testing.assert_allclose(motion("sensor", "u"), expected, rtol=1e-12)
    passive = replace(asked, design=replace(asked.design, actuator=None))
    per_newton = {q.key: q.value for q in quantities.six_degrees(passive, compliance, off_axis=False)}
    assert per_newton["table_u_y_1_N_of_actuator_force_actuator_on_axis"] == pytest.approx(compliance.c12, rel=1e-12)


def test_the_report_has_a_table_for_each_point(document: Document) -> None:
    page = render.to_markdown(document)
    assert "The table, at the middle of the output's face, full voltage" in page and "| θ_x | 0 |" in page
    assert "The sensor's point" not in page and "names output.sensor" in page


@pytest.mark.parametrize(
    ("given", "why"),
    [
        ('["0 mm", "20 mm"]', "expected a point x, y, z"),
        ("5 mm", "expected a point x, y, z"),
        ('["0 mm", "3 N", "1 mm"]', "not a unit of length"),
        ('["0 mm", "3", "1 mm"]', "the unit is missing"),
        ('["0 mm", "3 m", "1 mm"]', "allowed: -1000 to 1000 mm"),
    ],
)
def test_a_sensor_s_point_has_three_lengths(given: str, why: str) -> None:
    with pytest.raises(InputError, match=why) as caught:
        study.read("bridge_amplifier", [f"output.sensor={given}"])
    assert (caught.value.file, caught.value.field) == ("command line", "output.sensor")


def test_command_line(validation: Validation, cache: Path, tmp_path: Path, command_line: Callable[..., Ended]) -> None:
    sets = [word for override in COARSE for word in ("--set", override)]
    out, step, mesh = tmp_path / "out", tmp_path / "part.step", tmp_path / "mesh.vtu"
    exports = ["--export", str(step), "--export", str(mesh)]
    ended = command_line(
        "validate", "bridge_amplifier", *sets, "--cache", str(cache), "--out", str(out), "--json", *exports
    )
    assert ended.code == 0, ended.stderr
    content = json.loads(ended.stdout)
    assert content == json.loads((out / "result.json").read_text())
    assert all(level["cached"] for level in content["meshes"])
    assert step.read_text().startswith("ISO-10303-21")
    exported, solution = meshio.read(mesh), validation.finest.solution
    assert len(exported.points) == len(validation.finest.mesh.points)
    np.testing.assert_array_equal(exported.points, solution.positions[: len(exported.points)])


def test_assert_agrees_passes_and_fails_with_the_table(cache: Path, validation: Validation) -> None:
    assert_agrees("bridge_amplifier", overrides=COARSE, cache=cache, K_in="30 %", amplification="20 %")
    with pytest.raises(
        AssertionError, match=r"K_in_output_free: PRB is off by \+\d\d\.\d %, allowed (\n|.)*input stiffness"
    ):
        assert_agrees("bridge_amplifier", overrides=COARSE, cache=cache, K_in="1 %")
    with pytest.raises(ValueError, match="no quantity 'stiffness'"):
        assert_agrees("bridge_amplifier", overrides=COARSE, cache=cache, stiffness="1 %")


# --- strength and energy ------------------------------------------------------------------------------------------


def test_energies_of_the_regions_are_the_work_of_the_loads(validation: Validation) -> None:
    """Half of each compliance, as the strain energy is; the shares of each case add up to one."""
    for level in validation.levels:
        c, energies = level.solution.compliance, level.solution.energies
        found = [sum(three[k] for three in energies.values()) for k in range(3)]
        assert found == pytest.approx([c.c11 / 2, c.c12 / 2, c.c22 / 2], rel=1e-6)
        for split in quantities.energy_shares(level.solution).values():
            assert sum(split.values()) == pytest.approx(1.0, rel=1e-12)
            assert min(split.values()) >= 0
    told = validation_report.result(validation)["strain_energy_shares"]
    assert max(told["K_in_output_free"], key=told["K_in_output_free"].get) == "hinge"


def test_fatigue_is_judged_by_goodman_s_line(validation: Validation) -> None:
    """Without preload the stress swings from zero: amplitude and mean are half of it, 1/n = a/S + m/R_m."""
    material, solution = validation.study.design.material, validation.finest.solution
    assert material.fatigue is not None and material.ultimate_strength is not None
    asked = study.read("bridge_amplifier", ["actuator.preload=0 N"])
    found = {q.name: q.value for q in quantities.stresses(asked, solution)}
    half = found["hinge_stress"] / 2
    expected = 1 / (half / material.fatigue.strength + half / material.ultimate_strength)
    assert found["safety_against_fatigue"] == pytest.approx(expected, rel=1e-12)
    preloaded = {q.name: q.value for q in quantities.stresses(validation.study, solution)}
    assert preloaded["safety_against_fatigue"] < found["safety_against_fatigue"]


def test_a_sharp_root_has_a_peak_without_error_or_margin(validation: Validation, document: Document) -> None:
    peaks = [q for q in validation.further if q.name == "peak_stress" or "peak stress" in q.boundary]
    assert [q.name for q in peaks] == ["peak_stress"]
    assert peaks[0].half_width is None and "use a fillet" in peaks[0].source
    page = render.to_markdown(document)
    assert "singular: grows with refinement, use a fillet" in page and "Williams 1952" in page


def test_a_round_root_has_a_peak_with_an_error_and_margins(validation: Validation) -> None:
    """The same solutions, read as those of a part with fillets: its margins carry the peak's error."""
    rounded = study.read("bridge_amplifier", ['dimensions.fillet_radius="0.2 mm"'])
    members = {member.name: member for member in rounded.design.part().linkage().members}
    solutions = [
        replace(
            level.solution,
            input_sections=tuple(replace(s, member=members[s.member.name]) for s in level.solution.input_sections),
        )
        for level in validation.levels
    ]
    found = {q.name: q for q in quantities.peak_stresses(rounded, solutions, [2e-4, 1e-4])}
    peak, yielding = found["peak_stress"], found["safety_against_yield"]
    assert (
        peak.half_width is not None
        and yielding.half_width is not None
        and found["safety_against_fatigue"].half_width is not None
    )
    assert yielding.half_width / yielding.value == pytest.approx(peak.half_width / peak.value)
    assert yielding.value == pytest.approx(503e6 / peak.value)

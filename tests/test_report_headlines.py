"""What a report of a validation says first: the better stroke, safety, warnings; its words, pictures and exports."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np
import pytest
from PIL import Image

from flexdesign.core import units
from flexdesign.core.model import Quantity
from flexdesign.core.result_cache import Cache
from flexdesign.design import study
from flexdesign.fem import quantities
from flexdesign.fem.mesh_refinement import ACCURACY_QUANTITIES
from flexdesign.report import charts, render, terminal, wording
from flexdesign.report.document import Document, Table
from flexdesign.report.validation import card, export, table_1, validation_pictures, validation_report
from flexdesign.report.validation.vibrations import symmetry
from flexdesign.workflows.validation import Comparison, Validation, validate

#: As in test_validation.py, with which this file shares solutions.
COARSE = ["mesh.levels=2", "mesh.at_root=0.7", "modes.count=1"]
LARGE, LINEAR = "stroke_output_free_large_displacements", "stroke_output_free"


@pytest.fixture(scope="module")
def validation(shared_cache: Path) -> Validation:
    return validate(study.read("bridge_amplifier", COARSE), Cache(shared_cache))


@pytest.mark.parametrize("name", ["first_frequency", "output_frequency", "drive_frequency"])
def test_no_frequency_is_called_a_stroke_on_the_terminal(name: str, validation: Validation) -> None:
    """The table fits a terminal by symbols, or else by the last word of a name."""
    frequency = Quantity(name, 100.0, "Hz", "Hz", "actuator installed", half_width=1.0)
    compared = replace(validation, comparisons=[Comparison(frequency, {"model": replace(frequency, value=101.0)})])
    ((label, *_),) = table_1.brief(compared).rows
    assert label.startswith("f") and label.endswith("actuator installed")


@pytest.fixture(scope="module")
def document(validation: Validation) -> Document:
    return validation_report.document(validation)


# --- the stroke


def test_headlines_state_the_stroke_with_large_displacements_and_the_linear_one_as_such(
    validation: Validation, document: Document, capsys: pytest.CaptureFixture[str]
) -> None:
    large, linear = (validation.fem(key).formatted() for key in (LARGE, LINEAR))
    assert large != linear
    sentence = f"the output travels {large} with large displacements (linear: {linear})"
    assert sentence in document.summary[0]
    assert document.card[0].value == large and f"linear: {linear}" in document.card[0].note
    terminal.brief(document, table_1.brief(validation), [])
    on_terminal = " ".join(capsys.readouterr().out.split())
    assert sentence in on_terminal and on_terminal.index(large) < on_terminal.index(linear)
    text, page = render.to_markdown(document), render.to_html(document)
    assert text.index(large) < text.index(linear)
    assert page.index(units.typeset(large)) < page.index(units.typeset(linear))
    headline = validation_report.result(validation)["headline"]
    assert headline["stroke"]["value"] == pytest.approx(1e6 * validation.fem(LARGE).value)
    assert headline["stroke_linear"]["value"] == pytest.approx(1e6 * validation.fem(LINEAR).value)


def test_the_stroke_is_the_linear_one_times_what_large_displacements_make_of_it(validation: Validation) -> None:
    large, linear = validation.fem(LARGE), validation.fem(LINEAR)
    assert validation.large is not None
    ratio = validation.large.full_stroke / validation.large.linear_stroke
    assert 1.01 < ratio < 1.1
    assert large.value == pytest.approx(ratio * linear.value, rel=1e-12)
    assert large.half_width is not None and linear.half_width is not None and large.half_width >= linear.half_width


def test_a_stroke_of_small_displacements_alone_is_called_linear(validation: Validation) -> None:
    further = [quantity for quantity in validation.further if "large" not in quantity.boundary]
    small = replace(validation, large=None, further=further)
    assert card.facts(small)[0].name == "stroke, linear"
    assert card.stroke_text(small).endswith("(linear)")
    assert "Large displacements were not followed: the stroke is the linear one." in card.warnings(small)


# --- the card


def test_a_report_opens_with_a_card(validation: Validation, document: Document) -> None:
    names = [fact.name for fact in document.card]
    assert names[0] == "stroke, large displacements" and names[-1] == "preload"
    assert {"input stiffness K_in", "output stiffness K_out", "first natural frequency"} < set(names)
    assert {"safety against yield", "safety against fatigue"} < set(names)
    assert validation_report.result(validation)["warnings"] == document.warnings


def test_safety_is_the_smallest_and_less_than_one_is_a_warning(validation: Validation) -> None:
    weak = Quantity("safety_against_yield", 0.8, "1", "", "peak stress, full voltage")
    broken = replace(validation, further=[*validation.further, weak])
    assert card.margins(broken)[0] is weak
    assert any("safety against yield is 0.8" in warning for warning in card.warnings(broken))


@pytest.mark.parametrize("error", [0.01, 0.2])
def test_an_accuracy_that_was_not_reached_is_said_once_and_in_the_headline(
    validation: Validation, monkeypatch: pytest.MonkeyPatch, error: float
) -> None:
    """Not in the card's warnings as well, though a large error alone is one of them; result.json has one list."""
    unsure = [
        replace(q, half_width=error * abs(q.value)) if q.name in ACCURACY_QUANTITIES else q for q in validation.found
    ]
    monkeypatch.setattr(type(validation), "found", property(lambda _: unsure))
    mesh = validation.study.mesh.model_copy(update={"accuracy": 5e-3})
    asked = replace(validation, study=replace(validation.study, mesh=mesh))
    document = validation_report.document(asked)
    assert len([line for line in document.summary if "0.5 % was asked for" in line]) == 1
    assert not [line for line in document.warnings if "asked for" in line or "largest estimated error" in line]
    assert len([line for line in validation_report.result(asked)["warnings"] if "NOT reached" in line]) == 1
    unasked = [line for line in card.warnings(validation) if "largest estimated error" in line]
    assert len(unasked) == (error > card.ERROR)


# --- words


def test_the_first_mention_of_prb_explains_it(document: Document, validation: Validation) -> None:
    meaning = wording.MODELS["PRB"]
    for text in (
        "\n".join(document.summary),
        render.to_markdown(document),
        table_1.table(validation).caption,
    ):
        assert meaning in text[text.index("PRB") :][: len(meaning) + 10]


@pytest.mark.parametrize("words", ["answers with", "hangs on", "odd in x", "even in z", "what is left"])
def test_words_that_stop_a_reader_are_gone(document: Document, words: str) -> None:
    assert words not in render.to_markdown(document)


def test_no_module_of_reports_calls_a_residual_left() -> None:
    folder = Path(charts.__file__).parent
    texts = {file.name: file.read_text(encoding="utf-8") for file in folder.glob("*.py")}
    found = {
        name: re.findall(r'"[^"\n]*(?:left \[|[Ww]hat is left|hangs on|answers [^"]*with)[^"\n]*"', text)
        for name, text in texts.items()
    }
    assert not {name: phrases for name, phrases in found.items() if phrases}


def test_symmetries_are_told_by_their_planes() -> None:
    assert symmetry("even in x, odd in z") == "symmetric about the plane x = 0, antisymmetric about z = 0"
    assert symmetry("whole part") == "no symmetry"


def test_inputs_leave_out_what_is_not_set(document: Document) -> None:
    inputs = dict(row for row in document.sections[-1].tables[1].rows)
    assert not re.search(r"\bNone\b|\binf\b", " ".join(inputs.values()))
    assert wording.flat({"contact_stiffness": "inf N/um", "source": ""}) == "contact_stiffness infinite"


# --- pictures and tables


def test_the_largest_stress_is_marked(validation: Validation) -> None:
    """The mark lies where the report's peak stress is, and says its number."""
    place, peak, hinge = validation_pictures.hinge_maximum(validation.finest.solution)
    force, _ = quantities.stated_force(validation.study, validation.finest.solution)
    told = next(quantity for quantity in validation.further if quantity.name == "peak_stress")
    assert force * peak == pytest.approx(told.value)
    assert np.hypot(place[0] - hinge.centre[0], place[1] - hinge.centre[1]) < hinge.length / 2 + 2 * hinge.thickness
    marked = {picture.file: picture.mark for picture, _ in validation_pictures._static(validation) if picture.mark}
    assert set(marked) == {"stress.png", "stress_hinge.png"}
    assert all(mark[1].endswith(f"{force * peak / 1e6:.3g} MPa") for mark in marked.values())


def test_the_mark_is_drawn(document: Document) -> None:
    figures = {figure.file: figure for figure in document.figures}
    if "stress.png" not in figures:
        pytest.skip("no pictures on this machine")
    for name, marked in (("stress.png", True), ("deformation.png", False)):
        pixels = np.asarray(Image.open(io.BytesIO(figures[name].data)).convert("RGB")).astype(int)
        red = (pixels[..., 0] > 180) & (pixels[..., 1] < 70) & (pixels[..., 2] < 70)
        assert (red.sum() > 50) == marked


def test_colours_of_displacement_begin_at_zero(validation: Validation) -> None:
    (deformation,) = [p for p, _ in validation_pictures._static(validation) if p.file == "deformation.png"]
    assert deformation.limits is not None and deformation.limits[0] == 0.0


@pytest.mark.parametrize("width", [6.0, 7.2, 12.6, 20.0])
def test_letters_of_a_wide_drawing_are_legible_on_the_page(width: float) -> None:
    figure, axes = charts.drawing(width, 3.0)
    axes.plot([0, 1], [0, 1], label="a")
    axes.text(0.5, 0.5, "small", fontsize=5)
    axes.set_xticks([0.0, 1.0], ["a", "b"], fontsize=6)
    charts.below(figure, axes, 1)
    charts.svg(figure)
    from matplotlib.text import Text

    sizes = [text.get_fontsize() for text in figure.findobj(Text) if text.get_text()]
    assert min(sizes) / 72 * charts.PAGE / width >= charts.SMALLEST - 1e-6


def test_a_table_of_many_columns_is_set_smaller_and_its_heads_wrap() -> None:
    def page(columns: int) -> str:
        return render.to_html(
            Document("A", [], [validation_report.Section("T", (), [Table(["a"] * columns, [["1"] * columns])])])
        )

    assert 'class="wide"' in page(9) and 'class="wide"' not in page(4)
    head = re.search(r"thead th \{([^}]*)\}", page(4))
    assert head is not None and "white-space: normal" in head[1]


# --- exports


def test_a_mesh_is_exported_with_stress(validation: Validation, tmp_path: Path) -> None:
    """In SI, at the load at which the report states stress."""
    export.write_mesh(validation, tmp_path / "mesh.vtu")
    data = meshio.read(tmp_path / "mesh.vtu").point_data
    force, _ = quantities.stated_force(validation.study, validation.finest.solution)
    corners = len(validation.finest.mesh.points)
    solution = validation.finest.solution
    np.testing.assert_allclose(data["von_mises_stress_[Pa]"], force * solution.von_mises[:corners])
    np.testing.assert_allclose(data["displacement_[m]"], force * solution.input_field[:corners])


# --- the terminal


def test_no_name_is_cut_on_a_narrow_terminal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    names = [f"{number}-a-name-of-letters" for number in range(3)]
    terminal.brief(Document("A", []), Table(["run", "error", "noise"], [[n, "2.03 um", "20 nm"] for n in names]), [])
    said = capsys.readouterr().out
    assert "…" not in said

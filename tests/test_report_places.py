"""Where reports go: a folder for each input, nothing replaced in silence, and what a report says of its making."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from flexdesign.analytic import static_model
from flexdesign.core.errors import InputError
from flexdesign.core.model import Quantity
from flexdesign.design import changes, design, study
from flexdesign.dynamics.stage_model import StageModel
from flexdesign.report import origin, render
from flexdesign.report.document import Document, Fact, Section, Table
from flexdesign.report.validation import export, validation_report
from flexdesign.workflows import validation
from tests.conftest import Ended

Run = Callable[..., Ended]
THINNER = 'dimensions.hinge_thickness="0.4 mm"'
K_IN = Quantity("K_in", 2e6, "N/m", "N/mm", "output free", "FEM", 1e3)
SHIPPED = Path(validation.__file__).parents[3] / "geometry"
STAGE = """format = 1

[axis.x]
gain = "1.5 um/V"
natural_frequency = "116 Hz"
damping_ratio = 0.03

[axis.x.actuator]
voltage_range = ["0 V", "100 V"]
"""


@pytest.fixture
def solved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the solution and its report by small ones."""

    def validate(asked: study.Study, *_: object) -> Any:
        found = SimpleNamespace(fem=K_IN, analytic={})
        return SimpleNamespace(
            study=asked, comparisons=[found], further=[], levels=(), seconds=0.0, stage_model=StageModel({}, source="-")
        )

    monkeypatch.setattr(validation, "validate", validate)
    monkeypatch.setattr(validation_report, "document", lambda found, _: Document(found.study.design.title, ["Stiff."]))
    monkeypatch.setattr(validation_report, "result", lambda _: {"kind": "validation"})


def folders(tmp_path: Path) -> set[str]:
    return {path.name for path in (tmp_path / "reports").iterdir()}


# --- folders and titles of changed designs


@pytest.mark.usefixtures("solved")
def test_a_changed_design_has_a_folder_and_a_title_of_its_own(tmp_path: Path, command_line: Run) -> None:
    assert command_line("validate", "bridge_amplifier", "--json").code == 0
    assert command_line("validate", "bridge_amplifier", "--set", THINNER, "--json").code == 0
    assert folders(tmp_path) == {"bridge_amplifier", "bridge_amplifier_hinge_thickness_0.4_mm"}
    titles = [(tmp_path / "reports" / name / "report.md").read_text().splitlines()[0] for name in folders(tmp_path)]
    assert sorted(titles) == ["# Bridge amplifier", "# Bridge amplifier (hinge_thickness 0.4 mm)"]


def test_a_study_s_own_title_tells_changes_too() -> None:
    changed = study.read("lin2019_amplifier", ["dimensions.hinge_thickness=0.4 mm", "mesh.levels=2"]).design
    assert changed.title.endswith("(hinge_thickness 0.4 mm)")


def test_many_changes_make_a_name_that_a_folder_can_have() -> None:
    one, other = ([f"axis.x.key_{n}={value}" for n in range(40)] for value in (1, 2))
    assert len(changes.as_name(one)) < 80 and changes.as_name(one) != changes.as_name(other)
    assert re.fullmatch(r"[\w.+-]+", changes.as_name(['output.sensor=["0 mm", "../a"]', "limits.|K|=> 2 N/um"]))
    assert len(changes.title_with_changes("A", one)) < 120


def test_each_stage_model_has_a_folder_of_its_own(tmp_path: Path, command_line: Run) -> None:
    for name in ("first", "second"):
        (tmp_path / "reports" / name).mkdir(parents=True)
        (tmp_path / "reports" / name / "stage_model.toml").write_text(STAGE)
        ended = command_line("simulate", f"reports/{name}/stage_model.toml", "--json")
        assert ended.code == 0, ended.stderr
    assert folders(tmp_path) == {"first", "second", "first_stage_model_standard", "second_stage_model_standard"}


# --- nothing is replaced in silence


@pytest.mark.usefixtures("solved")
def test_designs_of_one_name_have_folders_of_their_own(tmp_path: Path, command_line: Run) -> None:
    for folder in ("here", "there"):
        shutil.copytree(SHIPPED, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
        ended = command_line("validate", f"{folder}/bridge_amplifier.toml", "--json")
        assert ended.code == 0, ended.stderr
    first, second = sorted(folders(tmp_path))
    assert (first, len(second)) == ("bridge_amplifier", len("bridge_amplifier_123456"))
    again = command_line("validate", "there/bridge_amplifier.toml", "--json")
    assert sorted(folders(tmp_path)) == [first, second]
    assert "replaced" not in again.stderr


@pytest.mark.usefixtures("solved")
def test_a_report_of_another_input_is_not_replaced_silently(tmp_path: Path, command_line: Run) -> None:
    assert "replaced" not in command_line("validate", "--out", "out", "--json").stderr
    assert "replaced" not in command_line("validate", "--out", "out", "--json").stderr
    ended = command_line("validate", "--out", "out", "--json", "--set", THINNER)
    assert "flexdesign: replaced the report in out, which was that of validate" in ended.stderr
    ended = command_line("validate", "--out", "out", "--json")
    assert f"with {THINNER}" in ended.stderr
    assert json.loads(ended.stdout)["inputs"]["settings"] == []


@pytest.mark.usefixtures("solved")
def test_a_report_made_before_a_file_changed_is_replaced_and_that_is_said(tmp_path: Path, command_line: Run) -> None:
    shutil.copytree(SHIPPED, tmp_path / "geometry", ignore=shutil.ignore_patterns("__pycache__"))
    assert command_line("validate", "bridge_amplifier", "--json").code == 0
    file = tmp_path / "geometry" / "bridge_amplifier.toml"
    file.write_text(file.read_text().replace('hinge_thickness = "0.5 mm"', 'hinge_thickness = "0.45 mm"'))
    ended = command_line("validate", "bridge_amplifier", "--json")
    assert "made before bridge_amplifier.toml changed" in ended.stderr
    assert folders(tmp_path) == {"bridge_amplifier"}


@pytest.mark.parametrize("content", ["", "[1]", '{"inputs": 3}', '{"inputs": {"files": 3, "settings": 4}}', "\x00{"])
@pytest.mark.usefixtures("solved")
def test_whatever_lies_there_it_is_replaced_and_that_is_said(command_line: Run, content: str) -> None:
    Path("out").mkdir()
    Path("out/result.json").write_text(content)
    ended = command_line("validate", "--out", "out", "--json")
    assert ended.code == 0 and "replaced the report in out" in ended.stderr


# --- tables carry what differs


def test_a_table_of_a_changed_design_is_compared_like_with_like(tmp_path: Path) -> None:
    """The model that reads a table of a thinner hinge predicts that of a thinner hinge."""
    thinner, plain = (design.read(design.find("bridge_amplifier"), sets) for sets in ([THINNER], []))
    file = tmp_path / "fem.csv"
    file.write_text(static_model.to_csv([K_IN], thinner))
    assert "hinge_thickness [mm]" in file.read_text()
    read = static_model.read([file], plain)
    (row,) = read.rows
    assert row.dimensions == {"hinge_thickness": pytest.approx(0.4e-3)}
    (predicted,) = static_model.of_design(plain).predict(read)
    (own,) = static_model.of_design(thinner).predict(static_model.read([file], thinner))
    assert predicted == pytest.approx(own)
    assert static_model.to_csv([K_IN], plain) == static_model.to_csv([K_IN])


def test_a_number_of_parts_is_carried_too(tmp_path: Path) -> None:
    changed, plain = (
        design.read(design.find("lin2019_xyz_stage"), sets) for sets in (["dimensions.lateral_branches=2"], [])
    )
    k_in = Quantity("K_in", 2e6, "N/m", "N/mm", "x, table free", "FEM", 1e3)
    file = tmp_path / "fem.csv"
    file.write_text(static_model.to_csv([k_in], changed))
    (row,) = static_model.read([file], plain).rows
    assert row.dimensions == {"lateral_branches": 2.0} and row.numbers == {"lateral_branches"}


@pytest.mark.parametrize(
    "override", ["material=AZ31B", 'actuator.stiffness="50 N/um"', 'actuator.contact_stiffness="90 N/um"']
)
def test_a_table_of_another_material_or_actuator_is_refused(tmp_path: Path, override: str) -> None:
    changed, plain = (design.read(design.find("bridge_amplifier"), sets) for sets in ([override], []))
    file = tmp_path / "fem.csv"
    file.write_text(static_model.to_csv([K_IN], changed))
    assert len(static_model.read([file], changed).rows) == 1
    with pytest.raises(InputError, match="the same --set"):
        static_model.read([file], plain)


# --- what a report says of its making


def test_a_report_has_date_command_and_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "1700000000")
    monkeypatch.setattr("sys.argv", ["/usr/bin/flexdesign", "validate", "my design.toml", "--out", "x", "--json"])
    document = Document("A", ["B."], [Section("C", tables=[Table(["a"], [["1"]])])])
    render.write(tmp_path, document, {}, {"fem.csv": "", "stage_model.toml": ""}, ["a solid.step", "mesh.vtu"])
    for name in ("report.html", "report.md"):
        text = (tmp_path / name).read_text()
        assert "2023-11-14 22:13 UTC" in text
        assert "flexdesign validate &#39;my design.toml&#39;" in text or "flexdesign validate 'my design.toml'" in text
        for file in ("fem.csv", "stage_model.toml", "result.json", "a%20solid.step", "mesh.vtu"):
            assert f"({file})" in text or f'href="{file}"' in text, file


def test_answer_warnings_and_card_come_before_the_rest() -> None:
    card, warnings = [Fact("stroke", "406 um", "linear")], ["No yield strength is known."]
    document = Document("A", ["Answer.", "More."], [], card, warnings)
    orders = {
        render.to_html: ("Answer.", "No yield strength", "stroke", "406 µm", "More."),
        render.to_markdown: ("stroke", "406 um", "No yield strength", "Answer.", "More."),
    }
    for write, order in orders.items():
        at = [write(document).index(words) for words in order]
        assert at == sorted(at)


def test_a_table_without_rows_is_said_to_be_empty() -> None:
    document = Document("title", [], [Section("Wrong verdicts", tables=[Table(["case", "effect"], [])])])
    assert "None." in render.to_markdown(document) and "| case |" not in render.to_markdown(document)
    assert "<p>None.</p>" in render.to_html(document) and "<table" not in render.to_html(document)


def test_a_study_says_how_it_is_run() -> None:
    assert origin.command(["/x/studies/lin2019_gains/__main__.py"]) == "python -m studies.lin2019_gains"
    assert origin.command(["/x/flexdesign/__main__.py", "size", "a"]) == "flexdesign size a"


@pytest.mark.usefixtures("solved")
def test_a_bare_name_is_exported_beside_the_report(tmp_path: Path, command_line: Run) -> None:
    ended = command_line("validate", "--out", "out", "--json", "--export", "part.step")
    assert ended.code == 0, ended.stderr
    assert (tmp_path / "out" / "part.step").read_text().startswith("ISO-10303-21")
    assert not (tmp_path / "part.step").exists()
    assert "(part.step)" in (tmp_path / "out" / "report.md").read_text()


# --- a folder where a file is meant


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("simulate", "d"), "d: is a folder; name a stage model"),
        (("simulate", "lin2019_stage", "d"), "d: is a folder; name a study of experiments"),
        (("diagnose", "bridge_amplifier", "bench.csv", "-o", "d"), "-o = d: cannot be written (it is a folder)"),
        (("add", "bridge_amplifier", "over_cut", "bench.csv", "-o", "d"), "-o = d: cannot be written (it is a folder)"),
        (("validate", "--out", "out", "--export", "part.step"), "--export = part.step: is a folder"),
    ],
)
def test_a_folder_where_a_file_is_meant_is_named_at_once(
    command_line: Run, arguments: tuple[str, ...], words: str
) -> None:
    for folder in ("d", "out/part.step"):
        Path(folder).mkdir(parents=True)
    Path("bench.csv").write_text("quantity,value,unit,sigma,boundary\nK_in,2000,N/mm,10,free\n")
    ended = command_line(*arguments)
    assert ended.code == 2 and words in ended.stderr.splitlines()[-1]


def test_a_full_temporary_folder_is_told_of_an_export(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tempfile.TemporaryDirectory", full)
    with pytest.raises(InputError, match="No space left on device") as caught:
        export.writers(["mesh.vtu"], tmp_path / "out")
    assert caught.value.field == "TMPDIR"

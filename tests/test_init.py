"""``flexdesign init`` writes files that work as they are, completely or not at all."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import flexdesign as fd
from flexdesign.core.errors import InputError
from flexdesign.workflows import scaffolding

Run = Callable[..., Any]


def test_a_project_can_be_read_and_compared(command_line: Run) -> None:
    ended = command_line("init", "project", "my_stage")
    assert ended.code == 0 and "my_stage/README.md" in ended.stdout.replace("\\", "/")
    assert fd.read_design("my_stage/amplifier.toml").dimensions["arm_span"] == pytest.approx(20e-3)
    assert fd.compare("my_stage/model.toml", "my_stage/runs").rms > 1e-6


def test_the_page_names_what_is_there(tmp_path: Path) -> None:
    scaffolding.write_project(tmp_path / "new")
    text = (tmp_path / "new" / "README.md").read_text()
    rows = re.findall(r"^\| `([\w./]+)` \|", text, re.M)
    assert rows and all((tmp_path / "new" / name).exists() for name in rows)
    assert text.startswith("# New\n")


def test_a_folder_with_content_is_left_alone(command_line: Run) -> None:
    Path("full").mkdir()
    (Path("full") / "mine.txt").write_text("mine")
    ended = command_line("init", "project", "full")
    assert (ended.code, ended.stdout) == (2, "")
    assert "FOLDER = full: exists and is not empty; choose another folder" in ended.stderr
    assert [path.name for path in Path("full").iterdir()] == ["mine.txt"]


def test_an_empty_folder_is_filled(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert scaffolding.write_folder(tmp_path / "empty", {"a/b.txt": "c"}) == [tmp_path / "empty" / "a/b.txt"]
    assert (tmp_path / "empty/a/b.txt").read_text() == "c"
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]


def test_nothing_is_left_where_a_file_fails(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        scaffolding.write_folder(tmp_path / "new", {"a": "a file", "a/b": "not a folder"})
    assert list(tmp_path.iterdir()) == []


# --- a part, an effect, a study


def test_a_part_is_short_and_can_be_built(command_line: Run) -> None:
    """It is the table on two leaves that the solid says: volume of both blocks and both leaves."""
    ended = command_line("init", "part", "leaf_guide")
    assert (ended.code, ended.stdout.split()) == (0, ["leaf_guide.py", "leaf_guide.toml"])
    assert len(Path("leaf_guide.py").read_text().splitlines()) < 40
    part = fd.read_design("leaf_guide.toml").part()
    assert type(part).__name__ == "LeafGuide"
    solid = part.solid()
    assert solid.isValid() and solid.Volume() == pytest.approx(10 * (30 * 20 + 2 * 0.5 * 20), rel=1e-9)
    assert [port.role for port in part.ports()] == ["input", "output", "ground"]


@pytest.mark.slow
def test_a_part_validates(command_line: Run) -> None:
    """K = 24 E I / L^3 of two leaves; roots make it softer, their width stiffer, by some percent in all."""
    command_line("init", "part")
    found = fd.validate("my_part.toml", mesh={"levels": 2, "independent": False})
    expected = 24 * found.study.design.material.youngs_modulus * 10e-3 * 0.5e-3**3 / 12 / 20e-3**3
    assert found["K_out"].value == pytest.approx(expected, rel=0.06)


def test_an_effect_works_as_it_is(command_line: Run) -> None:
    assert command_line("init", "effect", "warm_up.py").code == 0
    ended = command_line("effects", "warm_up.py", "--json")
    assert ended.code == 0 and "drift of the reading" in ended.stdout


def test_a_study_can_be_read(command_line: Run) -> None:
    assert command_line("init", "study", "mine").code == 0
    study = fd.read_study("mine.toml")
    assert (study.mesh.accuracy, study.modes.count) == (0.01, 4)


@pytest.mark.parametrize("kind", ["part", "effect", "study"])
def test_nothing_is_overwritten(kind: str, command_line: Run) -> None:
    assert command_line("init", kind, "mine").code == 0
    before = {path.name: path.read_text() for path in Path().iterdir() if path.is_file()}
    ended = command_line("init", kind, "mine")
    assert ended.code == 2 and "exists; choose another name" in ended.stderr
    assert {path.name: path.read_text() for path in Path().iterdir() if path.is_file()} == before


def test_a_name_that_python_has_not(command_line: Run) -> None:
    ended = command_line("init", "part", "2nd part")
    assert ended.code == 2 and "NAME = 2nd part: is no name of a Python file" in ended.stderr
    assert not list(Path().iterdir())

"""``flexdesign init project`` writes a project that works, completely or not at all."""

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

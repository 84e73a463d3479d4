"""Files written whole or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexdesign.core.whole_files import written_whole


def test_files_move_together_and_replace_what_is_there(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("before")
    with written_whole(tmp_path) as scratch:
        (scratch / "a.txt").write_text("after")
        (scratch / "b.txt").write_text("new")
        assert (tmp_path / "a.txt").read_text() == "before" and not (tmp_path / "b.txt").exists()
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {"a.txt": "after", "b.txt": "new"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_after_an_error_nothing_has_changed(error: type[BaseException], tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("before")
    with pytest.raises(error), written_whole(tmp_path) as scratch:
        (scratch / "a.txt").write_text("half")
        raise error
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {"a.txt": "before"}


def test_a_folder_must_be_there(tmp_path: Path) -> None:
    with pytest.raises(OSError), written_whole(tmp_path / "missing"):
        pass

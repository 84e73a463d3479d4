"""`--no-code`: a file of somebody else runs in no command that names it, and what ran is said."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from flexdesign.core import foreign_code

ROOT = Path(__file__).resolve().parent.parent
RUNS = ROOT / "studies" / "hidden_effect_demo"
BAD = '\n\n__import__("pathlib").Path("ran").touch()\n'


@pytest.fixture(autouse=True)
def allowed(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Begin and end with code allowed, and nothing run."""
    monkeypatch.setenv(foreign_code.VARIABLE, "")
    monkeypatch.setattr(foreign_code, "_ran", {})
    yield


@pytest.fixture
def stranger(tmp_path: Path) -> Path:
    """A folder of somebody else: a part, a design, an effect and a model that name them, recordings."""
    part = (ROOT / "geometry" / "bridge_amplifier.py").read_text()
    (tmp_path / "their_part.py").write_text(part + BAD)
    design = (ROOT / "geometry" / "bridge_amplifier.toml").read_text()
    (tmp_path / "design.toml").write_text(design.replace('part = "bridge_amplifier"', 'part = "their_part.py"'))
    effect = (ROOT / "flexdesign" / "effects" / "creep.py").read_text()
    (tmp_path / "their_effect.py").write_text(effect + BAD)
    model = (RUNS / "model.toml").read_text()
    (tmp_path / "model.toml").write_text(model + '\n[axis.x.effects."their_effect.py"]\nper_decade = 0.01\n')
    shutil.copytree(RUNS / "runs", tmp_path / "runs")
    shutil.copy(ROOT / "studies" / "hidden_over_cut" / "bench.csv", tmp_path / "table.csv")
    sweep = (
        'format = 1\ndesign = "design.toml"\nevaluator = "analytic"\n[vary]\n"dimensions.width" = ["10 mm", "12 mm"]\n'
    )
    (tmp_path / "sweep.toml").write_text(sweep)
    study = 'format = 1\ndesign = "design.toml"\n'
    (tmp_path / "study.toml").write_text(study)
    return tmp_path


COMMANDS = [
    ("validate", "design.toml"),
    ("validate", "study.toml"),
    ("sweep", "sweep.toml"),
    ("optimize", "sweep.toml"),
    ("simulate", "model.toml"),
    ("identify", "model.toml", "runs"),
    ("compare", "model.toml", "runs"),
    ("diagnose", "model.toml", "runs"),
    ("plan", "model.toml", "--slew", "500 V/s"),
    ("add", "model.toml", "creep", "runs"),
    ("compare", "design.toml", "table.csv"),
    ("diagnose", "design.toml", "table.csv"),
    ("effects", "their_effect.py"),
    ("diagnose", str(RUNS / "model.toml"), "runs", "--effect", "their_effect.py"),
    ("add", str(RUNS / "model.toml"), "their_effect.py", "runs"),
]


@pytest.mark.parametrize("arguments", COMMANDS, ids=" ".join)
def test_nothing_of_a_stranger_runs(
    arguments: tuple[str, ...], stranger: Path, command_line: Callable[..., Any]
) -> None:
    ended = command_line(*arguments, "--no-code")
    assert ended.code == 2
    assert "--no-code forbids its" in ended.stderr and "their_" in ended.stderr
    assert "Traceback" not in ended.stderr and "ran the code" not in ended.stderr
    assert not (stranger / "ran").exists()


def test_what_ran_is_said(stranger: Path, command_line: Callable[..., Any]) -> None:
    ended = command_line("compare", "design.toml", "table.csv")
    assert ended.code == 0
    assert f"flexdesign: ran the code of {stranger / 'their_part.py'} (part); --no-code forbids it" in ended.stderr
    assert (stranger / "ran").exists()


def test_what_comes_with_flexdesign_runs_and_is_not_said(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    ended = command_line(
        "--no-code", "compare", "bridge_amplifier", str(ROOT / "studies" / "hidden_over_cut" / "bench.csv"), "--json"
    )
    assert ended.code == 0 and "ran the code" not in ended.stderr
    assert json.loads(ended.stdout)


def test_processes_inherit_it(monkeypatch: pytest.MonkeyPatch) -> None:
    import os

    foreign_code.forbid()
    assert foreign_code.is_forbidden() and os.environ[foreign_code.VARIABLE] == "1"

"""`flexdesign doctor`: what is missing is named with the command that installs it; what is broken ends with 1."""

from __future__ import annotations

import importlib.util
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import flexdesign as fd
from flexdesign.fem.solving import solver
from flexdesign.workflows import doctor


def without(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    known = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name in modules else known(name, *a))


def item(name: str, cache: Path) -> doctor.Item:
    return next(each for each in doctor.examine(cache).items if each.name == name)


def test_everything_is_there(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    ended = command_line("doctor", "--json")
    content = json.loads(ended.stdout)
    names = [each["name"] for each in content["items"]]
    assert names[:2] == ["flexdesign", "extra design"] and "memory" in names
    assert ended.code == (0 if content["is_sound"] else 1)


@pytest.mark.parametrize(("module", "extra"), [("h5py", "import"), ("SALib", "sensitivity"), ("dask", "cluster")])
def test_a_missing_extra(module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without(monkeypatch, module)
    found = item(f"extra {extra}", tmp_path)
    assert found.state == "missing" and module in found.found and "brings" in found.found
    assert found.remedy == f"pip install 'flexdesign[{extra}]'"
    assert doctor.examine(tmp_path).is_sound


def test_no_mkl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without(monkeypatch, "pypardiso")
    assert item("solver", tmp_path).state == "missing"


def test_no_opengl(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "DRAWING", "import os; os.abort()")
    found = item("pictures", tmp_path)
    assert found.state == "problem" and "reports have no pictures" in found.found


def test_drawing_that_never_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def late(*_: Any, **__: Any) -> Any:
        raise subprocess.TimeoutExpired("python", 1)

    monkeypatch.setattr(subprocess, "run", late)
    assert item("pictures", tmp_path).state == "problem"


def test_little_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "available_memory", lambda: 2**30)
    assert item("memory", tmp_path).found.startswith("1.0 GiB free")
    assert item("memory", tmp_path).state == "problem"


def test_a_cache_that_cannot_be_written(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    (tmp_path / "file").touch()
    ended = command_line("doctor", "--cache", "file")
    assert ended.code == 1
    assert "Problems: cache" in ended.stdout and "FLEXDESIGN_CACHE" in ended.stdout


def test_memory_of_a_container(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "memory.max").write_text("3000000\n")
    (tmp_path / "memory.current").write_text("1000000\n")
    monkeypatch.setattr(solver, "CONTAINER", str(tmp_path))
    assert solver.available_memory() == 2_000_000
    (tmp_path / "memory.max").write_text("max\n")
    assert (solver.available_memory() or 10**12) > 2_000_000


def test_from_python(tmp_path: Path) -> None:
    found = fd.doctor(tmp_path)
    assert found["cache"] == "ok" and "extra design" in str(found)

"""`flexdesign doctor`: what is missing is named with the command that installs it; what is broken ends with 1."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import flexdesign as fd
from flexdesign.fem.solving import solver
from flexdesign.workflows import doctor


def without(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    known = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *a: None if name in modules else known(name, *a))


@pytest.fixture
def without_drawing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no picture, which takes seconds."""
    monkeypatch.setattr(doctor, "DRAWING", "pass")


def item(name: str, cache: Path) -> doctor.Item:
    return next(each for each in doctor.examine(cache).items if each.name == name)


def test_everything_is_there(tmp_path: Path, command_line: Callable[..., Any]) -> None:
    ended = command_line("doctor", "--json")
    content = json.loads(ended.stdout)
    names = [each["name"] for each in content["items"]]
    assert names[:2] == ["flexdesign", "extra design"] and "memory" in names
    assert ended.code == (0 if content["is_sound"] else 1)


@pytest.mark.usefixtures("without_drawing")
@pytest.mark.parametrize(("module", "extra"), [("h5py", "import"), ("SALib", "sensitivity"), ("dask", "cluster")])
def test_a_missing_extra(module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    without(monkeypatch, module)
    examined = doctor.examine(tmp_path)
    found = next(each for each in examined.items if each.name == f"extra {extra}")
    assert found.state == "missing" and module in found.found and "brings" in found.found
    assert found.remedy == f"pip install 'flexdesign[{extra}]'"
    assert examined.is_sound


@pytest.mark.parametrize(
    ("arguments", "module", "said"),
    [
        (("validate", "bridge_amplifier"), "cadquery", "BridgeAmplifier.solid(): needs cadquery"),
        (("ports", "a.step"), "OCP.STEPCAFControl", "flexdesign: needs cadquery-ocp"),
    ],
)
def test_a_command_without_its_extra_says_what_to_install(
    arguments: tuple[str, ...],
    module: str,
    said: str,
    command_line: Callable[..., Any],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The part's own method needs it, or the command itself."""
    Path("a.step").write_text("ISO-10303-21;")
    monkeypatch.setitem(sys.modules, module, None)
    ended = command_line(*arguments)
    assert ended.code == 2
    assert ended.stderr.splitlines()[-1].endswith(f"{said}: pip install 'flexdesign[design]'")
    assert "Traceback" not in ended.stderr


@pytest.mark.usefixtures("without_drawing")
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


@pytest.mark.usefixtures("without_drawing")
def test_little_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "available_memory", lambda: 2**30)
    assert item("memory", tmp_path).found.startswith("1.0 GiB free")
    assert item("memory", tmp_path).state == "problem"


@pytest.mark.usefixtures("without_drawing")
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


def test_memory_of_a_process() -> None:
    """`ulimit -v` counts; a process of its own, as a limit once lowered stays."""
    resource = pytest.importorskip("resource")
    limit = f"import resource; resource.setrlimit(resource.RLIMIT_AS, (2**31, {resource.RLIM_INFINITY}))"
    asked = f"from flexdesign.fem.solving import solver; {limit}; print(solver.available_memory())"
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert 0 < int(done.stdout) < 2**31


@pytest.mark.usefixtures("without_drawing")
def test_from_python(tmp_path: Path) -> None:
    found = fd.doctor(tmp_path)
    assert found["cache"] == "ok" and "extra design" in str(found)


# --- What is missing as a report is written


def test_a_report_without_opengl_has_no_pictures_and_says_so() -> None:
    from flexdesign.report import pictures

    said: list[str] = []
    drawn = pictures.draw_or_explain(lambda: pictures.apart(os.abort), said.append)  # type: ignore[arg-type, return-value]
    assert drawn[:2] == ([], []) and drawn[2] == said
    assert said[0].startswith("No pictures: ")


def test_without_mkl_superlu_solves(monkeypatch: pytest.MonkeyPatch) -> None:
    import scipy.sparse as sp

    monkeypatch.setitem(sys.modules, "pypardiso", None)
    upper = sp.csr_matrix(np.triu(np.array([[4.0, 1.0], [1.0, 3.0]])))
    factor = solver.factorize(upper)
    assert factor.name == "SciPy SuperLU"
    assert factor.solve(np.array([1.0, 2.0])) == pytest.approx([1 / 11, 7 / 11])


def test_superlu_out_of_memory_is_refused_with_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    import scipy.sparse as sp
    from scipy.sparse import linalg

    def full(*_: Any, **__: Any) -> Any:
        raise MemoryError

    monkeypatch.setattr(linalg, "splu", full)
    with pytest.raises(solver.NotEnoughMemory, match="2 unknowns need more memory than there is"):
        solver.SuperLU(sp.csr_matrix(np.eye(2)))


def test_what_would_fit_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    import scipy.sparse as sp

    pytest.importorskip("pypardiso")
    monkeypatch.setattr(solver, "available_memory", lambda: 1000)
    laplacian = sp.diags([np.full(9999, -1.0), np.full(10000, 2.5)], [1, 0]).tocsr()
    with pytest.raises(solver.NotEnoughMemory, match=r"10000 unknowns need .* are free: about \d+ would fit"):
        solver.factorize(laplacian)

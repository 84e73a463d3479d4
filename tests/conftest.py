"""What several test files share."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import settings

from flexdesign import cli

# The clock says nothing where cores are shared; the examples are the same in every run.
settings.register_profile("flexdesign", deadline=None, derandomize=True)
settings.load_profile("flexdesign")


#: A stage with amplifiers on four sides, to which reference values belong.
FOUR_SIDED = Path(__file__).resolve().parent / "designs" / "four_sided_stage.toml"


@pytest.fixture(scope="session")
def shared_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache that all files share, also where pytest-xdist runs them in several processes."""
    base = tmp_path_factory.getbasetemp()
    return (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "shared_cache"


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    code: int
    stdout: str
    stderr: str


@pytest.fixture
def command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Ended]:
    """Run the command line as `flexdesign ARGUMENTS` does, in an empty folder with an empty cache."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("FLEXDESIGN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def run(*arguments: str) -> Ended:
        monkeypatch.setattr(sys, "argv", ["flexdesign", *arguments])
        capsys.readouterr()
        code = 0
        try:
            cli.main()
        except SystemExit as stop:
            code = int(stop.code or 0)
        said = capsys.readouterr()
        return Ended(code, said.out, said.err)

    return run

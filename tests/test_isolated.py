"""Calls in a process of their own: answers, errors, sudden ends, interrupts, and scripts that call without a guard."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from flexdesign.core import subprocess_call


def folder_and_files() -> tuple[Path, list[Path]]:
    return Path.cwd(), list(Path.cwd().iterdir())


def refused(number: float) -> float:
    raise ValueError(f"{number} is refused")


def ended(code: int) -> None:
    os._exit(code)


def interrupted() -> None:
    signal.raise_signal(signal.SIGINT)


def test_it_answers_as_the_function_does() -> None:
    assert subprocess_call.call(math.hypot, 3.0, 4.0) == 5.0
    assert subprocess_call.call(np.full, 3, fill_value=2.0).tolist() == [2.0, 2.0, 2.0]


def test_it_runs_in_an_empty_folder_of_its_own_that_is_gone_afterwards() -> None:
    folder, files = subprocess_call.call(folder_and_files)
    assert files == [] and folder != Path.cwd() and not folder.exists()


def test_what_the_function_raises_is_raised() -> None:
    with pytest.raises(ValueError, match=r"2\.0 is refused"):
        subprocess_call.call(refused, 2.0)


@pytest.mark.parametrize("code", [0, 3])
def test_an_end_without_an_answer_is_told(code: int) -> None:
    with pytest.raises(subprocess_call.ProcessDied, match="ended ended without an answer"):
        subprocess_call.call(ended, code)


@pytest.mark.skipif(os.name != "posix", reason="signals as return codes are POSIX's")
def test_an_interrupt_is_passed_on() -> None:
    with pytest.raises(KeyboardInterrupt):
        subprocess_call.call(interrupted)


def test_a_script_needs_no_guard(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import math\nfrom flexdesign.core import subprocess_call as isolated\nprint(isolated.call(math.sqrt, 16.0))\n"
    )
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "4.0\n", "")

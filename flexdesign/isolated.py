"""Native libraries that may end the whole process run in one of their own."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
#: What was given to a process and what it answers, beside the folder in which it runs.
GIVEN, ANSWER, FOLDER = "given.pickle", "answer.pickle", "scratch"


class ProcessDied(Exception):
    """The process ended without an answer."""


def call(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a module-level function in a fresh process, in an empty scratch folder, and return what it returns.

    The process runs nothing of the script that calls, so that this needs no guard against being run twice. An
    interrupt from the keyboard ends the process and is raised here as KeyboardInterrupt, even where the library would
    have swallowed it. What the function raises is raised here.

    Raises
    ------
    ProcessDied
        If the process ended without an answer.
    """
    with tempfile.TemporaryDirectory(prefix="flexdesign-") as name:
        place = Path(name)
        (place / FOLDER).mkdir()
        (place / GIVEN).write_bytes(pickle.dumps((function, args, kwargs)))
        paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
        command = [sys.executable, "-m", __name__, name]
        ended = subprocess.run(command, cwd=place / FOLDER, env={**os.environ, "PYTHONPATH": paths}, check=False)
        if ended.returncode == -signal.SIGINT:
            raise KeyboardInterrupt
        if not (place / ANSWER).is_file():
            raise ProcessDied(f"{getattr(function, '__name__', function)} ended without an answer")
        is_error, answer = pickle.loads((place / ANSWER).read_bytes())
    if is_error:
        raise answer
    return answer


def _serve(place: Path) -> None:
    """Answer what was given."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    function, args, kwargs = pickle.loads((place / GIVEN).read_bytes())
    try:
        answer = pickle.dumps((False, function(*args, **kwargs)))
    except Exception as error:
        answer = pickle.dumps((True, error))
    unfinished = place / "unfinished"
    unfinished.write_bytes(answer)
    unfinished.replace(place / ANSWER)


if __name__ == "__main__":
    _serve(Path(sys.argv[1]))

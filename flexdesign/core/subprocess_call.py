"""Libraries that may end the whole process, or never come back, run in one of their own.

`call` starts a fresh process for long work; `ask` keeps one for many short questions.
"""

from __future__ import annotations

import atexit
import contextlib
import math
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, ParamSpec, TypeVar

from flexdesign.core.errors import InputError

P = ParamSpec("P")
T = TypeVar("T")
#: Files of a process: its input, its result, and the folder in which it runs.
GIVEN, ANSWER, FOLDER = "given.pickle", "answer.pickle", "scratch"
#: A process that has a limit of processor time may take this many times as long by the clock: machines are shared.
CLOCK_PER_PROCESSOR = 10.0


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
    with _scratch() as place:
        with _no_file_remedy():
            (place / FOLDER).mkdir()
            (place / GIVEN).write_bytes(pickle.dumps((function, args, kwargs)))
        paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
        command = [sys.executable, "-m", __name__, str(place)]
        process = subprocess.run(command, cwd=place / FOLDER, env={**os.environ, "PYTHONPATH": paths}, check=False)
        if process.returncode == -signal.SIGINT:
            raise KeyboardInterrupt
        if not (place / ANSWER).is_file():
            raise ProcessDied(f"{getattr(function, '__name__', function)} ended without an answer")
        is_error, outcome = pickle.loads((place / ANSWER).read_bytes())
    if is_error:
        raise outcome
    return outcome


class _Helper:
    """A process that answers one question after another, and is started when it is needed."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._turn = threading.Lock()

    def ask(self, seconds: float, request: bytes) -> tuple[bool, object]:
        """Return whether the answer is an error, and the answer; None of a process that died or took too long."""
        with self._turn:
            process = self._running()
            assert process.stdin and process.stdout
            late = threading.Timer(CLOCK_PER_PROCESSOR * seconds, process.kill)
            late.start()
            try:
                process.stdin.write(request)
                process.stdin.flush()
                outcome: tuple[bool, object] = pickle.load(process.stdout)
            except (EOFError, OSError, pickle.UnpicklingError):
                self.end()
                return True, ProcessDied()
            except BaseException:  # interrupted: the answer that is still to come belongs to no question
                self.end()
                raise
            finally:
                late.cancel()
            return outcome

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self.end()
            paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
            environment = {**os.environ, "PYTHONPATH": paths}
            command = [sys.executable, "-m", __name__]
            pipe, quiet = subprocess.PIPE, subprocess.DEVNULL
            self._process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=quiet, env=environment)
        return self._process

    def end(self) -> None:
        """End the process if there is one."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            with contextlib.suppress(OSError):
                process.communicate()


_helper = _Helper()
atexit.register(_helper.end)


def ask(seconds: float, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a module-level function in a process that is kept for the next call, and return what it returns.

    The function may take `seconds` of processor time. What it raises is raised here; what it writes on the
    terminal, and warns of, is lost.

    Raises
    ------
    ProcessDied
        If the process ended without an answer, or exceeded the time limit and was stopped.
    """
    is_error, outcome = _helper.ask(seconds, pickle.dumps((seconds, function, args, kwargs)))
    if is_error:
        assert isinstance(outcome, BaseException)
        raise outcome
    return outcome  # type: ignore[return-value]


def _outcome(request: tuple[Callable[..., object], tuple[object, ...], dict[str, object]]) -> bytes:
    """Return whether a call raises, and what it returns or raises."""
    function, args, kwargs = request
    try:
        return pickle.dumps((False, function(*args, **kwargs)))
    except Exception as error:
        try:
            pickle.loads(outcome := pickle.dumps((True, error)))
        except Exception:  # some errors do not travel
            return pickle.dumps((True, RuntimeError(str(error))))
        return outcome


def _help(asked: IO[bytes], replies: IO[bytes]) -> None:
    """Answer questions until no more come."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who asks decides
    warnings.simplefilter("ignore")
    with contextlib.suppress(EOFError):
        while True:
            seconds, function, args, kwargs = pickle.load(asked)
            _allow(seconds)
            replies.write(_outcome((function, args, kwargs)))
            replies.flush()


def _allow(seconds: float) -> None:
    """End this process after so much more processor time, where the system can."""
    try:
        import resource
    except ImportError:  # Windows
        return
    spent = resource.getrusage(resource.RUSAGE_SELF)
    limit = math.ceil(spent.ru_utime + spent.ru_stime + seconds)
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    resource.setrlimit(resource.RLIMIT_CPU, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard))


@contextlib.contextmanager
def _no_file_remedy() -> Iterator[None]:
    """Say what to do where no file can be kept for a while."""
    try:
        yield
    except OSError as error:
        remedy = (
            f"no file can be kept there for a while ({error.strerror}); free space, or set TMPDIR to another folder"
        )
        raise InputError("environment", "TMPDIR", os.environ.get("TMPDIR"), remedy) from error


@contextlib.contextmanager
def _scratch() -> Iterator[Path]:
    """Make a folder, and remove it."""
    with _no_file_remedy():
        folder = tempfile.TemporaryDirectory(prefix="flexdesign-")
    with folder as name:
        yield Path(name)


def _serve(place: Path) -> None:
    """Answer what was given."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    function, args, kwargs = pickle.loads((place / GIVEN).read_bytes())
    try:
        outcome = pickle.dumps((False, function(*args, **kwargs)))
    except Exception as error:
        outcome = pickle.dumps((True, error))
    unfinished = place / "unfinished"
    unfinished.write_bytes(outcome)
    unfinished.replace(place / ANSWER)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        _serve(Path(sys.argv[1]))
    else:
        channel = os.fdopen(os.dup(1), "wb")
        os.dup2(2, 1)  # what libraries print is no answer
        _help(sys.stdin.buffer, channel)


def end_with_parent() -> None:
    """Let this process of `multiprocessing` end as soon as its parent is gone, even one that was killed.

    A pool's process otherwise waits for work for ever: it holds both ends of the queue that its parent wrote to.
    """
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_after, args=(parent.join,), daemon=True).start()


def _end_after(wait: Callable[[], object]) -> None:
    wait()
    os._exit(1)  # at once: nobody is left who would take an answer

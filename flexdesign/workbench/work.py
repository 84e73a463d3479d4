"""Long work in the background: in a thread that is asked to stop, or in a process that is ended."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from nicegui import run

import flexdesign as fd

T = TypeVar("T")
#: Seconds between two looks at whether something has ended.
LOOK = 0.02


class Cancelled(Exception):
    """The user ended the work."""


class Work:
    """What one client is waiting for; one piece at a time.

    `message` is what is going on, empty while nothing is.
    """

    def __init__(self) -> None:
        self.message, self._cancelled, self._yields = "", False, False
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether something is being done."""
        return bool(self.message)

    def say(self, text: str) -> None:
        """Take what is going on; raise Cancelled if the user has ended it."""
        if self._cancelled:
            raise Cancelled
        self.message = text or self.message

    def cancel(self) -> None:
        """End the work: a process at once, a thread where it next says what is going on."""
        self._cancelled = True
        if self._process is not None and self._process.poll() is None:
            if hasattr(os, "killpg"):
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(self._process.pid, signal.SIGKILL)  # with all that it has started
            else:
                self._process.kill()
        if self.message:
            self.message = "cancelling"

    async def is_free(self) -> bool:
        """Tell whether something may begin; what was done unasked is ended first."""
        if self._yields and self.is_busy:
            self.cancel()
            while self.is_busy:
                await asyncio.sleep(LOOK)
        return not self.is_busy

    async def in_thread(
        self, first: str, function: Callable[..., T], *args: Any, yields: bool = False, **options: Any
    ) -> T:
        """Run a function of the Python face that takes `progress` in a thread.

        Parameters
        ----------
        first
            What is said as it begins.
        function, args, options
            What is run.
        yields
            Whether it ends as soon as the user asks for something else.

        Raises
        ------
        Cancelled
            If the user ended it.
        """
        self.message, self._cancelled, self._yields = first, False, yields
        try:
            found = await run.io_bound(function, *args, **options, progress=self.say)
        finally:
            self.message = ""
        if self._cancelled or found is None:  # nothing is returned while the server shuts down
            raise Cancelled
        return found

    async def in_process(self, verb: str, arguments: list[Any], options: dict[str, Any], folder: Path) -> Any:
        """Run a function of the Python face in a process of its own; return title, summary, table and files.

        Parameters
        ----------
        verb
            Its name: one of `job_process.VERBS`.
        arguments, options
            What it is given.
        folder
            Where its report is written.

        Raises
        ------
        Cancelled
            If the user ended it.
        InputError
            If anything cannot be used.
        """
        self.message, self._cancelled, self._yields = "starting", False, False
        asked = {"verb": verb, "arguments": arguments, "options": options, "folder": str(folder)}
        paths = os.pathsep.join(str(Path(path).resolve()) for path in sys.path)
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "flexdesign.workbench.job_process"],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": paths}, start_new_session=True,
            )  # fmt: skip
            fact = await run.io_bound(self._last_fact, self._process, json.dumps(asked).encode())
            code = self._process.returncode
        finally:
            self.message, self._process = "", None
        if self._cancelled or fact is None:  # nothing is returned while the server shuts down
            raise Cancelled
        if "error" in fact:
            raise fd.InputError("workbench", verb, None, fact["error"])
        if "done" not in fact:
            raise fd.InputError("workbench", verb, None, f"ended without an answer (exit code {code})")
        return fact["done"]

    def _last_fact(self, process: subprocess.Popen[bytes], asked: bytes) -> dict[str, Any]:
        """Give a process what is asked, follow what it says, and return the last of it."""
        assert process.stdin and process.stdout
        fact: dict[str, Any] = {}
        with process, contextlib.suppress(BrokenPipeError):
            process.stdin.write(asked)
            process.stdin.close()
            for line in process.stdout:
                fact = json.loads(line)
                if "progress" in fact and not self._cancelled:
                    self.message = fact["progress"] or self.message
        return fact

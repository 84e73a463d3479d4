"""Native libraries that may end the whole process run in one of their own."""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class ProcessDied(Exception):
    """The process ended without an answer."""


def call(function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """Call a module-level function in a fresh process, in an empty scratch folder, and return what it returns.

    An interrupt from the keyboard ends that process and is raised here as KeyboardInterrupt, even where the library
    would have swallowed it.

    Raises
    ------
    ProcessDied
        If the process ended without an answer.
    """
    spawn = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory(prefix="flexdesign-") as scratch:
        try:
            with ProcessPoolExecutor(1, mp_context=spawn, initializer=_enter, initargs=(scratch,)) as pool:
                return pool.submit(function, *args, **kwargs).result()
        except BrokenProcessPool as error:
            raise ProcessDied(f"{function.__name__} ended without an answer") from error


def _enter(scratch: str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    os.chdir(scratch)
